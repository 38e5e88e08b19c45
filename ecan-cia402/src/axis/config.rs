//! Configuration of an axis: plain data.

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    CobId, FaultReaction, GuardingConfig, HaltOption, IdentityCheck, NodeAddress, NodeLossReaction,
    OperatingMode, ParameterSet, PdoDirection, PdoMapping, QuickStopOption, Step, StopOption,
    TransmissionType,
};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

use super::error::AxisFault;
use super::pdo_layout::{InputObject, OutputObject, PdoLayout, TargetObject};
use super::script::{MOST_AXES, axis_index};
use super::units::{MotionLimits, Scale, ScaleSource};
use crate::guard::feed_forward::FeedForwardLimits;
use crate::guard::terms::{GuardLimits, PositionRange, TargetKind};

/// Least following-error window, in step limits: the lag of an axis that moves at its limit, by the
/// delay out and back.
const WINDOW_STEPS: u32 = 8;

/// Highest PDO number of the predefined connection set.
pub(crate) const LAST_PDO: u16 = 4;

/// Most PDOs of a node in each direction.
const MOST_PDOS: u16 = 512;

/// Configuration of one axis: a row of the axis table.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisConfig {
    /// Address of the drive.
    pub address: NodeAddress,
    /// Axis of the node, 0 to 7, for a drive with several: its objects are 0x800 further for each (CiA
    /// 402-1). The axes of a node are rows of the table with the same address, each with PDOs of its own.
    /// What concerns the node (reset, identity, profile, heartbeats, guarding, parameters, other TPDOs) must
    /// be equal in all of them; they are configured together.
    pub node_axis: u8,
    /// Operating mode. It determines the content of the RPDO.
    pub mode: OperatingMode,
    /// Steps of the position counter per turn, for angles.
    pub scale: Scale,
    /// Origin of the scale: this configuration, compared with the drive if wanted, or the drive.
    pub scale_source: ScaleSource,
    /// Range of the position counter.
    pub range: PositionRange,
    /// Smallest and largest target, in steps or in units of velocity or torque.
    pub bounds: Option<(i32, i32)>,
    /// Longest distance of a target from the previous one, per
    /// [target period](crate::Cia402Config::target_cycles).
    /// Ignored in PP, PV and PT, in which the drive generates the motion.
    pub step_limit: u32,
    /// Longest distance of a position target from the actual position; at least eight step limits,
    /// since a moving axis lags by the delay of the communication.
    pub following_window: u32,
    /// Longest distance between two actual positions of an axis at rest, by noise. An axis that
    /// moves faster is not activated. At most the step limit.
    pub standstill: u32,
    /// Step per target period of [`send_target_step`](crate::Cia402::send_target_step).
    pub target_step: i32,
    /// Largest change per target period of a step that the host generates: for
    /// [`send_target_step`](crate::Cia402::send_target_step), halt and shutdown.
    pub ramp: u32,
    /// Limits in units of the machine. One that is set replaces `step_limit`, `ramp` or `bounds`, as
    /// its documentation says; none by default.
    pub limits: MotionLimits,
    /// Faults of the path to the drive that do not make the axis hold.
    pub tolerances: PathTolerances,
    /// Activates the axis again after it held for a reason on the path to a drive that stayed
    /// enabled; in CSP only, in which the drive rests until then. Otherwise only the application
    /// activates it. A drive that left Operation Enabled is never enabled automatically.
    pub auto_resume: bool,
    /// Longest time for enabling: brake and power stage.
    pub enable_timeout: Duration,
    /// PDOs and the objects that they carry.
    pub pdos: PdoConfig,
    /// Limits of the feed-forward that
    /// [`set_target_with`](crate::Target::with_feed_forward) gives.
    pub feed_forward: FeedForwardLimits,
    /// Configuration of the drive.
    pub drive: DriveConfig,
}

