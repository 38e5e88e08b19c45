//! 0x8001..0x8004 MCAN Channel Config (manual 13.4).
//!
//! The manual lists no values for the actions on frames without a filter; those of the MCAN core's
//! register GFC are used.

use super::ObjectType::{U8, U16, U32};
use super::declare::object;
use super::entry::{Entry, Object};
use super::filter_window::{
    ExtendedMatch, FilterAction, FilterCommand, FilterCommandStatus, StandardMatch,
};
use super::message_ram::{DataSize, FifoMode, MessageRamLayout, TxMode};
use super::value::{KeyForm, ObjectValue, raw_enum, status_enum};
use super::{ConfigObject, SdoWrite};
use crate::can::{
    BitTiming, MCAN_CLOCK_HZ, Phase, TDC_MAX_PRESCALER, solve_bit_timing, tdc_active,
    usual_sample_point,
};

raw_enum! {
    /// Source of the bit timing (0x8001:07).
    pub enum BitTimingMode: u8;
    /// The firmware solves it from bit rate and sample point window.
    Automatic = 0, "automatic";
    /// The configuration gives it: `manual_nominal` and `manual_data`.
    Manual = 1, "manual";
}

raw_enum! {
    /// Participation of the channel in the bus (0x8001:08).
    pub enum NodeMode: u8;
    /// Sends and receives.
    Normal = 0, "normal";
    /// Listens only; sends neither frames nor acknowledgements.
    Listen = 1, "listen";
    /// Receives its own frames, without the bus.
    InternalLoopback = 2, "internal loopback";
    /// Receives its own frames, which are also sent on the bus.
    ExternalLoopback = 3, "external loopback";
}

raw_enum! {
    /// Action on a frame that no filter matches (0x8001:36, :37).
    ///
    /// The manual defines only 0; the others are those of the MCAN core.
    pub enum NonMatch: u8;
    Fifo0 = 0, "FIFO0";
    Fifo1 = 1, "FIFO1";
    Reject = 2, "reject";
    /// Reject (the core has two numbers for it).
    RejectToo = 3, "reject";
}

status_enum! {
    /// Apply status (0x8001:02) and flash status (:04).
    pub enum ApplyStatus;
    Ok = 0, "OK";
    Fail = 1, "failed";
    BuildFail = 3, "build failed: the configuration could not be converted";
    RuntimeFail = 4, "apply failed: the CAN controller could not be restarted with it";
}

/// Bounds of the sample point in 0.1 %, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SamplePointWindow {
    /// Lower bound in 0.1 %.
    pub min: u16,
    /// Upper bound in 0.1 %.
    pub max: u16,
}

impl SamplePointWindow {
    /// The device default, 75 % to 87.5 %.
    pub const DEFAULT: Self = Self { min: 750, max: 875 };

    /// The window that allows one sample point, in 0.1 %.
    pub const fn exactly(permille: u16) -> Self {
        Self { min: permille, max: permille }
    }
}

/// Timing of a phase while the firmware solves it.
const UNSET: BitTiming = BitTiming { brp: 0, tseg1: 0, tseg2: 0, sjw: 0 };

/// An entry of the filter editing window with the values of an enumeration.
const fn filter<T: ObjectValue>(subindex: u8, name: &'static str) -> Entry {
    Entry::field::<T>(subindex, name).default(0)
}

