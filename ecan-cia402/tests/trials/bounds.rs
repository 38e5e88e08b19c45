//! Bounds of docs/SAFETY.md, from the parameters of a plan: one function for each bound, in the order of that
//! page, with the same symbols. Times are in nanoseconds.

use ecan_canopen::OperatingMode;
use ecan_cia402::{AxisConfig, OutputObject};

use crate::plan::{AxisPlan, MS, Plan};
use crate::variants;

/// B: time of the frames that a channel has in a cycle, 15 of 130 us at 1 Mbit/s, before a command.
const BUS_NS: u64 = 2 * MS;
/// Transfers of a stop by SDO: one that runs, two of the first contact, and the command.
const TRANSFERS: u64 = 4;
const RESERVE_NS: u64 = 60 * MS;
/// An attempt without a response is repeated after this time.
const RETRY_NS: u64 = 100 * MS;
/// Every fourth attempt waits for this time instead, and those of a configuration do.
const PATIENT_NS: u64 = 500 * MS;
const PATIENT_ATTEMPT: u64 = 4;
/// Time with reports after which a quick stop counts as ignored.
const IGNORED_NS: u64 = 250 * MS;
/// Time in which a drive may come to rest to be adopted.
const ADOPTION_NS: u64 = 200 * MS;
/// Time after which a drive that reports nothing is out of reach, and the same in SYNC periods.
const OUT_OF_REACH_NS: u64 = 100 * MS;
const OUT_OF_REACH_PERIODS: u64 = 15;

/// The position controller of the simulated drive (gain 200/s, period 1 ms) adds 0.2 of a change of
/// velocity that it could not follow within one period; the targets of an application that reverses
/// at the limit change it by twice the limit, of which the motor follows one half at once.
const OVERSHOOT: f64 = 1.22;
/// Gain of the position controller of the simulated drive, 1/s.
const POSITION_GAIN: f64 = 200.0;
/// A target takes effect when its SYNC arrives. Other frames on the bus shift it: with four axes on a
/// channel by up to eight frames of 130 us, of which the host evens out the regular part. The drive begins its
/// interpolation where it is, so a target that comes earlier by this time than one period makes the motion
/// faster.
const SYNC_JITTER_NS: f64 = 0.35e6;
/// Shift of the times of targets by other frames on the bus, in target periods.
const TARGET_JITTER: f64 = 0.35;
/// Noise of one increment of a target, per controller period.
const ROUNDING: f64 = 2_000.0;
/// The following error of the motor may change by this time of motion at the limit: it cannot
/// follow within one period, and the position controller needs 5 ms (1 / gain) to reduce it.
const LAG_S: f64 = 0.005;
/// 0x6081 of the simulated drive: a tenth of its maximum velocity.
const PROFILE_VELOCITY: f64 = 655_360.0;
/// After a stop the position controller of the simulated drive brings the motor to rest: sixteen time
/// constants.
const SETTLE_S: f64 = 0.080;
/// Acceleration of the simulated motor per thousandth of its rated torque, in its controller period of
/// 1 ms, increments per second.
const PER_MILLE_PERIOD: f64 = 200_000_000.0 / 3_000.0 / 1_000.0;

/// Increments per revolution of the simulated motor.
const INCREMENTS: i32 = 65_536;

/// Lost attempts of a stop by SDO.
#[derive(Debug, Clone, Copy, Default)]
pub struct LostAttempts {
    /// The first one was lost before the path was clear; it may have been a patient one.
    pub first: bool,
    pub further: u64,
    /// Those of them that a configuration waited for.
    pub by_configuration: u64,
}

/// Parameters of an axis that its bounds depend on.
pub struct Bounds {
    /// C, S and T: cycle, SYNC period and target period.
    cycle_ns: u64,
    sync_ns: u64,
    target_ns: u64,
    /// P: longest wait of a scheduled frame for its phase, two periods of Sync0, and S if SYNC leaves first.
    phase_ns: u64,
    /// G: service period of a gateway with a clock of its own.
    service_ns: u64,
    /// R: response time of the drive's SDO server.
    response_ns: u64,
    /// Axes of the node.
    node_axes: u64,
    tpdo_timeout: u64,
    ignores_quick_stop: bool,
    /// Time in which the brake opens.
    brake_ns: u64,
    step_limit: f64,
    standstill: f64,
    /// Highest amount of a target in modes without positions.
    highest: f64,
    /// Deviation of the velocity by the feed-forward, increments per second, and of the position.
    feed_forward: f64,
    feed_forward_distance: f64,
    halt_ns: u64,
}

