//! One slave controller: which datagrams concern it, and what they count.

use ecan_protocol::AlState;

use crate::mailbox::MailboxServer;

use super::clock::ClockRegisters;
use super::command::{Access, Command};
use super::eeprom::{EepromInterface, Effect, INTERFACE_BYTES};
use super::fmmu::{FMMUS, Fmmu, Part, copy_bits};
use super::frame::{Datagram, FrameFault, for_each_datagram};
use super::memory::{Context, MEMORY_BYTES, READ_MAILBOX, WRITE_MAILBOX};
use super::registers::{self, REGISTER_BYTES, address, event};
use super::sync_manager::{SYNC_MANAGERS, SyncManager};

/// Data of the longest datagram that a frame holds.
const DATAGRAM_BYTES: usize = 1500;

/// DL status: configuration loaded, link on ports 0 and 1, communication on them, closed loops.
mod dl {
    pub(super) const LOADED: u16 = 1 << 0;
    pub(super) const LINK_0: u16 = 1 << 4;
    pub(super) const LINK_1: u16 = 1 << 5;
    pub(super) const COMMUNICATION_0: u16 = 1 << 9;
    pub(super) const CLOSED_1: u16 = 1 << 10;
    pub(super) const COMMUNICATION_1: u16 = 1 << 11;
    pub(super) const CLOSED_2_AND_3: u16 = 1 << 12 | 1 << 14;
}
/// DL control: the alias is a station address as well.
const ALIAS_IS_ADDRESS: u8 = 1;

/// A slave controller. Its EtherCAT state, clock and process data buffers are the gateway's.
pub(super) struct Controller {
    pub(super) registers: Box<[u8]>,
    pub(super) memory: Box<[u8]>,
    pub(super) sync_managers: [SyncManager; SYNC_MANAGERS],
    pub(super) fmmus: [Option<Fmmu>; FMMUS],
    pub(super) clock: ClockRegisters,
    pub(super) eeprom: EepromInterface,
    /// Event requests of the link and of the state.
    pub(super) events: u16,
    /// Expirations of the watchdog when its counter was cleared.
    pub(super) watchdogs_cleared: u32,
    mailbox: MailboxServer,
    scratch: Box<[u8]>,
    /// Boots of the gateway that it has gone along with.
    boots: Option<u32>,
    /// What was last told of the state, and of the next slave.
    shown_state: (AlState, bool),
    has_next: bool,
}

impl Controller {
    pub(super) fn new() -> Self {
        Self {
            registers: registers::initial(),
            memory: vec![0; MEMORY_BYTES].into_boxed_slice(),
            sync_managers: [SyncManager::default(); SYNC_MANAGERS],
            fmmus: [None; FMMUS],
            clock: ClockRegisters::default(),
            eeprom: EepromInterface::default(),
            events: 0,
            watchdogs_cleared: 0,
            mailbox: MailboxServer::new(),
            scratch: vec![0; DATAGRAM_BYTES].into_boxed_slice(),
            boots: None,
            shown_state: (AlState::Init, false),
            has_next: false,
        }
    }

    /// A frame passes. It is served up to its first fault.
    pub(super) fn pass(&mut self, frame: &mut [u8], context: &mut Context<'_>) {
        self.catch_up(context);
        match for_each_datagram(frame, |datagram| self.serve(datagram, context)) {
            Ok(()) | Err(FrameFault::NotEtherCat) => {}
            Err(_) => self.count_processing_error(),
        }
    }

    /// What has happened since the last frame.
    fn catch_up(&mut self, context: &mut Context<'_>) {
        let boots = context.gateway.boots();
        if self.boots != Some(boots) {
            *self = Self { boots: Some(boots), has_next: self.has_next, ..Self::new() };
            // Local time begins with the controller.
            context.gateway.write_dc_system_time(context.now, 0);
            let words = context.gateway.eeprom();
            self.load_configuration(words);
            self.eeprom.check(words);
        }
        let has_next = context.way_back_ns.is_some();
        if std::mem::replace(&mut self.has_next, has_next) != has_next {
            self.events |= event::DL_STATUS;
            if !has_next {
                self.count_lost_link(1);
            }
        }
        let state = (context.gateway.al_state(), context.gateway.al_error());
        if std::mem::replace(&mut self.shown_state, state) != state {
            self.events |= event::AL_STATUS;
            if !context.gateway.al_state().has_mailbox() {
                self.mailbox.reset();
            }
        }
        self.notice_buffers(context);
        self.serve_mailbox(context);
    }

