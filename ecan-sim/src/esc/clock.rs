//! Registers of the distributed clock: receive times, system time, control, Sync0.
//!
//! The clock itself belongs to the gateway: local time is system time without the offset that the
//! master wrote, so the control loop affects both.

use super::Context;
use crate::gateway::{Gateway, Sync0};

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