impl AxisConfig {
    /// Creates a CSP axis at an address, with a limit of 1000 steps per target.
    pub fn new(address: NodeAddress) -> Self {
        Self {
            address,
            node_axis: 0,
            mode: OperatingMode::CyclicPosition,
            scale: Scale::default(),
            scale_source: ScaleSource::default(),
            range: PositionRange::Linear,
            bounds: None,
            step_limit: 1_000,
            following_window: 10_000,
            standstill: 20,
            target_step: 0,
            ramp: 20,
            limits: MotionLimits::default(),
            tolerances: PathTolerances::default(),
            auto_resume: false,
            enable_timeout: Duration::from_secs(5),
            pdos: PdoConfig::default(),
            feed_forward: FeedForwardLimits::default(),
            drive: DriveConfig::default(),
        }
    }

    /// Sets the step per target, and limits that allow it.
    #[must_use]
    pub fn with_target_step(mut self, step: i32) -> Self {
        self.target_step = step;
        let limit = self.step_limit.max(step.unsigned_abs());
        self.with_step_limit(limit)
    }

    /// Sets the step limit, and a following-error window that is large enough for it.
    #[must_use]
    pub fn with_step_limit(mut self, limit: u32) -> Self {
        self.step_limit = limit;
        self.following_window = self.following_window.max(limit.saturating_mul(WINDOW_STEPS));
        self.standstill = self.standstill.min(limit);
        self
    }

    /// Sets the operating mode.
    #[must_use]
    pub fn with_mode(mut self, mode: OperatingMode) -> Self {
        self.mode = mode;
        self
    }

    /// Process data of the mode, with further objects. Allocates.
    pub fn layout(&self) -> PdoLayout {
        PdoLayout::new(TargetObject::of_mode(self.mode), &self.pdos.outputs, &self.pdos.inputs)
            .on_node_axis(self.node_axis)
    }

    /// Sets the axis of the node, and the number of its first PDOs.
    #[must_use]
    pub fn with_node_axis(mut self, axis: u8, pdo_number: u16) -> Self {
        (self.node_axis, self.pdos.number) = (axis, pdo_number);
        self
    }

    /// Index of an object of the axis in its node, by its index for the first axis (0x6000 to 0x67FF). Other
    /// objects belong to the node and keep their index.
    pub fn object_index(&self, index: u16) -> u16 {
        axis_index(self.node_axis, index)
    }

    /// CAN ID of an RPDO of the axis, 0 is the first.
    pub fn rpdo_id(&self, nth: usize) -> CanId {
        let predefined = || CobId::rpdo(self.address.node, self.predefined_number(nth)).can_id();
        self.pdos.cob_ids.rpdos.get(nth).copied().unwrap_or_else(predefined)
    }

    /// CAN ID of a TPDO of the axis, 0 is the first.
    pub fn tpdo_id(&self, nth: usize) -> CanId {
        let predefined = || CobId::tpdo(self.address.node, self.predefined_number(nth)).can_id();
        self.pdos.cob_ids.tpdos.get(nth).copied().unwrap_or_else(predefined)
    }

    /// Number of a PDO in the predefined connection set; a larger one is a fault of the configuration.
    fn predefined_number(&self, nth: usize) -> u8 {
        u8::try_from(usize::from(self.pdos.number) + nth).unwrap_or(u8::MAX)
    }

    /// The PDOs of the axis as they are mapped. Allocates.
    pub fn pdo_mappings(&self) -> Vec<PdoMapping> {
        let layout = self.layout();
        let pdo = |direction, nth, cob_id, entries| PdoMapping {
            direction,
            number: self.pdos.number.saturating_add(nth as u16),
            cob_id,
            transmission: TransmissionType::Synchronous(1),
            inhibit_time: None,
            event_timer_ms: None,
            sync_start: None,
            entries,
        };
        let received = (0..layout.rpdo_count()).map(|nth| {
            let entries = layout.rpdo_entries(nth).collect();
            pdo(PdoDirection::Receive, nth, self.rpdo_id(nth), entries)
        });
        let sent = (0..layout.tpdo_count()).map(|nth| {
            let entries = layout.tpdo_entries(nth).collect();
            pdo(PdoDirection::Transmit, nth, self.tpdo_id(nth), entries)
        });
        received.chain(sent).collect()
    }

