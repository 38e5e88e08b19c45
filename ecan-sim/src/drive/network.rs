//! The drive in its network: NMT slave with heartbeats, node guarding and emergency messages; and LSS slave (CiA
//! 305) with states, addresses, pending settings and the switch of the bit rate.

use std::collections::VecDeque;

use ecan_canopen::{
    Emcy, EmcyClass, ErrorRegister, GuardResponse, HeartbeatConsumer, LssAddress, LssAddressRange,
    LssBitRate, LssConfirmation, LssPart, LssRequest, LssResponse, NmtState, NodeId, RangePart,
    UNCONFIGURED_NODE_ID, object,
};
use ecan_protocol::can::{CanFrame, CanId};

use super::config::DriveConfig;
use super::dictionary::Dictionary;
use crate::event_queue::earliest;
use crate::node::NodeOutput;

#[derive(Clone, Copy, Debug)]
struct Watch {
    producer: NodeId,
    time_ns: u64,
    /// Time at which it is late; `None` until the first one arrives.
    deadline: Option<u64>,
    lost: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Network {
    pub(super) state: NmtState,
    boot_at: Option<u64>,
    producer_ns: u64,
    heartbeat_at: Option<u64>,
    watches: Vec<Watch>,
}

impl Network {
    pub(super) const fn new() -> Self {
        Self {
            state: NmtState::Initialising,
            boot_at: None,
            producer_ns: 0,
            heartbeat_at: None,
            watches: Vec::new(),
        }
    }

    /// Returns whether SDO, SYNC and EMCY are active.
    pub(super) const fn communicates(&self) -> bool {
        matches!(self.state, NmtState::PreOperational | NmtState::Operational)
    }

    /// Starts booting; with `None` it never ends.
    pub(super) fn boot(&mut self, at: Option<u64>) {
        self.state = NmtState::Initialising;
        self.boot_at = at;
        self.heartbeat_at = None;
        for watch in &mut self.watches {
            watch.deadline = None;
            watch.lost = false;
        }
    }

    pub(super) fn boot_ends(&mut self, now: u64) -> bool {
        self.boot_at.take_if(|at| *at <= now).is_some()
    }

    pub(super) fn load(&mut self, now: u64, objects: &Dictionary) {
        let ms = objects.unsigned16(object::PRODUCER_HEARTBEAT, 0);
        self.producer_ns = ms * 1_000_000;
        self.heartbeat_at = (ms > 0).then(|| now.saturating_add(self.producer_ns));
        self.load_watches(objects);
    }

    /// Reads the monitored heartbeats from the dictionary; an unchanged entry keeps its state.
    pub(super) fn load_watches(&mut self, objects: &Dictionary) {
        let before = std::mem::take(&mut self.watches);
        for subindex in 1..=127 {
            let Some(raw) = objects.number(object::CONSUMER_HEARTBEAT, subindex) else { break };
            let Some(entry) = HeartbeatConsumer::from_raw(raw as u32) else { continue };
            let watch = Watch {
                producer: entry.producer,
                time_ns: u64::from(entry.time_ms) * 1_000_000,
                deadline: None,
                lost: false,
            };
            let same = before
                .iter()
                .find(|old| old.producer == watch.producer && old.time_ns == watch.time_ns);
            self.watches.push(same.copied().unwrap_or(watch));
        }
    }

    /// Returns whether another entry than `subindex` already monitors this node.
    pub(super) fn is_watched(objects: &Dictionary, producer: NodeId, subindex: u8) -> bool {
        (1..=127).filter(|other| *other != subindex).any(|other| {
            objects
                .number(object::CONSUMER_HEARTBEAT, other)
                .and_then(|raw| HeartbeatConsumer::from_raw(raw as u32))
                .is_some_and(|entry| entry.producer == producer)
        })
    }

    /// Receives a heartbeat; returns true if it had been lost.
    pub(super) fn heartbeat_received(&mut self, now: u64, producer: NodeId) -> bool {
        let Some(watch) = self.watches.iter_mut().find(|watch| watch.producer == producer) else {
            return false;
        };
        watch.deadline = Some(now.saturating_add(watch.time_ns));
        std::mem::take(&mut watch.lost)
    }

