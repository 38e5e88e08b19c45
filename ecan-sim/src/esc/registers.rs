//! Registers of a slave controller (ETG.1000.4): addresses, writability, values, and the effect of writes; and those of
//! the distributed clock: receive times, system time, control, Sync0.
//!
//! The clock itself belongs to the gateway: local time is system time without the offset that the
//! master wrote, so the control loop affects both.

use ecan_protocol::device::AlState;

use super::Context;
use super::eeprom::{EepromInterface, Effect, INTERFACE_BYTES};
use super::sync_manager::{
    Buffers, FMMU_BYTES, FMMUS, Fmmu, REGISTER_BYTES, SYNC_MANAGER_BYTES, SYNC_MANAGERS,
};
use crate::gateway::{Gateway, Sync0};

mod address {
    pub(super) const TYPE: usize = 0x0000;
    pub(super) const STATION: usize = 0x0010;
    pub(super) const ALIAS: usize = 0x0012;
    pub(super) const WRITE_PROTECTION: usize = 0x0020;
    pub(super) const DL_CONTROL: usize = 0x0100;
    pub(super) const PHYSICAL_ACCESS: usize = 0x0108;
    pub(super) const DL_STATUS: usize = 0x0110;
    pub(super) const AL_CONTROL: usize = 0x0120;
    pub(super) const AL_STATUS: usize = 0x0130;
    pub(super) const AL_STATUS_CODE: usize = 0x0134;
    pub(super) const PDI: usize = 0x0140;
    pub(super) const EVENT_MASK: usize = 0x0200;
    pub(super) const EVENTS: usize = 0x0210;
    pub(super) const DEVICE_EVENTS: usize = 0x0220;
    pub(super) const RECEIVE_ERRORS: usize = 0x0300;
    pub(super) const PROCESSING_ERRORS: usize = 0x030C;
    pub(super) const LOST_LINKS: usize = 0x0310;
    pub(super) const WATCHDOG_DIVIDER: usize = 0x0400;
    pub(super) const WATCHDOG_DEVICE: usize = 0x0410;
    pub(super) const WATCHDOG_TIME: usize = 0x0420;
    pub(super) const WATCHDOG_STATUS: usize = 0x0440;
    pub(super) const WATCHDOG_COUNTERS: usize = 0x0442;
    pub(super) const EEPROM_OWNER: usize = 0x0500;
    pub(super) const EEPROM: usize = 0x0502;
    pub(super) const FMMU: usize = 0x0600;
    pub(super) const SYNC_MANAGER: usize = 0x0800;
    pub(super) const RECEIVE_TIMES: usize = 0x0900;
    pub(super) const SYSTEM_TIME: usize = 0x0910;
    pub(super) const TIME_OFFSET: usize = 0x0920;
    pub(super) const TIME_DELAY: usize = 0x0928;
    pub(super) const SPEED_COUNTER: usize = 0x0930;
    pub(super) const FILTER_DEPTHS: usize = 0x0934;
    pub(super) const CYCLIC_CONTROL: usize = 0x0980;
    pub(super) const ACTIVATION: usize = 0x0981;
    pub(super) const PULSE_LENGTH: usize = 0x0982;
    pub(super) const CYCLIC_START: usize = 0x0990;
    pub(super) const SYNC0_CYCLE: usize = 0x09A0;
    pub(super) const USER: usize = 0x0F80;
}

/// Writable registers, except sync managers and EEPROM: address and length.
const WRITABLE: [(usize, usize); 23] = [
    (address::STATION, 2),
    (address::WRITE_PROTECTION, 2),
    (address::WRITE_PROTECTION + 0x10, 2),
    (address::DL_CONTROL, 4),
    (address::PHYSICAL_ACCESS, 2),
    (address::AL_CONTROL, 2),
    (address::EVENT_MASK, 2),
    (address::RECEIVE_ERRORS, 20),
    (address::WATCHDOG_DIVIDER, 2),
    (address::WATCHDOG_DEVICE, 2),
    (address::WATCHDOG_TIME, 2),
    (address::WATCHDOG_COUNTERS, 2),
    (address::EEPROM_OWNER, 1),
    (address::FMMU, FMMUS * FMMU_BYTES),
    (address::RECEIVE_TIMES, 4),
    (address::SYSTEM_TIME, 8),
    (address::TIME_OFFSET, 12),
    (address::SPEED_COUNTER, 2),
    (address::FILTER_DEPTHS, 2),
    (address::CYCLIC_CONTROL, 2),
    (address::CYCLIC_START, 8),
    (address::SYNC0_CYCLE, 8),
    (address::USER, 128),
];

