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

use ecan_protocol::can::{BitTiming, Phase};
use ecan_protocol::config::NonMatch;

use crate::bus::StationMode;

use super::{Controller, offset};

pub(super) mod cccr {
    pub(in super::super) const INIT: u32 = 1 << 0;
    pub(in super::super) const CCE: u32 = 1 << 1;
    pub(in super::super) const MON: u32 = 1 << 5;
    pub(in super::super) const DAR: u32 = 1 << 6;
    pub(in super::super) const TEST: u32 = 1 << 7;
    pub(in super::super) const FDOE: u32 = 1 << 8;
    pub(in super::super) const BRSE: u32 = 1 << 9;
    /// ASM, and the bits above the bit rate switch.
    pub(in super::super) const KEPT: u32 = 1 << 2 | 0xFC00;
}

pub(super) const TEST_LOOPBACK: u32 = 1 << 4;
const TEST_BITS: u32 = 0x70;
const RAM_WATCHDOG_BITS: u32 = 0xFF;
const INTERRUPT_BITS: u32 = 0x3FFF_FFFF;
const LINE_ENABLE_BITS: u32 = 3;
const DBTP_DELAY_COMPENSATION: u32 = 1 << 23;

/// Written register values since the last restart that the configuration does not contain.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WrittenRegisters {
    pub(super) is_stopped: bool,
    pub(super) may_change: bool,
    /// CCCR without INIT and CCE.
    pub(super) control: Option<u32>,
    pub(super) data_timing: Option<u32>,
    pub(super) nominal_timing: Option<u32>,
    pub(super) delay_compensation: Option<u32>,
    pub(super) filter: Option<u32>,
    pub(super) extended_mask: Option<u32>,
    pub(super) test: Option<u32>,
    pub(super) ram_watchdog: u32,
    pub(super) interrupt_enable: u32,
    pub(super) line_select: u32,
    pub(super) line_enable: u32,
    pub(super) fifo0_acknowledge: u32,
    pub(super) fifo1_acknowledge: u32,
    pub(super) event_acknowledge: u32,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct FramesDropped {
    pub(in crate::gateway) transmit: usize,
    pub(in crate::gateway) receive: usize,
}

impl Controller {
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
            offset::IE => self.written.interrupt_enable = value & INTERRUPT_BITS,
            offset::ILS => self.written.line_select = value & INTERRUPT_BITS,
            offset::ILE => self.written.line_enable = value & LINE_ENABLE_BITS,
            offset::RXF0A => {
                self.written.fifo0_acknowledge = value & 0x3F;
                dropped.receive = self.fifo0.acknowledge(value & 0x3F, self.fifo_sizes().0);
            }
            offset::RXF1A => {
                self.written.fifo1_acknowledge = value & 0x3F;
                dropped.receive = self.fifo1.acknowledge(value & 0x3F, self.fifo_sizes().1);
            }
            offset::TXEFA => self.written.event_acknowledge = value & 0x1F,
            // one bit per element; the model cancels all of them or none
            offset::TXBCR if value != 0 => dropped.transmit = self.flush_transmit(),
            _ if self.written.may_change => self.write_protected(offset, value, clock_hz),
            _ => {}
        }
        dropped
    }

    fn fifo_sizes(&self) -> (u8, u8) {
        let ram = self.config.as_ref().map(|config| config.ram);
        ram.map_or((0, 0), |ram| (ram.rx_fifo0.size, ram.rx_fifo1.size))
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
            self.written.test = Some(0);
        }
        self.written.control = Some(control);
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

    fn write_protected(&mut self, offset: u16, value: u32, clock_hz: u32) {
        let written = &mut self.written;
        match offset {
            offset::DBTP => written.data_timing = Some(value & 0x009F_1FFF),
            offset::NBTP => written.nominal_timing = Some(value & 0xFFFF_FF7F),
            offset::TDCR => written.delay_compensation = Some(value & 0x7F7F),
            offset::GFC => written.filter = Some(value & 0x3F),
            offset::XIDAM => written.extended_mask = Some(value & 0x1FFF_FFFF),
            offset::RWD => written.ram_watchdog = value & RAM_WATCHDOG_BITS,
            offset::TEST => {
                if self.control_register() & cccr::TEST != 0 {
                    self.written.test = Some(value & TEST_BITS);
                    self.take_modes_over();
                }
                return;
            }
            _ => return,
        }
        let Some(config) = &mut self.config else {
            return;
        };
        match offset {
            offset::NBTP => {
                let timing = nominal_timing(value);
                config.timing.0 = timing;
                config.station.nominal_bitrate = timing.bitrate(clock_hz);
                if config.timing.1.is_none() {
                    config.station.data_bitrate = config.station.nominal_bitrate;
                }
            }
            offset::DBTP => {
                let timing = data_timing(value);
                config.timing.1 = Some(timing);
                config.station.data_bitrate = timing.bitrate(clock_hz);
                let tdc = config.tdc.unwrap_or_default();
                config.tdc = (value & DBTP_DELAY_COMPENSATION != 0).then_some(tdc);
            }
            offset::TDCR => {
                let [filter, offset, ..] = (value & 0x7F7F).to_le_bytes();
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
            offset::XIDAM => config.filters.extended_mask = value & 0x1FFF_FFFF,
            _ => {}
        }
    }
}

fn nominal_timing(value: u32) -> BitTiming {
    let field = |shift: u32, bits: u32| 1 + (value >> shift & ((1 << bits) - 1)) as u16;
    clamp(
        Phase::Nominal,
        BitTiming { sjw: field(25, 7), brp: field(16, 9), tseg1: field(8, 8), tseg2: field(0, 7) },
    )
}

fn data_timing(value: u32) -> BitTiming {
    let field = |shift: u32, bits: u32| 1 + (value >> shift & ((1 << bits) - 1)) as u16;
    clamp(
        Phase::Data,
        BitTiming { brp: field(16, 5), tseg1: field(8, 5), tseg2: field(4, 4), sjw: field(0, 4) },
    )
}

/// Raises segments to the shortest that the core supports.
fn clamp(phase: Phase, timing: BitTiming) -> BitTiming {
    let limits = phase.limits();
    BitTiming {
        tseg1: timing.tseg1.max(limits.tseg1.0),
        tseg2: timing.tseg2.max(limits.tseg2.0),
        ..timing
    }
}
