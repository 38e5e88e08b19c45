//! Configuration of the distributed clocks.

use std::time::Duration;

/// The clock that the other clocks follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ClockSource {
    /// The host's clock: each cycle corrects the reference clock to the application's time, and the
    /// other slaves to the reference clock.
    #[default]
    Host,
    /// The reference clock: a phase-locked loop shifts the deadlines of the host's cycle until the
    /// frames pass the reference slave in phase. Sync0 is then as regular as that slave's
    /// oscillator, independent of the host's delays.
    ///
    /// The loop acts on [`Adapter::wait_next_cycle`](crate::Adapter::wait_next_cycle); an
    /// application with its own cycle timer adds
    /// [`Adapter::clock_correction_ns`](crate::Adapter::clock_correction_ns) to its next deadline.
    Reference,
}

/// Distributed clocks with Sync0 (manual 8.4, 15.6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DcSync {
    /// Sync0 period; a whole multiple of the cycle, normally the cycle itself.
    pub cycle: Duration,
    /// Phase of Sync0 relative to the start of the period, below `cycle`.
    ///
    /// Outputs must arrive before it (manual 15.6.1 lists proven values; 16.1 describes the effect
    /// of a value that is too small). [`DcSync::planned`] chooses it; the
    /// [`Plan`](crate::Plan) warns of one among the arrivals of the outputs.
    pub shift: Duration,
    /// AssignActivate word of the slave. The manual does not state it; see docs/ASSUMPTIONS.md.
    pub assign_activate: u16,
    /// The clock that the other clocks follow.
    pub source: ClockSource,
    /// Index of the slave with the reference clock; `None` selects the first slave on the bus that
    /// has a clock.
    pub reference: Option<usize>,
    /// Period, in cycles, of the measurement of the differences between the slaves' clocks, for
    /// [`ClockStatus::synchrony_ns`](crate::ClockStatus::synchrony_ns); 0 disables it.
    pub monitor_every: u32,
}

/// At most `u32::MAX`, which the check of a configuration rejects as too long.
pub(super) fn nanoseconds(duration: Duration) -> u32 {
    u32::try_from(duration.as_nanos()).unwrap_or(u32::MAX)
}

impl DcSync {
    /// Sync0 once per `cycle`, `shift` after its start. The slaves follow the host's clock,
    /// the first slave is the reference, and the differences are measured every 100 cycles.
    pub fn new(cycle: Duration, shift: Duration) -> Self {
        Self {
            cycle,
            shift,
            assign_activate: 0x0300,
            source: ClockSource::Host,
            reference: None,
            monitor_every: 100,
        }
    }

    /// `cycle` in nanoseconds, at most `u32::MAX`.
    pub fn cycle_ns(&self) -> u32 {
        nanoseconds(self.cycle)
    }

    /// `shift` in nanoseconds, at most `u32::MAX`.
    pub fn shift_ns(&self) -> u32 {
        nanoseconds(self.shift)
    }
}
