//! Check of a network as a whole.

use std::collections::{BTreeMap, BTreeSet};

use ecan_mcan_port::{ChannelLoad, FrameRate, FrameStream};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::sequence::{Action, Expectation, Tolerance};

use super::node_description::{
    ChannelDescription, NetworkDescription, NetworkFault, NetworkFaultKind, NodeDescription,
    PdoName,
};
use crate::device_file::{BitRates, DeviceFile};
use crate::network::boot::Subject;
use crate::network::config::Step;
use crate::network::pdo_mapping::{PdoDirection, PdoMapping};
use crate::{CobId, MappingEntry, NodeId, PdoCobId, TransmissionType, object};

impl NetworkDescription {
    /// Checks the description as a whole and returns every fault: addresses, bit rates, PDOs,
    /// COB-IDs over each bus, values, bus load. Nothing is sent.
    pub fn check(&self) -> Vec<NetworkFault> {
        let mut faults = Vec::new();
        self.check_addresses(&mut faults);
        for (nth, node) in self.nodes.iter().enumerate() {
            let mut report = |kind| faults.push(NetworkFault { nodes: vec![nth], kind });
            check_pdos(node, &mut report);
            check_parameters(node, &mut report);
            check_steps(node, &mut report);
        }
        check_cob_ids(self, &mut faults);
        check_load(self, &mut faults);
        faults
    }

    fn check_addresses(&self, faults: &mut Vec<NetworkFault>) {
        let nodes = || self.nodes.iter().enumerate();
        for (nth, node) in nodes() {
            let address = node.address;
            let mut fault = |nodes, kind| faults.push(NetworkFault { nodes, kind });
            if let Some((first, _)) = nodes().take(nth).find(|(_, other)| other.address == address)
            {
                fault(vec![first, nth], NetworkFaultKind::Duplicate { address });
            }
            if self.host_heartbeat.is_some_and(|host| host.node == address.node) {
                fault(vec![nth], NetworkFaultKind::HostNode { node: address.node });
            }
            let key = (address.slave, address.channel);
            match self.channels.iter().find(|channel| (channel.slave, channel.channel) == key) {
                None => fault(vec![nth], NetworkFaultKind::Channel { address }),
                Some(channel) => {
                    let bitrate = channel.can.nominal_bitrate;
                    let rates = node.device.as_ref().map(|device| &device.device_info.bit_rates);
                    // A file without any bit rate states nothing.
                    let excludes =
                        |rates: &BitRates| !rates.kbit_per_s.is_empty() && !rates.contains(bitrate);
                    if rates.is_some_and(excludes) {
                        fault(vec![nth], NetworkFaultKind::BitRate { bitrate });
                    }
                }
            }
        }
    }
}

/// Data types are below.
const FIRST_OBJECT: u16 = 0x1000;

/// Sender of a COB-ID: its node, and a text.
type Sender = (Option<usize>, String);

pub(super) fn check_cob_ids(network: &NetworkDescription, faults: &mut Vec<NetworkFault>) {
    for channel in &network.channels {
        let here = |node: &NodeDescription| {
            (node.address.slave, node.address.channel) == (channel.slave, channel.channel)
        };
        let nodes = || network.nodes.iter().enumerate().filter(|(_, node)| here(node));
        let mut senders = BTreeMap::new();
        let mut add = |id: CanId, sender: Sender| {
            let key = (id.is_extended(), id.raw());
            match senders.get(&key) {
                None => _ = senders.insert(key, sender),
                Some((first_node, first)) if *first_node != sender.0 || *first != sender.1 => {
                    let nodes = first_node.iter().copied().chain(sender.0).collect();
                    let (first, second): (&String, _) = (first, sender.1);
                    let kind = NetworkFaultKind::Collision { id, first: first.clone(), second };
                    faults.push(NetworkFault { nodes, kind });
                }
                Some(_) => {}
            }
        };
        for (id, text) in [(CobId::NMT, "NMT"), (CobId::SYNC, "SYNC"), (CobId::TIME, "TIME")] {
            add(id.can_id(), (None, text.to_owned()));
        }
        if let Some(host) = network.host_heartbeat {
            add(CobId::heartbeat(host.node).can_id(), (None, "the host's heartbeat".to_owned()));
        }
        for (nth, node) in nodes() {
            for (id, what) in services(node) {
                add(id, (Some(nth), format!("{what} of {}", node.title())));
            }
        }
        for (nth, node) in nodes() {
            for (pdo, id) in
                valid_pdos(node).filter(|(pdo, _)| pdo.direction == PdoDirection::Transmit)
            {
                add(id, (Some(nth), format!("{pdo} of {}", node.title())));
            }
        }
    }
}

