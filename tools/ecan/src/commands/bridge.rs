//! `ecan bridge`: a channel for other programs.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::str::FromStr;

use clap::Args;
use ecan_bridge::{BridgeProtocol, BridgeServer, BridgeSettings, BusRates, ClientId};
use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{Received, SendTicket, Session};
use ecan_protocol::CanFrame;
use serde::Serialize;

use crate::failure::Failure;
use crate::frames::channels::{Channels, parse_channel};
use crate::frames::options::GatewayOptions;
use crate::frames::service::{Service, Wishes};
use crate::global::GlobalOptions;
use crate::output::Output;

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan bridge --bitrate 1000000                slcan on a free port, which is printed
  ecan bridge --channel 2 --slcan 3333 --socketcand 29536
  python-can: can.Bus(interface=\"slcan\", channel=\"socket://127.0.0.1:3333\")
  python-can: can.Bus(interface=\"socketcand\", host=\"127.0.0.1\", port=29536, channel=\"can2\")

The bit rates of the channel are those of the options: a client that names others hears nothing and
cannot send. Frames go through once per EtherCAT cycle.";

/// Arguments of `bridge`.
#[derive(Debug, Args)]
pub struct BridgeArguments {
    /// Channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
    /// Speak slcan over TCP: a port, an address or both; 127.0.0.1 and a free port otherwise.
    /// The default without --socketcand
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "0")]
    slcan: Option<Listening>,
    /// Speak socketcand over TCP: classic CAN data frames
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "0")]
    socketcand: Option<Listening>,
    /// Clients at a time, of each protocol
    #[arg(long, value_name = "COUNT", default_value_t = 8,
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    max_clients: u16,
    /// Listen without acknowledging; what clients send is not sent
    #[arg(long)]
    listen_only: bool,
    #[command(flatten)]
    options: GatewayOptions,
}

/// Where to listen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Listening(SocketAddr);

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

/// Where other programs connect.
#[derive(Debug, Serialize)]
struct Place {
    protocol: &'static str,
    address: String,
    channel: u8,
}

/// A frame of a client.
#[derive(Clone, Copy, Debug)]
struct Held {
    server: usize,
    client: ClientId,
    frame: CanFrame,
}

pub fn run(
    arguments: &BridgeArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let interrupt = Interrupt::install().map_err(|error| Failure::Master(error.to_string()))?;
    // Before the gateway: the servers' threads keep out of what the cycle's thread asks for.
    let servers = listen(arguments)?;
    let wishes = Wishes {
        is_listening: arguments.listen_only,
        has_results: true,
        has_end: false,
        ..Wishes::on(Channels::only(arguments.channel))
    };
    let opened = Service::open(&arguments.options, wishes, &interrupt, global, output)?;
    let Some(service) = opened else { return Ok(()) };
    announce(arguments.channel, &servers, output)?;
    let mut bridge = Traffic {
        channel: arguments.channel,
        service,
        servers,
        under_way: HashMap::new(),
        waiting: None,
    };
    while !interrupt.is_set() {
        bridge.cycle(arguments.listen_only, output)?;
    }
    Ok(())
}

/// Starts the servers.
fn listen(arguments: &BridgeArguments) -> Result<Vec<BridgeServer>, Failure> {
    let GatewayOptions { bitrate, data_bitrate, .. } = arguments.options;
    let rates = match data_bitrate {
        Some(data_bitrate) => BusRates::fd(bitrate, data_bitrate),
        None => BusRates::classic(bitrate),
    };
    let default = Listening::from_str("0").map_err(Failure::Usage)?;
    let slcan = match (arguments.slcan, arguments.socketcand) {
        (None, None) => Some(default),
        (slcan, _) => slcan,
    };
    let wanted =
        [(BridgeProtocol::Slcan, slcan), (BridgeProtocol::Socketcand, arguments.socketcand)];
    let wanted = wanted.into_iter().filter_map(|(protocol, at)| Some((protocol, at?)));
    wanted
        .map(|(protocol, Listening(address))| {
            let max_clients = arguments.max_clients.into();
            let settings =
                BridgeSettings { address, max_clients, ..BridgeSettings::speaking(protocol) };
            let server = BridgeServer::listen(&settings);
            let server = server.map_err(|error| Failure::Bridge(error.to_string()))?;
            server.set_bus(rates);
            Ok(server)
        })
        .collect()
}

/// Tells where the servers are.
fn announce(channel: u8, servers: &[BridgeServer], output: &Output) -> Result<(), Failure> {
    for server in servers.iter().filter(|server| !server.info().address().ip().is_loopback()) {
        let address = server.info().address();
        output.note(format_args!("whoever reaches {address} can send on the bus"));
    }
    let places: Vec<_> = servers
        .iter()
        .map(|server| Place {
            protocol: match server.info().protocol() {
                BridgeProtocol::Slcan => "slcan",
                BridgeProtocol::Socketcand => "socketcand",
            },
            address: server.info().address().to_string(),
            channel,
        })
        .collect();
    output.data(&places, |out| {
        servers.iter().try_for_each(|server| writeln!(out, "{} on can{channel}", server.info()))
    })
}

/// Frames between the bus and the clients.
#[derive(Debug)]
struct Traffic {
    channel: u8,
    service: Service,
    servers: Vec<BridgeServer>,
    /// Frames of clients that the gateway has.
    under_way: HashMap<SendTicket, Held>,
    /// A frame for which there was no room.
    waiting: Option<Held>,
}

impl Traffic {
    fn cycle(&mut self, is_listening: bool, output: &Output) -> Result<(), Failure> {
        let cycle = self.service.begin();
        for arrival in &cycle.arrivals {
            let time_ns = self.service.absolute_ns(arrival.time_ns);
            match &arrival.received {
                Received::Frame(received) => self.deliver(&received.frame, time_ns, None),
                Received::TransmitReport(report) => {
                    let held = report.ticket.and_then(|ticket| self.under_way.remove(&ticket));
                    let Some(held) = held else { continue };
                    if report.code.is_success() {
                        self.deliver(&held.frame, time_ns, Some(held));
                    } else {
                        output.note(format_args!("# a client's frame was lost: {}", report.code));
                    }
                }
            }
        }
        if self.service.port().session(0) != Session::Ready {
            // Nothing is told any more of frames before the loss.
            self.under_way.clear();
        }
        while let Some(held) = self.waiting.take().or_else(|| self.next_of_clients()) {
            if is_listening {
                continue;
            }
            match self.service.send(self.channel, &held.frame) {
                Ok(Some(ticket)) => {
                    self.under_way.insert(ticket, held);
                }
                Ok(None) => {
                    self.waiting = Some(held);
                    break;
                }
                // A client's mistake is no reason to leave the others alone.
                Err(error) => output.note(format_args!("# a client's frame was refused: {error}")),
            }
        }
        self.service.end(cycle)
    }

    fn next_of_clients(&self) -> Option<Held> {
        self.servers.iter().enumerate().find_map(|(server, it)| {
            it.next_for_bus().map(|(client, frame)| Held { server, client, frame })
        })
    }

    /// Hands a frame of the bus to all clients but the one that sent it.
    fn deliver(&self, frame: &CanFrame, time_ns: u64, sent: Option<Held>) {
        for (number, server) in self.servers.iter().enumerate() {
            let sender = sent.filter(|held| held.server == number);
            if sender.is_some() {
                server.count_sent();
            }
            server.deliver(frame, time_ns, sender.map(|held| held.client));
        }
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
