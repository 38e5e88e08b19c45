//! Process data of an axis of a file.

use ecan_cia402::{AxisConfig, InputObject, OutputObject};
use ecan_protocol::can::CanId;

use crate::config_file::document::{Table, store};

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
pub(crate) fn read(table: &mut Table<'_, '_>, axis: &mut AxisConfig) {
    store(&mut axis.pdo_number, table.unsigned("pdo_number", (1, 512)));
    axis.cob_ids.rpdos = read_cob_ids(table, "rpdo_cob_ids");
    axis.cob_ids.tpdos = read_cob_ids(table, "tpdo_cob_ids");
    axis.inputs = read_objects(table, "inputs", &INPUTS);
    axis.outputs = read_objects(table, "outputs", &OUTPUTS);
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
    let is_repeated = |nth: usize, object: &T| objects.iter().take(nth).any(|it| it == object);
    let repeated = objects.iter().enumerate().find(|(nth, object)| is_repeated(*nth, object));
    let name = |object: &T| words.iter().find(|it| it.1 == *object).map_or("", |it| it.0);
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
        assert!(InputObject::ALL.iter().all(|object| INPUTS.iter().any(|it| it.1 == *object)));
        assert!(OutputObject::ALL.iter().all(|object| OUTPUTS.iter().any(|it| it.1 == *object)));
    }
}
