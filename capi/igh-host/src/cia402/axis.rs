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

use crate::milliseconds::{duration, milliseconds};
use ecan_c_export::export;

use ecan_canopen::{
    FaultReaction, HaltOption, NodeAddress, NodeId, NodeLossReaction, OperatingMode,
    QuickStopOption, SdoValue, Step, StopOption,
};
use ecan_cia402::{AxisConfig, DriveConfig, MotionLimits, PositionRange, Scale};
use ecan_mcan_host::boundary::Call;
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_host::pointers;

use super::numbers::{igh_cia402_range_t, igh_cia402_reset_t};

/// Keeps an option code of the drive.
pub const IGH_CIA402_UNCHANGED: i32 = 2_147_483_647;

/// Most additional objects of an axis.
pub const IGH_CIA402_MAX_FURTHER: usize = 16;

/// Marks a filled axis.
const SEAL: u64 = 0x6563_616e_5f61_7873;

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
    /// Not used.
    pub reserved: [u8; 3],
}

/// Configuration of an axis: its drive and the limits of its targets. Steps are those of the
/// drive's position counter; a cycle is a cycle in which targets are sent.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_cia402_axis_t {
    /// Not for the application: marks a filled axis.
    pub seal: u64,

    /// Slave index of the gateway.
    pub slave: u16,
    /// Channel of the gateway, 0 to 3.
    pub channel: u8,
    /// Node-ID of the drive, 1 to 127.
    pub node_id: u8,
    /// An igh_cia402_mode_t; it determines the process data. Default IGH_CIA402_MODE_CSP.
    pub mode: i8,
    /// Number of the RPDO and the TPDO, 1 to 4. Default 1.
    pub pdo_number: u8,

    /// 1: in CSP, the axis becomes active again automatically after a hold in which its drive
    /// stayed enabled. Default 0: only igh_cia402_enable() does that. A drive that left Operation
    /// enabled is never enabled automatically.
    pub auto_resume: u8,
    /// An igh_cia402_range_t: range of the position counter. Default IGH_CIA402_RANGE_LINEAR.
    pub range: u8,
    /// Smallest position of IGH_CIA402_RANGE_MODULO, 0x607B:01.
    pub range_min: i32,
    /// Largest position of IGH_CIA402_RANGE_MODULO, 0x607B:02.
    pub range_max: i32,
    /// Step at which the angle is 0. Default 0.
    pub origin: i32,
    /// Steps per turn of the axis, gear included; negative inverts the direction. For angles only.
    /// Default 360, one step per degree.
    pub steps_per_turn: f64,

    /// Step per target that igh_cia402_send_target_step() makes.
    pub target_step: i32,
    /// Largest distance between consecutive targets, which take effect with a SYNC each: steps, or units of velocity or torque. Not
    /// used in PP, PV and PT. Default 1000, or the target step if it is larger.
    pub step_limit: u32,
    /// Largest distance between a position target and the actual position, in steps; at least eight
    /// step limits, because a moving axis lags by the transport times. Default 0: a value for the
    /// step limit, at least 10000.
    pub following_window: u32,
    /// Largest distance between two actual positions of an axis at rest, in steps: noise. A faster
    /// axis does not become active. The step limit if it is smaller. Default 20.
    pub standstill: u32,
    /// Largest change of the step per target for motion that the host generates: target step, halt,
    /// shutdown. Default 20.
    pub ramp: u32,
    /// Largest velocity of the axis in rad/s, by steps_per_turn and the time from target to target: it
    /// replaces step_limit, in CSV and PV it bounds the targets. Limits that cannot be kept in the mode
    /// of the axis are rejected. Default 0: none.
    pub max_velocity_rad_s: f64,
    /// Largest acceleration in rad/s^2 of motion that the host generates: it replaces ramp. In CSV it
    /// replaces step_limit. Default 0: none.
    pub max_acceleration_rad_s2: f64,
    /// Largest jerk in rad/s^3 of motion that the host generates. Default 0: none.
    pub max_jerk_rad_s3: f64,
    /// Value of 0x60FF for one turn of the axis per second; the limits in CSV and PV need it.
    /// Default 0: unknown.
    pub velocity_units: f64,
    /// Smallest target, if has_bounds is 1; steps, or units of velocity or torque.
    pub bound_min: i32,
    /// Largest target, if has_bounds is 1.
    pub bound_max: i32,
    /// 1: targets outside bound_min and bound_max are rejected. Default 0.
    pub has_bounds: u8,
    /// 1: the bounds are also written to 0x607D, in position modes and if the drive has the object.
    /// Default 0.
    pub write_position_limits: u8,

    /// Tolerated consecutive SYNC periods without a usable TPDO. Default 5.
    pub tpdo_timeout: u16,
    /// Tolerated consecutive cycles with an incomplete working counter; no targets are sent in
    /// them. Default 3.
    pub wc_misses: u16,
    /// Images after which earlier targets count as executed or lost. Default 3.
    pub drain_images: u16,
    /// Timeout for enabling, in milliseconds. Default 5000.
    pub enable_timeout_ms: u32,

    /// Timeout for the boot-up message after a reset, in milliseconds. Default 5000.
    pub boot_timeout_ms: u32,
    /// An igh_cia402_reset_t. Default IGH_CIA402_RESET_NONE.
    pub reset: u8,
    /// 1: the low half of 0x1000 must be 402. Default 1.
    pub expect_profile_402: u8,
    /// 1: 0x1018 must have this vendor and product. Default 0.
    pub check_identity: u8,
    /// 1: TPDO 2 to 4 are disabled if the drive has them, to save bus time. Default 1.
    pub silence_other_tpdos: u8,
    /// 0x1018:01, if check_identity is 1.
    pub vendor_id: u32,
    /// 0x1018:02, if check_identity is 1.
    pub product_code: u32,

    /// Heartbeat of the drive, 0x1017, in milliseconds; the host counts it as lost after three and
    /// a half periods. 0 disables it. Default 100.
    pub heartbeat_ms: u16,
    /// Time after which the drive counts the host as lost, 0x1016:01, in milliseconds; 0 does not
    /// write the object. Default 250.
    pub host_heartbeat_ms: u16,
    /// Reaction of the drive to a lost host, 0x6007: an igh_cia402_host_loss_t, or
    /// IGH_CIA402_UNCHANGED. Default IGH_CIA402_HOST_LOSS_QUICK_STOP.
    pub host_loss: i32,
    /// Kind of the quick stop, 0x605A: an igh_cia402_quick_stop_t, or IGH_CIA402_UNCHANGED. Default
    /// IGH_CIA402_UNCHANGED.
    pub quick_stop: i32,
    /// Following error window of the drive, 0x6065, in steps, if write_following_error is 1. Should
    /// not be less than following_window.
    pub following_error_window: u32,
    /// Time of the following error window, 0x6066, in milliseconds.
    pub following_error_ms: u16,
    /// 1: both are written if the drive has them. Default 0.
    pub write_following_error: u8,

    /// Number of objects in `further`. Default 0.
    pub further_count: u8,
    /// Additional objects that are written after the mapping, in Pre-operational.
    pub further: [igh_cia402_object_t; IGH_CIA402_MAX_FURTHER],
    /// Kind of the shutdown, 0x605B: an igh_cia402_stop_option_t, or IGH_CIA402_UNCHANGED. Default
    /// IGH_CIA402_UNCHANGED.
    pub shutdown: i32,
    /// Stop of a disabled axis, 0x605C: an igh_cia402_stop_option_t, or IGH_CIA402_UNCHANGED.
    /// Default IGH_CIA402_UNCHANGED.
    pub disable_operation: i32,
    /// Kind of a halt in PP, PV and PT, 0x605D: an igh_cia402_halt_option_t, or
    /// IGH_CIA402_UNCHANGED. Default IGH_CIA402_UNCHANGED.
    pub halt: i32,
    /// Fault reaction, 0x605E: an igh_cia402_fault_reaction_t, or IGH_CIA402_UNCHANGED. Default
    /// IGH_CIA402_UNCHANGED.
    pub fault_reaction: i32,
    /// Not used.
    pub reserved: [u64; 2],
}

