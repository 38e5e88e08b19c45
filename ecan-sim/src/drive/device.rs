//! The parts of a drive and their interaction.

use std::collections::VecDeque;

use ecan_canopen::{
    CobId, ErrorRegister, NmtCommand, NmtState, NodeId, Statusword, TimeOfDay, heartbeat_data,
    object,
};
use ecan_protocol::can::{CanFrame, CanId};

use super::axis::Report;
use super::axis_unit::{AxisUnit, AxisUnits};
use super::config::{DriveConfig, SdoRule};
use super::dictionary::{Dictionary, Value, axis_index};
use super::lss::{BitRateSwitch, LssSlave};
use super::network::{Emergency, Guarding, Network};
use super::objects::ObjectSource;
use super::pdo::{CanIdSet, ReceivePdo, TransmitPdo, numbers, valid_pdo_id};
use crate::event_queue::earliest;
use crate::node::NodeOutput;

/// EMCY error code: heartbeat of another node, or guarding request, missing.
const HEARTBEAT_LOST: u16 = 0x8130;
/// EMCY error code: NMT command ended communication while the motor was energised.
const COMMUNICATION_ENDED: u16 = 0x8100;
/// EMCY error code: PDO not received before its event timer expired.
const PDO_LATE: u16 = 0x8250;
/// EMCY error code: recovered from bus-off.
const BUS_OFF: u16 = 0x8140;

const COMMUNICATION_RESET_NS: u64 = 2_000_000;
/// Maximum number of delayed SDO responses.
const MAX_RESPONSES: usize = 8;

#[derive(Clone, Debug)]
pub(super) struct Device {
    pub(super) config: DriveConfig,
    /// False for a node without CiA 402: its axes stay idle, and its objects only have values.
    pub(super) is_drive: bool,
    pub(super) now: u64,
    pub(super) powered: bool,
    /// True if the CAN controller takes part in the bus: from the end of booting until the supply
    /// is switched off, also during NMT resets; not in bus-off, nor while the bit rate switches.
    pub(super) on_bus: bool,
    /// End of bus-off.
    bus_off_until: Option<u64>,
    power_on_at: Option<u64>,
    pub(super) source: ObjectSource,
    pub(super) objects: Dictionary,
    pub(super) network: Network,
    pub(super) guarding: Guarding,
    pub(super) lss: LssSlave,
    /// Bit rate that LSS has configured, in bit/s.
    pub(super) bit_per_s: Option<u32>,
    pub(super) bit_rate_switch: Option<BitRateSwitch>,
    /// CAN ID of TIME, if the drive consumes it.
    pub(super) time_id: Option<CanId>,
    /// Last received time.
    pub(super) time_of_day: Option<TimeOfDay>,
    pub(super) emergency: Emergency,
    pub(super) units: AxisUnits,
    pub(super) receive: Vec<ReceivePdo>,
    pub(super) transmit: Vec<TransmitPdo>,
    /// True if a receive PDO has a timer, or a transmit PDO is event-driven. Without them the
    /// search for the next event skips the PDOs.
    has_timed_pdos: bool,
    pub(super) has_event_pdos: bool,
    /// COB-IDs of the services, SYNC and the receive PDOs.
    pub(super) received_ids: CanIdSet,
    pub(super) services: CanIdSet,
    pub(super) sync_id: Option<CanId>,
    /// SYNC carries a counter: 0x1019 is not 0.
    pub(super) has_sync_counter: bool,
    /// SDO rules, each with its remaining count.
    pub(super) rules: Vec<(SdoRule, Option<u32>)>,
    pub(super) responses: VecDeque<(u64, [u8; 8])>,
    pub(super) syncs: u64,
    pub(super) received_pdos: u64,
}

impl Device {
    pub(super) fn new(config: &DriveConfig, source: ObjectSource) -> Self {
        let (objects, is_drive) = source.objects(config);
        let axes = source.axis_count(&objects);
        let quirks = &config.quirks;
        let node = (!quirks.without_node_id).then_some(config.node);
        Self {
            config: config.clone(),
            is_drive,
            now: 0,
            powered: false,
            on_bus: false,
            bus_off_until: None,
            power_on_at: None,
            network: Network::new(),
            guarding: Guarding::default(),
            lss: LssSlave::new(node, !quirks.no_lss_store),
            bit_per_s: None,
            bit_rate_switch: None,
            time_id: None,
            time_of_day: None,
            emergency: Emergency::new(),
            units: AxisUnits::new(config, axes, &objects, is_drive),
            receive: numbers(&objects, object::RPDO_COMMUNICATION)
                .map(|number| ReceivePdo::load(&objects, number))
                .collect(),
            transmit: numbers(&objects, object::TPDO_COMMUNICATION)
                .map(|number| TransmitPdo::load(&objects, number))
                .collect(),
            has_timed_pdos: false,
            has_event_pdos: false,
            received_ids: CanIdSet::default(),
            services: CanIdSet::services_of(config.node),
            sync_id: None,
            has_sync_counter: false,
            rules: config.quirks.sdo_rules.iter().map(|rule| (*rule, rule.times)).collect(),
            responses: VecDeque::with_capacity(MAX_RESPONSES),
            syncs: 0,
            received_pdos: 0,
            source,
            objects,
        }
    }

