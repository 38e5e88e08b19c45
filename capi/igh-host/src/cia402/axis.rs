//! The axis table
//!
//! Plain data: a table may be copied and needs no deinit. igh_cia402_axis_init() fills every field
//! with values for most drives; change fields after it, before igh_cia402_context_init(), which
//! checks the table as a whole.
//!
//! ```c
//! igh_cia402_axis_t axes[2];
//! igh_cia402_axis_init(&axes[0], 0, 0, 1, 10);     slave 0, CAN0, node 1, 10 steps per target
//! igh_cia402_axis_init(&axes[1], 0, 0, 2, 10);
//! axes[1].steps_per_turn = 131072.0;
//! ```

use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{
    FaultReaction, GuardingConfig, HaltOption, IdentityCheck, NodeAddress, NodeId,
    NodeLossReaction, QuickStopOption, RevisionCheck, StopOption,
};
use ecan_cia402::{AxisConfig, InputObject, OutputObject, PdoCobIds, Scale, ScaleSource};
use ecan_protocol::can::CanId;

use super::numbers::{igh_cia402_range_t, igh_cia402_revision_t, igh_cia402_scale_source_t};
use crate::callback::{duration, milliseconds};

/// Keeps an option code of the drive.
pub const IGH_CIA402_UNCHANGED: i32 = 2_147_483_647;

/// Most additional objects of an axis.
pub const IGH_CIA402_MAX_FURTHER: usize = 16;

/// Most PDOs of an axis with own COB-IDs in one direction.
pub const IGH_CIA402_MAX_PDOS: usize = 8;

/// Marks a filled axis.
pub(super) const SEAL: u64 = 0x6563_616e_5f61_7873;

/// An object that the configuration of a drive writes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_cia402_object_t {
    /// Value; signed for a signed object.
    pub value: i64,
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Bytes of the object: 1, 2, 4 or 8.
    pub size: u8,
    /// 1 if the drive may lack the object.
    pub is_optional: u8,
    /// Must be 0.
    pub reserved: [u8; 3],
}