impl igh_cia402_axis_t {
    fn new(slave: u16, channel: u8, node_id: u8, settings: &AxisConfig) -> Self {
        let code = |code: Option<i16>| code.map_or(IGH_CIA402_UNCHANGED, i32::from);
        let AxisConfig { drive, .. } = settings;
        let (bounds, identity) = (settings.bounds, drive.identity);
        let following_error = drive.following_error;
        Self {
            seal: SEAL,
            slave,
            channel,
            node_id,
            mode: settings.mode.raw(),
            pdo_number: settings.pdo_number,
            auto_resume: settings.auto_resume.into(),
            range: igh_cia402_range_t::IGH_CIA402_RANGE_LINEAR as u8,
            range_min: 0,
            range_max: 0,
            origin: 0,
            steps_per_turn: settings.scale.steps(),
            target_step: settings.target_step,
            step_limit: settings.step_limit,
            following_window: 0,
            standstill: settings.standstill,
            ramp: settings.ramp,
            max_velocity_rad_s: 0.0,
            max_acceleration_rad_s2: 0.0,
            max_jerk_rad_s3: 0.0,
            velocity_units: 0.0,
            bound_min: bounds.map_or(0, |(min, _)| min),
            bound_max: bounds.map_or(0, |(_, max)| max),
            has_bounds: bounds.is_some().into(),
            write_position_limits: drive.write_position_limits.into(),
            tpdo_timeout: settings.tpdo_timeout,
            wc_misses: settings.wc_misses,
            drain_images: settings.drain_images,
            enable_timeout_ms: milliseconds(settings.enable_timeout),
            boot_timeout_ms: milliseconds(drive.boot_timeout),
            reset: drive.reset as u8,
            expect_profile_402: drive.expect_profile_402.into(),
            check_identity: identity.is_some().into(),
            silence_other_tpdos: drive.silence_other_tpdos.into(),
            vendor_id: identity.map_or(0, |(vendor, _)| vendor),
            product_code: identity.map_or(0, |(_, product)| product),
            heartbeat_ms: drive.heartbeat_ms,
            host_heartbeat_ms: drive.host_heartbeat_ms,
            host_loss: code(drive.host_loss.map(NodeLossReaction::raw)),
            quick_stop: code(drive.quick_stop.map(QuickStopOption::raw)),
            following_error_window: following_error.map_or(0, |(window, _)| window),
            following_error_ms: following_error.map_or(0, |(_, ms)| ms),
            write_following_error: following_error.is_some().into(),
            further_count: 0,
            further: [igh_cia402_object_t::default(); IGH_CIA402_MAX_FURTHER],
            shutdown: code(drive.shutdown.map(StopOption::raw)),
            disable_operation: code(drive.disable_operation.map(StopOption::raw)),
            halt: code(drive.halt.map(HaltOption::raw)),
            fault_reaction: code(drive.fault_reaction.map(FaultReaction::raw)),
            reserved: [0; 2],
        }
    }