/// Register defaults other than 0. Type, revision, build, FMMUs, sync managers, KiB of memory,
/// ports (0 and 1 MII), features (64-bit distributed clocks, separate receive errors).
const INFORMATION: [u8; 10] =
    [0x04, 0x01, 0, 0, FMMUS as u8, SYNC_MANAGERS as u8, 8, 0x0F, 0x8C, 0];
const DEFAULTS: [(usize, &[u8]); 7] = [
    (address::TYPE, &INFORMATION),
    (address::DL_CONTROL, &[0x01, 0, 0, 0]),
    (address::WATCHDOG_DIVIDER, &2498_u16.to_le_bytes()),
    (address::WATCHDOG_DEVICE, &1000_u16.to_le_bytes()),
    (address::WATCHDOG_TIME, &1000_u16.to_le_bytes()),
    (address::SPEED_COUNTER, &0x1000_u16.to_le_bytes()),
    (address::FILTER_DEPTHS, &[4, 12]),
];

/// Step of the watchdog divider, in nanoseconds; the divider has two steps more than its value.
const WATCHDOG_STEP_NS: u64 = 40;

const AL_STATE: u8 = 0x0F;
const AL_ACKNOWLEDGE: u8 = 0x10;

mod event {
    pub(super) const DL_STATUS: u16 = 1 << 2;
    pub(super) const AL_STATUS: u16 = 1 << 3;
    pub(super) const FIRST_SYNC_MANAGER: u16 = 1 << 4;
}
const FIRST_DEVICE_SYNC_MANAGER: u32 = 1 << 8;

fn touches(at: usize, bytes: usize, register: usize, length: usize) -> bool {
    at < register + length && register < at + bytes
}

fn initial() -> Box<[u8]> {
    let mut registers = vec![0; REGISTER_BYTES].into_boxed_slice();
    for (at, bytes) in DEFAULTS {
        registers[at..at + bytes.len()].copy_from_slice(bytes);
    }
    registers
}

/// DL control bit: the alias is also a station address.
const ALIAS_IS_ADDRESS: u8 = 1;

/// The registers, with the units behind them. EtherCAT state and clock belong to the gateway.
#[derive(Clone)]
pub(super) struct Registers {
    bytes: Box<[u8]>,
    fmmus: [Option<Fmmu>; FMMUS],
    clock: ClockRegisters,
    eeprom: EepromInterface,
    /// Written start time of the cyclic unit.
    cyclic_start: [u8; 8],
    /// Event requests of link and AL state.
    events: u16,
    /// Watchdog expirations at the last clear of the counter.
    watchdogs_cleared: u32,
}

impl Registers {
    pub(super) fn new() -> Self {
        Self {
            bytes: initial(),
            fmmus: [None; FMMUS],
            clock: ClockRegisters::default(),
            eeprom: EepromInterface::default(),
            cyclic_start: [0; 8],
            events: 0,
            watchdogs_cleared: 0,
        }
    }

    pub(super) fn fmmus(&self) -> [Option<Fmmu>; FMMUS] {
        self.fmmus
    }

    /// The stored bytes, without an update; shorter at the end.
    pub(super) fn stored_bytes(&self, at: usize, bytes: usize) -> &[u8] {
        self.bytes.get(at..at + bytes).unwrap_or_default()
    }

    /// Event requests that the master has unmasked; `None` without a mask.
    pub(super) fn unmasked_events(&self, buffers: &Buffers) -> Option<u16> {
        let mask = u16::from_le_bytes(self.stored(address::EVENT_MASK));
        (mask != 0).then(|| self.event_requests(buffers) & mask)
    }

