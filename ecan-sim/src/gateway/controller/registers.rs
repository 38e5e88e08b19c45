//! Status and configuration registers of an MCAN controller, in the layout of the Bosch M_CAN core;
//! the manual names them but not their bits (manual 13.5, 13.6).

use ecan_protocol::can::{BitTiming, Phase};

use crate::bus::{ErrorState, StationMode};

use super::register_writes::{TEST_LOOPBACK, cccr};
use super::{Controller, offset};

impl Controller {
    /// ECR: transmit errors, receive errors, receive error passive.
    pub(in crate::gateway) fn error_counter_register(&self) -> u32 {
        let (tec, rec) = (u32::from(self.error_counters.0), u32::from(self.error_counters.1));
        tec.min(0xFF) | rec.min(0x7F) << 8 | u32::from(rec >= 128) << 15
    }

    /// PSR: last error code "no change", activity, error passive, warning, bus-off.
    pub(in crate::gateway) fn protocol_status_register(&self) -> u32 {
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
        7 | activity << 3 | passive << 5 | warning << 6 | bus_off << 7 | 7 << 8
    }

    pub(in crate::gateway) fn interrupt_register(&self) -> u32 {
        self.interrupts
    }

    pub(in crate::gateway) fn fifo0_register(&self) -> u32 {
        let size = self.config.as_ref().map_or(0, |config| config.ram.rx_fifo0.size);
        self.fifo0.status(size)
    }

    pub(in crate::gateway) fn fifo1_register(&self) -> u32 {
        let size = self.config.as_ref().map_or(0, |config| config.ram.rx_fifo1.size);
        self.fifo1.status(size)
    }

    /// TXFQS: free level, get index, put index, full.
    pub(in crate::gateway) fn transmit_register(&self) -> u32 {
        let free = self.transmit_elements().saturating_sub(self.transmit_waiting()) as u32;
        free | self.tx_get_index << 8
            | self.tx_put_index << 16
            | u32::from(self.is_transmit_full()) << 21
    }

    /// TXEFS: always empty, because the firmware takes each event at once.
    pub(in crate::gateway) fn event_register(&self) -> u32 {
        0
    }

    pub(in crate::gateway) fn high_priority_register(&self) -> u32 {
        self.high_priority
    }

    /// CCCR: initialisation while stopped or bus-off, configuration change, modes.
    pub(in crate::gateway) fn control_register(&self) -> u32 {
        let init = u32::from(self.is_stopped() || self.is_bus_off());
        let change = if self.written.may_change { cccr::CCE } else { 0 };
        init | change | self.written.control.unwrap_or_else(|| self.configured_modes())
    }

    fn configured_modes(&self) -> u32 {
        let Some(station) = self.config().map(|config| config.station) else {
            return 0;
        };
        let monitoring = station.mode == StationMode::Listen;
        let loopback =
            matches!(station.mode, StationMode::InternalLoopback | StationMode::ExternalLoopback);
        let bit = |on: bool, mask: u32| if on { mask } else { 0 };
        bit(monitoring, cccr::MON)
            | bit(!station.auto_retransmit, cccr::DAR)
            | bit(loopback, cccr::TEST)
            | bit(station.fd, cccr::FDOE | cccr::BRSE)
    }

    /// TEST: loopback, and the level of the receive pin, recessive.
    pub(in crate::gateway) fn test_register(&self) -> u32 {
        const RECEIVE_PIN: u32 = 1 << 7;
        let loopback = self.config().is_some_and(|config| {
            let mode = config.station.mode;
            matches!(mode, StationMode::InternalLoopback | StationMode::ExternalLoopback)
        });
        RECEIVE_PIN | self.written.test.unwrap_or(if loopback { TEST_LOOPBACK } else { 0 })
    }

