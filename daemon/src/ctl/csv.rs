//! The ledger of latency as a table in a file: a line a frame, projector and body.

use super::Failure;
use lantern_proto::event::{FrameEvent, ShownPose};
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// What the columns are. Ages are in ms, since the measurement where the tracker says when that was, else since the receipt;
/// `lost` is how many frames' events are missing before a line.
const HEADER: &str = "frame,projector,revision,body,source,sequence,predicted_ms,measured_ms,received_ms,submitted_ms,\
                      completed_ms,presented_ms,frame_ms,missed,light_s,completed_s,lost\n";

/// A file of frames.
pub(super) struct Book {
    file: Box<dyn Write>,
    /// Frames that were lost since the last line.
    lost: u64,
}

impl Book {
    /// Begins a file; `-` is standard output.
    ///
    /// # Errors
    /// Where it cannot be made.
    pub(super) fn open(path: &Path) -> Result<Self, Failure> {
        let file: Box<dyn Write> = if path == Path::new("-") {
            Box::new(io::stdout())
        } else {
            let made = File::create(path);
            Box::new(made.map_err(|error| Failure::Usage(format!("cannot write {}: {error}", path.display())))?)
        };
        let mut this = Self { file, lost: 0 };
        this.file.write_all(HEADER.as_bytes())?;
        this.file.flush()?;
        Ok(this)
    }

    /// So many frames are missing here.
    pub(super) fn miss(&mut self, count: u64) {
        self.lost += count;
    }

    /// Adds a frame: a line for each body that it shows, or one without any.
    ///
    /// # Errors
    /// Where the file takes no more.
    pub(super) fn write(&mut self, frame: &FrameEvent) -> Result<(), Failure> {
        let lost = std::mem::take(&mut self.lost);
        self.file.write_all(lines(frame, lost).as_bytes())?;
        self.file.flush()?;
        Ok(())
    }
}

fn lines(frame: &FrameEvent, lost: u64) -> String {
    let nobody = (String::new(), None);
    let shown: Vec<_> = frame.poses.iter().map(|(body, pose)| (body.clone(), Some(pose))).collect();
    let rows = if shown.is_empty() { vec![nobody] } else { shown };
    rows.iter().map(|(body, pose)| line(frame, body, *pose, lost)).collect()
}

fn line(frame: &FrameEvent, body: &str, pose: Option<&ShownPose>, lost: u64) -> String {
    let ms = |value: Option<f64>| value.map(|ms| format!("{ms:.3}")).unwrap_or_default();
    let ages = pose.map(|pose| pose.age_ms);
    let cells = [
        frame.frame.to_string(),
        quoted(&frame.projector),
        frame.revision.to_string(),
        quoted(body),
        quoted(pose.map(|pose| pose.source.as_str()).unwrap_or_default()),
        pose.and_then(|pose| pose.sequence).map(|sequence| sequence.to_string()).unwrap_or_default(),
        ms(pose.and_then(|pose| pose.predicted_ms)),
        ms(ages.and_then(|ages| ages.measured)),
        ms(ages.map(|ages| ages.received)),
        ms(ages.map(|ages| ages.submitted)),
        ms(ages.map(|ages| ages.completed)),
        ms(ages.and_then(|ages| ages.presented)),
        format!("{:.3}", frame.frame_ms),
        frame.missed.to_string(),
        format!("{:.6}", frame.light_s),
        format!("{:.6}", frame.completed_s),
        lost.to_string(),
    ];
    format!("{}\n", cells.join(","))
}

/// A cell (RFC 4180): names may hold anything that can be shown.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_proto::event::Ages;

    #[test]
    fn every_line_has_every_cell() {
        let age_ms = Ages { measured: Some(0.0), received: 31.25, submitted: 40.0, completed: 52.5, presented: None };
        let head = ShownPose { source: "optitrack".into(), sequence: Some(7), age_ms, ..ShownPose::default() };
        let hand = ShownPose { source: "a, \"b\"".into(), predicted_ms: Some(12.5), ..ShownPose::default() };
        let mut frame = FrameEvent { projector: "left".into(), frame: 9, light_s: 1.5, ..FrameEvent::default() };
        assert_eq!(lines(&frame, 0), "9,left,0,,,,,,,,,,0.000,0,1.500000,0.000000,0\n");
        frame.poses = [("hand".to_owned(), hand), ("head".to_owned(), head)].into();
        let text = lines(&frame, 3);
        let [hand, head] = text.lines().collect::<Vec<_>>()[..] else { panic!("{text}") };
        assert_eq!(head, "9,left,0,head,optitrack,7,,0.000,31.250,40.000,52.500,,0.000,0,1.500000,0.000000,3");
        assert!(hand.starts_with("9,left,0,hand,\"a, \"\"b\"\"\",,12.500,,0.000,"), "{hand}");
        assert_eq!(head.matches(',').count(), HEADER.matches(',').count());
    }
}
