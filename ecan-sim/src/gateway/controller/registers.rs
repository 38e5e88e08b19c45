//! Status and configuration registers of an MCAN controller, in the layout of the Bosch M_CAN core;
//! the manual names them but not their bits (manual 13.5, 13.6).

use ecan_protocol::can::{BitTiming, Phase};

use crate::bus::{ErrorState, StationMode};

use super::{CanController, ErrorCodes, offset};

/// Registers at 0x9000:1 to :8.
pub(in crate::gateway) const STATUS_REGISTERS: [u16; 8] = [
    offset::ECR,
    offset::PSR,
    offset::IR,
    offset::RXF0S,
    offset::RXF1S,
    offset::TXFQS,
    offset::TXEFS,
    offset::HPMS,
];

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
}

fn is_loopback(mode: StationMode) -> bool {
    matches!(mode, StationMode::InternalLoopback | StationMode::ExternalLoopback)
}

/// Shift and number of bits of BRP, TSEG1, TSEG2 and SJW in NBTP or DBTP, which hold values less one.
fn timing_fields(phase: Phase) -> [(u32, u32); 4] {
    match phase {
        Phase::Nominal => [(16, 9), (8, 8), (0, 7), (25, 7)],
        Phase::Data => [(16, 5), (8, 5), (4, 4), (0, 4)],
    }
}

fn timing_register(phase: Phase, timing: BitTiming) -> u32 {
    let values = [timing.brp, timing.tseg1, timing.tseg2, timing.sjw];
    let fields = values.into_iter().zip(timing_fields(phase));
    fields.fold(0, |word, (value, (shift, _))| word | u32::from(value.saturating_sub(1)) << shift)
}

/// Timing of a written NBTP or DBTP; segments are raised to the shortest that the core supports.
pub(super) fn written_timing(phase: Phase, word: u32) -> BitTiming {
    let [brp, tseg1, tseg2, sjw] =
        timing_fields(phase).map(|(shift, bits)| 1 + (word >> shift & ((1 << bits) - 1)) as u16);
    let limits = phase.limits();
    BitTiming { brp, tseg1: tseg1.max(limits.tseg1.0), tseg2: tseg2.max(limits.tseg2.0), sjw }
}
