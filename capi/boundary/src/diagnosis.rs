//! Faults of an image

use ecan_protocol::image::{ImageFault, ParseDiagnosis, PdoError};

use crate::result::ecan_result_t;
use crate::{ToResult, mirror};

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
    /// The same image again.
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
