//! Logical datagrams: mapping by FMMUs.

use super::super::Context;
use super::super::fmmu::{Part, copy_bits};
use super::super::frame::Datagram;
use super::registers::REGISTER_BYTES;
use super::{Access, Controller, DATAGRAM_BYTES};

impl Controller {
    /// Processes a logical datagram. The received data is written before the inputs of this slave
    /// are inserted.
    pub(super) fn map(
        &mut self,
        access: Access,
        datagram: &mut Datagram<'_>,
        context: &mut Context<'_>,
    ) {
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
                // the other bits keep their value
                let stored = if first < REGISTER_BYTES {
                    self.registers.get(first..first + own.len()).unwrap_or_default()
                } else {
                    self.memory_at(first, own.len())
                };
                own[..stored.len()].copy_from_slice(stored);
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
}

/// First byte of a bit range, and number of bytes.
fn byte_range(first_bit: usize, bits: usize) -> (usize, usize) {
    let first = first_bit / 8;
    (first, (first_bit + bits).div_ceil(8) - first)
}
