//! Profile of an image, its faults and the channel status in it, as C has them.

use std::ffi::c_int;

use ecan_protocol::image::{
    BudgetPolicy, ChannelStatus, EncapsulationProfile, ImageFault, OptionFlags, ParseDiagnosis,
    PdoError, PdoProfile, ProfileError,
};
use ecan_protocol::mapping::Direction;

use crate::result::ecan_result_t;
use crate::{Call, ToResult, mirror};

// Section: PDO profiles

/// Direction of an image, as the slave sees it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_direction_t {
    /// Master to slave.
    IGH_MCAN_RXPDO = 0,
    /// Slave to master.
    IGH_MCAN_TXPDO = 1,
}

/// Encapsulation profile: the format of the packets (manual 9).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_encapsulation_t {
    /// Data length by DLC, no timestamp. The device default.
    IGH_MCAN_ENCAPSULATION_COMPACT = 0,
    /// Data length by DLC, timestamps allowed.
    IGH_MCAN_ENCAPSULATION_COMPACT_TIMESTAMPED = 1,
    /// 64-byte data windows allowed, no timestamp.
    IGH_MCAN_ENCAPSULATION_WINDOW64 = 4,
    /// 64-byte data windows and timestamps allowed.
    IGH_MCAN_ENCAPSULATION_WINDOW64_TIMESTAMPED = 5,
}

/// Budget policy: how channels share an image (manual 12).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_budget_t {
    /// A small reserve for each channel, the rest shared. The device default.
    IGH_MCAN_BUDGET_BALANCED = 0,
    /// No reserve, everything shared.
    IGH_MCAN_BUDGET_SHARED_ONLY = 1,
    /// Equal parts for each enabled channel, without borrowing.
    IGH_MCAN_BUDGET_DETERMINISTIC = 2,
}

/// Option: the gateway reports the result of each transmission (manual 9.1, 10). TxPDO only.
pub const IGH_MCAN_OPTION_TX_RESULT: u8 = 0x01;
/// Option: packets are padded to 4 bytes.
pub const IGH_MCAN_OPTION_ALIGN4: u8 = 0x02;
/// Option: no CRC. For performance tests.
pub const IGH_MCAN_OPTION_NO_CRC16: u8 = 0x04;
/// Option: the CAN side is disconnected. For tests.
pub const IGH_MCAN_OPTION_APP_BYPASS: u8 = 0x08;
/// Option: bytes after the payload keep their old content.
pub const IGH_MCAN_OPTION_PAYLOAD_ONLY: u8 = 0x10;

/// The PDO profile of one direction, 0x8010:03..07 or 0x8011:03..07 (manual 13.2).
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_pdo_profile_t {
    /// An igh_mcan_direction_t.
    pub direction: u8,
    /// PDO size multiplier N, 1 to 24: the image has 128 times as many bytes.
    pub multiplier: u8,
    /// Enabled channels, bit 0 for channel 0.
    pub channel_mask: u8,
    /// An igh_mcan_encapsulation_t.
    pub encapsulation: u8,
    /// An igh_mcan_budget_t.
    pub budget: u8,
    /// IGH_MCAN_OPTION_ values.
    pub options: u8,
    /// Must be 0; for fields of later versions.
    pub reserved: [u8; 10],
}

impl ToResult for ProfileError {
    fn result(&self) -> ecan_result_t {
        ecan_result_t::ECAN_ERR_CONFIG
    }
}

/// Encapsulation profile of a number, or `ECAN_ERR_ARGUMENT`.
pub fn encapsulation(call: Call, raw: c_int) -> Result<EncapsulationProfile, ecan_result_t> {
    let profile = u8::try_from(raw).ok().and_then(EncapsulationProfile::from_raw);
    profile.ok_or_else(|| {
        call.argument("encapsulation", format_args!("{raw} is invalid; allowed: 0, 1, 4, 5"))
    })
}

/// Budget policy of a number, or `ECAN_ERR_ARGUMENT`.
pub fn budget(call: Call, raw: c_int) -> Result<BudgetPolicy, ecan_result_t> {
    let policy = u8::try_from(raw).ok().and_then(BudgetPolicy::from_raw);
    policy.ok_or_else(|| {
        call.argument("budget", format_args!("{raw} is out of range; allowed: 0 to 2"))
    })
}