    pub(super) fn switch_on(&mut self, now: u64) {
        self.run_to(now);
        self.powered = true;
        self.power_on_at = None;
        self.units.restart(true);
        self.reset_node();
    }

    pub(super) fn switch_off(&mut self, now: u64, on_at: u64) {
        self.run_to(now);
        self.powered = false;
        self.on_bus = false;
        self.bus_off_until = None;
        self.power_on_at = Some(on_at);
        self.bit_rate_switch = None;
        self.units.restart(false);
        self.network.boot(None);
        self.responses.clear();
        self.emergency.restart();
    }

    fn reset_node(&mut self) {
        self.units.restart(false);
        self.emergency.restart();
        self.bit_per_s = self.lss.reset_node();
        self.apply_node_id();
        self.reload(0x0000..=0xFFFF);
        self.boot(u64::from(self.config.boot_ms) * 1_000_000);
    }

    fn reset_communication(&mut self) {
        self.lose_host_in_motion();
        self.lss.reset_communication();
        self.restart_communication();
    }

    /// Applies the active node-ID and boots.
    pub(super) fn restart_communication(&mut self) {
        self.apply_node_id();
        self.reload(0x1000..=0x1FFF);
        self.boot(COMMUNICATION_RESET_NS);
    }

    fn boot(&mut self, ns: u64) {
        self.responses.clear();
        let at = self.now.saturating_add(ns);
        self.network.boot((!self.config.quirks.never_boots).then_some(at));
        self.guarding.restart();
    }

    fn reload(&mut self, indices: std::ops::RangeInclusive<u16>) {
        for object in self.objects.iter_mut().filter(|object| indices.contains(&object.index)) {
            match (&mut object.value, object.saved.as_ref().unwrap_or(&object.default)) {
                (Value::Bytes(value), Value::Bytes(bytes)) => {
                    value.clear();
                    value.extend_from_slice(bytes);
                }
                (value, reset) => *value = reset.clone(),
            }
        }
        self.load_parameters();
        for pdo in &mut self.receive {
            *pdo = ReceivePdo::load(&self.objects, pdo.number);
        }
        for pdo in &mut self.transmit {
            *pdo = TransmitPdo::load(&self.objects, pdo.number);
        }
        self.update_pdos();
        self.load_sync();
        self.load_time();
        self.guarding.load(&self.objects);
        self.network.load_watches(&self.objects);
        for unit in self.units.iter_mut() {
            let index = axis_index(unit.number, object::MODE_OF_OPERATION);
            let mode = self.objects.number(index, 0).unwrap_or(0) as i8;
            unit.axis.preset_mode(mode);
        }
    }

    pub(super) fn load_parameters(&mut self) {
        self.units.load_parameters(&self.objects);
    }

