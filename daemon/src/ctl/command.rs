//! From arguments to requests, and from answers to text.

use super::args::{Apply, Arguments, Command, Load, Pose, Scene, Snapshot};
use super::client::Client;
use super::{Failure, print, read, table, watch};
use crate::socket_path;
use lantern_proto::{Applied, SnapshotHead};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::path::Path;

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    // What cannot be asked is said before anyone is asked.
    let request = request(&arguments.command)?;
    let path = socket_path::resolve(arguments.socket.as_deref(), None).map_err(|e| Failure::Usage(e.to_string()))?;
    let mut client = Client::connect(&path)?;
    if let Command::Watch(watch) = &arguments.command {
        return watch::watch(&path, client, watch, arguments.json);
    }
    let answer = client.ask(request)?;

    // A snapshot's bytes belong to its answer, whichever way that is shown.
    if let Command::Snapshot(snapshot) = &arguments.command {
        return save(&mut client, snapshot, &answer, arguments.json);
    }
    if arguments.json {
        return print(&format!("{answer}\n"));
    }
    match &arguments.command {
        Command::Status | Command::Watch(_) => print(&table::status(&read(answer)?)),
        Command::Scene(Scene::Get) => print(&edits_text(&answer)),
        Command::Scene(Scene::Apply(_)) | Command::Load(_) => {
            let Applied { revision, frame, durable } = read(answer)?;
            let kept = if durable { "" } else { ", not kept across a restart" };
            print(&format!("revision {revision}, first shown by frame {frame}{kept}\n"))
        }
        Command::Reload => print("the configuration was read again\n"),
        Command::Pose(_) | Command::Pattern(_) | Command::Snapshot(_) => Ok(()),
    }
}

/// The request of a command, its id left out.
fn request(command: &Command) -> Result<Value, Failure> {
    Ok(match command {
        Command::Status | Command::Watch(_) => json!({"op": "status"}),
        Command::Scene(Scene::Get) => json!({"op": "scene.get"}),
        Command::Scene(Scene::Apply(Apply { file, not_durable })) => {
            json!({"op": "scene.apply", "edits": edits(file)?, "durable": !not_durable})
        }
        Command::Load(Load { uri, node, role }) => {
            let mut add = json!({"node": node, "uri": absolute(uri)});
            if let Some(role) = role {
                add["role"] = role.as_str().into();
            }
            json!({"op": "scene.apply", "edits": [{"add": add}]})
        }
        Command::Pose(Pose { body, numbers }) => match numbers.as_slice() {
            [x, y, z] => json!({"op": "pose", "body": body, "position_m": [x, y, z]}),
            [x, y, z, orientation @ ..] if orientation.len() == 4 => {
                json!({"op": "pose", "body": body, "position_m": [x, y, z], "orientation": orientation})
            }
            _ => {
                let message = format!("a pose has 3 or 7 numbers, not {}; hint: X Y Z [QX QY QZ QW]", numbers.len());
                return Err(Failure::Usage(message));
            }
        },
        Command::Snapshot(Snapshot { projector, layer, .. }) => {
            json!({"op": "snapshot", "projector": projector, "layer": layer})
        }
        Command::Pattern(pattern) => {
            let mut request = json!({"op": "pattern", "name": pattern.name});
            if let Some(projector) = &pattern.projector {
                request["projector"] = projector.as_str().into();
            }
            request
        }
        Command::Reload => json!({"op": "config.reload"}),
    })
}

/// The edits of a file, as an array; what they mean is for the daemon to judge.
fn edits(file: &Path) -> Result<Value, Failure> {
    let unreadable = |error: std::io::Error| Failure::Usage(format!("cannot read {}: {error}", file.display()));
    let text = if file == Path::new("-") {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map_err(unreadable)?;
        text
    } else {
        std::fs::read_to_string(file).map_err(unreadable)?
    };
    let shape = "hint: write a JSON array of edits, as `lanternctl scene apply --help` shows";
    let wrong = |what: String| Failure::Usage(format!("{}: {what}; {shape}", file.display()));
    match serde_json::from_str(&text).map_err(|error| wrong(format!("no JSON: {error}")))? {
        Value::Array(edits) => Ok(Value::Array(edits)),
        Value::Object(mut whole) => match whole.remove("edits") {
            Some(Value::Array(edits)) => Ok(Value::Array(edits)),
            _ => Err(wrong("an object without an array `edits`".to_owned())),
        },
        _ => Err(wrong("neither an array nor an object".to_owned())),
    }
}

/// The full path of a file that is here; what is no file here is sent as it is.
fn absolute(uri: &str) -> String {
    let full = std::fs::canonicalize(uri).ok().filter(|path| path.is_file());
    // A path that is no UTF-8 cannot travel in JSON; the daemon will say that it finds nothing there.
    full.and_then(|path| path.into_os_string().into_string().ok()).unwrap_or_else(|| uri.to_owned())
}

fn save(client: &mut Client, snapshot: &Snapshot, answer: &Value, json: bool) -> Result<(), Failure> {
    let SnapshotHead { bytes: count, .. } = read(answer.clone())?;
    let bytes = client.bytes(count)?;
    if snapshot.output == Path::new("-") {
        let mut stdout = std::io::stdout().lock();
        stdout.write_all(&bytes)?;
        stdout.flush()?;
        return Ok(());
    }
    std::fs::write(&snapshot.output, &bytes)
        .map_err(|error| Failure::Usage(format!("cannot write {}: {error}", snapshot.output.display())))?;
    if json { print(&format!("{answer}\n")) } else { Ok(()) }
}

/// One edit a line, so that files of them can be compared.
fn edits_text(answer: &Value) -> String {
    let edits = answer["edits"].as_array().map(Vec::as_slice).unwrap_or_default();
    let lines: Vec<_> = edits.iter().map(Value::to_string).collect();
    format!("[{}]\n", lines.join(",\n "))
}