    /// Limits of the motion guard in a mode, with `cycles_per_sync` cycles from SYNC to SYNC.
    pub fn guard_limits(&self, mode: OperatingMode, cycles_per_sync: u32) -> GuardLimits {
        let cycles = u16::try_from(cycles_per_sync.max(1)).unwrap_or(u16::MAX);
        let kind = target_kind(mode);
        let makes_its_own_way = !mode.is_cyclic();
        GuardLimits {
            kind,
            range: self.range,
            step: if makes_its_own_way { u32::MAX } else { self.step_limit },
            window: self.following_window,
            bounds: if kind == TargetKind::None { None } else { self.bounds },
            standstill: self.standstill,
            tpdo_timeout: self.tolerances.tpdo_timeout.saturating_mul(cycles),
            wc_misses: self.tolerances.wc_misses,
            drain_images: self.tolerances.drain_images,
        }
    }

    /// Returns whether another axis of the same node has the same settings of the node.
    pub(crate) fn shares_node_settings(&self, other: &Self) -> bool {
        let (own, other) = (&self.drive, &other.drive);
        own.reset == other.reset
            && own.boot_timeout == other.boot_timeout
            && own.identity == other.identity
            && own.expect_profile_402 == other.expect_profile_402
            && own.heartbeat_ms == other.heartbeat_ms
            && own.guarding == other.guarding
            && own.host_heartbeat_ms == other.host_heartbeat_ms
            && own.silence_other_tpdos == other.silence_other_tpdos
            && own.parameters == other.parameters
    }

    /// Returns whether the limits of the drive are read.
    pub(crate) fn reads_limits(&self) -> bool {
        let drive = &self.drive;
        drive.use_limits || drive.max_torque.is_some() || drive.max_motor_speed.is_some()
    }

    /// Returns whether the drive follows its targets only with the right interpolation time 0x60C2.
    pub(crate) fn needs_interpolation_time(&self) -> bool {
        matches!(self.mode, OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition)
    }

