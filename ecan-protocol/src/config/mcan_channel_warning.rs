//! Warnings about a [`McanChannelConfig`] that is valid, but may not match the bus (manual 5.4.3,
//! 13.4).

use crate::can::{MCAN_CLOCK_HZ, Phase, vendor_driver_timing};
use crate::object::mcan_channel::{BitTimingMode, McanChannelConfig};

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
