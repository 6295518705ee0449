//! XML as all formats read it: no document type, so no entities that grow; bounded in elements. The parser does not recurse, so
//! depth is for those to bound who do.

use roxmltree::{Document, Node, ParsingOptions};

use super::text::{malformed, number};
use super::{FileError, limits};

/// Reads a document.
pub(super) fn parse<'a>(text: &'a str, format: &'static str) -> Result<Document<'a>, FileError> {
    let options = ParsingOptions { nodes_limit: limits::NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|error| malformed(format, error.to_string()))
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
