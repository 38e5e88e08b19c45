//! A transmission on the bus, and how stations sample it.

use ecan_protocol::can::{CanFrame, Phase};

use crate::bus::station::{Mismatch, Station, StationConfig};
use crate::bus::timing::{
    BitRates, Draw, FrameTiming, PhysicalLayer, Sample, SwitchError, bits_ns,
};

/// Bits until a receiver at another nominal bit rate detects a stuff error.
const RATE_ERROR_AFTER_BITS: u32 = 7;
/// Data bits until a receiver with another data bit rate detects a stuff error after the switch.
const DATA_RATE_ERROR_AFTER_BITS: u32 = 6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TransmissionResult {
    /// Acknowledged, or sent in external loopback.
    Delivered,
    /// No one acknowledged.
    NoAck,
    /// The acknowledgements came after the sample point of the sender.
    LateAck,
    /// The sender sampled its own data bits before they were back.
    EchoMissed,
    /// An injected bit error.
    Disturbed,
    /// An error-active station that cannot read the frame destroyed it.
    Destroyed,
    /// The sender left the bus.
    SenderRemoved,
}

/// A transmission: planned until `start` has passed, then in progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transmission {
    pub transmitter: usize,
    pub config: StationConfig,
    pub frame: CanFrame,
    pub timing: FrameTiming,
    pub key: u32,
    pub start: u64,
    pub end: u64,
    pub result: TransmissionResult,
    /// Phase in which the sender detects the error of an unsuccessful result.
    pub phase: Phase,
    pub collision: bool,
    /// True if other stations were ready at the same start.
    pub contested: bool,
}

/// Sampling of a transmission whose sender has sample points.
pub(super) struct Sampling {
    pub(super) sender: PhysicalLayer,
    pub(super) rates: BitRates,
    /// The frame has a data phase.
    pub(super) has_switch: bool,
    pub(super) draw: Draw,
}

impl Sampling {
    #[cold]
    pub(super) fn read_by(&self, index: usize, station: &Station) -> Result<(), Mismatch> {
        if let Some(receiver) = &station.physical_layer
            && self.has_switch
        {
            let (error, probability) = self.sender.switch_error(receiver, self.rates);
            if self.draw.hits(probability, index, Sample::Switch) {
                return Err(match error {
                    SwitchError::Late => Mismatch::SwitchLate,
                    SwitchError::Early => Mismatch::SwitchEarly,
                });
            }
        }
        Ok(())
    }

    #[cold]
    pub(super) fn acknowledges_late(&self, index: usize, station: &Station) -> bool {
        let Some(receiver) = &station.physical_layer else { return false };
        let probability = self.sender.late_acknowledge(receiver, self.rates, self.has_switch);
        self.draw.hits(probability, index, Sample::Acknowledge)
    }

    #[cold]
    pub(super) fn misses_echo(&self, t: &Transmission) -> bool {
        let probability = if self.has_switch { self.sender.echo_error(self.rates) } else { 0 };
        self.draw.hits(probability, t.transmitter, Sample::Echo)
    }
}

impl Transmission {
    /// Returns whether a station can read the frame.
    #[inline]
    pub(super) fn read_by(
        &self,
        sampling: Option<&Sampling>,
        index: usize,
        station: &Station,
        config: &StationConfig,
    ) -> Result<(), Mismatch> {
        config.can_read(&self.config, &self.frame)?;
        match sampling {
            Some(sampling) => sampling.read_by(index, station),
            None => Ok(()),
        }
    }

    pub(super) fn after_switch_ns(&self, data_bits: u32) -> u64 {
        self.config.bits_ns(u32::from(self.timing.header_bits))
            + bits_ns(data_bits, self.config.data_bitrate)
    }

    /// Phase of the sender when a receiver signals an error.
    pub(super) fn phase_of(&self, mismatch: Mismatch) -> Phase {
        match mismatch {
            Mismatch::NominalBitrate | Mismatch::FdFormat => Phase::Nominal,
            Mismatch::DataBitrate | Mismatch::SwitchLate | Mismatch::SwitchEarly => Phase::Data,
        }
    }
}

pub(super) fn mismatch_ns(mismatch: Mismatch, t: &Transmission) -> u64 {
    let header = u32::from(t.timing.header_bits);
    match mismatch {
        Mismatch::NominalBitrate => t.config.bits_ns(RATE_ERROR_AFTER_BITS),
        Mismatch::FdFormat => t.config.bits_ns(header),
        Mismatch::DataBitrate | Mismatch::SwitchEarly => {
            t.after_switch_ns(DATA_RATE_ERROR_AFTER_BITS)
        }
        // it continues at the nominal bit rate
        Mismatch::SwitchLate => t.config.bits_ns(header + DATA_RATE_ERROR_AFTER_BITS),
    }
}
