//! Constructors of a [`McanChannelConfig`] and its SDO downloads (manual 13.4, 5.4.3 E).

use crate::can::{
    MCAN_CLOCK_HZ, Phase, TDC_MAX_PRESCALER, solve_bit_timing, tdc_active, usual_sample_point,
};
use crate::object::mcan_channel::{MCAN_CHANNEL, McanChannelConfig, SamplePointWindow};
use crate::object::message_ram::MessageRamLayout;
use crate::object::{ConfigObject, SdoWrite};

impl McanChannelConfig {
    /// Creates a configuration for classic CAN at a bit rate in bit/s, with a Message RAM layout for
    /// frames of 8 bytes and the sample point of [`usual_sample_point`].
    pub fn classic(bitrate: u32) -> Self {
        Self {
            fd: false,
            nominal_bitrate: bitrate,
            nominal_sample_point: usual_window(Phase::Nominal, false, bitrate),
            ram: MessageRamLayout::classic(),
            ..Self::DEVICE_DEFAULT
        }
    }

    /// Creates a configuration for CAN FD at two bit rates in bit/s, with a Message RAM layout for
    /// frames of 64 bytes and the sample points of [`usual_sample_point`].
    ///
    /// The delay compensation is on, as the manual recommends, unless the data bit rate is too low
    /// for it (below about 0.8 Mbit/s at 80 MHz).
    pub fn fd(nominal: u32, data: u32) -> Self {
        let window = usual_window(Phase::Data, true, data);
        let tdc = match solve_bit_timing(Phase::Data, MCAN_CLOCK_HZ, data, window.min, window.max) {
            Ok(timing) => timing.brp <= TDC_MAX_PRESCALER,
            Err(_) => true,
        };
        Self {
            nominal_bitrate: nominal,
            data_bitrate: data,
            nominal_sample_point: usual_window(Phase::Nominal, true, nominal),
            data_sample_point: window,
            tdc,
            ..Self::DEVICE_DEFAULT
        }
    }

    /// Sets the sample points in 0.1 %, as the peers on the bus have them.
    #[must_use]
    pub const fn sample_point(mut self, nominal_permille: u16, data_permille: u16) -> Self {
        self.nominal_sample_point = SamplePointWindow::exactly(nominal_permille);
        self.data_sample_point = SamplePointWindow::exactly(data_permille);
        self
    }

    /// Bit rate in bit/s and sample point window of a phase.
    pub const fn bit_rate_and_window(&self, phase: Phase) -> (u32, SamplePointWindow) {
        match phase {
            Phase::Nominal => (self.nominal_bitrate, self.nominal_sample_point),
            Phase::Data => (self.data_bitrate, self.data_sample_point),
        }
    }

    /// True if the delay compensation is active on the device (manual 13.4, "TDC Strategy").
    pub const fn tdc_runs(&self) -> bool {
        self.fd && tdc_active(self.tdc, self.data_bitrate)
    }

    /// Bytes of Message RAM that the layout needs.
    pub const fn message_ram_bytes(&self) -> u32 {
        self.ram.bytes()
    }

    /// Returns the downloads of the whole configuration to a channel (0 to 3), in ascending order of
    /// subindex. All are needed, because a device may have loaded other values from its flash. They
    /// take effect with [`apply_write`](Self::apply_write).
    pub fn writes(&self, channel: u8) -> impl Iterator<Item = SdoWrite> + use<> {
        self.writes_to(MCAN_CHANNEL.first + u16::from(channel))
    }

    /// Returns those of [`writes`](Self::writes) that have an effect in this configuration: without
    /// manual timing in automatic mode, without the data phase in classic CAN (manual 5.4.3), without
    /// the parameters of a timestamp unit or timeout that is off.
    pub fn needed_writes(&self, channel: u8) -> impl Iterator<Item = SdoWrite> + use<> {
        let config = *self;
        self.writes(channel).filter(move |write| {
            MCAN_CHANNEL.entry(write.subindex).is_some_and(|entry| config.has_effect(entry))
        })
    }

    /// The download that applies what was written to a channel (0 to 3): :01 = 1.
    pub const fn apply_write(channel: u8) -> SdoWrite {
        SdoWrite::apply(&MCAN_CHANNEL, channel)
    }
}

/// The device default for a bit rate that is not possible: another check reports it.
fn usual_window(phase: Phase, is_fd: bool, bitrate: u32) -> SamplePointWindow {
    match usual_sample_point(phase, is_fd, MCAN_CLOCK_HZ, bitrate) {
        Some(permille) => SamplePointWindow::exactly(permille),
        None => SamplePointWindow::DEFAULT,
    }
}