    /// Notes a change of the link to the next slave.
    pub(super) fn note_link(&mut self, is_up: bool) {
        self.events |= event::DL_STATUS;
        if !is_up {
            self.count(address::LOST_LINKS + 1);
        }
    }

    /// Notes a change of the AL state.
    pub(super) fn note_al_status(&mut self) {
        self.events |= event::AL_STATUS;
    }

    pub(super) fn count_processing_error(&mut self) {
        self.count(address::PROCESSING_ERRORS);
    }

    /// Returns whether a station address is that of the slave.
    pub(super) fn is_addressed(&self, station: u16) -> bool {
        let is = |at| u16::from_le_bytes(self.stored(at)) == station;
        let [.., has_alias] = self.stored::<4>(address::DL_CONTROL);
        is(address::STATION) || (has_alias & ALIAS_IS_ADDRESS != 0 && is(address::ALIAS))
    }

    fn stored<const N: usize>(&self, at: usize) -> [u8; N] {
        self.bytes.get(at..at + N).and_then(|bytes| bytes.try_into().ok()).unwrap_or([0; N])
    }

    fn store(&mut self, at: usize, bytes: &[u8]) {
        if let Some(to) = self.bytes.get_mut(at..at + bytes.len()) {
            to.copy_from_slice(bytes);
        }
    }

    fn count(&mut self, at: usize) {
        let [value] = self.stored(at);
        self.store(at, &[value.saturating_add(1)]);
    }

    pub(super) fn read(
        &mut self,
        at: usize,
        out: &mut [u8],
        buffers: &Buffers,
        context: &Context<'_>,
    ) {
        self.refresh(at, out.len(), buffers, context);
        if let Some(from) = self.bytes.get(at..at + out.len()) {
            out.copy_from_slice(from);
        }
        // reading acknowledges
        if touches(at, out.len(), address::DL_STATUS, 2) {
            self.events &= !event::DL_STATUS;
        }
        if touches(at, out.len(), address::AL_STATUS, 2) {
            self.events &= !event::AL_STATUS;
        }
    }

    fn refresh(&mut self, at: usize, bytes: usize, buffers: &Buffers, context: &Context<'_>) {
        let touches = |register, length| touches(at, bytes, register, length);
        if touches(address::DL_STATUS, 2) {
            self.store(address::DL_STATUS, &dl_status(context).to_le_bytes());
        }
        if touches(address::AL_STATUS, 6) {
            let gateway = &context.gateway;
            let error = if gateway.al_error() { AL_ACKNOWLEDGE } else { 0 };
            self.store(address::AL_STATUS, &[gateway.al_state().raw() | error, 0]);
            self.store(address::AL_STATUS_CODE, &gateway.al_status_code().to_le_bytes());
        }
        if touches(address::EVENTS, 2) {
            self.store(address::EVENTS, &self.event_requests(buffers).to_le_bytes());
        }
        if touches(address::DEVICE_EVENTS, 4) {
            let sms =
                buffers.sync_managers().iter().enumerate().filter(|(_, sm)| sm.has_device_event());
            let events: u32 = sms.map(|(number, _)| FIRST_DEVICE_SYNC_MANAGER << number).sum();
            self.store(address::DEVICE_EVENTS, &events.to_le_bytes());
        }
        if touches(address::WATCHDOG_STATUS, 4) {
            let is_fed = !context.gateway.side().watchdog_has_expired();
            self.store(address::WATCHDOG_STATUS, &[is_fed.into()]);
            let expired = context.gateway.side().watchdog_expirations();
            let seen = expired.wrapping_sub(self.watchdogs_cleared).min(0xFF) as u8;
            self.store(address::WATCHDOG_COUNTERS, &[seen]);
        }
        if touches(address::EEPROM, INTERFACE_BYTES) {
            self.store(address::EEPROM, &self.eeprom.show(context.now));
        }
        if touches(address::SYNC_MANAGER, SYNC_MANAGERS * SYNC_MANAGER_BYTES) {
            for number in 0..SYNC_MANAGERS {
                let is_full = buffers.buffer_is_full(number, context);
                let first = address::SYNC_MANAGER + number * SYNC_MANAGER_BYTES;
                for byte in 0..SYNC_MANAGER_BYTES {
                    let value = buffers.sync_managers()[number].register(byte, is_full);
                    self.store(first + byte, &[value]);
                }
            }
        }
        if touches(address::RECEIVE_TIMES, 0x30) {
            let end = address::RECEIVE_TIMES + 0x30;
            self.clock.show(&mut self.bytes[address::RECEIVE_TIMES..end], context);
        }
        if touches(address::CYCLIC_START, 8)
            && let Some(next) = context.gateway.side().next_sync0_system_time(context.now)
        {
            self.store(address::CYCLIC_START, &next.to_le_bytes());
        }
    }