mirror! {
    /// Configuration of an axis: its drive and the limits of its targets. Steps are those of the
    /// drive's position counter; a cycle is a cycle in which targets are sent.
    pub struct igh_cia402_axis_t from config: &AxisConfig, set(c) to: AxisConfig {
        /// Not for the application: marks a filled axis.
        seal: u64 = SEAL,

        /// Slave index of the gateway.
        slave: u16 = u16::try_from(config.address.slave).unwrap_or(u16::MAX),
        /// Channel of the gateway, 0 to 3.
        channel: u8 = config.address.channel,
        /// Node-ID of the drive, 1 to 127.
        node_id: u8 = config.address.node.get(),
        /// An igh_cia402_mode_t; it determines the process data. Default IGH_CIA402_MODE_CSP.
        mode: i8 = config.mode.raw(),
        /// Axis of the node, 0 to 7, for a drive with several: its objects are 0x800 further for each. The axes
        /// of a node are rows of the table with the same address, each with PDOs of its own. reset,
        /// boot_timeout_ms, the identity, expect_profile_402, the heartbeats, guarding and silence_other_tpdos
        /// must be equal in all of them. Default 0.
        node_axis: u8 = config.node_axis => to.node_axis = c.node_axis,

        /// 1: in CSP, the axis becomes active again automatically after a hold in which its drive
        /// stayed enabled. Default 0: only igh_cia402_enable() does that. A drive that left Operation
        /// enabled is never enabled automatically.
        auto_resume: u8 = config.auto_resume.into() => to.auto_resume = c.auto_resume != 0,
        /// An igh_cia402_range_t: range of the position counter. Default IGH_CIA402_RANGE_LINEAR.
        range: u8 = igh_cia402_range_t::IGH_CIA402_RANGE_LINEAR as u8,
        /// Smallest position of IGH_CIA402_RANGE_MODULO, 0x607B:01.
        range_min: i32 = 0,
        /// Largest position of IGH_CIA402_RANGE_MODULO, 0x607B:02.
        range_max: i32 = 0,
        /// Steps per turn of the axis, gear included; negative inverts the direction. For angles only.
        /// Default 360, one step per degree.
        steps_per_turn: f64 = config.scale.steps() => to.scale = scale(c),
        /// Step at which the angle is 0. Default 0.
        origin: i32 = 0,

        /// Step per target that igh_cia402_send_target_step() makes.
        target_step: i32 = config.target_step => to.target_step = c.target_step,
        /// Largest distance between consecutive targets, which take effect with a SYNC each: steps, or units of velocity or torque. Not
        /// used in PP, PV and PT. Default 1000, or the target step if it is larger.
        step_limit: u32 = config.step_limit,
        /// Largest distance between a position target and the actual position, in steps; at least eight
        /// step limits, because a moving axis lags by the transport times. Default 0: a value for the
        /// step limit, at least 10000.
        following_window: u32 = 0,
        /// Largest distance between two actual positions of an axis at rest, in steps: noise. A faster
        /// axis does not become active. The step limit if it is smaller. Default 20.
        standstill: u32 = config.standstill => to.standstill = c.standstill,
        /// Largest change of the step per target for motion that the host generates: target step, halt,
        /// shutdown. Default 20.
        ramp: u32 = config.ramp => to.ramp = c.ramp,
        /// Largest velocity of the axis in rad/s, by steps_per_turn and the time from target to target: it
        /// replaces step_limit, in CSV and PV it bounds the targets. Limits that cannot be kept in the mode
        /// of the axis are rejected. Default 0: none.
        max_velocity_rad_s: f64 = 0.0 => to.limits.velocity = given(c.max_velocity_rad_s),
        /// Largest acceleration in rad/s^2 of motion that the host generates: it replaces ramp. In CSV it
        /// replaces step_limit. Default 0: none.
        max_acceleration_rad_s2: f64 = 0.0
            => to.limits.acceleration = given(c.max_acceleration_rad_s2),
        /// Largest jerk in rad/s^3 of motion that the host generates. Default 0: none.
        max_jerk_rad_s3: f64 = 0.0 => to.limits.jerk = given(c.max_jerk_rad_s3),
        /// Value of 0x60FF for one turn of the axis per second; the limits in CSV and PV need it.
        /// Default 0: unknown.
        velocity_units: f64 = 0.0,
        /// Smallest target, if has_bounds is 1; steps, or units of velocity or torque.
        bound_min: i32 = config.bounds.map_or(0, |(min, _)| min),
        /// Largest target, if has_bounds is 1.
        bound_max: i32 = config.bounds.map_or(0, |(_, max)| max),
        /// 1: targets outside bound_min and bound_max are rejected. Default 0.
        has_bounds: u8 = config.bounds.is_some().into()
            => to.bounds = (c.has_bounds != 0).then_some((c.bound_min, c.bound_max)),
        /// 1: the bounds are also written to 0x607D, in position modes and if the drive has the object.
        /// Default 0.
        write_position_limits: u8 = config.drive.write_position_limits.into()
            => to.drive.write_position_limits = c.write_position_limits != 0,

        /// Tolerated consecutive SYNC periods without a usable TPDO. Default 5.
        tpdo_timeout: u16 = config.tolerances.tpdo_timeout
            => to.tolerances.tpdo_timeout = c.tpdo_timeout,
        /// Tolerated consecutive cycles with an incomplete working counter; no targets are sent in
        /// them. Default 3.
        wc_misses: u16 = config.tolerances.wc_misses => to.tolerances.wc_misses = c.wc_misses,
        /// Images after which earlier targets count as executed or lost. Default 3.
        drain_images: u16 = config.tolerances.drain_images
            => to.tolerances.drain_images = c.drain_images,
        /// Timeout for enabling, in milliseconds. Default 5000.
        enable_timeout_ms: u32 = milliseconds(config.enable_timeout)
            => to.enable_timeout = duration(c.enable_timeout_ms),

        /// Timeout for the boot-up message after a reset, in milliseconds. Default 5000.
        boot_timeout_ms: u32 = milliseconds(config.drive.boot_timeout)
            => to.drive.boot_timeout = duration(c.boot_timeout_ms),
        /// An igh_cia402_reset_t. Default IGH_CIA402_RESET_NONE.
        reset: u8 = config.drive.reset as u8,
        /// 1: the low half of 0x1000 must be 402. Default 1.
        expect_profile_402: u8 = config.drive.expect_profile_402.into()
            => to.drive.expect_profile_402 = c.expect_profile_402 != 0,
        /// 1: 0x1018 must have this vendor and product. Default 0.
        check_identity: u8 = config.drive.identity.vendor_id.is_some().into(),
        /// 1: TPDO 2 to 4 are disabled if the drive has them, to save bus time. Default 1.
        silence_other_tpdos: u8 = config.drive.silence_other_tpdos.into()
            => to.drive.silence_other_tpdos = c.silence_other_tpdos != 0,
        /// 0x1018:01, if check_identity is 1.
        vendor_id: u32 = config.drive.identity.vendor_id.unwrap_or(0),
        /// 0x1018:02, if check_identity is 1.
        product_code: u32 = config.drive.identity.product_code.unwrap_or(0),

        /// Heartbeat of the drive, 0x1017, in milliseconds; the host counts it as lost after three and
        /// a half periods. 0 disables it. Not used with guard_time_ms. Default 100.
        heartbeat_ms: u16 = config.drive.heartbeat_ms => to.drive.heartbeat_ms = c.heartbeat_ms,
        /// Time after which the drive counts the host as lost, 0x1016:01, in milliseconds; 0 does not
        /// write the object. Default 250.
        host_heartbeat_ms: u16 = config.drive.host_heartbeat_ms
            => to.drive.host_heartbeat_ms = c.host_heartbeat_ms,
        /// Reaction of the drive to a lost host, 0x6007: an igh_cia402_host_loss_t, or
        /// IGH_CIA402_UNCHANGED. Default IGH_CIA402_HOST_LOSS_QUICK_STOP.
        host_loss: i32 = option_code(config.drive.host_loss.map(NodeLossReaction::raw)),
        /// Kind of the quick stop, 0x605A: an igh_cia402_quick_stop_t, or IGH_CIA402_UNCHANGED. Default
        /// IGH_CIA402_UNCHANGED.
        quick_stop: i32 = option_code(config.drive.quick_stop.map(QuickStopOption::raw)),
        /// Following error window of the drive, 0x6065, in steps, if write_following_error is 1. Should
        /// not be less than following_window.
        following_error_window: u32 = config.drive.following_error.map_or(0, |(window, _)| window),
        /// Time of the following error window, 0x6066, in milliseconds.
        following_error_ms: u16 = config.drive.following_error.map_or(0, |(_, ms)| ms),
        /// 1: both are written if the drive has them. Default 0.
        write_following_error: u8 = config.drive.following_error.is_some().into()
            => to.drive.following_error = (c.write_following_error != 0).then_some((c.following_error_window, c.following_error_ms)),

        /// Number of objects in `further`. Default 0.
        further_count: u8 = 0,
        /// Additional objects that are written after the mapping, in Pre-operational.
        further: [igh_cia402_object_t; IGH_CIA402_MAX_FURTHER] = [igh_cia402_object_t::default(); IGH_CIA402_MAX_FURTHER],
        /// Kind of the shutdown, 0x605B: an igh_cia402_stop_option_t, or IGH_CIA402_UNCHANGED. Default
        /// IGH_CIA402_UNCHANGED.
        shutdown: i32 = option_code(config.drive.shutdown.map(StopOption::raw)),
        /// Stop of a disabled axis, 0x605C: an igh_cia402_stop_option_t, or IGH_CIA402_UNCHANGED.
        /// Default IGH_CIA402_UNCHANGED.
        disable_operation: i32 = option_code(config.drive.disable_operation.map(StopOption::raw)),
        /// Kind of a halt in PP, PV and PT, 0x605D: an igh_cia402_halt_option_t, or
        /// IGH_CIA402_UNCHANGED. Default IGH_CIA402_UNCHANGED.
        halt: i32 = option_code(config.drive.halt.map(HaltOption::raw)),
        /// Fault reaction, 0x605E: an igh_cia402_fault_reaction_t, or IGH_CIA402_UNCHANGED. Default
        /// IGH_CIA402_UNCHANGED.
        fault_reaction: i32 = option_code(config.drive.fault_reaction.map(FaultReaction::raw)),

        /// Device type 0x1000, if check_device_type is 1.
        device_type: u32 = 0,
        /// Revision number 0x1018:03, if revision_check is not IGH_CIA402_REVISION_ANY.
        revision_number: u32 = 0,
        /// Serial number 0x1018:04, if check_serial_number is 1.
        serial_number: u32 = 0,

        /// Objects that the RPDOs carry beyond controlword and target: sum of igh_cia402_output_t, in the
        /// order of their numbers. Default 0.
        outputs: u32 = 0,
        /// Objects that the TPDOs carry beyond statusword and actual position: sum of igh_cia402_input_t,
        /// in the order of their numbers. igh_cia402_get_axis_state() has their values. Default 0.
        inputs: u32 = 0,
        /// Mask of the digital outputs 0x60FE:02, if has_output_mask is 1: a bit that is set lets the host
        /// set this output.
        output_mask: u32 = 0,
        /// Largest velocity offset 0x60B1 of igh_cia402_set_target_with(), in units of the drive's
        /// velocity; IGH_CIA402_OUTPUT_VELOCITY_OFFSET needs it. Default 0.
        feed_forward_velocity: u32 = 0 => to.feed_forward.velocity = c.feed_forward_velocity,
        /// Largest change of the velocity offset per target. Default 0.
        feed_forward_velocity_change: u32 = 0
            => to.feed_forward.velocity_change = c.feed_forward_velocity_change,

        /// Torque slope 0x6087 of PT, in thousandths of the rated torque per second; 0 does not write it.
        torque_slope: u32 = 0 => to.drive.torque_slope = given(c.torque_slope),
        /// Smallest amount of the velocity in VL, 0x6046:01, if vl_velocity_max is not 0.
        vl_velocity_min: u32 = 0,
        /// Largest amount of the velocity in VL, 0x6046:02; 0 does not write 0x6046.
        vl_velocity_max: u32 = 0
            => to.drive.vl.limits = given(c.vl_velocity_max).map(|most| (c.vl_velocity_min, most)),
        /// Change of the velocity in VL while it accelerates, 0x6048:01; 0 does not write 0x6048.
        vl_acceleration: u32 = 0
            => to.drive.vl.acceleration = given(c.vl_acceleration).map(|change| (change, c.vl_acceleration_s)),
        /// Change of the velocity in VL while it decelerates, 0x6049:01; 0 does not write 0x6049.
        vl_deceleration: u32 = 0
            => to.drive.vl.deceleration = given(c.vl_deceleration).map(|change| (change, c.vl_deceleration_s)),
        /// Largest speed of the motor 0x6080, in revolutions per minute; 0 does not write it.
        max_motor_speed: u32 = 0 => to.drive.max_motor_speed = given(c.max_motor_speed),
        /// Time of vl_acceleration in seconds, 0x6048:02.
        vl_acceleration_s: u16 = 0,
        /// Time of vl_deceleration in seconds, 0x6049:02.
        vl_deceleration_s: u16 = 0,
        /// Set-points that wait in the drive in IP, 0x60C4:02; 0 leaves it unchanged. When targets end,
        /// the drive still goes through those that wait.
        interpolation_buffer: u16 = 0
            => to.drive.interpolation_buffer = given(c.interpolation_buffer),
        /// Largest torque 0x6072, in thousandths of the rated torque; 0 does not write it.
        max_torque: u16 = 0 => to.drive.max_torque = given(c.max_torque),
        /// Largest torque offset 0x60B2 of igh_cia402_set_target_with(), in thousandths of the rated
        /// torque; IGH_CIA402_OUTPUT_TORQUE_OFFSET needs it. Default 0.
        feed_forward_torque: u16 = 0 => to.feed_forward.torque = c.feed_forward_torque,
        /// Largest change of the torque offset per target. Default 0.
        feed_forward_torque_change: u16 = 0
            => to.feed_forward.torque_change = c.feed_forward_torque_change,

        /// 1: 0x1000 must have this device type. Default 0.
        check_device_type: u8 = 0,
        /// An igh_cia402_revision_t. Default IGH_CIA402_REVISION_ANY.
        revision_check: u8 = 0,
        /// 1: 0x1018:04 must have this serial number. Default 0.
        check_serial_number: u8 = 0,
        /// 1: the mask of the digital outputs is written. Default 0.
        has_output_mask: u8 = 0
            => to.drive.output_mask = (c.has_output_mask != 0).then_some(c.output_mask),
        /// 1: the limits 0x6072, 0x607D and 0x6080 of the drive are read and narrow those of the axis;
        /// also done if max_torque or max_motor_speed is set. igh_cia402_get_drive_limits() returns them.
        /// Default 0.
        use_drive_limits: u8 = 0 => to.drive.use_limits = c.use_drive_limits != 0,
        /// An igh_cia402_scale_source_t. Default IGH_CIA402_SCALE_CONFIGURED.
        scale_source: u8 = 0,
        /// Multiple of guard_time_ms without response or request after which the host and the drive react,
        /// 1 to 255 (0x100D), if guard_time_ms is not 0. Default 0.
        life_time_factor: u8 = 0,
        /// Must be 0.
        padding: u8 = 0,
        /// Time between two requests of node guarding, 1 to 65535 ms (0x100C): in place of heartbeat_ms, for a
        /// drive without heartbeat. The drive detects by the requests that the host has stopped. Default 0:
        /// none.
        guard_time_ms: u16 = 0 => to.drive.guarding = guarding(c),
        /// Number of the first RPDO and of the first TPDO, 1 to 512; further ones have the next numbers. Numbers
        /// above 4 need COB-IDs. Default 1.
        pdo_number: u16 = config.pdos.number => to.pdos.number = c.pdo_number,
        /// COB-IDs of the RPDOs in the order of their numbers, 0x181 to 0x57F, one for each; the others are 0.
        /// Default all 0: those of the predefined connection set.
        rpdo_cob_ids: [u16; IGH_CIA402_MAX_PDOS] = [0; IGH_CIA402_MAX_PDOS],
        /// COB-IDs of the TPDOs, as rpdo_cob_ids.
        tpdo_cob_ids: [u16; IGH_CIA402_MAX_PDOS] = [0; IGH_CIA402_MAX_PDOS],
        /// Must be 0; for fields of later versions.
        reserved: [u64; 8] = [0; 8],
    }
}

