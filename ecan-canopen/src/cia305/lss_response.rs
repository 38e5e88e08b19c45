//! Frames of the LSS slaves, CAN ID 0x7E4 (CiA 305).

use super::lss_address::LssPart;

/// Result of a configuration service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LssConfirmation {
    /// Error code: 0 is success, 255 an error of the manufacturer, the others depend on the service.
    pub error: u8,
    /// Error code of the manufacturer; only with `error` 255.
    pub specific: u8,
}

impl LssConfirmation {
    /// Success.
    pub const OK: Self = Self { error: 0, specific: 0 };
    /// Node-ID out of range, bit timing not supported, or storing not supported.
    pub const UNSUPPORTED: Self = Self { error: 1, specific: 0 };
    /// The storage failed.
    pub const STORAGE: Self = Self { error: 2, specific: 0 };
    /// `error` of a manufacturer's error.
    pub const MANUFACTURER: u8 = 255;
}

/// Frame of an LSS slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LssResponse {
    /// The slave with the LSS address of a selective switch is in the configuration state.
    Selected,
    /// Result of the configuration of the node-ID.
    NodeIdConfigured(LssConfirmation),
    /// Result of the configuration of the bit timing.
    BitTimingConfigured(LssConfirmation),
    /// Result of storing.
    Stored(LssConfirmation),
    /// A slave is in the range of an identification, or matches a fastscan.
    Identified,
    /// A slave has no node-ID.
    NonConfigured,
    /// Part of the address.
    Address {
        /// The part.
        part: LssPart,
        /// Its value.
        value: u32,
    },
    /// Node-ID; 255 if the slave has none.
    NodeId {
        /// The number.
        node: u8,
    },
}

const NODE_ID_CONFIGURED: u8 = 0x11;
const BIT_TIMING_CONFIGURED: u8 = 0x13;
const STORED: u8 = 0x17;
const SELECTED: u8 = 0x44;
const IDENTIFIED: u8 = 0x4F;
const NON_CONFIGURED: u8 = 0x50;
const ADDRESS: u8 = 0x5A;
const NODE_ID: u8 = 0x5E;

impl LssResponse {
    /// The data of the CAN frame.
    pub const fn to_bytes(self) -> [u8; 8] {
        match self {
            Self::Selected => frame(SELECTED, [0; 4]),
            Self::NodeIdConfigured(result) => confirmation(NODE_ID_CONFIGURED, result),
            Self::BitTimingConfigured(result) => confirmation(BIT_TIMING_CONFIGURED, result),
            Self::Stored(result) => confirmation(STORED, result),
            Self::Identified => frame(IDENTIFIED, [0; 4]),
            Self::NonConfigured => frame(NON_CONFIGURED, [0; 4]),
            Self::Address { part, value } => frame(ADDRESS + part.raw(), value.to_le_bytes()),
            Self::NodeId { node } => frame(NODE_ID, [node, 0, 0, 0]),
        }
    }

    /// Reads the data of a CAN frame; `None` for anything that is not a response of CiA 305. Reserved bytes are
    /// ignored.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[command, a, b, c, d, _, _, _] = data else { return None };
        let result = LssConfirmation { error: a, specific: b };
        Some(match command {
            SELECTED => Self::Selected,
            NODE_ID_CONFIGURED => Self::NodeIdConfigured(result),
            BIT_TIMING_CONFIGURED => Self::BitTimingConfigured(result),
            STORED => Self::Stored(result),
            IDENTIFIED => Self::Identified,
            NON_CONFIGURED => Self::NonConfigured,
            ADDRESS..=0x5D => Self::Address {
                part: LssPart::from_raw(command - ADDRESS)?,
                value: u32::from_le_bytes([a, b, c, d]),
            },
            NODE_ID => Self::NodeId { node: a },
            _ => return None,
        })
    }
}

const fn confirmation(command: u8, result: LssConfirmation) -> [u8; 8] {
    frame(command, [result.error, result.specific, 0, 0])
}

const fn frame(command: u8, [a, b, c, d]: [u8; 4]) -> [u8; 8] {
    [command, a, b, c, d, 0, 0, 0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bytes from the tables of CiA 305.
    #[test]
    fn responses_have_the_bytes_of_cia_305() {
        use LssResponse as R;
        let golden = [
            (R::Selected, [0x44, 0, 0, 0, 0, 0, 0, 0]),
            (R::NodeIdConfigured(LssConfirmation::OK), [0x11, 0, 0, 0, 0, 0, 0, 0]),
            (R::NodeIdConfigured(LssConfirmation::UNSUPPORTED), [0x11, 1, 0, 0, 0, 0, 0, 0]),
            (
                R::BitTimingConfigured(LssConfirmation { error: 255, specific: 7 }),
                [0x13, 255, 7, 0, 0, 0, 0, 0],
            ),
            (R::Stored(LssConfirmation::STORAGE), [0x17, 2, 0, 0, 0, 0, 0, 0]),
            (R::Identified, [0x4F, 0, 0, 0, 0, 0, 0, 0]),
            (R::NonConfigured, [0x50, 0, 0, 0, 0, 0, 0, 0]),
            (
                R::Address { part: LssPart::Vendor, value: 0x1234_5678 },
                [0x5A, 0x78, 0x56, 0x34, 0x12, 0, 0, 0],
            ),
            (R::Address { part: LssPart::Serial, value: 9 }, [0x5D, 9, 0, 0, 0, 0, 0, 0]),
            (R::NodeId { node: 255 }, [0x5E, 255, 0, 0, 0, 0, 0, 0]),
        ];
        for (response, bytes) in golden {
            assert_eq!(response.to_bytes(), bytes, "{response:?}");
            assert_eq!(R::parse(&bytes), Some(response));
        }
        assert_eq!(R::parse(&[0x15; 8]), None);
        assert_eq!(R::parse(&[0x44; 7]), None);
    }

    proptest! {
        #[test]
        fn any_data_is_parsed_or_rejected(data in proptest::collection::vec(any::<u8>(), 0..=9)) {
            if let Some(response) = LssResponse::parse(&data) {
                prop_assert_eq!(LssResponse::parse(&response.to_bytes()), Some(response));
            }
        }
    }
}
