//! `ecan reboot`: restarts a gateway (0x8000:01, manual 13.3).

use clap::Args;
use serde::Serialize;

use crate::context::{Bus, Context, Failure, Result};

const POLL_NS: u64 = 20_000_000;
/// Time after which a gateway that is still on the bus has not restarted, in ns.
const VANISH_NS: u64 = 5_000_000_000;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan reboot
  ecan reboot --wait           wait until it responds, and print its version

A running application loses the gateway during the restart.")]
pub struct RebootArguments {
    /// Wait until the gateway responds again
    #[arg(long)]
    wait: bool,
    /// Time limit of --wait, in s
    #[arg(long, value_name = "S", default_value_t = 30, requires = "wait")]
    timeout: u16,
}

#[derive(Debug, Serialize)]
struct Restarted {
    position: usize,
    is_back: bool,
    firmware: Option<String>,
    after_ms: Option<u64>,
}

pub fn run(arguments: &RebootArguments, context: &Context) -> Result {
    let bus = context.bus()?;
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
    context.output.data(&restarted, |out| match (&restarted.firmware, restarted.after_ms) {
        (Some(firmware), Some(ms)) => {
            writeln!(out, "slave {slave}: restarted in {ms} ms, firmware {firmware}")
        }
        (None, Some(ms)) => {
            writeln!(out, "slave {slave}: restarted in {ms} ms, firmware version (0x100A) not read")
        }
        (_, None) => writeln!(out, "slave {slave}: restarting"),
    })
}

fn command(bus: &Bus, slave: usize) -> Result {
    bus.write(slave, 0x8000, 1, 1)
}

/// Restarts a gateway and waits until it has left the bus and responds again; returns the duration
/// in ns.
pub fn restart(bus: &Bus, slave: usize, timeout_ns: u64) -> Result<u64> {
    command(bus, slave)?;
    let clock = bus.clock();
    let start = clock.now_ns();
    let elapsed = || clock.now_ns().saturating_sub(start);
    let seconds = timeout_ns / 1_000_000_000;
    while is_there(bus, slave) {
        if elapsed() >= VANISH_NS {
            let text = format!("slave {slave} accepted the command but did not restart");
            return Err(Failure::Rejected(text));
        }
        if elapsed() >= timeout_ns {
            return Err(Failure::Slave(format!(
                "slave {slave} is still on the bus after {seconds} s; it accepted the command and may \
                 still restart"
            )));
        }
        bus.sleep_ns(POLL_NS);
    }
    while !is_there(bus, slave) || bus.read(slave, 0xF000, 5).is_err() {
        if elapsed() >= timeout_ns {
            return Err(Failure::Slave(format!(
                "slave {slave} does not respond {seconds} s after the restart; check its LEDs and its \
                 supply"
            )));
        }
        bus.sleep_ns(POLL_NS);
    }
    Ok(elapsed())
}

/// Returns whether the master sees the slave in a state with mailbox.
fn is_there(bus: &Bus, slave: usize) -> bool {
    let state = bus.diagnostics().al_state(slave);
    state.is_ok_and(|state| state.is_some_and(|state| state.has_mailbox()))
}
