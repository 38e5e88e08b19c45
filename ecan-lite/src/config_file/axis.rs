//! CiA 402 axes of a file with their drives and process data.

use std::time::Duration;

use ecan_canopen::{
    BootReset, FaultReaction, HaltOption, NodeAddress, NodeId, NodeLossReaction, OperatingMode,
    QuickStopOption, StopOption,
};
use ecan_cia402::{
    AxisConfig, AxisFault, DriveConfig, InputObject, MotionLimit, NodeReset, OutputObject,
    PositionRange, ScaleSource, axis_conflicts,
};
use ecan_mcan_port::Config;
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::{CHANNELS, Direction};

use super::document::{Document, Table, store};
use super::node::NodeSettings;

const MODES: [(&str, OperatingMode); 8] = [
    ("csp", OperatingMode::CyclicPosition),
    ("csv", OperatingMode::CyclicVelocity),
    ("cst", OperatingMode::CyclicTorque),
    ("pp", OperatingMode::ProfilePosition),
    ("pv", OperatingMode::ProfileVelocity),
    ("pt", OperatingMode::ProfileTorque),
    ("ip", OperatingMode::InterpolatedPosition),
    ("vl", OperatingMode::Velocity),
];

#[derive(Clone, Copy)]
enum Range {
    Linear,
    Wrapping,
    Modulo,
}

const RANGES: [(&str, Range); 3] =
    [("linear", Range::Linear), ("wrapping", Range::Wrapping), ("modulo", Range::Modulo)];

const SCALE_SOURCES: [(&str, ScaleSource); 3] = [
    ("configured", ScaleSource::Configured),
    ("checked", ScaleSource::Checked),
    ("drive", ScaleSource::Drive),
];

/// An axis of a file.
pub(crate) struct FileAxis {
    pub(crate) config: AxisConfig,
    /// Path of its table, or of the key that names its file.
    pub(crate) path: String,
}

/// Reads an axis; `None` if it has no valid address.
pub(crate) fn read(mut table: Table<'_, '_>) -> Option<FileAxis> {
    let address = read_address(&mut table);
    // In a node its keys are those of the node.
    let network = NodeSettings::read_network(&mut table);
    if let Some(fault) = network.guarding_fault() {
        table.fault("guard_time_ms", fault);
    }
    let mut axis = read_at(table, address, 0)?;
    let drive = &mut axis.config.drive;
    store(&mut drive.reset, network.reset.map(node_reset));
    store(&mut drive.boot_timeout, network.boot_timeout());
    store(&mut drive.heartbeat_ms, network.heartbeat_ms);
    drive.guarding = network.guarding();
    Some(axis)
}

fn read_address(table: &mut Table<'_, '_>) -> Option<NodeAddress> {
    let slave = table.required("gateway", "the index of its gateway in the file", (0, 0xFFFF));
    let channel = table.required("channel", "0 to 3", (0, CHANNELS as u32 - 1));
    let node = table.required("node", "the node-ID of the drive, 1 to 127", (1, 127));
    let ((slave, channel), node) = slave.zip(channel).zip(node)?;
    let (slave, channel) = (usize::try_from(slave).ok()?, u8::try_from(channel).ok()?);
    Some(NodeAddress { slave, channel, node: NodeId::from_raw(u8::try_from(node).ok()?)? })
}

/// Reads an axis of a node; `node_axis` is its default.
pub(crate) fn read_at(
    mut table: Table<'_, '_>,
    address: Option<NodeAddress>,
    node_axis: u8,
) -> Option<FileAxis> {
    // All keys are read, so that each wrong one is reported.
    let mut axis =
        AxisConfig::new(address.unwrap_or(NodeAddress { slave: 0, channel: 0, node: NodeId::MAX }));
    axis.node_axis = table.unsigned("node_axis", (0, 7)).unwrap_or(node_axis);
    store(&mut axis.mode, table.word("mode", &MODES));
    read_scale(&mut table, &mut axis);
    axis.limits.velocity = table.float("max_velocity_rad_s");
    axis.limits.acceleration = table.float("max_acceleration_rad_s2");
    axis.limits.jerk = table.float("max_jerk_rad_s3");
    if let Some(limit) = table.unsigned("step_limit", (0, u32::MAX)) {
        axis = axis.with_step_limit(limit);
    }
    store(&mut axis.following_window, table.unsigned("following_window", (0, u32::MAX)));
    store(&mut axis.standstill, table.unsigned("standstill", (0, u32::MAX)));
    store(&mut axis.target_step, table.signed("target_step"));
    store(&mut axis.ramp, table.unsigned("ramp", (0, u32::MAX)));
    axis.bounds = read_bounds(&mut table);
    store(&mut axis.auto_resume, table.flag("auto_resume"));
    let timeout_ms = table.unsigned("enable_timeout_ms", (1, 3_600_000));
    store(&mut axis.enable_timeout, timeout_ms.map(Duration::from_millis));
    read_tolerances(&mut table, &mut axis);
    read_process_data(&mut table, &mut axis);
    read_drive(&mut table, &mut axis.drive);
    let path = table.own_path().to_owned();
    address.map(|_| FileAxis { config: axis, path })
}

