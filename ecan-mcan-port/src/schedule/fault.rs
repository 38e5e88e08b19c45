//! Reasons for which the results of scheduled frames stay unknown.

use std::fmt;

use crate::schedule::diagnostics::Object;

/// Reason for which the [`ScheduleAccount`](crate::ScheduleAccount) of a gateway cannot name the results of
/// accepted frames: they count as unknown.
///
/// The text names the row of docs/ASSUMPTIONS.md that does not hold and what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScheduleFault {
    /// The codes 1 and 2 of TX_RESULT contradict the flag SCHED_LATE_DROP of 0xB000:06.
    CodesContradicted,
    /// SCHED_LATE_DROP was set before a reading could verify the codes of TX_RESULT.
    CodesUnverified,
    /// An object that decides on accepted frames cannot be read.
    Unreadable {
        /// Its index.
        index: u16,
        /// Its subindex.
        subindex: u8,
    },
}

impl ScheduleFault {
    pub(crate) fn unreadable((index, subindex): Object) -> Self {
        Self::Unreadable { index, subindex }
    }
}

impl fmt::Display for ScheduleFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CodesContradicted => f.write_str(
                "TX_RESULT codes 1 and 2 of scheduled frames contradict the flag SCHED_LATE_DROP (0xB000:06 bit 6), \
                 assumption H23; the frames count as unknown; disable TX_RESULT: then the flags alone decide",
            ),
            Self::CodesUnverified => f.write_str(
                "SCHED_LATE_DROP (0xB000:06 bit 6) was set before the TX_RESULT codes of scheduled frames were \
                 verified (assumption H23, or assumption H24: the frames may count from another pulse); the frames count as \
                 unknown; clear the flags, or disable TX_RESULT: then the flags alone decide",
            ),
            Self::Unreadable { index, subindex } => write!(
                f,
                "0x{index:04X}:{subindex:02} cannot be read (assumption H42: the firmware may lack it); accepted \
                 scheduled frames count as unknown; read the object with `ecan sdo`, update the firmware"
            ),
        }
    }
}
