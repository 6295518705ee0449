//! The control socket over the real editor, without a device: a client that says what a fuzzer has made up.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use lantern::control::{Door, Engine, Events, Listener, Picture, Rules, Server};
use lantern::feed::Lent;
use lantern_proto::status::TrackerStatus;
use lantern_proto::{
    Applied, Edit, ErrorBody, ExportOpen, Hello, Layer, MAX_LINE_BYTES, PatternRequest, Pose, Reloaded, SceneGet, Status,
};
use lantern_scene::Editor;
use serde_json::Value;
use tokio::runtime::Runtime;

use crate::scene;

/// The first byte of an input whose first line is longer than a line may be.
const TOO_LONG: u8 = 0xff;

/// No answer takes longer.
const PATIENCE: Duration = Duration::from_secs(8);

/// What the socket asks, answered by an editor and nothing else.
struct Desk {
    editor: Mutex<Editor>,
    events: Arc<Events>,
}

impl Desk {
    fn editor(&self) -> std::sync::MutexGuard<'_, Editor> {
        self.editor.lock().expect("an edit has panicked")
    }
}

impl Engine for Desk {
    fn hello(&self) -> Hello {
        Hello { protocol: 1, version: "fuzz".into(), projectors: vec!["left".into()] }
    }

    fn status(&self) -> Status {
        Status::default()
    }

    fn trackers(&self) -> BTreeMap<String, TrackerStatus> {
        BTreeMap::new()
    }

    fn events(&self) -> &Arc<Events> {
        &self.events
    }

    fn scene_get(&self) -> SceneGet {
        let scene = self.editor().current();
        SceneGet { revision: scene.revision, edits: scene.edits() }
    }

    fn apply(&self, edits: &[Edit], durable: bool) -> Result<Applied, ErrorBody> {
        let mut editor = self.editor();
        let before = editor.current();
        match editor.apply(edits) {
            Ok(scene) => Ok(Applied { revision: scene.revision, frame: 1, durable }),
            Err(error) => {
                assert!(Arc::ptr_eq(&before, &editor.current()), "a refused list has changed the scene: {error}");
                Err(ErrorBody::new(error.code, error.message).at(error.at))
            }
        }
    }

    fn pose(&self, _: &Pose) -> Result<(), ErrorBody> {
        Ok(())
    }

    fn snapshot(&self, _: &str, _: Layer) -> Result<Picture, ErrorBody> {
        Ok(Picture { format: "png", bytes: b"\n{x".to_vec() })
    }

    fn pattern(&self, _: &PatternRequest) -> Result<(), ErrorBody> {
        Ok(())
    }

    fn export(&self, open: &ExportOpen) -> Result<Lent, ErrorBody> {
        Err(ErrorBody::new("no-export", format!("projector `{}` goes nowhere", open.projector)).at("projector"))
    }

    fn reload(&self) -> Result<Reloaded, ErrorBody> {
        Ok(Reloaded { revision: 1 })
    }
}

/// Serves for as long as the process lives.
struct Served {
    desk: Arc<Desk>,
    base: Editor,
    path: PathBuf,
    _server: Server,
    _runtime: Runtime,
}

fn served() -> &'static Served {
    static SERVED: OnceLock<Served> = OnceLock::new();
    SERVED.get_or_init(|| {
        let path = scene::folder().join("socket");
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.expect("the fuzzer's threads");
        let base = scene::editor();
        let desk = Arc::new(Desk { editor: Mutex::new(base.clone()), events: Arc::default() });
        let rules = Rules::new(Door::open(), 16, u32::MAX);
        let listener = Listener::bind(&path, rules.door.gid()).expect("the fuzzer's own socket");
        let server = Server::start(runtime.handle(), listener, desk.clone(), rules).expect("the fuzzer's own server");
        Served { desk, base, path, _server: server, _runtime: runtime }
    })
}

/// Says it all, and hears what is answered.
///
/// # Panics
/// Where a line has no answer, or one that is none; where the daemon goes on after a line that is too long, or falls silent; where the
/// scene that is left cannot be kept and restored.
pub fn say(data: &[u8]) {
    let served = served();
    *served.desk.editor() = served.base.clone();
    let mut stream = UnixStream::connect(&served.path).expect("the fuzzer's own socket");
    stream.set_read_timeout(Some(PATIENCE)).expect("a limit");
    let too_long = data.first() == Some(&TOO_LONG);
    if too_long {
        // The daemon hangs up on this, perhaps before all of it is said.
        let _ = stream.write_all(&vec![b' '; MAX_LINE_BYTES + 1]);
    }
    // In two pieces, so that a line may come in parts.
    let (first, second) = data.split_at(data.len() / 2);
    let _ = stream.write_all(first).and_then(|()| stream.write_all(second));
    let _ = stream.shutdown(Shutdown::Write);

    let mut stream = BufReader::new(stream);
    let (mut answers, mut line) = (0, String::new());
    loop {
        line.clear();
        if stream.read_line(&mut line).expect("the daemon falls silent") == 0 {
            break;
        }
        let reply: Value = serde_json::from_str(&line).expect("a reply is JSON");
        assert!(reply.get("id").is_some(), "{line}");
        match (&reply["ok"], &reply["error"]) {
            (Value::Object(ok), Value::Null) => {
                if ok.contains_key("format") {
                    stream.read_exact(&mut [0; 3]).expect("the picture");
                }
            }
            (Value::Null, Value::Object(error)) => assert!(error["code"].is_string() && error["message"].is_string()),
            _ => panic!("neither ok nor error: {line}"),
        }
        answers += 1;
    }
    let lines = data.split(|&byte| byte == b'\n').count() - usize::from(data.is_empty() || data.ends_with(b"\n"));
    assert_eq!(answers, if too_long { 1 } else { lines }, "not an answer for each line");
    scene::is_restored(&served.desk.editor());
}
