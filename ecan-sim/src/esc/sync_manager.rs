//! Sync managers with their buffers, process data and mailboxes (ETG.1000.4; manual 5.3); and FMMUs: mapping of logical
//! addresses to the memory of a slave, by bytes and by bits.
//!
//! A single buffer (mailbox mode) is full or empty. An access begins with its first byte and is
//! complete with its last one, in one datagram or in several; an access that begins elsewhere is
//! rejected.

use super::Context;
use crate::gateway::SyncManagerConfig;
use crate::mailbox::MailboxServer;

pub(super) const SYNC_MANAGER_BYTES: usize = 8;
pub(super) const SYNC_MANAGERS: usize = 8;

const STATUS_WRITTEN: u8 = 0x01;
const STATUS_READ: u8 = 0x02;
const STATUS_FULL: u8 = 0x08;

const ACTIVATE_ENABLED: u8 = 0x01;
const ACTIVATE_REPEAT: u8 = 0x02;
/// Bits of the activation register that the master may write.
const ACTIVATE_WRITABLE: u8 = 0xC3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SyncManager {
    pub(super) config: SyncManagerConfig,
    activate: u8,
    /// Acknowledge of the repeat request, in the register of the device side.
    repeat_acknowledged: bool,
    /// Single buffer: its contents were not read yet.
    pub(super) is_full: bool,
    /// A partial access is in progress.
    is_open: bool,
    /// Written completely and not read since; read completely and not written since.
    was_written: bool,
    was_read: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    Rejected,
    Begun,
    Complete,
}

impl SyncManager {
    pub(super) fn is_enabled(&self) -> bool {
        self.activate & ACTIVATE_ENABLED != 0 && self.config.length > 0
    }

    pub(super) fn start(&self) -> usize {
        self.config.start.into()
    }

    pub(super) fn length(&self) -> usize {
        self.config.length.into()
    }

    pub(super) fn end(&self) -> usize {
        self.start() + self.length()
    }

    pub(super) fn contains(&self, address: usize) -> bool {
        self.is_enabled() && (self.start()..self.end()).contains(&address)
    }

    /// Voids the contents and a partial access.
    pub(super) fn discard(&mut self) {
        (self.is_full, self.is_open) = (false, false);
        (self.was_written, self.was_read) = (false, false);
    }

    /// The master writes `bytes` bytes from an offset. `is_full` is the state of the buffer, which
    /// may belong to the firmware.
    pub(super) fn write(&mut self, offset: usize, bytes: usize, is_full: bool) -> Progress {
        let is_free = !self.config.is_single() || !is_full;
        let may = self.config.is_written_by_master() && is_free;
        self.access(may, offset, bytes)
    }

    pub(super) fn read(&mut self, offset: usize, bytes: usize, is_full: bool) -> Progress {
        let has_data = !self.config.is_single() || is_full;
        let may = !self.config.is_written_by_master() && has_data;
        self.access(may, offset, bytes)
    }

    fn access(&mut self, may: bool, offset: usize, bytes: usize) -> Progress {
        if !may || (offset > 0 && !self.is_open) {
            return Progress::Rejected;
        }
        self.is_open = offset + bytes < self.length();
        if self.is_open { Progress::Begun } else { Progress::Complete }
    }

    pub(super) fn mark_full(&mut self) {
        (self.is_full, self.was_written, self.was_read) = (true, true, false);
    }

    pub(super) fn mark_empty(&mut self) {
        (self.is_full, self.was_written, self.was_read) = (false, false, true);
    }

    /// Event request for the master.
    pub(super) fn has_event(&self) -> bool {
        self.is_enabled()
            && if self.config.is_written_by_master() { self.was_read } else { self.was_written }
    }

    pub(super) fn has_device_event(&self) -> bool {
        self.is_enabled()
            && if self.config.is_written_by_master() { self.was_written } else { self.was_read }
    }

