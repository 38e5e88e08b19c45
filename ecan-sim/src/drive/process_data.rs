//! Process data of a drive: PDOs, multiplexed PDOs, SYNC and TIME.

use ecan_canopen::{Mpdo, MpdoAddress, NmtState, NodeId, TimeOfDay, object, parse_sync};
use ecan_protocol::can::CanId;

use super::config::DriveConfig;
use super::dictionary::Dictionary;
use super::model::ObjectModel;
use super::network::send;
use super::pdo::{CanIdSet, PDO_BYTES, PdoObject, ReceivePdo, TransmitPdo, numbers};
use crate::event_queue::earliest;
use crate::node::NodeOutput;

/// EMCY error code: PDO with too few bytes.
const PDO_TOO_SHORT: u16 = 0x8210;
/// EMCY error code: PDO with too many bytes.
const PDO_TOO_LONG: u16 = 0x8220;
/// EMCY error code: SYNC with wrong length, or with or without counter against 0x1019.
const SYNC_LENGTH: u16 = 0x8240;

/// The PDOs of a drive and the CAN IDs that the drive receives.
#[derive(Clone, Debug)]
pub(super) struct ProcessData {
    receive: Vec<ReceivePdo>,
    transmit: Vec<TransmitPdo>,
    /// True if a receive PDO has a timer. Without one the search for the next event skips the receive PDOs.
    has_timed_pdos: bool,
    /// True if a transmit PDO is event-driven.
    has_event_pdos: bool,
    /// COB-IDs of the services, SYNC, TIME and the receive PDOs.
    received_ids: CanIdSet,
    services: CanIdSet,
    sync_id: Option<CanId>,
    /// SYNC carries a counter: 0x1019 is not 0.
    has_sync_counter: bool,
    /// CAN ID of TIME, if the drive consumes it.
    time_id: Option<CanId>,
    /// Last received time.
    time_of_day: Option<TimeOfDay>,
    syncs: u64,
    received: u64,
}

impl ProcessData {
    pub(super) fn new(objects: &Dictionary, node: NodeId) -> Self {
        Self {
            receive: numbers(objects, object::RPDO_COMMUNICATION)
                .map(|number| ReceivePdo::load(objects, number))
                .collect(),
            transmit: numbers(objects, object::TPDO_COMMUNICATION)
                .map(|number| TransmitPdo::load(objects, number))
                .collect(),
            has_timed_pdos: false,
            has_event_pdos: false,
            received_ids: CanIdSet::default(),
            services: CanIdSet::services_of(node),
            sync_id: None,
            has_sync_counter: false,
            time_id: None,
            time_of_day: None,
            syncs: 0,
            received: 0,
        }
    }

    pub(super) fn set_node(&mut self, node: NodeId) {
        self.services = CanIdSet::services_of(node);
    }

    pub(super) const fn sync_id(&self) -> Option<CanId> {
        self.sync_id
    }

    pub(super) const fn time_id(&self) -> Option<CanId> {
        self.time_id
    }

    /// Last received time.
    pub(super) const fn time_of_day(&self) -> Option<TimeOfDay> {
        self.time_of_day
    }

    /// Number of SYNC messages.
    pub(super) const fn syncs(&self) -> u64 {
        self.syncs
    }

    /// Number of received PDOs.
    pub(super) const fn received(&self) -> u64 {
        self.received
    }

    pub(super) const fn received_ids(&self) -> &CanIdSet {
        &self.received_ids
    }

    /// Loads all PDOs, SYNC and TIME from their objects.
    pub(super) fn load(&mut self, model: &mut ObjectModel) {
        for pdo in &mut self.receive {
            *pdo = ReceivePdo::load(&model.objects, pdo.number);
        }
        self.load_transmit(model);
        self.load_sync(&model.objects);
        self.load_time(&model.objects);
    }

    /// Loads the transmit PDOs, for example after a change of scanner lists.
    pub(super) fn load_transmit(&mut self, model: &mut ObjectModel) {
        for pdo in &mut self.transmit {
            *pdo = TransmitPdo::load(&model.objects, pdo.number);
        }
        self.update(model);
    }

    /// Loads one PDO.
    pub(super) fn load_pdo(&mut self, pdo: PdoObject, model: &mut ObjectModel) {
        let PdoObject { number, is_sent, .. } = pdo;
        if is_sent {
            for pdo in self.transmit.iter_mut().filter(|pdo| pdo.number == number) {
                *pdo = TransmitPdo::load(&model.objects, number);
            }
        } else {
            for pdo in self.receive.iter_mut().filter(|pdo| pdo.number == number) {
                *pdo = ReceivePdo::load(&model.objects, number);
            }
        }
        self.update(model);
    }

