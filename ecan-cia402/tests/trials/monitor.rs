//! Checks one axis by the trace of its drive: motion in every controller period, commands, states.
//! Nothing here reads the SDK; the trial reports the calls of the application, and whether a frame
//! could reach the drive.

use std::collections::VecDeque;

use ecan_canopen::{Command, Controlword, DriveState, OperatingMode, QuickStopOption};
use ecan_cia402::FeedForwardLimits;
use ecan_sim::{TargetKind, TargetSums, TraceCause, TraceEvent, TraceRecord};

use crate::bounds::{self, Bounds, LostAttempts};
use crate::log::DriveLog;
use crate::plan::{AxisPlan, MS, Plan};
use crate::report::{Finding, Kind, StopSample};
use crate::sdk::Class;

mod motion;
mod stop;

pub use motion::{
    LOST_BY_CLOCK, LOST_IN_BUS_OFF, LOST_IN_HIDDEN_BUS_OFF, RELEASED, RELEASED_BY_BUS,
};
use stop::Stop;
pub use stop::StopKind;

/// Velocity below which an axis counts as at rest, increments per second: three times that at which
/// the simulated drive ends a stop (0.01 revolutions per second).
const REST: f64 = 2_000.0;
/// A motor that was blocked returns to its demand as fast as it can, as long as that is inside the
/// drive's window for the following error.
const AFTER_BLOCK_NS: u64 = 400 * MS;

/// State of the path from the host to the drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// In this cycle the application did not call what sends and receives; nothing else is wrong.
    Paused,
    /// The host has lost time; nothing else is wrong. As blocked, but no frame waits.
    Resumed,
    /// A fault on the path, or a drive that is not on the bus or cannot answer.
    Blocked,
    /// The drive answers: SDO works. Process data do not, or the SDK does not know that they do.
    Services,
    /// RPDOs take effect.
    ProcessData,
}

/// State of an axis by the SDK.
#[derive(Debug, Clone, Copy)]
pub struct View {
    pub class: Class,
    pub is_recovering: bool,
    pub is_stopped: bool,
    /// No TPDO can arrive; `None` in a cycle without calls of the SDK.
    pub is_cut: Option<bool>,
}

#[derive(Debug, Clone, Copy)]
struct Braking {
    at_ns: u64,
    position: f64,
    velocity: f64,
    deceleration: f64,
}

/// Permission to enable the drive, by a call of the application.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Permit {
    #[default]
    None,
    Enable,
    /// It has led to an axis that follows: after the drive left Operation Enabled, it needs
    /// another one.
    Used,
    /// A mode change or homing enables and disables the drive as often as it needs.
    Procedure,
}

pub struct AxisMonitor {
    axis: usize,
    /// Mode and periods, for messages.
    machine: String,
    read: u64,
    // limits
    pub bounds: Bounds,
    range: Option<(i32, i32)>,
    target_ns: f64,
    friction: f64,
    may_coast: bool,
    // drive
    pub state: DriveState,
    pub follows: bool,
    pub mode: Option<OperatingMode>,
    pub position: f64,
    pub velocity: f64,
    torque: f64,
    /// The last controlword halts the axis.
    is_halted: bool,
    sampled_ns: u64,
    enabled_ns: u64,
    braking: Option<Braking>,
    targets: VecDeque<(u64, i32)>,
    target_kind: Option<TargetKind>,
    /// A target other than the first one took effect.
    has_moved: bool,
    window: VecDeque<(u64, f64, f64)>,
    unlimited_until: u64,
    /// A drive that ignores the quick stop may follow the positions of the stop frames: these are not
    /// limited (docs/SAFETY.md).
    stop_frames_until: u64,
    /// A target was late; the drive overshoots until then.
    late_until: u64,
    /// Until then waiting targets may take effect together, with this number in addition.
    released_until: u64,
    released: f64,
    /// A scheduled frame that is late is dropped, and the next target makes its step, too.
    scheduled: f64,
    // application
    permit: Permit,
    /// A command of the earlier owner may enable the drive until then, although that owner has called a stop.
    late_enable_until: u64,
    /// Times that a command from before a stop has enabled the drive.
    late_enables: u64,
    stop: Option<Stop>,
    was_running: bool,
    /// The axis runs again, and its next target is the first one.
    has_resumed: bool,
    /// Since the command to enable the SDK has shown only [`Class::Reading`]: it has not enabled the
    /// drive.
    is_reading: bool,
    was_process_data: bool,
    /// The drive was silent while its owner did not know it: it may still execute an RPDO of an earlier owner
    /// (docs/SAFETY.md, residual risks).
    pub is_unknown: bool,
    uncontrolled_ns: u64,
    /// Time in which the present owner may adopt the drive.
    adoption_ns: u64,
    /// Time without TPDOs of an axis that the SDK reports as running.
    cut_ns: u64,
    not_stopped_ns: u64,
    /// Remaining time until a halted axis must be at rest.
    halt: Option<u64>,
    pub findings: Vec<Finding>,
    pub samples: Vec<StopSample>,
    /// Greatest ratio of the velocity to the limit, in CSP.
    pub fastest: f64,
}