/// COB-IDs of the services of a node, except PDOs.
fn services(node: &NodeDescription) -> Vec<(CanId, &'static str)> {
    let id = node.address.node;
    let emcy = number(node, object::EMCY_COB_ID, 0).and_then(PdoCobId::from_raw);
    let emcy = match emcy {
        Some(emcy) => emcy.is_valid.then_some(emcy.id),
        None => Some(CobId::emcy(id).can_id()),
    };
    let mut services = vec![
        (CobId::sdo_client(id).can_id(), "SDO requests"),
        (CobId::sdo_server(id).can_id(), "SDO responses"),
        (CobId::heartbeat(id).can_id(), "heartbeat"),
    ];
    services.extend(emcy.map(|id| (id, "EMCY")));
    services
}

/// PDOs of a node that exist after its boot-up: those that are described, and those that exist by
/// its device file.
fn valid_pdos(node: &NodeDescription) -> impl Iterator<Item = (PdoName, CanId)> + '_ {
    let described = node.pdos.iter().map(|pdo| {
        let PdoName { direction, number } =
            PdoName { direction: pdo.direction, number: pdo.number };
        (PdoName { direction, number }, pdo.cob_id)
    });
    let name = |index: u16| match index {
        0x1400..=0x15FF => {
            Some(PdoName { direction: PdoDirection::Receive, number: index - 0x1400 + 1 })
        }
        0x1800..=0x19FF => {
            Some(PdoName { direction: PdoDirection::Transmit, number: index - 0x1800 + 1 })
        }
        _ => None,
    };
    let is_described = |pdo: &PdoName| {
        node.pdos.iter().any(|other| (other.direction, other.number) == (pdo.direction, pdo.number))
            || node.disabled_pdos.contains(&(pdo.direction, pdo.number))
    };
    let objects = node.device.iter().flat_map(|device| device.objects());
    let by_file = objects.filter_map(move |object| {
        let pdo = name(object.index).filter(|pdo| !is_described(pdo))?;
        let cob_id = PdoCobId::from_raw(number(node, object.index, 1)?)?;
        cob_id.is_valid.then_some((pdo, cob_id.id))
    });
    described.chain(by_file)
}

/// Value of an object after the boot-up, as far as override and device file state it.
fn number(node: &NodeDescription, index: u16, subindex: u8) -> Option<u32> {
    if let Some(value) =
        node.overrides.iter().find(|value| (value.index, value.subindex) == (index, subindex))
    {
        let bytes = value.data.first_chunk::<4>()?;
        return Some(u32::from_le_bytes(*bytes));
    }
    let entry = node.device.as_ref()?.entry(index, subindex)?;
    let value = entry.configured_value(node.address.node)?.to_integer()?;
    u32::try_from(value).ok()
}

pub(super) fn check_load(network: &NetworkDescription, faults: &mut Vec<NetworkFault>) {
    for channel in &network.channels {
        let streams = network.streams(channel);
        let load = ChannelLoad::of(&streams, &channel.can, network.cycle_ns);
        if load.most > 1.0 {
            let ChannelDescription { slave, channel, .. } = *channel;
            let kind = NetworkFaultKind::Load { slave, channel, share: load.most };
            faults.push(NetworkFault { nodes: Vec::new(), kind });
        }
    }
}

impl NetworkDescription {
    /// The periodic frames of a channel: SYNC, described PDOs, heartbeats. An event-driven PDO counts
    /// with its event timer, or with its inhibit time if it has no event timer.
    pub fn streams(&self, channel: &ChannelDescription) -> Vec<FrameStream> {
        let ChannelDescription { slave, channel, .. } = *channel;
        let per_sync = self.sync.map_or(1, |sync| sync.every_cycles.max(1));
        let to_bus = |frame, rate| FrameStream::to_bus(slave, channel, frame, rate);
        let from_bus = |frame, rate| FrameStream::from_bus(slave, channel, frame, rate);
        let mut streams = Vec::new();
        if let Some(sync) = &self.sync {
            let length = usize::from(sync.counter_overflow.is_some());
            let rate = FrameRate::EveryCycles(per_sync);
            streams.extend(frame(CobId::SYNC.can_id(), length).map(|frame| to_bus(frame, rate)));
        }
        if let Some(host) = &self.host_heartbeat {
            let rate = FrameRate::PerSecond(1.0 / host.period.as_secs_f64().max(1e-3));
            let id = CobId::heartbeat(host.node).can_id();
            streams.extend(frame(id, 1).map(|frame| to_bus(frame, rate)));
        }
        let here = self
            .nodes
            .iter()
            .filter(|node| (node.address.slave, node.address.channel) == (slave, channel));
        for node in here {
            let life_sign_ms = match node.boot.guarding {
                Some(guarding) => guarding.guard_time.as_secs_f64() * 1e3,
                None => node.boot.heartbeat_ms.into(),
            };
            if life_sign_ms > 0.0 {
                let rate = FrameRate::PerSecond(1e3 / life_sign_ms);
                let id = CobId::heartbeat(node.address.node).can_id();
                streams.extend(frame(id, 1).map(|frame| from_bus(frame, rate)));
            }
            for pdo in &node.pdos {
                let Some(frame) = frame(pdo.cob_id, pdo.length()) else { continue };
                let Some(rate) = rate(pdo, per_sync) else { continue };
                streams.push(match pdo.direction {
                    PdoDirection::Receive => to_bus(frame, rate),
                    PdoDirection::Transmit => from_bus(frame, rate),
                });
            }
        }
        streams
    }
}

