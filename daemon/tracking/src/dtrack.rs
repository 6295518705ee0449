//! DTRACK's ASCII (ART): lines of which each begins with a word for what it holds.
//!
//! ```text
//! fr 21753                                    number of the frame
//! ts 39596.024831                             s since midnight, UTC
//! 6d 1 [0 1.000][sx sy sz η θ φ][b0 … b8]     standard bodies: id and quality; mm and angles; rotation
//! 6df 1 [0 1.000 2][…][b0 … b8]               Flysticks, old form: buttons after the quality
//! 6df2 2 1 [0 1.000 8 2][…][b0 … b8][…]       Flysticks: how many are defined and how many follow; buttons at the end
//! ```
//!
//! The rotation's columns are (b0 b1 b2), (b3 b4 b5), (b6 b7 b8), room from body; the angles say the same and are not
//! used. A standard body that is not seen is absent, a Flystick has the quality −1. Lines that begin otherwise are of no
//! interest. There is no checksum: a digit that becomes another one is data.

use crate::axes::Axes;
use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, bad, ns_of};
use glam::{DMat3, DQuat, DVec3};
use std::net::SocketAddr;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::time::Instant;

/// No room holds more; what claims to is no DTRACK.
const MAX_BODIES: usize = 1000;
const DAY_S: f64 = 86_400.0;
/// How far the columns of a rotation may be from length 1 and from right angles.
const ROTATION_TOLERANCE: f64 = 0.01;

/// Reads datagrams of lines.
pub(crate) struct Dtrack {
    axes: Axes,
    /// The ids of standard bodies that have been seen.
    standard: Vec<u32>,
    /// What Flysticks are called in the configuration, by their ids.
    flysticks: Vec<u32>,
    /// The newest time, s, and the midnights before it.
    clock: Option<(f64, u32)>,
}

impl Dtrack {
    /// `names` are the ids that the configuration has.
    pub(crate) fn new<'a>(axes: lantern_config::Axes, names: impl Iterator<Item = &'a String>) -> Self {
        let flysticks = names.filter_map(|name| name.strip_prefix("flystick ")?.parse().ok()).collect();
        Self { axes: Axes::configured(axes), standard: Vec::new(), flysticks, clock: None }
    }

    /// ns since the midnight before the first datagram: at midnight the sender's seconds begin anew, and this goes on.
    fn unwrapped_ns(&mut self, time_s: f64) -> Option<u64> {
        let (newest_s, mut days) = self.clock.unwrap_or((time_s, 0));
        // Less than half a day back is a clock that was set, or a datagram that comes late.
        if newest_s - time_s > DAY_S / 2.0 {
            days += 1;
        } else if time_s - newest_s > DAY_S / 2.0 && days > 0 {
            // One of yesterday that comes late.
            return ns_of((f64::from(days) - 1.0) * DAY_S + time_s);
        }
        self.clock = Some((time_s, days));
        ns_of(f64::from(days) * DAY_S + time_s)
    }

    /// What the configuration calls a Flystick. A bare number means a standard body, if one has been seen.
    fn flystick(&self, id: u32, frame: &Frame) -> BodyId {
        if self.flysticks.contains(&id) || self.standard.contains(&id) || frame.standard.contains(&id) {
            return BodyId::Name(format!("flystick {id}").into());
        }
        BodyId::Number(id)
    }

    /// A body of any line: its first block, the place after the first three numbers of the second, and the rotation.
    fn body(&self, blocks: &mut Blocks<'_>, numbers: usize) -> Result<(u32, Option<(DVec3, DQuat)>), Refusal> {
        let head = blocks.numbers(numbers..=numbers)?;
        let id = id_of(head[0])?;
        let place = blocks.numbers(3..=6)?;
        let b = blocks.numbers(9..=9)?;
        if place.len() != 3 && place.len() != 6 {
            return bad(format!("{} numbers where 3 or 6 are a place", place.len()));
        }
        if head[1] < 0.0 {
            return Ok((id, None));
        }
        let room_from_body = DMat3::from_cols_slice(&b);
        let error = room_from_body.transpose() * room_from_body - DMat3::IDENTITY;
        let is_rotation = error.to_cols_array().iter().all(|x| x.abs() <= 2.0 * ROTATION_TOLERANCE);
        if !is_rotation || room_from_body.determinant() < 0.0 {
            return bad(format!("the matrix of body {id} is no rotation"));
        }
        let orientation = self.axes.rotation(DQuat::from_mat3(&room_from_body).normalize());
        let position_m = self.axes.vector(DVec3::new(place[0], place[1], place[2]) / 1000.0);
        Ok((id, Some((position_m, orientation))))
    }

    fn line(&self, word: &str, rest: &str, frame: &mut Frame, heard: &mut Heard) -> Result<(), Refusal> {
        // Of `6d`, `6df` and `6df2`: how many counts come first, and how many numbers are in the first block.
        let (counts, numbers) = match word {
            "fr" => {
                frame.number = Some(only(rest, word)?);
                return Ok(());
            }
            "ts" => {
                let time_s: f64 = only(rest, word)?;
                if !(0.0..2.0 * DAY_S).contains(&time_s) {
                    return bad(format!("the time {time_s} is none of a day"));
                }
                frame.time_s = Some(time_s);
                return Ok(());
            }
            "6d" => (1, 2),
            "6df" => (1, 3),
            "6df2" => (2, 4),
            _ => return Ok(()),
        };
        frame.has_bodies = true;
        let (mut count, mut blocks) = (0, Blocks { rest: rest.trim_start() });
        for _ in 0..counts {
            count = blocks.leading()?;
        }
        if count > MAX_BODIES {
            return bad(format!("claims {count} bodies"));
        }
        for _ in 0..count {
            let (id, pose) = self.body(&mut blocks, numbers)?;
            if word == "6df2" {
                blocks.numbers(0..=64)?;
            }
            let body = if word == "6d" { BodyId::Number(id) } else { self.flystick(id, frame) };
            if word == "6d" {
                frame.standard.push(id);
            }
            let (position_m, orientation) = pose.unzip();
            heard.readings.push(Reading { position_m, orientation, ..Reading::of(body) });
        }
        blocks.end(word)
    }
}