impl igh_cia402_axis_t {
    /// Returns whether a field that must be 0 is not.
    pub(super) fn has_reserved(&self) -> bool {
        let mut further = self.further.iter().take(self.further_count.into());
        self.padding != 0
            || self.reserved.iter().any(|word| *word != 0)
            || further.any(|object| object.reserved != [0; 3])
    }
}

/// Number of an option code of the drive.
fn option_code(code: Option<i16>) -> i32 {
    code.map_or(IGH_CIA402_UNCHANGED, i32::from)
}

fn scale(axis: &igh_cia402_axis_t) -> Scale {
    let scale = Scale::steps_per_turn(axis.steps_per_turn).with_origin(axis.origin);
    given(axis.velocity_units).map_or(scale, |units| scale.with_velocity_units(units))
}

/// Fills an axis: CSP, with limits that allow its target step.
///
/// @param axis         Is overwritten.
/// @param slave        Slave index of the gateway.
/// @param channel      Channel of the gateway, 0 to 3.
/// @param node_id      Node-ID of the drive, 1 to 127.
/// @param target_step  Steps per target that igh_cia402_send_target_step() makes; 0 for none.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT, with nothing filled, for a node-ID, channel or slave out
///          of range.
#[export(call)]
pub fn igh_cia402_axis_init(
    axis: *mut igh_cia402_axis_t,
    slave: usize,
    channel: u8,
    node_id: u8,
    target_step: i32,
) {
    pointers!(call, out(axis));
    if u16::try_from(slave).is_err() {
        let text = format_args!("{slave} is out of range; allowed: 0 to 65535");
        return Err(call.argument("slave", text));
    }
    if channel > 3 {
        return Err(
            call.argument("channel", format_args!("{channel} is out of range; allowed: 0 to 3"))
        );
    }
    let node = NodeId::from_raw(node_id).ok_or_else(|| {
        call.argument("node_id", format_args!("{node_id} is out of range; allowed: 1 to 127"))
    })?;
    let settings = AxisConfig::new(NodeAddress { slave, channel, node });
    let settings = settings.with_target_step(target_step);
    axis.set((&settings).into());
}

