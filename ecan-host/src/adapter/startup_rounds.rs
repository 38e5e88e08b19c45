//! Help for slaves that start: the master's own datagrams between two cycles, and clocks.

use ecan_protocol::device::AlState;
use ecrt_sys::Clock;

use super::cycle_clock::CycleClock;
use super::slave::Slave;
use crate::clocks::DistributedClocks;
use crate::master::{Master, RequestState};

/// Time from a send to a receive and from a receive to the next send, in nanoseconds. In between, the
/// master's thread evaluates a response and prepares the next datagram; without the pause after the
/// receive each step would take two sends.
const PAUSE_NS: u64 = 250_000;

/// ESC register speed counter start, and its default.
const SPEED_COUNTER: u16 = 0x0930;
const SPEED_COUNTER_START: u16 = 0x1000;
/// Longest wait for the writes, and the interval of looking, in nanoseconds.
const RESET_LIMIT_NS: u64 = 1_000_000_000;
const RESET_POLL_NS: u64 = 5_000_000;

/// When the master exchanges its own datagrams between two cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartupRounds {
    /// Only in the cycles.
    #[default]
    Off,
    /// While a slave is below SAFEOP or exchanges no process data: while the master reads an SDO
    /// dictionary it polls no states. Once all are in OP, the first SDO request must follow within the
    /// few sends in which the master polls the slaves; otherwise it begins to read the SDO dictionary,
    /// and executes no requests until that is done.
    UntilSafeOp,
    /// Always: requests are queued.
    On,
}

/// The master and its slaves between two cycles.
pub(super) struct RoundExchange<'a> {
    pub(super) master: &'a mut Master,
    pub(super) slaves: &'a [Slave],
    pub(super) clocks: Option<&'a mut DistributedClocks>,
    pub(super) cycle_clock: &'a CycleClock,
}

impl RoundExchange<'_> {
    /// Lets the master receive and send until the next cycle, while the slaves need it.
    pub(super) fn run(&mut self, clock: &dyn Clock, rounds: StartupRounds) {
        let end_ns =
            self.cycle_clock.next_deadline_ns().map(|deadline| deadline.saturating_sub(PAUSE_NS));
        // Each receive makes the master give up datagrams that were sent more than 500 us ago.
        let back_ns = self.cycle_clock.answered_ns();
        let pause = || {
            let next_ns = back_ns.max(clock.now_ns() + PAUSE_NS);
            let in_time = end_ns.is_some_and(|end_ns| next_ns <= end_ns);
            if in_time {
                clock.sleep_until_ns(next_ns);
            }
            in_time
        };
        // The next cycle reports what fails.
        while self.needs_round(rounds) && pause() {
            let _ = self.master.receive();
            if !pause() {
                return;
            }
            // It takes the place of the cycle's reading of the reference clock.
            if self.has_slave_below_safeop()
                && let Some(clocks) = &mut self.clocks
            {
                let _ = clocks.send_between_cycles(self.master, clock.now_ns());
            }
            let _ = self.master.send();
        }
    }

    fn needs_round(&self, rounds: StartupRounds) -> bool {
        let is_silent = |slave: &Slave| slave.report().working_counter == 0;
        match rounds {
            StartupRounds::Off => false,
            StartupRounds::UntilSafeOp => {
                self.slaves.iter().any(is_silent) || self.has_slave_below_safeop()
            }
            StartupRounds::On => true,
        }
    }

    fn has_slave_below_safeop(&self) -> bool {
        self.slaves.iter().any(|slave| {
            let state = self.master.config_state(slave.config());
            state.is_ok_and(|state| !state.online || state.al_state < AlState::SafeOp.raw())
        })
    }
}

/// Clears the filtered time difference (0x092C) of each slave by writing its speed counter start.
/// The difference outlasts a program whose host led the clocks. The master waits five seconds for it to
/// become small, although nothing changes it when the reference clock leads.
pub(super) fn reset_clock_differences(clock: &dyn Clock, master: &mut Master, slaves: &[Slave]) {
    let end_ns = clock.now_ns() + RESET_LIMIT_NS;
    for slave in slaves {
        let start = SPEED_COUNTER_START.to_le_bytes();
        // Without it the startup only lasts longer.
        let _ = master.requests().register_write(slave.al_control(), SPEED_COUNTER, &start);
    }
    let is_busy = |master: &mut Master, slave: &Slave| {
        matches!(master.requests().register_state(slave.al_control()), Ok(RequestState::Busy))
    };
    while slaves.iter().any(|slave| is_busy(master, slave)) && clock.now_ns() < end_ns {
        clock.sleep_until_ns(clock.now_ns() + RESET_POLL_NS);
    }
}
