//! NatNet 3.0 to 4.x: OptiTrack's frames, little-endian.
//!
//! A message is u16 what it is, u16 how many bytes follow. A frame (7) is
//!
//! ```text
//! i32 number; marker sets; other markers; rigid bodies; skeletons; [4.1: assets]; labelled markers; force plates;
//! devices; u32 timecode, u32 sub; f64 s; 3 × u64 ticks; [4.1: 2 × u32]; u16 parameters; u32 end
//! rigid body: i32 id; 3 × f32 m; 4 × f32 quaternion; f32 error; u16, bit 0: tracked
//! ```
//!
//! and each section opens with a count, from 4.1 on followed by its size in bytes. A frame does not tell its version:
//! that comes from the configuration, or from the server ([`Conversation`]). Since
//! every layout must end exactly where the message does, a frame read by another version's layout is refused.

use crate::bytes::Bytes;
use crate::natnet_server::{Conversation, FRAME, SERVER_INFO};
use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, Saying, bad, finite, ns_of, unit};
use glam::DQuat;
use lantern_config::NatnetVersion;
use std::net::SocketAddr;
use std::time::Instant;

const MARKER_BYTES: usize = 12;
const RIGID_BODY_BYTES: usize = 38;
const LABELLED_MARKER_BYTES: usize = 26;
const TRACKED: u16 = 1;

/// Reads frames.
pub(crate) struct Natnet {
    conversation: Conversation,
}

impl Natnet {
    pub(crate) fn new(settings: &lantern_config::Natnet, is_multicast: bool) -> Self {
        Self { conversation: Conversation::new(settings, is_multicast) }
    }
}

impl Protocol for Natnet {
    fn read(&mut self, datagram: &[u8], from: SocketAddr, _at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let mut bytes = Bytes::new(datagram);
        let (id, size) = (bytes.u16("the header")?, bytes.u16("the header")?);
        if usize::from(size) != bytes.len() {
            return bad(format!("claims {size} bytes and has {}", bytes.len()));
        }
        match id {
            FRAME => {
                let version = self.conversation.version_of(from)?;
                frame(bytes, version, heard).map_err(|refusal| match refusal {
                    Refusal::Bad(reason) => Refusal::Bad(format!("{reason} (read as NatNet {version})")),
                    other => other,
                })
            }
            SERVER_INFO => {
                self.conversation.answer(bytes, from)?;
                Err(Refusal::Other("the server's answer".to_owned()))
            }
            id => Err(Refusal::Other(format!("message {id}"))),
        }
    }

    fn say(&mut self, now: Instant) -> Vec<Saying> {
        self.conversation.say(now)
    }
}

fn frame(mut bytes: Bytes<'_>, version: NatnetVersion, heard: &mut Heard) -> Result<(), Refusal> {
    let is_sized = version >= NatnetVersion { major: 4, minor: 1 };
    heard.frame = Some(bytes.u32("the frame's number")?);
    let mut section = |what: &str, least: usize, entry: &mut dyn FnMut(&mut Bytes<'_>) -> Result<(), Refusal>| {
        if !is_sized {
            let count = bytes.count(least, what)?;
            return (0..count).try_for_each(|_| entry(&mut bytes));
        }
        let count = bytes.u32(what)?;
        let size = bytes.u32(what)? as usize;
        let mut inner = Bytes::new(bytes.take(size, what)?);
        if count as usize > inner.len() / least {
            return bad(format!("claims {count} {what} in {size} bytes"));
        }
        (0..count).try_for_each(|_| entry(&mut inner))?;
        if inner.is_empty() { Ok(()) } else { bad(format!("{} bytes after the last of the {what}", inner.len())) }
    };

    section("marker sets", 5, &mut |bytes| {
        bytes.text("a marker set's name")?;
        passed(bytes, MARKER_BYTES, "markers")
    })?;
    section("markers", MARKER_BYTES, &mut |bytes| bytes.take(MARKER_BYTES, "a marker").map(drop))?;
    section("rigid bodies", RIGID_BODY_BYTES, &mut |bytes| {
        heard.readings.push(rigid_body(bytes)?);
        Ok(())
    })?;
    section("skeletons", 8, &mut |bytes| {
        bytes.u32("a skeleton")?;
        passed(bytes, RIGID_BODY_BYTES, "bones")
    })?;
    if is_sized {
        section("assets", 12, &mut |bytes| {
            bytes.u32("an asset")?;
            passed(bytes, RIGID_BODY_BYTES, "an asset's bodies")?;
            passed(bytes, LABELLED_MARKER_BYTES, "an asset's markers")
        })?;
    }
    section("labelled markers", LABELLED_MARKER_BYTES, &mut |bytes| {
        bytes.take(LABELLED_MARKER_BYTES, "a labelled marker").map(drop)
    })?;
    section("force plates", 8, &mut channels)?;
    section("devices", 8, &mut channels)?;

    bytes.take(8, "the timecode")?;
    let time_s = bytes.f64("the time")?;
    bytes.take(24, "the ticks")?;
    if is_sized {
        bytes.take(8, "the precise time")?;
    }
    bytes.u16("the parameters")?;
    if bytes.u32("the end")? != 0 {
        return bad("no end where it should be");
    }
    if !bytes.is_empty() {
        return bad(format!("{} bytes after the end", bytes.len()));
    }
    if !time_s.is_finite() {
        return bad("non-finite time");
    }
    heard.is_everything = true;
    // Of a clock that starts with Motive a time before 0 is none.
    let measured_ns = ns_of(time_s);
    heard.readings.iter_mut().for_each(|reading| reading.measured_ns = measured_ns);
    Ok(())
}

/// Things of one size, after their count.
fn passed(bytes: &mut Bytes<'_>, size: usize, what: &str) -> Result<(), Refusal> {
    let count = bytes.count(size, what)?;
    bytes.take(count * size, what).map(drop)
}

/// A force plate or another device: its id, and channels of samples.
fn channels(bytes: &mut Bytes<'_>) -> Result<(), Refusal> {
    bytes.u32("a device")?;
    let count = bytes.count(4, "channels")?;
    (0..count).try_for_each(|_| passed(bytes, 4, "samples"))
}

fn rigid_body(bytes: &mut Bytes<'_>) -> Result<Reading, Refusal> {
    let id = bytes.u32("a rigid body")?;
    let position = bytes.vector("a rigid body")?;
    let [x, y, z, w] = [
        bytes.f32("a rigid body")?,
        bytes.f32("a rigid body")?,
        bytes.f32("a rigid body")?,
        bytes.f32("a rigid body")?,
    ];
    bytes.f32("a rigid body")?;
    let parameters = bytes.u16("a rigid body")?;
    let reading = Reading::of(BodyId::Number(id));
    // What stands there of a body that is not seen is whatever was there before.
    if parameters & TRACKED == 0 {
        return Ok(reading);
    }
    Ok(Reading {
        position_m: Some(finite(position, "position")?),
        orientation: Some(unit(DQuat::from_xyzw(x, y, z, w))?),
        ..reading
    })
}
