//! What each number of `status` is called: by Prometheus' conventions in base units (seconds, bytes), with `_total` at the end of
//! what only grows, and a label for each name.

use lantern_proto::Status;
use lantern_proto::event::OutputState;
use lantern_proto::status::{BodyStatus, Latency, Percentiles, ProjectorStatus, TrackedStatus, TrackerStatus};

use super::text::{Kind, Label, Page, Sample};

const MS: f64 = 1e-3;

/// Every number of a status, and its words as labels of families that end in `_info`.
pub(super) fn page_of(status: &Status) -> String {
    let mut page = Page::default();
    of_daemon(&mut page, status);
    of_bodies(&mut page, status);
    of_trackers(&mut page, status);
    of_projectors(&mut page, status);
    page.finish()
}

fn sample<'a>(labels: &[Label<'a>], value: f64) -> Sample<'a> {
    Sample { labels: labels.to_vec(), value }
}

fn of_daemon(page: &mut Page, status: &Status) {
    let (device, scene) = (&status.device, &status.scene);
    let one = |value: f64| [sample(&[], value)];
    page.family("lantern_info", Kind::Gauge, "The daemon", [sample(&[("version", &status.version)], 1.0)]);
    page.family("lantern_uptime_seconds", Kind::Gauge, "Since the daemon started", one(status.uptime_s));
    let good = f64::from(u8::from(status.config.good));
    let help = "1 where the configuration file is in use, 0 where it has come to be wrong and an earlier one is";
    page.family("lantern_config_good", Kind::Gauge, help, one(good));
    let words = [("name", device.name.as_str()), ("driver", &device.driver), ("kind", &device.kind)];
    page.family("lantern_device_info", Kind::Gauge, "What renders", [sample(&words, 1.0)]);
    let help = "Times that the device was lost or hung, and opened again";
    page.family("lantern_device_losses_total", Kind::Counter, help, one(device.lost as f64));
    let messages = device.validation_messages.map(|count| sample(&[], count as f64));
    let help = "Messages of the validation layer, where it is on";
    page.family("lantern_device_validation_messages_total", Kind::Counter, help, messages);
    page.family("lantern_scene_revision", Kind::Gauge, "The newest revision of the scene", one(scene.revision as f64));
    page.family("lantern_scene_nodes", Kind::Gauge, "Nodes, visible or not", one(scene.nodes as f64));
    page.family("lantern_scene_triangles", Kind::Gauge, "Triangles of all nodes", one(scene.triangles as f64));
    page.family("lantern_scene_bytes", Kind::Gauge, "The scene's memory on the device", one(scene.bytes as f64));
    let help = "The world position that device coordinates are relative to";
    page.family("lantern_scene_origin_meters", Kind::Gauge, help, components(&[], scene.origin_m));
}

/// A vector or a quaternion, a sample for each component.
fn components<'a, const N: usize>(labels: &[Label<'a>], values: [f64; N]) -> Vec<Sample<'a>> {
    let named = ["x", "y", "z", "w"].into_iter().zip(values);
    named.map(|(axis, value)| sample(&[labels, &[("axis", axis)]].concat(), value)).collect()
}

fn of_bodies(page: &mut Page, status: &Status) {
    let all = |of: &dyn for<'a> Fn(&[Label<'a>], &'a BodyStatus) -> Vec<Sample<'a>>| -> Vec<Sample<'_>> {
        status.bodies.iter().flat_map(|(name, body)| of(&[("body", name)], body)).collect()
    };
    let help = "The body's last pose, in the world";
    let positions = all(&|labels, body| components(labels, body.position_m));
    page.family("lantern_body_position_meters", Kind::Gauge, help, positions);
    let help = "World from body, a unit quaternion";
    let turns = all(&|labels, body| components(labels, body.orientation));
    page.family("lantern_body_orientation", Kind::Gauge, help, turns);
    let ages = all(&|labels, body| vec![sample(labels, body.age_ms * MS)]);
    page.family("lantern_body_age_seconds", Kind::Gauge, "Since the body's last pose was said", ages);
    let sources = all(&|labels, body| vec![sample(&[labels, &[("source", body.source.as_str())]].concat(), 1.0)]);
    page.family("lantern_body_info", Kind::Gauge, "Who placed the body last", sources);
}