    pub(super) fn event_requests(&self, buffers: &Buffers) -> u16 {
        let sync_managers = buffers.sync_managers().iter().enumerate();
        self.events
            | sync_managers
                .filter(|(_, sm)| sm.has_event())
                .map(|(number, _)| event::FIRST_SYNC_MANAGER << number)
                .sum::<u16>()
    }

    /// The master writes registers; returns whether any of them is writable.
    pub(super) fn write(
        &mut self,
        at: usize,
        data: &[u8],
        buffers: &mut Buffers,
        context: &mut Context<'_>,
    ) -> bool {
        let mut is_done = false;
        for (first, length) in WRITABLE {
            let from = first.max(at);
            let to = (first + length).min(at + data.len());
            if from >= to {
                continue;
            }
            is_done = true;
            // any write clears a counter
            let is_counter = matches!(first, address::RECEIVE_ERRORS | address::WATCHDOG_COUNTERS);
            for byte in from..to {
                self.bytes[byte] = if is_counter { 0 } else { data[byte - at] };
            }
        }
        let sync_managers =
            address::SYNC_MANAGER..address::SYNC_MANAGER + SYNC_MANAGERS * SYNC_MANAGER_BYTES;
        for (byte, value) in (at..).zip(data).filter(|(byte, _)| sync_managers.contains(byte)) {
            let offset = byte - address::SYNC_MANAGER;
            let sm = buffers.sync_manager_mut(offset / SYNC_MANAGER_BYTES);
            is_done |= sm.write_register(offset % SYNC_MANAGER_BYTES, *value);
        }
        if touches(at, data.len(), address::EEPROM, INTERFACE_BYTES) {
            is_done |= self.write_eeprom_interface(at, data, context);
        }
        if is_done {
            self.after_write(at, data.len(), buffers, context);
        }
        is_done
    }

    fn after_write(
        &mut self,
        at: usize,
        bytes: usize,
        buffers: &mut Buffers,
        context: &mut Context<'_>,
    ) {
        let touches = |register, length| touches(at, bytes, register, length);
        if touches(address::AL_CONTROL, 1) {
            self.request_state(buffers, context);
        }
        if touches(address::WATCHDOG_COUNTERS, 2) {
            self.watchdogs_cleared = context.gateway.side().watchdog_expirations();
        }
        if touches(address::WATCHDOG_DIVIDER, 2) || touches(address::WATCHDOG_TIME, 2) {
            let divider = u64::from(u16::from_le_bytes(self.stored(address::WATCHDOG_DIVIDER)));
            let time = u64::from(u16::from_le_bytes(self.stored(address::WATCHDOG_TIME)));
            context.gateway.set_watchdog_ns((divider + 2) * WATCHDOG_STEP_NS * time);
        }
        if touches(address::FMMU, FMMUS * FMMU_BYTES) {
            for number in 0..FMMUS {
                let registers = self.stored(address::FMMU + number * FMMU_BYTES);
                self.fmmus[number] = Fmmu::from_registers(&registers);
            }
        }
        // reading gives the next pulse instead
        for (nth, byte) in self.cyclic_start.iter_mut().enumerate() {
            if touches(address::CYCLIC_START + nth, 1) {
                *byte = self.bytes[address::CYCLIC_START + nth];
            }
        }
        if touches(address::SYNC_MANAGER, SYNC_MANAGERS * SYNC_MANAGER_BYTES) {
            pass_sync_managers(buffers, context);
        }
        if touches(address::RECEIVE_TIMES, 4) {
            self.clock.latch(context);
        }
        if touches(address::TIME_OFFSET, 8) {
            let offset = u64::from_le_bytes(self.stored(address::TIME_OFFSET));
            self.clock.set_offset(offset, context);
        }
        if touches(address::TIME_DELAY, 4) {
            self.clock.delay = u32::from_le_bytes(self.stored(address::TIME_DELAY));
        }
        if touches(address::SYSTEM_TIME, 8) {
            let written_time: [u8; 8] = self.stored(address::SYSTEM_TIME);
            let is_whole = at + bytes >= address::SYSTEM_TIME + 8;
            self.clock.write_time(&written_time[..if is_whole { 8 } else { 4 }], context);
        }
        if touches(address::SPEED_COUNTER, 2) {
            context.gateway.parts().0.restart_dc_control(context.now);
        }
        if touches(address::CYCLIC_CONTROL, 2) {
            let [activation] = self.stored(address::ACTIVATION);
            let start = u64::from_le_bytes(self.cyclic_start);
            let cycle = u32::from_le_bytes(self.stored(address::SYNC0_CYCLE));
            switch_sync0(context.gateway, activation, start, cycle);
        }
    }

