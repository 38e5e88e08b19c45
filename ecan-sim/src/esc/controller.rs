//! Slave controller: addressing of datagrams and working counters.

mod logical;
mod mailbox_buffers;
mod memory;
mod registers;

use ecan_protocol::device::AlState;

use super::Context;
use super::clock::ClockRegisters;
use super::eeprom::EepromInterface;
use super::frame::{Datagram, FrameFault, for_each_datagram};
use super::sync_manager::{FMMUS, Fmmu};
use super::sync_manager::{SYNC_MANAGERS, SyncManager};
use mailbox_buffers::MailboxBuffers;
use memory::{INPUTS, MEMORY_BYTES, OUTPUTS, READ_MAILBOX, WRITE_MAILBOX};
use registers::{address, event};

/// Longest data of a datagram: its length has 11 bits.
const DATAGRAM_BYTES: usize = 0x7FF;

/// Kind of access at an addressed slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Access {
    Read,
    Write,
    /// The memory is read before it is written.
    Exchange,
}

impl Access {
    fn reads(self) -> bool {
        self != Self::Write
    }

    fn writes(self) -> bool {
        self != Self::Read
    }
}

/// DL control bit: the alias is also a station address.
const ALIAS_IS_ADDRESS: u8 = 1;

/// Number of times that the firmware stopped mailboxes and process data.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
struct Stops {
    mailbox: u32,
    process_data: u32,
}

impl Stops {
    fn of(context: &Context<'_>) -> Self {
        Self {
            mailbox: context.gateway.mailbox_stops(),
            process_data: context.gateway.process_data_stops(),
        }
    }
}

