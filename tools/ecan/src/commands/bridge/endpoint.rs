//! Addresses and servers for the clients of a channel, and the gate that rejects their frames.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use ecan_can_io::bridge::{
    BridgeConfig, BridgeProtocol, BridgeServer, Clients, SerialBridge, SocketCanBridge,
};
use serde::Serialize;

use crate::context::{Failure, Result};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listening(pub SocketAddr);

impl Listening {
    /// A free port of the loopback interface.
    pub const ANY: Self = Self(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0));

    /// The address for the channel with this index: ports count up; free ports remain free ports.
    pub fn following(self, index: u16) -> Result<Self> {
        let Self(mut address) = self;
        let port = match address.port() {
            0 => Some(0),
            first => first.checked_add(index),
        };
        let too_high = || Failure::Usage(format!("no ports after {address} for all channels"));
        address.set_port(port.ok_or_else(too_high)?);
        Ok(Self(address))
    }
}

impl FromStr for Listening {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let local = |port| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
        let port = text.parse().map(local).ok();
        let whole = || text.parse::<SocketAddr>().ok();
        let address = || text.parse().ok().map(|ip| SocketAddr::new(ip, 0));
        let found = port.or_else(whole).or_else(address);
        found.map(Self).ok_or_else(|| "expected a port, an IP address, or ADDRESS:PORT".to_owned())
    }
}

#[derive(Clone, Debug, Serialize)]
pub struct Address {
    pub protocol: &'static str,
    pub address: String,
    #[serde(flatten)]
    pub lane: LaneId,
}

/// A server; stops when dropped.
#[derive(Debug)]
pub enum Endpoint {
    Server(BridgeServer),
    Terminal { bridge: SerialBridge, link: Option<Link> },
    Interface(SocketCanBridge),
}

/// Symbolic link to a terminal; removed when dropped.
#[derive(Debug)]
pub struct Link {
    path: PathBuf,
    terminal: PathBuf,
}

impl Drop for Link {
    fn drop(&mut self) {
        // Another program may have removed or replaced it.
        if std::fs::read_link(&self.path).is_ok_and(|terminal| terminal == self.terminal) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl Endpoint {
    pub fn listen(
        protocol: BridgeProtocol,
        Listening(address): Listening,
        LaneId { channel, .. }: LaneId,
        max_clients: u16,
    ) -> Result<Self> {
        let config = BridgeConfig {
            address,
            bus: Some(format!("can{channel}")),
            max_clients: max_clients.into(),
            ..BridgeConfig::with_protocol(protocol)
        };
        let server = BridgeServer::listen(&config);
        server.map(Self::Server).map_err(|error| Failure::Bridge(error.to_string()))
    }

    pub fn terminal(link: &Path) -> Result<Self> {
        let no_terminal =
            |error| Failure::Bridge(format!("cannot open a pseudo-terminal: {error}"));
        let queue = BridgeConfig::default().queue;
        let bridge = SerialBridge::open(queue).map_err(no_terminal)?;
        if link.as_os_str().is_empty() {
            return Ok(Self::Terminal { bridge, link: None });
        }
        let linked = std::os::unix::fs::symlink(bridge.path(), link);
        linked.map_err(|error| Failure::file("create the link", link, error))?;
        let link = Link { path: link.to_owned(), terminal: bridge.path().to_owned() };
        Ok(Self::Terminal { bridge, link: Some(link) })
    }

    pub fn interface(name: &str) -> Result<Self> {
        let bridge = SocketCanBridge::open_or_create(name, BridgeConfig::default().queue);
        bridge.map(Self::Interface).map_err(|error| Failure::Bridge(error.to_string()))
    }

    pub fn clients(&self) -> &Clients {
        match self {
            Self::Interface(bridge) => bridge.clients(),
            Self::Server(server) => server.clients(),
            Self::Terminal { bridge, .. } => bridge.clients(),
        }
    }

    pub fn address(&self, lane: LaneId) -> Address {
        let (protocol, address) = match self {
            Self::Server(server) => {
                (server.info().protocol().name(), server.info().address().to_string())
            }
            Self::Terminal { bridge, link } => {
                let path = link.as_ref().map_or(bridge.path(), |link| &link.path);
                ("slcan", path.display().to_string())
            }
            Self::Interface(bridge) => ("socketcan", bridge.interface().to_owned()),
        };
        Address { protocol, address, lane }
    }

    pub fn socketcand_address(&self) -> Option<SocketAddr> {
        let Self::Server(server) = self else { return None };
        let info = server.info();
        (info.protocol() == BridgeProtocol::Socketcand).then(|| info.address())
    }

    pub fn is_open_to_others(&self) -> bool {
        matches!(self, Self::Server(server) if !server.info().address().ip().is_loopback())
    }

    pub fn check(&self) -> Result {
        let Self::Interface(bridge) = self else { return Ok(()) };
        bridge.end().map_or(Ok(()), |error| {
            let name = bridge.interface();
            Err(Failure::Bridge(format!("CAN interface {name} is not available: {error}")))
        })
    }

    /// What is lost so far, in texts.
    pub fn losses(&self) -> [(u64, &'static str); LOSSES] {
        let counted = self.clients().statistics();
        let counted_apart = counted.mismatched + counted.discarded;
        [
            (counted.dropped_to_bus, "frames to the bus dropped: queue full"),
            (counted.dropped_to_clients, "frames from the bus dropped: clients too slow"),
            (
                counted.rejected.saturating_sub(counted_apart),
                "commands or frames rejected: malformed, unknown, out of sequence, or of another bus",
            ),
            (
                counted.mismatched,
                "commands or frames rejected: another bit rate than that of the bus, or CAN FD is disabled",
            ),
            (counted.failed, "frames to the bus not sent, or with unknown result"),
            (counted.rejected_clients, "connections rejected: too many clients; set --max-clients"),
            (counted.silent_clients, "connections closed: their clients did not open the bus"),
            (counted.discarded, "frames to the bus rejected: channel not available or listen-only"),
            (
                counted.unsupported,
                "CAN FD frames from the bus dropped: the interface is classic CAN (with \
                 ip link set INTERFACE mtu 72 a virtual one carries them)",
            ),
        ]
    }
}

/// Kinds of losses of an endpoint.
pub const LOSSES: usize = 9;

/// A name with the placeholders `%g` (index of the gateway) and `%c` (channel).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NameTemplate(String);

impl NameTemplate {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn name(&self, LaneId { gateway, channel }: LaneId) -> String {
        self.0.replace("%g", &gateway.to_string()).replace("%c", &channel.to_string())
    }
}

impl FromStr for NameTemplate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_valid = text.split('%').skip(1).all(|rest| rest.starts_with(['g', 'c']));
        match is_valid {
            true => Ok(Self(text.to_owned())),
            false => Err("expected only %g (gateway) and %c (channel) after %".to_owned()),
        }
    }
}

/// Parses the name of a network interface, with placeholders.
pub fn parse_interface(text: &str) -> Result<NameTemplate, String> {
    let template: NameTemplate = text.parse()?;
    // All numbers have one digit in the usual case.
    let name = template.name(LaneId { gateway: 0, channel: 0 });
    let is_possible = (1..=15).contains(&name.len())
        && name.bytes().all(|byte| byte.is_ascii_graphic() && !matches!(byte, b'/' | b':'));
    match is_possible {
        true => Ok(template),
        false => {
            Err("expected the name of a network interface, 1 to 15 characters, for example vcan0"
                .to_owned())
        }
    }
}

/// A channel of a gateway, in the order of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct LaneId {
    pub gateway: usize,
    pub channel: u8,
}

