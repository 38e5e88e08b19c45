//! An axis of a bus in the form of ros2_canopen: a node with the driver `Cia402Driver`.

use std::f64::consts::TAU;

use ecan_canopen::{CobId, HostHeartbeat, MappingEntry, OperatingMode, PdoDirection, object};
use ecan_cia402::{AxisConfig, InputObject, OutputObject, Scale};

use super::resolve::{Report, ResolvedNode};
use super::source::RosAxis;

/// Units of the device per SI unit if the file states none, as in ros2_canopen.
const UNITS: f64 = 1_000.0;

/// Objects of the targets; the mode selects the one that is mapped.
const TARGETS: [u16; 5] = [
    object::TARGET_POSITION,
    object::TARGET_VELOCITY,
    object::TARGET_TORQUE,
    object::INTERPOLATION_DATA,
    object::VL_TARGET_VELOCITY,
];

/// The axis of a node whose names are resolved. Angles are in radians.
pub(crate) fn axis(
    source: &RosAxis,
    host_heartbeat_ms: Option<u16>,
    node: &ResolvedNode,
    report: &mut Report<'_>,
) -> AxisConfig {
    let mut axis = AxisConfig::new(node.description.address);
    if let Some(mode) = source.modes.iter().flatten().next() {
        match OperatingMode::from_raw(mode.value).filter(|it| *it != OperatingMode::Homing) {
            Some(known) => axis.mode = known,
            None => report(
                mode.at,
                format!("mode {} is invalid for an axis; allowed: 1 to 4, 7 to 10", mode.value),
            ),
        }
    }
    axis.scale = Scale::steps_per_turn(source.position_units.unwrap_or(UNITS) * TAU)
        .with_origin(source.origin.unwrap_or(0.0).round() as i32)
        .with_velocity_units(source.velocity_units.unwrap_or(UNITS) * TAU);
    if let Some(ms) = host_heartbeat_ms {
        axis.drive.host_heartbeat_ms = ms;
    }
    for (pdo, at) in node.description.pdos.iter().zip(&node.pdos) {
        let predefined = u8::try_from(pdo.number).ok().filter(|it| (1..=4).contains(it));
        let predefined = predefined.map(|number| match pdo.direction {
            PdoDirection::Receive => CobId::rpdo(axis.address.node, number).can_id(),
            PdoDirection::Transmit => CobId::tpdo(axis.address.node, number).can_id(),
        });
        if predefined != Some(pdo.cob_id) {
            let text = "an axis has the COB-IDs of the predefined connection set, of PDO 1 to 4; set \
                        `cob_id: auto`";
            report(*at, text.to_owned());
        }
        for entry in &pdo.entries {
            let added = match pdo.direction {
                PdoDirection::Receive => add_output(entry, &mut axis),
                PdoDirection::Transmit => add_input(entry, &mut axis),
            };
            if let Err(reason) = added {
                let (index, subindex) = (entry.index, entry.subindex);
                report(*at, format!("0x{index:04X}:{subindex:02X}: {reason}"));
            }
        }
    }
    axis
}

fn add_output(entry: &MappingEntry, axis: &mut AxisConfig) -> Result<(), &'static str> {
    let object = OutputObject::ALL.iter().copied().find(|it| it.entry() == *entry);
    match object {
        Some(object) if object.is_feed_forward() => {
            Err("a feed-forward needs limits; use `[[node]]` with `[node.axis.feed_forward]`")
        }
        Some(object) => {
            axis.outputs.push(object);
            Ok(())
        }
        None if entry.index == object::CONTROLWORD || TARGETS.contains(&entry.index) => Ok(()),
        None => {
            Err("the RPDOs of an axis cannot contain it; allowed: controlword, targets, mode, \
                     0x60B8, 0x60FE:01; set the value in `sdo`")
        }
    }
}

fn add_input(entry: &MappingEntry, axis: &mut AxisConfig) -> Result<(), &'static str> {
    match InputObject::ALL.iter().copied().find(|it| it.entry() == *entry) {
        Some(object) => {
            axis.inputs.push(object);
            Ok(())
        }
        None if matches!(entry.index, object::STATUSWORD | object::POSITION_ACTUAL) => Ok(()),
        None => Err("the TPDOs of an axis cannot contain it; allowed: 0x6041, 0x6064, 0x606C, \
                     0x6077, 0x603F, 0x60FD, 0x6061, 0x60F4, 0x60B9 to 0x60BD, 0x6044"),
    }
}

/// Consumer heartbeat time of a node that watches the master, in milliseconds.
pub(crate) fn consumer_time_ms(host: HostHeartbeat, multiplier: Option<f64>) -> u16 {
    /// As in ros2_canopen.
    const MULTIPLIER: f64 = 3.0;
    let ms = host.period.as_secs_f64() * 1_000.0 * multiplier.unwrap_or(MULTIPLIER);
    // Saturates.
    ms.round().max(1.0) as u16
}
