//! JSON, with the comments that some write into it.

use serde_json::Value;

use super::FileError;
use super::text::malformed;

/// Reads a text. The parser bounds its depth; its size is bounded by the text's.
pub(super) fn parse(text: &str, format: &'static str) -> Result<Value, FileError> {
    serde_json::from_str(text).map_err(|error| malformed(format, error.to_string()))
}

/// The text with blanks in place of `//` and `/* */` comments outside of strings, so that lines and columns stay.
pub(super) fn without_comments(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text.chars().peekable();
    let (mut in_string, mut escaped) = (false, false);
    while let Some(c) = rest.next() {
        if in_string {
            in_string = escaped || c != '"';
            escaped = c == '\\' && !escaped;
            plain.push(c);
            continue;
        }
        match (c, rest.peek()) {
            ('/', Some('/')) => {
                while rest.peek().is_some_and(|next| *next != '\n') {
                    rest.next();
                    plain.push(' ');
                }
                plain.push(' ');
            }
            ('/', Some('*')) => {
                plain.push(' ');
                let mut last = ' ';
                rest.next();
                for inside in rest.by_ref() {
                    plain.push(if inside == '\n' { '\n' } else { ' ' });
                    if (last, inside) == ('*', '/') {
                        break;
                    }
                    last = inside;
                }
            }
            _ => {
                in_string = c == '"';
                plain.push(c);
            }
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_go_and_strings_stay() {
        let text = "// one\n{\"a//b\": 1, /* two\n*/ \"c\\\"//\": [2] // \"three\n}";
        let value = parse(&without_comments(text), "test").unwrap();
        assert_eq!(value, serde_json::json!({"a//b": 1, "c\"//": [2]}));
        assert_eq!(without_comments(text).matches('\n').count(), text.matches('\n').count());
        // What never ends, ends with the text.
        for open in ["/*", "//", "\"", "\"\\", "/"] {
            assert!(parse(&without_comments(open), "test").is_err(), "{open}");
        }
    }
}