/// The range of the counter, and what the guard tolerates.
fn read_tolerances(table: &mut Table<'_, '_>, axis: &mut AxisConfig) {
    let range = table.word("position_range", &RANGES);
    let (min, max) = (table.signed("position_min"), table.signed("position_max"));
    match (range, min, max) {
        (Some(Range::Modulo), Some(min), Some(max)) => {
            axis.range = PositionRange::Modulo { min, max };
        }
        (Some(Range::Modulo), ..) => {
            let text = "`position_range` = \"modulo\" needs `position_min` and `position_max`";
            table.fault("position_range", text);
        }
        (range, None, None) => {
            let is_wrapping = matches!(range, Some(Range::Wrapping));
            axis.range = if is_wrapping { PositionRange::Wrapping } else { PositionRange::Linear };
        }
        (_, min, _) => {
            let key = if min.is_some() { "position_min" } else { "position_max" };
            table.fault(key, format!("`{key}` needs `position_range` = \"modulo\""));
        }
    }
    store(&mut axis.tolerances.tpdo_timeout, table.unsigned("tpdo_timeout", (1, 0xFFFF)));
    store(&mut axis.tolerances.wc_misses, table.unsigned("wc_misses", (0, 0xFFFF)));
    store(&mut axis.tolerances.drain_images, table.unsigned("drain_images", (0, 0xFFFF)));
}

fn read_scale(table: &mut Table<'_, '_>, axis: &mut AxisConfig) {
    if let Some(steps) = table.float("steps_per_turn") {
        axis.scale = ecan_cia402::Scale::steps_per_turn(steps);
    }
    if let Some(step) = table.signed("origin_step") {
        axis.scale = axis.scale.with_origin(step);
    }
    if let Some(units) = table.float("velocity_units_per_turn_s") {
        axis.scale = axis.scale.with_velocity_units(units);
    }
    store(&mut axis.scale_source, table.word("scale_source", &SCALE_SOURCES));
}

fn read_bounds(table: &mut Table<'_, '_>) -> Option<(i32, i32)> {
    let (min, max) = (table.signed("min_target"), table.signed("max_target"));
    for (key, other) in [("min_target", "max_target"), ("max_target", "min_target")] {
        if table.has(key) && !table.has(other) {
            table.fault(key, format!("`{key}` needs `{other}`"));
        }
    }
    min.zip(max)
}

/// Checks the axes, each alone, with the earlier ones and with the gateways, and reports their faults to
/// the document.
pub(crate) fn check(document: &Document<'_>, config: &Config, axes: &[Option<FileAxis>]) {
    let mut earlier: Vec<(usize, &AxisConfig)> = Vec::new();
    for (at, file_axis) in axes.iter().enumerate() {
        let Some(FileAxis { config: axis, path }) = file_axis else { continue };
        let paths =
            |keys: &[&str]| keys.iter().map(|key| format!("{path}.{key}")).collect::<Vec<_>>();
        let mut report = |fault: AxisFault| {
            document.semantic_fault(&paths(keys(&fault, axis)), format!("axis {at}: {fault}"));
        };
        axis.check(&mut report);
        axis_conflicts(axis, &earlier, &mut report);
        if let Some((key, reason)) = channel_fault(config, axis.address, at) {
            document.semantic_fault(&paths(&[key]), reason);
        }
        earlier.push((at, axis));
    }
}