    /// Returns whether a heartbeat is late that was not lost before.
    pub(super) fn take_late(&mut self, now: u64) -> bool {
        let late = |watch: &&mut Watch| watch.deadline.is_some_and(|at| at <= now);
        let Some(watch) = self.watches.iter_mut().find(late) else { return false };
        watch.deadline = None;
        watch.lost = true;
        true
    }

    pub(super) const fn produces_heartbeats(&self) -> bool {
        self.producer_ns > 0
    }

    pub(super) fn heartbeat_due(&mut self, now: u64) -> bool {
        let Some(at) = self.heartbeat_at.filter(|at| *at <= now) else { return false };
        let period = self.producer_ns.max(1);
        let periods = (now - at) / period + 1;
        self.heartbeat_at = Some(at.saturating_add(periods.saturating_mul(period)));
        true
    }

    pub(super) fn next_event(&self) -> Option<u64> {
        let watches = earliest(self.watches.iter().map(|watch| watch.deadline));
        earliest([self.boot_at, self.heartbeat_at, watches])
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Guarding {
    /// Toggle bit of the next response.
    toggle: bool,
    /// Life time, 0x100C times 0x100D; 0 disables life guarding.
    life_ns: u64,
    /// Time at which the host is lost; `None` until the first request.
    deadline: Option<u64>,
    is_lost: bool,
}

impl Guarding {
    /// Communication starts: the first response has toggle bit 0.
    pub(super) fn restart(&mut self) {
        *self = Self { life_ns: self.life_ns, ..Self::default() };
    }

    /// Reads the life time; a new one runs from the next request.
    pub(super) fn load(&mut self, objects: &Dictionary) {
        let number = |index| objects.unsigned16(index, 0);
        let life_ms = number(object::GUARD_TIME) * number(object::LIFE_TIME_FACTOR);
        let life_ns = life_ms * 1_000_000;
        if life_ns != self.life_ns {
            self.life_ns = life_ns;
            self.deadline = None;
        }
    }

    /// Receives a request; returns the response, and whether the host had been lost.
    pub(super) fn request(&mut self, now: u64, state: NmtState) -> ([u8; 1], bool) {
        let response = GuardResponse { toggle: self.toggle, state };
        self.toggle = !self.toggle;
        self.deadline = (self.life_ns > 0).then(|| now.saturating_add(self.life_ns));
        (response.to_bytes(), std::mem::take(&mut self.is_lost))
    }

    /// Returns whether the host is lost since this call.
    pub(super) fn take_late(&mut self, now: u64) -> bool {
        let is_late = self.deadline.take_if(|at| *at <= now).is_some();
        self.is_lost |= is_late;
        is_late
    }

    pub(super) const fn next_event(&self) -> Option<u64> {
        self.deadline
    }
}

/// Length of the error history 0x1003.
pub(super) const HISTORY: usize = 8;
/// Maximum number of messages that wait for the inhibit time.
const WAITING: usize = 8;

#[derive(Clone, Debug, Default)]
pub(super) struct Emergency {
    pub(super) register: u8,
    /// Last error code; 0 after a reset.
    pub(super) code: u16,
    pub(super) waiting: VecDeque<Emcy>,
    /// End of the inhibit time.
    free_at: u64,
    pub(super) sent: u64,
}

/// Error register bits for an error code.
pub(super) fn register_of(code: u16) -> ErrorRegister {
    let class = match EmcyClass::of(code) {
        EmcyClass::Current => ErrorRegister::CURRENT,
        EmcyClass::Voltage => ErrorRegister::VOLTAGE,
        EmcyClass::Temperature => ErrorRegister::TEMPERATURE,
        // 0x81 and 0x82 are communication errors, other monitoring codes are control errors.
        EmcyClass::Monitoring if matches!(code >> 8, 0x81 | 0x82) => ErrorRegister::COMMUNICATION,
        EmcyClass::Monitoring => ErrorRegister::PROFILE,
        EmcyClass::DeviceSpecific => ErrorRegister::MANUFACTURER,
        _ => ErrorRegister::default(),
    };
    ErrorRegister(ErrorRegister::GENERIC.0 | class.0)
}

impl Emergency {
    pub(super) fn new() -> Self {
        Self { waiting: VecDeque::with_capacity(WAITING), ..Self::default() }
    }

    pub(super) fn restart(&mut self) {
        self.register = 0;
        self.code = 0;
        self.waiting.clear();
        self.free_at = 0;
    }

    /// Reports an error that has already gone: it enters the history, not the register.
    pub(super) fn report(&mut self, code: u16, register: ErrorRegister, objects: &mut Dictionary) {
        add_to_history(objects, code);
        self.queue(code, ErrorRegister(self.register | register.0));
    }

    /// Reports a present error.
    pub(super) fn raise(&mut self, code: u16, objects: &mut Dictionary) {
        self.register |= register_of(code).0;
        self.code = code;
        add_to_history(objects, code);
        self.queue(code, ErrorRegister(self.register));
    }

    pub(super) fn clear(&mut self, register: ErrorRegister) {
        if self.register & register.0 == 0 {
            return;
        }
        self.register &= !register.0;
        // The generic bit is cleared with the last of the others.
        if self.register == ErrorRegister::GENERIC.0 {
            self.register = 0;
        }
        if self.register == 0 {
            self.code = 0;
            self.queue(0, ErrorRegister::default());
        }
    }

    fn queue(&mut self, code: u16, register: ErrorRegister) {
        if self.waiting.len() >= WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(Emcy { code, register, manufacturer: [0; 5] });
    }

    pub(super) fn next_event(&self) -> Option<u64> {
        (!self.waiting.is_empty()).then_some(self.free_at)
    }

    /// Takes a message that may be sent now.
    pub(super) fn due(&mut self, now: u64, inhibit_ns: u64) -> Option<Emcy> {
        if self.free_at > now {
            return None;
        }
        let emcy = self.waiting.pop_front()?;
        self.free_at = now.saturating_add(inhibit_ns);
        self.sent += 1;
        Some(emcy)
    }
}

fn add_to_history(objects: &mut Dictionary, code: u16) {
    let Some(count) = objects.number(object::ERROR_HISTORY, 0) else { return };
    let mut raw = i64::from(code);
    let mut kept = 0;
    for subindex in 1..=HISTORY as u8 {
        let Some(before) = objects.number(object::ERROR_HISTORY, subindex) else { break };
        objects.set(object::ERROR_HISTORY, subindex, raw);
        raw = before;
        kept += 1;
    }
    objects.set(object::ERROR_HISTORY, 0, (count + 1).min(kept));
}

pub(super) fn clear_history(objects: &mut Dictionary) {
    for subindex in 0..=HISTORY as u8 {
        objects.set(object::ERROR_HISTORY, subindex, 0);
    }
}

/// Sends a frame, unless the drive is silent.
pub(super) fn send(config: &DriveConfig, out: &mut NodeOutput, id: CanId, data: &[u8]) {
    if !config.quirks.silent
        && let Ok(frame) = CanFrame::classic(id, data)
    {
        out.send(frame);
    }
}

const MS: u64 = 1_000_000;

/// Reaction of the drive to a request, besides the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LssAction {
    /// The drive has got its first node-ID and boots.
    Boot,
    /// The drive switches its bit rate, in bit/s, after a delay.
    SwitchBitRate { bit_per_s: Option<u32>, delay_ms: u16 },
}

/// Switch of the bit rate in progress.
#[derive(Clone, Copy, Debug)]
struct BitRateSwitch {
    bit_per_s: Option<u32>,
    /// End of both delays: the drive takes part in the bus again.
    ends_at: u64,
}

/// Node-ID and bit rate; `None` is no node-ID, and the bit rate of the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Settings {
    node: Option<NodeId>,
    bit_rate: Option<LssBitRate>,
}

#[derive(Clone, Debug)]
pub(super) struct LssSlave {
    can_store: bool,
    is_configuring: bool,
    /// Parts of a selective switch that matched in order.
    matched_parts: u8,
    /// Parts of the range of an identification, in order.
    range: LssAddressRange,
    range_parts: u8,
    fastscan_part: LssPart,
    /// Active node-ID.
    node: Option<NodeId>,
    /// Bit rate that was configured, in bit/s.
    bit_per_s: Option<u32>,
    switch: Option<BitRateSwitch>,
    pending: Settings,
    stored: Settings,
}

impl LssSlave {
    /// Active node-ID; `None` before one was configured.
    pub(super) const fn node(&self) -> Option<NodeId> {
        self.node
    }