    /// Updates what depends on the PDO parameters, after they were loaded.
    fn update(&mut self, model: &mut ObjectModel) {
        self.has_timed_pdos = self.receive.iter().any(ReceivePdo::is_timed);
        self.has_event_pdos = self.transmit.iter().any(TransmitPdo::is_event_driven);
        let transmit = &self.transmit;
        let sent = |slot| transmit.iter().any(|pdo| pdo.id.is_some() && pdo.has(slot));
        for unit in model.units.iter_mut() {
            unit.pdo_slots.clear();
            unit.pdo_slots.extend(unit.slots.iter().filter(|(slot, _)| sent(*slot)));
        }
        self.collect_received_ids();
    }

    fn collect_received_ids(&mut self) {
        self.received_ids.reset(&self.services);
        let pdos = self.receive.iter().filter_map(|pdo| pdo.id);
        let broadcasts = self.sync_id.into_iter().chain(self.time_id);
        pdos.chain(broadcasts).for_each(|id| self.received_ids.insert(id));
    }

    /// Bit 31 of 0x1012: the drive consumes TIME.
    pub(super) fn load_time(&mut self, objects: &Dictionary) {
        let raw = objects.number(object::TIME_COB_ID, 0).unwrap_or(0) as u32;
        let id = CanId::standard((raw & 0x7FF) as u16).ok();
        self.time_id = id.filter(|_| raw & 1 << 31 != 0);
        self.collect_received_ids();
    }

    pub(super) fn load_sync(&mut self, objects: &Dictionary) {
        let raw = objects.number(object::SYNC_COB_ID, 0);
        self.sync_id = raw.and_then(|raw| CanId::standard((raw & 0x7FF) as u16).ok());
        let overflow = objects.number(object::SYNC_COUNTER_OVERFLOW, 0);
        self.has_sync_counter = overflow.is_some_and(|overflow| overflow > 0);
        self.collect_received_ids();
    }

    /// Enters Operational.
    pub(super) fn start(&mut self) {
        self.transmit.iter_mut().for_each(TransmitPdo::start);
    }

    /// Leaves Operational: data that wait for SYNC are dropped.
    pub(super) fn stop(&mut self) {
        for pdo in &mut self.receive {
            pdo.waiting = None;
            pdo.deadline = None;
        }
    }

    /// Handles a SYNC: inputs are sampled and sent, then waiting outputs are applied.
    pub(super) fn on_sync(
        &mut self,
        data: &[u8],
        state: NmtState,
        model: &mut ObjectModel,
        config: &DriveConfig,
        out: &mut NodeOutput,
    ) {
        let counter = parse_sync(data).filter(|counter| counter.is_some() == self.has_sync_counter);
        let Some(counter) = counter else {
            return model.report(SYNC_LENGTH);
        };
        self.syncs += 1;
        if state != NmtState::Operational {
            return;
        }
        model.publish_pdos(state);
        self.send_due(config, model, out, |pdo, objects| pdo.on_sync(counter, objects));
        for pdo in &mut self.receive {
            if let Some(waiting) = pdo.waiting.take() {
                model.unpack(&pdo.mapping, &waiting);
            }
        }
    }

    /// Stores the time of a TIME message.
    pub(super) fn on_time(&mut self, data: &[u8]) {
        self.time_of_day = TimeOfDay::parse(data).or(self.time_of_day);
    }

    /// Sends event-driven PDOs whose objects changed or whose timer expired, in Operational.
    pub(super) fn send_events(
        &mut self,
        now: u64,
        model: &mut ObjectModel,
        config: &DriveConfig,
        out: &mut NodeOutput,
    ) {
        if !self.has_event_pdos {
            return;
        }
        model.publish_pdos(NmtState::Operational);
        self.send_due(config, model, out, |pdo, objects| pdo.on_event(now, objects));
        self.send_scanned(now, config, model, out);
    }

    fn send_due(
        &mut self,
        config: &DriveConfig,
        model: &ObjectModel,
        out: &mut NodeOutput,
        due: impl Fn(&mut TransmitPdo, &Dictionary) -> Option<[u8; PDO_BYTES]>,
    ) {
        for pdo in &mut self.transmit {
            if let (Some(id), Some(data)) = (pdo.id, due(pdo, &model.objects)) {
                send(config, out, id, data.get(..pdo.mapping.length).unwrap_or(&data));
            }
        }
    }

