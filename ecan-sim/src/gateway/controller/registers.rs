//! Status and configuration registers of an MCAN controller, laid out as in the Bosch M_CAN
//! core; the manual names them but not their bits (manual 13.5, 13.6).

use ecan_protocol::{BitTiming, Phase};

use crate::bus::{ErrorState, StationMode};

use super::Controller;

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

    pub(in crate::gateway) fn clear_interrupts(&mut self, bits: u32) {
        self.interrupts &= !bits;
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

    /// TXEFS: always empty, the firmware takes each event at once.
    pub(in crate::gateway) fn event_register(&self) -> u32 {
        0
    }

    pub(in crate::gateway) fn high_priority_register(&self) -> u32 {
        self.high_priority
    }

    /// CCCR: initialisation while stopped, monitoring or loopback, FD and bit rate switch.
    pub(in crate::gateway) fn control_register(&self) -> u32 {
        let Some(station) = self.station() else {
            return 1;
        };
        let monitoring = station.mode == StationMode::Listen;
        let loopback =
            matches!(station.mode, StationMode::InternalLoopback | StationMode::ExternalLoopback);
        u32::from(self.is_bus_off())
            | u32::from(monitoring) << 5
            | u32::from(!station.auto_retransmit) << 6
            | u32::from(loopback) << 7
            | u32::from(station.fd) << 8
            | u32::from(station.fd) << 9
    }

    /// NBTP.
    pub(in crate::gateway) fn nominal_timing_register(&self) -> u32 {
        self.config().map_or(0x0600_0A03, |config| timing_register(Phase::Nominal, config.timing.0))
    }

    /// DBTP with the delay compensation's enable bit.
    pub(in crate::gateway) fn data_timing_register(&self) -> u32 {
        let Some(config) = self.config() else {
            return 0x0000_0A33;
        };
        let timing =
            config.timing.1.map_or(0x0000_0A33, |timing| timing_register(Phase::Data, timing));
        timing | u32::from(config.tdc.is_some()) << 23
    }

    /// TDCR: filter window and offset, the automatic ones resolved.
    pub(in crate::gateway) fn delay_compensation_register(&self) -> u32 {
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
        self.config().map_or(0, |config| {
            let filters = &config.filters;
            u32::from(filters.reject_remote_extended)
                | u32::from(filters.reject_remote_standard) << 1
                | u32::from(filters.non_match_extended.raw()) << 2
                | u32::from(filters.non_match_standard.raw()) << 4
        })
    }

    /// XIDAM.
    pub(in crate::gateway) fn extended_mask_register(&self) -> u32 {
        self.config().map_or(0x1FFF_FFFF, |config| config.filters.extended_mask)
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