/// A slave controller. EtherCAT state, clock and process data buffers belong to the gateway.
#[derive(Clone)]
pub(super) struct Controller {
    registers: Box<[u8]>,
    memory: Box<[u8]>,
    sync_managers: [SyncManager; SYNC_MANAGERS],
    fmmus: [Option<Fmmu>; FMMUS],
    clock: ClockRegisters,
    eeprom: EepromInterface,
    /// Written start time of the cyclic unit.
    cyclic_start: [u8; 8],
    /// Event requests of link and AL state.
    events: u16,
    /// Watchdog expirations at the last clear of the counter.
    watchdogs_cleared: u32,
    mailbox: MailboxBuffers,
    scratch: Box<[u8]>,
    /// Number of gateway boots at the last reset of this controller.
    boots: Option<u32>,
    stops: Stops,
    /// AL state and error indication in the last frame.
    last_state: (AlState, bool),
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
            cyclic_start: [0; 8],
            events: 0,
            watchdogs_cleared: 0,
            mailbox: MailboxBuffers::default(),
            scratch: vec![0; DATAGRAM_BYTES].into_boxed_slice(),
            boots: None,
            stops: Stops::default(),
            last_state: (AlState::Init, false),
            has_next: false,
        }
    }

    pub(super) fn pass(&mut self, frame: &mut [u8], context: &mut Context<'_>) {
        self.catch_up(context);
        match for_each_datagram(frame, |datagram| self.serve(datagram, context)) {
            Ok(()) | Err(FrameFault::NotEtherCat) => {}
            Err(_) => self.count(address::PROCESSING_ERRORS),
        }
    }

    fn catch_up(&mut self, context: &mut Context<'_>) {
        let boots = context.gateway.boots();
        if self.boots != Some(boots) {
            *self = Self { boots: Some(boots), has_next: self.has_next, ..Self::new() };
            // local time starts at power-on
            let since_boot = context.gateway.dc_time_since_boot(context.now);
            context.gateway.write_dc_system_time(context.now, since_boot);
            self.stops = Stops::of(context);
            let words = context.gateway.eeprom();
            self.load_configuration(words);
            self.eeprom.check(words);
        }
        let has_next = context.return_ns.is_some();
        if std::mem::replace(&mut self.has_next, has_next) != has_next {
            self.events |= event::DL_STATUS;
            if !has_next {
                self.count_lost_link(1);
            }
        }
        let state = (context.gateway.al_state(), context.gateway.al_error());
        if std::mem::replace(&mut self.last_state, state) != state {
            self.events |= event::AL_STATUS;
        }
        self.check_stops(context);
        self.check_buffers(context);
        self.serve_mailbox(context);
    }

    /// Voids partial accesses and buffer contents that the firmware has stopped.
    pub(super) fn check_stops(&mut self, context: &Context<'_>) {
        let stops = Stops::of(context);
        let before = std::mem::replace(&mut self.stops, stops);
        if stops.mailbox != before.mailbox {
            self.mailbox = MailboxBuffers::default();
            self.sync_managers[WRITE_MAILBOX].discard();
            self.sync_managers[READ_MAILBOX].discard();
        }
        if stops.process_data != before.process_data {
            self.sync_managers[OUTPUTS].discard();
            self.sync_managers[INPUTS].discard();
        }
    }

    pub(super) fn dl_status(&self, context: &Context<'_>) -> u16 {
        // loaded, device watchdog, link and communication at port 0, ports 2 and 3 closed
        const FIXED: u16 = 1 << 0 | 1 << 1 | 1 << 4 | 1 << 9 | 1 << 12 | 1 << 14;
        // port 1: link and communication, or closed
        FIXED | if context.return_ns.is_some() { 1 << 5 | 1 << 11 } else { 1 << 10 }
    }

    fn is_addressed(&self, station: u16) -> bool {
        let is = |at| u16::from_le_bytes(self.stored(at)) == station;
        let [.., has_alias] = self.stored::<4>(address::DL_CONTROL);
        is(address::STATION) || (has_alias & ALIAS_IS_ADDRESS != 0 && is(address::ALIAS))
    }

    fn serve(&mut self, mut datagram: Datagram<'_>, context: &mut Context<'_>) {
        let (command, address) = (datagram.command(), datagram.slave_address());
        let is_addressed = match command {
            // APRD, APWR, APRW, ARMW: the slave that finds the address 0; each one counts it up
            1..=3 | 13 => address == 0,
            // FPRD, FPWR, FPRW, FRMW
            4..=6 | 14 => self.is_addressed(address),
            // BRD, BWR, BRW; LRD, LWR, LRW
            7..=12 => true,
            // NOP and undefined commands pass unchanged
            _ => return,
        };
        let is_broadcast = matches!(command, 7..=9);
        if is_broadcast || matches!(command, 1..=3 | 13) {
            datagram.count_slave_address_up();
        }
        let access = match command {
            // the addressed slave is read, all others are written
            13 | 14 if is_addressed => Access::Read,
            13 | 14 => Access::Write,
            _ => [Access::Read, Access::Write, Access::Exchange][usize::from(command - 1) % 3],
        };
        if matches!(command, 10..=12) {
            self.map(access, &mut datagram, context);
        } else if is_addressed || command >= 13 {
            self.access(access, is_broadcast, &mut datagram, context);
        }
        let mask = u16::from_le_bytes(self.stored(address::EVENT_MASK));
        if mask != 0 {
            datagram.add_events(self.event_requests() & mask);
        }
    }

    /// Accesses the memory; with a broadcast what is read is combined by OR.
    fn access(
        &mut self,
        access: Access,
        is_broadcast: bool,
        datagram: &mut Datagram<'_>,
        context: &mut Context<'_>,
    ) {
        let offset = datagram.offset();
        let mut scratch = std::mem::take(&mut self.scratch);
        let own = &mut scratch[..datagram.data().len()];
        // a rejected part of the memory leaves the datagram as it is
        own.copy_from_slice(datagram.data());
        if is_broadcast {
            own.fill(0);
        }
        let is_read = access.reads() && self.read(offset, own, context);
        if access.writes() && self.write(offset, datagram.data(), context) {
            datagram.count(if access == Access::Exchange { 2 } else { 1 });
        }
        if is_read {
            datagram.count(1);
            for (to, from) in datagram.data().iter_mut().zip(&*own) {
                *to = if is_broadcast { *to | from } else { *from };
            }
        }
        self.scratch = scratch;
    }
}