impl Bounds {
    pub fn new(plan: &Plan, axis: usize) -> Self {
        let AxisPlan { config, drive, .. } = &plan.axes[axis];
        Self {
            cycle_ns: plan.cycle_ns,
            sync_ns: plan.sync_ns(),
            target_ns: plan.target_ns(),
            phase_ns: if plan.schedules_frames() { 2 * plan.cycle_ns } else { 0 }
                + if plan.has_sync_first() { plan.sync_ns() } else { 0 },
            service_ns: variants::service_period_ns(&plan.variants),
            response_ns: u64::from(drive.sdo_delay_us) * 1_000,
            node_axes: plan.axes_of_node(axis).count() as u64,
            tpdo_timeout: config.tolerances.tpdo_timeout.into(),
            ignores_quick_stop: drive.quirks.ignores_quick_stop,
            brake_ns: u64::from(drive.enable_ms) * MS,
            step_limit: config.step_limit.into(),
            standstill: config.standstill.into(),
            highest: range(config).map_or(f64::MAX, |(low, high)| {
                f64::from(low.unsigned_abs().max(high.unsigned_abs()))
            }),
            feed_forward: feed_forward_deviation(config, plan.target_ns() as f64),
            feed_forward_distance: feed_forward_distance(config),
            halt_ns: halt_ns(plan, axis),
        }
    }

    // Stops

    /// S + 4 C + P + G + B. The call follows the send of its cycle (C), the image is on the path (C), the host
    /// sees a clear path up to two images late (2 C), and one SYNC may be missed (S). The gateway serves the frame (G) and
    /// holds it for its phase (P); the frames of a cycle are before it on the bus (B).
    pub fn stop_by_process_data_ns(&self) -> u64 {
        self.sync_ns + 4 * self.cycle_ns + self.phase_ns + self.service_ns + BUS_NS
    }

    /// 12 C + 8 R + 60 ms: four transfers of 3 C + 2 R, and a reserve, which is not derived. An axis of a node with
    /// others may find its server in use.
    pub fn stop_by_sdo_ns(&self, lost: LostAttempts) -> u64 {
        let transfer = 3 * self.cycle_ns + 2 * self.response_ns;
        let further_axes = (self.node_axes - 1) * RETRY_NS;
        TRANSFERS * transfer + RESERVE_NS + further_axes + self.lost_ns(lost)
    }

    fn lost_ns(&self, lost: LostAttempts) -> u64 {
        let repetition = RETRY_NS + 2 * self.cycle_ns;
        let first = if lost.first { PATIENT_NS + RETRY_NS + 20 * MS } else { 0 };
        let patient = lost.further / PATIENT_ATTEMPT + lost.by_configuration;
        first + lost.further * repetition + patient * (PATIENT_NS - RETRY_NS)
    }

    /// Additional time of a drive that ignores the quick stop, which is optional in CiA 402: 250 ms with reports, and
    /// the time of the next command, `bound_ns`. 0 for others.
    pub fn ignored_stop_ns(&self, bound_ns: u64) -> u64 {
        if self.ignores_quick_stop { IGNORED_NS + bound_ns } else { 0 }
    }

    pub fn ignores_quick_stop(&self) -> bool {
        self.ignores_quick_stop
    }

    /// S + 4 C + P + G + B and the time of the brake: a command to enable that left an owner before its stop, which did
    /// not leave because the owner ended.
    pub fn late_enable_ns(&self) -> u64 {
        self.stop_by_process_data_ns() + self.brake_ns
    }

    /// 200 ms + 20 ms: time in which the next owner waits for rest, and that of the last positions before.
    pub fn adoption_ns(&self) -> u64 {
        ADOPTION_NS + 20 * MS
    }