    pub(super) fn take_repeat_request(&mut self) -> bool {
        let requested = self.activate & ACTIVATE_REPEAT != 0;
        let is_new = requested != self.repeat_acknowledged;
        self.repeat_acknowledged = requested;
        is_new
    }

    pub(super) fn register(&self, at: usize, is_full: bool) -> u8 {
        let flag = |is_set: bool, flag: u8| if is_set { flag } else { 0 };
        match at {
            0 | 1 => self.config.start.to_le_bytes()[at],
            2 | 3 => self.config.length.to_le_bytes()[at - 2],
            4 => self.config.control,
            5 => {
                flag(self.was_written, STATUS_WRITTEN)
                    | flag(self.was_read, STATUS_READ)
                    | flag(is_full && self.config.is_single(), STATUS_FULL)
            }
            6 => self.activate,
            7 => flag(self.repeat_acknowledged, ACTIVATE_REPEAT),
            _ => 0,
        }
    }

    /// Writes a register; returns whether it is writable. The buffer can be configured only while
    /// it is disabled.
    pub(super) fn write_register(&mut self, at: usize, value: u8) -> bool {
        let is_on = self.activate & ACTIVATE_ENABLED != 0;
        let changed = |word: u16| {
            let mut bytes = word.to_le_bytes();
            bytes[at % 2] = value;
            u16::from_le_bytes(bytes)
        };
        match at {
            0..=4 if is_on => return true,
            0 | 1 => self.config.start = changed(self.config.start),
            2 | 3 => self.config.length = changed(self.config.length),
            4 => self.config.control = value,
            6 => {
                self.activate = value & ACTIVATE_WRITABLE;
                let is_still_on = value & ACTIVATE_ENABLED != 0;
                if is_on != is_still_on {
                    self.discard();
                    self.repeat_acknowledged = value & ACTIVATE_REPEAT != 0;
                }
            }
            _ => return false,
        }
        true
    }
}

pub(super) const FMMU_BYTES: usize = 16;
pub(super) const FMMUS: usize = 8;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fmmu {
    pub(super) logical: u32,
    pub(super) length: u16,
    first_bit: u8,
    last_bit: u8,
    pub(super) physical: u16,
    physical_bit: u8,
    pub(super) reads: bool,
    pub(super) writes: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Bytes {
        /// First byte in the datagram's data.
        at: usize,
        length: usize,
        /// First byte in the memory.
        physical: u16,
    },
    /// Bits that begin or end inside bytes.
    Bits {
        /// First bit in the datagram's data.
        at: usize,
        length: usize,
        /// First bit in the memory, counted from the byte 0.
        physical: usize,
    },
}

impl Fmmu {
    /// Decodes registers; `None` while disabled or without a mapping.
    pub(super) fn from_registers(registers: &[u8; FMMU_BYTES]) -> Option<Self> {
        let [l0, l1, l2, l3, n0, n1, first, last, p0, p1, bit, direction, active, ..] = *registers;
        let length = u16::from_le_bytes([n0, n1]);
        (active & 1 == 1 && length > 0).then_some(Self {
            logical: u32::from_le_bytes([l0, l1, l2, l3]),
            length,
            first_bit: first & 7,
            last_bit: last & 7,
            physical: u16::from_le_bytes([p0, p1]),
            physical_bit: bit & 7,
            reads: direction & 1 == 1,
            writes: direction & 2 == 2,
        })
    }

    pub(super) fn part(&self, logical: u32, bytes: usize) -> Option<Part> {
        let own = i64::from(self.logical);
        let datagram = i64::from(logical);
        let first = own.max(datagram);
        let end = (own + i64::from(self.length)).min(datagram + bytes as i64);
        if first >= end {
            return None;
        }
        let (at, within) = ((first - datagram) as usize, (first - own) as usize);
        let length = (end - first) as usize;
        if (self.first_bit, self.last_bit, self.physical_bit) == (0, 7, 0) {
            let physical = self.physical.checked_add(u16::try_from(within).ok()?)?;
            return Some(Part::Bytes { at, length, physical });
        }
        // without the bits of the first and last byte outside the FMMU
        let is_first = within == 0;
        let is_last = end == own + i64::from(self.length);
        let from = at * 8 + if is_first { usize::from(self.first_bit) } else { 0 };
        let to = (at + length) * 8 - if is_last { 7 - usize::from(self.last_bit) } else { 0 };
        let before = if is_first { 0 } else { within * 8 - usize::from(self.first_bit) };
        let physical = usize::from(self.physical) * 8 + usize::from(self.physical_bit) + before;
        (from < to).then(|| Part::Bits { at: from, length: to - from, physical })
    }
}

