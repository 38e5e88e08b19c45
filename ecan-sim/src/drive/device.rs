//! The parts of a drive and their interaction.

use std::collections::VecDeque;

use ecan_canopen::{
    CobId, ErrorRegister, LssRequest, NmtCommand, NmtState, NodeId, Statusword, heartbeat_data,
    object,
};
use ecan_protocol::can::CanId;

use super::config::{DriveConfig, SdoRule};
use super::model::{AxisUnit, ObjectModel};
use super::network::{Guarding, LssAction, LssSlave, Network, lss_address, send};
use super::objects::ObjectSource;
use super::pdo::valid_pdo_id;
use super::process_data::ProcessData;
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

/// A drive with its supply and its services; a [`Drive`](super::Drive) adds the SDO server.
#[derive(Clone, Debug)]
pub(super) struct Device {
    pub(super) config: DriveConfig,
    pub(super) now: u64,
    pub(super) powered: bool,
    /// True if the CAN controller takes part in the bus: from the end of booting until the supply
    /// is switched off, also during NMT resets; not in bus-off, nor while the bit rate switches.
    pub(super) on_bus: bool,
    /// End of bus-off.
    bus_off_until: Option<u64>,
    power_on_at: Option<u64>,
    source: ObjectSource,
    pub(super) model: ObjectModel,
    pub(super) network: Network,
    pub(super) guarding: Guarding,
    pub(super) lss: LssSlave,
    pub(super) pdos: ProcessData,
    /// SDO rules, each with its remaining count.
    pub(super) rules: Vec<(SdoRule, Option<u32>)>,
    responses: VecDeque<(u64, [u8; 8])>,
}

impl Device {
    pub(super) fn new(config: &DriveConfig, source: ObjectSource) -> Self {
        let model = ObjectModel::new(config, &source);
        let quirks = &config.quirks;
        let node = (!quirks.without_node_id).then_some(config.node);
        Self {
            config: config.clone(),
            now: 0,
            powered: false,
            on_bus: false,
            bus_off_until: None,
            power_on_at: None,
            network: Network::new(),
            guarding: Guarding::default(),
            lss: LssSlave::new(node, !quirks.no_lss_store),
            pdos: ProcessData::new(&model.objects, config.node),
            rules: quirks.sdo_rules.iter().map(|rule| (*rule, rule.times)).collect(),
            responses: VecDeque::with_capacity(MAX_RESPONSES),
            source,
            model,
        }
    }

    pub(super) fn switch_on(&mut self, now: u64) {
        self.run_to(now);
        self.powered = true;
        self.power_on_at = None;
        self.model.units.restart(true);
        self.reset_node();
    }

    pub(super) fn switch_off(&mut self, now: u64, on_at: u64) {
        self.run_to(now);
        self.powered = false;
        self.on_bus = false;
        self.bus_off_until = None;
        self.power_on_at = Some(on_at);
        self.lss.cancel_switch();
        self.model.units.restart(false);
        self.network.boot(None);
        self.responses.clear();
        self.model.emergency.restart();
    }

    fn reset_node(&mut self) {
        self.model.units.restart(false);
        self.model.emergency.restart();
        self.lss.reset_node();
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
        self.model.reset_values(indices);
        self.pdos.load(&mut self.model);
        self.guarding.load(&self.model.objects);
        self.network.load_watches(&self.model.objects);
        self.model.preset_modes();
    }

    /// Applies the node-ID of the LSS slave.
    fn apply_node_id(&mut self) {
        let Some(node) = self.lss.node().filter(|node| *node != self.config.node) else { return };
        self.config.node = node;
        self.pdos.set_node(node);
        let (objects, _) = self.source.objects(&self.config);
        self.model.replace_objects(objects);
    }