    /// Checks the configuration as a whole and reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(AxisFault)) {
        if usize::from(self.address.channel) >= CHANNELS {
            report(AxisFault::Channel { channel: self.address.channel });
        }
        if self.node_axis >= MOST_AXES {
            report(AxisFault::NodeAxis { node_axis: self.node_axis });
        }
        self.check_process_data(report);
        if let Some(guarding) = self.drive.guarding
            && !guarding.is_valid()
        {
            report(AxisFault::Guarding { guarding });
        }
        if !self.scale.is_valid() {
            report(AxisFault::Scale { steps_per_turn: self.scale.steps() });
        }
        if let Some(units) = self.scale.velocity_units()
            && !units.is_normal()
        {
            report(AxisFault::VelocityUnits { units });
        }
        if self.scale_source == ScaleSource::Drive && self.limits.iter().next().is_some() {
            report(AxisFault::ScaleSource);
        }
        self.check_limits(report);
        // With a velocity limit these follow from it.
        if target_kind(self.mode) != TargetKind::Position || self.limits.velocity.is_none() {
            self.check_steps(report);
        }
        if let Some((min, max)) = self.bounds
            && min > max
        {
            report(AxisFault::Bounds { min, max });
        } else if let Some((min, max)) = self.bounds
            && target_kind(self.mode) == TargetKind::Rate
            && !(min..=max).contains(&0)
        {
            report(AxisFault::RateBounds { min, max });
        }
        if let PositionRange::Modulo { min, max } = self.range
            && min >= max
        {
            report(AxisFault::Range { min, max });
        }
        if self.tolerances.tpdo_timeout == 0 {
            report(AxisFault::TpdoTimeout);
        }
    }

    fn check_process_data(&self, report: &mut dyn FnMut(AxisFault)) {
        let layout = self.layout();
        let first = self.pdos.number;
        let directions = [
            (layout.rpdo_count(), self.pdos.cob_ids.rpdos.len()),
            (layout.tpdo_count(), self.pdos.cob_ids.tpdos.len()),
        ];
        let ends_in = |count, most| usize::from(first) + count - 1 <= usize::from(most);
        let is_in = |most| first > 0 && ends_in(1, most);
        let most = |ids| if ids > 0 { MOST_PDOS } else { LAST_PDO };
        if directions.iter().any(|(_, ids)| !is_in(most(*ids))) {
            report(AxisFault::PdoNumber { number: first });
        }
        for (count, ids) in directions {
            if ids == 0 && count > 1 && !ends_in(count, LAST_PDO) {
                report(AxisFault::PdoCount { first, count });
            } else if ids > 0 && ids != count {
                report(AxisFault::CobIdCount { found: ids, count });
            }
        }
        for cob_id in self.pdos.cob_ids.invalid() {
            report(AxisFault::CobId { cob_id });
        }
        let mode = self.mode;
        for output in self.pdos.outputs.iter().copied() {
            if !output.serves(mode) {
                report(AxisFault::OutputMode { output, mode });
            }
            let limits = &self.feed_forward;
            let is_limited = match output {
                OutputObject::VelocityOffset => limits.velocity.min(limits.velocity_change) > 0,
                OutputObject::TorqueOffset => limits.torque.min(limits.torque_change) > 0,
                _ => true,
            };
            if !is_limited {
                report(AxisFault::FeedForwardLimit { output });
            }
            let needs_status = output == OutputObject::ProbeFunction;
            if needs_status && layout.tpdo_of(InputObject::ProbeStatus).is_none() {
                report(AxisFault::ProbeStatus);
            }
        }
    }

    fn check_steps(&self, report: &mut dyn FnMut(AxisFault)) {
        if self.step_limit == 0 {
            report(AxisFault::NoStep);
        }
        if self.target_step.unsigned_abs() > self.step_limit {
            report(AxisFault::TargetStep { step: self.target_step, limit: self.step_limit });
        }
        if self.standstill > self.step_limit {
            report(AxisFault::Standstill { standstill: self.standstill, limit: self.step_limit });
        }
        let least = self.step_limit.saturating_mul(WINDOW_STEPS);
        if target_kind(self.mode) == TargetKind::Position && self.following_window < least {
            report(AxisFault::Window { window: self.following_window, least });
        }
    }
}

pub(crate) fn target_kind(mode: OperatingMode) -> TargetKind {
    match mode {
        OperatingMode::Homing => TargetKind::None,
        OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => TargetKind::Position,
        OperatingMode::ProfilePosition => TargetKind::Profile,
        OperatingMode::Velocity
        | OperatingMode::ProfileVelocity
        | OperatingMode::ProfileTorque
        | OperatingMode::CyclicVelocity
        | OperatingMode::CyclicTorque => TargetKind::Rate,
    }
}

/// Reset of a node at the start of its configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NodeReset {
    /// None; the node is commanded to Pre-operational.
    #[default]
    None,
    /// Reset Communication: parameters of 0x1000.. as at power-on.
    Communication,
    /// Reset Node.
    Node,
}

/// Parameters of the velocity mode (VL) in a drive; `None` does not write an object. Velocities are
/// those of 0x6042, by default revolutions per minute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VlConfig {
    /// Smallest and largest amount of the velocity, 0x6046:01 and :02.
    pub limits: Option<(u32, u32)>,
    /// Acceleration 0x6048: change of the velocity, and its time in seconds.
    pub acceleration: Option<(u32, u16)>,
    /// Deceleration 0x6049: change of the velocity, and its time in seconds.
    pub deceleration: Option<(u32, u16)>,
}