/// Rate of a PDO; `None` if only events of the device decide it.
fn rate(pdo: &PdoMapping, cycles_per_sync: u32) -> Option<FrameRate> {
    match pdo.transmission {
        TransmissionType::Synchronous(nth) => {
            Some(FrameRate::EveryCycles(cycles_per_sync.saturating_mul(u32::from(nth.max(1)))))
        }
        TransmissionType::SynchronousAcyclic => Some(FrameRate::EveryCycles(cycles_per_sync)),
        _ => match (pdo.event_timer_ms, pdo.inhibit_time) {
            (Some(ms @ 1..), _) => Some(FrameRate::PerSecond(1e3 / f64::from(ms))),
            (_, Some(time @ 1..)) => Some(FrameRate::PerSecond(1e4 / f64::from(time))),
            _ => None,
        },
    }
}

/// A frame of zeros; none beyond eight bytes, which `pdo_check` reports.
fn frame(id: CanId, length: usize) -> Option<CanFrame> {
    CanFrame::classic(id, [0; 8].get(..length)?).ok()
}

pub(super) fn check_parameters(node: &NodeDescription, report: &mut impl FnMut(NetworkFaultKind)) {
    let Some(device) = node.device.as_deref() else { return };
    for value in &node.overrides {
        let faults = write_fault(device, node.address.node, value.subject(), Some(&value.data));
        faults.into_iter().for_each(&mut *report);
    }
}

/// Checks the steps that configure a node: what its device file excludes would end the boot-up. One fault for each
/// object; a missing PDO has its own.
fn check_steps(node: &NodeDescription, report: &mut impl FnMut(NetworkFaultKind)) {
    let Some(device) = node.device.as_deref() else { return };
    // Invalid values and PDOs have their own faults.
    let boot = node.boot_config().unwrap_or_default();
    let own = || boot.all_steps().collect();
    let steps: Vec<Step> = node.setup.clone().unwrap_or_else(own);
    let mut reported = BTreeSet::new();
    for Step { action, purpose, tolerance } in steps {
        let subject = |index, subindex| {
            let name = device.entry(index, subindex).map(|entry| device.label(entry).into());
            Subject { index, subindex, name }
        };
        let write = |index, subindex, data: Option<&[u8]>| {
            write_fault(device, node.address.node, subject(index, subindex), data)
        };
        let fault = match action {
            Action::Write { index, subindex, value } => {
                write(index, subindex, Some(value.as_bytes()))
            }
            Action::Modify { index, subindex, .. } => write(index, subindex, None),
            Action::Read { index, subindex } | Action::Await { index, subindex, .. } => {
                let is_missing = device.entry(index, subindex).is_none();
                is_missing
                    .then(|| NetworkFaultKind::NoParameter { subject: subject(index, subindex) })
            }
            Action::Expect { index, subindex, expected } => {
                expected_fault(node, device, subject(index, subindex), expected)
            }
            Action::Pause(_) | Action::Device(_) => None,
        };
        let is_tolerated = matches!(
            (tolerance, &fault),
            (Tolerance::Any, _)
                | (Tolerance::Missing, Some(NetworkFaultKind::NoParameter { .. }))
                | (Tolerance::ReadOnly, Some(NetworkFaultKind::ReadOnly { .. }))
        );
        let Some(fault) = fault.filter(|_| !is_tolerated) else { continue };
        let is_of_missing_pdo = match action.index() {
            Some(index @ 0x1400..=0x1BFF) => device.object(index & !0x200).is_none(),
            _ => false,
        };
        if !is_of_missing_pdo && reported.insert(fault.to_string()) {
            report(NetworkFaultKind::Step { purpose, fault: Box::new(fault) });
        }
    }
}

