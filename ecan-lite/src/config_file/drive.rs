//! The drive of an axis of a file.

use std::time::Duration;

use ecan_canopen::{
    FaultReaction, GuardingConfig, HaltOption, NodeLossReaction, QuickStopOption, StopOption,
};
use ecan_cia402::{DriveConfig, NodeReset};

use crate::config_file::document::{Table, store};

const RESETS: [(&str, NodeReset); 3] = [
    ("none", NodeReset::None),
    ("communication", NodeReset::Communication),
    ("node", NodeReset::Node),
];
/// Guarding requests without response that a node tolerates by default.
pub(crate) const LIFE_TIME_FACTOR: u8 = 3;

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
pub(crate) fn read(table: &mut Table<'_, '_>, drive: &mut DriveConfig) {
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

/// Reads reset, heartbeat and node guarding.
pub(crate) fn read_network(table: &mut Table<'_, '_>, drive: &mut DriveConfig) {
    store(&mut drive.reset, table.word("reset", &RESETS));
    let timeout_ms = table.unsigned("boot_timeout_ms", (1, 3_600_000));
    store(&mut drive.boot_timeout, timeout_ms.map(Duration::from_millis));
    let heartbeat_ms = table.unsigned("heartbeat_ms", (0, 0xFFFF));
    store(&mut drive.heartbeat_ms, heartbeat_ms);
    let guard_time_ms = table.unsigned("guard_time_ms", (1, 0xFFFF));
    let life_time_factor = table.unsigned("life_time_factor", (1, 0xFF));
    if guard_time_ms.is_some() && heartbeat_ms.is_some_and(|ms| ms > 0) {
        let text = "`guard_time_ms` and `heartbeat_ms` exclude each other; set `heartbeat_ms` = 0";
        table.fault("guard_time_ms", text);
    }
    drive.guarding = guard_time_ms.map(|ms| GuardingConfig {
        guard_time: Duration::from_millis(ms),
        life_time_factor: life_time_factor.unwrap_or(LIFE_TIME_FACTOR),
    });
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