impl AxisMonitor {
    pub fn new(axis: usize, plan: &Plan) -> Self {
        let AxisPlan { config, drive, .. } = &plan.axes[axis];
        Self {
            axis,
            machine: format!(
                "{}, {} ms, div {}, SYNC {}",
                config.mode,
                plan.cycle_ns / MS,
                plan.table.motion_div,
                plan.table.sync.every_cycles
            ),
            read: 0,
            bounds: Bounds::new(plan, axis),
            range: bounds::range(config),
            target_ns: plan.target_ns() as f64,
            friction: f64::from(drive.motor.friction),
            may_coast: config.drive.quick_stop == Some(QuickStopOption::Disable),
            state: DriveState::NotReadyToSwitchOn,
            follows: false,
            mode: None,
            position: f64::from(drive.motor.start_position),
            velocity: 0.0,
            torque: 0.0,
            is_halted: false,
            sampled_ns: 0,
            enabled_ns: 0,
            braking: None,
            targets: VecDeque::new(),
            target_kind: None,
            has_moved: false,
            window: VecDeque::new(),
            unlimited_until: 0,
            stop_frames_until: 0,
            late_until: 0,
            released_until: 0,
            released: 0.0,
            scheduled: if plan.schedules_frames() { 1.0 } else { 0.0 },
            cut_ns: 0,
            not_stopped_ns: 0,
            halt: None,
            permit: Permit::None,
            late_enable_until: 0,
            late_enables: 0,
            stop: None,
            was_running: false,
            has_resumed: false,
            is_reading: false,
            was_process_data: false,
            is_unknown: false,
            uncontrolled_ns: 0,
            adoption_ns: 0,
            findings: Vec::new(),
            samples: Vec::new(),
            fastest: 0.0,
        }
    }

    fn report(&mut self, at_ns: u64, kind: Kind, text: String) {
        if !self.findings.iter().any(|finding| finding.kind == kind) {
            let text = format!("{text} [{}]", self.machine);
            self.findings.push(Finding { kind, axis: self.axis, at_ns, text });
        }
    }

    pub fn is_moving(&self) -> bool {
        self.velocity.abs() > REST
    }

    /// At the end: what the drive received.
    pub fn check_feed_forward(&mut self, at: u64, sums: &TargetSums, limits: &FeedForwardLimits) {
        let (velocity, torque) = sums.largest_offsets;
        if velocity > limits.velocity || torque > limits.torque.into() {
            let text = format!("{velocity} and {torque}; the limits are {limits:?}");
            self.report(at, Kind::FeedForward, text);
        }
        if sums.firsts_with_offsets > self.late_enables {
            let text = format!("at {} first targets", sums.firsts_with_offsets);
            self.report(at, Kind::FeedForward, text);
        }
    }

    // Calls of the application

    pub fn enabling(&mut self) {
        self.permit = Permit::Enable;
        self.is_reading = true;
    }

    pub fn procedure(&mut self) {
        self.permit = Permit::Procedure;
    }