/// Key and text of the fault of an axis whose channel cannot be used.
fn channel_fault(
    config: &Config,
    NodeAddress { slave, channel, .. }: NodeAddress,
    at: usize,
) -> Option<(&'static str, String)> {
    let Some(gateway) = config.port.gateways.get(slave) else {
        return Some(("gateway", format!("axis {at}: gateway {slave} is not in the file")));
    };
    let text = if !gateway.channels.get(usize::from(channel)).is_some_and(Option::is_some) {
        format!("is not enabled; add its table can{channel}")
    } else {
        let direction =
            Direction::ALL.into_iter().find(|direction| !gateway.carries(*direction, channel))?;
        format!("is not among the `channels` of the {direction}; an axis needs both directions")
    };
    Some(("channel", format!("axis {at}: channel {channel} of gateway {slave} {text}")))
}

/// Keys that a fault may come from, the most likely one first.
fn keys(fault: &AxisFault, axis: &AxisConfig) -> &'static [&'static str] {
    let limit_key = |limit: &MotionLimit| -> &'static [&'static str] {
        match limit {
            MotionLimit::Velocity => &["max_velocity_rad_s"],
            MotionLimit::Acceleration => &["max_acceleration_rad_s2"],
            MotionLimit::Jerk => &["max_jerk_rad_s3"],
        }
    };
    match fault {
        AxisFault::Scale { .. } => &["steps_per_turn"],
        AxisFault::VelocityUnits { .. } => &["velocity_units_per_turn_s"],
        AxisFault::NoStep => &["step_limit"],
        AxisFault::TargetStep { .. } => &["target_step", "step_limit"],
        AxisFault::Standstill { .. } => &["standstill", "step_limit"],
        AxisFault::Window { .. } => &["following_window", "step_limit"],
        AxisFault::PdoNumber { .. } | AxisFault::SamePdo { .. } => {
            &["pdo_number", "rpdo_cob_ids", "tpdo_cob_ids"]
        }
        AxisFault::CobIdCount { found, .. } if *found == axis.pdos.cob_ids.rpdos.len() => {
            &["rpdo_cob_ids"]
        }
        AxisFault::CobId { cob_id } | AxisFault::SameCobId { cob_id, .. }
            if axis.pdos.cob_ids.rpdos.contains(cob_id) =>
        {
            &["rpdo_cob_ids"]
        }
        AxisFault::CobIdCount { .. } | AxisFault::CobId { .. } => &["tpdo_cob_ids"],
        AxisFault::SameCobId { cob_id, .. } if axis.pdos.cob_ids.tpdos.contains(cob_id) => {
            &["tpdo_cob_ids"]
        }
        AxisFault::SameCobId { .. } => &["pdo_number", "node", "rpdo_cob_ids", "tpdo_cob_ids"],
        AxisFault::SameNode { .. } | AxisFault::NodeAxis { .. } => &["node_axis", "node"],
        AxisFault::PdoCount { .. } => &["inputs", "outputs", "pdo_number"],
        AxisFault::OutputMode { .. } | AxisFault::ProbeStatus => &["outputs", "mode"],
        AxisFault::FeedForwardLimit { .. } => &["feed_forward", "outputs"],
        AxisFault::ScaleSource => &["scale_source"],
        AxisFault::Guarding { .. } => &["guard_time_ms"],
        AxisFault::Range { .. } => &["position_min"],
        AxisFault::Bounds { .. } | AxisFault::RateBounds { .. } => &["min_target"],
        AxisFault::Limit { limit, .. }
        | AxisFault::LimitMode { limit, .. }
        | AxisFault::LimitUnits { limit, .. } => limit_key(limit),
        _ => &["node"],
    }
}

/// Reset of a drive that boots as a node with this reset.
pub(crate) fn node_reset(reset: BootReset) -> NodeReset {
    match reset {
        BootReset::None => NodeReset::None,
        BootReset::Communication => NodeReset::Communication,
        BootReset::Node => NodeReset::Node,
    }
}

// Option codes; `unchanged` does not write the object.

const HOST_LOSS: [(&str, Option<NodeLossReaction>); 5] = [
    ("unchanged", None),
    ("none", Some(NodeLossReaction::None)),
    ("fault", Some(NodeLossReaction::Fault)),
    ("disable_voltage", Some(NodeLossReaction::DisableVoltage)),
    ("quick_stop", Some(NodeLossReaction::QuickStop)),
];