    /// Updates what depends on the PDO parameters, after they were loaded.
    pub(super) fn update_pdos(&mut self) {
        self.has_timed_pdos = self.receive.iter().any(ReceivePdo::is_timed);
        self.has_event_pdos = self.transmit.iter().any(TransmitPdo::is_event_driven);
        let Self { units, transmit, .. } = self;
        let sent = |slot| transmit.iter().any(|pdo| pdo.id.is_some() && pdo.has(slot));
        for unit in units.iter_mut() {
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
    pub(super) fn load_time(&mut self) {
        let raw = self.objects.number(object::TIME_COB_ID, 0).unwrap_or(0) as u32;
        let id = CanId::standard((raw & 0x7FF) as u16).ok();
        self.time_id = id.filter(|_| raw & 1 << 31 != 0);
        self.collect_received_ids();
    }

    pub(super) fn load_sync(&mut self) {
        let raw = self.objects.number(object::SYNC_COB_ID, 0);
        self.sync_id = raw.and_then(|raw| CanId::standard((raw & 0x7FF) as u16).ok());
        let overflow = self.objects.number(object::SYNC_COUNTER_OVERFLOW, 0);
        self.has_sync_counter = overflow.is_some_and(|overflow| overflow > 0);
        self.collect_received_ids();
    }

    fn finish_boot(&mut self, out: &mut NodeOutput) {
        self.on_bus = self.bus_off_until.is_none();
        if self.is_unconfigured() {
            // It takes part in LSS only.
            return;
        }
        self.send(out, CobId::heartbeat(self.config.node), &heartbeat_data(NmtState::Initialising));
        self.network.state = NmtState::PreOperational;
        self.network.load(self.now, &self.objects);
        self.units.iter_mut().for_each(|unit| unit.axis.finish_self_test());
    }

    pub(super) fn send(&self, out: &mut NodeOutput, id: CobId, data: &[u8]) {
        send(&self.config, out, id.can_id(), data);
    }

    pub(super) fn nmt(&mut self, command: NmtCommand) {
        let before = self.network.state;
        match command {
            NmtCommand::Start => {
                self.network.state = NmtState::Operational;
                if before != NmtState::Operational {
                    self.transmit.iter_mut().for_each(TransmitPdo::start);
                }
            }
            NmtCommand::Stop => {
                self.network.state = NmtState::Stopped;
                if before != NmtState::Stopped {
                    self.lose_host_in_motion();
                }
            }
            NmtCommand::EnterPreOperational => self.network.state = NmtState::PreOperational,
            NmtCommand::ResetNode => self.reset_node(),
            NmtCommand::ResetCommunication => self.reset_communication(),
        }
        if self.network.state != NmtState::Operational {
            for pdo in &mut self.receive {
                pdo.waiting = None;
                pdo.deadline = None;
            }
        }
    }

    /// Reacts to being stopped or reset while the motor is energised, as to a loss of the host.
    fn lose_host_in_motion(&mut self) {
        if self.units.are_energised() {
            self.units.host_lost(COMMUNICATION_ENDED);
        }
    }

    /// Reacts to a loss of the host as 0x1029 and 0x6007 demand.
    fn lose_host(&mut self, code: u16) {
        if !(self.is_drive && self.units.will_fault_without_host()) {
            // Otherwise the fault raises the emergency.
            self.emergency.raise(code, &mut self.objects);
        }
        self.react_to_host_loss(code);
    }

    /// The controller is bus-off until then: the drive neither receives nor sends.
    pub(super) fn bus_off(&mut self, until: u64) {
        self.on_bus = false;
        self.bus_off_until = Some(until);
        self.react_to_host_loss(BUS_OFF);
    }

    fn recover_from_bus_off(&mut self) {
        self.bus_off_until = None;
        self.on_bus = self.network.state != NmtState::Initialising;
        self.emergency.report(BUS_OFF, ErrorRegister::COMMUNICATION, &mut self.objects);
    }

    fn react_to_host_loss(&mut self, code: u16) {
        if self.is_drive {
            self.units.host_lost(code);
        }
        match self.objects.number(object::ERROR_BEHAVIOUR, 1).unwrap_or(0) {
            0 if self.network.state == NmtState::Operational => {
                self.nmt(NmtCommand::EnterPreOperational);
            }
            2 => self.nmt(NmtCommand::Stop),
            _ => {}
        }
    }

    /// Receives a heartbeat of another node.
    pub(super) fn heartbeat(&mut self, producer: NodeId) {
        if self.network.heartbeat_received(self.now, producer) && !self.units.are_faulted() {
            self.emergency.clear(ErrorRegister::COMMUNICATION);
        }
    }

    /// Responds to a guarding request, unless the drive produces heartbeats or has no guarding.
    pub(super) fn guarding_request(&mut self, out: &mut NodeOutput) {
        let has_guarding = self.objects.number(object::GUARD_TIME, 0).is_some();
        if self.network.produces_heartbeats() || !has_guarding {
            return;
        }
        let (response, was_lost) = self.guarding.request(self.now, self.network.state);
        self.send(out, CobId::heartbeat(self.config.node), &response);
        if was_lost && !self.units.are_faulted() {
            self.emergency.clear(ErrorRegister::COMMUNICATION);
        }
    }

    pub(super) fn run_to(&mut self, now: u64) {
        self.units.advance(now);
        self.now = now;
    }

    pub(super) fn tick(&mut self, now: u64, out: &mut NodeOutput) {
        if !self.powered {
            if self.power_on_at.is_some_and(|at| at <= now) {
                self.switch_on(now);
            }
            return;
        }
        self.run_to(now);
        if self.bus_off_until.is_some_and(|at| at <= now) {
            self.recover_from_bus_off();
        }
        if self.network.boot_ends(now) {
            self.finish_boot(out);
        }
        self.switch_bit_rate();
        while self.network.take_late(now) {
            self.lose_host(HEARTBEAT_LOST);
        }
        if self.guarding.take_late(now) {
            self.lose_host(HEARTBEAT_LOST);
        }
        let late = |pdo: &&mut ReceivePdo| pdo.deadline.is_some_and(|at| at <= now);
        while let Some(pdo) = self.receive.iter_mut().find(late) {
            pdo.deadline = None;
            self.lose_host(PDO_LATE);
        }
        if self.network.heartbeat_due(now) {
            let data = heartbeat_data(self.network.state);
            self.send(out, CobId::heartbeat(self.config.node), &data);
        }
    }

    pub(super) fn queue_response(&mut self, bytes: [u8; 8]) {
        if self.responses.len() < MAX_RESPONSES {
            let delay = u64::from(self.config.sdo_delay_us) * 1_000;
            self.responses.push_back((self.now.saturating_add(delay), bytes));
        }
    }

    /// Processes axis reports and sends event-driven PDOs, SDO responses and emergencies that are
    /// due.
    pub(super) fn settle(&mut self, out: &mut NodeOutput) {
        if !self.powered {
            return;
        }
        while let Some(report) = self.units.take_report() {
            match report {
                Report::Fault(code) => self.emergency.raise(code, &mut self.objects),
                Report::FaultReset => self.emergency.clear(ErrorRegister(u8::MAX)),
            }
        }
        let operational = self.network.state == NmtState::Operational;
        if operational && self.has_event_pdos {
            self.send_events(out);
        }
        while let Some((at, bytes)) = self.responses.front().copied()
            && at <= self.now
        {
            self.responses.pop_front();
            if self.network.communicates() {
                self.send(out, CobId::sdo_server(self.config.node), &bytes);
            }
        }
        self.send_emergencies(out);
    }

    fn send_emergencies(&mut self, out: &mut NodeOutput) {
        if self.emergency.next_event().is_none() {
            return;
        }
        let raw = self.objects.number(object::EMCY_COB_ID, 0).unwrap_or(0) as u32;
        let (true, Some(id)) = (self.network.communicates(), valid_pdo_id(raw)) else {
            return self.emergency.waiting.clear();
        };
        let inhibit = self.objects.unsigned16(object::EMCY_INHIBIT, 0);
        while let Some(emcy) = self.emergency.due(self.now, inhibit * 100_000) {
            send(&self.config, out, id, &emcy.to_bytes());
        }
    }

    /// Statusword of an axis.
    pub(super) fn statusword(&self, unit: &AxisUnit) -> Statusword {
        let mut word = unit.statusword().0 | self.status_bits();
        if self.emergency.register != 0 && !unit.axis.power.is_faulted() {
            word |= Statusword::WARNING;
        }
        Statusword(word)
    }

    /// Bits of the statusword that all axes have in common.
    fn status_bits(&self) -> u16 {
        if self.network.state == NmtState::Initialising { 0 } else { Statusword::REMOTE }
    }

    /// Executes skipped controller ticks up to `now`.
    pub(super) fn catch_up(&mut self, now: u64) {
        if self.powered
            && let Some(tick) = self.units.missed_tick(now)
        {
            self.run_to(tick);
        }
    }

    pub(super) fn next_tick(&self) -> Option<u64> {
        self.units.next_tick().filter(|_| self.powered)
    }

    /// Time of the next event that others can observe; controller ticks only if they can cause a
    /// frame.
    pub(super) fn next_event(&self) -> Option<u64> {
        if !self.powered {
            return self.power_on_at;
        }
        let response = self.responses.front().map(|(at, _)| *at);
        let emergency = self.emergency.next_event().filter(|_| self.network.communicates());
        let operational = self.network.state == NmtState::Operational;
        let mut next = earliest([
            self.network.next_event(),
            self.guarding.next_event(),
            self.bit_rate_switch.map(|switch| switch.ends_at),
            self.units.next_event(),
            self.bus_off_until,
            response,
            emergency,
        ]);
        if self.has_timed_pdos {
            next = earliest(self.receive.iter().map(|pdo| pdo.deadline).chain([next]));
        }
        if operational && self.has_event_pdos {
            let timers = self.transmit.iter().map(|pdo| pdo.next_event(self.now));
            next = earliest(timers.chain([self.units.next_tick(), next]));
        }
        next
    }
}

pub(super) fn send(config: &DriveConfig, out: &mut NodeOutput, id: CanId, data: &[u8]) {
    if !config.quirks.silent
        && let Ok(frame) = CanFrame::classic(id, data)
    {
        out.send(frame);
    }
}
