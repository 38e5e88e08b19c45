//! Effect of register writes on an MCAN controller (manual 13.6), by the rules of the Bosch M_CAN
//! core.
//!
//! CCCR.INIT takes the controller off its bus; its unsent frames wait. CCCR.CCE, writable only
//! then, unlocks the protected registers and empties FIFOs and queue. Otherwise a write to a
//! protected register has no effect, as on the chip. Clearing INIT returns the controller to the
//! bus with the changed bit timing, delay compensation, modes and global filters. A controller that
//! was never applied has no Message RAM and stays in INIT. These are stored and read back without
//! effect: interrupt enables and lines, the RAM watchdog, the other bits of CCCR, and the
//! acknowledge of transmit events, which the firmware takes at once. An add request has no effect,
//! because the firmware requests each frame itself.

use std::collections::BTreeMap;

use ecan_protocol::can::Phase;
use ecan_protocol::config::NonMatch;

use crate::bus::StationMode;

use super::registers::{TEST_LOOPBACK, cccr, written_timing};
use super::{CanController, offset};

const DBTP_DELAY_COMPENSATION: u32 = 1 << 23;

/// Registers that keep a written value: offset, writable bits, and whether the register is protected.
const STORED: [(u16, u32, bool); 13] = [
    (offset::DBTP, 0x009F_1FFF, true),
    (offset::TEST, 0x70, true),
    (offset::RWD, 0xFF, true),
    (offset::NBTP, 0xFFFF_FF7F, true),
    (offset::TDCR, 0x7F7F, true),
    (offset::IE, 0x3FFF_FFFF, false),
    (offset::ILS, 0x3FFF_FFFF, false),
    (offset::ILE, 3, false),
    (offset::GFC, 0x3F, true),
    (offset::XIDAM, 0x1FFF_FFFF, true),
    (offset::RXF0A, 0x3F, false),
    (offset::RXF1A, 0x3F, false),
    (offset::TXEFA, 0x1F, false),
];

/// Written register values since the last restart that the configuration does not contain.
#[derive(Clone, Debug, Default)]
pub(super) struct WrittenRegisters {
    pub(super) is_stopped: bool,
    pub(super) may_change: bool,
    /// By offset; CCCR without INIT and CCE.
    pub(super) values: BTreeMap<u16, u32>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct FramesDropped {
    pub(in crate::gateway) transmit: usize,
    pub(in crate::gateway) receive: usize,
}

impl CanController {
    /// Whether a write to this register has no effect now.
    pub(in crate::gateway) fn is_locked(&self, offset: u16) -> bool {
        let stored = STORED.iter().find(|(at, ..)| *at == offset);
        let is_test_locked = offset == offset::TEST && self.control_register() & cccr::TEST == 0;
        stored.is_some_and(|(.., is_protected)| *is_protected)
            && (!self.written.may_change || is_test_locked)
    }

    /// Writes a register of the whitelist; `clock_hz` is the controller's source clock.
    pub(in crate::gateway) fn write_register(
        &mut self,
        offset: u16,
        value: u32,
        clock_hz: u32,
    ) -> FramesDropped {
        let mut dropped = FramesDropped::default();
        match offset {
            offset::CCCR => return self.write_control(value),
            offset::IR => self.interrupts &= !value,
            // one bit per element; the model cancels all of them or none
            offset::TXBCR if value != 0 => dropped.transmit = self.flush_transmit(),
            _ => {}
        }
        let Some(&(_, bits, _)) = STORED.iter().find(|(at, ..)| *at == offset) else {
            return dropped;
        };
        if self.is_locked(offset) {
            return dropped;
        }
        let value = value & bits;
        self.written.values.insert(offset, value);
        match offset {
            offset::RXF0A | offset::RXF1A => {
                let number = usize::from(offset == offset::RXF1A);
                dropped.receive = self.fifos[number].acknowledge(value, self.fifo_size(number));
            }
            offset::TEST => self.take_modes_over(),
            _ => self.configure(offset, value, clock_hz),
        }
        dropped
    }

