//! Configuration of one CAN channel, 0x8001..0x8004 (manual 13.4), as plain data.

use core::fmt;

use super::message_ram::MessageRamLayout;
use crate::can::{BitTiming, MCAN_CLOCK_HZ, TDC_MAX_PRESCALER, solve_data, tdc_active};
use crate::object::ObjectType;
use crate::object::SdoWrite;
use crate::raw_enum::raw_enum;

pub(super) const FIRST_INDEX: u16 = 0x8001;

raw_enum! {
    /// Who determines the bit timing (0x8001:07).
    pub enum BitTimingMode: u8 {
        /// The firmware, from bit rate and sample point window.
        Automatic = 0,
        /// The configuration, by its `manual_nominal` and `manual_data`.
        Manual = 1,
    }
}

raw_enum! {
    /// How the channel takes part in the bus (0x8001:08).
    pub enum NodeMode: u8 {
        /// Sends and receives.
        Normal = 0,
        /// Listens only; sends neither frames nor acknowledgements.
        Listen = 1,
        /// Receives what it sends, without the bus.
        InternalLoopback = 2,
        /// Receives what it sends, with the frame on the bus.
        ExternalLoopback = 3,
    }
}

raw_enum! {
    /// Where a frame goes that no filter matches (0x8001:36, :37).
    ///
    /// The manual names only 0; the others are those of the MCAN core.
    pub enum NonMatch: u8 {
        /// Into RX FIFO0.
        Fifo0 = 0,
        /// Into RX FIFO1.
        Fifo1 = 1,
        /// Nowhere.
        Reject = 2,
        /// Nowhere (the core has two numbers for it).
        RejectToo = 3,
    }
}

/// Bounds of the sample point in 0.1 %, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SamplePointWindow {
    /// Lower bound in 0.1 %.
    pub min: u16,
    /// Upper bound in 0.1 %.
    pub max: u16,
}

impl SamplePointWindow {
    /// The device default, 75..87.5 %.
    pub const DEFAULT: Self = Self { min: 750, max: 875 };

    /// The window that leaves one sample point, in 0.1 %.
    pub const fn exactly(permille: u16) -> Self {
        Self { min: permille, max: permille }
    }
}

/// Configuration of one CAN channel: what a host writes to 0x8001..0x8004.
///
/// The default is the device's. [`check`](Self::check) tells what is wrong with it before
/// anything is written; filters are separate (`filter_writes`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct McanChannelConfig {
    /// :07 Who determines the bit timing.
    pub bit_timing_mode: BitTimingMode,
    /// :08 How the channel takes part in the bus.
    pub node_mode: NodeMode,
    /// :09 CAN FD as Bosch had it before ISO 11898-1:2015.
    pub non_iso: bool,
    /// :10 Pause of two bits between two transmissions.
    pub transmit_pause: bool,
    /// :11 Two quanta needed for an edge while the bus is integrated.
    pub edge_filter: bool,
    /// :12 No protocol exception handling.
    pub protocol_exception_disable: bool,
    /// :13 Message markers of 16 bits.
    pub wide_message_marker: bool,
    /// :14 Timestamps from an external source.
    pub external_timestamp: bool,
    /// :15 CAN FD; classic CAN otherwise.
    pub fd: bool,
    /// :16 Transmitter delay compensation; from 5 Mbit/s on it runs in any case.
    pub tdc: bool,
    /// :17 Control of restricted operation mode.
    pub restricted_mode_disable: bool,
    /// :18 A frame that failed is not sent again.
    pub disable_auto_retransmission: bool,
    /// :19 Bit rate of arbitration and of classic frames, bit/s.
    pub nominal_bitrate: u32,
    /// :20 Bit rate of the data phase, bit/s.
    pub data_bitrate: u32,
    /// :21, :22 Window for the nominal sample point.
    pub nominal_sample_point: SamplePointWindow,
    /// :23, :24 Window for the data sample point.
    pub data_sample_point: SamplePointWindow,
    /// :25..:28 Nominal timing in manual mode (TSEG1 at most 255).
    pub manual_nominal: BitTiming,
    /// :29..:32 Data timing in manual mode.
    pub manual_data: BitTiming,
    /// :33 Offset of the delay compensation in clock periods, 0..127; 0 is automatic.
    pub tdc_offset: u8,
    /// :34 Filter window of the delay compensation in clock periods, 0..127; 0 is automatic.
    pub tdc_filter: u8,
    /// :36 Standard frames that no filter matches.
    pub non_match_standard: NonMatch,
    /// :37 Extended frames that no filter matches.
    pub non_match_extended: NonMatch,
    /// :38 Refuse standard remote frames.
    pub reject_remote_standard: bool,
    /// :39 Refuse extended remote frames.
    pub reject_remote_extended: bool,
    /// :40 Mask over extended identifiers before filtering.
    pub extended_id_mask: u32,
    /// :61..:73 Elements in the Message RAM.
    pub ram: MessageRamLayout,
    /// :74 Timestamp selection, 0..2.
    pub timestamp_selection: u8,
    /// :75 Timestamp prescaler.
    pub timestamp_prescaler: u8,
    /// :76 Timestamp unit (TSU).
    pub tsu: bool,
    /// :77 TSU counts an external time base.
    pub tsu_external_timebase: bool,
    /// :78 TSU captures at the start of frame, at the end otherwise.
    pub tsu_capture_sof: bool,
    /// :79 TSU counts 64 bits.
    pub tsu_64_bit: bool,
    /// :81 TSU prescaler, at least 1.
    pub tsu_prescaler: u16,
    /// :82 Source of the external time base.
    pub tsu_timebase_source: u8,
    /// :83 TBSEL option.
    pub tsu_tbsel: u8,
    /// :84 Timeout counter.
    pub timeout: bool,
    /// :85 What the timeout counter watches, 0..3.
    pub timeout_select: u8,
    /// :87 Timeout period.
    pub timeout_period: u16,
}

