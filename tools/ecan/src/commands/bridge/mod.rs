//! `ecan bridge`: channels for other programs.

mod endpoint;
mod lane;

use std::collections::HashSet;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;
use std::{io, thread};

use clap::Args;
use ecan_can_io::bridge::{BridgeProtocol, BusRates};
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::mapping::Direction;
use endpoint::{Address, Endpoint, LaneId, Listening, NameTemplate, parse_interface};
use lane::{Lane, Traffic};

use crate::context::{Context, Failure, Output, Result, note};
use crate::frames::{Channels, FrameOptions, GatewayRequirements, Prepared};

pub const EXAMPLES: &str = "\
Examples:
  ecan bridge --bitrate 1M                     slcan on a free port, which is printed
  ecan bridge --channel 2 --slcan 3333 --socketcand 29536
  ecan bridge --pty /tmp/can0                  slcan on a pseudo-terminal, for example for slcand
  ecan bridge --channel 1 --socketcan vcan0    a CAN interface: candump vcan0, cansend vcan0 123#01
  ecan bridge --channel all --socketcan can%c  can0 to can3, created if they do not exist
  ecan bridge --all --channel all --socketcan can%g%c
  ecan bridge --socketcand --beacon            SavvyCAN and python-can find the bridge
  python-can: can.Bus(interface=\"slcan\", channel=\"socket://127.0.0.1:3333\")
  python-can: can.Bus(interface=\"socketcand\", host=\"127.0.0.1\", port=29536, channel=\"can2\")

The bit rates come from the options, the file, or the gateway's configuration. A client that requests
other bit rates cannot send or receive. Frames are exchanged once per EtherCAT cycle.

With several channels, TCP ports count up from PORT, and %c in LINK and INTERFACE is the channel (%g the
index of the gateway). A CAN interface that does not exist is created, which requires CAP_NET_ADMIN, and
removed at the end: modprobe vcan; ip link add dev can0 mtu 72 type vcan; ip link set can0 up";

#[derive(Debug, Args)]
pub struct BridgeArguments {
    /// CAN channels, 0 to 3, comma-separated, or all
    #[arg(long, value_name = "CHANNELS", default_value = "0")]
    channel: Channels,
    /// Serve every gateway of the file or bus
    #[arg(long, conflicts_with = "slave")]
    all: bool,
    /// Serve slcan over TCP at PORT, IP or IP:PORT [default: 127.0.0.1, free port]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "0")]
    slcan: Option<Listening>,
    /// Serve socketcand over TCP, classic CAN frames only
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "0")]
    socketcand: Option<Listening>,
    /// Announce socketcand by beacon (UDP port 42000) to this address [default: 127.0.0.1]
    #[arg(long, value_name = "IP", num_args = 0..=1, default_missing_value = "127.0.0.1",
          requires = "socketcand")]
    beacon: Option<IpAddr>,
    /// Serve slcan on a pseudo-terminal with the symbolic link LINK
    #[arg(long, value_name = "LINK", num_args = 0..=1, default_missing_value = "")]
    pty: Option<NameTemplate>,
    /// Connect a CAN interface of this host, for example vcan0 or can%c
    #[arg(long, value_name = "INTERFACE", value_parser = parse_interface)]
    socketcan: Option<NameTemplate>,
    /// Maximum number of TCP clients, slcan and socketcand
    #[arg(long, value_name = "COUNT", default_value_t = 8,
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    max_clients: u16,
    /// Listen without acknowledging; frames of clients are rejected
    #[arg(long)]
    listen_only: bool,
    #[command(flatten)]
    options: FrameOptions,
}

pub fn run(arguments: &BridgeArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let requirements = GatewayRequirements {
        directions: match arguments.listen_only {
            true => &[Direction::TxPdo],
            false => &Direction::ALL,
        },
        is_listening: arguments.listen_only,
        has_results: true,
        has_end: false,
        ..GatewayRequirements::on(arguments.channel)
    };
    let prepared = match arguments.all {
        true => Prepared::for_all(&arguments.options, requirements, context)?,
        false => Prepared::new(&arguments.options, requirements, context)?,
    };
    // Before the cycle: the threads of the servers must not inherit its real-time settings.
    let mut lanes = listen(arguments, &prepared)?;
    let Some(service) = prepared.enter()? else { return Ok(()) };
    // Open before the addresses are printed: early clients are not rejected.
    for lane in &mut lanes {
        lane.start();
    }
    announce(&lanes, &context.output)?;
    let _beacons = start_beacons(arguments, &lanes)?;
    Traffic::new(service, lanes).run()
}