    /// Converts to Rust. Checks the values that Rust's types cannot hold; the whole table is
    /// checked later.
    pub(crate) fn checked(&self, call: Call, axis: usize) -> Result<AxisConfig, ecan_result_t> {
        if self.seal != SEAL {
            let text = format_args!("axis {axis} is not filled: call igh_cia402_axis_init first");
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        let fault = |name: &str, value: i64| {
            let text = format_args!("axis {axis}: invalid value {value} for `{name}`");
            call.fail(ecan_result_t::ECAN_ERR_CONFIG, text)
        };
        let address = NodeAddress {
            slave: self.slave.into(),
            channel: self.channel,
            node: NodeId::new(self.node_id).ok_or_else(|| fault("node_id", self.node_id.into()))?,
        };
        let code = |name, code: i32| match code {
            IGH_CIA402_UNCHANGED => Ok(None),
            code => i16::try_from(code).map(Some).map_err(|_| fault(name, code.into())),
        };
        let count = usize::from(self.further_count);
        let further = self
            .further
            .get(..count)
            .ok_or_else(|| fault("further_count", self.further_count.into()))?;
        let drive = DriveConfig {
            reset: igh_cia402_reset_t::to_rust(self.reset)
                .ok_or_else(|| fault("reset", self.reset.into()))?,
            boot_timeout: duration(self.boot_timeout_ms),
            identity: (self.check_identity != 0).then_some((self.vendor_id, self.product_code)),
            expect_profile_402: self.expect_profile_402 != 0,
            heartbeat_ms: self.heartbeat_ms,
            host_heartbeat_ms: self.host_heartbeat_ms,
            host_loss: code("host_loss", self.host_loss)?.map(NodeLossReaction::from_raw),
            quick_stop: code("quick_stop", self.quick_stop)?.map(QuickStopOption::from_raw),
            shutdown: code("shutdown", self.shutdown)?.map(StopOption::from_raw),
            disable_operation: code("disable_operation", self.disable_operation)?
                .map(StopOption::from_raw),
            halt: code("halt", self.halt)?.map(HaltOption::from_raw),
            fault_reaction: code("fault_reaction", self.fault_reaction)?
                .map(FaultReaction::from_raw),
            following_error: (self.write_following_error != 0)
                .then_some((self.following_error_window, self.following_error_ms)),
            write_position_limits: self.write_position_limits != 0,
            silence_other_tpdos: self.silence_other_tpdos != 0,
            further: further
                .iter()
                .map(|object| object.step().ok_or_else(|| fault("further", object.value)))
                .collect::<Result<_, _>>()?,
        };
        let mut settings = AxisConfig {
            mode: OperatingMode::from_raw(self.mode)
                .ok_or_else(|| fault("mode", self.mode.into()))?,
            scale: self.scale(),
            range: self.range().ok_or_else(|| fault("range", self.range.into()))?,
            bounds: (self.has_bounds != 0).then_some((self.bound_min, self.bound_max)),
            standstill: self.standstill,
            target_step: self.target_step,
            ramp: self.ramp,
            limits: self.limits(),
            tpdo_timeout: self.tpdo_timeout,
            wc_misses: self.wc_misses,
            drain_images: self.drain_images,
            auto_resume: self.auto_resume != 0,
            enable_timeout: duration(self.enable_timeout_ms),
            pdo_number: self.pdo_number,
            drive,
            ..AxisConfig::new(address)
        }
        .with_step_limit(self.step_limit);
        if self.following_window != 0 {
            settings.following_window = self.following_window;
        }
        Ok(settings)
    }

    fn scale(&self) -> Scale {
        let scale = Scale::steps_per_turn(self.steps_per_turn).with_origin(self.origin);
        given(self.velocity_units).map_or(scale, |units| scale.with_velocity_units(units))
    }

    fn limits(&self) -> MotionLimits {
        MotionLimits {
            velocity: given(self.max_velocity_rad_s),
            acceleration: given(self.max_acceleration_rad_s2),
            jerk: given(self.max_jerk_rad_s3),
        }
    }

    fn range(&self) -> Option<PositionRange> {
        use igh_cia402_range_t::*;
        const LINEAR: u8 = IGH_CIA402_RANGE_LINEAR as u8;
        const WRAPPING: u8 = IGH_CIA402_RANGE_WRAPPING as u8;
        const MODULO: u8 = IGH_CIA402_RANGE_MODULO as u8;
        Some(match self.range {
            LINEAR => PositionRange::Linear,
            WRAPPING => PositionRange::Wrapping,
            MODULO => PositionRange::Modulo { min: self.range_min, max: self.range_max },
            _ => return None,
        })
    }
}

/// A value, of which 0 is none.
fn given(value: f64) -> Option<f64> {
    (value != 0.0).then_some(value)
}

impl igh_cia402_object_t {
    /// Step that writes the object; `None` if the value does not fit the size.
    fn step(&self) -> Option<Step> {
        // A value fits where it is that of the object, read with or without sign.
        let value = self.value;
        let sized: SdoValue = match self.size {
            1 => i8::try_from(value).map(Into::into).or(u8::try_from(value).map(Into::into)),
            2 => i16::try_from(value).map(Into::into).or(u16::try_from(value).map(Into::into)),
            4 => i32::try_from(value).map(Into::into).or(u32::try_from(value).map(Into::into)),
            8 => Ok(value.into()),
            _ => return None,
        }
        .ok()?;
        let step = Step::write(self.index, self.subindex, sized);
        Some(if self.is_optional != 0 { step.if_present() } else { step })
    }
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
    let number = u16::try_from(slave).map_err(|_| {
        call.argument("slave", format_args!("{slave} is out of range; allowed: 0 to 65535"))
    })?;
    if channel > 3 {
        return Err(
            call.argument("channel", format_args!("{channel} is out of range; allowed: 0 to 3"))
        );
    }
    let node = NodeId::new(node_id).ok_or_else(|| {
        call.argument("node_id", format_args!("{node_id} is out of range; allowed: 1 to 127"))
    })?;
    let settings = AxisConfig::new(NodeAddress { slave, channel, node });
    let settings = settings.with_target_step(target_step);
    axis.set(igh_cia402_axis_t::new(number, channel, node_id, &settings));
}

#[cfg(test)]
mod tests {
    use ecan_mcan_host::boundary::call;
    use std::ffi::c_int;