/// Fault of a write to an object, without its value if that is not known.
fn write_fault(
    device: &DeviceFile,
    node: NodeId,
    subject: Subject,
    data: Option<&[u8]>,
) -> Option<NetworkFaultKind> {
    let Some(entry) = device.entry(subject.index, subject.subindex) else {
        return Some(NetworkFaultKind::NoParameter { subject });
    };
    if !entry.access.is_writable() {
        return Some(NetworkFaultKind::ReadOnly { subject });
    }
    let data = data?;
    if let Some(expected) = entry.data_type.size().filter(|size| *size != data.len()) {
        return Some(NetworkFaultKind::ValueLength { subject, expected, found: data.len() });
    }
    let number = entry.data_type.decode(data).ok()?.to_integer()?;
    let (low, high) = entry.limits(node);
    let (range_low, range_high) = entry.data_type.range().unwrap_or_default();
    let low = low.and_then(|value| value.to_integer()).unwrap_or(range_low);
    let high = high.and_then(|value| value.to_integer()).unwrap_or(range_high);
    let (is_inside, value) = ((low..=high).contains(&number), number.to_string());
    let (low, high) = (low.to_string(), high.to_string());
    (!is_inside).then_some(NetworkFaultKind::Limit { subject, value, low, high })
}

/// Fault of a check of an object: it does not exist, or it is part of a PDO and has another value for ever.
fn expected_fault(
    node: &NodeDescription,
    device: &DeviceFile,
    subject: Subject,
    expected: Expectation,
) -> Option<NetworkFaultKind> {
    let (index, subindex) = (subject.index, subject.subindex);
    let Some(entry) = device.entry(index, subindex) else {
        return Some(NetworkFaultKind::NoParameter { subject });
    };
    if entry.access.is_writable() || !matches!(index, 0x1400..=0x1BFF) {
        return None;
    }
    let found = u64::from(number(node, index, subindex)?);
    let expected = match expected {
        Expectation::Equals(value) | Expectation::Masked { value, .. }
            if !expected.is_met_by(found) =>
        {
            value
        }
        _ => return None,
    };
    Some(NetworkFaultKind::Fixed { subject, found, expected })
}

pub(super) fn check_pdos(node: &NodeDescription, report: &mut impl FnMut(NetworkFaultKind)) {
    for (nth, pdo) in node.pdos.iter().enumerate() {
        let name = PdoName { direction: pdo.direction, number: pdo.number };
        let same =
            |other: &PdoMapping| (other.direction, other.number) == (pdo.direction, pdo.number);
        if node.pdos.iter().take(nth).any(same) {
            report(NetworkFaultKind::DuplicatePdo { pdo: name });
        }
        if let Err(error) = pdo.steps() {
            report(NetworkFaultKind::Pdo { pdo: name, error });
        }
        if is_reserved(pdo.cob_id.raw()) && !pdo.cob_id.is_extended() {
            report(NetworkFaultKind::Reserved { pdo: name, id: pdo.cob_id });
        }
        let Some(device) = node.device.as_deref() else { continue };
        let index = pdo.communication_index();
        if device.object(index).is_none() {
            report(NetworkFaultKind::NoPdo { pdo: name, index });
        }
        for (subindex, entry) in (1..).zip(&pdo.entries) {
            // Devices have data types as gaps in mappings of their own.
            let is_own_gap = entry.index < FIRST_OBJECT
                && number(node, pdo.mapping_index(), subindex) == Some(entry.raw());
            if !is_own_gap {
                check_entry(device, name, *entry, report);
            }
        }
    }
}

fn check_entry(
    device: &DeviceFile,
    pdo: PdoName,
    entry: MappingEntry,
    report: &mut impl FnMut(NetworkFaultKind),
) {
    if is_dummy(device, pdo.direction, entry) {
        return;
    }
    let Some(object) = device.entry(entry.index, entry.subindex) else {
        return report(NetworkFaultKind::NoObject { pdo, entry });
    };
    let subject = Subject {
        index: entry.index,
        subindex: entry.subindex,
        name: Some(device.label(object).into()),
    };
    let is_mappable = match pdo.direction {
        PdoDirection::Receive => object.is_rpdo_mappable(),
        PdoDirection::Transmit => object.is_tpdo_mappable(),
    };
    match object.data_type.pdo_bits() {
        _ if !is_mappable => report(NetworkFaultKind::NotMappable { pdo, subject }),
        Some(expected) if expected != entry.bits => {
            report(NetworkFaultKind::EntryLength { pdo, subject, expected, found: entry.bits });
        }
        _ => {}
    }
}

/// A data type as a gap in an RPDO (CiA 301, 7.4.7.1).
fn is_dummy(device: &DeviceFile, direction: PdoDirection, entry: MappingEntry) -> bool {
    direction == PdoDirection::Receive && device.dummy_usage.contains(&entry.index)
}

/// CAN-IDs that a PDO must not have (CiA 301, 7.3.5).
fn is_reserved(raw: u32) -> bool {
    matches!(
        raw,
        0x000..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF
    )
}