    /// Value of a register; 0 for one that the model does not have.
    pub(in crate::gateway) fn read_register(&self, offset: u16) -> u32 {
        match offset {
            offset::ENDIAN => 0x8765_4321,
            offset::DBTP => self.data_timing_register(),
            offset::TEST => self.test_register(),
            offset::RWD => self.written.ram_watchdog,
            offset::CCCR => self.control_register(),
            offset::NBTP => self.nominal_timing_register(),
            offset::ECR => self.error_counter_register(),
            offset::PSR => self.protocol_status_register(),
            offset::TDCR => self.delay_compensation_register(),
            offset::IR => self.interrupt_register(),
            offset::IE => self.written.interrupt_enable,
            offset::ILS => self.written.line_select,
            offset::ILE => self.written.line_enable,
            offset::GFC => self.filter_register(),
            offset::XIDAM => self.extended_mask_register(),
            offset::HPMS => self.high_priority_register(),
            offset::RXF0S => self.fifo0_register(),
            offset::RXF0A => self.written.fifo0_acknowledge,
            offset::RXF1S => self.fifo1_register(),
            offset::RXF1A => self.written.fifo1_acknowledge,
            offset::TXFQS => self.transmit_register(),
            offset::TXEFS => self.event_register(),
            offset::TXEFA => self.written.event_acknowledge,
            _ => 0,
        }
    }

    pub(in crate::gateway) fn nominal_timing_register(&self) -> u32 {
        if let Some(written) = self.written.nominal_timing {
            return written;
        }
        self.config().map_or(0x0600_0A03, |config| timing_register(Phase::Nominal, config.timing.0))
    }

    /// DBTP with the delay compensation's enable bit.
    pub(in crate::gateway) fn data_timing_register(&self) -> u32 {
        if let Some(written) = self.written.data_timing {
            return written;
        }
        let Some(config) = self.config() else {
            return 0x0000_0A33;
        };
        let timing =
            config.timing.1.map_or(0x0000_0A33, |timing| timing_register(Phase::Data, timing));
        timing | u32::from(config.tdc.is_some()) << 23
    }

    /// TDCR: filter window and offset; an automatic offset is computed.
    pub(in crate::gateway) fn delay_compensation_register(&self) -> u32 {
        if let Some(written) = self.written.delay_compensation {
            return written;
        }
        let Some(config) = self.config() else {
            return 0;
        };
        let (Some((offset, filter)), Some(timing)) = (config.tdc, config.timing.1) else {
            return 0;
        };
        let offset = match offset {
            0 => timing.automatic_tdc_offset().unwrap_or(0),
            offset => offset,
        };
        u32::from(filter) | u32::from(offset) << 8
    }

    /// GFC: remote rules and non-match rules.
    pub(in crate::gateway) fn filter_register(&self) -> u32 {
        if let Some(written) = self.written.filter {
            return written;
        }
        self.config().map_or(0, |config| {
            let filters = &config.filters;
            u32::from(filters.reject_remote_extended)
                | u32::from(filters.reject_remote_standard) << 1
                | u32::from(filters.non_match_extended.raw()) << 2
                | u32::from(filters.non_match_standard.raw()) << 4
        })
    }

    pub(in crate::gateway) fn extended_mask_register(&self) -> u32 {
        let configured = self.config().map_or(0x1FFF_FFFF, |config| config.filters.extended_mask);
        self.written.extended_mask.unwrap_or(configured)
    }
}

/// NBTP or DBTP; registers hold values less one.
fn timing_register(phase: Phase, timing: BitTiming) -> u32 {
    let less_one = |value: u16| u32::from(value.saturating_sub(1));
    let (brp, tseg1, tseg2, sjw) = (
        less_one(timing.brp),
        less_one(timing.tseg1),
        less_one(timing.tseg2),
        less_one(timing.sjw),
    );
    match phase {
        Phase::Nominal => sjw << 25 | brp << 16 | tseg1 << 8 | tseg2,
        Phase::Data => brp << 16 | tseg1 << 8 | tseg2 << 4 | sjw,
    }
}
