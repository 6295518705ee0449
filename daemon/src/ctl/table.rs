//! `status` for people.

use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, ContentArrangement, Table};
use lantern_proto::Status;
use lantern_proto::status::{BodyStatus, Latency, Percentiles, ProjectorStatus, TrackerStatus};

/// A few lines and a table for bodies, trackers and projectors each, as far as there are any.
pub(super) fn status(status: &Status) -> String {
    let Status { device, scene, .. } = status;
    let mut text = format!(
        "lanternd {}, up {}\ndevice  {} ({}), {}\n",
        status.version,
        duration(status.uptime_s),
        device.name,
        device.kind,
        device.driver
    );
    if let Some(messages) = device.validation_messages.filter(|&messages| messages > 0) {
        text.push_str(&format!("        {messages} messages of the validation layer\n"));
    }
    if let Some(problem) = &status.config.problem {
        let problem = problem.replace('\n', "\n        ");
        text.push_str(&format!("config  wrong, and an earlier one is in use: {problem}\n"));
    }
    text.push_str(&format!(
        "scene   revision {}: {} nodes, {} triangles, {} on the device\n",
        scene.revision,
        scene.nodes,
        grouped(scene.triangles),
        bytes(scene.bytes)
    ));

    let bodies = status.bodies.iter().map(|(name, body)| body_row(name, body));
    text.push_str(&table(["body", "position, m", "orientation", "source", "age"], &[], bodies));
    let trackers = status.trackers.iter().map(|(name, tracker)| tracker_row(name, tracker));
    let header =
        ["tracker", "protocol", "listens at", "rate, Hz", "accepted", "rejected", "does not see", "last rejection"];
    text.push_str(&table(header, &[3, 4, 5], trackers));
    let projectors = status.projectors.iter().map(|(name, projector)| projector_row(name, projector));
    let header = ["projector", "pixels", "output", "frames", "missed", "frame, ms: p50 p95 max", "stages, ms", "queue"];
    text.push_str(&table(header, &[3, 4, 5], projectors));
    let latencies = status.projectors.iter().flat_map(|(projector, of)| {
        of.latency_ms.iter().map(move |(body, latency)| latency_row(projector, body, latency))
    });
    let header = ["projector", "body", "heard, ms: p50 p95 p99 max", "submitted", "complete", "presented", "frames"];
    text.push_str(&table(header, &[2, 3, 4, 5, 6], latencies));
    text
}

/// A table with some columns set to the right; nothing where there are no rows.
fn table<const N: usize>(header: [&str; N], right: &[usize], rows: impl Iterator<Item = [String; N]>) -> String {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_content_arrangement(ContentArrangement::Dynamic).set_header(header);
    for row in rows {
        table.add_row(row);
    }
    for &index in right {
        if let Some(column) = table.column_mut(index) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    if table.is_empty() { String::new() } else { format!("\n{table}\n") }
}

fn body_row(name: &str, body: &BodyStatus) -> [String; 5] {
    let numbers = |values: &[f64]| values.iter().map(|x| format!("{x:.3}")).collect::<Vec<_>>().join(" ");
    let age = duration(body.age_ms / 1e3);
    [name.to_owned(), numbers(&body.position_m), numbers(&body.orientation), body.source.clone(), age]
}

fn tracker_row(name: &str, tracker: &TrackerStatus) -> [String; 8] {
    let lost: Vec<_> = tracker.bodies.values().filter(|body| !body.tracked).map(|body| body.body.as_str()).collect();
    [
        name.to_owned(),
        tracker.protocol.clone(),
        tracker.listen.clone(),
        format!("{:.0}", tracker.rate_hz),
        tracker.accepted.to_string(),
        tracker.rejected.to_string(),
        lost.join(", "),
        tracker.last_reject.clone().unwrap_or_default(),
    ]
}

fn projector_row(name: &str, projector: &ProjectorStatus) -> [String; 8] {
    let [width, height] = projector.resolution_px;
    let times = projector.frame_ms;
    let stages = projector.stages_ms.iter().map(|(stage, ms)| format!("{stage} {ms:.2}")).collect::<Vec<_>>();
    let queue = projector.queue;
    [
        name.to_owned(),
        format!("{width} × {height}"),
        projector.output.clone(),
        projector.frames.to_string(),
        projector.missed.to_string(),
        format!("{:.1} {:.1} {:.1}", times.p50, times.p95, times.max),
        stages.join(", "),
        format!("{}.{}{}", queue.family, queue.index, if queue.shared { " shared" } else { "" }),
    ]
}

/// How old a body's poses were on their way.
fn latency_row(projector: &str, body: &str, latency: &Latency) -> [String; 7] {
    let of = |of: Option<Percentiles>| {
        of.map(|p| format!("{:.1} {:.1} {:.1} {:.1}", p.p50, p.p95, p.p99, p.max)).unwrap_or_default()
    };
    [
        projector.to_owned(),
        body.to_owned(),
        of(latency.received),
        of(Some(latency.submitted)),
        of(Some(latency.completed)),
        of(latency.presented),
        latency.frames.to_string(),
    ]
}

/// In the unit that a person would take.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 1.0 => format!("{:.0} ms", s * 1e3),
        s if s < 60.0 => format!("{s:.1} s"),
        s if s < 3600.0 => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        s => format!("{:.0} h {:02.0} min", (s / 3600.0).floor(), (s % 3600.0 / 60.0).floor()),
    }
}

fn bytes(count: u64) -> String {
    match count as f64 {
        n if n < 1024.0 => format!("{n:.0} B"),
        n if n < 1024.0 * 1024.0 => format!("{:.1} KiB", n / 1024.0),
        n => format!("{:.1} MiB", n / (1024.0 * 1024.0)),
    }
}

/// 1234567 as 1 234 567.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_for_people() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1 000", "1 234 567"]);
        assert_eq!([0.0042, 5.0, 65.0, 3725.0].map(duration), ["4 ms", "5.0 s", "1 min 05 s", "1 h 02 min"]);
        assert_eq!([12, 2048, 3 << 20].map(bytes), ["12 B", "2.0 KiB", "3.0 MiB"]);
    }
}