object! {
    /// Configuration of one CAN channel: the fields of 0x8001..0x8004 (manual 13.4).
    ///
    /// The default is the device's. [`check`](Self::check) reports its faults before anything is
    /// written; filters are separate (`filter_writes`).
    pub struct McanChannelConfig {
        /// Window for the nominal sample point (:21, :22).
        nominal_sample_point: SamplePointWindow = SamplePointWindow::DEFAULT,
        /// Window for the data sample point (:23, :24).
        data_sample_point: SamplePointWindow = SamplePointWindow::DEFAULT,
        /// Nominal timing in manual mode (:25 to :28); TSEG1 is at most 255.
        manual_nominal: BitTiming = UNSET,
        /// Data timing in manual mode (:29 to :32).
        manual_data: BitTiming = UNSET,
        /// Elements in the Message RAM (:61 to :73).
        ram: MessageRamLayout = MessageRamLayout::fd(),
    }
    const MCAN_CHANNEL =
        Object::family(0x8001, 4, 1, "MCAN Channel Config", "13.4", McanChannelConfig::ENTRIES)
            .applied_by(1, 2)
            .saved_except(&[43, 44, 45, 46, 50, 51, 52, 53, 54, 56, 57, 58, 59, 60]);
    entries {
        entry(Entry::highest(87));
        entry(Entry::wo(1, "Apply command", U8).default(0).values(&[(0, "no-op"), (1, "apply")])
            .range(0, 1));
        entry(Entry::ro(2, "Apply status", U8).default(0).values(ApplyStatus::VALUES));
        entry(Entry::wo(3, "Flash command", U8).default(0).range(0, 7).result_after(4, 5)
            .bits(&[(0, "save"), (1, "load"), (2, "factory reset")]));
        entry(Entry::ro(4, "Flash status", U8).default(0).values(ApplyStatus::VALUES));
        entry(Entry::ro(5, "Command sequence", U32).default(0));
        entry(Entry::ro(6, "Command Pad0", U32).default(0));
        /// Source of the bit timing (:07).
        7 "Bit timing mode" bit_timing_mode: BitTimingMode = BitTimingMode::Automatic,
            key("bit_timing");
        /// Participation of the channel in the bus (:08).
        8 "Node mode" node_mode: NodeMode = NodeMode::Normal;
        /// CAN FD as Bosch defined it before ISO 11898-1:2015 (:09).
        9 "Non-ISO enable" non_iso: bool = false;
        /// Pause of two bits between two transmissions (:10).
        10 "Transmit pause" transmit_pause: bool = false;
        /// Two quanta are needed for an edge during bus integration (:11).
        11 "Edge filter enable" edge_filter: bool = false;
        /// No protocol exception handling (:12).
        12 "Protocol exception disable" protocol_exception_disable: bool = false;
        /// Message markers of 16 bits (:13).
        13 "Wide message marker enable" wide_message_marker: bool = false;
        /// Timestamps from an external source (:14).
        14 "External timestamp use" external_timestamp: bool = false;
        /// CAN FD; otherwise classic CAN (:15).
        15 "FD enable" fd: bool = true, no_key();
        /// Transmitter delay compensation (:16); from 5 Mbit/s it is always active.
        16 "TDC enable" tdc: bool = true, needs(&[15]);
        /// Control of restricted operation mode (:17).
        17 "Restricted mode disable" restricted_mode_disable: bool = false;
        /// A frame that failed is not sent again (:18).
        18 "Disable auto retransmission" disable_auto_retransmission: bool = false;
        /// Bit rate of arbitration and of classic frames, bit/s (:19).
        19 "Nominal bitrate" nominal_bitrate: u32 = 500_000,
            range(1, 1_000_000), unit("bit/s"), key("bitrate");
        /// Bit rate of the data phase, bit/s (:20).
        20 "Data bitrate" data_bitrate: u32 = 5_000_000,
            range(1, u32::MAX), unit("bit/s"), needs(&[15]);
        part 21 "Nominal SP min" nominal_sample_point.min: u16,
            range(0, 1000), unit("0.1 %"), key("sample_point"), form(KeyForm::LowerBound);
        part 22 "Nominal SP max" nominal_sample_point.max: u16,
            range(0, 1000), unit("0.1 %"), key("sample_point"), form(KeyForm::UpperBound);
        part 23 "Data SP min" data_sample_point.min: u16,
            range(0, 1000), unit("0.1 %"), key("data_sample_point"), form(KeyForm::LowerBound),
            needs(&[15]);
        part 24 "Data SP max" data_sample_point.max: u16,
            range(0, 1000), unit("0.1 %"), key("data_sample_point"), form(KeyForm::UpperBound),
            needs(&[15]);
        part 25 "Nominal BRP" manual_nominal.brp: u16,
            range(0, 512), key("nominal_timing.brp"), needs(&[7]);
        part 26 "Nominal TSEG1" manual_nominal.tseg1: u8,
            range(0, 255), key("nominal_timing.tseg1"), needs(&[7]);
        part 27 "Nominal TSEG2" manual_nominal.tseg2: u8,
            range(0, 128), key("nominal_timing.tseg2"), needs(&[7]);
        part 28 "Nominal SJW" manual_nominal.sjw: u8,
            range(0, 128), key("nominal_timing.sjw"), needs(&[7]);
        part 29 "Data BRP" manual_data.brp: u16,
            range(0, 32), key("data_timing.brp"), needs(&[15, 7]);
        part 30 "Data TSEG1" manual_data.tseg1: u8,
            range(0, 32), key("data_timing.tseg1"), needs(&[15, 7]);
        part 31 "Data TSEG2" manual_data.tseg2: u8,
            range(0, 16), key("data_timing.tseg2"), needs(&[15, 7]);
        part 32 "Data SJW" manual_data.sjw: u8,
            range(0, 16), key("data_timing.sjw"), needs(&[15, 7]);
        /// Offset of the delay compensation in clock periods, 0 to 127 (:33); 0 is automatic.
        33 "TDC offset" tdc_offset: u8 = 0, range(0, 127), unit("mtq"), needs(&[15]);
        /// Filter window of the delay compensation in clock periods, 0 to 127 (:34); 0 is automatic.
        34 "TDC filter" tdc_filter: u8 = 0, range(0, 127), unit("mtq"), needs(&[15]);
        /// Action on standard frames that no filter matches (:36).
        36 "Accept non-match std" non_match_standard: NonMatch = NonMatch::Fifo0;
        /// Action on extended frames that no filter matches (:37).
        37 "Accept non-match ext" non_match_extended: NonMatch = NonMatch::Fifo0;
        /// Reject standard remote frames (:38).
        38 "Reject remote std" reject_remote_standard: bool = false;
        /// Reject extended remote frames (:39).
        39 "Reject remote ext" reject_remote_extended: bool = false;
        /// Mask over extended CAN IDs before filtering (:40).
        40 "Ext ID mask" extended_id_mask: u32 = 0x1FFF_FFFF, range(0, 0x1FFF_FFFF);
        entry(Entry::ro(41, "Std list max", U8).default(64));
        entry(Entry::ro(42, "Ext list max", U8).default(24));
        entry(Entry::rw(43, "Std current index", U8).default(0).range(0, 63));
        entry(Entry::rw(44, "Ext current index", U8).default(0).range(0, 23));
        entry(filter::<FilterCommand>(45, "Std entry cmd").result(47));
        entry(filter::<FilterCommand>(46, "Ext entry cmd").result(48));
        entry(Entry::ro(47, "Std entry status", U8).default(0).values(FilterCommandStatus::VALUES));
        entry(Entry::ro(48, "Ext entry status", U8).default(0).values(FilterCommandStatus::VALUES));
        entry(Entry::rw(49, "Std filter count", U8).default(0).range(0, 64));
        entry(filter::<StandardMatch>(50, "Std filter type"));
        entry(Entry::rw(51, "Std filter action", U8).default(0).range(0, 7)
            .values(FilterAction::VALUES).form(KeyForm::Word));
        entry(filter::<bool>(52, "Std filter sync"));
        entry(Entry::rw(53, "Std ID1", U32).default(0).range(0, 0x7FF));
        entry(Entry::rw(54, "Std ID2", U32).default(0).range(0, 0x7FF));
        entry(Entry::rw(55, "Ext filter count", U8).default(0).range(0, 24));
        entry(filter::<ExtendedMatch>(56, "Ext filter type"));
        entry(Entry::rw(57, "Ext filter action", U8).default(0).range(0, 7)
            .values(FilterAction::VALUES).form(KeyForm::Word));
        entry(filter::<bool>(58, "Ext filter sync"));
        entry(Entry::rw(59, "Ext ID1", U32).default(0).range(0, 0x1FFF_FFFF));
        entry(Entry::rw(60, "Ext ID2", U32).default(0).range(0, 0x1FFF_FFFF));
        part 61 "RX FIFO0 op mode" ram.rx_fifo0.mode: FifoMode, key("ram.rx_fifo0_mode");
        part 62 "RX FIFO0 size" ram.rx_fifo0.size: u8,
            range(0, 64), unit("elements"), key("ram.rx_fifo0_size");
        part 63 "RX FIFO1 op mode" ram.rx_fifo1.mode: FifoMode, key("ram.rx_fifo1_mode");
        part 64 "RX FIFO1 size" ram.rx_fifo1.size: u8,
            range(0, 64), unit("elements"), key("ram.rx_fifo1_size");
        part 65 "RX FIFO0 data size" ram.rx_fifo0.data_size: DataSize,
            key("ram.rx_fifo0_data_bytes");
        part 66 "RX FIFO1 data size" ram.rx_fifo1.data_size: DataSize,
            key("ram.rx_fifo1_data_bytes");
        part 67 "RX buffer count" ram.rx_buffer_count: u8,
            range(0, 64), unit("elements"), key("ram.rx_buffer_count");
        part 68 "RX buffer data size" ram.rx_buffer_data_size: DataSize,
            key("ram.rx_buffer_data_bytes");
        part 69 "TX FIFO queue mode" ram.tx_mode: TxMode, key("ram.tx_mode");
        part 70 "TX FIFO queue size" ram.tx_fifo_size: u8,
            range(0, 32), unit("elements"), key("ram.tx_fifo_size");
        part 71 "TX dedicated buffer count" ram.tx_dedicated_count: u8,
            range(0, 32), unit("elements"), key("ram.tx_dedicated_count");
        part 72 "TX buffer data size" ram.tx_data_size: DataSize, key("ram.tx_data_bytes");
        part 73 "TX event FIFO size" ram.tx_event_size: u8,
            range(0, 32), unit("elements"), key("ram.tx_event_size");
        /// Timestamp selection, 0 to 2 (:74).
        74 "Timestamp selection" timestamp_selection: u8 = 0, range(0, 2);
        /// Timestamp prescaler (:75).
        75 "Timestamp prescaler" timestamp_prescaler: u8 = 0;
        /// Timestamp unit, TSU (:76).
        76 "TSU enable" tsu: bool = false;
        /// The TSU counts an external time base (:77).
        77 "TSU use external timebase" tsu_external_timebase: bool = false, needs(&[76]);
        /// The TSU captures at the start of the frame; otherwise at the end (:78).
        78 "TSU capture on SOF" tsu_capture_sof: bool = false, needs(&[76]);
        /// The TSU counts 64 bits (:79).
        79 "TSU enable 64-bit" tsu_64_bit: bool = false, needs(&[76]);
        entry(Entry::ro(80, "Pad2", U8).default(0));
        /// TSU prescaler, at least 1 (:81).
        81 "TSU prescaler" tsu_prescaler: u16 = 1, range(1, 0xFFFF), needs(&[76]);
        /// Source of the external time base (:82).
        82 "TSU external timebase source" tsu_timebase_source: u8 = 0, needs(&[76]);
        /// TBSEL option (:83).
        83 "TSU TBSEL option" tsu_tbsel: u8 = 0, needs(&[76]);
        /// Timeout counter (:84).
        84 "Timeout enable" timeout: bool = false;
        /// Selection of the timeout counter, 0 to 3 (:85).
        85 "Timeout select" timeout_select: u8 = 0, range(0, 3), needs(&[84]);
        entry(Entry::ro(86, "Pad3", U16).default(0));
        /// Timeout period (:87).
        87 "Timeout period" timeout_period: u16 = 0, needs(&[84]);
    }
}

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
