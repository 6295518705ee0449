//! Pictures that other processes import: an independent program reads the pixels of the snapshots, and no client holds up the daemon or
//! another client.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use lantern_tests::client::Client;
use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Nothing takes longer to be let go of, even beside other tests.
const LIMIT: Duration = Duration::from_secs(30);

/// Images of one client.
const IMAGES: u64 = 3;

/// The room, whose projector `left` goes where this says.
fn room(output: &str) -> String {
    let left = lab::stand(-1.0).toml("left").replace("{ kind = \"headless\" }", output);
    [lab::RENDER, lab::SCENE, lab::TRACKED, &left, &lab::stand(1.0).toml("right")].join("\n")
}

fn start() -> Daemon {
    Daemon::start(&room("{ kind = \"export\" }")).unwrap()
}

fn ends_well(mut daemon: Daemon) {
    assert_eq!(daemon.client().unwrap().status().unwrap()["device"]["validation_messages"], 0);
    assert!(daemon.stop().unwrap().success());
    assert_eq!(daemon.ills(), Vec::<String>::new());
}

/// What `status` says of the export.
fn screen(client: &mut Client) -> Value {
    client.status().unwrap()["projectors"]["left"]["screen"].clone()
}

/// Waits until something is so.
fn comes(what: &str, mut is_so: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < LIMIT, "{what} does not come");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Moves the ball, and gives the revision.
fn edit(client: &mut Client, x: f64) -> u64 {
    let edits = json!([{"set": {"node": "ball", "translation_m": [x, 0.4, 0]}}]);
    client.apply(edits).unwrap()["revision"].as_u64().unwrap()
}

/// A connection with an export, whose descriptors it lets go.
fn reader(daemon: &Daemon) -> (Client, Value) {
    let mut client = daemon.client().unwrap();
    let opened = client.ask_ok("export.open", json!({"projector": "left"})).unwrap();
    (client, opened)
}

fn told(client: &mut Client) -> Value {
    let event = client.line().unwrap().unwrap();
    assert_eq!((&event["event"], &event["projector"]), (&json!("export"), &json!("left")), "{event}");
    event
}

/// The program that imports, as C compilers of the machine make it.
fn compiled(folder: &Path) -> PathBuf {
    let (source, program) = (Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/export/import.c")), folder.join("import"));
    let mut compiler = Command::new("cc");
    compiler.args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-O1"]).arg(source).arg("-lvulkan").arg("-o");
    let output = compiler.arg(&program).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}\nhint: packaging/test installs libvulkan-dev");
    program
}

/// The program at work.
struct Import {
    child: Child,
    said: BufReader<ChildStdout>,
    next: Option<ChildStdin>,
    out: PathBuf,
    _folder: TempDir,
}

impl Import {
    fn start(daemon: &Daemon, projector: &str, count: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("picture");
        let mut command = Command::new(compiled(folder.path()));
        command.arg(daemon.socket()).arg(projector).arg(&out).arg(count.to_string());
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (said, next) = (BufReader::new(child.stdout.take().unwrap()), child.stdin.take());
        Self { child, said, next, out, _folder: folder }
    }

    /// The event that it was told, its colour and its depth.
    fn picture(&mut self, n: u32) -> (Value, Vec<[u8; 4]>, Vec<f32>) {
        let mut line = String::new();
        self.said.read_line(&mut line).unwrap();
        let event = line.strip_prefix(&format!("picture {n} ")).unwrap_or_else(|| panic!("it says {line:?}"));
        let words = |kind: &str| -> Vec<[u8; 4]> {
            let bytes = fs::read(format!("{}.{n}.{kind}", self.out.display())).unwrap();
            bytes.chunks_exact(4).map(|word| word.try_into().unwrap()).collect()
        };
        let depth = words("depth").into_iter().map(f32::from_le_bytes).collect();
        (serde_json::from_str(event).unwrap(), words("rgba"), depth)
    }

    fn go_on(&mut self) {
        self.next.as_mut().unwrap().write_all(b"\n").unwrap();
    }
}