/// Options of their bits, or `ECAN_ERR_ARGUMENT`.
pub fn options(call: Call, bits: u8) -> Result<OptionFlags, ecan_result_t> {
    OptionFlags::from_bits(bits)
        .ok_or_else(|| call.argument("options", format_args!("0x{bits:02X} has reserved bits")))
}

impl igh_mcan_pdo_profile_t {
    /// Profile that C describes, or the first fault.
    pub fn checked(&self, call: Call) -> Result<(Direction, PdoProfile), ecan_result_t> {
        call.reserved("profile", &self.reserved)?;
        let direction = match self.direction {
            0 => Direction::RxPdo,
            1 => Direction::TxPdo,
            other => {
                return Err(
                    call.argument("direction", format_args!("{other} is invalid; allowed: 0, 1"))
                );
            }
        };
        let profile = PdoProfile {
            multiplier: self.multiplier,
            channel_mask: self.channel_mask,
            profile: encapsulation(call, self.encapsulation.into())?,
            budget: budget(call, self.budget.into())?,
            options: options(call, self.options)?,
        };
        profile.check(direction).map_err(|error| call.error(&error))?;
        Ok((direction, profile))
    }

    /// Converts a profile for C.
    pub fn new(direction: Direction, profile: &PdoProfile) -> Self {
        Self {
            direction: u8::from(direction == Direction::TxPdo),
            multiplier: profile.multiplier,
            channel_mask: profile.channel_mask,
            encapsulation: profile.profile.raw(),
            budget: profile.budget.raw(),
            options: profile.options.bits(),
            reserved: [0; 10],
        }
    }
}

// Section: Faults of an image

/// Errors of the encapsulation layer, as 0x8010:14 and 0x8011:14 report them (manual 13.2), and two
/// for an image that was read while it was written.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_pdo_error_t {
    /// No error.
    IGH_MCAN_PDO_OK = 0,
    /// A frame exceeds what the profile can carry.
    IGH_MCAN_PDO_FRAME_OVERRUN = 2,
    /// A packet exceeds the frame area.
    IGH_MCAN_PDO_PACKET_OVERRUN = 3,
    /// A packet of unknown kind.
    IGH_MCAN_PDO_UNKNOWN_KIND = 4,
    /// The DLC breaks the rules.
    IGH_MCAN_PDO_INVALID_DLC = 5,
    /// The channel does not exist or is not in the mask.
    IGH_MCAN_PDO_INVALID_CHANNEL = 6,
    /// The timestamp format does not belong to profile or direction.
    IGH_MCAN_PDO_INVALID_TSF = 7,
    /// The payload ends inside a packet.
    IGH_MCAN_PDO_TRUNCATED = 8,
    /// The encapsulation profile is not supported.
    IGH_MCAN_PDO_UNSUPPORTED_PROFILE = 9,
    /// The image is the one before, received again.
    IGH_MCAN_PDO_DUPLICATE_SEQUENCE = 10,
    /// An option is not supported.
    IGH_MCAN_PDO_UNSUPPORTED_OPTION = 11,
    /// Frame area and mapping disagree, or the buffer is too small.
    IGH_MCAN_PDO_ACTIVE_AREA = 12,
    /// A reserved bit is set.
    IGH_MCAN_PDO_RESERVED_BIT = 13,
    /// Version, length or another field of the header is illegal.
    IGH_MCAN_PDO_BAD_HEADER = 14,
    /// The CRC does not match.
    IGH_MCAN_PDO_BAD_CRC = 15,
    /// The schedule record is illegal.
    IGH_MCAN_PDO_BAD_SCHEDULE = 16,
    /// The image was being written: its sequence numbers differ. Skip it in this cycle.
    IGH_MCAN_PDO_UPDATING = 256,
    /// The header changed while the image was read. Skip it in this cycle.
    IGH_MCAN_PDO_TORN = 257,
    /// layout_id is not that of the profile; the frames are valid.
    IGH_MCAN_PDO_LAYOUT = 258,
}

