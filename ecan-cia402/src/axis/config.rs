//! Configuration of an axis: plain data.

use std::time::Duration;

use ecan_canopen::{CobId, NodeAddress, OperatingMode, PdoDirection, PdoMapping, TransmissionType};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

use super::axis_fault::AxisFault;
use super::drive_config::DriveConfig;
use super::drive_units::ScaleSource;
use super::input_object::InputObject;
use super::motion_limits::MotionLimits;
use super::node_axis::{MOST_AXES, axis_index};
use super::output_object::OutputObject;
use super::pdo_cob_ids::PdoCobIds;
use super::pdo_layout::{PdoLayout, TargetObject};
use super::units::Scale;
use crate::guard::feed_forward::FeedForwardLimits;
use crate::guard::position_range::PositionRange;
use crate::guard::terms::{GuardLimits, TargetKind};

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
    /// Tolerated SYNC periods in a row without a usable TPDO.
    pub tpdo_timeout: u16,
    /// Tolerated cycles in a row with an incomplete working counter; in these the Port repeats the
    /// last image, and no target is sent.
    pub wc_misses: u16,
    /// Fewest new images that must be received while old targets drain.
    pub drain_images: u16,
    /// Activates the axis again after it held for a reason on the path to a drive that stayed
    /// enabled; in CSP only, in which the drive rests until then. Otherwise only the application
    /// activates it. A drive that left Operation Enabled is never enabled automatically.
    pub auto_resume: bool,
    /// Longest time for enabling: brake and power stage.
    pub enable_timeout: Duration,
    /// Number of the first RPDO and of the first TPDO, 1 to 512. Further ones have the next numbers.
    /// Numbers above 4 need [`cob_ids`](Self::cob_ids). (CiA 301 begins with 64 n + 1 for axis n of a node.)
    pub pdo_number: u16,
    /// COB-IDs of the PDOs; by default those of the predefined connection set.
    pub cob_ids: PdoCobIds,
    /// Objects that the RPDOs carry beyond controlword and target, none by default. See
    /// [`PdoLayout`] for their places. A feed-forward object needs its limits in
    /// [`feed_forward`](Self::feed_forward).
    pub outputs: Vec<OutputObject>,
    /// Objects that the TPDOs carry beyond statusword and actual position, none by default;
    /// [`AxisStatus::inputs`](crate::AxisStatus::inputs) has their values.
    pub inputs: Vec<InputObject>,
    /// Limits of the feed-forward that
    /// [`set_target_with`](crate::Cia402::set_target_with) gives.
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
            tpdo_timeout: 5,
            wc_misses: 3,
            drain_images: 3,
            auto_resume: false,
            enable_timeout: Duration::from_secs(5),
            pdo_number: 1,
            cob_ids: PdoCobIds::default(),
            outputs: Vec::new(),
            inputs: Vec::new(),
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
        PdoLayout::new(TargetObject::of_mode(self.mode), &self.outputs, &self.inputs)
            .on_node_axis(self.node_axis)
    }

    /// Sets the axis of the node, and the number of its first PDOs.
    #[must_use]
    pub fn with_node_axis(mut self, axis: u8, pdo_number: u16) -> Self {
        (self.node_axis, self.pdo_number) = (axis, pdo_number);
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
        self.cob_ids.rpdos.get(nth).copied().unwrap_or_else(predefined)
    }

    /// CAN ID of a TPDO of the axis, 0 is the first.
    pub fn tpdo_id(&self, nth: usize) -> CanId {
        let predefined = || CobId::tpdo(self.address.node, self.predefined_number(nth)).can_id();
        self.cob_ids.tpdos.get(nth).copied().unwrap_or_else(predefined)
    }

    /// Number of a PDO in the predefined connection set; a larger one is a fault of the configuration.
    fn predefined_number(&self, nth: usize) -> u8 {
        u8::try_from(usize::from(self.pdo_number) + nth).unwrap_or(u8::MAX)
    }

    /// The PDOs of the axis as they are mapped. Allocates.
    pub fn pdo_mappings(&self) -> Vec<PdoMapping> {
        let layout = self.layout();
        let pdo = |direction, nth, cob_id, entries| PdoMapping {
            direction,
            number: self.pdo_number.saturating_add(nth as u16),
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
            tpdo_timeout: self.tpdo_timeout.saturating_mul(cycles),
            wc_misses: self.wc_misses,
            drain_images: self.drain_images,
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
        if self.tpdo_timeout == 0 {
            report(AxisFault::TpdoTimeout);
        }
    }

    fn check_process_data(&self, report: &mut dyn FnMut(AxisFault)) {
        let layout = self.layout();
        let first = self.pdo_number;
        let directions = [
            (layout.rpdo_count(), self.cob_ids.rpdos.len()),
            (layout.tpdo_count(), self.cob_ids.tpdos.len()),
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
        for cob_id in self.cob_ids.invalid() {
            report(AxisFault::CobId { cob_id });
        }
        let mode = self.mode;
        for output in self.outputs.iter().copied() {
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
        bad.outputs = vec![OutputObject::TorqueOffset];
        bad.pdo_number = 0;
        bad.scale = Scale::steps_per_turn(0.0);
        bad.step_limit = 0;
        bad.target_step = 1;
        bad.following_window = 0;
        bad.bounds = Some((1, 0));
        bad.range = PositionRange::Modulo { min: 0, max: 0 };
        bad.tpdo_timeout = 0;
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
