//! `ecan bridge`: a channel for other programs.

mod front;

use std::collections::HashMap;
use std::path::PathBuf;

use clap::Args;
use ecan_bridge::{BridgeProtocol, BusRates, ClientId};
use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{Received, SendTicket, Session};
use ecan_protocol::CanFrame;

use crate::commands::bridge::front::{Front, Listening, Place};
use crate::failure::Failure;
use crate::frames::channels::{Channels, parse_channel};
use crate::frames::options::FrameOptions;
use crate::frames::service::Service;
use crate::frames::settings::{Settings, Wishes};
use crate::global::GlobalOptions;
use crate::output::Output;

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan bridge --bitrate 1000000                slcan on a free port, which is printed
  ecan bridge --channel 2 --slcan 3333 --socketcand 29536
  ecan bridge --pty /tmp/can0                  slcan on a terminal, for slcand and the like
  ecan bridge --channel 1 --socketcan vcan0    a CAN interface: candump vcan0, cansend vcan0 123#01
  python-can: can.Bus(interface=\"slcan\", channel=\"socket://127.0.0.1:3333\")
  python-can: can.Bus(interface=\"socketcand\", host=\"127.0.0.1\", port=29536, channel=\"can2\")

The bit rates of the channel are those of the options or of the file: a client that names others hears nothing and
cannot send. Frames go through once per EtherCAT cycle.

A virtual CAN interface: modprobe vcan; ip link add dev vcan0 type vcan; ip link set vcan0 up";

/// Arguments of `bridge`.
#[derive(Debug, Args)]
pub struct BridgeArguments {
    /// Channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
    /// Speak slcan over TCP: a port, an address or both; 127.0.0.1 and a free port otherwise.
    /// The default where no other way in is chosen
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "0")]
    slcan: Option<Listening>,
    /// Speak socketcand over TCP: classic CAN data frames
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "0")]
    socketcand: Option<Listening>,
    /// Speak slcan on a pseudo-terminal, as a serial adapter does; LINK becomes a link to it
    #[arg(long, value_name = "LINK", num_args = 0..=1, default_missing_value = "")]
    pty: Option<PathBuf>,
    /// Couple a CAN interface of this host, virtual or real, as vcan0; CAN FD where its MTU is 72
    #[arg(long, value_name = "INTERFACE", value_parser = parse_interface)]
    socketcan: Option<String>,
    /// Clients at a time, of slcan and socketcand over TCP
    #[arg(long, value_name = "COUNT", default_value_t = 8,
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    max_clients: u16,
    /// Listen without acknowledging; what clients send is not sent
    #[arg(long)]
    listen_only: bool,
    #[command(flatten)]
    options: FrameOptions,
}

/// A name that an interface can have.
fn parse_interface(text: &str) -> Result<String, String> {
    let is_possible = (1..=15).contains(&text.len())
        && text.bytes().all(|byte| byte.is_ascii_graphic() && !matches!(byte, b'/' | b':'));
    match is_possible {
        true => Ok(text.to_owned()),
        false => Err("expected the name of a network interface, as vcan0".to_owned()),
    }
}

/// A frame of a client.
#[derive(Clone, Copy, Debug)]
struct Held {
    front: usize,
    client: ClientId,
    frame: CanFrame,
}

pub fn run(
    arguments: &BridgeArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let settings = Settings::of(&arguments.options.gateway)?;
    let interrupt = Interrupt::install().map_err(|error| Failure::Master(error.to_string()))?;
    // Before the gateway: the servers' threads keep out of what the cycle's thread asks for.
    let fronts = listen(arguments)?;
    let wishes = Wishes {
        is_listening: arguments.listen_only,
        has_results: true,
        has_end: false,
        ..Wishes::on(Channels::only(arguments.channel))
    };
    let capture = &arguments.options.capture;
    let opened = Service::open(&settings, capture, wishes, &interrupt, global, output)?;
    let Some(service) = opened else { return Ok(()) };
    if let Some(can) = service.can(arguments.channel) {
        let rates = match can.fd {
            true => BusRates::fd(can.nominal_bitrate, can.data_bitrate),
            false => BusRates::classic(can.nominal_bitrate),
        };
        fronts.iter().for_each(|front| front.clients().set_bus(rates));
    }
    announce(arguments.channel, &fronts, output)?;
    let mut bridge = Traffic {
        channel: arguments.channel,
        service,
        fronts,
        under_way: HashMap::with_capacity(4096),
        waiting: None,
    };
    let mut outcome = Ok(());
    while outcome.is_ok() && !interrupt.is_set() {
        outcome = bridge.cycle(arguments.listen_only, output);
    }
    bridge.tell_losses(output);
    outcome.and(bridge.service.finish_capture())
}

/// Starts the servers.
fn listen(arguments: &BridgeArguments) -> Result<Vec<Front>, Failure> {
    let has_another =
        arguments.socketcand.is_some() || arguments.pty.is_some() || arguments.socketcan.is_some();
    let slcan = arguments.slcan.or((!has_another).then_some(Listening::ANY));
    let mut fronts = Vec::new();
    let wanted =
        [(BridgeProtocol::Slcan, slcan), (BridgeProtocol::Socketcand, arguments.socketcand)];
    for (protocol, at) in wanted {
        if let Some(at) = at {
            fronts.push(Front::listen(protocol, at, arguments.max_clients)?);
        }
    }
    if let Some(link) = &arguments.pty {
        fronts.push(Front::terminal(link)?);
    }
    if let Some(interface) = &arguments.socketcan {
        fronts.push(Front::interface(interface)?);
    }
    Ok(fronts)
}

/// Tells where the servers are.
fn announce(channel: u8, fronts: &[Front], output: &Output) -> Result<(), Failure> {
    let places: Vec<_> = fronts.iter().map(|front| front.place(channel)).collect();
    for (front, place) in fronts.iter().zip(&places) {
        if front.is_open_to_others() {
            output.note(format_args!("whoever reaches {} can send on the bus", place.address));
        }
    }
    output.data(&places, |out| {
        places.iter().try_for_each(|Place { protocol, address, channel }| {
            writeln!(out, "{protocol} bridge at {address} on can{channel}")
        })
    })
}

/// Frames between the bus and the clients.
#[derive(Debug)]
struct Traffic {
    channel: u8,
    service: Service,
    fronts: Vec<Front>,
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
        self.service.end(cycle)?;
        self.fronts.iter().try_for_each(Front::check)
    }

    /// Says what did not go through, where there is anything.
    fn tell_losses(&self, output: &Output) {
        for front in &self.fronts {
            let Place { protocol, address, .. } = front.place(self.channel);
            for loss in front.losses() {
                output.note(format_args!("# {protocol} bridge at {address}: {loss}"));
            }
        }
    }

    fn next_of_clients(&self) -> Option<Held> {
        self.fronts.iter().enumerate().find_map(|(front, it)| {
            it.clients().next_for_bus().map(|(client, frame)| Held { front, client, frame })
        })
    }

    /// Hands a frame of the bus to all clients but the one that sent it.
    fn deliver(&self, frame: &CanFrame, time_ns: u64, sent: Option<Held>) {
        for (number, front) in self.fronts.iter().enumerate() {
            let sender = sent.filter(|held| held.front == number);
            if sender.is_some() {
                front.clients().count_sent();
            }
            front.clients().deliver(frame, time_ns, sender.map(|held| held.client));
        }
    }
}
