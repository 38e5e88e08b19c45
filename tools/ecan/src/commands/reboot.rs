//! `ecan reboot`: restarts a gateway (0x8000:01, manual 13.3).

use clap::Args;
use ecan_host::Error;
use ecan_protocol::config::FilterWindow;
use ecan_tool_support::command_line::options::seconds;
use serde::Serialize;

use crate::context::{Bus, Context, Failure, Result};

/// Interval at which the state in the master is read, in ns.
const POLL_NS: u64 = 20_000_000;
/// Interval of SDO transfers, in ns. The library prints a line for each that fails.
const TRANSFER_NS: u64 = 500_000_000;
/// Time after which a gateway that shows no restart has not restarted, in ns.
const VANISH_NS: u64 = 5_000_000_000;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan reboot
  ecan reboot --wait           wait until it responds, and print its version

A running application loses the gateway during the restart. The gateway may restart before the master
has fetched its answer to the command: only the restart counts, not the answer.")]
pub struct RebootArguments {
    /// Wait until the gateway responds again
    #[arg(long)]
    wait: bool,
    /// Time limit of --wait
    #[arg(long, value_name = "TIME", default_value = "30s", requires = "wait", value_parser = seconds::<u16>(0..=65_535))]
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
    let mut is_answered = true;
    if arguments.wait {
        let took_ns = restart(&bus, slave, u64::from(arguments.timeout) * 1_000_000_000)?;
        restarted.is_back = true;
        restarted.after_ms = Some(took_ns / 1_000_000);
        restarted.firmware = bus.text(slave, 0x100A).ok();
    } else {
        is_answered = command(&bus, slave)?;
    }
    context.output.data(&restarted, |out| match (&restarted.firmware, restarted.after_ms) {
        (Some(firmware), Some(ms)) => {
            writeln!(out, "slave {slave}: restarted in {ms} ms, firmware {firmware}")
        }
        (None, Some(ms)) => {
            writeln!(out, "slave {slave}: restarted in {ms} ms, firmware version (0x100A) not read")
        }
        (_, None) if is_answered => writeln!(out, "slave {slave}: restarting"),
        (_, None) => writeln!(
            out,
            "slave {slave}: no answer to the command, which a restart explains; check with `ecan scan`"
        ),
    })
}

/// Sends the command; returns whether it was answered. The restart may come first.
fn command(bus: &Bus, slave: usize) -> Result<bool> {
    match bus.diagnostics().sdo_download_once(slave, 0x8000, 1, &[1]) {
        Ok(()) => Ok(true),
        Err(Error::Sdo { abort_code: None, .. }) => Ok(false),
        Err(error) => Err(Failure::Device(error)),
    }
}

/// A value that a restart resets: the index of a filter editing window, which has no other effect
/// (manual 13.4).
struct RestartMark {
    before: u32,
    written: u32,
}

impl RestartMark {
    const INDEX: u16 = 0x8001;
    const SUBINDEX: u8 = FilterWindow::STANDARD.index;

    /// Sets the mark; `None` if the gateway rejects it.
    fn set(bus: &Bus, slave: usize) -> Option<Self> {
        let before = bus.read(slave, Self::INDEX, Self::SUBINDEX).ok()?;
        let written = if before == 1 { 2 } else { 1 };
        bus.write(slave, Self::INDEX, Self::SUBINDEX, written).ok()?;
        Some(Self { before, written })
    }

    fn is_reset(&self, bus: &Bus, slave: usize) -> Result<bool> {
        Ok(bus.read(slave, Self::INDEX, Self::SUBINDEX)? != self.written)
    }

    fn undo(&self, bus: &Bus, slave: usize) {
        let _ = bus.write(slave, Self::INDEX, Self::SUBINDEX, self.before);
    }
}

/// Restarts a gateway and waits until it responds again; returns the duration in ns.
///
/// The gateway has restarted if it left the bus, or if it has lost what was written before: the
/// master may see it only when it is back.
pub fn restart(bus: &Bus, slave: usize, timeout_ns: u64) -> Result<u64> {
    let mark = RestartMark::set(bus, slave);
    let clock = bus.clock();
    let start = clock.now_ns();
    let elapsed = || clock.now_ns().saturating_sub(start);
    let is_answered = command(bus, slave).inspect_err(|_| {
        if let Some(mark) = &mark {
            mark.undo(bus, slave);
        }
    })?;
    let seconds = timeout_ns / 1_000_000_000;
    let mut next_transfer_ns = TRANSFER_NS;
    while is_there(bus, slave) {
        if elapsed() >= next_transfer_ns {
            next_transfer_ns = elapsed() + TRANSFER_NS;
            let is_reset = mark.as_ref().map(|mark| mark.is_reset(bus, slave));
            if matches!(is_reset, Some(Ok(true))) {
                break;
            }
        }
        let answer = if is_answered { "accepted" } else { "did not answer" };
        if elapsed() >= VANISH_NS {
            if let Some(mark) = mark {
                mark.undo(bus, slave);
            }
            let text = format!(
                "slave {slave} {answer} the command and did not restart (by 0x8001:43, assumption H39)"
            );
            return Err(Failure::Rejected(text));
        }
        if elapsed() >= timeout_ns {
            return Err(Failure::Slave(format!(
                "slave {slave} is still on the bus after {seconds} s; it {answer} the command and may \
                 still restart"
            )));
        }
        bus.sleep_ns(POLL_NS);
    }
    next_transfer_ns = 0;
    loop {
        if is_there(bus, slave) && elapsed() >= next_transfer_ns {
            match bus.read(slave, 0xF000, 5) {
                Ok(_) => return Ok(elapsed()),
                Err(Failure::Device(error)) if error.is_missing_object() => return Ok(elapsed()),
                Err(_) => {}
            }
            next_transfer_ns = elapsed() + TRANSFER_NS;
        }
        if elapsed() >= timeout_ns {
            return Err(Failure::Slave(format!(
                "slave {slave} does not respond {seconds} s after the restart; check its LEDs and its \
                 supply"
            )));
        }
        bus.sleep_ns(POLL_NS);
    }
}

/// Returns whether the master sees the slave in a state with mailbox.
fn is_there(bus: &Bus, slave: usize) -> bool {
    let state = bus.diagnostics().al_state(slave);
    state.is_ok_and(|state| state.is_some_and(|state| state.has_mailbox()))
}

#[cfg(test)]
mod tests {
    use ecan_sim::{ClockKind, Fault, GatewayFault, SimOptions};

    use super::*;

    #[test]
    fn rejected_command_leaves_the_filter_window() {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let bus = Bus::over(&backend.ecrt);
        let window = |bus: &Bus| bus.read(0, RestartMark::INDEX, RestartMark::SUBINDEX).unwrap();
        bus.write(0, RestartMark::INDEX, RestartMark::SUBINDEX, 5).unwrap();
        let abort =
            GatewayFault::SdoAbort { index: 0x8000, subindex: 1, code: 0x0800_0022, times: 1 };
        backend.simulation.unwrap().inject(Fault::Gateway { gateway: 0, fault: abort });
        let error = restart(&bus, 0, 10_000_000_000).unwrap_err().to_string();
        assert!(error.contains("0x08000022"), "{error}");
        assert_eq!(window(&bus), 5);
    }
}
