//! Where other programs come in.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use ecan_bridge::{
    BridgeConfig, BridgeProtocol, BridgeServer, Clients, SerialBridge, SocketCanBridge,
};
use serde::Serialize;

use crate::failure::Failure;

/// Where to listen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listening(pub SocketAddr);

impl Listening {
    /// A free port of the loopback interface.
    pub const ANY: Self = Self(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0));
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

/// Where other programs come in, in words.
#[derive(Clone, Debug, Serialize)]
pub struct Place {
    pub protocol: &'static str,
    pub address: String,
    pub channel: u8,
}

/// A server; it ends when this is dropped.
#[derive(Debug)]
pub enum Endpoint {
    Server(BridgeServer),
    Terminal { bridge: SerialBridge, link: Option<Link> },
    Interface(SocketCanBridge),
}

/// A name for a terminal, taken away in the end.
#[derive(Debug)]
pub struct Link(PathBuf);

impl Drop for Link {
    fn drop(&mut self) {
        // One that is gone already is no error.
        let _ = std::fs::remove_file(&self.0);
    }
}

impl Endpoint {
    /// Listens.
    pub fn listen(
        protocol: BridgeProtocol,
        Listening(address): Listening,
        max_clients: u16,
    ) -> Result<Self, Failure> {
        let max_clients = max_clients.into();
        let settings =
            BridgeConfig { address, max_clients, ..BridgeConfig::with_protocol(protocol) };
        let server = BridgeServer::listen(&settings);
        server.map(Self::Server).map_err(|error| Failure::Bridge(error.to_string()))
    }

    /// Makes a terminal, with a link to it where a path is given.
    pub fn terminal(link: &Path) -> Result<Self, Failure> {
        let no_terminal = |error| Failure::Bridge(format!("cannot make a terminal: {error}"));
        let queue = BridgeConfig::default().queue;
        let bridge = SerialBridge::open(queue).map_err(no_terminal)?;
        if link.as_os_str().is_empty() {
            return Ok(Self::Terminal { bridge, link: None });
        }
        let linked = std::os::unix::fs::symlink(bridge.path(), link);
        linked.map_err(|error| Failure::File {
            what: "make the link",
            path: link.to_owned(),
            reason: error.to_string(),
        })?;
        Ok(Self::Terminal { bridge, link: Some(Link(link.to_owned())) })
    }

    /// Couples a CAN interface of this host.
    pub fn interface(name: &str) -> Result<Self, Failure> {
        let bridge = SocketCanBridge::open(name, BridgeConfig::default().queue);
        bridge.map(Self::Interface).map_err(|error| Failure::Bridge(error.to_string()))
    }

    pub fn clients(&self) -> &Clients {
        match self {
            Self::Interface(bridge) => bridge.clients(),
            Self::Server(server) => server.clients(),
            Self::Terminal { bridge, .. } => bridge.clients(),
        }
    }

    pub fn place(&self, channel: u8) -> Place {
        let (protocol, address) = match self {
            Self::Server(server) => {
                let protocol = match server.info().protocol() {
                    BridgeProtocol::Slcan => "slcan",
                    BridgeProtocol::Socketcand => "socketcand",
                };
                (protocol, server.info().address().to_string())
            }
            Self::Terminal { bridge, link } => {
                let path = link.as_ref().map_or(bridge.path(), |link| &link.0);
                ("slcan", path.display().to_string())
            }
            Self::Interface(bridge) => ("socketcan", bridge.interface().to_owned()),
        };
        Place { protocol, address, channel }
    }

    /// Where it speaks socketcand, if it does.
    pub fn socketcand_address(&self) -> Option<SocketAddr> {
        let Self::Server(server) = self else { return None };
        let info = server.info();
        (info.protocol() == BridgeProtocol::Socketcand).then(|| info.address())
    }

    /// Whether other machines reach it.
    pub fn is_open_to_others(&self) -> bool {
        match self {
            Self::Server(server) => !server.info().address().ip().is_loopback(),
            Self::Terminal { .. } | Self::Interface(_) => false,
        }
    }

    /// Fails where it cannot go on.
    pub fn check(&self) -> Result<(), Failure> {
        let Self::Interface(bridge) = self else { return Ok(()) };
        bridge.end().map_or(Ok(()), |error| {
            let name = bridge.interface();
            Err(Failure::Bridge(format!("the CAN interface {name} is gone: {error}")))
        })
    }

    /// What did not go through, in words; nothing where all did.
    pub fn losses(&self) -> Vec<String> {
        let counted = self.clients().statistics();
        let has_own_words = counted.dropped_to_bus + counted.mismatched + counted.discarded;
        let words = [
            (counted.dropped_to_bus, "frames for the bus were dropped: too many waited"),
            (
                counted.dropped_to_clients,
                "frames of the bus were dropped: nobody took them in time",
            ),
            (
                counted.rejected.saturating_sub(has_own_words),
                "commands or frames were refused: malformed, unknown, or at the wrong time",
            ),
            (
                counted.mismatched,
                "frames for the bus were refused: the channel has another bit rate, or no CAN FD",
            ),
            (
                counted.discarded,
                "frames for the bus were refused: nothing could be sent, or the channel only listens",
            ),
            (
                counted.unsupported,
                "CAN FD frames were not passed on: the interface is one of classic CAN (with \
                 ip link set INTERFACE mtu 72 a virtual one carries them)",
            ),
        ];
        let lost = words.into_iter().filter(|(count, _)| *count > 0);
        lost.map(|(count, words)| format!("{count} {words}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Listening;

    #[test]
    fn addresses_may_be_short() {
        let parse = |text: &str| text.parse::<Listening>().map(|it| it.0.to_string());
        assert_eq!(parse("0"), Ok("127.0.0.1:0".to_owned()));
        assert_eq!(parse("29536"), Ok("127.0.0.1:29536".to_owned()));
        assert_eq!(parse("0.0.0.0:1"), Ok("0.0.0.0:1".to_owned()));
        assert_eq!(parse("::1"), Ok("[::1]:0".to_owned()));
        for wrong in ["", "65536", "localhost", "1.2.3", "1.2.3.4:"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