    /// (N + 2) S + 6 C + P + G: the N tolerated SYNC periods, the one in progress and the one whose TPDO still
    /// arrives, with the images and the phase on the path.
    pub fn loss_detected_ns(&self) -> u64 {
        (self.tpdo_timeout + 2) * self.sync_ns + 6 * self.cycle_ns + self.phase_ns + self.service_ns
    }

    /// max(100 ms, 15 S) + 50 ms: a drive that moves without targets is out of reach, or is stopped, if it obeys.
    pub fn uncontrolled_ns(&self) -> u64 {
        let out_of_reach = OUT_OF_REACH_NS.max(OUT_OF_REACH_PERIODS * self.sync_ns);
        let stop_ns = self.stop_by_sdo_ns(LostAttempts::default());
        (stop_ns + self.ignored_stop_ns(stop_ns)).max(out_of_reach + 50 * MS)
    }

    /// Longest time of a halt.
    pub fn halt_ns(&self) -> u64 {
        self.halt_ns
    }

    /// v / a + 80 ms: the ramp, and sixteen time constants of the position controller.
    pub fn rest_s(&self, speed: f64, deceleration: f64) -> f64 {
        speed / deceleration + SETTLE_S
    }

    /// v^2 / (2 a) + 10 ms v, the way back from a feed-forward, and 500 increments of rounding and friction.
    pub fn stop_distance(&self, speed: f64, deceleration: f64) -> f64 {
        speed * speed / (2.0 * deceleration)
            + speed * 2.0 * LAG_S
            + self.feed_forward_distance
            + 500.0
    }

    // Targets

    /// 2 standstill windows: one of the positions that show rest, one until the first target takes effect. A step
    /// limit more for each of the `lost` targets before it.
    pub fn first_target(&self, lost: f64) -> f64 {
        2.0 * self.standstill + self.step_limit * lost
    }

    /// Velocity limit V of an axis: step limit / T.
    pub fn limit(&self) -> f64 {
        self.step_limit / self.target_s()
    }

    fn target_s(&self) -> f64 {
        self.target_ns as f64 / 1e9
    }

    /// V (1.22 (1 + (0.35 ms + G) / T) n + e): n targets in a period, which jitter shortens, at a drive whose
    /// position controller adds 0.22; after a late target it runs ahead by e = 1 - exp(-T / 10 ms).
    pub fn velocity(&self, together: f64, is_late: bool) -> f64 {
        let jitter = 1.0 + (SYNC_JITTER_NS + self.service_ns as f64) / self.target_ns as f64;
        let ahead = 1.0 - (-POSITION_GAIN * self.target_s() / 2.0).exp();
        let late = if is_late { ahead } else { 0.0 };
        self.limit() * (OVERSHOOT * jitter * together + late) + ROUNDING + self.feed_forward
    }

    /// Travel in a time: V t, one target more at its edge, and the change of the lag.
    pub fn travel(&self, seconds: f64, together: f64) -> f64 {
        self.limit() * (seconds + LAG_S * together)
            + self.step_limit * together
            + self.first_target(0.0)
            + self.feed_forward * LAG_S * 2.0
    }

    /// Change of the velocity in CSV: a step limit for each target in the time, and for one at its edge.
    pub fn gain(&self, seconds: f64, released: f64) -> f64 {
        let targets = (seconds / self.target_s()).ceil() + 1.0 + released;
        self.step_limit * targets + ROUNDING + self.feed_forward
    }

    /// Velocity in modes with a velocity as target: the bounds of the axis and 2 %.
    pub fn speed(&self) -> f64 {
        self.highest * 1.02 + ROUNDING + self.feed_forward
    }

    /// Torque in modes with a torque as target, thousandths.
    pub fn torque(&self) -> f64 {
        self.highest + 1.0
    }

    /// Velocity in PP: that of the drive's own profile.
    pub fn profile_velocity(&self) -> f64 {
        PROFILE_VELOCITY * OVERSHOOT
    }

