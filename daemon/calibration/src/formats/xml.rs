//! XML as all formats read it: no document type, so no entities that grow; bounded in elements and depth.

use roxmltree::{Document, Node, ParsingOptions};

use super::text::{malformed, number};
use super::{FileError, limits};

/// Reads a document.
pub(super) fn parse<'a>(text: &'a str, format: &'static str) -> Result<Document<'a>, FileError> {
    check_depth(text, format)?;
    let options = ParsingOptions { nodes_limit: limits::NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|error| malformed(format, error.to_string()))
}

/// Counts open elements before the parser sees them. It counts a little more than there are (a `<` in a comment or in
/// character data), and never less.
fn check_depth(text: &str, format: &'static str) -> Result<(), FileError> {
    let bytes = text.as_bytes();
    let mut depth = 0_usize;
    for (at, _) in bytes.iter().enumerate().filter(|(_, byte)| **byte == b'<') {
        match bytes.get(at + 1) {
            Some(b'/') => depth = depth.saturating_sub(1),
            Some(b'?' | b'!') | None => {}
            Some(_) => {
                let end = bytes[at..].iter().position(|byte| *byte == b'>').map(|length| at + length);
                let is_closed = end.is_none_or(|end| bytes[end - 1] == b'/');
                depth += usize::from(!is_closed);
            }
        }
        if depth > limits::DEPTH {
            return Err(malformed(format, format!("its elements are more than {} deep", limits::DEPTH)));
        }
    }
    Ok(())
}

/// Child elements of a name, in whatever case it is written.
pub(super) fn children<'a, 'i>(of: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    of.children().filter(move |child| child.is_element() && child.tag_name().name().eq_ignore_ascii_case(name))
}

/// The first child element of a name.
pub(super) fn child<'a, 'i>(of: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children(of, name).next()
}

/// The same where it must be there.
pub(super) fn needed<'a, 'i>(
    of: Node<'a, 'i>,
    name: &'static str,
    format: &'static str,
) -> Result<Node<'a, 'i>, FileError> {
    child(of, name).ok_or_else(|| malformed(format, format!("<{}> has no <{name}>", of.tag_name().name())))
}

/// The number in a child element.
pub(super) fn child_number(of: Node<'_, '_>, name: &'static str, format: &'static str) -> Result<f64, FileError> {
    number(needed(of, name, format)?.text().unwrap_or_default(), format, name)
}

/// The text of a child element, where there is any.
pub(super) fn child_text<'a>(of: Node<'a, '_>, name: &'static str) -> Option<&'a str> {
    child(of, name)?.text().map(str::trim).filter(|text| !text.is_empty())
}

/// An attribute of a name, in whatever case it is written.
pub(super) fn attribute<'a>(of: Node<'a, '_>, name: &str) -> Option<&'a str> {
    of.attributes().find(|attribute| attribute.name().eq_ignore_ascii_case(name)).map(|attribute| attribute.value())
}
