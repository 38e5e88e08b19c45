//! Faults of a [`McanChannelConfig`], and warnings about a valid one that may not match the bus (manual
//! 5.4.3, 13.4).

use super::mcan_channel::{BitTimingMode, McanChannelConfig, NodeMode, NonMatch};
use super::message_ram::MESSAGE_RAM_BYTES;
use super::{ConfigObject, RangeFault};
use crate::can::{
    BitTiming, BitTimingError, MCAN_CLOCK_HZ, Phase, TDC_MAX_PRESCALER, solve_bit_timing,
    vendor_driver_timing,
};

/// A fault of a channel configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChannelFault {
    /// A field outside the range of 0x8001..0x8004.
    #[error("{0}")]
    Range(RangeFault),
    /// Bit rate and sample point window allow no timing.
    #[error("{phase} bit timing: {error}")]
    Timing {
        /// The phase.
        phase: Phase,
        /// The reason, with the nearest possible values.
        error: BitTimingError,
    },
    /// A manual timing that the registers cannot hold, or with SJW above TSEG2.
    #[error(
        "manual {phase} bit timing BRP {} TSEG1 {} TSEG2 {} SJW {} does not fit the controller",
        .timing.brp, .timing.tseg1, .timing.tseg2, .timing.sjw
    )]
    ManualTiming {
        /// The phase.
        phase: Phase,
        /// The timing.
        timing: BitTiming,
    },
    /// A manual timing that gives another bit rate than the configured one.
    #[error(
        "manual {phase} bit timing gives {actual} bit/s, not the configured {configured} bit/s"
    )]
    ManualBitrate {
        /// The phase.
        phase: Phase,
        /// The configured bit rate, bit/s.
        configured: u32,
        /// Bit rate of the timing, bit/s.
        actual: u32,
    },
    /// The data phase is slower than the arbitration.
    #[error("data bit rate {data} bit/s is below the nominal {nominal} bit/s")]
    DataBelowNominal {
        /// Nominal bit rate, bit/s.
        nominal: u32,
        /// Data bit rate, bit/s.
        data: u32,
    },
    /// Delay compensation needs a data prescaler of 1 or 2.
    #[error(
        "delay compensation (TDC) does not work with a data prescaler of {brp}; allowed: 1 or 2; \
         switch it off at this data bit rate"
    )]
    TdcPrescaler {
        /// Data prescaler that the bit rate needs.
        brp: u16,
    },
    /// FIFO and dedicated buffers together exceed the 32 transmit elements.
    #[error("{fifo} FIFO and {dedicated} dedicated transmit elements; allowed: 32 together")]
    TransmitElements {
        /// FIFO or queue elements.
        fifo: u8,
        /// Dedicated buffers.
        dedicated: u8,
    },
    /// No FIFO to send through.
    #[error("no transmit FIFO element; the channel could not send")]
    NoTransmitFifo,
    /// Frames that no filter matches are stored in a FIFO without elements.
    #[error("frames that no filter matches are stored in RX FIFO{fifo}, which has no elements")]
    NonMatchWithoutFifo {
        /// The FIFO.
        fifo: u8,
    },
    /// The layout does not fit into the Message RAM.
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
        self.check_ranges(&mut |fault| {
            // Manual timing counts only in manual mode, and has a fault of its own.
            if !(25..=32).contains(&fault.subindex) {
                report(ChannelFault::Range(fault));
            }
        });
        self.check_timing(clock_hz, report);
        self.check_ram(report);
    }

    /// Returns the timings at a source clock in Hz: nominal, and data for CAN FD. In automatic mode
    /// they are solved, in manual mode they are the configured ones.
    ///
    /// # Errors
    /// The phase and [`BitTimingError`] if there is no timing; never in manual mode.
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
        let (bitrate, window) = self.bit_rate_and_window(phase);
        match self.bit_timing_mode {
            BitTimingMode::Manual => Ok(match phase {
                Phase::Nominal => self.manual_nominal,
                Phase::Data => self.manual_data,
            }),
            BitTimingMode::Automatic => {
                solve_bit_timing(phase, clock_hz, bitrate, window.min, window.max)
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
        // Subindex 26 is one byte; the register could hold 256.
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
        // Each one above 32 is already a range fault.
        if fifo <= 32 && dedicated <= 32 && fifo + dedicated > 32 {
            report(ChannelFault::TransmitElements { fifo, dedicated });
        }
        if fifo == 0 && self.node_mode != NodeMode::Listen {
            report(ChannelFault::NoTransmitFifo);
        }
        let is_target =
            |target| self.non_match_standard == target || self.non_match_extended == target;
        if ram.rx_fifo0.size == 0 && is_target(NonMatch::Fifo0) {
            report(ChannelFault::NonMatchWithoutFifo { fifo: 0 });
        }
        if ram.rx_fifo1.size == 0 && is_target(NonMatch::Fifo1) {
            report(ChannelFault::NonMatchWithoutFifo { fifo: 1 });
        }
        let bytes = ram.bytes();
        if bytes > MESSAGE_RAM_BYTES {
            report(ChannelFault::MessageRam { bytes });
        }
    }
}

