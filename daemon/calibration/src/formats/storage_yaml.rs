//! FileStorage in YAML, as OpenCV 4 (`%YAML:1.0`) and 5 (`%YAML 1.2`) write it.
//!
//! Events are taken one by one and a tree is made of them with a bound on nodes and depth. Anchors and aliases, by which a
//! few lines become gigabytes, are refused: OpenCV writes none.

use saphyr_parser::{Event, Parser};

use super::storage::Node;
use super::text::malformed;
use super::{FileError, limits};

const FORMAT: &str = "OpenCV FileStorage (YAML)";

/// A list or a map that is being filled.
enum Open {
    List(Vec<Node>),
    /// The entries so far, and the name of the next one once it has been read.
    Map(Vec<(String, Node)>, Option<String>),
}

/// Reads the first document.
pub(super) fn parse(text: &str) -> Result<Node, FileError> {
    // `%YAML:1.0` is no directive of YAML's; blanks in its place leave all line numbers as they are. The version says
    // nothing else: matrices look alike under both.
    let has_directive = text.starts_with("%YAML");
    let body = if has_directive { text.find('\n').map_or("", |end| &text[end..]) } else { text };

    let mut open: Vec<Open> = Vec::new();
    let mut nodes = 0_u32;
    for event in Parser::new_from_str(body) {
        let (event, span) = event.map_err(|error| malformed(FORMAT, error.to_string()))?;
        let line = span.start.line();
        nodes += 1;
        if nodes > limits::NODES || open.len() > limits::DEPTH {
            return Err(malformed(FORMAT, format!("line {line}: it has too many nodes, or too deep ones")));
        }
        let done = match event {
            Event::Alias(_) => return Err(malformed(FORMAT, format!("line {line}: aliases are not read"))),
            Event::SequenceStart(..) => {
                open.push(Open::List(Vec::new()));
                continue;
            }
            Event::MappingStart(..) => {
                open.push(Open::Map(Vec::new(), None));
                continue;
            }
            Event::Scalar(text, ..) => Node::Text(text.into_owned()),
            Event::SequenceEnd | Event::MappingEnd => match open.pop() {
                Some(Open::List(items)) => Node::List(items),
                Some(Open::Map(entries, _)) => Node::Map(entries),
                None => return Err(malformed(FORMAT, format!("line {line}: something ends that has not begun"))),
            },
            Event::DocumentEnd | Event::StreamEnd => break,
            Event::Nothing | Event::StreamStart | Event::DocumentStart(_) => continue,
        };
        match (open.last_mut(), done) {
            (None, root) => return Ok(root),
            (Some(Open::List(items)), item) => items.push(item),
            (Some(Open::Map(entries, name)), node) => match (name.take(), node) {
                (Some(name), node) => entries.push((name, node)),
                (None, Node::Text(text)) => *name = Some(text),
                (None, _) => return Err(malformed(FORMAT, format!("line {line}: a name is no text"))),
            },
        }
    }
    Err(malformed(FORMAT, "nothing is in it".to_owned()))
}