    /// Time passed without cycles.
    pub fn disturbed(&mut self) {
        if let Some(stop) = &mut self.stop {
            stop.services_ns = 0;
            stop.process_data_ns = 0;
            stop.forget_losses();
            stop.was_blocked = true;
        }
        self.uncontrolled_ns = 0;
        self.not_stopped_ns = 0;
    }

    /// The motor cannot follow until `until`.
    pub fn blocked(&mut self, until: u64) {
        self.unlimited_until = until + AFTER_BLOCK_NS;
    }

    // Cycle

    /// Takes the new records of the trace, then the state of the path and of the SDK.
    pub fn observe<'a>(
        &mut self,
        records: impl Iterator<Item = &'a TraceRecord>,
        recorded: u64,
        log: &mut DriveLog<'_>,
    ) {
        let before = self.read;
        let mut count = 0;
        for record in records {
            count += 1;
            self.take(record, log);
        }
        self.read = recorded;
        if before + count != recorded {
            let text = format!("{} records of the trace were dropped", recorded - before - count);
            self.report(self.sampled_ns, Kind::Trial, text);
        }
    }

    pub fn read_so_far(&self) -> u64 {
        self.read
    }

    /// Takes the phase: in modes in which the drive would move on, an axis that does not run any more
    /// must be stopped.
    pub fn note_class(&mut self, now: u64, class: Class) {
        let ended = self.was_running && class.is_stopped();
        let was_running = std::mem::replace(&mut self.was_running, class.is_running());
        self.has_resumed = self.was_running && (self.has_resumed || !was_running);
        let moves_on = !matches!(
            self.mode,
            Some(OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition)
        );
        if ended && self.follows && moves_on && self.stop.is_none() {
            self.stopping(now, StopKind::Hold, class);
        }
    }

    /// Checks the cycle that ended at `now` and took `ns`.
    pub fn check(&mut self, now: u64, ns: u64, path: Path, view: View) {
        let View { class, is_recovering, is_stopped, is_cut } = view;
        if path == Path::Blocked {
            self.releasing(now, RELEASED);
        }
        self.is_unknown &= !class.is_running();
        self.check_halt(now, ns, path, class);
        self.check_cut(now, ns, class, is_cut);
        // In a cycle without calls the phase is that before the application's commands.
        let is_current = is_cut.is_some();
        if is_current && class.is_running() && self.permit == Permit::Enable && self.follows {
            self.permit = Permit::Used;
        }
        if is_current && self.permit == Permit::Procedure && !class.is_busy() && !is_recovering {
            self.permit = Permit::Used;
        }
        self.is_reading &= !is_current || class == Class::Reading;
        self.note_class(now, class);
        if matches!(path, Path::Services | Path::ProcessData) {
            self.was_process_data = path == Path::ProcessData;
        }
        self.check_stop(now, ns, path);
        self.check_stopped(now, ns, path, is_stopped);
        // A drive that follows a velocity although the SDK reports that the axis does not run.
        let is_uncontrolled = self.follows
            && self.is_moving()
            && class.is_stopped()
            && now > self.unlimited_until
            && self.stop.is_none();
        match path {
            Path::Blocked | Path::Resumed => self.uncontrolled_ns = 0,
            Path::Paused => {}
            _ if is_uncontrolled => self.uncontrolled_ns += ns,
            _ => self.uncontrolled_ns = 0,
        }
        if self.uncontrolled_ns > self.bounds.uncontrolled_ns() + self.adoption_ns {
            let text = format!("{:.0}/s while {class:?}, {:?}", self.velocity, self.mode);
            self.report(now, Kind::Uncontrolled, text);
        }
    }

    /// An axis whose TPDOs cannot arrive must not count as running for long.
    fn check_cut(&mut self, now: u64, ns: u64, class: Class, is_cut: Option<bool>) {
        match is_cut {
            Some(true) if class.is_running() => self.cut_ns += ns,
            Some(_) => self.cut_ns = 0,
            None => {}
        }
        if self.cut_ns > self.bounds.loss_detected_ns() {
            let text = format!("no TPDO for {} ms, {class:?}", self.cut_ns / MS);
            self.report(now, Kind::LossNotDetected, text);
        }
    }

    // Trace

    fn take(&mut self, record: &TraceRecord, log: &mut DriveLog<'_>) {
        let at = record.time_ns;
        match record.event {
            TraceEvent::Motion(sample) => {
                log.detail(at, || format!("{:.1} {:.0}/s", sample.position, sample.velocity));
                self.position = sample.position;
                self.velocity = sample.velocity;
                self.torque = sample.torque;
                self.sampled_ns = at;
                self.check_motion(at);
            }
            TraceEvent::Controlword { word, source } => {
                self.is_halted = word.has(Controlword::HALT);
                log.line(at, || format!("controlword {:04X} by {source:?}", word.0));
                if self.bounds.ignores_quick_stop() && word.command(word) == Command::QuickStop {
                    let command_ns = self.bounds.stop_by_sdo_ns(LostAttempts::default());
                    self.stop_frames_until = at + self.bounds.ignored_stop_ns(command_ns);
                }
            }
            TraceEvent::State { state, cause } => {
                log.line(at, || format!("{state} by {cause:?} at {:.0}/s", self.velocity));
                self.state = state;
                if state != DriveState::OperationEnabled {
                    self.unfollow(at, cause);
                }
            }
            TraceEvent::Enable { cause } => {
                log.line(at, || format!("follows targets by {cause:?}"));
                self.check_enable(at);
                self.follows = true;
                self.enabled_ns = at;
                self.braking = None;
                self.restart();
            }
            TraceEvent::Stop { deceleration, cause } => {
                log.line(at, || format!("decelerates by {cause:?} from {:.0}/s", self.velocity));
                self.unfollow(at, cause);
                self.brake(at, deceleration);
            }
            TraceEvent::Release { velocity, cause } => {
                log.line(at, || format!("current off by {cause:?} at {velocity:.0}/s"));
                // A blocked motor is at rest until it is free: the host cannot see it coming.
                if velocity.abs() > REST
                    && at >= self.unlimited_until
                    && matches!(cause, TraceCause::Command(_))
                    && !self.may_coast
                {
                    let text = format!("current switched off at {velocity:.0}/s by {cause:?}");
                    self.report(at, Kind::Coasting, text);
                }
                self.unfollow(at, cause);
                self.brake(at, self.friction);
            }
            TraceEvent::Mode(mode) => {
                log.line(at, || format!("mode {mode:?}"));
                self.mode = mode;
                self.restart();
            }
            TraceEvent::Target(target) => {
                log.detail(at, || format!("target {} followed {}", target.target, target.followed));
                self.check_target(&target);
            }
        }
    }

    fn restart(&mut self) {
        self.targets.clear();
        self.window.clear();
    }

    fn brake(&mut self, at_ns: u64, deceleration: f64) {
        let (position, mut velocity) = (self.position, self.velocity);
        // The drive brakes from the velocity of its demand. A target that took effect after the last sample
        // has set it, and no sample of the motor shows it.
        if let Some((_, target)) = self.targets.back().filter(|(then, _)| *then > self.sampled_ns)
            && matches!(
                self.mode,
                Some(OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition)
            )
        {
            let demand = (f64::from(*target) - position) / (self.target_ns / 1e9);
            velocity = velocity.abs().max(demand.abs());
        }
        self.braking = Some(Braking { at_ns, position, velocity, deceleration });
        self.restart();
    }

    fn check_enable(&mut self, at: u64) {
        match self.permit {
            Permit::None if self.stop.is_none() && at > self.late_enable_until => {
                let text = format!("at {:.0}/s in {:?}", self.velocity, self.mode);
                self.report(at, Kind::EnabledWithoutCommand, text);
            }
            // The drive took long to execute an earlier command; the present one continues.
            Permit::Enable if self.is_reading => {}
            Permit::Enable => self.permit = Permit::Used,
            // A frame that was sent before the stop takes effect after the one that arrived by SDO.
            Permit::None => self.late_enables += 1,
            Permit::Used | Permit::Procedure => {}
        }
    }
}