mirror! {
    /// Fault of an image and its location, with the fields that the manual demands (16.2). Fields
    /// that do not apply are 0.
    #[derive(Default)]
    pub struct igh_mcan_pdo_parse_diag_t from diagnosis: &ParseDiagnosis {
        /// An igh_mcan_pdo_error_t; 0 for no fault.
        error: u16 = match diagnosis.fault {
            ImageFault::Updating => igh_mcan_pdo_error_t::IGH_MCAN_PDO_UPDATING as u16,
            ImageFault::Torn => igh_mcan_pdo_error_t::IGH_MCAN_PDO_TORN as u16,
            ImageFault::Pdo(error) => error.raw(),
        },
        /// Offset in the image where the faulty packet starts, in bytes; 0 for the header.
        offset: u16,
        /// Offset after that packet, padding included, if it is known.
        packet_end: u16,
        /// Control word of the packet.
        ctrl: u16,
        /// Sequence number of the image.
        seq: u16 = diagnosis.sequence,
        /// payload_len of the header.
        payload_len: u16,
        /// payload_crc16 of the header.
        payload_crc16: u16,
        /// CRC of the payload as received.
        computed_crc16: u16,
        /// layout_id of the header.
        layout_id: u16,
        /// Channel of the packet.
        ch: u8 = diagnosis.channel,
        /// DLC of the packet.
        dlc: u8,
        /// Timestamp format of the packet.
        tsf: u8,
        /// Kind of the packet.
        kind: u8,
        /// Zero; for fields of later versions.
        reserved: [u8; 10] = [0; 10],
    }
}

impl igh_mcan_pdo_parse_diag_t {
    /// Diagnosis of the layers below; `None` for an unknown error.
    pub fn to_diagnosis(self) -> Option<ParseDiagnosis> {
        let fault = match self.error {
            256 => ImageFault::Updating,
            257 => ImageFault::Torn,
            raw => ImageFault::Pdo(PdoError::from_raw(raw)?),
        };
        Some(ParseDiagnosis {
            fault,
            offset: self.offset,
            packet_end: self.packet_end,
            ctrl: self.ctrl,
            sequence: self.seq,
            payload_len: self.payload_len,
            payload_crc16: self.payload_crc16,
            computed_crc16: self.computed_crc16,
            layout_id: self.layout_id,
            channel: self.ch,
            dlc: self.dlc,
            tsf: self.tsf,
            kind: self.kind,
        })
    }
}

impl ToResult for ParseDiagnosis {
    fn result(&self) -> ecan_result_t {
        match self.fault {
            ImageFault::Updating | ImageFault::Torn => ecan_result_t::ECAN_ERR_IMAGE_BUSY,
            ImageFault::Pdo(PdoError::ActiveArea) => ecan_result_t::ECAN_ERR_BUFFER,
            ImageFault::Pdo(_) => ecan_result_t::ECAN_ERR_PARSE,
        }
    }
}

// Section: Channel status

/// State of a CAN channel (manual 7). The device may report other values.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_state_t {
    /// The channel is not enabled.
    IGH_MCAN_STATE_DISABLED = 0,
    /// Being initialised.
    IGH_MCAN_STATE_INIT = 1,
    /// Takes part in the bus.
    IGH_MCAN_STATE_RUN = 2,
    /// Off the bus after too many errors.
    IGH_MCAN_STATE_BUS_OFF = 3,
    /// In error.
    IGH_MCAN_STATE_ERROR = 4,
    /// Listens without sending or acknowledging.
    IGH_MCAN_STATE_LISTEN = 5,
}

mirror! {
    /// Status of a channel, as the TxPDO header carries it (manual 7). Flags are 0 or 1.
    #[derive(Default)]
    pub struct igh_mcan_channel_status_t from status: ChannelStatus {
        /// The word as transmitted.
        raw: u16 = status.raw(),
        /// An igh_mcan_state_t.
        state: u8 = status.state().raw(),
        /// CAN FD is enabled.
        fd_enabled: u8 = status.fd_enabled().into(),
        /// Error warning, error passive or degraded bus.
        warn: u8 = status.warn().into(),
        /// Off the bus.
        bus_off: u8 = status.bus_off().into(),
        /// The receive cache is filling up.
        rx_pressure: u8 = status.rx_pressure().into(),
        /// The transmit queue is filling up.
        tx_pressure: u8 = status.tx_pressure().into(),
        /// The channel's diagnostic object has new content.
        detail_pending: u8 = status.detail_pending().into(),
        /// A counter has reached its maximum.
        counter_saturated: u8 = status.counter_sat().into(),
        /// Received frames that wait, as a coarse figure: 0 to 7.
        rx_pending: u8 = status.rx_pending(),
        /// Frames that wait to be sent, as a coarse figure: 0 to 7.
        tx_pending: u8 = status.tx_pending(),
        /// Zero; for fields of later versions.
        reserved: [u8; 4] = [0; 4],
    }
}
