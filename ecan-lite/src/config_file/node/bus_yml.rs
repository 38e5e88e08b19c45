//! A bus of ros2_canopen: the file `bus.yml` of a configuration package.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use ecan_canopen::{
    BootReset, CobId, HostHeartbeat, MappingEntry, NodeId, OperatingMode, PdoDirection, object,
};
use ecan_cia402::{AxisConfig, InputObject, OutputObject, Scale};
use saphyr::{LoadableYamlNode, MarkedYaml, Scalar, YamlData};

use super::resolve::{Report, ResolvedNode};
use super::source::{NodeSource, ParameterSource, PdoSource, RevisionRule, RosAxis};
use crate::config_file::fault::{FileFaults, Located, TextLines};
use crate::config_file::network::MasterSource;

/// Sections that describe no node.
const SECTIONS: [&str; 4] = ["options", "master", "defaults", "nodes"];

/// Takes over the keys of another mapping, or of several (YAML 1.1).
const MERGE_KEY: &str = "<<";

/// Reads the nodes of a bus on a channel, and its master.
///
/// # Errors
/// The first fault of the syntax, or every other fault.
pub(crate) fn read(
    text: &str,
    slave: usize,
    channel: u8,
) -> Result<(MasterSource, Vec<NodeSource>), FileFaults> {
    let lines = TextLines::new(text);
    let documents = MarkedYaml::load_from_str(text).map_err(|error| {
        let marker = error.marker();
        let at = lines.offset(marker.line(), marker.col());
        lines.finish(vec![(at, error.info().to_owned())]).err().unwrap_or(FileFaults(Vec::new()))
    })?;
    let mut reader = Reader { lines: &lines, faults: Vec::new() };
    let mut master = MasterSource::default();
    let mut nodes = Vec::new();
    match documents.first() {
        Some(root) => {
            let root = reader.mapping(root, "the file");
            master = root.get("master").map(|node| reader.master(node)).unwrap_or_default();
            let defaults = root.get("defaults").map(|node| reader.mapping(node, "`defaults`"));
            let defaults = defaults.unwrap_or_default();
            let apart = root.pairs.iter().filter(|(name, _)| {
                !SECTIONS.contains(&name.value.as_str()) && !name.value.starts_with('.')
            });
            let listed = root.get("nodes").map(|node| reader.listed(node)).unwrap_or_default();
            for (name, value) in apart.cloned().chain(listed) {
                let own = reader.mapping(value, &format!("`{}`", name.value));
                let mut node = NodeSource::new(name.at, slave, channel);
                node.name = name.value;
                reader.node(&own.or(&defaults), &mut node);
                nodes.push(node);
            }
        }
        None => reader.faults.push((0, "the file is empty".to_owned())),
    }
    lines.finish(reader.faults)?;
    Ok((master, nodes))
}

type Node<'y> = &'y MarkedYaml<'y>;

/// A mapping with the locations of its keys.
#[derive(Clone, Default)]
struct Mapping<'y> {
    pairs: Vec<(Located<String>, Node<'y>)>,
}

impl<'y> Mapping<'y> {
    fn get(&self, key: &str) -> Option<Node<'y>> {
        self.pairs.iter().find(|(name, _)| name.value == key).map(|(_, value)| *value)
    }

    /// The keys of this mapping, and those of `defaults` that it does not have.
    fn or(mut self, defaults: &Self) -> Self {
        let own: BTreeSet<_> = self.pairs.iter().map(|(name, _)| name.value.clone()).collect();
        let others = defaults.pairs.iter().filter(|(name, _)| !own.contains(&name.value));
        self.pairs.extend(others.cloned());
        self
    }
}

struct Reader<'t> {
    lines: &'t TextLines<'t>,
    faults: Vec<(usize, String)>,
}

