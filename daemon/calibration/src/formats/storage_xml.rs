//! FileStorage in XML: elements are names, and `_` is an item of a list.

use roxmltree::Node as Element;

use super::storage::Node;
use super::text::malformed;
use super::{FileError, limits, xml};

const FORMAT: &str = "OpenCV FileStorage (XML)";

/// Reads a document.
pub(super) fn parse(text: &str) -> Result<Node, FileError> {
    let document = xml::parse(text, FORMAT)?;
    let root = document.root_element();
    if root.tag_name().name() != "opencv_storage" {
        let message = format!("its root is <{}>, not <opencv_storage>", root.tag_name().name());
        return Err(malformed(FORMAT, message));
    }
    node(root, 0)
}

/// A value and what it holds, to a bounded depth: whoever reads or drops it recurses.
fn node(element: Element<'_, '_>, depth: usize) -> Result<Node, FileError> {
    if depth > limits::DEPTH {
        return Err(malformed(FORMAT, format!("its elements are more than {} deep", limits::DEPTH)));
    }
    let mut children = element.children().filter(Element::is_element).peekable();
    let named = |child: Element<'_, '_>| Ok((child.tag_name().name().to_owned(), node(child, depth + 1)?));
    match children.peek().map(|first| first.tag_name().name()) {
        None => Ok(Node::Text(element.text().unwrap_or_default().trim().to_owned())),
        Some("_") => children.map(|child| node(child, depth + 1)).collect::<Result<_, _>>().map(Node::List),
        Some(_) => children.map(named).collect::<Result<_, _>>().map(Node::Map),
    }
}
