//! A tracker's sockets: bound, joined to its group, and with room for what comes while nobody listens.

use crate::protocol::Saying;
use lantern_config::Tracker;
use rustix::net::netdevice::name_to_index;
use socket2::{Domain, InterfaceIndexOrAddress, Protocol, Socket, Type};
use std::fs;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::task::{Context, Poll};
use tokio::io::ReadBuf;
use tokio::net::UdpSocket;
use tokio::runtime::Handle;

/// Room for what comes while both cores render: a second of the busiest tracker, as far as the system grants it
/// (`net.core.rmem_max`).
const RECEIVE_BUFFER_BYTES: usize = 1 << 20;

/// A tracker that cannot be listened to.
#[derive(Debug, thiserror::Error)]
pub enum TrackerError {
    /// Its address is taken, or not this machine's.
    #[error(
        "tracker `{name}` cannot listen at {listen}: {source}; hint: another program may have that port, or no \
             network card that address"
    )]
    Bind {
        /// The tracker.
        name: String,
        /// Its address.
        listen: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The interface is not there, or does not take part in multicast.
    #[error("tracker `{name}` cannot join {group} on `{interface}`: {source}; hint: {}", interfaces())]
    Join {
        /// The tracker.
        name: String,
        /// The group.
        group: IpAddr,
        /// As the configuration has it.
        interface: String,
        /// What the system said.
        source: io::Error,
    },
}

/// The interfaces that there are, for whoever named another.
fn interfaces() -> String {
    // Two lines of headings, then a line a device, which begins with its name and a colon.
    let table = fs::read_to_string("/proc/self/net/dev").unwrap_or_default();
    let mut names: Vec<_> = table.lines().skip(2).filter_map(|line| Some(line.split_once(':')?.0.trim())).collect();
    names.sort_unstable();
    match names.as_slice() {
        [] => "`ip address` lists the interfaces; the loopback one may lack the flag MULTICAST".to_owned(),
        _ => format!("there are {}; `ip link` shows which have the flag MULTICAST", names.join(", ")),
    }
}

/// Where a tracker listens: what its sockets depend on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    /// As it was asked for; a port of 0 means any.
    pub(crate) listen: SocketAddr,
    pub(crate) interface: Option<String>,
    /// Whether its protocol speaks to a server.
    pub(crate) speaks: bool,
}

impl Place {
    pub(crate) fn of(tracker: &Tracker) -> Self {
        let speaks = matches!(tracker.protocol, lantern_config::Protocol::Natnet(_));
        Self { listen: tracker.listen, interface: tracker.interface.clone(), speaks }
    }
}

/// The sockets of one tracker.
#[derive(Debug)]
pub(crate) struct Sockets {
    /// Hears what the tracker sends to where it was told to.
    listening: UdpSocket,
    /// Speaks to the server and hears its answers, where `listening` is a group's, from which nothing can be sent.
    speaking: Option<UdpSocket>,
    address: SocketAddr,
}

impl Sockets {
    /// Opens what a tracker of this name needs.
    pub(crate) fn open(runtime: &Handle, name: &str, place: &Place) -> Result<Self, TrackerError> {
        let failed = |source| TrackerError::Bind { name: name.to_owned(), listen: place.listen, source };
        // A socket belongs to the runtime that it is made in.
        let _guard = runtime.enter();
        let socket = bound(place.listen).map_err(failed)?;
        if let Some(interface) = &place.interface {
            join(&socket, place.listen.ip(), interface).map_err(|source| TrackerError::Join {
                name: name.to_owned(),
                group: place.listen.ip(),
                interface: interface.clone(),
                source,
            })?;
        }
        let listening = UdpSocket::from_std(socket.into()).map_err(failed)?;
        let anywhere = match place.listen {
            SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
            SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
        };
        let speaking = if place.speaks && place.listen.ip().is_multicast() {
            Some(bound(anywhere).and_then(|socket| UdpSocket::from_std(socket.into())).map_err(failed)?)
        } else {
            None
        };
        let address = listening.local_addr().map_err(failed)?;
        Ok(Self { listening, speaking, address })
    }

    /// Where it listens, as it is.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// The next datagram's length and sender.
    pub(crate) fn poll_datagram(
        &self,
        context: &mut Context<'_>,
        buffer: &mut [u8],
    ) -> Poll<io::Result<(usize, SocketAddr)>> {
        for socket in [Some(&self.listening), self.speaking.as_ref()].into_iter().flatten() {
            let mut buffer = ReadBuf::new(buffer);
            if let Poll::Ready(from) = socket.poll_recv_from(context, &mut buffer) {
                return Poll::Ready(from.map(|from| (buffer.filled().len(), from)));
            }
        }
        Poll::Pending
    }

    /// Sends, or fails at once.
    pub(crate) fn say(&self, saying: &Saying) -> io::Result<()> {
        let socket = self.speaking.as_ref().unwrap_or(&self.listening);
        socket.try_send_to(&saying.datagram, saying.to).map(drop)
    }

    /// How many datagrams the system has thrown away for want of room, as far as it tells.
    pub(crate) fn kernel_dropped(&self) -> Option<u64> {
        let inode = rustix::fs::fstat(&self.listening).ok()?.st_ino.to_string();
        let tables = ["/proc/self/net/udp", "/proc/self/net/udp6"];
        tables.iter().find_map(|table| drops_of(&fs::read_to_string(table).ok()?, &inode))
    }
}

/// The last column of the line of a socket (proc(5)); its inode is the tenth.
fn drops_of(table: &str, inode: &str) -> Option<u64> {
    let line = table.lines().find(|line| line.split_whitespace().nth(9) == Some(inode))?;
    line.split_whitespace().last()?.parse().ok()
}

fn bound(address: SocketAddr) -> io::Result<Socket> {
    let socket = Socket::new(Domain::for_address(address), Type::DGRAM.nonblocking(), Some(Protocol::UDP))?;
    if address.ip().is_multicast() {
        // Whoever else listens to the group on this machine goes on hearing it, and we hear no group that is another's.
        socket.set_reuse_address(true)?;
        match address {
            SocketAddr::V4(_) => socket.set_multicast_all_v4(false)?,
            SocketAddr::V6(_) => socket.set_multicast_all_v6(false)?,
        }
    }
    // The system gives what it may; what it throws away for want of more is counted.
    socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
    socket.bind(&address.into())?;
    Ok(socket)
}

/// Joins a group on an interface that is named, or told by its address.
fn join(socket: &Socket, group: IpAddr, interface: &str) -> io::Result<()> {
    let by_name = || name_to_index(socket, interface).map_err(io::Error::from);
    match (group, interface.parse::<IpAddr>()) {
        (IpAddr::V4(group), Ok(IpAddr::V4(address))) => {
            socket.join_multicast_v4_n(&group, &InterfaceIndexOrAddress::Address(address))
        }
        (IpAddr::V4(group), _) => socket.join_multicast_v4_n(&group, &InterfaceIndexOrAddress::Index(by_name()?)),
        (IpAddr::V6(group), _) => socket.join_multicast_v6(&group, by_name()?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_are_the_last_column_of_ones_own_line() {
        let table = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops\n\
                     3: 0100007F:1B58 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 777 2 0000000000000000 12\n\
                     4: 0100007F:1B59 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 778 2 0000000000000000 0\n";
        assert_eq!((drops_of(table, "777"), drops_of(table, "778"), drops_of(table, "77")), (Some(12), Some(0), None));
    }
}