    pub(super) fn dl_status(&self, context: &Context<'_>) -> u16 {
        let port_1 = match context.way_back_ns {
            Some(_) => dl::LINK_1 | dl::COMMUNICATION_1,
            None => dl::CLOSED_1,
        };
        dl::LOADED | dl::LINK_0 | dl::COMMUNICATION_0 | port_1 | dl::CLOSED_2_AND_3
    }

    fn is_addressed(&self, station: u16) -> bool {
        let is = |at| u16::from_le_bytes(self.stored(at)) == station;
        let [.., has_alias] = self.stored::<4>(address::DL_CONTROL);
        is(address::STATION) || (has_alias & ALIAS_IS_ADDRESS != 0 && is(address::ALIAS))
    }

    fn serve(&mut self, mut datagram: Datagram<'_>, context: &mut Context<'_>) {
        let address = datagram.slave_address();
        match Command::from_raw(datagram.command()) {
            // What a real controller does not know, it lets pass.
            None | Some(Command::None) => return,
            Some(Command::Position(access)) => {
                datagram.count_slave_address_up();
                if address == 0 {
                    self.access(access, &mut datagram, context);
                }
            }
            Some(Command::Station(access)) => {
                if self.is_addressed(address) {
                    self.access(access, &mut datagram, context);
                }
            }
            Some(Command::Broadcast(access)) => {
                datagram.count_slave_address_up();
                self.broadcast(access, &mut datagram, context);
            }
            Some(Command::Logical(access)) => self.map(access, &mut datagram, context),
            Some(Command::PositionReadOthersWrite) => {
                datagram.count_slave_address_up();
                let access = if address == 0 { Access::Read } else { Access::Write };
                self.access(access, &mut datagram, context);
            }
            Some(Command::StationReadOthersWrite) => {
                let is_read = self.is_addressed(address);
                let access = if is_read { Access::Read } else { Access::Write };
                self.access(access, &mut datagram, context);
            }
        }
        let mask = u16::from_le_bytes(self.stored(address::EVENT_MASK));
        if mask != 0 {
            datagram.add_events(self.event_requests() & mask);
        }
    }

    fn access(&mut self, access: Access, datagram: &mut Datagram<'_>, context: &mut Context<'_>) {
        let offset = datagram.offset();
        let mut scratch = std::mem::take(&mut self.scratch);
        let bytes = datagram.data().len().min(scratch.len());
        if access == Access::Exchange {
            scratch[..bytes].copy_from_slice(&datagram.data()[..bytes]);
        }
        if access.reads() && self.read(offset, datagram.data(), context) {
            datagram.count(1);
        }
        let is_written = match access {
            Access::Read => false,
            Access::Write => self.write(offset, datagram.data(), context),
            Access::Exchange => self.write(offset, &scratch[..bytes], context),
        };
        if is_written {
            datagram.count(if access == Access::Exchange { 2 } else { 1 });
        }
        self.scratch = scratch;
    }

    fn broadcast(
        &mut self,
        access: Access,
        datagram: &mut Datagram<'_>,
        context: &mut Context<'_>,
    ) {
        if access == Access::Write {
            return self.access(access, datagram, context);
        }
        let offset = datagram.offset();
        let mut scratch = std::mem::take(&mut self.scratch);
        let bytes = datagram.data().len().min(scratch.len());
        let own = &mut scratch[..bytes];
        own.fill(0);
        let is_read = self.read(offset, own, context);
        if access == Access::Exchange && self.write(offset, datagram.data(), context) {
            datagram.count(2);
        }
        if is_read {
            datagram.count(1);
            for (to, from) in datagram.data().iter_mut().zip(&*own) {
                *to |= from;
            }
        }
        self.scratch = scratch;
    }

    /// A logical datagram. What is written is what came, before this slave's inputs go into it.
    fn map(&mut self, access: Access, datagram: &mut Datagram<'_>, context: &mut Context<'_>) {
        let logical = datagram.logical_address();
        let bytes = datagram.data().len();
        let (mut is_written, mut is_read) = (false, false);
        for fmmu in self.fmmus.into_iter().flatten().filter(|fmmu| fmmu.writes && access.writes()) {
            if let Some(part) = fmmu.part(logical, bytes) {
                is_written |= self.write_part(part, datagram.data(), context);
            }
        }
        for fmmu in self.fmmus.into_iter().flatten().filter(|fmmu| fmmu.reads && access.reads()) {
            if let Some(part) = fmmu.part(logical, bytes) {
                is_read |= self.read_part(part, datagram.data(), context);
            }
        }
        let weight = if access == Access::Exchange { 2 } else { 1 };
        datagram.count(u16::from(is_read) + if is_written { weight } else { 0 });
    }