/// Configuration of a drive before it is enabled. Objects marked (optional) are skipped if the
/// drive does not have them.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveConfig {
    /// Reset at the start.
    pub reset: NodeReset,
    /// Longest time for the boot-up message after a reset.
    pub boot_timeout: Duration,
    /// Identity that it must have.
    pub identity: IdentityCheck,
    /// True if the low half of 0x1000 must be 402.
    pub expect_profile_402: bool,
    /// Producer heartbeat time 0x1017 in milliseconds (optional); 0 disables it. The host
    /// watches it with three and a half times this value.
    pub heartbeat_ms: u16,
    /// Node guarding in both directions (CiA 301, 7.2.8.3.2.1) in place of the producer heartbeat, for
    /// a drive that has none: `heartbeat_ms` is not used then, and 0x1017 is set to 0. The host guards
    /// the drive from the end of its configuration on, and the drive detects by the requests that the
    /// host has stopped. `None` uses the heartbeat.
    pub guarding: Option<GuardingConfig>,
    /// Consumer heartbeat time of the host, 0x1016:01, in milliseconds (optional); 0 does not
    /// write the object. By it a drive detects that the host has stopped.
    pub host_heartbeat_ms: u16,
    /// Reaction of the drive to that, 0x6007 (optional); `None` does not write the object.
    pub host_loss: Option<NodeLossReaction>,
    /// Quick stop option 0x605A (optional); `None` does not write it.
    pub quick_stop: Option<QuickStopOption>,
    /// Shutdown option 0x605B (optional); `None` does not write it.
    pub shutdown: Option<StopOption>,
    /// Disable operation option 0x605C (optional), by which a disabled axis stops; `None` does not
    /// write it.
    pub disable_operation: Option<StopOption>,
    /// Halt option 0x605D (optional), by which an axis halts in PP, PV and PT; `None` does not
    /// write it.
    pub halt: Option<HaltOption>,
    /// Fault reaction option 0x605E (optional); `None` does not write it.
    pub fault_reaction: Option<FaultReaction>,
    /// Following error window 0x6065 in steps and time 0x6066 in milliseconds (optional); `None`
    /// does not write them, so that a window of the drive's commissioning stays in force; a larger one
    /// here would widen it. Should not be below [`AxisConfig::following_window`](crate::AxisConfig::following_window) in normal motion.
    ///
    /// The drive protects here against what the host cannot prevent: a drive that receives several targets at once
    /// after a fault of the bus moves faster than the step limit for up to one target period (see
    /// [`Cia402`](crate::Cia402)), and stops with a fault if its motor does not follow.
    pub following_error: Option<(u32, u16)>,
    /// Mask of the digital outputs 0x60FE:02: a bit that is set lets the host set this output. `None`
    /// does not write it.
    pub output_mask: Option<u32>,
    /// Set-points that wait in the drive in IP, 0x60C4:02; `None` leaves it as it is. When targets end,
    /// the drive still goes through those that wait: at most this number of step limits.
    pub interpolation_buffer: Option<u16>,
    /// Torque slope of PT, 0x6087, in thousandths of the rated torque per second; `None` does not
    /// write it.
    pub torque_slope: Option<u32>,
    /// Limits and ramps of VL.
    pub vl: VlConfig,
    /// Writes [`AxisConfig::bounds`](crate::AxisConfig::bounds) to 0x607D too, in a position mode (optional).
    pub write_position_limits: bool,
    /// Largest torque 0x6072, in thousandths of the rated torque; `None` does not write it.
    pub max_torque: Option<u16>,
    /// Largest speed of the motor 0x6080, in revolutions per minute; `None` does not write it.
    pub max_motor_speed: Option<u32>,
    /// Reads 0x6072, 0x607D and 0x6080, and narrows the limits of the axis to those of the drive:
    /// bounds in position and torque modes, in CSP and IP the step limit, in CSV and PV the bounds, by
    /// the motor speed and the [units](crate::DriveUnits) of the drive. Also done if one of the two above is
    /// set. The limits of the axis are never widened.
    pub use_limits: bool,
    /// Disables the other TPDOs (optional), so that they take no bus time.
    pub silence_other_tpdos: bool,
    /// Values that are written, and read back, before the mapping, for example those of a DCF. What
    /// the axis configures itself, it writes afterwards.
    pub parameters: Arc<ParameterSet>,
    /// Further steps, done after the mapping and before the mode, while Pre-operational.
    pub further: Vec<Step>,
}