/// Sets the settings of an axis. Reports every value that Rust's types cannot hold.
pub(super) fn apply(
    axis: &igh_cia402_axis_t,
    config: &mut AxisConfig,
    report: &mut dyn FnMut(&str, i64),
) {
    axis.set_plain(config);
    let chosen = |mask: u32, raw: u8| mask & 1 << raw != 0;
    let all = |count: usize| !(u32::MAX << count);
    if axis.outputs & !all(OutputObject::ALL.len()) != 0 {
        report("outputs", axis.outputs.into());
    }
    if axis.inputs & !all(InputObject::ALL.len()) != 0 {
        report("inputs", axis.inputs.into());
    }
    let outputs = OutputObject::ALL.iter().copied();
    config.pdos.outputs = outputs.filter(|output| chosen(axis.outputs, output.raw())).collect();
    let inputs = InputObject::ALL.iter().copied();
    config.pdos.inputs = inputs.filter(|input| chosen(axis.inputs, input.raw())).collect();
    match scale_source(axis.scale_source) {
        Some(source) => config.scale_source = source,
        None => report("scale_source", axis.scale_source.into()),
    }
    config.pdos.cob_ids = PdoCobIds {
        rpdos: cob_ids("rpdo_cob_ids", &axis.rpdo_cob_ids, report),
        tpdos: cob_ids("tpdo_cob_ids", &axis.tpdo_cob_ids, report),
    };
    config.drive.identity = identity(axis, report);
}