    fn write_part(&mut self, part: Part, data: &[u8], context: &mut Context<'_>) -> bool {
        match part {
            Part::Bytes { at, length, physical } => {
                let bytes = data.get(at..at + length).unwrap_or_default();
                self.write(physical, bytes, context)
            }
            Part::Bits { at, length, physical } => {
                let (first, bytes) = byte_range(physical, length);
                let Ok(address) = u16::try_from(first) else { return false };
                let mut scratch = std::mem::take(&mut self.scratch);
                let own = &mut scratch[..bytes.min(DATAGRAM_BYTES)];
                // The bits beside stay as they are.
                let beside = if first < REGISTER_BYTES {
                    self.registers.get(first..first + own.len()).unwrap_or_default()
                } else {
                    self.memory_at(first, own.len())
                };
                own[..beside.len()].copy_from_slice(beside);
                copy_bits(data, at, own, physical % 8, length);
                let is_done = self.write(address, own, context);
                self.scratch = scratch;
                is_done
            }
        }
    }

    fn read_part(&mut self, part: Part, data: &mut [u8], context: &mut Context<'_>) -> bool {
        match part {
            Part::Bytes { at, length, physical } => {
                let bytes = data.get_mut(at..at + length).unwrap_or_default();
                self.read(physical, bytes, context)
            }
            Part::Bits { at, length, physical } => {
                let (first, bytes) = byte_range(physical, length);
                let Ok(address) = u16::try_from(first) else { return false };
                let mut scratch = std::mem::take(&mut self.scratch);
                let own = &mut scratch[..bytes.min(DATAGRAM_BYTES)];
                let is_done = self.read(address, own, context);
                if is_done {
                    copy_bits(own, physical % 8, data, at, length);
                }
                self.scratch = scratch;
                is_done
            }
        }
    }

    /// Lets the firmware take what lies in the write mailbox, and fill the read mailbox.
    pub(super) fn serve_mailbox(&mut self, context: &mut Context<'_>) {
        let now = context.now;
        if !context.gateway.mailbox_answers(now) {
            return;
        }
        let [to_device, from_device] = [WRITE_MAILBOX, READ_MAILBOX].map(|n| self.sync_managers[n]);
        if to_device.is_enabled() && to_device.is_full {
            let from = to_device.start().saturating_sub(REGISTER_BYTES);
            let request = self.memory.get(from..from + to_device.length()).unwrap_or_default();
            self.mailbox.receive(now, request, from_device.length(), context.gateway);
            self.sync_managers[WRITE_MAILBOX].emptied();
        }
        let is_waiting = from_device.is_enabled() && !from_device.is_full;
        if is_waiting && self.mailbox.is_due(now, context.gateway) {
            let to = from_device.start().saturating_sub(REGISTER_BYTES);
            let out = self.memory.get_mut(to..to + from_device.length()).unwrap_or_default();
            if self.mailbox.send(now, out, context.gateway) {
                self.sync_managers[READ_MAILBOX].filled();
            }
        }
    }

    /// The master may ask for the last message of the read mailbox once more.
    pub(super) fn repeat_if_asked(&mut self) {
        let sm = &mut self.sync_managers[READ_MAILBOX];
        if !sm.is_enabled() || !sm.take_repeat_request() {
            return;
        }
        let to = sm.start().saturating_sub(REGISTER_BYTES);
        let out = self.memory.get_mut(to..to + sm.length()).unwrap_or_default();
        if self.mailbox.repeat(out) {
            sm.filled();
        }
    }

    /// The master has written the EEPROM interface.
    pub(super) fn command_eeprom(
        &mut self,
        interface: &[u8; INTERFACE_BYTES],
        has_command: bool,
        context: &mut Context<'_>,
    ) {
        let words = context.gateway.eeprom();
        match self.eeprom.written(context.now, interface, has_command, words) {
            Effect::Nothing => {}
            Effect::Write { word, value } => context.gateway.write_eeprom(word, value),
            Effect::Reload => {
                let words = context.gateway.eeprom();
                self.load_configuration(words);
            }
        }
    }
}

/// First byte of a stretch of bits, and how many bytes it touches.
fn byte_range(first_bit: usize, bits: usize) -> (usize, usize) {
    let first = first_bit / 8;
    (first, (first_bit + bits).div_ceil(8) - first)
}