    /// Sends the changed objects of scanner lists as multiplexed PDOs (CiA 301, 7.2.2.4) in source address mode.
    fn send_scanned(
        &mut self,
        now: u64,
        config: &DriveConfig,
        model: &ObjectModel,
        out: &mut NodeOutput,
    ) {
        for pdo in &mut self.transmit {
            let Some(id) = pdo.id else { continue };
            while let Some((slot, value)) = pdo.next_scanned(now, &model.objects) {
                let Some(object) = model.objects.object(slot) else { continue };
                let bytes = value.to_le_bytes();
                let value = bytes.get(..4).unwrap_or_default();
                let source = MpdoAddress::Source(config.node);
                if let Ok(mpdo) = Mpdo::new(source, object.key(), value) {
                    send(config, out, id, &mpdo.to_bytes());
                }
            }
        }
    }

    /// Stores the data of an RPDO until SYNC. Returns false without effect if the frame has other
    /// consequences.
    pub(super) fn store(&mut self, id: CanId, data: &[u8], state: NmtState) -> bool {
        let is_broadcast = [self.sync_id, self.time_id].contains(&Some(id));
        // Every other frame samples the objects of event-driven PDOs.
        let only_stores = state == NmtState::Operational && !self.has_event_pdos;
        if !only_stores || is_broadcast || self.services.contains(id) {
            return false;
        }
        let mut concerned = self.receive.iter_mut().filter(|pdo| pdo.id == Some(id));
        let (Some(pdo), None) = (concerned.next(), concerned.next()) else { return false };
        if !pdo.only_waits(data.len()) {
            return false;
        }
        pdo.waiting = Some(padded(data));
        self.received += 1;
        true
    }

    /// Number of receive PDOs.
    pub(super) fn receive_count(&self) -> usize {
        self.receive.len()
    }

    /// Receives the data of the receive PDO at an index, in Operational. Returns whether the PDO is multiplexed:
    /// then the caller writes the data to the object that they name.
    pub(super) fn on_pdo(
        &mut self,
        index: usize,
        id: CanId,
        data: &[u8],
        now: u64,
        model: &mut ObjectModel,
    ) -> bool {
        let Some(pdo) = self.receive.get_mut(index).filter(|pdo| pdo.id == Some(id)) else {
            return false;
        };
        if pdo.is_multiplexed {
            pdo.restart_timer(now);
            return true;
        }
        if data.len() < pdo.mapping.length {
            model.report(PDO_TOO_SHORT);
            return false;
        }
        pdo.restart_timer(now);
        let bytes = padded(data);
        if pdo.synchronous {
            pdo.waiting = Some(bytes);
        }
        if data.len() > pdo.mapping.length {
            model.report(PDO_TOO_LONG);
        }
        self.received += 1;
        if !pdo.synchronous {
            model.unpack(&pdo.mapping, &bytes);
        }
        false
    }

    /// Counts a multiplexed PDO that concerns the drive.
    pub(super) fn count_multiplexed(&mut self) {
        self.received += 1;
    }

    /// Takes a receive PDO whose event timer has expired.
    pub(super) fn take_late(&mut self, now: u64) -> bool {
        let late = |pdo: &&mut ReceivePdo| pdo.deadline.is_some_and(|at| at <= now);
        let late = self.receive.iter_mut().find(late);
        late.map(|pdo| pdo.deadline = None).is_some()
    }

    /// Time of the next event of a PDO. `tick` is the next tick of the axes, which can change objects in
    /// event-driven PDOs.
    pub(super) fn next_event(
        &self,
        now: u64,
        is_operational: bool,
        tick: Option<u64>,
    ) -> Option<u64> {
        let mut next = None;
        if self.has_timed_pdos {
            next = earliest(self.receive.iter().map(|pdo| pdo.deadline));
        }
        if is_operational && self.has_event_pdos {
            let timers = self.transmit.iter().map(|pdo| pdo.next_event(now));
            next = earliest(timers.chain([tick, next]));
        }
        next
    }
}

fn padded(data: &[u8]) -> [u8; PDO_BYTES] {
    let mut bytes = [0; PDO_BYTES];
    for (to, from) in bytes.iter_mut().zip(data) {
        *to = *from;
    }
    bytes
}