    /// AL control was written. With a pending error only a request that acknowledges it is
    /// accepted; a request for INIT always is.
    fn request_state(&self, buffers: &mut Buffers, context: &mut Context<'_>) {
        let [control] = self.stored(address::AL_CONTROL);
        let state = AlState::from_raw(control & AL_STATE);
        let acknowledges = control & AL_ACKNOWLEDGE != 0 || state == Some(AlState::Init);
        if context.gateway.al_error() && !acknowledges {
            return;
        }
        match state {
            Some(state) => context.gateway.request_al_state(context.now, state),
            None => {
                context.gateway.advance(context.now);
                if context.gateway.is_responding() {
                    context.gateway.parts().0.reject_unknown_al_state();
                }
            }
        }
        buffers.check_stops(context);
    }

    fn write_eeprom_interface(
        &mut self,
        at: usize,
        data: &[u8],
        context: &mut Context<'_>,
    ) -> bool {
        const OWNED_BY_DEVICE: u8 = 1;
        let [owner] = self.stored(address::EEPROM_OWNER);
        if owner & OWNED_BY_DEVICE != 0 {
            return false;
        }
        let mut interface = self.eeprom.show(context.now);
        for (byte, value) in (at..).zip(data) {
            let offset = byte.checked_sub(address::EEPROM);
            if let Some(to) = offset.and_then(|offset| interface.get_mut(offset)) {
                *to = *value;
            }
        }
        let has_command = touches(at, data.len(), address::EEPROM + 1, 1);
        let words = context.gateway.eeprom();
        match self.eeprom.written(context.now, &interface, has_command, words) {
            Effect::Nothing => {}
            Effect::Write { word, value } => context.gateway.write_eeprom(word, value),
            // the alias is loaded at power-on only
            Effect::Reload => self.load_interface_configuration(context.gateway.eeprom()),
        }
        true
    }

    /// Loads the configuration from the EEPROM, as at power-on.
    pub(super) fn load_configuration(&mut self, words: &[u16]) {
        self.eeprom.check(words);
        self.load_interface_configuration(words);
        self.store(address::ALIAS, &words.get(4).copied().unwrap_or(0).to_le_bytes());
    }

    /// Loads the part of the configuration that a reload also loads.
    fn load_interface_configuration(&mut self, words: &[u16]) {
        let word = |at: usize| words.get(at).copied().unwrap_or(0).to_le_bytes();
        self.store(address::PDI, &word(0));
        self.store(address::PULSE_LENGTH, &word(2));
    }
}

fn dl_status(context: &Context<'_>) -> u16 {
    // loaded, device watchdog, link and communication at port 0, ports 2 and 3 closed
    const FIXED: u16 = 1 << 0 | 1 << 1 | 1 << 4 | 1 << 9 | 1 << 12 | 1 << 14;
    // port 1: link and communication, or closed
    FIXED | if context.return_ns.is_some() { 1 << 5 | 1 << 11 } else { 1 << 10 }
}