    fn finish_boot(&mut self, out: &mut NodeOutput) {
        self.on_bus = self.bus_off_until.is_none();
        if self.lss.node().is_none() {
            // It takes part in LSS only.
            return;
        }
        self.send(out, CobId::heartbeat(self.config.node), &heartbeat_data(NmtState::Initialising));
        self.network.state = NmtState::PreOperational;
        self.network.load(self.now, &self.model.objects);
        self.model.units.iter_mut().for_each(|unit| unit.axis.finish_self_test());
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
                    self.pdos.start();
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
            self.pdos.stop();
        }
    }

    /// Reacts to being stopped or reset while the motor is energised, as to a loss of the host.
    fn lose_host_in_motion(&mut self) {
        if self.model.units.are_energised() {
            self.model.units.host_lost(COMMUNICATION_ENDED);
        }
    }

    /// Reacts to a loss of the host as 0x1029 and 0x6007 demand.
    fn lose_host(&mut self, code: u16) {
        if !(self.model.is_drive && self.model.units.will_fault_without_host()) {
            // Otherwise the fault raises the emergency.
            self.model.emergency.raise(code, &mut self.model.objects);
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
        self.model.emergency.report(BUS_OFF, ErrorRegister::COMMUNICATION, &mut self.model.objects);
    }

    fn react_to_host_loss(&mut self, code: u16) {
        if self.model.is_drive {
            self.model.units.host_lost(code);
        }
        match self.model.objects.number(object::ERROR_BEHAVIOUR, 1).unwrap_or(0) {
            0 if self.network.state == NmtState::Operational => {
                self.nmt(NmtCommand::EnterPreOperational);
            }
            2 => self.nmt(NmtCommand::Stop),
            _ => {}
        }
    }

    /// Receives a heartbeat of another node.
    pub(super) fn heartbeat(&mut self, producer: NodeId) {
        if self.network.heartbeat_received(self.now, producer) {
            self.model.end_communication_error();
        }
    }

    /// Responds to a guarding request, unless the drive produces heartbeats or has no guarding.
    pub(super) fn guarding_request(&mut self, out: &mut NodeOutput) {
        let has_guarding = self.model.objects.number(object::GUARD_TIME, 0).is_some();
        if self.network.produces_heartbeats() || !has_guarding {
            return;
        }
        let (response, was_lost) = self.guarding.request(self.now, self.network.state);
        self.send(out, CobId::heartbeat(self.config.node), &response);
        if was_lost {
            self.model.end_communication_error();
        }
    }

    pub(super) fn run_to(&mut self, now: u64) {
        self.model.units.advance(now);
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
        if self.lss.finish_switch(now) {
            self.on_bus = true;
        }
        while self.network.take_late(now) {
            self.lose_host(HEARTBEAT_LOST);
        }
        if self.guarding.take_late(now) {
            self.lose_host(HEARTBEAT_LOST);
        }
        while self.pdos.take_late(now) {
            self.lose_host(PDO_LATE);
        }
        if self.network.heartbeat_due(now) {
            let data = heartbeat_data(self.network.state);
            self.send(out, CobId::heartbeat(self.config.node), &data);
        }
    }

    pub(super) fn on_lss(&mut self, data: &[u8], out: &mut NodeOutput) {
        if self.config.quirks.no_lss {
            return;
        }
        let Some(request) = LssRequest::parse(data) else { return };
        let own = lss_address(&self.model.objects);
        let (response, action) = self.lss.receive(request, &own);
        if let Some(response) = response {
            self.send(out, CobId::LSS_RESPONSE, &response.to_bytes());
        }
        match action {
            None => {}
            Some(LssAction::Boot) => self.restart_communication(),
            Some(LssAction::SwitchBitRate { bit_per_s, delay_ms }) => {
                self.lss.begin_switch(bit_per_s, delay_ms, self.now);
                self.on_bus = false;
            }
        }
    }

    /// Handles a SYNC: inputs are sampled and sent, then waiting outputs are applied.
    pub(super) fn on_sync(&mut self, data: &[u8], out: &mut NodeOutput) {
        let Self { network, pdos, model, config, .. } = self;
        pdos.on_sync(data, network.state, model, config, out);
    }

    /// Handles a TIME message.
    pub(super) fn on_time(&mut self, data: &[u8]) {
        if self.network.communicates() {
            self.pdos.on_time(data);
        }
    }

    /// Stores the data of an RPDO until SYNC. Returns false without effect if the frame has other
    /// consequences.
    pub(super) fn store_pdo(&mut self, id: CanId, data: &[u8]) -> bool {
        self.pdos.store(id, data, self.network.state)
    }

    pub(super) fn on_pdo(&mut self, id: CanId, data: &[u8]) {
        if self.network.state != NmtState::Operational {
            return;
        }
        for index in 0..self.pdos.receive_count() {
            if self.pdos.on_pdo(index, id, data, self.now, &mut self.model) {
                self.on_mpdo(data);
            }
        }
    }

    /// Statusword of an axis.
    pub(super) fn statusword(&self, unit: &AxisUnit) -> Statusword {
        self.model.statusword(unit, self.network.state)
    }

    /// Returns whether SDO responses wait for their delay.
    pub(super) fn has_responses(&self) -> bool {
        !self.responses.is_empty()
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
        self.model.take_reports();
        if self.network.state == NmtState::Operational {
            self.pdos.send_events(self.now, &mut self.model, &self.config, out);
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
        if self.model.emergency.next_event().is_none() {
            return;
        }
        let raw = self.model.objects.number(object::EMCY_COB_ID, 0).unwrap_or(0) as u32;
        let (true, Some(id)) = (self.network.communicates(), valid_pdo_id(raw)) else {
            return self.model.emergency.waiting.clear();
        };
        let inhibit = self.model.objects.unsigned16(object::EMCY_INHIBIT, 0);
        while let Some(emcy) = self.model.emergency.due(self.now, inhibit * 100_000) {
            send(&self.config, out, id, &emcy.to_bytes());
        }
    }

    /// Executes skipped controller ticks up to `now`.
    pub(super) fn catch_up(&mut self, now: u64) {
        if self.powered
            && let Some(tick) = self.model.units.missed_tick(now)
        {
            self.run_to(tick);
        }
    }

    pub(super) fn next_tick(&self) -> Option<u64> {
        self.model.units.next_tick().filter(|_| self.powered)
    }

    /// Time of the next event that others can observe; controller ticks only if they can cause a
    /// frame.
    pub(super) fn next_event(&self) -> Option<u64> {
        if !self.powered {
            return self.power_on_at;
        }
        let response = self.responses.front().map(|(at, _)| *at);
        let emergency = self.model.emergency.next_event().filter(|_| self.network.communicates());
        let operational = self.network.state == NmtState::Operational;
        let pdos = self.pdos.next_event(self.now, operational, self.model.units.next_tick());
        earliest([
            self.network.next_event(),
            self.guarding.next_event(),
            self.lss.switch_ends_at(),
            self.model.units.next_event(),
            self.bus_off_until,
            response,
            pdos,
            emergency,
        ])
    }
}
