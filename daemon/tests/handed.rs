//! Edits in a memfd that comes with its request. Alone in its program, since it counts the process's descriptors.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

mod support;

use std::fs::File;
use std::io::{BufRead, BufReader, IoSlice, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use serde_json::{Value, json};
use support::FakeDaemon;

const SEALS: SealFlags = SealFlags::SHRINK.union(SealFlags::GROW).union(SealFlags::WRITE);

fn memfd(text: &[u8], seals: SealFlags) -> OwnedFd {
    let mut file = File::from(memfd_create("edits", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING).unwrap());
    file.write_all(text).unwrap();
    fcntl_add_seals(&file, seals).unwrap();
    file.into()
}

fn send(stream: &UnixStream, lines: &str, files: &[BorrowedFd<'_>]) {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(8))];
    let mut control = SendAncillaryBuffer::new(&mut space);
    assert!(files.is_empty() || control.push(SendAncillaryMessage::ScmRights(files)));
    sendmsg(stream, &[IoSlice::new(lines.as_bytes())], &mut control, SendFlags::empty()).unwrap();
}

fn open_descriptors() -> usize {
    std::fs::read_dir("/proc/self/fd").unwrap().count()
}

const APPLY: &str = "{\"id\": 1, \"op\": \"scene.apply\", \"edits\": \"fd:0\"}\n";

#[test]
fn edits_come_in_a_sealed_memfd_and_nothing_else() {
    let daemon = FakeDaemon::start();
    let stream = UnixStream::connect(daemon.socket()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut reader = BufReader::new(stream.try_clone().unwrap());
    let mut receive = move || -> Value {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap()
    };
    let before = open_descriptors();
    let many = |count: usize| json!(vec![json!({"remove": {"node": "x".repeat(100)}}); count]).to_string();

    // Far longer than a line; and two ahead of the requests that name them, with another request between.
    let file = memfd(many(100_000).as_bytes(), SEALS);
    send(&stream, APPLY, &[file.as_fd()]);
    assert_eq!(receive()["ok"]["revision"], 100_000);
    let files = [memfd(many(1).as_bytes(), SEALS), memfd(many(2).as_bytes(), SEALS)];
    send(&stream, &format!("{{\"id\": 0, \"op\": \"hello\"}}\n{APPLY}{APPLY}"), &[files[0].as_fd(), files[1].as_fd()]);
    let revisions: Vec<_> = (0..3).map(|_| receive()["ok"]["revision"].clone()).collect();
    assert_eq!(revisions, [Value::Null, json!(100_001), json!(100_003)]);

    // What cannot be read safely, or is no list of edits.
    let (read, write) = rustix::pipe::pipe().unwrap();
    let sparse = File::from(memfd_create("long", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING).unwrap());
    sparse.set_len((16 << 20) + 1).unwrap();
    fcntl_add_seals(&sparse, SEALS).unwrap();
    for (file, code, at) in [
        (Some(memfd(b"[]", SealFlags::SHRINK | SealFlags::GROW)), "bad-file", "edits"),
        (Some(File::open("/dev/zero").unwrap().into()), "bad-file", "edits"),
        (Some(read), "bad-file", "edits"),
        (None, "bad-file", "edits"),
        (Some(sparse.into()), "too-large", "edits"),
        (Some(memfd(b"[{}", SEALS)), "bad-request", "edits[0]"),
        (Some(memfd(b"[] []", SEALS)), "bad-request", "edits"),
        (Some(memfd(b"", SEALS)), "bad-request", "edits"),
        (Some(memfd(br#"[{"remove": {"node": "a"}}, {"remove": {}}]"#, SEALS)), "bad-request", "edits[1].node"),
        (Some(memfd(br#"[{"remove": {"node": "ghost"}}]"#, SEALS)), "unknown-node", "edits[0].node"),
    ] {
        let files: Vec<_> = file.iter().map(AsFd::as_fd).collect();
        send(&stream, APPLY, &files);
        let reply = receive();
        assert_eq!(
            (&reply["id"], &reply["error"]["code"], &reply["error"]["at"]),
            (&json!(1), &json!(code), &json!(at)),
            "{reply}"
        );
    }
    assert_eq!(daemon.engine.edits.lock().unwrap().len(), 100_003);

    // More than may wait; nobody names them, and the connection goes on. With the client they go.
    let idle: Vec<_> = (0..8).map(|_| memfd(b"[]", SEALS)).collect();
    let idle: Vec<_> = idle.iter().map(AsFd::as_fd).collect();
    send(&stream, "{\"id\": 9, \"op\": \"hello\"}\n", &idle);
    assert_eq!(receive()["id"], 9);
    drop((stream, receive, files, file, write));
    let deadline = Instant::now() + Duration::from_secs(10);
    // The client's two ends were open when the count was taken, and eight memfds are ours still.
    while open_descriptors() > before + 8 - 2 {
        assert!(Instant::now() < deadline, "{} descriptors, and there were {before}", open_descriptors());
        std::thread::sleep(Duration::from_millis(10));
    }
}
