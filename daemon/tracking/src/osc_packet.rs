//! OSC 1.0 packets: a message, or a bundle of messages and of further bundles.
//!
//! Crate `rosc` reads single messages. Bundles are opened here, because `rosc` follows them and the arrays of a message
//! as deep as a datagram has them, by recursion that a hostile one could let run over the stack's end, and because it
//! leaves out silently what follows the first broken element of a bundle.

use crate::protocol::{Refusal, bad};
use rosc::{OscMessage, OscPacket};

/// Bundles within bundles.
const MAX_DEPTH: usize = 8;
/// Messages of one datagram.
const MAX_MESSAGES: usize = 2048;
/// Arguments of a message; a pose has ten.
const MAX_ARGUMENTS: usize = 64;

const BUNDLE: &[u8] = b"#bundle\0";
const NS_PER_S: u64 = 1_000_000_000;

/// A message and when its bundle says that it holds, ns since 1900; bundles mostly say "at once".
#[derive(Debug)]
pub(crate) struct Message {
    pub(crate) message: OscMessage,
    pub(crate) time_ns: Option<u64>,
}

/// All messages of a datagram, in its order.
pub(crate) fn messages(datagram: &[u8]) -> Result<Vec<Message>, Refusal> {
    let mut messages = Vec::new();
    // What is still to be read, the next at the end, with the depth and the time of the bundle around it.
    let mut waiting: Vec<(&[u8], usize, Option<u64>)> = vec![(datagram, 0, None)];
    while let Some((packet, depth, time_ns)) = waiting.pop() {
        if packet.starts_with(BUNDLE) {
            if depth == MAX_DEPTH {
                return bad(format!("bundles more than {MAX_DEPTH} deep"));
            }
            let (time_ns, elements) = bundle(packet)?;
            waiting.extend(elements.into_iter().rev().map(|element| (element, depth + 1, time_ns)));
        } else {
            messages.push(Message { message: message(packet)?, time_ns });
        }
        if messages.len() + waiting.len() > MAX_MESSAGES {
            return bad(format!("more than {MAX_MESSAGES} messages"));
        }
    }
    Ok(messages)
}

/// A bundle's time and elements.
fn bundle(packet: &[u8]) -> Result<(Option<u64>, Vec<&[u8]>), Refusal> {
    let word = |bytes: &[u8]| bytes.iter().fold(0_u64, |word, byte| word << 8 | u64::from(*byte));
    let Some((tag, mut rest)) = packet[BUNDLE.len()..].split_at_checked(8) else {
        return bad("a bundle without its time");
    };
    // Seconds and their binary fractions; 1 means "at once".
    let (seconds, fraction) = (word(&tag[..4]), word(&tag[4..]));
    let time_ns = (seconds != 0).then(|| seconds * NS_PER_S + ((fraction * NS_PER_S) >> 32));

    let mut elements = Vec::new();
    while !rest.is_empty() {
        let Some((length, after)) = rest.split_at_checked(4) else { return bad("a bundle with an odd end") };
        let length = usize::try_from(word(length)).unwrap_or(usize::MAX);
        let Some((element, after)) = after.split_at_checked(length) else {
            return bad(format!("an element of {length} bytes in a bundle that has {}", after.len()));
        };
        elements.push(element);
        rest = after;
    }
    Ok((time_ns, elements))
}

fn message(packet: &[u8]) -> Result<OscMessage, Refusal> {
    if packet.first() != Some(&b'/') || !packet.len().is_multiple_of(4) {
        return bad("neither an OSC message nor a bundle");
    }
    check_tags(packet)?;
    match rosc::decoder::decode_udp(packet) {
        Ok(([], OscPacket::Message(message))) => Ok(message),
        Ok((rest, _)) => bad(format!("{} bytes after an OSC message", rest.len())),
        Err(error) => bad(format!("broken OSC message: {error}")),
    }
}

/// Refuses what makes `rosc` use much of the memory or of the stack: many arguments, and arrays.
fn check_tags(packet: &[u8]) -> Result<(), Refusal> {
    let end = |bytes: &[u8]| bytes.iter().position(|byte| *byte == 0);
    let Some(address) = end(packet) else { return bad("an OSC address without its end") };
    let tags = packet.get((address / 4 + 1) * 4..).unwrap_or_default();
    let Some(tags) = end(tags).map(|end| &tags[..end]) else { return bad("an OSC message without types") };
    if tags.first() != Some(&b',') {
        return bad("an OSC message without types");
    }
    if tags.len() > MAX_ARGUMENTS + 1 {
        return bad(format!("an OSC message of {} arguments", tags.len() - 1));
    }
    if tags.contains(&b'[') {
        return bad("an OSC message that holds an array");
    }
    Ok(())
}
