//! Help for slaves that start: the master's own datagrams between two cycles, and clocks.

use ecan_protocol::device::AlState;

use super::{Adapter, Slave};
use crate::master::{Master, RequestState};
use crate::phase::Phase;

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

impl Adapter {
    /// Speeds up slaves that start: [`wait_next_cycle`](Self::wait_next_cycle) then lets the master
    /// receive and send every half millisecond, without process data. Otherwise each step of a scan
    /// and of an SDO transfer takes two cycles. [`wait_op`](Self::wait_op) and the layers above set
    /// this. Without effect on an attached Adapter. Real-time safe.
    pub fn set_startup_rounds(&mut self, rounds: StartupRounds) {
        self.startup_rounds = rounds;
    }

    pub(super) fn exchange_startup_rounds(&mut self) {
        if self.attached || self.phase != Phase::Active || self.is_leaving_op {
            return;
        }
        let clock = self.ecrt.clock().clone();
        let end_ns =
            self.cycle_timer.next_deadline_ns().map(|deadline| deadline.saturating_sub(PAUSE_NS));
        // Each receive makes the master give up datagrams that were sent more than 500 us ago.
        let back_ns = self.sent_ns + self.response_ns;
        let pause = || {
            let next_ns = back_ns.max(clock.now_ns() + PAUSE_NS);
            let in_time = end_ns.is_some_and(|end_ns| next_ns <= end_ns);
            if in_time {
                clock.sleep_until_ns(next_ns);
            }
            in_time
        };
        // The next cycle reports what fails.
        while self.needs_startup_round() && pause() {
            let _ = self.master.receive();
            if !pause() {
                return;
            }
            // It takes the place of the cycle's reading of the reference clock.
            if self.has_slave_below_safeop()
                && let Some(clocks) = &mut self.clocks
            {
                let _ = clocks.send_between_cycles(&mut self.master, clock.now_ns());
            }
            let _ = self.master.send();
        }
    }

    /// Clears the filtered time difference (0x092C) of each slave by writing its speed counter start.
    /// It outlasts a program whose host led the clocks, and the master waits five seconds for it to
    /// become small, although nothing changes it when the reference clock leads.
    pub(super) fn reset_clock_differences(&mut self) {
        let clock = self.ecrt.clock().clone();
        let end_ns = clock.now_ns() + RESET_LIMIT_NS;
        for slave in &self.slaves {
            let start = SPEED_COUNTER_START.to_le_bytes();
            // Without it the startup only lasts longer.
            let _ = self.master.reg_request_write(slave.al_control, SPEED_COUNTER, &start);
        }
        let is_busy = |master: &mut Master, slave: &Slave| {
            matches!(master.reg_request_state(slave.al_control), Ok(RequestState::Busy))
        };
        while self.slaves.iter().any(|slave| is_busy(&mut self.master, slave))
            && clock.now_ns() < end_ns
        {
            clock.sleep_until_ns(clock.now_ns() + RESET_POLL_NS);
        }
    }

    fn needs_startup_round(&self) -> bool {
        let is_silent = |slave: &Slave| slave.report.working_counter == 0;
        match self.startup_rounds {
            StartupRounds::Off => false,
            StartupRounds::UntilSafeOp => {
                self.slaves.iter().any(is_silent) || self.has_slave_below_safeop()
            }
            StartupRounds::On => true,
        }
    }

    fn has_slave_below_safeop(&self) -> bool {
        self.slaves.iter().any(|slave| {
            let state = self.master.config_state(slave.config);
            state.is_ok_and(|state| !state.online || state.al_state < AlState::SafeOp.raw())
        })
    }
}