impl Default for McanChannelConfig {
    fn default() -> Self {
        Self::DEVICE_DEFAULT
    }
}

impl McanChannelConfig {
    /// What a factory-new device has: CAN FD, 500 kbit/s and 5 Mbit/s.
    pub const DEVICE_DEFAULT: Self = Self {
        bit_timing_mode: BitTimingMode::Automatic,
        node_mode: NodeMode::Normal,
        non_iso: false,
        transmit_pause: false,
        edge_filter: false,
        protocol_exception_disable: false,
        wide_message_marker: false,
        external_timestamp: false,
        fd: true,
        tdc: true,
        restricted_mode_disable: false,
        disable_auto_retransmission: false,
        nominal_bitrate: 500_000,
        data_bitrate: 5_000_000,
        nominal_sample_point: SamplePointWindow::DEFAULT,
        data_sample_point: SamplePointWindow::DEFAULT,
        manual_nominal: BitTiming { brp: 0, tseg1: 0, tseg2: 0, sjw: 0 },
        manual_data: BitTiming { brp: 0, tseg1: 0, tseg2: 0, sjw: 0 },
        tdc_offset: 0,
        tdc_filter: 0,
        non_match_standard: NonMatch::Fifo0,
        non_match_extended: NonMatch::Fifo0,
        reject_remote_standard: false,
        reject_remote_extended: false,
        extended_id_mask: 0x1FFF_FFFF,
        ram: MessageRamLayout::fd(),
        timestamp_selection: 0,
        timestamp_prescaler: 0,
        tsu: false,
        tsu_external_timebase: false,
        tsu_capture_sof: false,
        tsu_64_bit: false,
        tsu_prescaler: 1,
        tsu_timebase_source: 0,
        tsu_tbsel: 0,
        timeout: false,
        timeout_select: 0,
        timeout_period: 0,
    };

    /// Classic CAN at a bit rate in bit/s, with the Message RAM laid out for frames of 8 bytes.
    pub const fn classic(bitrate: u32) -> Self {
        Self {
            fd: false,
            nominal_bitrate: bitrate,
            ram: MessageRamLayout::classic(),
            ..Self::DEVICE_DEFAULT
        }
    }

    /// CAN FD at two bit rates in bit/s, with room for frames of 64 bytes.
    ///
    /// The delay compensation is on, as the manual recommends, unless the data bit rate is so
    /// low that the core cannot use it (below about 0.8 Mbit/s at 80 MHz).
    pub fn fd(nominal: u32, data: u32) -> Self {
        let window = SamplePointWindow::DEFAULT;
        let tdc = match solve_data(MCAN_CLOCK_HZ, data, window.min, window.max) {
            Ok(timing) => timing.brp <= TDC_MAX_PRESCALER,
            Err(_) => true,
        };
        Self { nominal_bitrate: nominal, data_bitrate: data, tdc, ..Self::DEVICE_DEFAULT }
    }

    /// The same with sample points in 0.1 % as the peers on the bus have them.
    #[must_use]
    pub const fn sample_point(mut self, nominal_permille: u16, data_permille: u16) -> Self {
        self.nominal_sample_point = SamplePointWindow::exactly(nominal_permille);
        self.data_sample_point = SamplePointWindow::exactly(data_permille);
        self
    }

    /// True when the delay compensation runs on the device (manual 13.4, "TDC Strategy").
    pub const fn tdc_runs(&self) -> bool {
        self.fd && tdc_active(self.tdc, self.data_bitrate)
    }

    /// Bytes of Message RAM that the layout needs.
    pub const fn message_ram_bytes(&self) -> u32 {
        self.ram.bytes()
    }

    /// The download that applies what was written to a channel (0..3): :01 = 1.
    pub const fn apply_write(channel: u8) -> SdoWrite {
        SdoWrite::new(channel_index(channel), 1, ObjectType::U8, 1)
    }
}

/// 0x8001 for channel 0 and so on.
pub(super) const fn channel_index(channel: u8) -> u16 {
    FIRST_INDEX + channel as u16
}

/// 0x8001:02 Apply status and :04 Flash status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ApplyStatus {
    /// Done.
    Ok,
    /// Failed.
    Fail,
    /// The configuration could not be converted.
    BuildFail,
    /// The controller could not be restarted with it.
    RuntimeFail,
    /// A number that the manual does not list.
    Unknown(u8),
}

impl ApplyStatus {
    /// The status for the gateway's number.
    pub const fn from_raw(raw: u8) -> Self {
        match raw {
            0 => Self::Ok,
            1 => Self::Fail,
            3 => Self::BuildFail,
            4 => Self::RuntimeFail,
            other => Self::Unknown(other),
        }
    }

    /// The gateway's number.
    pub const fn raw(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Fail => 1,
            Self::BuildFail => 3,
            Self::RuntimeFail => 4,
            Self::Unknown(raw) => raw,
        }
    }
}

impl fmt::Display for ApplyStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        super::write_status(
            f,
            self.raw(),
            match self {
                Self::Ok => Some("OK"),
                Self::Fail => Some("failed"),
                Self::BuildFail => Some("the configuration could not be converted"),
                Self::RuntimeFail => Some("the CAN controller could not be restarted with it"),
                Self::Unknown(_) => None,
            },
        )
    }
}