/// Copies bits between byte strings, least significant bit first; bits outside are dropped.
pub(super) fn copy_bits(from: &[u8], first: usize, to: &mut [u8], at: usize, length: usize) {
    for bit in 0..length {
        let Some(source) = from.get((first + bit) / 8) else { return };
        let is_set = source >> ((first + bit) % 8) & 1 == 1;
        let Some(target) = to.get_mut((at + bit) / 8) else { return };
        let mask = 1 << ((at + bit) % 8);
        *target = if is_set { *target | mask } else { *target & !mask };
    }
}

/// Bytes of the registers, after which the memory begins.
pub(super) const REGISTER_BYTES: usize = 0x1000;
const MEMORY_END: usize = REGISTER_BYTES + 0x2000;
const MEMORY_BYTES: usize = MEMORY_END - REGISTER_BYTES;

const WRITE_MAILBOX: usize = 0;
const READ_MAILBOX: usize = 1;
const OUTPUTS: usize = 2;
const INPUTS: usize = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Area {
    Registers,
    Buffer(usize),
    Memory,
    Nothing,
}

/// Number of times that the firmware stopped mailboxes and process data.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
struct Stops {
    mailbox: u32,
    process_data: u32,
}

impl Stops {
    fn of(context: &Context<'_>) -> Self {
        Self {
            mailbox: context.gateway.side().mailbox_stops(),
            process_data: context.gateway.side().process_data_stops(),
        }
    }
}

#[derive(Clone, Default)]
struct MailboxBuffers {
    server: MailboxServer,
    /// The last message read, for a repeat.
    last_read: Vec<u8>,
    /// A message that a repeat has displaced; it follows the repeat.
    displaced: Option<Vec<u8>>,
}

/// The memory after the registers, with its sync managers. Process data buffers belong to the gateway.
#[derive(Clone)]
pub(super) struct Buffers {
    memory: Box<[u8]>,
    sync_managers: [SyncManager; SYNC_MANAGERS],
    mailbox: MailboxBuffers,
    stops: Stops,
}

impl Buffers {
    pub(super) fn new() -> Self {
        Self {
            memory: vec![0; MEMORY_BYTES].into_boxed_slice(),
            sync_managers: [SyncManager::default(); SYNC_MANAGERS],
            mailbox: MailboxBuffers::default(),
            stops: Stops::default(),
        }
    }

    /// Begins with the firmware: earlier stops have no effect.
    pub(super) fn begin(&mut self, context: &Context<'_>) {
        self.stops = Stops::of(context);
    }

    pub(super) fn sync_managers(&self) -> &[SyncManager; SYNC_MANAGERS] {
        &self.sync_managers
    }

