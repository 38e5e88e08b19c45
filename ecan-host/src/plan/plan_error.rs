//! Errors and warnings of a plan.

use ecan_protocol::mapping::CHUNK_BYTES;
use thiserror::Error;

use super::domain_layout::{MAX_DATAGRAM_BYTES, MAX_PLAIN_MULTIPLIER};

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn remedy(best_ns: Option<u32>) -> String {
    match best_ns {
        Some(ns) => format!("use a shift of {:.1} us", us(ns.into())),
        None => "no shift is usable: use a smaller N or a longer cycle".to_owned(),
    }
}

/// A configuration that does not work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlanError {
    /// N that one datagram cannot carry, without the permission for it.
    #[error(
        "slave {slave}: {pdo} size N = {multiplier} needs {} bytes, but the IgH master puts a sync \
         manager into one datagram of at most {MAX_DATAGRAM_BYTES} bytes, so N is at most \
         {MAX_PLAIN_MULTIPLIER}; a larger one would activate and then block the whole bus. Set \
         `allow_large_pdos` (option --large-pdos) only if the installed master segments process data",
        usize::from(*multiplier) * CHUNK_BYTES
    )]
    LargePdo {
        /// Slave index.
        slave: usize,
        /// "RxPDO" or "TxPDO".
        pdo: &'static str,
        /// The configured N.
        multiplier: u8,
    },
    /// The frames of a cycle take longer than the cycle.
    #[error(
        "the frames of a cycle take {:.1} us on the wire, the cycle is {:.1} us: use a smaller N \
         or a longer cycle", us(*wire_ns), us((*cycle_ns).into())
    )]
    WireTime {
        /// Time on the wire in nanoseconds.
        wire_ns: u64,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// The watchdog of the slaves runs out between two cycles.
    #[error(
        "the process data watchdog of {} us runs out within the cycle of {} us: no slave would stay \
         in OP. Use a longer watchdog or a shorter cycle", watchdog_us, us((*cycle_ns).into())
    )]
    Watchdog {
        /// The watchdog in microseconds.
        watchdog_us: u32,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// The process data leave no room for mailbox traffic, so that no slave would ever reach OP.
    #[error(
        "process data of {needed} bytes per cycle with mailbox do not fit a cycle of {} us, of \
         which the master fills {available} bytes at most: its mailbox traffic would starve, and \
         no slave reach OP. Use a smaller N or a longer cycle", us((*cycle_ns).into())
    )]
    MailboxStarved {
        /// Bytes needed per cycle, with one mailbox transfer.
        needed: usize,
        /// Bytes that the master lets through in a cycle.
        available: usize,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
}

/// A configuration that works with little margin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlanWarning {
    /// More than 80 % of the cycle goes to the wire.
    #[error(
        "the frames of a cycle take {:.1} us on the wire, {:.0} % of the cycle of {:.1} us: a \
         frame that is sent late is not back for the next cycle. Use a smaller N or a longer cycle",
        us(*wire_ns), percent(*wire_ns, (*cycle_ns).into()), us((*cycle_ns).into())
    )]
    WireTime {
        /// Time on the wire in nanoseconds.
        wire_ns: u64,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// The watchdog outlasts no lost frame.
    #[error(
        "the process data watchdog of {} us is no longer than two cycles of {} us: a single lost \
         frame takes the slaves out of OP. Use a longer watchdog or a shorter cycle",
        watchdog_us, us((*cycle_ns).into())
    )]
    WatchdogTight {
        /// The watchdog in microseconds.
        watchdog_us: u32,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// Fewer mailbox transfers fit a cycle than there are slaves.
    #[error(
        "a cycle leaves room for {transfers} mailbox transfer(s) of {slaves} slaves: start-up and \
         SDOs take longer. Use a smaller N or a longer cycle"
    )]
    MailboxTight {
        /// Mailbox transfers that fit.
        transfers: usize,
        /// Number of slaves.
        slaves: usize,
    },
    /// A Sync0 pulse falls into the arrival of the outputs.
    #[error(
        "Sync0 {:.1} us after the start of the cycle falls into the arrival of the outputs, by {:.1} \
         us: outputs that arrive around or after it are missed, with missing working counters or \
         loss of OP; {} (manual 16.1)",
        us((*shift_ns).into()), us(*lacking_ns), remedy(*best_ns)
    )]
    Sync0Shift {
        /// The shift in nanoseconds.
        shift_ns: u32,
        /// Distance to the next usable shift, in nanoseconds.
        lacking_ns: u64,
        /// The shift with the largest margin, in nanoseconds; `None` if the arrivals fill the cycle.
        best_ns: Option<u32>,
    },
}
