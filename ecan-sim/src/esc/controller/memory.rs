//! Accesses to the address space of a slave controller: registers, sync manager buffers, and plain
//! memory. An access counts if any byte of it was accepted.

use std::ops::Range;

use super::super::Context;
use super::super::sync_manager::Progress;
use super::Controller;
use super::registers::REGISTER_BYTES;

const MEMORY_END: usize = REGISTER_BYTES + 0x2000;
pub(super) const MEMORY_BYTES: usize = MEMORY_END - REGISTER_BYTES;

pub(super) const WRITE_MAILBOX: usize = 0;
pub(super) const READ_MAILBOX: usize = 1;
pub(super) const OUTPUTS: usize = 2;
pub(super) const INPUTS: usize = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Area {
    Registers,
    Buffer(usize),
    Memory,
    Nothing,
}

impl Controller {
    /// Area at an address, and its end.
    fn area(&self, at: usize) -> (Area, usize) {
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

    /// Passes each area of an access to `part`, with its address and its range in the data.
    fn visit(
        &mut self,
        at: u16,
        bytes: usize,
        mut part: impl FnMut(&mut Self, Area, usize, Range<usize>) -> bool,
    ) -> bool {
        let (mut done, mut is_accepted) = (0, false);
        while done < bytes {
            let at = usize::from(at) + done;
            let (area, end) = self.area(at);
            let length = (end - at).min(bytes - done);
            is_accepted |= part(self, area, at, done..done + length);
            done += length;
        }
        is_accepted
    }

    /// Reads for the master. A rejected part leaves `out` unchanged.
    pub(super) fn read(&mut self, at: u16, out: &mut [u8], context: &mut Context<'_>) -> bool {
        self.visit(at, out.len(), |this, area, at, range| {
            let part = &mut out[range];
            match area {
                Area::Registers => this.read_registers(at, part, context),
                Area::Buffer(number) => return this.read_buffer(number, at, part, context),
                Area::Memory => part.copy_from_slice(this.memory_at(at, part.len())),
                Area::Nothing => return false,
            }
            true
        })
    }

    pub(super) fn write(&mut self, at: u16, data: &[u8], context: &mut Context<'_>) -> bool {
        self.visit(at, data.len(), |this, area, at, range| {
            let part = &data[range];
            match area {
                Area::Registers => this.write_registers(at, part, context),
                Area::Buffer(number) => this.write_buffer(number, at, part, context),
                Area::Memory => {
                    this.memory_mut(at, part.len()).copy_from_slice(part);
                    true
                }
                Area::Nothing => false,
            }
        })
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

    fn write_buffer(
        &mut self,
        number: usize,
        at: usize,
        data: &[u8],
        context: &mut Context<'_>,
    ) -> bool {
        let is_full = self.buffer_is_full(number, context);
        if number == OUTPUTS && !context.gateway.exchanges_process_data() {
            return false;
        }
        let sm = &mut self.sync_managers[number];
        let progress = sm.write(at - sm.start(), data.len(), is_full);
        if progress == Progress::Rejected {
            if number == OUTPUTS {
                context.gateway.reject_outputs(context.now);
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

    fn read_buffer(
        &mut self,
        number: usize,
        at: usize,
        out: &mut [u8],
        context: &mut Context<'_>,
    ) -> bool {
        let is_full = self.buffer_is_full(number, context);
        if number == INPUTS && !context.gateway.exchanges_process_data() {
            return false;
        }
        let sm = &mut self.sync_managers[number];
        let (start, length) = (sm.start(), sm.length());
        let progress = sm.read(at - start, out.len(), is_full);
        if progress == Progress::Rejected {
            if number == INPUTS {
                context.gateway.count_rejected_read();
            }
            return false;
        }
        if number == INPUTS && at == start {
            // the image does not change until it has been read
            let image = context.gateway.input_image();
            let to = start - REGISTER_BYTES;
            if let Some(to) = self.memory.get_mut(to..to + length.min(image.len())) {
                to.copy_from_slice(&image[..to.len()]);
            }
        }
        let from = self.memory_at(at, out.len());
        out[..from.len()].copy_from_slice(from);
        if progress == Progress::Begun && number == INPUTS {
            context.gateway.begin_partial_read();
        }
        if progress == Progress::Complete {
            self.sync_managers[number].mark_empty();
            match number {
                INPUTS => context.gateway.inputs_were_read(context.now),
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
}