impl fmt::Display for LaneId {
    /// For example "can1", or "can1 of gateway 2".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "can{}", self.channel)?;
        match self.gateway {
            0 => Ok(()),
            gateway => write!(f, " of gateway {gateway}"),
        }
    }
}

/// Rejects frames of clients while the gateway is not ready or the channel is bus-off or stalled.
/// Frames that are sent later, all at once, would be outdated and could move an axis.
#[derive(Debug)]
pub struct TransmitGate {
    is_open: bool,
}

impl TransmitGate {
    pub fn new(endpoints: &[Endpoint]) -> Self {
        let mut gate = Self { is_open: true };
        gate.set_open(false, 0, endpoints);
        gate
    }

    /// Opens or closes the gate; clients are told which of their frames are lost.
    pub fn set_open(&mut self, is_open: bool, time_ns: u64, endpoints: &[Endpoint]) {
        if std::mem::replace(&mut self.is_open, is_open) != is_open {
            for endpoint in endpoints {
                endpoint.clients().set_accepting(is_open, time_ns);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Listening, *};

    #[test]
    fn short_addresses_are_completed() {
        let parse = |text: &str| text.parse::<Listening>().map(|listening| listening.0.to_string());
        assert_eq!(parse("0"), Ok("127.0.0.1:0".to_owned()));
        assert_eq!(parse("29536"), Ok("127.0.0.1:29536".to_owned()));
        assert_eq!(parse("0.0.0.0:1"), Ok("0.0.0.0:1".to_owned()));
        assert_eq!(parse("::1"), Ok("[::1]:0".to_owned()));
        for wrong in ["", "65536", "localhost", "1.2.3", "1.2.3.4:"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn placeholders_are_replaced() {
        let name = |text: &str| {
            text.parse::<NameTemplate>()
                .map(|template| template.name(LaneId { gateway: 1, channel: 3 }))
        };
        assert_eq!(name("vcan0"), Ok("vcan0".to_owned()));
        assert_eq!(name("can%g%c"), Ok("can13".to_owned()));
        assert_eq!(name("c%c-g%g"), Ok("c3-g1".to_owned()));
        for wrong in ["can%", "can%d", "can%%c"] {
            assert!(name(wrong).is_err(), "{wrong}");
        }
        assert!(parse_interface("thirteen_and%g%c").is_ok());
        assert!(parse_interface("fourteen__and_%g%c").is_err());
    }
}