    /// Bit rate that was configured, in bit/s.
    pub(super) const fn bit_per_s(&self) -> Option<u32> {
        self.bit_per_s
    }

    /// Begins a switch of the bit rate: the drive is off the bus during both delays.
    pub(super) fn begin_switch(&mut self, bit_per_s: Option<u32>, delay_ms: u16, now: u64) {
        let delays = 2 * u64::from(delay_ms) * MS;
        let ends_at = now.saturating_add(delays.max(1));
        self.switch = Some(BitRateSwitch { bit_per_s, ends_at });
    }

    /// Ends a switch of the bit rate that is due. Returns whether there was one.
    pub(super) fn finish_switch(&mut self, now: u64) -> bool {
        let due = self.switch.take_if(|switch| switch.ends_at <= now);
        due.map(|switch| self.bit_per_s = switch.bit_per_s).is_some()
    }

    pub(super) fn cancel_switch(&mut self) {
        self.switch = None;
    }

    pub(super) fn switch_ends_at(&self) -> Option<u64> {
        self.switch.map(|switch| switch.ends_at)
    }

    pub(super) const fn new(node: Option<NodeId>, can_store: bool) -> Self {
        let settings = Settings { node, bit_rate: None };
        Self {
            can_store,
            is_configuring: false,
            matched_parts: 0,
            range: LssAddressRange::of_product(0, 0),
            range_parts: 0,
            fastscan_part: LssPart::Vendor,
            node,
            bit_per_s: None,
            switch: None,
            pending: settings,
            stored: settings,
        }
    }

