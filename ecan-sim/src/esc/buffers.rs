//! Memory of a slave controller with the buffers of its sync managers: process data and mailboxes.

use super::Context;
use super::sync_manager::{Progress, SYNC_MANAGERS, SyncManager};
use crate::mailbox::MailboxServer;

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