/// Compares what the program reads with the snapshots.
fn compared(client: &mut Client, projector: &str, import: &mut Import, n: u32) -> Vec<[u8; 4]> {
    let (event, color, depth) = import.picture(n);
    let of = &client.status().unwrap()["projectors"][projector];
    let told = (&event["projector"], &event["revision"], &event["frame"], &event["missed"]);
    assert_eq!(told, (&json!(projector), &of["revision"], &of["frame"], &json!(0)), "{of}");

    // The bytes are the same: colour is copied, and so is depth; where it is turned round, by the same subtraction.
    let (shown, layer) = (client.png(projector, "color").unwrap(), client.layer(projector, "depth").unwrap());
    assert!(color.iter().map(|p| [p[0], p[1], p[2]]).eq(shown.pixels().map(|p| p.0)));
    assert!(color.iter().all(|p| p[3] == 255));
    assert!(depth.iter().map(|z| z.to_bits()).eq(layer.values.iter().map(|z| z.to_bits())));
    assert!(depth.contains(&1.0) && depth.iter().any(|z| *z < 1.0), "something is hit, and something missed");
    color
}

#[test]
fn another_program_reads_the_pixels_of_the_snapshots() {
    // Two projectors, of which the second has the nearer depth as the greater one.
    let stands = [lab::stand(-1.0), lab::stand(1.0)];
    let [x, y, z, w] = stands[1].projection();
    let exports = |toml: String| toml.replace("{ kind = \"headless\" }", "{ kind = \"export\" }");
    let right =
        stands[1].toml("right").replace(&format!("{:?}", [x, y, z, w]), &format!("{:?}", [x, y, z.map(|z| -z), w]));
    let projectors = exports(stands[0].toml("left") + &right);
    let daemon = Daemon::start(&[lab::RENDER, lab::SCENE, lab::TRACKED, &projectors].join("\n")).unwrap();
    let mut client = daemon.client().unwrap();
    let mut imports = ["left", "right"].map(|projector| (projector, Import::start(&daemon, projector, 3), Vec::new()));
    for n in 0..3u32 {
        match n {
            0 => {}
            1 => drop(edit(&mut client, 0.3)),
            _ => drop(client.ask_ok("pattern", json!({"name": "grid"})).unwrap()),
        }
        for (projector, import, pictures) in &mut imports {
            if n > 0 {
                import.go_on();
            }
            pictures.push(compared(&mut client, projector, import, n));
        }
    }
    for (_, mut import, pictures) in imports {
        assert!(pictures[0] != pictures[1] && pictures[1] != pictures[2]);
        assert!(import.child.wait().unwrap().success());
    }
    comes("its leave", || screen(&mut client)["readers"] == 0);
    ends_well(daemon);
}

#[test]
fn who_holds_all_images_misses_pictures_and_holds_up_nobody() {
    let daemon = start();
    let mut client = daemon.client().unwrap();
    let (mut holder, opened) = reader(&daemon);
    assert_eq!((&opened["images"], &opened["handle"]), (&json!(IMAGES), &json!("opaque-fd")));
    let (mut other, _) = reader(&daemon);
    let (mut held, mut last) = (vec![told(&mut holder)["image"].clone()], told(&mut other));
    for turn in 1..6u32 {
        other.ask_ok("export.release", json!({"image": last["image"]})).unwrap();
        let revision = edit(&mut client, 0.1 * f64::from(turn));
        last = told(&mut other);
        assert_eq!((&last["revision"], &last["missed"]), (&json!(revision), &json!(0)));
        if (held.len() as u64) < IMAGES {
            let event = told(&mut holder);
            assert_eq!(event["revision"], revision);
            held.push(event["image"].clone());
        }
    }
    held.sort_by_key(Value::as_u64);
    assert_eq!(held, [0, 1, 2]);
    let of = screen(&mut client);
    assert_eq!((&of["state"], &of["readers"], &of["readers_missed"]), (&json!("shown"), &json!(2), &json!(3)));

    // Once it gives one back it has the newest, without anything's changing.
    holder.ask_ok("export.release", json!({"image": 1})).unwrap();
    let newest = told(&mut holder);
    assert_eq!((&newest["image"], &newest["missed"]), (&json!(1), &json!(3)));
    assert_eq!((&newest["revision"], &newest["frame"]), (&last["revision"], &last["frame"]));
    for image in [json!(1), json!(IMAGES), json!(7)] {
        let given = holder.ask("export.release", json!({"image": image})).unwrap();
        assert_eq!(given.is_ok(), image == json!(1), "{image}");
        assert!(given.is_ok() || given.is_err_and(|refused| refused.code == "not-held"));
    }
    ends_well(daemon);
}