/// A warning about a channel configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChannelWarning {
    /// The firmware chooses the sample point of a CAN FD channel with bit rate switch.
    #[error(
        "the firmware chooses the {phase} sample point between {} and {} %; with CAN FD set it to \
         that of the other nodes (manual 5.4.3)",
        f64::from(*.min_permille) / 10.0, f64::from(*.max_permille) / 10.0
    )]
    WideWindow {
        /// The phase.
        phase: Phase,
        /// Lower bound in 0.1 %.
        min_permille: u16,
        /// Upper bound in 0.1 %.
        max_permille: u16,
    },
    /// The public driver of the controller's vendor finds no timing.
    #[error(
        "the public driver of the controller's vendor finds no {phase} timing for these sample \
         points; a firmware that uses it cannot start the channel (assumption H43); allow smaller \
         sample points, or set the bit timing by hand"
    )]
    NoDriverTiming {
        /// The phase.
        phase: Phase,
    },
    /// The meaning of the values of a manual bit timing is an assumption.
    #[error(
        "the manual bit timing has prescaler and time quanta; a firmware that expects register \
         values, less by one, has another bit rate (assumption H10); use automatic bit timing, or \
         find out with `ecan probe`"
    )]
    ManualTiming,
    /// Only one of TDC offset and TDC filter is set.
    #[error(
        "TDC offset is {offset} and TDC filter {filter}: one is automatic (0), the other one is \
         not; set both or none (manual 13.4)"
    )]
    UnpairedTdc {
        /// 0x8001:33.
        offset: u8,
        /// 0x8001:34.
        filter: u8,
    },
}

impl McanChannelConfig {
    /// Reports what is valid but may not match the bus, with the MCAN clock at its default of 80 MHz.
    pub fn warnings(&self, report: &mut dyn FnMut(ChannelWarning)) {
        let phases: &[Phase] =
            if self.fd { &[Phase::Nominal, Phase::Data] } else { &[Phase::Nominal] };
        if self.bit_timing_mode == BitTimingMode::Automatic {
            for &phase in phases {
                let (bitrate, window) = self.bit_rate_and_window(phase);
                let (min_permille, max_permille) = (window.min, window.max);
                if self.fd && min_permille < max_permille {
                    report(ChannelWarning::WideWindow { phase, min_permille, max_permille });
                }
                let driver = vendor_driver_timing(
                    phase,
                    self.fd,
                    MCAN_CLOCK_HZ,
                    bitrate,
                    min_permille,
                    max_permille,
                );
                if driver.is_none() {
                    report(ChannelWarning::NoDriverTiming { phase });
                }
            }
        }
        if self.bit_timing_mode == BitTimingMode::Manual {
            report(ChannelWarning::ManualTiming);
        }
        let (offset, filter) = (self.tdc_offset, self.tdc_filter);
        if self.tdc_runs() && (offset == 0) != (filter == 0) {
            report(ChannelWarning::UnpairedTdc { offset, filter });
        }
    }
}
