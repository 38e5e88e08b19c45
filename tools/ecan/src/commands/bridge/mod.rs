//! `ecan bridge`: a channel for other programs.

mod beacon;
mod endpoint;
mod in_flight;
mod round_robin;
mod transmit_gate;

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use clap::Args;
use ecan_bridge::{BridgeProtocol, BusRates, ClientId};
use ecan_mcan_port::{Received, Session};
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;

use crate::commands::bridge::beacon::Beacon;
use crate::commands::bridge::endpoint::{Address, Endpoint, Listening};
use crate::commands::bridge::in_flight::InFlight;
use crate::commands::bridge::round_robin::RoundRobin;
use crate::commands::bridge::transmit_gate::TransmitGate;
use crate::context::{Context, Failure, Output, Result, note};
use crate::frames::{
    Channels, FrameOptions, GatewayRequirements, Prepared, Service, channel_status, parse_channel,
    session,
};

pub const EXAMPLES: &str = "\
Examples:
  ecan bridge --bitrate 1000000                slcan on a free port, which is printed
  ecan bridge --channel 2 --slcan 3333 --socketcand 29536
  ecan bridge --pty /tmp/can0                  slcan on a pseudo-terminal, for example for slcand
  ecan bridge --channel 1 --socketcan vcan0    a CAN interface: candump vcan0, cansend vcan0 123#01
  ecan bridge --socketcand --beacon            SavvyCAN and python-can find the bridge
  python-can: can.Bus(interface=\"slcan\", channel=\"socket://127.0.0.1:3333\")
  python-can: can.Bus(interface=\"socketcand\", host=\"127.0.0.1\", port=29536, channel=\"can2\")

The bit rates come from the options, the file, or the gateway's configuration. A client that requests
other bit rates cannot send or receive. Frames are exchanged once per EtherCAT cycle.

Create a virtual CAN interface: modprobe vcan; ip link add dev vcan0 type vcan; ip link set vcan0 up";

#[derive(Debug, Args)]
pub struct BridgeArguments {
    /// CAN channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
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
    pty: Option<PathBuf>,
    /// Connect a CAN interface of this host, for example vcan0; CAN FD if its MTU is 72
    #[arg(long, value_name = "INTERFACE", value_parser = parse_interface)]
    socketcan: Option<String>,
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

fn parse_interface(text: &str) -> Result<String, String> {
    let is_possible = (1..=15).contains(&text.len())
        && text.bytes().all(|byte| byte.is_ascii_graphic() && !matches!(byte, b'/' | b':'));
    match is_possible {
        true => Ok(text.to_owned()),
        false => Err("expected the name of a network interface, for example vcan0".to_owned()),
    }
}

#[derive(Clone, Copy, Debug)]
struct PendingFrame {
    endpoint: usize,
    client: ClientId,
    frame: CanFrame,
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
        ..GatewayRequirements::on(Channels::only(arguments.channel))
    };
    let prepared = Prepared::new(&arguments.options, requirements, context)?;
    // Before the cycle: the threads of the servers must not inherit its real-time settings.
    let endpoints = listen(arguments)?;
    let mut gate = TransmitGate::closed(&endpoints);
    let Some(service) = prepared.enter()? else { return Ok(()) };
    if let Some(can) = service.can(arguments.channel) {
        let rates = match can.fd {
            true => BusRates::fd(can.nominal_bitrate, can.data_bitrate),
            false => BusRates::classic(can.nominal_bitrate),
        };
        endpoints.iter().for_each(|endpoint| endpoint.clients().set_bus(rates));
    }
    // Open before the addresses are printed: early clients are not rejected.
    gate.set_open(!arguments.listen_only, 0, &endpoints);
    announce(arguments.channel, &endpoints, &context.output)?;
    let _beacon = start_beacon(arguments, &endpoints)?;
    let moved_ns = service.now_ns();
    let mut bridge = Traffic {
        channel: arguments.channel,
        is_listening: arguments.listen_only,
        service,
        endpoints,
        in_flight: InFlight::default(),
        waiting: None,
        turns: RoundRobin::default(),
        gate,
        moved_ns,
    };
    let mut outcome = Ok(());
    while outcome.is_ok() && !bridge.service.is_interrupted() {
        outcome = bridge.cycle();
    }
    bridge.report_losses();
    outcome.and(bridge.service.finish())
}

fn listen(arguments: &BridgeArguments) -> Result<Vec<Endpoint>> {
    let has_another =
        arguments.socketcand.is_some() || arguments.pty.is_some() || arguments.socketcan.is_some();
    let slcan = arguments.slcan.or((!has_another).then_some(Listening::ANY));
    let mut endpoints = Vec::new();
    let protocols =
        [(BridgeProtocol::Slcan, slcan), (BridgeProtocol::Socketcand, arguments.socketcand)];
    for (protocol, at) in protocols {
        if let Some(at) = at {
            endpoints.push(Endpoint::listen(protocol, at, arguments.max_clients)?);
        }
    }
    if let Some(link) = &arguments.pty {
        endpoints.push(Endpoint::terminal(link)?);
    }
    if let Some(interface) = &arguments.socketcan {
        endpoints.push(Endpoint::interface(interface)?);
    }
    Ok(endpoints)
}

fn start_beacon(arguments: &BridgeArguments, endpoints: &[Endpoint]) -> Result<Option<Beacon>> {
    let server = endpoints.iter().find_map(Endpoint::socketcand_address);
    let Some((ip, server)) = arguments.beacon.zip(server) else { return Ok(None) };
    let to = SocketAddr::new(ip, beacon::PORT);
    let started = Beacon::start(to, server, arguments.channel);
    let failed = |error| Failure::Bridge(format!("cannot send a beacon to {to}: {error}"));
    started.map(Some).map_err(failed)
}

fn announce(channel: u8, endpoints: &[Endpoint], output: &Output) -> Result {
    let addresses: Vec<_> = endpoints.iter().map(|it| it.address(channel)).collect();
    for (endpoint, Address { address, .. }) in endpoints.iter().zip(&addresses) {
        if endpoint.is_open_to_others() {
            note(format_args!("every host that can connect to {address} can send on the bus"));
        }
    }
    output.data(&addresses, |out| {
        addresses.iter().try_for_each(|Address { protocol, address, channel }| {
            writeln!(out, "{protocol} bridge at {address} on can{channel}")
        })
    })
}

/// A bus without progress for this time, despite pending frames, has no acknowledging node.
const STALL_NS: u64 = 1_000_000_000;

#[derive(Debug)]
struct Traffic {
    channel: u8,
    is_listening: bool,
    service: Service,
    endpoints: Vec<Endpoint>,
    /// Client frames in the gateway.
    in_flight: InFlight<PendingFrame>,
    /// Frame that waits for space.
    waiting: Option<PendingFrame>,
    turns: RoundRobin,
    gate: TransmitGate,
    /// Time of the last accepted frame, or without pending frames.
    moved_ns: u64,
}

impl Traffic {
    fn cycle(&mut self) -> Result {
        let cycle = self.service.begin();
        for arrival in &cycle.arrivals {
            let time_ns = self.service.absolute_ns(arrival.time_ns);
            match &arrival.received {
                Received::Frame(received) => self.deliver(&received.frame, time_ns, None),
                Received::TransmitReport(report) => {
                    self.moved_ns = cycle.now_ns;
                    let held = report.ticket.and_then(|ticket| self.in_flight.remove(ticket));
                    let Some(held) = held else { continue };
                    if report.code.is_success() {
                        self.deliver(&held.frame, time_ns, Some(held));
                    } else {
                        note(format_args!("# client frame lost: {}", report.code));
                    }
                }
            }
        }
        let is_ready = session(self.service.port()) == Session::Ready;
        if !is_ready {
            // Results of frames before the loss never arrive.
            self.in_flight.clear();
        }
        let forgotten = self.in_flight.forget_old(cycle.now_ns);
        if forgotten > 0 {
            note(format_args!("# {forgotten} client frames: transmit result unknown"));
        }
        let status = channel_status(self.service.port(), self.channel);
        if self.waiting.is_none() && status.tx_pending() == 0 {
            self.moved_ns = cycle.now_ns;
        }
        let is_stalled = cycle.now_ns - self.moved_ns >= STALL_NS;
        let can_send = is_ready && !status.bus_off() && !is_stalled && !self.is_listening;
        let held = self.waiting.take_if(|_| !can_send);
        self.gate.set_open(can_send, held.iter().count(), &self.endpoints);
        while let Some(held) = self.waiting.take().or_else(|| self.next_of_clients()) {
            match self.service.send(self.channel, &held.frame) {
                Ok(Some(ticket)) => {
                    self.in_flight.insert(ticket, held, cycle.now_ns);
                }
                Ok(None) => {
                    self.waiting = Some(held);
                    break;
                }
                // An invalid frame of one client must not stop the others.
                Err(error) => note(format_args!("# client frame rejected: {error}")),
            }
        }
        self.service.end(cycle)?;
        self.endpoints.iter().try_for_each(Endpoint::check)
    }

    fn report_losses(&self) {
        for endpoint in &self.endpoints {
            let Address { protocol, address, .. } = endpoint.address(self.channel);
            for loss in endpoint.losses() {
                note(format_args!("# {protocol} bridge at {address}: {loss}"));
            }
        }
    }

    fn next_of_clients(&mut self) -> Option<PendingFrame> {
        self.turns.next(self.endpoints.len(), |endpoint| {
            let (client, frame) = self.endpoints.get(endpoint)?.clients().next_for_bus()?;
            Some(PendingFrame { endpoint, client, frame })
        })
    }

    /// Passes a frame from the bus to all clients except its sender.
    fn deliver(&self, frame: &CanFrame, time_ns: u64, sent: Option<PendingFrame>) {
        for (number, endpoint) in self.endpoints.iter().enumerate() {
            let sender = sent.filter(|held| held.endpoint == number);
            if sender.is_some() {
                endpoint.clients().count_sent();
            }
            endpoint.clients().deliver(frame, time_ns, sender.map(|held| held.client));
        }
    }
}