/// COB-IDs up to the last one that is given.
fn cob_ids(field: &str, ids: &[u16], report: &mut dyn FnMut(&str, i64)) -> Vec<CanId> {
    let count = ids.iter().rposition(|id| *id != 0).map_or(0, |last| last + 1);
    let can_id = |id: &u16| {
        let can_id = CanId::standard(*id).ok().filter(|_| *id != 0);
        if can_id.is_none() {
            report(field, (*id).into());
        }
        can_id
    };
    ids.iter().take(count).filter_map(can_id).collect()
}

/// Node guarding if one of its values is given; a missing one is a fault that Rust finds.
fn guarding(axis: &igh_cia402_axis_t) -> Option<GuardingConfig> {
    let guarding = GuardingConfig {
        guard_time: duration(axis.guard_time_ms.into()),
        life_time_factor: axis.life_time_factor,
    };
    (axis.guard_time_ms != 0 || axis.life_time_factor != 0).then_some(guarding)
}

fn identity(axis: &igh_cia402_axis_t, report: &mut dyn FnMut(&str, i64)) -> IdentityCheck {
    use igh_cia402_revision_t::*;
    const ANY: u8 = IGH_CIA402_REVISION_ANY as u8;
    const EXACTLY: u8 = IGH_CIA402_REVISION_EXACTLY as u8;
    const COMPATIBLE: u8 = IGH_CIA402_REVISION_COMPATIBLE as u8;
    let has_vendor = axis.check_identity != 0;
    IdentityCheck {
        device_type: (axis.check_device_type != 0).then_some(axis.device_type),
        vendor_id: has_vendor.then_some(axis.vendor_id),
        product_code: has_vendor.then_some(axis.product_code),
        revision: match axis.revision_check {
            ANY => RevisionCheck::Any,
            EXACTLY => RevisionCheck::Exactly(axis.revision_number),
            COMPATIBLE => RevisionCheck::Compatible(axis.revision_number),
            other => {
                report("revision_check", other.into());
                RevisionCheck::Any
            }
        },
        serial_number: (axis.check_serial_number != 0).then_some(axis.serial_number),
    }
}

