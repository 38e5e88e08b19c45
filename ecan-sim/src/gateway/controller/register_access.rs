//! Reads and writes of the registers of an MCAN controller, in the layout and by the rules of the Bosch M_CAN
//! core; the manual names the registers but not their bits (manual 13.5, 13.6).
//!
//! CCCR.INIT takes the controller off its bus; its unsent frames wait. CCCR.CCE, writable only
//! then, unlocks the protected registers and empties FIFOs and queue. Otherwise a write to a
//! protected register has no effect, as on the chip. Clearing INIT returns the controller to the
//! bus with the changed bit timing, delay compensation, modes and global filters. A controller that
//! was never applied has no Message RAM and stays in INIT. These are stored and read back without
//! effect: interrupt enables and lines, the RAM watchdog, the other bits of CCCR, and the
//! acknowledge of transmit events, which the firmware takes at once. An add request has no effect,
//! because the firmware requests each frame itself.

use ecan_protocol::can::Phase;
use ecan_protocol::config::NonMatch;

use super::{CanController, ErrorCodes};
use crate::bus::{ErrorState, StationMode};
use crate::gateway::mcan_registers::{
    FramesDropped, TEST_LOOPBACK, cccr, offset, timing_register, written_timing,
};

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

impl CanController {
    /// Value of a register; 0 for one that the model does not have. Reading PSR and ECR clears the last
    /// error codes and the error logging.
    pub(in crate::gateway) fn read_register(&mut self, offset: u16) -> u32 {
        let value = match (offset, self.written.values.get(&offset)) {
            (offset::CCCR, _) => self.control_register(),
            (offset::TEST, _) => self.test_register(),
            (_, Some(value)) => *value,
            (_, None) => self.unwritten_register(offset),
        };
        match offset {
            offset::ECR => self.errors.logged = 0,
            offset::PSR => {
                self.errors = ErrorCodes { logged: self.errors.logged, ..ErrorCodes::default() };
            }
            _ => {}
        }
        value
    }

    fn unwritten_register(&self, offset: u16) -> u32 {
        let config = self.config.as_ref();
        match offset {
            offset::ENDIAN => 0x8765_4321,
            // transmit errors, receive errors, receive error passive, error logging
            offset::ECR => {
                let [tec, rec] = <[u16; 2]>::from(self.error_counters).map(u32::from);
                tec.min(0xFF)
                    | rec.min(0x7F) << 8
                    | u32::from(rec >= 128) << 15
                    | u32::from(self.errors.logged) << 16
            }
            offset::PSR => self.protocol_status(),
            offset::IR => self.interrupts,
            offset::RXF0S => self.fifos[0].status(self.fifo_size(0)),
            offset::RXF1S => self.fifos[1].status(self.fifo_size(1)),
            // free level, get index, put index, full
            offset::TXFQS => {
                let free = self.transmit_elements().saturating_sub(self.transmit_waiting()) as u32;
                free | self.tx_get_index << 8
                    | self.tx_put_index << 16
                    | u32::from(self.is_transmit_full()) << 21
            }
            // always empty, because the firmware takes each event at once
            offset::TXEFS => 0,
            offset::HPMS => self.high_priority,
            offset::NBTP => config
                .map_or(0x0600_0A03, |config| timing_register(Phase::Nominal, config.timing.0)),
            // bit 23 enables the delay compensation
            offset::DBTP => config.map_or(0x0000_0A33, |config| {
                let timing = config.timing.1;
                timing.map_or(0x0000_0A33, |timing| timing_register(Phase::Data, timing))
                    | u32::from(config.tdc.is_some()) << 23
            }),
            // filter window and offset; an automatic offset is computed
            offset::TDCR => match config.map(|config| (config.tdc, config.timing.1)) {
                Some((Some((offset, filter)), Some(timing))) => {
                    let automatic = || timing.automatic_tdc_offset().unwrap_or(0);
                    let offset = if offset == 0 { automatic() } else { offset };
                    u32::from(filter) | u32::from(offset) << 8
                }
                _ => 0,
            },
            // remote rules and non-match rules
            offset::GFC => config.map_or(0, |config| {
                let filters = &config.filters;
                u32::from(filters.reject_remote_extended)
                    | u32::from(filters.reject_remote_standard) << 1
                    | u32::from(filters.non_match_extended.raw()) << 2
                    | u32::from(filters.non_match_standard.raw()) << 4
            }),
            offset::XIDAM => config.map_or(0x1FFF_FFFF, |config| config.filters.extended_mask),
            _ => 0,
        }
    }

    /// PSR: last error code, activity, error passive, warning, bus-off, last error code of the data phase,
    /// secondary sample point.
    fn protocol_status(&self) -> u32 {
        let activity = match &self.config {
            None => 0,
            Some(_) if self.in_flight.is_some() => 3,
            Some(_) => 1,
        };
        let (passive, warning, bus_off) = match self.error_state {
            ErrorState::Active => (0, 0, 0),
            ErrorState::Warning => (0, 1, 0),
            ErrorState::Passive => (1, 1, 0),
            ErrorState::BusOff => (1, 1, 1),
        };
        self.errors.arbitration
            | activity << 3
            | passive << 5
            | warning << 6
            | bus_off << 7
            | self.errors.data << 8
            | self.secondary_sample_point() << 16
    }

    /// CCCR: initialisation while stopped or bus-off, configuration change, modes.
    pub(super) fn control_register(&self) -> u32 {
        let init = u32::from(self.is_stopped() || self.is_bus_off());
        let change = if self.written.may_change { cccr::CCE } else { 0 };
        let modes = self.written.values.get(&offset::CCCR).copied();
        init | change | modes.unwrap_or_else(|| self.configured_modes())
    }

    fn configured_modes(&self) -> u32 {
        let Some(station) = self.config.as_ref().map(|config| config.station) else {
            return 0;
        };
        let bit = |on: bool, mask: u32| if on { mask } else { 0 };
        let monitors = matches!(station.mode, StationMode::Listen | StationMode::InternalLoopback);
        bit(monitors, cccr::MON)
            | bit(!station.auto_retransmit, cccr::DAR)
            | bit(is_loopback(station.mode), cccr::TEST)
            | bit(station.fd, cccr::FDOE | cccr::BRSE)
    }

    /// TEST: loopback, and the level of the receive pin, recessive.
    pub(super) fn test_register(&self) -> u32 {
        const RECEIVE_PIN: u32 = 1 << 7;
        let configured = || match &self.config {
            Some(config) if is_loopback(config.station.mode) => TEST_LOOPBACK,
            _ => 0,
        };
        RECEIVE_PIN | self.written.values.get(&offset::TEST).copied().unwrap_or_else(configured)
    }

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

fn is_loopback(mode: StationMode) -> bool {
    matches!(mode, StationMode::InternalLoopback | StationMode::ExternalLoopback)
}
