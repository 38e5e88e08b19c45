//! `ecan-sim wire`: simulated gateways on a network interface.

use ecan_host::{Clock, MonotonicClock};
use ecan_protocol::text::Printable;
use ecan_sim::{ClockKind, Scenario, ScenarioChoice, SimOptions, Wire, load_scenario};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file::is_standard_stream;
use nix::sys::prctl::set_timerslack;

use crate::failure::{Failure, Screen};
use crate::packet_socket::{Interface, PacketSocket};
use crate::report::real_time_ns;
use crate::server::{Dump, Server, WireArguments};

pub fn run(arguments: &WireArguments) -> Result<(), Failure> {
    let screen = match &arguments.dump {
        Some(path) if is_standard_stream(path) => Screen::OutputIsData,
        _ => Screen::Output,
    };
    let scenario = scenario(arguments, screen)?;
    let socket = PacketSocket::open(Interface::find(&arguments.interface)?)?;
    let start_ns = MonotonicClock.now_ns();
    let offset_ns = real_time_ns().saturating_sub(start_ns);
    let dump = arguments.dump.as_ref().map(|path| Dump::create(path, offset_ns)).transpose()?;
    let mut wire = Wire::with_bridges(&scenario, start_ns, Some(ecan_sim::bridge::make))?;
    if dump.is_some() {
        wire.world_mut().record_all_buses();
    }
    // The threads for signals and bridges must not inherit the privileges of this thread.
    let interrupt = Interrupt::install()?;
    announce(&scenario, &wire, &socket, screen);
    let mut server = Server::new(wire, socket, dump, arguments, screen, start_ns);
    let report = arguments.thread.settings().apply()?;
    for outcome in &report.outcomes {
        screen.line(outcome);
    }
    // Without it the system may delay each timer by 50 us; real-time threads have no such delay.
    let _ = set_timerslack(1);
    let outcome = server.serve(&interrupt);
    // Print the counters also after an error.
    let finished = server.finish();
    outcome?;
    Ok(finished?)
}

fn scenario(arguments: &WireArguments, screen: Screen) -> Result<Scenario, Failure> {
    let options = SimOptions {
        seed: arguments.seed,
        gateways: vec![0; arguments.gateways.map_or(0, usize::from)],
        ..SimOptions::default()
    };
    // Not parsed by clap: a wrong scenario has the status of a wrong file.
    let choice = ScenarioChoice::parse(&arguments.scenario)?;
    let mut scenario = load_scenario(&choice, &options)?;
    for gateway in &mut scenario.gateways {
        gateway.sii_pdos |= arguments.sii_pdos;
        // the distance of frames varies by more than on a wire
        let is_built_in = !matches!(choice, ScenarioChoice::File(_));
        gateway.config.publishes_after_read |= is_built_in;
    }
    if let ScenarioChoice::File(path) = &choice {
        let file = Printable(path.display());
        let count = scenario.gateways.len();
        if count == 0 {
            return Err(Failure::NoGateway(path.clone()));
        }
        if let Some(asked) = arguments.gateways.filter(|asked| usize::from(*asked) != count) {
            screen.line(format_args!(
                "--gateways {asked} is ignored: {file} has {}",
                counted(count, "gateway")
            ));
        }
        if scenario.clock == Some(ClockKind::Stepped) {
            screen.line(format_args!("the clock of {file} is ignored: a wire runs in real time"));
        }
    }
    Ok(scenario)
}

fn announce(scenario: &Scenario, wire: &Wire, socket: &PacketSocket, screen: Screen) {
    let bridges = wire.world().node_descriptions();
    let interface = &socket.interface;
    screen.line(format_args!(
        "SIMULATED: no gateway, no CAN bus is real. Scenario {}: {}, {}, on interface {}, seed {}{bridges}",
        scenario.name,
        counted(scenario.gateways.len(), "gateway"),
        counted(scenario.nodes.len(), "node"),
        interface.name,
        scenario.seed,
    ));
    if !interface.has_link {
        screen.line(format_args!("{} has no link; check that the other end is up", interface.name));
    }
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}