    use super::*;

    fn axis(target_step: i32) -> igh_cia402_axis_t {
        let mut axis = std::mem::MaybeUninit::uninit();
        // SAFETY: the pointer is valid for writing.
        let code = unsafe { igh_cia402_axis_init(axis.as_mut_ptr(), 2, 1, 5, target_step) };
        assert_eq!(code, 0);
        // SAFETY: filled by the call above.
        unsafe { axis.assume_init() }
    }

    fn to_rust(axis: &igh_cia402_axis_t) -> Result<AxisConfig, c_int> {
        let mut settings = None;
        let code = call("to_rust", |call| {
            settings = Some(axis.checked(call, 0)?);
            Ok(())
        });
        settings.ok_or(code)
    }

    fn defaults(target_step: i32) -> AxisConfig {
        let node = NodeId::new(5).unwrap();
        AxisConfig::new(NodeAddress { slave: 2, channel: 1, node }).with_target_step(target_step)
    }

    #[test]
    fn defaults_of_c_are_those_of_rust() {
        for target_step in [0, 10, -1000, 5000, i32::MIN] {
            assert_eq!(to_rust(&axis(target_step)), Ok(defaults(target_step)));
        }
    }

    #[test]
    fn limits_follow_the_step_limit_by_default() {
        let mut small = axis(0);
        small.step_limit = 3;
        assert_eq!(to_rust(&small), Ok(defaults(0).with_step_limit(3)));
        let mut large = axis(0);
        large.step_limit = 100_000;
        assert_eq!(to_rust(&large).unwrap().following_window, 800_000);
        large.following_window = 900_000;
        assert_eq!(to_rust(&large).unwrap().following_window, 900_000);
    }

