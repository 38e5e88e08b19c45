//! socketcand's beacon: announces a bridge on the network.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

/// UDP port of the beacon in the protocol.
pub const PORT: u16 = 42_000;
/// Period. The protocol allows three seconds; python-can listens for little more.
const INTERVAL: Duration = Duration::from_secs(1);

/// Sends the beacon periodically until dropped.
#[derive(Debug)]
pub struct Beacon {
    _stop: Sender<()>,
}

impl Beacon {
    /// Announces the bridge at `server` to an address, which may be a broadcast address.
    pub fn start(to: SocketAddr, server: SocketAddr, can: u8) -> io::Result<Self> {
        let any: IpAddr = match to {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => std::net::Ipv6Addr::UNSPECIFIED.into(),
        };
        let socket = UdpSocket::bind((any, 0))?;
        socket.set_broadcast(true)?;
        socket.connect(to)?;
        // A server on all addresses is announced with the source address of the beacon.
        let ip = if server.ip().is_unspecified() { socket.local_addr()?.ip() } else { server.ip() };
        let text = text(SocketAddr::new(ip, server.port()), can);
        let (stop, stopped) = channel::<()>();
        thread::Builder::new().name("bridge beacon".to_owned()).spawn(move || {
            loop {
                // Errors are ignored: no receiver, or no network at the moment.
                let _ = socket.send(text.as_bytes());
                if stopped.recv_timeout(INTERVAL) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        })?;
        Ok(Self { _stop: stop })
    }
}

fn text(server: SocketAddr, channel: u8) -> String {
    format!(
        "<CANBeacon name=\"ecan\" type=\"adapter\" description=\"ECAN-Lite\">\n\
         <URL>can://{server}</URL><Bus name=\"can{channel}\"/></CANBeacon>"
    )
}