/// Creates the endpoints of each channel.
fn listen(arguments: &BridgeArguments, prepared: &Prepared<'_>) -> Result<Vec<Lane>> {
    let has_another =
        arguments.socketcand.is_some() || arguments.pty.is_some() || arguments.socketcan.is_some();
    let slcan = arguments.slcan.or((!has_another).then_some(Listening::ANY));
    let protocols =
        [(BridgeProtocol::Slcan, slcan), (BridgeProtocol::Socketcand, arguments.socketcand)];
    let gateways = 0..prepared.gateways();
    let channels = gateways
        .flat_map(|gateway| arguments.channel.iter().map(move |channel| (gateway, channel)));
    let channels: Vec<_> = channels
        .filter_map(|(gateway, channel)| {
            Some((LaneId { gateway, channel }, prepared.can(gateway, channel)?))
        })
        .collect();
    let names = |template: &Option<NameTemplate>, option| {
        let names = template.iter().filter(|template| !template.is_empty());
        let names: Vec<_> =
            names.flat_map(|name| channels.iter().map(|(id, _)| name.name(*id))).collect();
        let distinct: HashSet<_> = names.iter().collect();
        match distinct.len() == names.len() {
            true => Ok(()),
            false => Err(Failure::Usage(format!(
                "{option}: several channels need several names; use %c for the channel, and %g for \
                 the index of the gateway with --all"
            ))),
        }
    };
    names(&arguments.pty, "--pty")?;
    names(&arguments.socketcan, "--socketcan")?;
    let mut lanes = Vec::new();
    for (index, (id, can)) in (0..).zip(&channels) {
        let mut endpoints = Vec::new();
        for (protocol, at) in protocols {
            if let Some(at) = at {
                let at = at.following(index)?;
                endpoints.push(Endpoint::listen(protocol, at, *id, arguments.max_clients)?);
            }
        }
        if let Some(link) = &arguments.pty {
            endpoints.push(Endpoint::terminal(Path::new(&link.name(*id)))?);
        }
        if let Some(interface) = &arguments.socketcan {
            endpoints.push(Endpoint::interface(&interface.name(*id))?);
        }
        endpoints.iter().for_each(|endpoint| endpoint.clients().set_bus(rates(can)));
        lanes.push(Lane::new(*id, endpoints, arguments.listen_only));
    }
    Ok(lanes)
}

fn rates(can: &McanChannelConfig) -> BusRates {
    match can.fd {
        true => BusRates::fd(can.nominal_bitrate, can.data_bitrate),
        false => BusRates::classic(can.nominal_bitrate),
    }
}

fn start_beacons(arguments: &BridgeArguments, lanes: &[Lane]) -> Result<Vec<Beacon>> {
    let Some(ip) = arguments.beacon else { return Ok(Vec::new()) };
    let to = SocketAddr::new(ip, BEACON_PORT);
    let failed = |error| Failure::Bridge(format!("cannot send a beacon to {to}: {error}"));
    let servers = lanes.iter().filter_map(|lane| {
        let server = lane.endpoints().iter().find_map(Endpoint::socketcand_address)?;
        Some((lane.id.channel, server))
    });
    servers.map(|(channel, server)| Beacon::start(to, server, channel).map_err(failed)).collect()
}

fn announce(lanes: &[Lane], output: &Output) -> Result {
    let addresses: Vec<_> = lanes.iter().flat_map(Lane::addresses).collect();
    let endpoints = lanes.iter().flat_map(Lane::endpoints);
    for (endpoint, Address { address, .. }) in endpoints.zip(&addresses) {
        if endpoint.is_open_to_others() {
            note(format_args!("every host that can connect to {address} can send on the bus"));
        }
    }
    output.data(&addresses, |out| {
        addresses.iter().try_for_each(|Address { protocol, address, lane }| {
            writeln!(out, "{protocol} bridge at {address} on {lane}")
        })
    })
}

/// UDP port of the beacon in the protocol.
const BEACON_PORT: u16 = 42_000;
/// Period. The protocol allows three seconds; python-can listens for little more.
const BEACON_INTERVAL: Duration = Duration::from_secs(1);

/// Sends the beacon periodically until dropped.
#[derive(Debug)]
struct Beacon {
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
        let text = beacon_text(SocketAddr::new(ip, server.port()), can);
        let (stop, stopped) = channel::<()>();
        thread::Builder::new().name("bridge beacon".to_owned()).spawn(move || {
            loop {
                // Errors are ignored: no receiver, or no network at the moment.
                let _ = socket.send(text.as_bytes());
                if stopped.recv_timeout(BEACON_INTERVAL) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        })?;
        Ok(Self { _stop: stop })
    }
}

fn beacon_text(server: SocketAddr, channel: u8) -> String {
    format!(
        "<CANBeacon name=\"ecan\" type=\"adapter\" description=\"ECAN-Lite\">\n\
         <URL>can://{server}</URL><Bus name=\"can{channel}\"/></CANBeacon>"
    )
}