    /// Power-on or reset of the node: the stored settings apply.
    pub(super) fn reset_node(&mut self) {
        self.pending = self.stored;
        self.reset_communication();
        self.bit_per_s = self.pending.bit_rate.and_then(LssBitRate::bit_per_s);
    }

    /// Reset of communication: the pending node-ID applies.
    pub(super) fn reset_communication(&mut self) {
        self.is_configuring = false;
        self.matched_parts = 0;
        self.range_parts = 0;
        self.node = self.pending.node;
    }

    /// Receives a request; `own` is the address of the drive.
    pub(super) fn receive(
        &mut self,
        request: LssRequest,
        own: &LssAddress,
    ) -> (Option<LssResponse>, Option<LssAction>) {
        let mut action = None;
        let response = match request {
            LssRequest::SwitchGlobal { configuration } => {
                self.is_configuring = configuration;
                self.matched_parts = 0;
                if !configuration && self.node.is_none() && self.pending.node.is_some() {
                    self.node = self.pending.node;
                    action = Some(LssAction::Boot);
                }
                None
            }
            LssRequest::SwitchSelective { part, value } => self.select(part, value, own),
            LssRequest::IdentifyRemote { part, value } => self.identify(part, value, own),
            LssRequest::IdentifyNonConfigured => {
                self.is_unconfigured().then_some(LssResponse::NonConfigured)
            }
            LssRequest::Fastscan { value, bit_check, part, next } => self
                .fastscan((value, bit_check, part, next), own)
                .then_some(LssResponse::Identified),
            _ if !self.is_configuring => None,
            LssRequest::ConfigureNodeId { node } => {
                let id = NodeId::from_raw(node);
                let is_valid = id.is_some() || node == UNCONFIGURED_NODE_ID;
                if is_valid {
                    self.pending.node = id;
                }
                Some(LssResponse::NodeIdConfigured(confirmation(is_valid)))
            }
            LssRequest::ConfigureBitTiming { table, entry } => {
                let bit_rate = LssBitRate::from_raw(entry)
                    .filter(|rate| table == LssBitRate::TABLE && rate.bit_per_s().is_some());
                if bit_rate.is_some() {
                    self.pending.bit_rate = bit_rate;
                }
                Some(LssResponse::BitTimingConfigured(confirmation(bit_rate.is_some())))
            }
            LssRequest::ActivateBitTiming { delay_ms } => {
                let bit_per_s = self.pending.bit_rate.and_then(LssBitRate::bit_per_s);
                action = Some(LssAction::SwitchBitRate { bit_per_s, delay_ms });
                None
            }
            LssRequest::Store => {
                if self.can_store {
                    self.stored = self.pending;
                }
                Some(LssResponse::Stored(confirmation(self.can_store)))
            }
            LssRequest::Inquire(part) => Some(LssResponse::Address { part, value: own.part(part) }),
            LssRequest::InquireNodeId => {
                let node = self.node.map_or(UNCONFIGURED_NODE_ID, NodeId::get);
                Some(LssResponse::NodeId { node })
            }
        };
        (response, action)
    }

