//! Status of an axis, and the axes of a snapshot.
//!
//! The section has the time, the words that do not change of all axes, then those of each cycle of all
//! axes, then those of rejected targets, then those of further objects of process data.

use std::time::Duration;

use ecan_canopen::{
    DriveState, Heartbeat, Network, NmtState, NodeAddress, NodeId, NodeStatus, OperatingMode,
    Statusword,
};
use ecan_host::{Adapter, Section, Snapshot, WordGroups};

use super::codes;
use crate::axis::axis::Axis;
use crate::axis::config::AxisConfig;
use crate::axis::pdo_layout::AxisInputs;
use crate::axis::power::StopCause;
use crate::axis::status::{AxisErrorKind, AxisPhase};
use crate::axis::units::Scale;
use crate::guard::feed_forward::FeedForward;
use crate::guard::terms::{Decision, HoldReason, PositionRange, TargetRejection};

/// Declares the status of an axis once: each field with its value, and with its value in the words of a
/// snapshot. A flag is a bit of [`Words::state`], with a constant for it.
macro_rules! axis_status {
    (
        ($axis:ident, $network:ident, $now_ns:ident, $words:ident)
        fields { $($(#[$meta:meta])* $vis:vis $field:ident: $type:ty = $value:expr, $decoded:expr;)* }
        flags { $($(#[$flag_meta:meta])* $flag:ident, $constant:ident = $bit:literal, $is_set:expr;)* }
    ) => {
        /// Status of an axis in one cycle, complete: by [`AxisRef::status`](crate::AxisRef::status), and
        /// in a snapshot by [`AxesSnapshot`](crate::AxesSnapshot).
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[non_exhaustive]
        pub struct AxisStatus {
            $($(#[$meta])* $vis $field: $type,)*
            $($(#[$flag_meta])* pub $flag: bool,)*
        }

        $(const $constant: u64 = 1 << $bit;)*

        impl AxisStatus {
            pub(crate) fn of($axis: &Axis, $network: &Network, $now_ns: u64) -> Self {
                Self { $($field: $value,)* $($flag: $is_set,)* }
            }

            fn decode($words: &Words<'_>) -> Option<Self> {
                Some(Self { $($field: $decoded,)* $($flag: $words.has($constant),)* })
            }
        }

        fn flags($axis: &Axis, $now_ns: u64) -> u64 {
            0 $(| flag($is_set, $constant))*
        }
    };
}

axis_status! {
    (axis, network, now_ns, words)
    fields {
        /// Address of the drive.
        pub address: NodeAddress = axis.plan.config.address, address_of(words.address)?;
        /// Phase.
        pub phase: AxisPhase = axis.report.phase(), codes::phase(words.phase as u32)?;
        /// Time since the phase began.
        pub elapsed: Duration = axis.report.elapsed(now_ns), words.elapsed();
        /// Failure of the last command.
        pub error: Option<AxisErrorKind> =
            axis.report.error.map(AxisErrorKind::from), AxisErrorKind::from_raw((words.errors >> 16) as u8);
        /// Mode that the drive has confirmed; before that, the configured one.
        pub mode: OperatingMode = axis.path.mode(), codes::mode((words.phase >> 56) as u8)?;
        /// The last statusword, however old; `None` before the first.
        pub statusword: Option<Statusword> = axis.link.drive().statusword,
            words.has(HAS_STATUSWORD).then_some(Statusword((words.state >> 32) as u16));
        /// Error code of the last emergency message; 0 for none, or after the node reset it.
        pub error_code: u16 = axis.plan.error_code(network), words.errors as u16;
        /// Last NMT state that the node reported.
        pub nmt_state: Option<NmtState> =
            network.nmt_state(axis.plan.node), codes::nmt_state((words.state >> 16) as u8);
        /// State of the node's heartbeat.
        pub heartbeat: Heartbeat =
            network.heartbeat(axis.plan.node), codes::heartbeat((words.state >> 24) as u8)?;
        /// The last usable actual position, in steps; `None` before the first.
        pub actual: Option<i32> =
            axis.path.guard().actual(), words.has(HAS_ACTUAL).then_some(unpair(words.positions).0);
        /// Age of the actual position in cycles; 0 is this cycle, 65535 is more or never.
        pub actual_age: u16 = axis.path.guard().actual_age(), (words.decision >> 48) as u16;
        /// The last target sent to an axis that follows targets.
        pub target: Option<i32> =
            axis.path.target(), words.has(HAS_TARGET).then_some(unpair(words.positions).1);
        /// Values of the further objects in the last TPDOs, see
        /// [`PdoConfig::inputs`](crate::PdoConfig::inputs).
        pub inputs: AxisInputs = *axis.data.inputs(), extension_of(words.extension).0;
        /// The feed-forward that was sent last.
        pub feed_forward: FeedForward = axis.data.feed_forward(), extension_of(words.extension).1;
        /// Decision about the target of the cycle.
        pub decision: Decision = axis.path.decision(), words.decision()?;
        /// Reason of a hold.
        pub hold_reason: Option<HoldReason> =
            axis.path.hold_reason(), codes::hold_reason((words.errors >> 32) as u16);
        /// Cause of the stop that is pending or complete.
        pub stop_cause: Option<StopCause> = axis.task.state().stop().map(|stop| stop.cause),
            codes::stop_cause((words.phase >> 32) as u32 & 0xFF_FFFF);
        scale: Scale = Scale::of_parts(axis.plan.config.scale.parts()), words.scale();
        range: PositionRange = axis.plan.config.range, words.range();
    }
    flags {
        /// The drive is configured.
        is_configured, CONFIGURED = 3, axis.setup.is_complete();
        /// The axis follows the application's targets; false while it is halted.
        is_running, RUNNING = 4, axis.path.follows_application();
        /// A halted axis is at rest; true for an axis that is not running.
        is_at_rest, AT_REST = 0, axis.is_at_rest();
        /// A drive with its own trajectory has reached its target.
        is_target_reached, TARGET_REACHED = 6, axis.path.is_target_reached(axis.link.drive());
        /// The axis has stopped.
        is_stopped, STOPPED = 7, axis.is_stopped(now_ns);
        /// A recovery continues.
        is_recovering, RECOVERING = 8, axis.task.recovery.is_some();
    }
}

impl AxisStatus {
    /// The state in the statusword.
    pub fn drive_state(&self) -> Option<DriveState> {
        self.statusword.and_then(Statusword::state)
    }

    /// The actual position in degrees by the axis's scale.
    pub fn actual_degrees(&self) -> Option<f64> {
        self.actual.map(|actual| self.scale.degrees(actual))
    }

    /// The actual position in radians by the axis's scale.
    pub fn actual_radians(&self) -> Option<f64> {
        self.actual.map(|actual| self.scale.radians(actual))
    }

    /// Following error of a running axis in steps: target minus actual position, the shorter
    /// distance if the counter wraps. It includes the delay of the communication, two cycles or more;
    /// the drive's own value is 0x60F4.
    pub fn following_error(&self) -> Option<i64> {
        Some(self.range.distance(self.actual?, self.target?))
    }
}

/// Words that do not change: address, scale and range.
pub(super) const FIXED_WORDS: usize = 4;
/// Words of each cycle.
pub(super) const CYCLE_WORDS: usize = 6;
/// Words of a rejected target; else their content is old.
pub(super) const REJECTION_WORDS: usize = 2;
/// Words of the further objects of process data, of axes that have some.
pub(super) const EXTENSION_WORDS: usize = 8;
/// Words of the values of inputs among them.
const INPUT_WORDS: usize = 6;
/// The scale is that of the extension: a bit above those of the inputs.
const HAS_SCALE: u64 = 1 << 15;
pub(super) const AXIS_WORDS: usize = FIXED_WORDS + CYCLE_WORDS + REJECTION_WORDS + EXTENSION_WORDS;

/// Words of one axis, by their kind.
#[derive(Debug, Clone, Copy)]
pub(super) struct AxisWords<'a> {
    pub(super) fixed: &'a [u64; FIXED_WORDS],
    pub(super) cycle: &'a [u64; CYCLE_WORDS],
    pub(super) rejection: &'a [u64; REJECTION_WORDS],
    pub(super) extension: &'a [u64; EXTENSION_WORDS],
    /// Time of the cycle.
    pub(super) now_ns: u64,
}

const HAS_TARGET: u64 = 1 << 1;
const HAS_STATUSWORD: u64 = 1 << 2;
const HAS_ACTUAL: u64 = 1 << 5;
/// Kind of the decision: 3 bits above the flags.
const KIND_SHIFT: u32 = 9;

fn flag(is_set: bool, bit: u64) -> u64 {
    if is_set { bit } else { 0 }
}

/// Two numbers of 32 bits.
fn pair(low: i32, high: i32) -> u64 {
    u64::from(low.cast_unsigned()) | u64::from(high.cast_unsigned()) << 32
}

fn unpair(word: u64) -> (i32, i32) {
    ((word as u32).cast_signed(), ((word >> 32) as u32).cast_signed())
}

pub(super) fn fixed_words(config: &AxisConfig) -> [u64; FIXED_WORDS] {
    let NodeAddress { slave, channel, node } = config.address;
    let (kind, min, max) = match config.range {
        PositionRange::Linear => (0, 0, 0),
        PositionRange::Wrapping => (1, 0, 0),
        PositionRange::Modulo { min, max } => (2, min, max),
    };
    let address = slave as u64 | u64::from(channel) << 32 | u64::from(node.get()) << 40;
    let (steps_per_turn, origin) = config.scale.parts();
    [address, steps_per_turn.to_bits(), pair(origin, kind), pair(min, max)]
}

fn address_of(word: u64) -> Option<NodeAddress> {
    let node = NodeId::from_raw((word >> 40) as u8)?;
    Some(NodeAddress { slave: word as u32 as usize, channel: (word >> 32) as u8, node })
}

const DECISION_TARGET: u8 = 3;
const DECISION_WAIT: u8 = 4;

/// Kind of a decision, its reason, and its value.
fn decision_parts(decision: Decision) -> (u8, u8, i32) {
    match decision {
        Decision::Closed => (0, 0, 0),
        Decision::Track(target) => (1, 0, target),
        Decision::First(target) => (2, 0, target),
        Decision::Target(target) => (DECISION_TARGET, 0, target),
        Decision::Wait(reason) => (DECISION_WAIT, reason as u8, 0),
        Decision::Reject(rejection) => (5, rejection_words(rejection).0, 0),
    }
}

fn rejection_words(rejection: TargetRejection) -> (u8, [u64; REJECTION_WORDS]) {
    match rejection {
        TargetRejection::Step { step, limit } => (0, [step.cast_unsigned(), limit.into()]),
        TargetRejection::Window { distance, window } => {
            (1, [distance.cast_unsigned(), window.into()])
        }
        TargetRejection::Bounds { target, min, max } => (2, [pair(target, min), pair(max, 0)]),
        TargetRejection::Counter { target } => (3, [pair(target, 0), 0]),
        TargetRejection::NoTargets => (4, [0, 0]),
    }
}

fn rejection_of(kind: u8, [first, second]: [u64; REJECTION_WORDS]) -> TargetRejection {
    let (target, min) = unpair(first);
    match kind {
        0 => TargetRejection::Step { step: first.cast_signed(), limit: second as u32 },
        1 => TargetRejection::Window { distance: first.cast_signed(), window: second as u32 },
        2 => TargetRejection::Bounds { target, min, max: unpair(second).0 },
        3 => TargetRejection::Counter { target },
        _ => TargetRejection::NoTargets,
    }
}

/// Reason and value of a decision: 40 bits.
#[inline(always)]
fn decision_number(reason: u8, value: i32) -> u64 {
    u64::from(value.cast_unsigned()) | u64::from(reason) << 32
}

/// Word of the decision, and of the age of the actual position.
#[inline(always)]
fn decision_word(axis: &Axis, decision: u64) -> u64 {
    decision | u64::from(axis.path.guard().actual_age()) << 48
}

/// Word of what the drive and its node reported, with flags of the axis and the kind of the decision.
#[inline(always)]
fn report_word(flags: u64, kind: u8, node: &NodeStatus, statusword: u16) -> u64 {
    flags
        | u64::from(kind) << KIND_SHIFT
        | u64::from(codes::nmt_number(node.nmt_state)) << 16
        | (node.heartbeat as u64) << 24
        | u64::from(statusword) << 32
}

/// Word of phase, stop and mode.
#[inline(always)]
fn phase_word(phase: u32, stop: u32, mode: OperatingMode) -> u64 {
    u64::from(phase) | u64::from(stop) << 32 | u64::from(codes::mode_number(mode)) << 56
}

/// Word of the errors, of the node and of the axis, and of the hold.
#[inline(always)]
fn error_word(node: &NodeStatus, error: u8, hold: u16) -> u64 {
    u64::from(node.error_code) | u64::from(error) << 16 | u64::from(hold) << 32
}

/// The words of the further objects of process data.
#[inline(never)]
pub(super) fn encode_extension(axis: &Axis) -> [u64; EXTENSION_WORDS] {
    let (values, present) = axis.data.inputs().parts();
    let FeedForward { velocity, torque } = axis.data.feed_forward();
    let torque = u64::from(torque.cast_unsigned());
    let mut words = [0; EXTENSION_WORDS];
    let [first, scale, rest @ ..] = &mut words;
    *first =
        u64::from(present) | HAS_SCALE | torque << 16 | u64::from(velocity.cast_unsigned()) << 32;
    *scale = axis.plan.config.scale.parts().0.to_bits();
    for (word, values) in rest.iter_mut().zip(values.as_chunks().0) {
        let [low, high] = *values;
        *word = pair(low, high);
    }
    words
}

fn extension_of(words: &[u64; EXTENSION_WORDS]) -> (AxisInputs, FeedForward) {
    let [first, _, rest @ ..] = *words;
    let mut values = [0; 2 * INPUT_WORDS];
    for (values, word) in values.as_chunks_mut().0.iter_mut().zip(rest) {
        let (low, high) = unpair(word);
        *values = [low, high];
    }
    let inputs = AxisInputs::of_parts(values, (first & !HAS_SCALE) as u16);
    let torque = ((first >> 16) as u16).cast_signed();
    (inputs, FeedForward { velocity: unpair(first).1, torque })
}

/// The words of an axis that is running with this target, in the usual case; most parts of them are
/// constant.
#[inline(always)]
pub(super) fn encode_running(
    axis: &Axis,
    target: i32,
    network: &Network,
) -> Option<[u64; CYCLE_WORDS]> {
    // First, since it may call.
    let (kind, decision) = match axis.path.decision() {
        Decision::Target(target) => (DECISION_TARGET, decision_number(0, target)),
        _ => (DECISION_WAIT, waiting_number(axis)?),
    };
    if let OperatingMode::CyclicPosition = axis.path.mode()
        && let None = axis.report.error
        && let None = axis.task.recovery
        && let Some(actual) = axis.path.guard().actual()
        && let Some(statusword) = axis.link.drive().statusword
    {
        let node = network.status(axis.plan.node)?;
        let flags = HAS_ACTUAL | HAS_TARGET | HAS_STATUSWORD | CONFIGURED | RUNNING;
        let at_rest = flag(axis.path.targets.is_at_rest(), AT_REST);
        return Some([
            pair(actual, target),
            decision_word(axis, decision),
            report_word(flags | at_rest, kind, &node, statusword.0),
            axis.report.phase_since_ns(),
            phase_word(codes::PHASE_RUNNING, 0, OperatingMode::CyclicPosition),
            error_word(&node, 0, 0),
        ]);
    }
    None
}

/// Apart from the kind of the usual decision, which one comparison then finds.
#[inline(never)]
fn waiting_number(axis: &Axis) -> Option<u64> {
    match axis.path.decision() {
        Decision::Wait(reason) => Some(decision_number(reason as u8, 0)),
        _ => None,
    }
}

/// The words in any state, and those of a rejected target.
#[cold]
#[inline(never)]
pub(super) fn encode_any(
    axis: &Axis,
    network: &Network,
    now_ns: u64,
) -> ([u64; CYCLE_WORDS], Option<[u64; REJECTION_WORDS]>) {
    // infallible: the network has the node of each axis
    let Some(node) = network.status(axis.plan.node) else { return ([0; CYCLE_WORDS], None) };
    let (actual, target) = (axis.path.guard().actual(), axis.path.target());
    let statusword = axis.link.drive().statusword;
    let flags = flag(actual.is_some(), HAS_ACTUAL)
        | flag(target.is_some(), HAS_TARGET)
        | flag(statusword.is_some(), HAS_STATUSWORD)
        | flags(axis, now_ns);
    let error = axis.report.error.map_or(0, |error| AxisErrorKind::from(error).raw());
    let stop = codes::stop_number(axis.task.state().stop().map(|stop| stop.cause));
    let hold = codes::hold_number(axis.path.hold_reason());
    let (kind, reason, value) = decision_parts(axis.path.decision());
    let words = [
        pair(actual.unwrap_or(0), target.unwrap_or(0)),
        decision_word(axis, decision_number(reason, value)),
        report_word(flags, kind, &node, statusword.map_or(0, |word| word.0)),
        axis.report.phase_since_ns(),
        phase_word(codes::phase_number(axis.report.phase()), stop, axis.path.mode()),
        error_word(&node, error, hold),
    ];
    match axis.path.decision() {
        Decision::Reject(rejection) => (words, Some(rejection_words(rejection).1)),
        _ => (words, None),
    }
}

/// Words of one axis by their content; see the functions that encode them.
struct Words<'a> {
    fixed: [u64; FIXED_WORDS],
    address: u64,
    positions: u64,
    decision: u64,
    state: u64,
    since_ns: u64,
    phase: u64,
    errors: u64,
    rejection: [u64; REJECTION_WORDS],
    extension: &'a [u64; EXTENSION_WORDS],
    now_ns: u64,
}

impl Words<'_> {
    fn has(&self, flag: u64) -> bool {
        self.state & flag != 0
    }

    fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.now_ns.saturating_sub(self.since_ns))
    }

    fn decision(&self) -> Option<Decision> {
        let value = unpair(self.decision).0;
        let reason = (self.decision >> 32) as u8;
        Some(match (self.state >> KIND_SHIFT) as u8 & 7 {
            1 => Decision::Track(value),
            2 => Decision::First(value),
            DECISION_TARGET => Decision::Target(value),
            DECISION_WAIT => Decision::Wait(codes::wait_reason(reason)?),
            5 => Decision::Reject(rejection_of(reason, self.rejection)),
            _ => Decision::Closed,
        })
    }

    fn scale(&self) -> Scale {
        let [_, steps_per_turn, origin, _] = self.fixed;
        let [extension, scale, ..] = *self.extension;
        let steps_per_turn = if extension & HAS_SCALE != 0 { scale } else { steps_per_turn };
        Scale::of_parts((f64::from_bits(steps_per_turn), unpair(origin).0))
    }

    fn range(&self) -> PositionRange {
        let [_, _, origin, range] = self.fixed;
        let (min, max) = unpair(range);
        match unpair(origin).1 {
            1 => PositionRange::Wrapping,
            2 => PositionRange::Modulo { min, max },
            _ => PositionRange::Linear,
        }
    }
}

/// The status of an axis.
pub(super) fn status_of(words: AxisWords<'_>) -> Option<AxisStatus> {
    let AxisWords { fixed, cycle, rejection, extension, now_ns } = words;
    let [address, ..] = *fixed;
    let [positions, decision, state, since_ns, phase, errors] = *cycle;
    AxisStatus::decode(&Words {
        fixed: *fixed,
        address,
        positions,
        decision,
        state,
        since_ns,
        phase,
        errors,
        rejection: *rejection,
        extension,
        now_ns,
    })
}

/// Words of the time of the cycle.
const TIME_WORDS: usize = 1;

pub(crate) fn reserve<'a>(adapter: &Adapter, axes: impl Iterator<Item = &'a AxisConfig>) {
    let fixed: Vec<u64> = axes.flat_map(fixed_words).collect();
    let mut words = vec![0; TIME_WORDS];
    words.extend_from_slice(&fixed);
    words.resize(TIME_WORDS + fixed.len() / FIXED_WORDS * AXIS_WORDS, 0);
    adapter.publisher().reserve(Section::Axes, &words);
}

/// Writes the axes' section of a cycle.
pub(crate) struct AxesWriter<'a> {
    now_ns: u64,
    cycle: WordGroups<'a, CYCLE_WORDS>,
    rejections: WordGroups<'a, REJECTION_WORDS>,
    extensions: WordGroups<'a, EXTENSION_WORDS>,
}

impl<'a> AxesWriter<'a> {
    /// `None` if nothing is observed.
    pub(crate) fn new(
        adapter: &'a Adapter,
        is_observed: bool,
        now_ns: u64,
        axis_count: usize,
    ) -> Option<Self> {
        // The writer marks the section as written.
        let mut rest = is_observed.then(|| adapter.publisher().section(Section::Axes)).flatten()?;
        rest.write([now_ns]);
        rest.skip(axis_count * FIXED_WORDS);
        let cycle = rest.groups(axis_count)?;
        let rejections = rest.groups(axis_count)?;
        Some(Self { now_ns, cycle, rejections, extensions: rest.groups(axis_count)? })
    }

    /// Updates the phases and writes the axes.
    pub(crate) fn update(self, axes: &mut [Axis], network: &Network) {
        let now_ns = self.now_ns;
        for (axis, to) in axes.iter_mut().zip(self.cycle.iter()) {
            // Phase and words in one pass, since the checks are the same.
            let target = axis.update_phase(now_ns);
            if axis.plan.is_extended
                && let Some(to) = self.extensions.get(axis.plan.index)
            {
                to.write(encode_extension(axis));
            }
            if let Some(words) = target.and_then(|target| encode_running(axis, target, network)) {
                to.write(words);
                continue;
            }
            let (words, rejection) = encode_any(axis, network, now_ns);
            to.write(words);
            if let Some((to, words)) = self.rejections.get(axis.plan.index).zip(rejection) {
                to.write(words);
            }
        }
    }
}

/// The axes in a [`Snapshot`]: those of the [`Cia402`](crate::Cia402) that was created last, and none
/// after its end.
#[derive(Debug, Clone, Copy)]
pub struct AxesSnapshot<'a> {
    now_ns: u64,
    fixed: &'a [[u64; FIXED_WORDS]],
    cycle: &'a [[u64; CYCLE_WORDS]],
    rejections: &'a [[u64; REJECTION_WORDS]],
    extensions: &'a [[u64; EXTENSION_WORDS]],
}

impl<'a> AxesSnapshot<'a> {
    /// The axes' part of a snapshot; `None` if the cycle did not send targets
    /// ([`Cia402::send_targets_all`](crate::Cia402::send_targets_all)).
    pub fn of(snapshot: &'a Snapshot) -> Option<Self> {
        let (now_ns, words) = snapshot.section(Section::Axes)?.split_first()?;
        let count = words.len() / AXIS_WORDS;
        let (fixed, rest) = words.split_at_checked(count * FIXED_WORDS)?;
        let (cycle, rest) = rest.split_at_checked(count * CYCLE_WORDS)?;
        let (rejections, extensions) = rest.split_at_checked(count * REJECTION_WORDS)?;
        Some(Self {
            now_ns: *now_ns,
            fixed: fixed.as_chunks().0,
            cycle: cycle.as_chunks().0,
            rejections: rejections.as_chunks().0,
            extensions: extensions.as_chunks().0,
        })
    }

    /// Number of axes.
    pub fn axis_count(&self) -> usize {
        self.fixed.len()
    }

    /// Status of an axis at the end of the cycle; `None` for an index out of range.
    pub fn axis(&self, axis: usize) -> Option<AxisStatus> {
        status_of(AxisWords {
            fixed: self.fixed.get(axis)?,
            cycle: self.cycle.get(axis)?,
            rejection: self.rejections.get(axis)?,
            extension: self.extensions.get(axis)?,
            now_ns: self.now_ns,
        })
    }

    /// Status of all axes.
    pub fn axes(&self) -> impl Iterator<Item = AxisStatus> {
        (0..self.axis_count()).filter_map(|axis| self.axis(axis))
    }
}