fn of_trackers(page: &mut Page, status: &Status) {
    let all = |of: &dyn Fn(&TrackerStatus) -> Option<f64>| -> Vec<Sample<'_>> {
        let numbers = status.trackers.iter().filter_map(|(name, tracker)| Some((name, of(tracker)?)));
        numbers.map(|(name, value)| sample(&[("tracker", name)], value)).collect()
    };
    let words = status.trackers.iter().map(|(name, tracker)| {
        let words = [("tracker", name.as_str()), ("protocol", &tracker.protocol), ("listen", &tracker.listen)];
        sample(&words, 1.0)
    });
    page.family("lantern_tracker_info", Kind::Gauge, "What the tracker speaks, and where it is listened to", words);
    type Counted = fn(&TrackerStatus) -> Option<u64>;
    let counters: [(&str, &str, Counted); 6] = [
        ("accepted", "Packets that were taken", |t| Some(t.accepted)),
        ("rejected", "Packets that were dropped, whatever the reason", |t| Some(t.rejected)),
        ("dropped_old", "Packets that were good and not newer than the last", |t| Some(t.dropped_old)),
        ("kernel_dropped", "Packets that the system threw away before they were taken in", |t| t.kernel_dropped),
        ("incomplete", "Frames of several packets of which one did not come", |t| Some(t.incomplete)),
        ("other", "Packets about something else than bodies", |t| Some(t.others.packets)),
    ];
    for (name, help, count) in counters {
        let name = format!("lantern_tracker_{name}_packets_total");
        page.family(&name, Kind::Counter, help, all(&|tracker| Some(count(tracker)? as f64)));
    }
    let help = "Accepted packets a second, over the last second";
    page.family("lantern_tracker_rate_hertz", Kind::Gauge, help, all(&|tracker| Some(tracker.rate_hz)));

    let each = |of: &dyn Fn(&TrackedStatus) -> Option<f64>| -> Vec<Sample<'_>> {
        let bodies = status.trackers.iter().flat_map(|(name, tracker)| tracker.bodies.iter().map(move |b| (name, b)));
        let numbers = bodies.filter_map(|(name, (id, body))| Some((name, id, body, of(body)?)));
        let labels = numbers.map(|(name, id, body, value)| {
            sample(&[("tracker", name.as_str()), ("id", id), ("body", &body.body)], value)
        });
        labels.collect()
    };
    let help = "1 where the tracker saw the body when it last spoke of it";
    let tracked = each(&|body| Some(f64::from(u8::from(body.tracked))));
    page.family("lantern_tracker_body_tracked", Kind::Gauge, help, tracked);
    let ages = each(&|body| Some(body.age_ms? * MS));
    page.family("lantern_tracker_body_age_seconds", Kind::Gauge, "Since the tracker's last pose of the body", ages);
}