impl Default for DriveConfig {
    /// No reset; heartbeats of 100 ms from the drive, a consumer time of 250 ms for the host's, and a
    /// quick stop if the host is lost.
    fn default() -> Self {
        Self {
            reset: NodeReset::None,
            boot_timeout: Duration::from_secs(5),
            identity: IdentityCheck::default(),
            expect_profile_402: true,
            heartbeat_ms: 100,
            guarding: None,
            host_heartbeat_ms: 250,
            host_loss: Some(NodeLossReaction::QuickStop),
            quick_stop: None,
            shutdown: None,
            disable_operation: None,
            halt: None,
            fault_reaction: None,
            following_error: None,
            output_mask: None,
            interpolation_buffer: None,
            torque_slope: None,
            vl: VlConfig::default(),
            write_position_limits: false,
            max_torque: None,
            max_motor_speed: None,
            use_limits: false,
            silence_other_tpdos: true,
            parameters: Arc::default(),
            further: Vec::new(),
        }
    }
}

/// Faults of the path to a drive that an axis tolerates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathTolerances {
    /// Tolerated SYNC periods in a row without a usable TPDO; 5 by default.
    pub tpdo_timeout: u16,
    /// Tolerated cycles in a row with an incomplete working counter; in these the Port repeats the
    /// last image, and no target is sent. 3 by default.
    pub wc_misses: u16,
    /// Fewest new images that must be received while old targets drain; 3 by default.
    pub drain_images: u16,
}

impl Default for PathTolerances {
    fn default() -> Self {
        Self { tpdo_timeout: 5, wc_misses: 3, drain_images: 3 }
    }
}

/// PDOs of an axis.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PdoConfig {
    /// Number of the first RPDO and of the first TPDO, 1 to 512; 1 by default. Further ones have the next
    /// numbers. Numbers above 4 need [`cob_ids`](Self::cob_ids). (CiA 301 begins with 64 n + 1 for axis n of a
    /// node.)
    pub number: u16,
    /// COB-IDs of the PDOs; by default those of the predefined connection set.
    pub cob_ids: PdoCobIds,
    /// Objects that the RPDOs carry beyond controlword and target, none by default. See
    /// [`PdoLayout`] for their places. A feed-forward object needs its limits in
    /// [`AxisConfig::feed_forward`].
    pub outputs: Vec<OutputObject>,
    /// Objects that the TPDOs carry beyond statusword and actual position, none by default;
    /// [`AxisStatus::inputs`](crate::AxisStatus::inputs) has their values.
    pub inputs: Vec<InputObject>,
}

impl Default for PdoConfig {
    fn default() -> Self {
        let cob_ids = PdoCobIds::default();
        Self { number: 1, cob_ids, outputs: Vec::new(), inputs: Vec::new() }
    }
}

/// COB-IDs of the PDOs of an axis, in the order of their numbers. An empty list stands for those of the
/// predefined connection set (CiA 301, 7.3.3), which has PDOs 1 to 4 of a node.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PdoCobIds {
    /// COB-IDs of the RPDOs, 0x181 to 0x57F.
    pub rpdos: Vec<CanId>,
    /// COB-IDs of the TPDOs, 0x181 to 0x57F.
    pub tpdos: Vec<CanId>,
}

/// CAN IDs of PDOs: those that no other service of CiA 301 has.
const ALLOWED: std::ops::RangeInclusive<u32> = 0x181..=0x57F;

