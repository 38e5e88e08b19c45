//! Record of what a drive does, for judging a run: motion in every controller period, commands and
//! changes of state.

use std::collections::VecDeque;

use ecan_canopen::{Controlword, DriveState, OperatingMode};

use super::history::TargetRecord;

/// Service by which a command reached the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandSource {
    /// RPDO.
    Pdo,
    /// SDO download.
    Sdo,
}

/// Cause of a change of the power stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TraceCause {
    /// A controlword.
    Command(CommandSource),
    /// The drive itself: the end of a stop or of enabling, or the self-test after power-on.
    Drive,
    /// A fault, with its error code.
    Fault(u16),
    /// Loss of the host, with the error code of its emergency message.
    HostLost(u16),
    /// Loss of supply, or NMT reset node.
    Restart,
}

/// Motion at the end of a controller period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample {
    /// Mechanical position in increments, as
    /// [`Drive::mechanical_position`](super::Drive::mechanical_position).
    pub position: f64,
    /// Velocity in increments per second.
    pub velocity: f64,
    /// Torque in thousandths of the rated torque.
    pub torque: f64,
}

/// An event in a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TraceEvent {
    /// End of a controller period. Not recorded while the power stage is off and the motor at rest.
    Motion(MotionSample),
    /// A controlword that differs from the previous one in value or source.
    Controlword {
        /// Controlword.
        word: Controlword,
        /// Service by which it came.
        source: CommandSource,
    },
    /// The power stage entered a state.
    State {
        /// New state.
        state: DriveState,
        /// Cause.
        cause: TraceCause,
    },
    /// The drive holds its position and follows targets from now on. A stop that did not leave
    /// Operation enabled yet is cancelled.
    Enable {
        /// Cause.
        cause: TraceCause,
    },
    /// The drive begins to decelerate, to leave Operation enabled or stay in Quick stop active. A
    /// halt (bit 8 of the controlword) is not a stop.
    Stop {
        /// Deceleration in increments per second squared.
        deceleration: f64,
        /// Cause.
        cause: TraceCause,
    },
    /// The current of the motor was switched off; at speed the motor coasts.
    Release {
        /// Velocity at that time in increments per second.
        velocity: f64,
        /// Cause.
        cause: TraceCause,
    },
    /// A mode became active; `None` is no mode.
    Mode(Option<OperatingMode>),
    /// A target was applied.
    Target(TargetRecord),
}

/// An event with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceRecord {
    /// Simulated time in nanoseconds.
    pub time_ns: u64,
    /// Event.
    pub event: TraceEvent,
}

/// The last events of a drive; empty if [`DriveConfig::trace`](super::DriveConfig::trace) is 0.
#[derive(Clone, Debug)]
pub struct DriveTrace {
    records: VecDeque<TraceRecord>,
    depth: usize,
    recorded: u64,
    last_controlword: Option<(u64, Controlword, CommandSource)>,
    state: DriveState,
}

impl DriveTrace {
    pub(super) fn new(depth: usize) -> Self {
        Self {
            records: VecDeque::with_capacity(depth),
            depth,
            recorded: 0,
            last_controlword: None,
            state: DriveState::NotReadyToSwitchOn,
        }
    }

    pub(super) const fn is_on(&self) -> bool {
        self.depth > 0
    }

    pub(super) fn add(&mut self, time_ns: u64, event: TraceEvent) {
        if self.depth == 0 {
            return;
        }
        if self.records.len() >= self.depth {
            self.records.pop_front();
        }
        self.records.push_back(TraceRecord { time_ns, event });
        self.recorded += 1;
    }

    pub(super) fn add_controlword(&mut self, time: u64, word: Controlword, source: CommandSource) {
        let is_new = self.last_controlword.is_none_or(|(_, last, by)| (last, by) != (word, source));
        self.last_controlword = Some((time, word, source));
        if is_new {
            self.add(time, TraceEvent::Controlword { word, source });
        }
    }

    pub(super) fn add_state(&mut self, time_ns: u64, state: DriveState, cause: TraceCause) {
        if self.state != state {
            self.state = state;
            self.add(time_ns, TraceEvent::State { state, cause });
        }
    }

    /// Number of events recorded so far, including those dropped from the trace.
    #[must_use]
    pub const fn recorded(&self) -> u64 {
        self.recorded
    }

    /// The kept events, oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &TraceRecord> + ExactSizeIterator {
        self.records.iter()
    }

    /// The kept events after the first `count` ever recorded, oldest first: with the last value of
    /// [`recorded`](Self::recorded), those that are new.
    pub fn since(&self, count: u64) -> impl Iterator<Item = &TraceRecord> {
        let new = usize::try_from(self.recorded.saturating_sub(count)).unwrap_or(usize::MAX);
        self.records.iter().skip(self.records.len().saturating_sub(new))
    }

    /// Time in ns, value and source of the last controlword, changed or not; `None` before the
    /// first. Also known if the trace is off.
    #[must_use]
    pub const fn last_controlword(&self) -> Option<(u64, Controlword, CommandSource)> {
        self.last_controlword
    }
}
