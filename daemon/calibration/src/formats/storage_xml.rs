//! FileStorage in XML: elements are names, and `_` is an item of a list.

use roxmltree::Node as Element;

use super::storage::Node;
use super::text::malformed;
use super::{FileError, xml};

const FORMAT: &str = "OpenCV FileStorage (XML)";

/// Reads a document.
pub(super) fn parse(text: &str) -> Result<Node, FileError> {
    let document = xml::parse(text, FORMAT)?;
    let root = document.root_element();
    if root.tag_name().name() != "opencv_storage" {
        let message = format!("its root is <{}>, not <opencv_storage>", root.tag_name().name());
        return Err(malformed(FORMAT, message));
    }
    Ok(node(root))
}

/// The depth is bounded by [`xml::parse`].
fn node(element: Element<'_, '_>) -> Node {
    let mut children = element.children().filter(Element::is_element).peekable();
    match children.peek().map(|first| first.tag_name().name()) {
        None => Node::Text(element.text().unwrap_or_default().trim().to_owned()),
        Some("_") => Node::List(children.map(node).collect()),
        Some(_) => Node::Map(children.map(|child| (child.tag_name().name().to_owned(), node(child))).collect()),
    }
}