    fn write_control(&mut self, value: u32) -> FramesDropped {
        let mut dropped = FramesDropped::default();
        let (init, cce) = (value & cccr::INIT != 0, value & cccr::CCE != 0);
        if self.written.may_change {
            self.change_modes(value);
        }
        let was_stopped = self.is_stopped();
        if !init && self.is_bus_off() {
            self.request_recovery();
        }
        if init != self.written.is_stopped {
            self.written.is_stopped = init;
            self.generation = self.generation.wrapping_add(1);
            // the frame in arbitration must be sent again
            if let Some(frame) = self.in_flight.take() {
                self.transmit.push_front(frame);
            }
        }
        // CCE can be set after INIT, and is cleared with it
        let may_change = cce && was_stopped && self.is_stopped();
        if may_change && !self.written.may_change {
            dropped.transmit = self.flush_transmit();
            dropped.receive = self.flush_received();
            self.high_priority = 0;
            self.tx_get_index = 0;
            self.tx_put_index = 0;
        }
        self.written.may_change = may_change;
        dropped
    }

    fn change_modes(&mut self, value: u32) {
        let control =
            value & (cccr::MON | cccr::DAR | cccr::TEST | cccr::FDOE | cccr::BRSE | cccr::KEPT);
        if control & cccr::TEST == 0 {
            self.written.values.insert(offset::TEST, 0);
        }
        self.written.values.insert(offset::CCCR, control);
        self.take_modes_over();
    }

    /// Sets the station mode from CCCR and TEST.
    fn take_modes_over(&mut self) {
        let control = self.control_register();
        let loopback = self.test_register() & TEST_LOOPBACK != 0;
        let Some(config) = &mut self.config else {
            return;
        };
        let monitoring = control & cccr::MON != 0;
        config.station.mode = match (control & cccr::TEST != 0 && loopback, monitoring) {
            (true, true) => StationMode::InternalLoopback,
            (true, false) => StationMode::ExternalLoopback,
            (false, true) => StationMode::Listen,
            (false, false) => StationMode::Normal,
        };
        config.station.auto_retransmit = control & cccr::DAR == 0;
        config.station.fd = control & cccr::FDOE != 0;
    }

    /// Puts the value of a protected register into effect.
    fn configure(&mut self, offset: u16, value: u32, clock_hz: u32) {
        let Some(config) = &mut self.config else {
            return;
        };
        match offset {
            offset::NBTP => {
                let timing = written_timing(Phase::Nominal, value);
                config.timing.0 = timing;
                config.station.nominal_bitrate = timing.bitrate(clock_hz);
                if config.timing.1.is_none() {
                    config.station.data_bitrate = config.station.nominal_bitrate;
                }
            }
            offset::DBTP => {
                let timing = written_timing(Phase::Data, value);
                config.timing.1 = Some(timing);
                config.station.data_bitrate = timing.bitrate(clock_hz);
                let tdc = config.tdc.unwrap_or_default();
                config.tdc = (value & DBTP_DELAY_COMPENSATION != 0).then_some(tdc);
            }
            offset::TDCR => {
                let [filter, offset, ..] = value.to_le_bytes();
                config.tdc = config.tdc.map(|_| (offset, filter));
            }
            offset::GFC => {
                let rule = |shift: u32| NonMatch::from_raw((value >> shift & 3) as u8);
                let filters = &mut config.filters;
                filters.reject_remote_extended = value & 1 != 0;
                filters.reject_remote_standard = value & 2 != 0;
                filters.non_match_extended = rule(2).unwrap_or(filters.non_match_extended);
                filters.non_match_standard = rule(4).unwrap_or(filters.non_match_standard);
            }
            offset::XIDAM => config.filters.extended_mask = value,
            _ => {}
        }
    }
}