    pub(super) fn sync_manager_mut(&mut self, number: usize) -> &mut SyncManager {
        &mut self.sync_managers[number]
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

    /// Area at an address, and its end.
    pub(super) fn area(&self, at: usize) -> (Area, usize) {
        if at < REGISTER_BYTES {
            return (Area::Registers, REGISTER_BYTES);
        }
        if at >= MEMORY_END {
            return (Area::Nothing, usize::MAX);
        }
        let managers = self.sync_managers.iter();
        if let Some(number) = managers.clone().position(|sm| sm.contains(at)) {
            return (Area::Buffer(number), self.sync_managers[number].end());
        }
        let next = managers.filter(|sm| sm.is_enabled() && sm.start() > at).map(|sm| sm.start());
        (Area::Memory, next.min().unwrap_or(MEMORY_END).min(MEMORY_END))
    }

    /// Memory at an address after the registers; shorter at its end.
    pub(super) fn memory_at(&self, at: usize, bytes: usize) -> &[u8] {
        let from = at.saturating_sub(REGISTER_BYTES).min(MEMORY_BYTES);
        &self.memory[from..(from + bytes).min(MEMORY_BYTES)]
    }

    pub(super) fn memory_mut(&mut self, at: usize, bytes: usize) -> &mut [u8] {
        let from = at.saturating_sub(REGISTER_BYTES).min(MEMORY_BYTES);
        &mut self.memory[from..(from + bytes).min(MEMORY_BYTES)]
    }

    /// Returns whether a buffer is full. Process data buffers belong to the firmware.
    pub(super) fn buffer_is_full(&self, number: usize, context: &Context<'_>) -> bool {
        match number {
            OUTPUTS => context.gateway.outputs_full(),
            INPUTS => context.gateway.inputs_full(),
            _ => self.sync_managers.get(number).is_some_and(|sm| sm.is_full),
        }
    }

    pub(super) fn write_buffer(
        &mut self,
        number: usize,
        at: usize,
        data: &[u8],
        context: &mut Context<'_>,
    ) -> bool {
        let is_full = self.buffer_is_full(number, context);
        if number == OUTPUTS && !context.gateway.side().exchanges_process_data() {
            return false;
        }
        let sm = &mut self.sync_managers[number];
        let progress = sm.write(at - sm.start(), data.len(), is_full);
        if progress == Progress::Rejected {
            if number == OUTPUTS {
                let (side, mut firmware) = context.gateway.parts();
                side.reject_outputs(context.now, &mut firmware);
            }
            return false;
        }
        let (start, length) = (sm.start(), sm.length());
        let to = self.memory_mut(at, data.len());
        let length_in = to.len();
        to.copy_from_slice(&data[..length_in]);
        if progress == Progress::Complete {
            self.sync_managers[number].mark_full();
            match number {
                OUTPUTS => {
                    let from = start - REGISTER_BYTES;
                    let image = self.memory.get(from..from + length).unwrap_or_default();
                    let _ = context.gateway.write_outputs(context.now, image);
                }
                WRITE_MAILBOX => self.serve_mailbox(context),
                _ => {}
            }
        }
        true
    }

    pub(super) fn read_buffer(
        &mut self,
        number: usize,
        at: usize,
        out: &mut [u8],
        context: &mut Context<'_>,
    ) -> bool {
        let is_full = self.buffer_is_full(number, context);
        if number == INPUTS && !context.gateway.side().exchanges_process_data() {
            return false;
        }
        let sm = &mut self.sync_managers[number];
        let (start, length) = (sm.start(), sm.length());
        let progress = sm.read(at - start, out.len(), is_full);
        if progress == Progress::Rejected {
            if number == INPUTS {
                context.gateway.parts().1.count_rejected_read();
            }
            return false;
        }
        if number == INPUTS && at == start {
            // the image does not change until it has been read
            let image = context.gateway.side().input_image();
            let to = start - REGISTER_BYTES;
            if let Some(to) = self.memory.get_mut(to..to + length.min(image.len())) {
                to.copy_from_slice(&image[..to.len()]);
            }
        }
        let from = self.memory_at(at, out.len());
        out[..from.len()].copy_from_slice(from);
        if progress == Progress::Begun && number == INPUTS {
            context.gateway.parts().0.begin_partial_read();
        }
        if progress == Progress::Complete {
            self.sync_managers[number].mark_empty();
            match number {
                INPUTS => {
                    let (side, mut firmware) = context.gateway.ethercat(context.now);
                    side.inputs_were_read(&mut firmware);
                }
                READ_MAILBOX => self.read_mailbox_was_read(context),
                _ => {}
            }
        }
        true
    }

    /// Raises the events of buffers that the firmware has filled or emptied.
    pub(super) fn check_buffers(&mut self, context: &Context<'_>) {
        for number in [OUTPUTS, INPUTS] {
            let is_full = self.buffer_is_full(number, context);
            let sm = &mut self.sync_managers[number];
            match (sm.is_full, is_full) {
                (false, true) => sm.mark_full(),
                (true, false) => sm.mark_empty(),
                _ => {}
            }
        }
    }

    pub(super) fn serve_mailbox(&mut self, context: &mut Context<'_>) {
        let now = context.now;
        if !context.gateway.mailbox_answers(now) {
            return;
        }
        let [write_mailbox, read_mailbox] =
            [WRITE_MAILBOX, READ_MAILBOX].map(|n| self.sync_managers[n]);
        if write_mailbox.is_enabled() && write_mailbox.is_full && self.mailbox.server.has_space() {
            let request = self.memory.get(memory_range(write_mailbox)).unwrap_or_default();
            self.mailbox.server.receive(now, request, read_mailbox.length(), context.gateway);
            self.sync_managers[WRITE_MAILBOX].mark_empty();
        }
        if !read_mailbox.is_enabled() || read_mailbox.is_full {
            return;
        }
        let Self { memory, mailbox, sync_managers, .. } = self;
        let out = memory.get_mut(memory_range(read_mailbox)).unwrap_or_default();
        let is_filled = match mailbox.displaced.take() {
            Some(message) => put(&message, out),
            None => {
                mailbox.server.is_due(now, context.gateway)
                    && mailbox.server.send(now, out, context.gateway)
            }
        };
        if is_filled {
            sync_managers[READ_MAILBOX].mark_full();
        }
    }

    pub(super) fn read_mailbox_was_read(&mut self, context: &mut Context<'_>) {
        let message =
            self.memory.get(memory_range(self.sync_managers[READ_MAILBOX])).unwrap_or_default();
        self.mailbox.last_read.clear();
        self.mailbox.last_read.extend_from_slice(message);
        self.serve_mailbox(context);
    }

    /// Repeats the last message if the master requests it after a loss.
    pub(super) fn repeat_if_requested(&mut self) {
        let Self { memory, mailbox, sync_managers, .. } = self;
        let sm = &mut sync_managers[READ_MAILBOX];
        if !sm.is_enabled() || !sm.take_repeat_request() || mailbox.last_read.is_empty() {
            return;
        }
        let out = memory.get_mut(memory_range(*sm)).unwrap_or_default();
        if sm.is_full {
            mailbox.displaced = Some(out.to_vec());
        }
        if put(&mailbox.last_read, out) {
            sm.mark_full();
        }
    }
}

fn memory_range(sm: SyncManager) -> std::ops::Range<usize> {
    let start = sm.start().saturating_sub(REGISTER_BYTES);
    start..start + sm.length()
}

/// Copies a message into the read mailbox if it has the same length.
fn put(message: &[u8], out: &mut [u8]) -> bool {
    let fits = message.len() == out.len();
    if fits {
        out.copy_from_slice(message);
    }
    fits
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set_up(registers: [u8; SYNC_MANAGER_BYTES]) -> SyncManager {
        let mut sm = SyncManager::default();
        for (at, value) in registers.into_iter().enumerate() {
            sm.write_register(at, value);
        }
        sm
    }

    #[test]
    fn single_buffer_is_written_from_its_first_byte_to_its_last() {
        let mut sm = set_up([0x00, 0x11, 0x80, 0x01, 0x66, 0, 1, 0]);
        assert!(sm.contains(0x1100) && sm.contains(0x127F) && !sm.contains(0x1280));
        assert_eq!(sm.write(1, 10, false), Progress::Rejected, "not begun");
        assert_eq!(sm.write(0, 0x100, false), Progress::Begun);
        assert_eq!(sm.write(0x100, 0x80, false), Progress::Complete);
        assert_eq!(sm.write(0, 0x180, true), Progress::Rejected, "full");
        assert_eq!(sm.read(0, 0x180, true), Progress::Rejected, "the other direction");
        assert_eq!(sm.write(0, 0x180, false), Progress::Complete);
    }

    #[test]
    fn buffer_to_be_read_has_to_be_full() {
        let mut sm = set_up([0x00, 0x1D, 0x80, 0x00, 0x22, 0, 1, 0]);
        assert_eq!(sm.read(0, 0x80, false), Progress::Rejected);
        sm.mark_full();
        assert!(sm.has_event() && !sm.has_device_event());
        assert_eq!(sm.register(5, sm.is_full), STATUS_WRITTEN | STATUS_FULL);
        assert_eq!(sm.read(0, 0x40, true), Progress::Begun);
        assert_eq!(sm.read(0x40, 0x40, true), Progress::Complete);
        sm.mark_empty();
        assert_eq!(sm.register(5, sm.is_full), STATUS_READ);
    }

    #[test]
    fn switched_off_gateway_can_be_configured() {
        let mut sm = set_up([0x00, 0x10, 0x80, 0x00, 0x26, 0, 1, 0]);
        sm.write_register(0, 0x55);
        assert_eq!(sm.start(), 0x1000, "it is on");
        sm.write_register(6, 0);
        sm.write_register(0, 0x80);
        assert_eq!((sm.start(), sm.is_enabled()), (0x1080, false));
        assert!(!sm.write_register(5, 0xFF) && !sm.write_register(7, 0xFF), "read only");
    }

    #[test]
    fn repeat_is_asked_for_by_a_change() {
        let mut sm = set_up([0x80, 0x10, 0x80, 0x00, 0x22, 0, 1, 0]);
        assert!(!sm.take_repeat_request());
        sm.write_register(6, 3);
        assert!(sm.take_repeat_request() && !sm.take_repeat_request());
        assert_eq!(sm.register(7, false), 2);
        sm.write_register(6, 1);
        assert!(sm.take_repeat_request());
    }

    fn fmmu(registers: [u8; FMMU_BYTES]) -> Fmmu {
        Fmmu::from_registers(&registers).unwrap()
    }

    #[test]
    fn byte_mapping_is_cut_to_the_datagram() {
        let bytes = fmmu([0, 0x10, 0, 0, 0x80, 1, 0, 7, 0x00, 0x11, 0, 2, 1, 0, 0, 0]);
        assert!(bytes.writes && !bytes.reads);
        let whole = Part::Bytes { at: 0, length: 0x180, physical: 0x1100 };
        assert_eq!(bytes.part(0x1000, 0x180), Some(whole));
        let first = Part::Bytes { at: 16, length: 84, physical: 0x1100 };
        assert_eq!(bytes.part(0x0FF0, 100), Some(first));
        let last = Part::Bytes { at: 0, length: 0x80, physical: 0x1200 };
        assert_eq!(bytes.part(0x1100, 1000), Some(last));
        assert_eq!(bytes.part(0x1180, 10), None);
        assert_eq!(bytes.part(0x0F00, 0x100), None);
        assert_eq!(Fmmu::from_registers(&[0; FMMU_BYTES]), None);
    }

    #[test]
    fn bits_keep_their_order_across_byte_borders() {
        // Logical 5.3 to 6.2 (eight bits) are physical 0x1000.6 to 0x1001.5.
        let bits = fmmu([5, 0, 0, 0, 2, 0, 3, 2, 0, 0x10, 6, 1, 1, 0, 0, 0]);
        let part = bits.part(4, 4).unwrap();
        assert_eq!(part, Part::Bits { at: 11, length: 8, physical: 0x8006 });
        // Only the second byte.
        assert_eq!(bits.part(6, 1), Some(Part::Bits { at: 0, length: 3, physical: 0x8006 + 5 }));
        let memory = [0b1100_0000, 0b0010_1010];
        let mut data = [0xFF; 4];
        copy_bits(&memory, 6, &mut data, 11, 8);
        assert_eq!(data, [0xFF, 0b0101_1111, 0b1111_1101, 0xFF]);
    }
}