impl Protocol for Dtrack {
    fn read(&mut self, datagram: &[u8], _from: SocketAddr, _at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let Ok(text) = std::str::from_utf8(datagram) else { return bad("not ASCII") };
        if !text.is_ascii() {
            return bad("not ASCII");
        }
        let mut frame = Frame::default();
        let lines = text.split(['\r', '\n']).map(str::trim).filter(|line| !line.is_empty());
        for line in lines {
            let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
            self.line(word, rest, &mut frame, heard)?;
        }
        if !frame.has_bodies {
            let known = frame.number.is_some() || frame.time_s.is_some();
            let words = "no line `6d`, `6df` or `6df2`".to_owned();
            return Err(if known { Refusal::Other(words) } else { Refusal::Bad(words) });
        }
        // Nothing of the datagram is kept before all of it has been found good.
        for id in frame.standard {
            if !self.standard.contains(&id) && self.standard.len() < MAX_BODIES {
                self.standard.push(id);
            }
        }
        heard.frame = frame.number;
        heard.is_everything = true;
        let measured_ns = frame.time_s.and_then(|time_s| self.unwrapped_ns(time_s));
        heard.readings.iter_mut().for_each(|reading| reading.measured_ns = measured_ns);
        Ok(())
    }
}

/// What the lines of a datagram say of all bodies.
#[derive(Default)]
struct Frame {
    number: Option<u32>,
    time_s: Option<f64>,
    has_bodies: bool,
    /// The ids of the standard bodies.
    standard: Vec<u32>,
}

/// The bracketed lists of a line, one after the other.
struct Blocks<'a> {
    rest: &'a str,
}

impl Blocks<'_> {
    /// A count before the first block.
    fn leading(&mut self) -> Result<usize, Refusal> {
        let end = self.rest.find([' ', '[']).unwrap_or(self.rest.len());
        let (count, rest) = self.rest.split_at(end);
        self.rest = rest.trim_start();
        number(count)
    }

    /// The next block's numbers, of which there are so many.
    fn numbers(&mut self, count: RangeInclusive<usize>) -> Result<Vec<f64>, Refusal> {
        let block = self.rest.strip_prefix('[').and_then(|rest| rest.split_once(']'));
        let Some((block, rest)) = block else { return bad("a body ends before its last block") };
        self.rest = rest.trim_start();
        // One more than there may be is enough to see that there are too many.
        let words = block.split_ascii_whitespace().take(count.end() + 1);
        let numbers = words.map(number).collect::<Result<Vec<f64>, _>>()?;
        if !count.contains(&numbers.len()) {
            return bad(format!("a block of {} numbers instead of {}", numbers.len(), count.end()));
        }
        if !numbers.iter().all(|number| number.is_finite()) {
            return bad("a number that is not finite");
        }
        Ok(numbers)
    }

    fn end(&self, word: &str) -> Result<(), Refusal> {
        if self.rest.is_empty() { Ok(()) } else { bad(format!("more after the last body of `{word}`")) }
    }
}

fn only<T: FromStr>(text: &str, word: &str) -> Result<T, Refusal> {
    match text.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        [text] => number(text),
        _ => bad(format!("`{word}` without its one number")),
    }
}

fn number<T: FromStr>(text: &str) -> Result<T, Refusal> {
    let shown = || text.chars().take(32).collect::<String>();
    text.parse().map_err(|_| Refusal::Bad(format!("`{}` is no number", shown())))
}

fn id_of(number: f64) -> Result<u32, Refusal> {
    let id = number as u32;
    if f64::from(id) == number { Ok(id) } else { bad(format!("{number} is no id of a body")) }
}