    #[test]
    fn every_field_arrives() {
        let mut axis = axis(0);
        axis.mode = OperatingMode::CyclicVelocity.raw();
        (axis.range, axis.range_min, axis.range_max) = (2, -5, 7);
        (axis.has_bounds, axis.bound_min, axis.bound_max) = (1, -3, 3);
        (axis.steps_per_turn, axis.origin) = (4096.0, 11);
        (axis.check_identity, axis.vendor_id, axis.product_code) = (1, 0x99, 0x402);
        (axis.host_loss, axis.quick_stop) = (IGH_CIA402_UNCHANGED, -2);
        (axis.shutdown, axis.disable_operation, axis.halt, axis.fault_reaction) = (1, 0, 2, 3);
        axis.write_following_error = 1;
        (axis.following_error_window, axis.following_error_ms) = (12_000, 20);
        (axis.reset, axis.auto_resume, axis.write_position_limits) = (1, 1, 1);
        axis.further_count = 2;
        axis.further[0] =
            igh_cia402_object_t { value: -1, index: 0x2000, size: 2, ..Default::default() };
        axis.further[1] = igh_cia402_object_t {
            value: 200,
            index: 0x2001,
            subindex: 3,
            size: 1,
            is_optional: 1,
            reserved: [0; 3],
        };
        let drive = DriveConfig {
            reset: ecan_cia402::NodeReset::Communication,
            identity: Some((0x99, 0x402)),
            host_loss: None,
            quick_stop: Some(QuickStopOption::Other(-2)),
            shutdown: Some(StopOption::SlowDown),
            disable_operation: Some(StopOption::Disable),
            halt: Some(HaltOption::QuickStop),
            fault_reaction: Some(FaultReaction::CurrentLimit),
            following_error: Some((12_000, 20)),
            write_position_limits: true,
            further: vec![
                Step::write(0x2000, 0, -1_i16),
                Step::write(0x2001, 3, 200_u8).if_present(),
            ],
            ..DriveConfig::default()
        };
        let expected = AxisConfig {
            mode: OperatingMode::CyclicVelocity,
            range: PositionRange::Modulo { min: -5, max: 7 },
            bounds: Some((-3, 3)),
            scale: Scale::steps_per_turn(4096.0).with_origin(11),
            auto_resume: true,
            drive,
            ..defaults(0)
        };
        assert_eq!(to_rust(&axis), Ok(expected));
    }

    #[test]
    fn invalid_values_return_errors() {
        let config = Err(ecan_result_t::ECAN_ERR_CONFIG.code());
        let faulty = |change: fn(&mut igh_cia402_axis_t)| {
            let mut axis = axis(0);
            change(&mut axis);
            to_rust(&axis)
        };
        assert_eq!(faulty(|axis| axis.node_id = 128), config);
        assert_eq!(faulty(|axis| axis.mode = 2), config);
        assert_eq!(faulty(|axis| axis.range = 3), config);
        assert_eq!(faulty(|axis| axis.reset = 3), config);
        assert_eq!(faulty(|axis| axis.host_loss = 0x8000), config);
        assert_eq!(faulty(|axis| axis.further_count = 17), config);
        assert_eq!(faulty(|axis| axis.further_count = 1), config, "a size of 0");
        let unfilled = Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());
        assert_eq!(faulty(|axis| axis.seal = 0), unfilled);
    }
}
