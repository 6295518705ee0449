//! PosiStageNet 2: chunks within chunks, little-endian, each with a header of 32 bits: id 16, length 15, and 1 where it
//! holds further chunks.
//!
//! ```text
//! DATA 0x6755            INFO 0x6756, once a second
//!   0 header               0 header
//!   1 trackers             1 the server's name
//!     ⟨tracker's id⟩       2 trackers
//!       0 position, m        ⟨tracker's id⟩
//!       1 speed, m/s           0 its name
//!       2 orientation, rad
//!       3 validity
//!       6 its own time, µs
//! ```
//!
//! The header: u64 µs since the server's start, version high and low, number of the frame, packets of the frame. Axes are
//! x right, y up, z ahead: left-handed. An orientation is a vector along the axis of rotation, as long as the angle.
//!
//! A frame's packets are gathered, by server, and move bodies together when the last is there. Chunks of other ids are
//! passed over. There is no checksum.

use crate::axes::Axes;
use crate::bytes::Bytes;
use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, bad, finite};
use glam::DQuat;
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

const DATA: u16 = 0x6755;
const INFO: u16 = 0x6756;

/// Servers whose frames and names are kept; of more, those that have been silent for longest are forgotten.
const MAX_SERVERS: usize = 8;
/// A server that has been silent for so long has gone: trackers are not seen by it. What it called them is kept, for it may be
/// heard again before it says that anew.
const SILENCE: Duration = Duration::from_secs(3);
/// Trackers of one frame. The largest that could be meant, 255 packets of 1500 bytes, has fewer with positions.
const MAX_TRACKERS: usize = 16_384;
/// A frame at most this much older than the newest is one that comes late; older still is a server that started anew.
const LATE_US: u64 = 1_000_000;

/// Reads packets of servers.
pub(crate) struct Psn {
    /// The names that the configuration knows bodies by.
    wanted: BTreeSet<String>,
    servers: Vec<(SocketAddr, Server)>,
}

/// What is known of a server.
struct Server {
    /// When anything came from it last.
    heard: Instant,
    /// The trackers' ids of the names that are wanted.
    names: BTreeMap<String, u16>,
    newest_us: Option<u64>,
    frame: Option<Gathered>,
}

/// The packets of a frame that have come.
struct Gathered {
    header: Header,
    packets: u8,
    readings: Vec<Reading>,
    trackers: BTreeSet<u16>,
}

/// What begins each packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Header {
    time_us: u64,
    frame: u8,
    packets: u8,
}

impl Psn {
    /// `ids` are those that the configuration has; what is no number is a name.
    pub(crate) fn new<'a>(ids: impl Iterator<Item = &'a String>) -> Self {
        let wanted = ids.filter(|id| matches!(BodyId::parse(id), BodyId::Name(_))).cloned().collect();
        Self { wanted, servers: Vec::new() }
    }

    /// What is known of the server at an address; it is the newest of them from now on.
    fn server(&mut self, from: SocketAddr, received: Instant) -> &mut Server {
        let at = self.servers.iter().position(|(address, _)| *address == from);
        let server = match at {
            Some(at) => self.servers.remove(at),
            None => (from, Server { heard: received, names: BTreeMap::new(), newest_us: None, frame: None }),
        };
        self.servers.insert(0, server);
        self.servers.truncate(MAX_SERVERS);
        let server = &mut self.servers[0].1;
        server.heard = received;
        server
    }

    /// Whether, by now, there is one server at most: then nobody sees what it does not.
    fn is_alone(&self, now: Instant) -> bool {
        let is_there = |server: &Server| now.saturating_duration_since(server.heard) < SILENCE;
        self.servers.iter().filter(|(_, server)| is_there(server)).count() <= 1
    }
}

impl Protocol for Psn {
    fn read(&mut self, datagram: &[u8], from: SocketAddr, at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let mut bytes = Bytes::new(datagram);
        let root = Chunk::read(&mut bytes)?;
        if !bytes.is_empty() {
            return bad(format!("{} bytes after the packet", bytes.len()));
        }
        match root.id {
            DATA => {
                let (header, trackers) = data(root)?;
                self.server(from, at).gather(header, trackers, heard)?;
                // What one server does not see, another may.
                heard.is_everything &= self.is_alone(at);
                Ok(())
            }
            INFO => {
                let names = info(root)?;
                // The names of a frame may come in several packets, so what is known stays known, but for the trackers that have
                // another name now.
                let named: BTreeSet<u16> = names.iter().map(|(_, id)| *id).collect();
                let wanted: Vec<_> = names.into_iter().filter(|(name, _)| self.wanted.contains(name)).collect();
                let server = self.server(from, at);
                server.names.retain(|_, id| !named.contains(id));
                server.names.extend(wanted);
                Err(Refusal::Other("names of trackers".to_owned()))
            }
            id => bad(format!("chunk {id:#06x} is neither data nor info")),
        }
    }
}