const QUICK_STOP: [(&str, Option<QuickStopOption>); 10] = [
    ("unchanged", None),
    ("disable", Some(QuickStopOption::Disable)),
    ("slow_down", Some(QuickStopOption::SlowDown)),
    ("quick_stop", Some(QuickStopOption::QuickStop)),
    ("current_limit", Some(QuickStopOption::CurrentLimit)),
    ("voltage_limit", Some(QuickStopOption::VoltageLimit)),
    ("slow_down_and_stay", Some(QuickStopOption::SlowDownAndStay)),
    ("quick_stop_and_stay", Some(QuickStopOption::QuickStopAndStay)),
    ("current_limit_and_stay", Some(QuickStopOption::CurrentLimitAndStay)),
    ("voltage_limit_and_stay", Some(QuickStopOption::VoltageLimitAndStay)),
];

const STOP: [(&str, Option<StopOption>); 3] = [
    ("unchanged", None),
    ("disable", Some(StopOption::Disable)),
    ("slow_down", Some(StopOption::SlowDown)),
];

const HALT: [(&str, Option<HaltOption>); 5] = [
    ("unchanged", None),
    ("slow_down", Some(HaltOption::SlowDown)),
    ("quick_stop", Some(HaltOption::QuickStop)),
    ("current_limit", Some(HaltOption::CurrentLimit)),
    ("voltage_limit", Some(HaltOption::VoltageLimit)),
];

const FAULT_REACTION: [(&str, Option<FaultReaction>); 6] = [
    ("unchanged", None),
    ("disable", Some(FaultReaction::Disable)),
    ("slow_down", Some(FaultReaction::SlowDown)),
    ("quick_stop", Some(FaultReaction::QuickStop)),
    ("current_limit", Some(FaultReaction::CurrentLimit)),
    ("voltage_limit", Some(FaultReaction::VoltageLimit)),
];

/// Reads the configuration of a drive that does not depend on its network.
pub(crate) fn read_drive(table: &mut Table<'_, '_>, drive: &mut DriveConfig) {
    store(&mut drive.expect_profile_402, table.flag("check_profile"));
    store(&mut drive.host_heartbeat_ms, table.unsigned("host_heartbeat_ms", (0, 0xFFFF)));
    store(&mut drive.host_loss, table.word("host_loss", &HOST_LOSS));
    store(&mut drive.quick_stop, table.word("quick_stop", &QUICK_STOP));
    store(&mut drive.shutdown, table.word("shutdown", &STOP));
    store(&mut drive.disable_operation, table.word("disable_operation", &STOP));
    store(&mut drive.halt, table.word("halt", &HALT));
    store(&mut drive.fault_reaction, table.word("fault_reaction", &FAULT_REACTION));
    drive.following_error = read_following_error(table);
    drive.output_mask = table.unsigned("output_mask", (0, u32::MAX));
    drive.interpolation_buffer = table.unsigned("interpolation_buffer", (0, 0xFFFF));
    drive.torque_slope = table.unsigned("torque_slope", (0, u32::MAX));
    if let Some(mut vl) = table.table("vl") {
        drive.vl.limits = vl.pair("limits", (0, u32::MAX));
        drive.vl.acceleration = read_ramp(&mut vl, "acceleration");
        drive.vl.deceleration = read_ramp(&mut vl, "deceleration");
    }
    store(&mut drive.write_position_limits, table.flag("write_position_limits"));
    drive.max_torque = table.unsigned("max_torque", (0, 0xFFFF));
    drive.max_motor_speed = table.unsigned("max_motor_speed", (0, u32::MAX));
    store(&mut drive.use_limits, table.flag("use_limits"));
    store(&mut drive.silence_other_tpdos, table.flag("silence_other_tpdos"));
}

/// Window in steps, and time in milliseconds.
fn read_following_error(table: &mut Table<'_, '_>) -> Option<(u32, u16)> {
    const KEY: &str = "following_error";
    let (window, time_ms) = table.pair(KEY, (0, u32::MAX))?;
    let time = u16::try_from(time_ms).ok();
    if time.is_none() {
        let text = format!(
            "`{KEY}` = [{window}, {time_ms}]: the time is out of range; allowed: 0 to 65535 ms"
        );
        table.fault(KEY, text);
    }
    Some((window, time?))
}

