//! Faults of a configuration, and errors of commands to an axis.

use std::time::Duration;

use ecan_canopen::{GuardingConfig, NodeAddress, OperatingMode};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::Direction;
use thiserror::Error;

use super::pdo_layout::OutputObject;
use super::targets::InvalidPeriod;
use super::units::{MotionLimit, UnitError};

/// Fault of an axis: of its configuration, or of the axis in its table.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum AxisFault {
    /// A gateway has four channels.
    #[error("channel {channel} is out of range; allowed: 0 to 3")]
    Channel {
        /// The invalid channel.
        channel: u8,
    },
    /// A node has eight axes at most.
    #[error("axis {node_axis} of the node is out of range; allowed: 0 to 7")]
    NodeAxis {
        /// The invalid axis of the node.
        node_axis: u8,
    },
    /// The predefined connection set has four PDOs each way.
    #[error("PDO number {number} is out of range; allowed: 1 to 4, with cob_ids 1 to 512")]
    PdoNumber {
        /// The invalid number.
        number: u16,
    },
    /// Every PDO of a direction needs a COB-ID, or none.
    #[error("{found} COB-IDs are given for {count} PDOs; allowed: 0 or {count}")]
    CobIdCount {
        /// COB-IDs of the direction.
        found: usize,
        /// PDOs of the direction.
        count: usize,
    },
    /// Other services have the CAN ID.
    #[error("COB-ID 0x{:03X} is out of range for a PDO; allowed: 0x181 to 0x57F", cob_id.raw())]
    CobId {
        /// The invalid COB-ID.
        cob_id: CanId,
    },
    /// Two PDOs on a channel have the same COB-ID.
    #[error(
        "COB-ID 0x{:03X} is that of a PDO of axis {other} already; choose another PDO number, or cob_ids",
        cob_id.raw()
    )]
    SameCobId {
        /// The COB-ID.
        cob_id: CanId,
        /// Index of the other axis.
        other: usize,
    },
    /// Two axes of a node have the same PDO.
    #[error(
        "PDO {number} is one of axis {other} of the same node already; choose another PDO number"
    )]
    SamePdo {
        /// The number.
        number: u16,
        /// Index of the other axis.
        other: usize,
    },
    /// The axes of a node have different settings of the node.
    #[error(
        "the settings of {address} differ from those of axis {other}; must be equal: reset, boot timeout, \
         identity, profile, heartbeats, guarding, parameters, other TPDOs"
    )]
    NodeSettings {
        /// The drive.
        address: NodeAddress,
        /// Index of the other axis.
        other: usize,
    },
    /// The objects of the process data need more PDOs than the predefined connection set has.
    #[error(
        "{count} PDOs from number {first} on are needed; allowed: up to number 4; choose fewer \
         objects, a smaller number, or cob_ids"
    )]
    PdoCount {
        /// Number of the first PDO.
        first: u16,
        /// PDOs of one direction.
        count: usize,
    },
    /// A drive does not use the object in the mode.
    #[error("{output} has no effect in mode {mode}; remove it from the outputs")]
    OutputMode {
        /// The object.
        output: OutputObject,
        /// The mode.
        mode: OperatingMode,
    },
    /// Without its status the function of a touch probe cannot be changed safely.
    #[error(
        "the touch probe function 0x60B8 is mapped without the status 0x60B9; add the status to the \
         inputs"
    )]
    ProbeStatus,
    /// A feed-forward without limits could make the axis jump.
    #[error("the limits of {output} are 0; must be at least 1; set them in feed_forward")]
    FeedForwardLimit {
        /// The object.
        output: OutputObject,
    },
    /// Node guarding is out of range.
    #[error(
        "guard time {:?} with life time factor {} is out of range; allowed: 1 ms to 65535 ms in whole \
         milliseconds, factor 1 to 255",
        guarding.guard_time,
        guarding.life_time_factor
    )]
    Guarding {
        /// The invalid configuration.
        guarding: GuardingConfig,
    },
    /// The scale is invalid.
    #[error("steps_per_turn {steps_per_turn} is invalid; must be finite and not 0")]
    Scale {
        /// Steps per turn.
        steps_per_turn: f64,
    },
    /// Limits in units of the machine are converted before the units of the drive are read.
    #[error(
        "limits in rad/s, rad/s^2 and rad/s^3 need a configured scale; set scale_source to Checked, \
         or step_limit and ramp in increments"
    )]
    ScaleSource,
    /// With a step limit of 0 the axis could never move.
    #[error("the step limit is 0; must be at least 1")]
    NoStep,
    /// The target step exceeds the step limit.
    #[error("the target step {step} exceeds the step limit {limit}")]
    TargetStep {
        /// The step.
        step: i32,
        /// The limit.
        limit: u32,
    },
    /// An axis at rest cannot move faster than its targets.
    #[error("the standstill window {standstill} exceeds the step limit {limit}")]
    Standstill {
        /// The window.
        standstill: u32,
        /// The limit.
        limit: u32,
    },
    /// The following-error window is smaller than the lag of a correct axis.
    #[error("the following-error window {window} is below {least}, eight step limits")]
    Window {
        /// The window.
        window: u32,
        /// Smallest allowed window.
        least: u32,
    },
    /// No target is inside the bounds.
    #[error("the bounds {min}..{max} are empty")]
    Bounds {
        /// Smallest.
        min: i32,
        /// Largest.
        max: i32,
    },
    /// An axis of velocity or torque could not stop.
    #[error("the bounds {min}..{max} exclude 0, so that the axis could not stop; must include 0")]
    RateBounds {
        /// Smallest.
        min: i32,
        /// Largest.
        max: i32,
    },
    /// The range of the counter is empty.
    #[error("the position range {min}..{max} is empty")]
    Range {
        /// Smallest.
        min: i32,
        /// Largest.
        max: i32,
    },
    /// The target period has no value of the interpolation time 0x60C2, so that the drive would not
    /// move evenly.
    #[error("{}", InvalidPeriod(*period_ns))]
    TargetPeriod {
        /// Target period in nanoseconds.
        period_ns: u64,
    },
    /// No missing TPDO would be tolerated, although one is missing whenever a reply is lost.
    #[error("the TPDO timeout is 0; must be at least 1")]
    TpdoTimeout,
    /// The unit of velocity is invalid.
    #[error("{units} units of velocity per turn per second are invalid; must be finite and not 0")]
    VelocityUnits {
        /// Units of velocity for one turn per second.
        units: f64,
    },
    /// A limit is no number above 0.
    #[error("the {limit} {value} {} is invalid; must be finite and above 0", limit.unit())]
    Limit {
        /// The limit.
        limit: MotionLimit,
        /// Its value.
        value: f64,
    },
    /// The host cannot keep the limit: in this mode the drive generates the motion, or the unit of
    /// its targets is none of motion.
    #[error("the {limit} cannot be kept in mode {mode}; set it by the objects of the drive")]
    LimitMode {
        /// The limit.
        limit: MotionLimit,
        /// The mode.
        mode: OperatingMode,
    },
    /// The unit of the drive's velocity is unknown.
    #[error(
        "the {limit} cannot be kept in mode {mode}: the unit of the drive's velocity is unknown; set \
         the velocity units of its scale"
    )]
    LimitUnits {
        /// The limit.
        limit: MotionLimit,
        /// The mode.
        mode: OperatingMode,
    },
    /// The limit is less than the smallest value that can be commanded.
    #[error(
        "the {limit} {value} {symbol} is below {unit} {symbol}, the smallest with a target period \
         of {target_period:?}",
        symbol = limit.unit()
    )]
    LimitResolution {
        /// The limit.
        limit: MotionLimit,
        /// Its value.
        value: f64,
        /// Smallest value.
        unit: f64,
        /// Time between two targets.
        target_period: Duration,
    },
    /// The target step exceeds the velocity limit.
    #[error(
        "the target step {step} exceeds {limit}, the velocity limit {velocity} rad/s with a target \
         period of {target_period:?}"
    )]
    TargetStepVelocity {
        /// The step.
        step: i32,
        /// Largest step.
        limit: u32,
        /// Velocity limit in rad/s.
        velocity: f64,
        /// Time between two targets.
        target_period: Duration,
    },
    /// The axis table names a gateway that the Port does not have.
    #[error("slave {slave} does not exist; the Port has {slaves}")]
    NoSuchSlave {
        /// The invalid slave index.
        slave: usize,
        /// Gateways of the Port.
        slaves: usize,
    },
    /// The axis table names a channel that the Port has not enabled.
    #[error("channel {channel} of slave {slave} is not enabled")]
    ChannelNotEnabled {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// The channel sends by CAN ID, not in order: SYNC would overtake its targets, and the end of a
    /// stale target could not be detected.
    #[error("channel {channel} of slave {slave} sends by CAN ID (Tx queue); axes need the Tx FIFO")]
    TransmitQueue {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// The axis is on a channel that only sends or only receives (0x8010:04, 0x8011:04).
    #[error(
        "channel {channel} of slave {slave} is not in the channel mask of the {direction}; an axis \
         needs both directions"
    )]
    ChannelDirection {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The direction without the channel.
        direction: Direction,
    },
    /// Two axes have the same axis of a drive.
    #[error("{address} is the drive of axis {other} already; set another node_axis")]
    SameNode {
        /// The drive.
        address: NodeAddress,
        /// Index of the other axis.
        other: usize,
    },
    /// The host uses the node-ID of the drive for its heartbeat.
    #[error("{address} has the node-ID of the host's heartbeat")]
    HostNode {
        /// The drive.
        address: NodeAddress,
    },
}