impl Server {
    /// Takes a packet's trackers; those of the whole frame are heard once its last packet is here.
    fn gather(&mut self, header: Header, trackers: Vec<(u16, Reading)>, heard: &mut Heard) -> Result<(), Refusal> {
        if let Some(newest_us) = self.newest_us
            && (1..LATE_US).contains(&newest_us.saturating_sub(header.time_us))
        {
            return Err(Refusal::Old(format!("{} µs is not newer than {newest_us}", header.time_us)));
        }
        self.newest_us = Some(header.time_us);

        let same = self.frame.take_if(|frame| frame.header == header);
        // Whatever else was being gathered has ended without its last packet.
        heard.incomplete_frames = u64::from(self.frame.take().is_some());
        let empty = Gathered { header, packets: 0, readings: Vec::new(), trackers: BTreeSet::new() };
        let mut frame = same.unwrap_or(empty);
        let repeated = trackers.iter().find(|(id, _)| frame.trackers.contains(id)).map(|(id, _)| *id);
        if let Some(id) = repeated {
            self.frame = Some(frame);
            return Err(Refusal::Old(format!("the frame has tracker {id} already")));
        }
        if frame.readings.len() + trackers.len() > MAX_TRACKERS {
            return bad(format!("more than {MAX_TRACKERS} trackers in a frame"));
        }
        for (id, reading) in trackers {
            let named = self.names.iter().find(|(_, named)| **named == id);
            let name = named.map(|(name, _)| BodyId::Name(name.as_str().into()));
            frame.trackers.insert(id);
            frame.readings.push(Reading { body: name.unwrap_or(reading.body), ..reading });
        }
        frame.packets += 1;
        if frame.packets < header.packets {
            self.frame = Some(frame);
            return Ok(());
        }
        heard.readings = frame.readings;
        heard.is_everything = true;
        Ok(())
    }
}

/// A chunk: its id and what it holds.
struct Chunk<'a> {
    id: u16,
    has_chunks: bool,
    bytes: Bytes<'a>,
}

impl<'a> Chunk<'a> {
    fn read(bytes: &mut Bytes<'a>) -> Result<Self, Refusal> {
        let header = bytes.u32("a chunk's header")?;
        let length = header >> 16 & 0x7fff;
        let id = (header & 0xffff) as u16;
        let inner = bytes.take(length as usize, &format!("chunk {id:#06x}"))?;
        Ok(Self { id, has_chunks: header >> 31 == 1, bytes: Bytes::new(inner) })
    }

    /// The chunks that it holds, which fill it.
    fn chunks(mut self) -> Result<Vec<Chunk<'a>>, Refusal> {
        if !self.has_chunks && !self.bytes.is_empty() {
            return bad(format!("chunk {:#06x} should hold chunks, and says that it does not", self.id));
        }
        let mut chunks = Vec::new();
        while !self.bytes.is_empty() {
            chunks.push(Self::read(&mut self.bytes)?);
        }
        Ok(chunks)
    }

    /// A chunk that holds numbers, when they have been read.
    fn end(&self, what: &str) -> Result<(), Refusal> {
        if self.bytes.is_empty() { Ok(()) } else { bad(format!("{} bytes too many in {what}", self.bytes.len())) }
    }
}

fn header(mut chunk: Chunk<'_>) -> Result<Header, Refusal> {
    let time_us = chunk.bytes.u64("the header")?;
    let [version, _, frame, packets] = chunk.bytes.u32("the header")?.to_le_bytes();
    chunk.end("the header")?;
    if version != 2 {
        return bad(format!("version {version} is not 2"));
    }
    if packets == 0 {
        return bad("a frame of no packets");
    }
    Ok(Header { time_us, frame, packets })
}

fn data(root: Chunk<'_>) -> Result<(Header, Vec<(u16, Reading)>), Refusal> {
    let (mut head, mut trackers) = (None, Vec::new());
    for chunk in root.chunks()? {
        match chunk.id {
            0 => head = Some(header(chunk)?),
            1 => {
                for chunk in chunk.chunks()? {
                    trackers.push((chunk.id, tracker(chunk)?));
                }
            }
            _ => {}
        }
    }
    let Some(header) = head else { return bad("a packet without its header") };
    let time_ns = header.time_us.saturating_mul(1000);
    trackers.iter_mut().for_each(|(_, reading)| reading.measured_ns = reading.measured_ns.or(Some(time_ns)));
    Ok((header, trackers))
}

fn tracker(chunk: Chunk<'_>) -> Result<Reading, Refusal> {
    let mut reading = Reading::of(BodyId::Number(chunk.id.into()));
    let mut is_valid = true;
    for mut field in chunk.chunks()? {
        match field.id {
            0 => {
                let p = finite(field.bytes.vector("a position")?, "position")?;
                reading.position_m = Some(Axes::Y_UP_LEFT.vector(p));
            }
            1 => {
                let v = finite(field.bytes.vector("a speed")?, "speed")?;
                reading.velocity_m_s = Some(Axes::Y_UP_LEFT.vector(v));
            }
            2 => {
                let r = finite(field.bytes.vector("an orientation")?, "orientation")?;
                // A few turns are a tracker that counts them; beyond, single precision has no angle left.
                if r.length() > 1e3 {
                    return bad("an orientation of hundreds of turns");
                }
                reading.orientation = Some(DQuat::from_scaled_axis(Axes::Y_UP_LEFT.turn(r)));
            }
            3 => {
                let validity = field.bytes.f32("a validity")?;
                if !validity.is_finite() {
                    return bad("non-finite validity");
                }
                is_valid = validity > 0.0;
            }
            6 => reading.measured_ns = Some(field.bytes.u64("a time")?.saturating_mul(1000)),
            _ => continue,
        }
        field.end("a tracker's field")?;
    }
    if !is_valid {
        return Ok(Reading { measured_ns: reading.measured_ns, ..Reading::of(reading.body) });
    }
    Ok(reading)
}

/// Names of trackers, and their ids.
fn info(root: Chunk<'_>) -> Result<Vec<(String, u16)>, Refusal> {
    let mut names = Vec::new();
    for chunk in root.chunks()? {
        match chunk.id {
            0 => drop(header(chunk)?),
            2 => {
                for tracker in chunk.chunks()? {
                    let id = tracker.id;
                    for mut field in tracker.chunks()?.into_iter().filter(|field| field.id == 0) {
                        let name = field.bytes.take(field.bytes.len(), "a name")?;
                        names.push((String::from_utf8_lossy(name).into_owned(), id));
                    }
                }
            }
            _ => {}
        }
    }
    Ok(names)
}