fn of_projectors(page: &mut Page, status: &Status) {
    let all = |of: &dyn for<'a> Fn(&[Label<'a>], &'a ProjectorStatus) -> Vec<Sample<'a>>| -> Vec<Sample<'_>> {
        status.projectors.iter().flat_map(|(name, projector)| of(&[("projector", name)], projector)).collect()
    };
    let words = all(&|labels, p| vec![sample(&[labels, &[("output", p.output.as_str())]].concat(), 1.0)]);
    page.family("lantern_projector_info", Kind::Gauge, "Where the image goes", words);
    let help = "Pictures shown";
    page.family("lantern_projector_frames_total", Kind::Counter, help, all(&|l, p| vec![sample(l, p.frames as f64)]));
    let help = "Frames that came too late to be shown";
    let missed = all(&|labels, p| vec![sample(labels, p.missed as f64)]);
    page.family("lantern_projector_missed_frames_total", Kind::Counter, help, missed);
    let readers = all(&|l, p| p.screen.readers.map(|n| sample(l, n as f64)).into_iter().collect());
    page.family("lantern_projector_readers", Kind::Gauge, "Clients that import the pictures", readers);
    let help = "Pictures that a client missed because it held all of its images";
    let missed = all(&|l, p| p.screen.readers_missed.map(|n| sample(l, n as f64)).into_iter().collect());
    page.family("lantern_projector_readers_missed_pictures_total", Kind::Counter, help, missed);
    type Told = fn(&ProjectorStatus) -> f64;
    let gauges: [(&str, &str, Told); 12] = [
        ("width_pixels", "Columns of the image", |p| p.resolution_px[0].into()),
        ("height_pixels", "Rows of the image", |p| p.resolution_px[1].into()),
        ("output_shown", "1 where the output shows the picture", |p| {
            u8::from(p.screen.state == OutputState::Shown).into()
        }),
        ("output_refresh_hertz", "How often the output shows another image", |p| p.screen.refresh_hz),
        ("coarse", "1 where the picture was made coarser, so as to follow what moves", |p| u8::from(p.coarse).into()),
        ("queue_family", "Family of the queue that its work is submitted to", |p| p.queue.family.into()),
        ("queue_index", "Index in the family of that queue", |p| p.queue.index.into()),
        ("queue_shared", "1 where other projectors submit to that queue too", |p| u8::from(p.queue.shared).into()),
        ("pose_to_submit_seconds", "From reading the pose to the submission, last frame", |p| p.pose_to_submit_ms * MS),
        ("device_bytes", "Device memory that the projector has for itself", |p| p.gpu_bytes as f64),
        ("revision", "The revision of the scene that is shown", |p| p.revision as f64),
        ("frame", "The number of the frame that is shown", |p| p.frame as f64),
    ];
    for (name, help, told) in gauges {
        let name = format!("lantern_projector_{name}");
        page.family(&name, Kind::Gauge, help, all(&|labels, projector| vec![sample(labels, told(projector))]));
    }
    let help = "Time of the last frame on the device, by stage";
    let stages = all(&|labels, projector| {
        let stages = projector.stages_ms.iter();
        stages.map(|(stage, ms)| sample(&[labels, &[("stage", stage.as_str())]].concat(), ms * MS)).collect()
    });
    page.family("lantern_projector_stage_seconds", Kind::Gauge, help, stages);
    let help = "From the start of a frame to its end";
    let times = all(&|labels, projector| {
        let times = projector.frame_ms;
        quantiles(labels, &[("0.5", times.p50), ("0.95", times.p95), ("1", times.max)])
    });
    page.family("lantern_projector_frame_seconds", Kind::Summary, help, times);

    // How old poses were on their way.
    let latencies = |of: &dyn for<'a> Fn(&[Label<'a>], &Latency) -> Vec<Sample<'a>>| {
        all(&|labels, projector| {
            let bodies = projector.latency_ms.iter();
            bodies.flat_map(|(body, latency)| of(&[labels, &[("body", body.as_str())]].concat(), latency)).collect()
        })
    };
    let help = "How old the poses of the last frames were at each stage of their way";
    let ages = latencies(&|labels, latency| {
        let stages: [(&str, Option<Percentiles>); 4] = [
            ("received", latency.received),
            ("submitted", Some(latency.submitted)),
            ("completed", Some(latency.completed)),
            ("presented", latency.presented),
        ];
        let known = stages.into_iter().filter_map(|(stage, ages)| Some((stage, ages?)));
        let ages = known.flat_map(|(stage, ages)| {
            let numbers = [("0.5", ages.p50), ("0.95", ages.p95), ("0.99", ages.p99), ("1", ages.max)];
            quantiles(&[labels, &[("stage", stage)]].concat(), &numbers)
        });
        ages.collect()
    });
    page.family("lantern_projector_pose_age_seconds", Kind::Summary, help, ages);
    let help = "Frames that the ages of poses are of";
    let frames = latencies(&|labels, latency| vec![sample(labels, latency.frames as f64)]);
    page.family("lantern_projector_pose_age_frames", Kind::Gauge, help, frames);
}