fn scale_source(number: u8) -> Option<ScaleSource> {
    igh_cia402_scale_source_t::to_rust(number)
}

/// A value, of which 0 is none.
fn given<T: Default + PartialEq>(value: T) -> Option<T> {
    (value != T::default()).then_some(value)
}

#[cfg(test)]
mod tests {
    use ecan_canopen::{NodeAddress, NodeId};
    use ecan_cia402::{FeedForwardLimits, VlConfig};

    use super::{IGH_CIA402_MAX_PDOS, igh_cia402_axis_init, *};
    use crate::cia402::cycle::{igh_cia402_input_t, igh_cia402_output_t};

    fn axis() -> igh_cia402_axis_t {
        let mut axis = std::mem::MaybeUninit::uninit();
        // SAFETY: the pointer is valid for writing.
        assert_eq!(unsafe { igh_cia402_axis_init(axis.as_mut_ptr(), 0, 0, 1, 0) }, 0);
        // SAFETY: filled by the call above.
        unsafe { axis.assume_init() }
    }

    fn config() -> AxisConfig {
        let node = NodeId::new(1).unwrap();
        AxisConfig::new(NodeAddress { slave: 0, channel: 0, node })
    }

    fn applied(axis: &igh_cia402_axis_t) -> (AxisConfig, Vec<(String, i64)>) {
        let (mut config, mut faults) = (config(), Vec::new());
        apply(axis, &mut config, &mut |field, value| faults.push((field.to_owned(), value)));
        (config, faults)
    }