/// Change of the velocity, and its time in seconds.
fn read_ramp(table: &mut Table<'_, '_>, key: &'static str) -> Option<(u32, u16)> {
    let (change, seconds) = table.pair(key, (0, u32::MAX))?;
    let time = u16::try_from(seconds).ok();
    if time.is_none() {
        let text = format!(
            "`{key}` = [{change}, {seconds}]: the time is out of range; allowed: 0 to 65535 s"
        );
        table.fault(key, text);
    }
    Some((change, time?))
}

pub(crate) const INPUTS: [(&str, InputObject); 12] = [
    ("velocity", InputObject::Velocity),
    ("torque", InputObject::Torque),
    ("error_code", InputObject::ErrorCode),
    ("digital_inputs", InputObject::DigitalInputs),
    ("mode_display", InputObject::ModeDisplay),
    ("following_error", InputObject::FollowingError),
    ("probe_status", InputObject::ProbeStatus),
    ("probe_1_positive", InputObject::Probe1Positive),
    ("probe_1_negative", InputObject::Probe1Negative),
    ("probe_2_positive", InputObject::Probe2Positive),
    ("probe_2_negative", InputObject::Probe2Negative),
    ("vl_velocity", InputObject::VlVelocity),
];

pub(crate) const OUTPUTS: [(&str, OutputObject); 5] = [
    ("velocity_offset", OutputObject::VelocityOffset),
    ("torque_offset", OutputObject::TorqueOffset),
    ("probe_function", OutputObject::ProbeFunction),
    ("digital_outputs", OutputObject::DigitalOutputs),
    ("mode", OutputObject::Mode),
];

/// Reads the PDOs with their objects, and the limits of the feed-forward.
pub(crate) fn read_process_data(table: &mut Table<'_, '_>, axis: &mut AxisConfig) {
    store(&mut axis.pdos.number, table.unsigned("pdo_number", (1, 512)));
    axis.pdos.cob_ids.rpdos = read_cob_ids(table, "rpdo_cob_ids");
    axis.pdos.cob_ids.tpdos = read_cob_ids(table, "tpdo_cob_ids");
    axis.pdos.inputs = read_objects(table, "inputs", &INPUTS);
    axis.pdos.outputs = read_objects(table, "outputs", &OUTPUTS);
    if let Some(mut limits) = table.table("feed_forward") {
        let target = &mut axis.feed_forward;
        store(&mut target.velocity, limits.unsigned("velocity", (0, i32::MAX.unsigned_abs())));
        let change = limits.unsigned("velocity_change", (0, i32::MAX.unsigned_abs()));
        store(&mut target.velocity_change, change);
        store(&mut target.torque, limits.unsigned("torque", (0, 0x7FFF)));
        store(&mut target.torque_change, limits.unsigned("torque_change", (0, 0x7FFF)));
    }
}

/// COB-IDs of PDOs; the check of the axis reports those that a PDO cannot have.
fn read_cob_ids(table: &mut Table<'_, '_>, key: &'static str) -> Vec<CanId> {
    let ids = table.unsigned_list(key, (0, 0x7FF)).unwrap_or_default();
    ids.into_iter().filter_map(|id| CanId::standard(u16::try_from(id).ok()?).ok()).collect()
}

fn read_objects<T: Copy + PartialEq>(
    table: &mut Table<'_, '_>,
    key: &'static str,
    words: &[(&str, T)],
) -> Vec<T> {
    let objects = table.words(key, words).unwrap_or_default();
    let is_repeated =
        |nth: usize, object: &T| objects.iter().take(nth).any(|other| other == object);
    let repeated = objects.iter().enumerate().find(|(nth, object)| is_repeated(*nth, object));
    let name = |object: &T| words.iter().find(|word| word.1 == *object).map_or("", |word| word.0);
    if let Some((_, object)) = repeated {
        table.fault(key, format!("`{key}` has \"{}\" twice", name(object)));
    }
    objects
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_object_has_a_word() {
        assert!(InputObject::ALL.iter().all(|object| INPUTS.iter().any(|word| word.1 == *object)));
        assert!(
            OutputObject::ALL.iter().all(|object| OUTPUTS.iter().any(|word| word.1 == *object))
        );
    }
}