/// Passes SM0 to SM3 to the firmware.
fn pass_sync_managers(buffers: &mut Buffers, context: &mut Context<'_>) {
    for number in 0..4 {
        let sm = buffers.sync_managers()[number];
        let config = sm.is_enabled().then_some(sm.config);
        context.gateway.configure_sync_manager(number as u8, config);
    }
    buffers.repeat_if_requested();
}

const PORTS: usize = 4;
/// Activation bits: cyclic unit, Sync0.
const ACTIVE: u8 = 0x01;
const SYNC0: u8 = 0x02;
const SYNC1: u8 = 0x04;

/// State of 0x0900 to 0x09A7 outside the gateway.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ClockRegisters {
    receive_times: [u32; PORTS],
    frame_received: u64,
    offset: u64,
    pub(super) delay: u32,
}

impl ClockRegisters {
    fn system_time(self, context: &Context<'_>) -> u64 {
        context.gateway.side().dc_time(context.now).wrapping_add(context.delay_ns)
    }

    /// A write to 0x0900 latches the arrival of this frame at the ports.
    pub(super) fn latch(&mut self, context: &Context<'_>) {
        let arrival = self.system_time(context).wrapping_sub(self.offset);
        self.frame_received = arrival;
        self.receive_times[0] = arrival as u32;
        if let Some(ns) = context.return_ns {
            self.receive_times[1] = arrival.wrapping_add(ns) as u32;
        }
    }

    /// Writes the present values of 0x0900 to 0x0937 to `registers`.
    pub(super) fn show(&self, registers: &mut [u8], context: &Context<'_>) {
        let mut put = |at: usize, bytes: &[u8]| {
            if let Some(to) = registers.get_mut(at..at + bytes.len()) {
                to.copy_from_slice(bytes);
            }
        };
        for (port, time) in self.receive_times.iter().enumerate() {
            put(4 * port, &time.to_le_bytes());
        }
        put(0x10, &self.system_time(context).to_le_bytes());
        put(0x18, &self.frame_received.to_le_bytes());
        put(0x20, &self.offset.to_le_bytes());
        put(0x28, &self.delay.to_le_bytes());
        // sign and magnitude; the sign is set while the own time is less
        let difference = context.gateway.dc_difference_ns();
        let magnitude = u32::try_from(difference.unsigned_abs()).unwrap_or(u32::MAX) & 0x7FFF_FFFF;
        let sign = if difference > 0 { 1 << 31 } else { 0 };
        put(0x2C, &(magnitude | sign).to_le_bytes());
    }

    /// The master writes the time, complete or its lower half (0x0910).
    pub(super) fn write_time(&self, bytes: &[u8], context: &mut Context<'_>) {
        let own = self.system_time(context);
        let written_time = match *bytes {
            [a, b, c, d, e, f, g, h] => u64::from_le_bytes([a, b, c, d, e, f, g, h]),
            [a, b, c, d] => {
                let ahead = u32::from_le_bytes([a, b, c, d])
                    .wrapping_sub(own as u32)
                    .wrapping_add(self.delay) as i32;
                own.wrapping_add_signed(i64::from(ahead)).wrapping_sub(self.delay.into())
            }
            _ => return,
        };
        let target = written_time.wrapping_add(self.delay.into()).wrapping_sub(context.delay_ns);
        context.gateway.correct_dc_system_time(context.now, target);
    }

    /// The master sets the offset of the system time (0x0920).
    pub(super) fn set_offset(&mut self, offset: u64, context: &mut Context<'_>) {
        let moved = offset.wrapping_sub(std::mem::replace(&mut self.offset, offset));
        let time = context.gateway.side().dc_time(context.now).wrapping_add(moved);
        context.gateway.write_dc_system_time(context.now, time);
    }
}

/// Starts or stops Sync0 after a write to 0x0980 or 0x0981, with the present start and cycle time.
pub(super) fn switch_sync0(gateway: &mut Gateway, activation: u8, start_ns: u64, cycle_ns: u32) {
    let runs = activation & (ACTIVE | SYNC0) == ACTIVE | SYNC0 && cycle_ns > 0;
    gateway.set_dc_sync1(activation & SYNC1 != 0);
    gateway.set_dc_sync0(runs.then_some(Sync0 { start_ns, cycle_ns, shift_ns: 0 }));
}
