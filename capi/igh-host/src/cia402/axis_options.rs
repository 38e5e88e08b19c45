//! Further settings of an axis of C: identity, process data, COB-IDs, guarding, feed-forward, modes, limits.

use ecan_canopen::{GuardingConfig, IdentityCheck, RevisionCheck};
use ecan_cia402::{
    AxisConfig, FeedForwardLimits, InputObject, OutputObject, PdoCobIds, ScaleSource, VlConfig,
};
use ecan_protocol::can::CanId;

use crate::milliseconds::duration;

use super::axis::igh_cia402_axis_t;
use super::numbers::{igh_cia402_revision_t, igh_cia402_scale_source_t};

/// Sets the settings of an axis. Reports every value that Rust's types cannot hold.
pub(super) fn apply(
    axis: &igh_cia402_axis_t,
    config: &mut AxisConfig,
    report: &mut dyn FnMut(&str, i64),
) {
    let chosen = |mask: u32, raw: u8| mask & 1 << raw != 0;
    let all = |count: usize| !(u32::MAX << count);
    if axis.outputs & !all(OutputObject::ALL.len()) != 0 {
        report("outputs", axis.outputs.into());
    }
    if axis.inputs & !all(InputObject::ALL.len()) != 0 {
        report("inputs", axis.inputs.into());
    }
    let outputs = OutputObject::ALL.iter().copied();
    config.outputs = outputs.filter(|it| chosen(axis.outputs, it.raw())).collect();
    let inputs = InputObject::ALL.iter().copied();
    config.inputs = inputs.filter(|it| chosen(axis.inputs, it.raw())).collect();
    config.feed_forward = FeedForwardLimits {
        velocity: axis.feed_forward_velocity,
        velocity_change: axis.feed_forward_velocity_change,
        torque: axis.feed_forward_torque,
        torque_change: axis.feed_forward_torque_change,
    };
    match scale_source(axis.scale_source) {
        Some(source) => config.scale_source = source,
        None => report("scale_source", axis.scale_source.into()),
    }
    config.cob_ids = PdoCobIds {
        rpdos: cob_ids("rpdo_cob_ids", &axis.rpdo_cob_ids, report),
        tpdos: cob_ids("tpdo_cob_ids", &axis.tpdo_cob_ids, report),
    };
    let drive = &mut config.drive;
    drive.guarding = guarding(axis);
    drive.identity = identity(axis, report);
    drive.output_mask = (axis.has_output_mask != 0).then_some(axis.output_mask);
    drive.interpolation_buffer = given(axis.interpolation_buffer);
    drive.torque_slope = given(axis.torque_slope);
    drive.vl = VlConfig {
        limits: given(axis.vl_velocity_max).map(|most| (axis.vl_velocity_min, most)),
        acceleration: given(axis.vl_acceleration).map(|change| (change, axis.vl_acceleration_s)),
        deceleration: given(axis.vl_deceleration).map(|change| (change, axis.vl_deceleration_s)),
    };
    drive.max_torque = given(axis.max_torque);
    drive.max_motor_speed = given(axis.max_motor_speed);
    drive.use_limits = axis.use_drive_limits != 0;
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

    use super::super::axis::{IGH_CIA402_MAX_PDOS, igh_cia402_axis_init};
    use super::super::process_data::{igh_cia402_input_t, igh_cia402_output_t};
    use super::*;

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
        expected.outputs = vec![OutputObject::TorqueOffset, OutputObject::DigitalOutputs];
        expected.inputs = vec![InputObject::Velocity, InputObject::VlVelocity];
        expected.feed_forward =
            FeedForwardLimits { velocity: 1, velocity_change: 2, torque: 3, torque_change: 4 };
        expected.scale_source = ScaleSource::Drive;
        expected.cob_ids = PdoCobIds {
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
        let config = AxisConfig {
            outputs: OutputObject::ALL.to_vec(),
            inputs: InputObject::ALL.to_vec(),
            ..config()
        };
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