    const fn is_unconfigured(&self) -> bool {
        self.node.is_none() && self.pending.node.is_none()
    }

    fn select(&mut self, part: LssPart, value: u32, own: &LssAddress) -> Option<LssResponse> {
        if self.is_configuring {
            return None;
        }
        let is_next = part == LssPart::Vendor || self.matched_parts == part.raw();
        let matches = is_next && own.part(part) == value;
        self.matched_parts = if matches { part.raw() + 1 } else { 0 };
        self.is_configuring = matches && part == LssPart::Serial;
        self.is_configuring.then_some(LssResponse::Selected)
    }

    fn identify(&mut self, part: RangePart, value: u32, own: &LssAddress) -> Option<LssResponse> {
        let range = &mut self.range;
        match part {
            RangePart::Vendor => range.vendor = value,
            RangePart::Product => range.product = value,
            RangePart::RevisionLow => range.revision.0 = value,
            RangePart::RevisionHigh => range.revision.1 = value,
            RangePart::SerialLow => range.serial.0 = value,
            RangePart::SerialHigh => range.serial.1 = value,
        }
        let position = part.raw() - RangePart::Vendor.raw();
        let is_next = position == 0 || self.range_parts == position;
        self.range_parts = if is_next { position + 1 } else { 0 };
        let is_complete = is_next && part == RangePart::SerialHigh;
        (is_complete && self.range.contains(own)).then_some(LssResponse::Identified)
    }

    fn fastscan(
        &mut self,
        (value, bit_check, part, next): (u32, u8, LssPart, LssPart),
        own: &LssAddress,
    ) -> bool {
        if self.is_configuring || !self.is_unconfigured() {
            return false;
        }
        if bit_check == LssRequest::FASTSCAN_START {
            self.fastscan_part = LssPart::Vendor;
            return true;
        }
        let differing = u64::from(value ^ own.part(part)) >> bit_check;
        if part != self.fastscan_part || differing != 0 {
            return false;
        }
        self.fastscan_part = next;
        self.is_configuring = bit_check == 0 && next.raw() < part.raw();
        true
    }
}

const fn confirmation(is_accepted: bool) -> LssConfirmation {
    if is_accepted { LssConfirmation::OK } else { LssConfirmation::UNSUPPORTED }
}

/// LSS address of a drive: its identity object.
pub(super) fn lss_address(objects: &Dictionary) -> LssAddress {
    let mut address = LssAddress::default();
    for part in LssPart::ALL {
        let value = objects.number(object::IDENTITY, part.raw() + 1).unwrap_or(0);
        address.set_part(*part, value as u32);
    }
    address
}