#[test]
fn who_dies_gives_everything_back() {
    let daemon = start();
    let mut client = daemon.client().unwrap();
    let open_files = |daemon: &Daemon| fs::read_dir(format!("/proc/{}/fd", daemon.pid())).unwrap().count();
    drop(reader(&daemon));
    comes("the leave of the first", || screen(&mut client)["readers"] == 0);
    let before = open_files(&daemon);

    // One in the middle of its work, by SIGKILL; others as fast as they can be, with all of their images.
    let mut import = Import::start(&daemon, "left", 9);
    import.picture(0);
    import.child.kill().unwrap();
    import.child.wait().unwrap();
    for turn in 0..20u32 {
        comes("room for another", || screen(&mut client)["readers"].as_u64().unwrap() < 4);
        let (mut one, _) = reader(&daemon);
        told(&mut one);
        edit(&mut client, 0.02 * f64::from(turn + 1));
        told(&mut one);
    }
    comes("the leave of all", || screen(&mut client)["readers"] == 0);
    comes("as few files as before", || open_files(&daemon) <= before);
    ends_well(daemon);
}

#[test]
fn what_cannot_be_exported_is_refused_in_words() {
    let daemon = start();
    let refused = |client: &mut Client, of: Value| client.ask("export.open", of).unwrap().unwrap_err();
    let mut client = daemon.client().unwrap();
    let nowhere = refused(&mut client, json!({"projector": "right"}));
    assert_eq!((nowhere.code.as_str(), nowhere.at.as_str()), ("no-export", "projector"));
    assert!(nowhere.message.contains("output = { kind = \"export\" }"), "{nowhere}");
    assert_eq!(refused(&mut client, json!({"projector": "middle"})).code, "unknown-projector");
    assert_eq!(refused(&mut client, json!({"projector": "left", "handle": "file"})).code, "bad-request");
    // A driver of software has no dma-bufs; a GPU that has them gives one.
    if let Err(no_dma_buf) = client.ask("export.open", json!({"projector": "left", "handle": "dma-buf"})).unwrap() {
        assert_eq!(no_dma_buf.code, "no-export");
        assert!(no_dma_buf.message.contains("VK_EXT_external_memory_dma_buf"), "{no_dma_buf}");
    }
    drop(client);

    let mut client = daemon.client().unwrap();
    comes("the leave of the first", || screen(&mut client)["readers"] == 0);
    let mut four: Vec<_> = (0..4).map(|_| reader(&daemon).0).collect();
    assert_eq!(refused(&mut four[0], json!({"projector": "left"})).code, "busy");
    assert_eq!(refused(&mut client, json!({"projector": "left"})).code, "busy");

    // A reload that sends the pictures elsewhere says so to those who have them.
    fs::write(daemon.folder().path().join("lantern.toml"), room("{ kind = \"headless\" }")).unwrap();
    client.ask_ok("config.reload", json!({})).unwrap();
    for mut one in four {
        let mut line = one.line().unwrap().unwrap();
        while line["event"] == "export" {
            line = one.line().unwrap().unwrap();
        }
        assert_eq!((&line["event"], &line["projector"]), (&json!("export_end"), &json!("left")), "{line}");
        assert_eq!(refused(&mut one, json!({"projector": "left"})).code, "no-export");
    }
    ends_well(daemon);
}
