//! NMT slave of a drive: heartbeats, node guarding, and emergency messages.

use std::collections::VecDeque;

use ecan_canopen::{
    Emcy, EmcyClass, ErrorRegister, GuardResponse, HeartbeatConsumer, NmtState, NodeId, object,
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
