//! What can be wrong with a [`McanChannelConfig`] (manual 13.4).

use super::message_ram::MESSAGE_RAM_BYTES;
use crate::can::{
    BitTiming, BitTimingError, MCAN_CLOCK_HZ, Phase, TDC_MAX_PRESCALER, solve_data, solve_nominal,
};
use crate::object::{MCAN_CHANNEL, describe_field};

use super::mcan_channel::{BitTimingMode, McanChannelConfig, NodeMode, NonMatch};

/// A fault of a channel configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChannelFault {
    /// A field outside the range of 0x8001..0x8004.
    #[error("{} is {value}, possible is {min}..{max}", describe_field(0x8001, *.subindex))]
    Range {
        /// The field's subindex.
        subindex: u8,
        /// Its value.
        value: u32,
        /// Smallest possible value.
        min: u32,
        /// Greatest possible value.
        max: u32,
    },
    /// Bit rate and sample point window admit no timing.
    #[error("{phase} bit timing: {error}")]
    Timing {
        /// Which timing.
        phase: Phase,
        /// Why, with the nearest possible values.
        error: BitTimingError,
    },
    /// A manual timing that the registers cannot hold, or with a jump width beyond TSEG2.
    #[error(
        "manual {phase} bit timing BRP {} TSEG1 {} TSEG2 {} SJW {} does not fit the controller",
        .timing.brp, .timing.tseg1, .timing.tseg2, .timing.sjw
    )]
    ManualTiming {
        /// Which timing.
        phase: Phase,
        /// The timing.
        timing: BitTiming,
    },
    /// A manual timing that gives another bit rate than the configured one.
    #[error("manual {phase} bit timing gives {actual} bit/s, configured are {configured} bit/s")]
    ManualBitrate {
        /// Which timing.
        phase: Phase,
        /// The configured bit rate, bit/s.
        configured: u32,
        /// What the timing gives, bit/s.
        actual: u32,
    },
    /// The data phase would be slower than the arbitration.
    #[error("data bit rate {data} bit/s is below the nominal {nominal} bit/s")]
    DataBelowNominal {
        /// Nominal bit rate, bit/s.
        nominal: u32,
        /// Data bit rate, bit/s.
        data: u32,
    },
    /// Delay compensation needs a data prescaler of 1 or 2.
    #[error(
        "delay compensation (TDC) does not work with a data prescaler of {brp}, possible is 1 \
         or 2; switch it off at this data bit rate"
    )]
    TdcPrescaler {
        /// The data prescaler that the bit rate needs.
        brp: u16,
    },
    /// FIFO and dedicated buffers together exceed the 32 transmit elements.
    #[error("{fifo} FIFO and {dedicated} dedicated transmit elements, possible are 32 together")]
    TransmitElements {
        /// FIFO or queue elements.
        fifo: u8,
        /// Dedicated buffers.
        dedicated: u8,
    },
    /// No FIFO to send by.
    #[error("no transmit FIFO element, the channel could not send")]
    NoTransmitFifo,
    /// Frames without a filter are sent to a FIFO without elements.
    #[error("frames that no filter matches go to RX FIFO{fifo}, which has no elements")]
    NonMatchWithoutFifo {
        /// The FIFO.
        fifo: u8,
    },
    /// The layout does not fit the Message RAM.
    #[error("Message RAM layout needs {bytes} bytes, the channel has {MESSAGE_RAM_BYTES}")]
    MessageRam {
        /// Bytes that the layout needs.
        bytes: u32,
    },
}

impl McanChannelConfig {
    /// Reports every fault of the configuration, with the MCAN clock at its default of 80 MHz.
    pub fn check(&self, report: &mut dyn FnMut(ChannelFault)) {
        self.check_at(MCAN_CLOCK_HZ, report);
    }

    /// Reports every fault of the configuration for a source clock in Hz (0x8000:06..09).
    pub fn check_at(&self, clock_hz: u32, report: &mut dyn FnMut(ChannelFault)) {
        self.check_ranges(report);
        self.check_timing(clock_hz, report);
        self.check_ram(report);
    }

    /// The timings that result at a source clock in Hz: nominal, and data for CAN FD. In
    /// automatic mode those that the solver finds, in manual mode the configured ones.
    ///
    /// # Errors
    /// The phase and [`BitTimingError`] when there is none; in manual mode never.
    pub fn timings(
        &self,
        clock_hz: u32,
    ) -> Result<(BitTiming, Option<BitTiming>), (Phase, BitTimingError)> {
        let nominal = self.timing(Phase::Nominal, clock_hz).map_err(|e| (Phase::Nominal, e))?;
        let data = match self.fd {
            true => Some(self.timing(Phase::Data, clock_hz).map_err(|e| (Phase::Data, e))?),
            false => None,
        };
        Ok((nominal, data))
    }