impl Reader<'_> {
    fn at(&self, node: Node<'_>) -> usize {
        self.lines.offset(node.span.start.line(), node.span.start.col())
    }

    fn fault(&mut self, node: Node<'_>, reason: String) {
        let at = self.at(node);
        self.faults.push((at, reason));
    }

    fn mapping<'y>(&mut self, node: Node<'y>, what: &str) -> Mapping<'y> {
        let YamlData::Mapping(mapping) = &node.data else {
            if !matches!(node.data, YamlData::Value(Scalar::Null)) {
                self.fault(node, format!("{what} must be a mapping of keys and values"));
            }
            return Mapping::default();
        };
        let (mut pairs, mut merged) = (Vec::new(), Vec::new());
        for (key, value) in mapping {
            match text_of(key) {
                Some(name) if name == MERGE_KEY => match &value.data {
                    YamlData::Sequence(list) => merged.extend(list),
                    _ => merged.push(value),
                },
                Some(name) => pairs.push((Located::new(name, self.at(key)), value)),
                None => self.fault(key, "a key must be a word or a number".to_owned()),
            }
        }
        merged.into_iter().fold(Mapping { pairs }, |own, other| {
            let other = self.mapping(other, "the value of `<<`");
            own.or(&other)
        })
    }

    /// `nodes` is a mapping, or a list of mappings of one name each.
    fn listed<'y>(&mut self, node: Node<'y>) -> Vec<(Located<String>, Node<'y>)> {
        match &node.data {
            YamlData::Sequence(list) => {
                list.iter().flat_map(|one| self.mapping(one, "an entry of `nodes`").pairs).collect()
            }
            _ => self.mapping(node, "`nodes`").pairs,
        }
    }

    fn integer<T: TryFrom<i64>>(
        &mut self,
        key: &str,
        node: Node<'_>,
        (min, max): (i64, i64),
    ) -> Option<T> {
        let found = match &node.data {
            YamlData::Value(Scalar::Integer(number)) => Some(*number),
            _ => None,
        };
        let in_range = found.filter(|number| (min..=max).contains(number));
        if in_range.is_none() {
            let found = text_of(node).unwrap_or_else(|| "the value".to_owned());
            self.fault(node, format!("`{key}` = {found} is out of range; allowed: {min} to {max}"));
        }
        T::try_from(in_range?).ok()
    }

    fn flag(&mut self, key: &str, node: Node<'_>) -> Option<bool> {
        match &node.data {
            YamlData::Value(Scalar::Boolean(flag)) => Some(*flag),
            YamlData::Value(Scalar::Integer(number @ 0..=1)) => Some(*number == 1),
            _ => {
                self.fault(node, format!("`{key}` must be true or false"));
                None
            }
        }
    }

    fn number(&mut self, key: &str, node: Node<'_>) -> Option<f64> {
        let number = match &node.data {
            YamlData::Value(Scalar::Integer(number)) => Some(*number as f64),
            YamlData::Value(Scalar::FloatingPoint(number)) => Some(number.into_inner()),
            _ => None,
        };
        if number.is_none() {
            self.fault(node, format!("`{key}` must be a number"));
        }
        number
    }

    fn mode(&mut self, key: &str, node: Node<'_>) -> Option<Located<i8>> {
        let raw = self.integer(key, node, (-128, 127));
        raw.map(|raw| Located::new(raw, self.at(node)))
    }

    fn master(&mut self, node: Node<'_>) -> MasterSource {
        let mut master = MasterSource::default();
        for (key, value) in self.mapping(node, "`master`").pairs {
            match key.value.as_str() {
                "node_id" => {
                    let raw: Option<u8> = self.integer("node_id", value, (1, 255));
                    master.node = raw.and_then(NodeId::from_raw);
                }
                "sync_period" => {
                    let period = self.integer("sync_period", value, (0, u32::MAX.into()));
                    master.sync_period_us =
                        period.map(|period| Located::new(period, self.at(value)));
                }
                "sync_overflow" => {
                    let overflow = self.integer("sync_overflow", value, (0, 240));
                    master.sync_overflow =
                        overflow.map(|overflow| Located::new(overflow, self.at(value)));
                }
                "heartbeat_multiplier" => {
                    master.heartbeat_multiplier = self.number("heartbeat_multiplier", value);
                }
                "heartbeat_producer" => {
                    master.heartbeat_ms = self.integer("heartbeat_producer", value, (0, 0xFFFF));
                }
                _ => {}
            }
        }
        master
    }

    fn node(&mut self, keys: &Mapping<'_>, node: &mut NodeSource) {
        const U32: (i64, i64) = (0, 0xFFFF_FFFF);
        const U16: (i64, i64) = (0, 0xFFFF);
        node.settings.reset = Some(BootReset::Communication);
        // As ros2_canopen: a node is optional unless the file states otherwise.
        node.settings.is_mandatory = Some(false);
        node.settings.heartbeat_ms = Some(0);
        node.settings.revision = Some(RevisionRule::Exact);
        let mut ignored = Vec::new();
        for (key, value) in &keys.pairs {
            let (at, name) = (self.at(value), key.value.as_str());
            match name {
                "node_id" => {
                    let raw: Option<u8> = self.integer(name, value, (1, 127));
                    node.node = raw.and_then(NodeId::from_raw).map(|value| Located::new(value, at));
                }
                "dcf" => match text_of(value) {
                    Some(path) => node.device_file = Some(Located::new(path.into(), at)),
                    None => self.fault(value, "`dcf` must be the name of a file".to_owned()),
                },
                "mandatory" => node.settings.is_mandatory = self.flag(name, value),
                "reset_communication" => {
                    if self.flag(name, value) == Some(false) {
                        node.settings.reset = Some(BootReset::None);
                    }
                }
                "boot_timeout_ms" => {
                    node.settings.boot_timeout_ms = self.integer(name, value, (1, 3_600_000))
                }
                // 0 accepts every one.
                "revision_number" => match self.integer(name, value, U32) {
                    Some(0) => node.settings.revision = Some(RevisionRule::Any),
                    revision => node.settings.revision_number = revision,
                },
                "serial_number" => {
                    node.settings.serial_number =
                        self.integer(name, value, U32).filter(|number| *number != 0);
                }
                "software_version" => {
                    node.settings.software =
                        self.integer(name, value, U32).filter(|number| *number != 0);
                }
                "restore_configuration" => {
                    node.settings.restores =
                        Some(self.integer(name, value, (0, 127)).filter(|group| *group != 0));
                }
                "heartbeat_producer" => node.settings.heartbeat_ms = self.integer(name, value, U16),
                "sdo" => self.sdo(value, node),
                "rpdo" => self.pdos(value, PdoDirection::Receive, node),
                "tpdo" => self.pdos(value, PdoDirection::Transmit, node),
                "guard_time" => {
                    let ms: Option<u16> = self.integer(name, value, U16);
                    node.settings.guard_time_ms = ms.filter(|ms| *ms > 0);
                    node.settings.guard_time_at = at;
                }
                "life_time_factor" => {
                    node.settings.life_time_factor =
                        self.integer(name, value, (0, 0xFF)).filter(|factor| *factor > 0);
                }
                "driver" => {
                    // Also that of lifecycle nodes.
                    let driver = text_of(value).unwrap_or_default();
                    node.ros_axis.is_axis = driver.ends_with("Cia402Driver");
                }
                "position_mode" => node.ros_axis.modes[0] = self.mode(name, value),
                "velocity_mode" => node.ros_axis.modes[1] = self.mode(name, value),
                "torque_mode" => node.ros_axis.modes[2] = self.mode(name, value),
                "scale_pos_to_dev" => node.ros_axis.position_units = self.number(name, value),
                "scale_vel_to_dev" => node.ros_axis.velocity_units = self.number(name, value),
                "offset_pos_to_dev" => node.ros_axis.origin = self.number(name, value),
                "heartbeat_consumer" => {
                    node.watches_master =
                        self.flag(name, value).map(|value| Located::new(value, at));
                }
                "error_behavior" => self.error_behavior(value, node),
                "num_channels" if matches!(value.data, YamlData::Value(Scalar::Integer(1))) => {}
                "software_file" | "num_channels" | "channel_names" | "channels" => {
                    self.fault(
                        value,
                        format!("`{name}` is not supported; use the configuration file"),
                    );
                }
                _ => ignored.push(format!("`{name}`")),
            }
        }
        if !ignored.is_empty() {
            node.notes.push(format!("ignored in its bus.yml: {}", ignored.join(", ")));
        }
        if node.device_file.is_none() {
            self.faults.push((node.at, format!("`{}` has no `dcf`: the EDS or DCF", node.name)));
        }
    }

    /// Reaction to each class of errors: the entries of 0x1029.
    fn error_behavior(&mut self, classes: Node<'_>, node: &mut NodeSource) {
        for (class, value) in self.mapping(classes, "`error_behavior`").pairs {
            let Some(subindex) = class.value.parse::<u8>().ok().filter(|factor| *factor > 0) else {
                let text =
                    format!("error class {} is out of range; allowed: 1 to 255", class.value);
                self.faults.push((class.at, text));
                continue;
            };
            let object = format!("0x{:04X}:{subindex}", object::ERROR_BEHAVIOUR);
            if let Some(value) = self.integer::<u8>("error_behavior", value, (0, 0xFF)) {
                node.parameters.push(ParameterSource {
                    object: Located::new(object, class.at),
                    value: Located::new(value.to_string(), class.at),
                });
            }
        }
    }

    fn sequence<'y>(&mut self, key: &str, node: Node<'y>) -> Vec<Node<'y>> {
        match &node.data {
            YamlData::Sequence(list) => list.iter().collect(),
            _ => {
                self.fault(node, format!("`{key}` must be a list"));
                Vec::new()
            }
        }
    }

    /// Index and subindex of an entry, as a text.
    fn object(&mut self, keys: &Mapping<'_>, node: Node<'_>) -> Option<Located<String>> {
        let Some(index) = keys.get("index") else {
            self.fault(node, "`index` is missing".to_owned());
            return None;
        };
        let index: u16 = self.integer("index", index, (1, 0xFFFF))?;
        let subindex: u8 = match keys.get("sub_index") {
            Some(subindex) => self.integer("sub_index", subindex, (0, 0xFF))?,
            None => 0,
        };
        Some(Located::new(format!("0x{index:04X}:{subindex:02X}"), self.at(node)))
    }

    fn sdo(&mut self, list: Node<'_>, node: &mut NodeSource) {
        for entry in self.sequence("sdo", list) {
            let keys = self.mapping(entry, "an entry of `sdo`");
            let object = self.object(&keys, entry);
            let value = keys.get("value").and_then(|value| Some((text_of(value)?, self.at(value))));
            match (object, value) {
                (Some(object), Some((value, at))) => {
                    let value = Located::new(value, at);
                    node.parameters.push(ParameterSource { object, value });
                }
                (Some(_), None) => self.fault(entry, "`value` is missing".to_owned()),
                (None, _) => {}
            }
        }
    }

    fn pdos(&mut self, pdos: Node<'_>, direction: PdoDirection, node: &mut NodeSource) {
        for (number, pdo) in self.mapping(pdos, "the PDOs").pairs {
            let Some(number) =
                number.value.parse().ok().filter(|number| (1..=512).contains(number))
            else {
                let text =
                    format!("PDO number {} is out of range; allowed: 1 to 512", number.value);
                self.faults.push((number.at, text));
                continue;
            };
            let mut source = PdoSource::new(self.at(pdo), direction, number);
            for (key, value) in self.mapping(pdo, "a PDO").pairs {
                let at = self.at(value);
                match key.value.as_str() {
                    "enabled" => source.is_enabled = self.flag("enabled", value).unwrap_or(true),
                    "cob_id" if text_of(value).is_some_and(|text| text == "auto") => {
                        source.is_predefined = true;
                    }
                    "cob_id" => {
                        let id = self.integer("cob_id", value, (1, 0x7FF));
                        source.cob_id = id.map(|id| Located::new(id, at));
                    }
                    "transmission" => {
                        let raw = self.integer("transmission", value, (0, 255));
                        source.transmission = raw.map(|raw| Located::new(raw, at));
                    }
                    "inhibit_time" => {
                        source.inhibit_time = self.integer("inhibit_time", value, (0, 0xFFFF));
                    }
                    "sync_start" => {
                        source.sync_start = self.integer("sync_start", value, (0, 240));
                    }
                    name @ ("event_timer" | "event_deadline") => {
                        source.event_timer_ms = self.integer(name, value, (0, 0xFFFF));
                    }
                    "mapping" => {
                        let mut objects = Vec::new();
                        for entry in self.sequence("mapping", value) {
                            let keys = self.mapping(entry, "an entry of `mapping`");
                            objects.extend(self.object(&keys, entry));
                        }
                        source.objects = Some(objects);
                    }
                    name => self.faults.push((key.at, format!("unknown key `{name}` of a PDO"))),
                }
            }
            node.pdos.push(source);
        }
    }
}

/// A scalar as text.
fn text_of(node: Node<'_>) -> Option<String> {
    let YamlData::Value(scalar) = &node.data else { return None };
    Some(match scalar {
        Scalar::String(text) => text.to_string(),
        Scalar::Integer(number) => number.to_string(),
        Scalar::FloatingPoint(number) => number.to_string(),
        Scalar::Boolean(flag) => u8::from(*flag).to_string(),
        Scalar::Null => return None,
    })
}

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
        match OperatingMode::from_raw(mode.value).filter(|mode| *mode != OperatingMode::Homing) {
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
        let predefined = u8::try_from(pdo.number).ok().filter(|number| (1..=4).contains(number));
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
    let object = OutputObject::ALL.iter().copied().find(|object| object.entry() == *entry);
    match object {
        Some(object) if object.is_feed_forward() => {
            Err("a feed-forward needs limits; use `[[node]]` with `[node.axis.feed_forward]`")
        }
        Some(object) => {
            axis.pdos.outputs.push(object);
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
    match InputObject::ALL.iter().copied().find(|object| object.entry() == *entry) {
        Some(object) => {
            axis.pdos.inputs.push(object);
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
