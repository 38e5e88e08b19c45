//! Record of what a drive does, for judging a run: motion in every controller period, commands, changes of state,
//! and received targets.

use std::collections::VecDeque;

use ecan_canopen::{Controlword, DriveState, OperatingMode};

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

/// Quantity of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetKind {
    /// 0x607A, in position units.
    Position,
    /// 0x60FF, in position units per second.
    Velocity,
    /// 0x6071, in thousandths of the rated torque.
    Torque,
}

/// A target at the time when the drive applied it: at the SYNC for a synchronous RPDO, otherwise on
/// arrival.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TargetRecord {
    /// Simulated time in nanoseconds.
    pub time_ns: u64,
    /// Quantity.
    pub kind: TargetKind,
    /// The target.
    pub target: i32,
    /// State of the drive after the frame with the target, so with its controlword applied.
    pub state: DriveState,
    /// True if the drive follows the target: it is in Operation enabled, in a mode for this
    /// quantity, and not stopping. In profile position the set-point counts, not the write to
    /// 0x607A.
    pub followed: bool,
    /// Actual position at that time.
    pub actual: i32,
    /// Previous target of the same quantity since the drive was enabled, changed its mode or was
    /// homed.
    pub previous: Option<i32>,
    /// True if it is the first target since the drive entered Operation enabled, changed its mode
    /// there, or was homed. Always `false` for a target that is not followed.
    pub first: bool,
    /// Following error window (0x6065) at that time.
    pub window: u32,
}

impl TargetRecord {
    /// Distance of a position target from the actual position, in position units; 0 for other
    /// quantities.
    #[must_use]
    pub fn offset(&self) -> u32 {
        match self.kind {
            TargetKind::Position => self.target.wrapping_sub(self.actual).unsigned_abs(),
            TargetKind::Velocity | TargetKind::Torque => 0,
        }
    }

    /// Distance from the previous target; 0 for the first.
    #[must_use]
    pub fn step(&self) -> u32 {
        self.previous.map_or(0, |previous| self.target.wrapping_sub(previous).unsigned_abs())
    }
}

/// Sums over all targets since the drive was made, including those dropped from the history.
/// Distances refer to position targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TargetSums {
    /// Number of followed targets.
    pub followed: u64,
    /// Number of targets not followed.
    pub ignored: u64,
    /// Number of first targets.
    pub firsts: u64,
    /// Maximum distance of a first target from the actual position.
    pub largest_first_offset: u32,
    /// Maximum distance of a followed target from the actual position.
    pub largest_offset: u32,
    /// Maximum distance between consecutive targets.
    pub largest_step: u32,
    /// Number of followed targets outside the following error window.
    pub outside_window: u64,
    /// Maximum amounts of velocity offset (0x60B1) and torque offset (0x60B2).
    pub largest_offsets: (u32, u32),
    /// Maximum changes of these offsets, except to 0.
    pub largest_offset_changes: (u32, u32),
    /// Number of first targets while an offset was not 0.
    pub firsts_with_offsets: u64,
}

/// The last targets, and sums over all.
#[derive(Clone, Debug)]
pub struct TargetHistory {
    records: VecDeque<TargetRecord>,
    depth: usize,
    sums: TargetSums,
    /// Last target by quantity.
    last: [Option<i32>; 3],
    awaits_first: bool,
    /// Velocity offset and torque offset.
    offsets: (i32, i32),
}

impl TargetHistory {
    pub(super) fn new(depth: usize) -> Self {
        Self {
            records: VecDeque::with_capacity(depth),
            depth,
            sums: TargetSums::default(),
            last: [None; 3],
            awaits_first: false,
            offsets: (0, 0),
        }
    }

    /// Starts a new sequence of targets: after enabling, a mode change or homing.
    pub(super) fn restart(&mut self) {
        self.awaits_first = true;
        self.last = [None; 3];
    }

    /// Takes the offsets of a frame.
    pub(super) fn note_offsets(&mut self, velocity: i32, torque: i32) {
        let (last_velocity, last_torque) = std::mem::replace(&mut self.offsets, (velocity, torque));
        let change = |last: i32, next: i32| if next == 0 { 0 } else { next.abs_diff(last) };
        let sums = &mut self.sums;
        let (largest, changes) = (&mut sums.largest_offsets, &mut sums.largest_offset_changes);
        largest.0 = largest.0.max(velocity.unsigned_abs());
        largest.1 = largest.1.max(torque.unsigned_abs());
        changes.0 = changes.0.max(change(last_velocity, velocity));
        changes.1 = changes.1.max(change(last_torque, torque));
    }

    /// Adds a target and returns it; sets `first` and `previous`.
    pub(super) fn add(&mut self, mut record: TargetRecord) -> TargetRecord {
        if record.followed {
            record.first = std::mem::take(&mut self.awaits_first);
            if let Some(last) = self.last.get_mut(record.kind as usize) {
                record.previous = last.replace(record.target);
            }
        }
        self.sum(&record);
        if self.depth > 0 {
            if self.records.len() >= self.depth {
                self.records.pop_front();
            }
            self.records.push_back(record);
        }
        record
    }

    fn sum(&mut self, record: &TargetRecord) {
        let sums = &mut self.sums;
        if !record.followed {
            sums.ignored += 1;
            return;
        }
        sums.followed += 1;
        if record.first {
            sums.firsts += 1;
            sums.firsts_with_offsets += u64::from(self.offsets != (0, 0));
        }
        if record.kind != TargetKind::Position {
            return;
        }
        if record.first {
            sums.largest_first_offset = sums.largest_first_offset.max(record.offset());
        }
        sums.largest_offset = sums.largest_offset.max(record.offset());
        sums.largest_step = sums.largest_step.max(record.step());
        if record.window != u32::MAX && record.offset() > record.window {
            sums.outside_window += 1;
        }
    }

    /// The last targets, oldest first; at most [`DriveConfig::history`](super::DriveConfig).
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &TargetRecord> + ExactSizeIterator {
        self.records.iter()
    }

    /// Sums over all targets.
    #[must_use]
    pub const fn sums(&self) -> &TargetSums {
        &self.sums
    }
}