    fn timing(&self, phase: Phase, clock_hz: u32) -> Result<BitTiming, BitTimingError> {
        match (self.bit_timing_mode, phase) {
            (BitTimingMode::Manual, Phase::Nominal) => Ok(self.manual_nominal),
            (BitTimingMode::Manual, Phase::Data) => Ok(self.manual_data),
            (BitTimingMode::Automatic, Phase::Nominal) => {
                let window = self.nominal_sample_point;
                solve_nominal(clock_hz, self.nominal_bitrate, window.min, window.max)
            }
            (BitTimingMode::Automatic, Phase::Data) => {
                let window = self.data_sample_point;
                solve_data(clock_hz, self.data_bitrate, window.min, window.max)
            }
        }
    }

    fn check_ranges(&self, report: &mut dyn FnMut(ChannelFault)) {
        for entry in MCAN_CHANNEL.entries {
            let Some(value) = self.value(entry.subindex) else {
                continue;
            };
            // Manual timing has a fault of its own, and counts only in manual mode.
            let manual_timing = (25..=32).contains(&entry.subindex);
            if !manual_timing && !(entry.min..=entry.max).contains(&value) {
                report(ChannelFault::Range {
                    subindex: entry.subindex,
                    value,
                    min: entry.min,
                    max: entry.max,
                });
            }
        }
    }

    fn check_timing(&self, clock_hz: u32, report: &mut dyn FnMut(ChannelFault)) {
        self.check_phase(Phase::Nominal, self.nominal_bitrate, clock_hz, report);
        if !self.fd {
            return;
        }
        if self.data_bitrate < self.nominal_bitrate {
            report(ChannelFault::DataBelowNominal {
                nominal: self.nominal_bitrate,
                data: self.data_bitrate,
            });
        }
        let data = self.check_phase(Phase::Data, self.data_bitrate, clock_hz, report);
        if let Some(BitTiming { brp, .. }) = data
            && self.tdc_runs()
            && brp > TDC_MAX_PRESCALER
        {
            report(ChannelFault::TdcPrescaler { brp });
        }
    }

    /// Reports the faults of one timing and returns it when it has none.
    fn check_phase(
        &self,
        phase: Phase,
        configured: u32,
        clock_hz: u32,
        report: &mut dyn FnMut(ChannelFault),
    ) -> Option<BitTiming> {
        let timing = match self.timing(phase, clock_hz) {
            Ok(timing) => timing,
            Err(error) => {
                report(ChannelFault::Timing { phase, error });
                return None;
            }
        };
        // Subindex 26 is one byte, the register would hold 256.
        let representable = self.bit_timing_mode == BitTimingMode::Automatic || timing.tseg1 <= 255;
        if !timing.fits(phase) || !representable {
            report(ChannelFault::ManualTiming { phase, timing });
            return None;
        }
        let actual = timing.bitrate(clock_hz);
        let off = u64::from(actual.abs_diff(configured)) * 1000;
        if self.bit_timing_mode == BitTimingMode::Manual && off > u64::from(configured) {
            report(ChannelFault::ManualBitrate { phase, configured, actual });
        }
        Some(timing)
    }

    fn check_ram(&self, report: &mut dyn FnMut(ChannelFault)) {
        let ram = &self.ram;
        let (fifo, dedicated) = (ram.tx_fifo_size, ram.tx_dedicated_count);
        // Each above 32 is a range fault already.
        if fifo <= 32 && dedicated <= 32 && fifo + dedicated > 32 {
            report(ChannelFault::TransmitElements { fifo, dedicated });
        }
        if fifo == 0 && self.node_mode != NodeMode::Listen {
            report(ChannelFault::NoTransmitFifo);
        }
        let goes_to =
            |target| self.non_match_standard == target || self.non_match_extended == target;
        if ram.rx_fifo0.size == 0 && goes_to(NonMatch::Fifo0) {
            report(ChannelFault::NonMatchWithoutFifo { fifo: 0 });
        }
        if ram.rx_fifo1.size == 0 && goes_to(NonMatch::Fifo1) {
            report(ChannelFault::NonMatchWithoutFifo { fifo: 1 });
        }
        let bytes = ram.bytes();
        if bytes > MESSAGE_RAM_BYTES {
            report(ChannelFault::MessageRam { bytes });
        }
    }
}