impl PdoCobIds {
    /// All COB-IDs that are no CAN ID of a PDO.
    pub(crate) fn invalid(&self) -> impl Iterator<Item = CanId> + '_ {
        let is_allowed = |id: &CanId| !id.is_extended() && ALLOWED.contains(&id.raw());
        self.rpdos.iter().chain(&self.tpdos).copied().filter(move |id| !is_allowed(id))
    }
}

/// Treatment of a drive that is enabled when a [`Cia402`](crate::Cia402) begins to command it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Takeover {
    /// The drive is quick-stopped, and switched off at rest.
    #[default]
    Stop,
    /// The drive remains enabled if it is at rest, displays the configured mode, has the process data of the
    /// configuration, and obeys a target that keeps it at standstill: velocity 0 in CSV, PV and VL, a
    /// set-point at its position in PP, in CSP the target that it has. The target in CSP and the demand (0x6062) in PP
    /// must be within the step limit of the position. The target is read back by SDO
    /// before and after the first SYNC. Only then the axis counts as configured, and no target of an
    /// earlier owner is in force. Otherwise, and in the torque modes and IP, the drive is stopped; also one with a quick
    /// stop option (0x605A) above 4, which a frame of the adoption would enable again after a quick stop of its own. A
    /// drive that watches the host's heartbeat must be adopted within its consumer time (0x1016).
    Adopt,
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::NodeId;

    fn config() -> AxisConfig {
        let node = NodeId::new(1).unwrap();
        AxisConfig::new(NodeAddress { slave: 0, channel: 0, node })
    }

    fn faults(config: &AxisConfig) -> Vec<AxisFault> {
        let mut faults = Vec::new();
        config.check(&mut |fault| faults.push(fault));
        faults
    }

    #[test]
    fn default_configuration_has_no_faults() {
        assert_eq!(faults(&config()), []);
        assert_eq!(faults(&config().with_target_step(-5_000)), []);
        assert_eq!(faults(&config().with_step_limit(3)), []);
        for &mode in OperatingMode::ALL {
            assert_eq!(faults(&config().with_mode(mode)), [], "{mode}");
        }
    }

    #[test]
    fn check_reports_every_fault() {
        let mut bad = config();
        bad.address.channel = 4;
        bad.pdos.outputs = vec![OutputObject::TorqueOffset];
        bad.pdos.number = 0;
        bad.scale = Scale::steps_per_turn(0.0);
        bad.step_limit = 0;
        bad.target_step = 1;
        bad.following_window = 0;
        bad.bounds = Some((1, 0));
        bad.range = PositionRange::Modulo { min: 0, max: 0 };
        bad.tolerances.tpdo_timeout = 0;
        assert_eq!(faults(&bad).len(), 10, "{:?}", faults(&bad));
        bad.bounds = Some((1, 2));
        bad.mode = OperatingMode::CyclicVelocity;
        assert!(faults(&bad).contains(&AxisFault::RateBounds { min: 1, max: 2 }));
        bad.mode = OperatingMode::CyclicPosition;
        bad.step_limit = 100;
        assert!(faults(&bad).contains(&AxisFault::Window { window: 0, least: 800 }));
    }

    #[test]
    fn guard_limits_depend_on_the_mode() {
        let limits = config().guard_limits(OperatingMode::CyclicPosition, 2);
        assert_eq!(
            (limits.kind, limits.step, limits.tpdo_timeout),
            (TargetKind::Position, 1000, 10)
        );
        let limits = config().guard_limits(OperatingMode::CyclicTorque, 1);
        assert_eq!((limits.kind, limits.step), (TargetKind::Rate, 1000));
        let limits = config().guard_limits(OperatingMode::ProfileVelocity, 1);
        assert_eq!((limits.kind, limits.step), (TargetKind::Rate, u32::MAX));
        assert_eq!(target_kind(OperatingMode::ProfilePosition), TargetKind::Profile);
        assert_eq!(target_kind(OperatingMode::Homing), TargetKind::None);
    }
}