/// Rejection of a command to an axis; nothing was changed.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The axis table has no such axis.
    #[error("axis {axis} does not exist")]
    NoSuchAxis {
        /// The invalid index.
        axis: usize,
    },
    /// The axis is not configured, or its drive restarted.
    #[error("axis {axis} is not configured; configure it first")]
    NotConfigured {
        /// Index of the axis.
        axis: usize,
    },
    /// The axis is configured or being configured, with a value that the call would change.
    #[error("axis {axis} is configured with the present target period; set it before configure")]
    Configured {
        /// Index of the axis.
        axis: usize,
    },
    /// The target period has no value of the interpolation time 0x60C2.
    #[error("axis {axis}: {}", InvalidPeriod(*period_ns))]
    TargetPeriod {
        /// Index of the axis.
        axis: usize,
        /// Target period in nanoseconds.
        period_ns: u64,
    },
    /// A limit in units of the machine cannot be kept with the target period.
    #[error("axis {axis}: {fault}")]
    Limit {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        fault: AxisFault,
    },
    /// A mode change or homing is running.
    #[error("axis {axis}: a mode change or homing is running; wait for its end")]
    Busy {
        /// Index of the axis.
        axis: usize,
    },
    /// The mode takes its targets from an object that is not mapped; homing has its own command.
    #[error("axis {axis} cannot change to mode {mode}: its target object is not mapped")]
    ModeNotMapped {
        /// Index of the axis.
        axis: usize,
        /// The mode.
        mode: OperatingMode,
    },
    /// The object is not in the process data of the axis.
    #[error("axis {axis}: {output} is not mapped; add it to the outputs of the axis")]
    NotMapped {
        /// Index of the axis.
        axis: usize,
        /// The object.
        output: OutputObject,
    },
    /// The orderly end has begun.
    #[error("axis {axis}: the shutdown has begun; create the axes again to use them")]
    ShuttingDown {
        /// Index of the axis.
        axis: usize,
    },
    /// The value is not a valid target.
    #[error("axis {axis}: {error}")]
    Unit {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        error: UnitError,
    },
}