    #[test]
    fn every_option_arrives() {
        use igh_cia402_input_t::*;
        use igh_cia402_output_t::*;
        let mut axis = axis();
        (axis.check_device_type, axis.device_type) = (1, 0x0002_0192);
        (axis.check_identity, axis.vendor_id, axis.product_code) = (1, 7, 8);
        (axis.revision_check, axis.revision_number) = (2, 0x0001_0002);
        (axis.check_serial_number, axis.serial_number) = (1, 99);
        axis.outputs =
            IGH_CIA402_OUTPUT_TORQUE_OFFSET as u32 | IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS as u32;
        axis.inputs = IGH_CIA402_INPUT_VELOCITY as u32 | IGH_CIA402_INPUT_VL_VELOCITY as u32;
        (axis.has_output_mask, axis.output_mask) = (1, 0xFF00);
        (axis.feed_forward_velocity, axis.feed_forward_velocity_change) = (1, 2);
        (axis.feed_forward_torque, axis.feed_forward_torque_change) = (3, 4);
        (axis.torque_slope, axis.interpolation_buffer) = (5, 6);
        (axis.vl_velocity_min, axis.vl_velocity_max) = (10, 3000);
        (axis.vl_acceleration, axis.vl_acceleration_s) = (100, 1);
        (axis.vl_deceleration, axis.vl_deceleration_s) = (200, 2);
        (axis.max_torque, axis.max_motor_speed, axis.use_drive_limits) = (1500, 4000, 1);
        axis.scale_source = igh_cia402_scale_source_t::IGH_CIA402_SCALE_DRIVE as u8;
        (axis.guard_time_ms, axis.life_time_factor) = (100, 3);
        axis.rpdo_cob_ids[0] = 0x301;
        axis.tpdo_cob_ids[..2].copy_from_slice(&[0x381, 0x382]);
        let mut expected = config();
        expected.pdos.outputs = vec![OutputObject::TorqueOffset, OutputObject::DigitalOutputs];
        expected.pdos.inputs = vec![InputObject::Velocity, InputObject::VlVelocity];
        expected.feed_forward =
            FeedForwardLimits { velocity: 1, velocity_change: 2, torque: 3, torque_change: 4 };
        expected.scale_source = ScaleSource::Drive;
        expected.pdos.cob_ids = PdoCobIds {
            rpdos: vec![CanId::standard(0x301).unwrap()],
            tpdos: [0x381, 0x382].map(|id| CanId::standard(id).unwrap()).to_vec(),
        };
        expected.drive.guarding = Some(GuardingConfig {
            guard_time: std::time::Duration::from_millis(100),
            life_time_factor: 3,
        });
        expected.drive.identity = IdentityCheck {
            device_type: Some(0x0002_0192),
            vendor_id: Some(7),
            product_code: Some(8),
            revision: RevisionCheck::Compatible(0x0001_0002),
            serial_number: Some(99),
        };
        expected.drive.output_mask = Some(0xFF00);
        expected.drive.interpolation_buffer = Some(6);
        expected.drive.torque_slope = Some(5);
        expected.drive.vl = VlConfig {
            limits: Some((10, 3000)),
            acceleration: Some((100, 1)),
            deceleration: Some((200, 2)),
        };
        expected.drive.max_torque = Some(1500);
        expected.drive.max_motor_speed = Some(4000);
        expected.drive.use_limits = true;
        assert_eq!(applied(&axis), (expected, Vec::new()));
        axis.revision_check = 1;
        let identity = applied(&axis).0.drive.identity;
        assert_eq!(identity.revision, RevisionCheck::Exactly(0x0001_0002));
    }

    #[test]
    fn cob_ids_of_all_objects_fit() {
        let mut config = config();
        config.pdos.outputs = OutputObject::ALL.to_vec();
        config.pdos.inputs = InputObject::ALL.to_vec();
        let layout = config.layout();
        assert!(layout.rpdo_count() <= IGH_CIA402_MAX_PDOS);
        assert!(layout.tpdo_count() <= IGH_CIA402_MAX_PDOS);
    }

    #[test]
    fn unknown_numbers_are_reported() {
        let mut axis = axis();
        (axis.outputs, axis.inputs) = (0x20, 0x1000);
        (axis.revision_check, axis.scale_source) = (3, 4);
        (axis.rpdo_cob_ids[1], axis.tpdo_cob_ids[0]) = (0x202, 0x800);
        let (_, faults) = applied(&axis);
        let fields: Vec<_> = faults.iter().map(|(field, _)| field.as_str()).collect();
        let expected =
            ["outputs", "inputs", "scale_source", "rpdo_cob_ids", "tpdo_cob_ids", "revision_check"];
        assert_eq!(fields, expected);
        assert_eq!((faults[3].1, faults[4].1), (0, 0x800));
    }
}
