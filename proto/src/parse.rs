//! From a line to a request, or to a refusal that says where the line is wrong.

use crate::reply::{ErrorBody, Outcome, Reply};
use crate::request::{Id, Op, Request};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use serde_path_to_error::{Path, Segment};

/// A line that is no request.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{error}")]
pub struct Refusal {
    /// The line's number, where that much could be read.
    pub id: Option<Id>,
    /// Why; its code is `bad-json`, `bad-request` or `unknown-op`.
    pub error: ErrorBody,
}

impl From<Refusal> for Reply {
    fn from(refusal: Refusal) -> Self {
        Self { id: refusal.id, outcome: Outcome::Error(refusal.error) }
    }
}

/// Reads one line, its newline left off.
///
/// # Errors
/// A [`Refusal`] with code `bad-json` (no JSON, or not UTF-8), `unknown-op`, or `bad-request` (JSON of another shape than
/// the contract's: a field that is missing, unknown, of a wrong type or out of its range), `at` naming the place.
pub fn parse_line(line: &[u8]) -> Result<Request, Refusal> {
    parse(line, parse_op)
}

/// The same, where `edits` of the line stands for a list that came in another way: a JSON text, or why there is none.
///
/// # Errors
/// As [`parse_line`]; places are those of the list.
pub fn parse_line_with(line: &[u8], edits: Result<Vec<u8>, ErrorBody>) -> Result<Request, Refusal> {
    parse(line, |mut fields| {
        let named =
            fields.get("op").is_some_and(|op| op == "scene.apply") && fields.get("edits").is_some_and(Value::is_string);
        if !named {
            return parse_op(fields);
        }
        // Everything but the list is read as ever, with an empty one in its place.
        fields.insert("edits".to_owned(), Value::Array(vec![]));
        let mut op = parse_op(fields)?;
        if let Op::SceneApply(apply) = &mut op {
            let text = edits?;
            let mut reader = serde_json::Deserializer::from_slice(&text);
            apply.edits = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
                let at = place(error.path(), &error.inner().to_string());
                let dot = if at.is_empty() || at.starts_with('[') { "" } else { "." };
                ErrorBody::new("bad-request", error.into_inner().to_string()).at(format!("edits{dot}{at}"))
            })?;
            reader.end().map_err(|error| ErrorBody::new("bad-request", error.to_string()).at("edits"))?;
        }
        Ok(op)
    })
}

fn parse(line: &[u8], op: impl FnOnce(Map<String, Value>) -> Result<Op, ErrorBody>) -> Result<Request, Refusal> {
    let anonymous = |error| Refusal { id: None, error };
    let value: Value = serde_json::from_slice(line)
        .map_err(|e| anonymous(ErrorBody::new("bad-json", format!("the line is no JSON: {e}"))))?;
    let Value::Object(mut fields) = value else {
        return Err(anonymous(ErrorBody::new(
            "bad-request",
            "a request is a JSON object such as {\"id\": 1, \"op\": \"hello\"}",
        )));
    };

    // The id comes first, so that every later refusal can carry it.
    let id = match fields.remove("id") {
        Some(Value::Number(id)) => id,
        Some(_) => return Err(anonymous(ErrorBody::new("bad-request", "`id` is not a number").at("id"))),
        None => return Err(anonymous(ErrorBody::new("bad-request", "missing field `id`").at("id"))),
    };
    match op(fields) {
        Ok(op) => Ok(Request { id, op }),
        Err(error) => Err(Refusal { id: Some(id), error }),
    }
}

fn parse_op(mut fields: Map<String, Value>) -> Result<Op, ErrorBody> {
    let name = match fields.remove("op") {
        Some(Value::String(name)) => name,
        Some(_) => return Err(ErrorBody::new("bad-request", "`op` is not a string").at("op")),
        None => return Err(ErrorBody::new("bad-request", "missing field `op`").at("op")),
    };
    match name.as_str() {
        "hello" => nothing(&name, &fields).map(|()| Op::Hello),
        "status" => nothing(&name, &fields).map(|()| Op::Status),
        "scene.get" => nothing(&name, &fields).map(|()| Op::SceneGet),
        "scene.apply" => read(fields).map(Op::SceneApply),
        "pose" => read(fields).map(Op::Pose),
        "snapshot" => read(fields).map(Op::Snapshot),
        "subscribe" => read(fields).map(Op::Subscribe),
        "pattern" => read(fields).map(Op::Pattern),
        "export.open" => read(fields).map(Op::ExportOpen),
        "export.release" => read(fields).map(Op::ExportRelease),
        "config.reload" => nothing(&name, &fields).map(|()| Op::ConfigReload),
        _ => {
            // The name is echoed, but no more of it than a person would read.
            let shown: String = name.chars().take(64).collect();
            let message = format!("there is no op `{shown}`; there are {}", Op::NAMES.join(", "));
            Err(ErrorBody::new("unknown-op", message).at("op"))
        }
    }
}

fn nothing(op: &str, fields: &Map<String, Value>) -> Result<(), ErrorBody> {
    match fields.keys().next() {
        None => Ok(()),
        Some(key) => Err(ErrorBody::new("bad-request", format!("unknown field `{key}`: `{op}` takes none")).at(key)),
    }
}

fn read<T: DeserializeOwned>(fields: Map<String, Value>) -> Result<T, ErrorBody> {
    serde_path_to_error::deserialize(Value::Object(fields)).map_err(|error| {
        let at = place(error.path(), &error.inner().to_string());
        ErrorBody::new("bad-request", error.into_inner().to_string()).at(at)
    })
}

/// The place as the contract writes it: `edits[3].node`, the edit's kind left out.
///
/// A field that is missing is in no path, so its name comes from the message.
fn place(path: &Path, message: &str) -> String {
    let mut at = String::new();
    let name = |at: &mut String, key: &str| {
        if !at.is_empty() {
            at.push('.');
        }
        at.push_str(key);
    };
    for segment in path.iter() {
        match segment {
            Segment::Seq { index } => at.push_str(&format!("[{index}]")),
            Segment::Map { key } => name(&mut at, key),
            Segment::Enum { .. } | Segment::Unknown => {}
        }
    }
    if let Some(key) = message.strip_prefix("missing field `").and_then(|rest| rest.split('`').next()) {
        name(&mut at, key);
    }
    at
}

#[cfg(test)]
mod tests;