/// Milliseconds by quantile, as seconds.
fn quantiles<'a>(labels: &[Label<'a>], times_ms: &[(&'static str, f64)]) -> Vec<Sample<'a>> {
    let sample = |&(q, ms): &(&'static str, f64)| sample(&[labels, &[("quantile", q)]].concat(), ms * MS);
    times_ms.iter().map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_proto::status::{
        ConfigStatus, DeviceStatus, FrameTimes, OthersStatus, OutputStatus, QueueStatus, SceneStatus,
    };
    use serde_json::Value;

    /// Numbers of which no two are alike, nor a thousandth of one another.
    struct Numbers(u32);

    impl Numbers {
        fn whole(&mut self) -> u32 {
            self.0 += 2;
            1_000_001 + self.0
        }

        fn count(&mut self) -> u64 {
            self.whole().into()
        }

        fn real(&mut self) -> f64 {
            f64::from(self.whole()) + 0.25
        }

        fn percentiles(&mut self) -> Percentiles {
            Percentiles { p50: self.real(), p95: self.real(), p99: self.real(), max: self.real() }
        }
    }

    /// With everything in it. No `..Default::default()` here: a number that `status` comes to tell must be told here as well, and
    /// then the test below asks for it.
    fn full(n: &mut Numbers) -> Status {
        Status {
            version: "0.1.0".to_owned(),
            uptime_s: n.real(),
            config: ConfigStatus { path: "lab.toml".to_owned(), good: false, problem: Some("wrong".to_owned()) },
            device: DeviceStatus {
                name: "a \"device\"".to_owned(),
                driver: "driver".to_owned(),
                kind: "cpu".to_owned(),
                lost: n.count(),
                validation_messages: Some(n.count()),
            },
            scene: SceneStatus {
                revision: n.count(),
                nodes: n.count(),
                triangles: n.count(),
                bytes: n.count(),
                origin_m: [n.real(), n.real(), n.real()],
            },
            bodies: ["head", "hand"].map(|name| (name.to_owned(), body(n))).into(),
            trackers: ["a", "b"].map(|name| (name.to_owned(), tracker(n))).into(),
            projectors: ["left", "right"].map(|name| (name.to_owned(), projector(n))).into(),
        }
    }

    fn body(n: &mut Numbers) -> BodyStatus {
        BodyStatus {
            position_m: [n.real(), n.real(), n.real()],
            orientation: [n.real(), n.real(), n.real(), n.real()],
            source: "a".to_owned(),
            age_ms: n.real(),
        }
    }

    fn tracker(n: &mut Numbers) -> TrackerStatus {
        TrackerStatus {
            protocol: "lantern".to_owned(),
            accepted: n.count(),
            rejected: n.count(),
            last_reject: Some("63 bytes".to_owned()),
            rate_hz: n.real(),
            dropped_old: n.count(),
            listen: "127.0.0.1:7000".to_owned(),
            kernel_dropped: Some(n.count()),
            incomplete: n.count(),
            bodies: ["1", "2"]
                .map(|id| {
                    let tracked = TrackedStatus { body: "head".to_owned(), tracked: id == "1", age_ms: Some(n.real()) };
                    (id.to_owned(), tracked)
                })
                .into(),
            others: OthersStatus { packets: n.count(), last: Some("a marker".to_owned()), bodies: vec![] },
        }
    }

    fn projector(n: &mut Numbers) -> ProjectorStatus {
        let mut latency = || Latency {
            received: Some(n.percentiles()),
            submitted: n.percentiles(),
            completed: n.percentiles(),
            presented: Some(n.percentiles()),
            frames: n.count(),
        };
        let latency_ms = ["head", "hand"].map(|body| (body.to_owned(), latency())).into();
        ProjectorStatus {
            resolution_px: [n.whole(), n.whole()],
            output: "window".to_owned(),
            screen: OutputStatus {
                state: OutputState::Black,
                detail: Some("it has 1x1 px".to_owned()),
                place: ":0".to_owned(),
                pixels: "8-bit".to_owned(),
                refresh_hz: n.real(),
                readers: Some(n.count()),
                readers_missed: Some(n.count()),
            },
            coarse: true,
            frames: n.count(),
            missed: n.count(),
            queue: QueueStatus { family: n.whole(), index: n.whole(), shared: true },
            frame_ms: FrameTimes { p50: n.real(), p95: n.real(), max: n.real() },
            stages_ms: ["primary", "secondary"].map(|stage| (stage.to_owned(), n.real())).into(),
            pose_to_submit_ms: n.real(),
            gpu_bytes: n.count(),
            revision: n.count(),
            frame: n.count(),
            latency_ms,
        }
    }

    /// Every number below a value, in seconds where its path says milliseconds.
    fn numbers(path: &str, value: &Value, out: &mut Vec<(String, f64)>) {
        match value {
            Value::Object(map) => map.iter().for_each(|(key, value)| numbers(&format!("{path}.{key}"), value, out)),
            Value::Array(items) => items.iter().for_each(|value| numbers(path, value, out)),
            Value::Number(number) => {
                let factor = if path.contains("_ms") && !path.ends_with(".frames") { MS } else { 1.0 };
                out.push((path.to_owned(), number.as_f64().unwrap() * factor));
            }
            _ => {}
        }
    }

    #[test]
    fn every_number_of_a_status_is_there_once() {
        let status = full(&mut Numbers(0));
        let page = page_of(&status);
        let mut told = Vec::new();
        numbers("", &serde_json::to_value(&status).unwrap(), &mut told);
        assert!(told.len() > 100);
        let samples = page.lines().filter(|line| !line.starts_with('#'));
        let samples: Vec<f64> = samples.map(|line| line.rsplit_once(' ').unwrap().1.parse().unwrap()).collect();
        for (path, number) in &told {
            let found = samples.iter().filter(|sample| *sample == number).count();
            assert_eq!(found, 1, "status{path} is in the metrics {found} times: see metrics/families.rs");
        }
        // What besides numbers is there: truths and words.
        assert!(samples.len() > told.len());
        for line in [
            "lantern_device_info{name=\"a \\\"device\\\"\",driver=\"driver\",kind=\"cpu\"} 1",
            "lantern_config_good 0",
            "lantern_tracker_body_tracked{tracker=\"b\",id=\"2\",body=\"head\"} 0",
            "lantern_tracker_body_tracked{tracker=\"b\",id=\"1\",body=\"head\"} 1",
            "lantern_projector_queue_shared{projector=\"left\"} 1",
            "lantern_projector_output_shown{projector=\"left\"} 0",
            "lantern_projector_coarse{projector=\"right\"} 1",
        ] {
            assert!(page.lines().any(|found| found == line), "{line} is not in\n{page}");
        }
    }

    #[test]
    fn a_family_stands_together_and_says_what_it_is() {
        let page = page_of(&full(&mut Numbers(0)));
        let mut families = std::collections::BTreeSet::new();
        let mut lines = page.lines().peekable();
        while let Some(help) = lines.next() {
            let (name, words) = help.strip_prefix("# HELP ").unwrap().split_once(' ').unwrap();
            assert!(families.insert(name) && !words.is_empty(), "{help}");
            let kind = lines.next().unwrap().strip_prefix(&format!("# TYPE {name} ")).unwrap();
            assert_eq!(kind == "counter", name.ends_with("_total"), "{name}");
            let mut samples = 0;
            while let Some(sample) = lines.next_if(|line| !line.starts_with('#')) {
                assert_eq!(sample.split(['{', ' ']).next(), Some(name));
                assert_eq!(kind == "summary", sample.contains("quantile=\""), "{sample}");
                samples += 1;
            }
            assert!(samples > 0, "{name}");
        }
    }
}
