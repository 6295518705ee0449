//! `watch`: the status again and again, or events as they happen, through restarts of the daemon.

use super::args::Watch;
use super::client::Client;
use super::csv::Book;
use super::{Failure, print, read, table};
use lantern_proto::event::Event;
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::path::Path;
use std::time::{Duration, Instant};

/// Clears the screen and goes to its upper left corner.
const CLEAR: &str = "\x1b[H\x1b[2J\x1b[3J";

/// How long to wait between two looks for a daemon that has gone.
const RETRY: Duration = Duration::from_millis(200);

/// Watches until enough was seen, or until a daemon that has gone does not come back in time.
pub(super) fn watch(path: &Path, client: Client, watch: &Watch, json: bool) -> Result<(), Failure> {
    let mut watcher = Watcher { client, watch, json, seen: 0 };
    let mut book = watch.csv.as_deref().map(Book::open).transpose()?;
    loop {
        let followed = match (&mut book, watch.events.as_slice()) {
            (Some(book), _) => watcher.follow_frames(book),
            (None, []) => watcher.follow_status(),
            (None, events) => watcher.follow_events(events),
        };
        match followed {
            Err(Failure::Lost(reason)) => {
                eprintln!("lanternctl: lost lanternd: {reason}; waiting for it to come back");
                watcher.client = connect(path, Duration::from_secs_f64(watch.patience))?;
            }
            done => return done,
        }
    }
}

/// Waits for a daemon.
fn connect(path: &Path, patience: Duration) -> Result<Client, Failure> {
    let began = Instant::now();
    loop {
        match Client::connect(path) {
            Err(Failure::NoDaemon { .. }) if began.elapsed() < patience => std::thread::sleep(RETRY),
            done => return done,
        }
    }
}

struct Watcher<'a> {
    client: Client,
    watch: &'a Watch,
    json: bool,
    /// Looks, events or lines so far.
    seen: u64,
}

impl Watcher<'_> {
    /// One more was seen; whether that is enough.
    fn is_enough(&mut self) -> bool {
        self.seen += 1;
        self.watch.count.is_some_and(|count| self.seen >= count)
    }

    fn follow_status(&mut self) -> Result<(), Failure> {
        let redraw = !self.json && std::io::stdout().is_terminal();
        loop {
            let answer = self.client.ask(json!({"op": "status"}))?;
            let text = if self.json { format!("{answer}\n") } else { table::status(&read(answer)?) };
            print(&if redraw { format!("{CLEAR}{text}") } else { text })?;
            if self.is_enough() {
                return Ok(());
            }
            std::thread::sleep(Duration::from_secs_f64(self.watch.interval));
        }
    }

    fn follow_events(&mut self, events: &[String]) -> Result<(), Failure> {
        self.subscribe(json!(events))?;
        loop {
            print(&self.client.line()?)?;
            if self.is_enough() {
                return Ok(());
            }
        }
    }

    fn follow_frames(&mut self, book: &mut Book) -> Result<(), Failure> {
        self.subscribe(json!(["frame"]))?;
        loop {
            let line = self.client.line()?;
            let event = serde_json::from_str(&line)
                .map_err(|error| Failure::Lost(format!("its events are of another version: {error}")))?;
            match event {
                Event::Frame(frame) => {
                    book.write(&frame)?;
                    if self.is_enough() {
                        return Ok(());
                    }
                }
                Event::Lost(lost) => book.miss(lost.count),
                Event::Pose(_) | Event::Scene(_) | Event::Tracker(_) | Event::Output(_) => {}
                // It has opened none.
                Event::Export(_) | Event::ExportEnd(_) => {}
            }
        }
    }

    fn subscribe(&mut self, events: Value) -> Result<(), Failure> {
        self.client.ask(json!({"op": "subscribe", "events": events}))?;
        // Where nothing happens, nothing is said.
        self.client.wait_for_ever()
    }
}