    /// Distance of a target from the `nth` one before, which took effect `passed_ns` earlier: a step limit for each
    /// period, and for each of the targets at most; after a disturbance `released` more, and `dropped` more for each
    /// scheduled target.
    pub fn step(&self, nth: usize, passed_ns: u64, released: f64, dropped: f64) -> f64 {
        let jitter = TARGET_JITTER + self.service_ns as f64 / self.target_ns as f64;
        let periods = (passed_ns as f64 / self.target_ns as f64 + jitter).floor().max(1.0);
        let targets = (nth + 1) as f64 * (1.0 + dropped);
        self.step_limit * (periods.min(targets) + released)
    }
}

/// Range of the targets of an axis, in increments or increments per second.
pub fn range(config: &AxisConfig) -> Option<(i32, i32)> {
    match config.mode {
        // Targets are revolutions per minute.
        OperatingMode::Velocity => {
            config.bounds.map(|(low, high)| (low * INCREMENTS / 60, high * INCREMENTS / 60))
        }
        _ => config.bounds,
    }
}

/// Most that a feed-forward can add to the velocity of the simulated motor, increments per second.
///
/// The position controller takes back a constant offset within some periods; each change of the
/// offset in a target period adds what is not taken back yet. A feed-forward that ends at once does
/// so with the targets. An offset of torque acts for one controller period.
fn feed_forward_deviation(config: &AxisConfig, target_ns: f64) -> f64 {
    let limits = &config.feed_forward;
    let has = |output| config.pdos.outputs.contains(&output);
    let mut deviation = 0.0;
    if has(OutputObject::VelocityOffset) {
        let kept = (-POSITION_GAIN * target_ns / 1e9).exp();
        let change = f64::from(limits.velocity_change);
        deviation += (change / (1.0 - kept)).min(2.0 * f64::from(limits.velocity));
    }
    if has(OutputObject::TorqueOffset) {
        deviation += 2.0 * f64::from(limits.torque) * PER_MILLE_PERIOD;
    }
    deviation
}

/// Distance from its last target at which a motor with a feed-forward rests, increments: the velocity that
/// the feed-forward adds, over the gain of the position controller. A stop ends the feed-forward, and the motor
/// returns by this.
fn feed_forward_distance(config: &AxisConfig) -> f64 {
    if config.mode != OperatingMode::CyclicPosition {
        return 0.0;
    }
    let limits = &config.feed_forward;
    let has = |output| config.pdos.outputs.contains(&output);
    let mut added = 0.0;
    if has(OutputObject::VelocityOffset) {
        added += f64::from(limits.velocity);
    }
    if has(OutputObject::TorqueOffset) {
        added += f64::from(limits.torque) * PER_MILLE_PERIOD;
    }
    added / POSITION_GAIN
}

/// Longest time in which a halted axis comes to rest: by its ramp or step limit, twice that for
/// the rounded ends of a ramp, or by the drive's deceleration or friction.
fn halt_ns(plan: &Plan, axis: usize) -> u64 {
    let AxisPlan { config, drive, .. } = &plan.axes[axis];
    let limit = u64::from(config.step_limit.max(1));
    let bound = config.bounds.map_or(0, |(_, high)| u64::from(high.unsigned_abs()));
    let targets = match config.mode {
        OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => {
            2 * limit / u64::from(config.ramp.max(1)) + 8
        }
        OperatingMode::CyclicVelocity | OperatingMode::CyclicTorque => bound / limit,
        _ => 0,
    };
    // In CST the velocity is what torque and friction left: at most that of the motor.
    let drive_ns = match config.mode {
        // 0x6084 of the simulated drive is a twentieth of its highest acceleration; in VL 0x6049 is
        // 100 revolutions per minute in 17 ms, but the halt uses 0x6084.
        OperatingMode::ProfileTorque => {
            let deceleration = u64::from(drive.motor.max_acceleration / 20);
            u64::from(drive.motor.max_velocity) * 1_000 * MS / deceleration
        }
        OperatingMode::CyclicTorque => {
            u64::from(drive.motor.max_velocity) * 1_000 * MS / u64::from(drive.motor.friction)
        }
        _ => 100 * MS,
    };
    (targets + 2) * plan.target_ns() + drive_ns + 200 * MS
}
