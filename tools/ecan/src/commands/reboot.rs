//! `ecan reboot`: restarts a gateway (0x8000:01, manual 13.3).

use clap::Args;
use serde::Serialize;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;

/// Time between two looks, ns.
const LOOK_NS: u64 = 20_000_000;
/// A gateway that did not vanish in this time did not restart, ns.
const VANISH_NS: u64 = 5_000_000_000;

/// How to restart.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan reboot
  ecan reboot --wait           wait until it is back, and print its version

An application that drives the bus loses the gateway meanwhile.")]
pub struct RebootArguments {
    /// Wait until the gateway is back and answers
    #[arg(long)]
    wait: bool,
    /// How long to wait, in seconds
    #[arg(long, value_name = "S", default_value_t = 30, requires = "wait")]
    timeout: u16,
}

/// What came back.
#[derive(Debug, Serialize)]
struct Restarted {
    position: usize,
    is_back: bool,
    firmware: Option<String>,
    after_ms: Option<u64>,
}

pub fn run(
    arguments: &RebootArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let bus = Bus::open(global, output)?;
    let slave = bus.slave()?;
    let mut restarted =
        Restarted { position: slave, is_back: false, firmware: None, after_ms: None };
    if arguments.wait {
        let took_ns = restart(&bus, slave, u64::from(arguments.timeout) * 1_000_000_000)?;
        restarted.is_back = true;
        restarted.after_ms = Some(took_ns / 1_000_000);
        restarted.firmware = bus.text(slave, 0x100A).ok();
    } else {
        command(&bus, slave)?;
    }
    output.data(&restarted, |out| match (&restarted.firmware, restarted.after_ms) {
        (Some(firmware), Some(ms)) => {
            writeln!(out, "slave {slave} is back after {ms} ms with firmware {firmware}")
        }
        (None, Some(ms)) => {
            writeln!(out, "slave {slave} is back after {ms} ms; 0x100A, its version, is not read")
        }
        (_, None) => writeln!(out, "slave {slave} restarts"),
    })
}

fn command(bus: &Bus, slave: usize) -> Result<(), Failure> {
    bus.write(slave, 0x8000, 1, 1)
}

/// Restarts a gateway and waits until it is back and answers; tells how long that took, ns.
pub fn restart(bus: &Bus, slave: usize, timeout_ns: u64) -> Result<u64, Failure> {
    command(bus, slave)?;
    wait(bus, slave, timeout_ns)
}

/// Waits until the gateway has gone and come back; tells how long that took, ns.
fn wait(bus: &Bus, slave: usize, timeout_ns: u64) -> Result<u64, Failure> {
    let clock = bus.clock();
    let start = clock.now_ns();
    let elapsed = || clock.now_ns().saturating_sub(start);
    let look_again = || clock.sleep_until_ns(clock.now_ns().saturating_add(LOOK_NS));
    let seconds = timeout_ns / 1_000_000_000;
    while is_there(bus, slave) {
        if elapsed() >= VANISH_NS {
            let words = "took the command but did not restart; it is still on the bus";
            return Err(Failure::Refused(format!("slave {slave} {words}")));
        }
        if elapsed() >= timeout_ns {
            let words = format!("slave {slave} is still on the bus after {seconds} s");
            return Err(Failure::Slave(format!(
                "{words}; it took the command, and may restart yet"
            )));
        }
        look_again();
    }
    while !is_there(bus, slave) || bus.read(slave, 0xF000, 5).is_err() {
        if elapsed() >= timeout_ns {
            let words = format!("slave {slave} is not back after {seconds} s");
            return Err(Failure::Slave(format!("{words}; look at its lamps and its supply")));
        }
        look_again();
    }
    Ok(elapsed())
}

/// Whether the master sees the slave with a mailbox.
fn is_there(bus: &Bus, slave: usize) -> bool {
    let state = bus.diagnostics().al_state(slave);
    state.is_ok_and(|state| state.is_some_and(|state| state.has_mailbox()))
}
