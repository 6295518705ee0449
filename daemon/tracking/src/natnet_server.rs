//! What is said to a NatNet server, and what it answers: which version its frames have.
//!
//! NAT_CONNECT (0), to the command port, is answered by NAT_SERVERINFO (1), which names the version. A server that
//! streams unicast sends its frames to where that came from, for as long as NAT_KEEPALIVE (10) goes on coming.
//!
//! Who asks for no server by name is given the version by whoever sends frames, if that is an allowed sender.

use crate::bytes::Bytes;
use crate::protocol::{Refusal, Saying, bad, canonical};
use lantern_config::NatnetVersion;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

const CONNECT: u16 = 0;
pub(crate) const SERVER_INFO: u16 = 1;
pub(crate) const FRAME: u16 = 7;
const KEEP_ALIVE: u16 = 10;

const COMMAND_PORT: u16 = 1510;
/// Where in the server's answer its versions stand: after its name.
const NAME_BYTES: usize = 256;

/// How often a server that does not answer is asked.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// A server that has been silent for so long may have started anew, as another version.
const SILENCE: Duration = Duration::from_secs(3);

/// Who is asked, and what is known.
#[derive(Debug)]
pub(crate) struct Conversation {
    /// As configured; an IPv4 address as such, which is how senders are told.
    server: Option<SocketAddr>,
    /// Whether it streams to us alone, and wants to be told that we are here.
    is_kept_alive: bool,
    configured: Option<NatnetVersion>,
    /// What the server has answered.
    answered: Option<(SocketAddr, NatnetVersion)>,
    /// Who sends frames whose version nobody knows.
    sender: Option<SocketAddr>,
    asked: Option<Instant>,
    /// Whether anything has come from the server since `quiet_since`.
    has_spoken: bool,
    quiet_since: Option<Instant>,
}

impl Conversation {
    pub(crate) fn new(settings: &lantern_config::Natnet, is_multicast: bool) -> Self {
        Self {
            server: settings.server.map(canonical),
            is_kept_alive: !is_multicast,
            configured: settings.version,
            answered: None,
            sender: None,
            asked: None,
            has_spoken: false,
            quiet_since: None,
        }
    }

    /// The version of a frame.
    pub(crate) fn version_of(&mut self, from: SocketAddr) -> Result<NatnetVersion, Refusal> {
        self.has_spoken = true;
        if let Some(version) = self.configured.or(self.answered.map(|(_, version)| version)) {
            return Ok(version);
        }
        self.sender = Some(from);
        let asked = self.asked().unwrap_or(from);
        bad(format!("a frame of unknown version: {asked} has not answered yet; `version` would say it"))
    }

    /// Takes a server's answer, after its header.
    pub(crate) fn answer(&mut self, mut bytes: Bytes<'_>, from: SocketAddr) -> Result<(), Refusal> {
        if self.asked() != Some(from) {
            return bad(format!("an answer from {from}, which was not asked"));
        }
        bytes.take(NAME_BYTES, "the server's name")?;
        bytes.take(4, "the server's version")?;
        let version = bytes.take(4, "the stream's version")?;
        let version = NatnetVersion { major: version[0], minor: version[1] };
        if !version.is_known() {
            return bad(format!("the server streams NatNet {version}, which is neither 3.0, 3.1 nor 4.x"));
        }
        self.has_spoken = true;
        if self.answered.is_none_or(|(server, known)| (server, known) != (from, version)) {
            tracing::info!(server = %from, %version, "NatNet server answered");
            if let Some(configured) = self.configured.filter(|configured| *configured != version) {
                tracing::warn!(
                    "{from} streams NatNet {version}; hint: the configuration says version = \"{configured}\""
                );
            }
        }
        self.answered = Some((from, version));
        Ok(())
    }

    /// Who is asked: the configured server, or the command port of whoever sends frames.
    fn asked(&self) -> Option<SocketAddr> {
        let command_port = |mut sender: SocketAddr| {
            sender.set_port(COMMAND_PORT);
            sender
        };
        self.server.or_else(|| self.sender.map(command_port))
    }

    /// What is to be said now.
    pub(crate) fn say(&mut self, now: Instant) -> Vec<Saying> {
        let mut sayings = Vec::new();
        let Some(to) = self.asked() else { return sayings };
        let mut say = |id: u16| {
            let [low, high] = id.to_le_bytes();
            sayings.push(Saying { to, datagram: vec![low, high, 0, 0] });
        };

        // A server that has fallen silent is asked anew, as is one that has not answered.
        if std::mem::take(&mut self.has_spoken) || self.quiet_since.is_none() {
            self.quiet_since = Some(now);
        }
        let is_silent = self.quiet_since.is_some_and(|since| now.saturating_duration_since(since) >= SILENCE);
        let is_due = self.asked.is_none_or(|asked| now.saturating_duration_since(asked) >= ASK_AGAIN);
        if is_due && (self.answered.is_none() || is_silent) {
            self.asked = Some(now);
            say(CONNECT);
        }
        if self.is_kept_alive && self.server.is_some() && self.answered.is_some() {
            say(KEEP_ALIVE);
        }
        sayings
    }
}
