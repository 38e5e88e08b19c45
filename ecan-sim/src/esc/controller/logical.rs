//! Logical datagrams: mapping by FMMUs.

use super::super::Context;
use super::super::frame::Datagram;
use super::registers::REGISTER_BYTES;
use super::{Access, Controller, DATAGRAM_BYTES};
use crate::esc::sync_manager::{Part, copy_bits};

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
        let mut is_done = [false; 2];
        for (is_write, is_done) in [true, false].into_iter().zip(&mut is_done) {
            for fmmu in self.fmmus.into_iter().flatten() {
                let maps = match is_write {
                    true => fmmu.writes && access.writes(),
                    false => fmmu.reads && access.reads(),
                };
                if let Some(part) = fmmu.part(logical, bytes).filter(|_| maps) {
                    *is_done |= self.map_part(part, is_write, datagram.data(), context);
                }
            }
        }
        let [is_written, is_read] = is_done;
        let weight = if access == Access::Exchange { 2 } else { 1 };
        datagram.count(u16::from(is_read) + if is_written { weight } else { 0 });
    }

    fn map_part(
        &mut self,
        part: Part,
        is_write: bool,
        data: &mut [u8],
        context: &mut Context<'_>,
    ) -> bool {
        let (at, length, physical) = match part {
            Part::Bytes { at, length, physical } => {
                let bytes = data.get_mut(at..at + length).unwrap_or_default();
                return match is_write {
                    true => self.write(physical, bytes, context),
                    false => self.read(physical, bytes, context),
                };
            }
            Part::Bits { at, length, physical } => (at, length, physical),
        };
        let (first, bytes) = byte_range(physical, length);
        let Ok(address) = u16::try_from(first) else { return false };
        let mut scratch = std::mem::take(&mut self.scratch);
        let own = &mut scratch[..bytes.min(DATAGRAM_BYTES)];
        let is_done = if is_write {
            // the other bits keep their value
            let stored = if first < REGISTER_BYTES {
                self.registers.get(first..first + own.len()).unwrap_or_default()
            } else {
                self.memory_at(first, own.len())
            };
            own[..stored.len()].copy_from_slice(stored);
            copy_bits(data, at, own, physical % 8, length);
            self.write(address, own, context)
        } else {
            let is_read = self.read(address, own, context);
            if is_read {
                copy_bits(own, physical % 8, data, at, length);
            }
            is_read
        };
        self.scratch = scratch;
        is_done
    }
}

/// First byte of a bit range, and number of bytes.
fn byte_range(first_bit: usize, bits: usize) -> (usize, usize) {
    let first = first_bit / 8;
    (first, (first_bit + bits).div_ceil(8) - first)
}
