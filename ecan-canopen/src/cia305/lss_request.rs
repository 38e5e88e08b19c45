//! Frames of the LSS master, CAN ID 0x7E5 (CiA 305).

use super::UNCONFIGURED_NODE_ID;
use super::lss_address::LssPart;
use super::lss_bit_rate::LssBitRate;
use crate::NodeId;

ecan_protocol::text_enum! {
    /// Part of an [`LssAddressRange`](crate::LssAddressRange); the number is the command specifier.
    pub enum RangePart: u8;
    /// Vendor-ID.
    Vendor = 0x46, "vendor-ID";
    /// Product code.
    Product = 0x47, "product code";
    /// Lowest revision number.
    RevisionLow = 0x48, "lowest revision number";
    /// Highest revision number.
    RevisionHigh = 0x49, "highest revision number";
    /// Lowest serial number.
    SerialLow = 0x4A, "lowest serial number";
    /// Highest serial number; the last frame of the request.
    SerialHigh = 0x4B, "highest serial number";
}

/// Frame of the LSS master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LssRequest {
    /// Switches all slaves to the configuration state or to the waiting state. No response.
    SwitchGlobal {
        /// True for the configuration state.
        configuration: bool,
    },
    /// One of four frames that switch the slave with this LSS address to the configuration state. The slave
    /// responds to the serial number.
    SwitchSelective {
        /// Part of the address.
        part: LssPart,
        /// Its value.
        value: u32,
    },
    /// Configures the pending node-ID.
    ConfigureNodeId {
        /// Node-ID, 1 to 127, or 255 for none. A slave rejects other values.
        node: u8,
    },
    /// Configures the pending bit timing.
    ConfigureBitTiming {
        /// Table; 0 is the table of CiA.
        table: u8,
        /// Entry of the table.
        entry: u8,
    },
    /// Activates the pending bit timing. No response.
    ActivateBitTiming {
        /// Time from this frame to the switch, and from the switch to the first frame, in milliseconds.
        delay_ms: u16,
    },
    /// Stores the pending node-ID and bit timing.
    Store,
    /// One of six frames that search slaves by a range of addresses. Slaves in the range respond to the
    /// last one.
    IdentifyRemote {
        /// Part of the range.
        part: RangePart,
        /// Its value.
        value: u32,
    },
    /// Searches slaves without node-ID.
    IdentifyNonConfigured,
    /// Compares the leading bits of a part of the address with all slaves without node-ID.
    Fastscan {
        /// Value to compare.
        value: u32,
        /// Lowest bit that is compared, 0 to 31; 128 starts a scan.
        bit_check: u8,
        /// Part of the address.
        part: LssPart,
        /// Part of the next frame; if it is a lower one and all bits match, the slave enters the configuration
        /// state.
        next: LssPart,
    },
    /// Reads a part of the address.
    Inquire(LssPart),
    /// Reads the node-ID.
    InquireNodeId,
}

const SWITCH_GLOBAL: u8 = 0x04;
const CONFIGURE_NODE_ID: u8 = 0x11;
const CONFIGURE_BIT_TIMING: u8 = 0x13;
const ACTIVATE_BIT_TIMING: u8 = 0x15;
const STORE: u8 = 0x17;
const SWITCH_SELECTIVE: u8 = 0x40;
const IDENTIFY_NON_CONFIGURED: u8 = 0x4C;
const FASTSCAN: u8 = 0x51;
const INQUIRE: u8 = 0x5A;
const INQUIRE_NODE_ID: u8 = 0x5E;

impl LssRequest {
    /// `bit_check` of the frame that starts a fastscan.
    pub const FASTSCAN_START: u8 = 128;

    /// Configures a node-ID, or none.
    pub const fn node_id(node: Option<NodeId>) -> Self {
        let node = match node {
            Some(node) => node.get(),
            None => UNCONFIGURED_NODE_ID,
        };
        Self::ConfigureNodeId { node }
    }

    /// Configures a bit rate of the table of CiA.
    pub const fn bit_rate(bit_rate: LssBitRate) -> Self {
        Self::ConfigureBitTiming { table: LssBitRate::TABLE, entry: bit_rate.raw() }
    }

    /// The data of the CAN frame.
    pub const fn to_bytes(self) -> [u8; 8] {
        match self {
            Self::SwitchGlobal { configuration } => short(SWITCH_GLOBAL, configuration as u8, 0),
            Self::SwitchSelective { part, value } => long(SWITCH_SELECTIVE + part.raw(), value),
            Self::ConfigureNodeId { node } => short(CONFIGURE_NODE_ID, node, 0),
            Self::ConfigureBitTiming { table, entry } => short(CONFIGURE_BIT_TIMING, table, entry),
            Self::ActivateBitTiming { delay_ms } => {
                let [low, high] = delay_ms.to_le_bytes();
                short(ACTIVATE_BIT_TIMING, low, high)
            }
            Self::Store => short(STORE, 0, 0),
            Self::IdentifyRemote { part, value } => long(part.raw(), value),
            Self::IdentifyNonConfigured => short(IDENTIFY_NON_CONFIGURED, 0, 0),
            Self::Fastscan { value, bit_check, part, next } => {
                let [a, b, c, d] = value.to_le_bytes();
                [FASTSCAN, a, b, c, d, bit_check, part.raw(), next.raw()]
            }
            Self::Inquire(part) => short(INQUIRE + part.raw(), 0, 0),
            Self::InquireNodeId => short(INQUIRE_NODE_ID, 0, 0),
        }
    }

    /// Reads the data of a CAN frame; `None` for anything that is not a request of CiA 305. Reserved bytes are
    /// ignored.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[command, a, b, c, d, e, f, g] = data else { return None };
        let value = u32::from_le_bytes([a, b, c, d]);
        Some(match command {
            SWITCH_GLOBAL if a <= 1 => Self::SwitchGlobal { configuration: a == 1 },
            SWITCH_SELECTIVE..=0x43 => Self::SwitchSelective {
                part: LssPart::from_raw(command - SWITCH_SELECTIVE)?,
                value,
            },
            CONFIGURE_NODE_ID => Self::ConfigureNodeId { node: a },
            CONFIGURE_BIT_TIMING => Self::ConfigureBitTiming { table: a, entry: b },
            ACTIVATE_BIT_TIMING => Self::ActivateBitTiming { delay_ms: u16::from_le_bytes([a, b]) },
            STORE => Self::Store,
            IDENTIFY_NON_CONFIGURED => Self::IdentifyNonConfigured,
            FASTSCAN if e < 32 || e == Self::FASTSCAN_START => Self::Fastscan {
                value,
                bit_check: e,
                part: LssPart::from_raw(f)?,
                next: LssPart::from_raw(g)?,
            },
            INQUIRE..=0x5D => Self::Inquire(LssPart::from_raw(command - INQUIRE)?),
            INQUIRE_NODE_ID => Self::InquireNodeId,
            _ => Self::IdentifyRemote { part: RangePart::from_raw(command)?, value },
        })
    }
}

const fn short(command: u8, first: u8, second: u8) -> [u8; 8] {
    [command, first, second, 0, 0, 0, 0, 0]
}

const fn long(command: u8, value: u32) -> [u8; 8] {
    let [a, b, c, d] = value.to_le_bytes();
    [command, a, b, c, d, 0, 0, 0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bytes from the tables of CiA 305.
    #[test]
    fn requests_have_the_bytes_of_cia_305() {
        use LssPart::{Product, Revision, Serial, Vendor};
        use LssRequest as R;
        let value = 0x1234_5678;
        let golden = [
            (R::SwitchGlobal { configuration: true }, [0x04, 1, 0, 0, 0, 0, 0, 0]),
            (R::SwitchGlobal { configuration: false }, [0x04, 0, 0, 0, 0, 0, 0, 0]),
            (R::SwitchSelective { part: Vendor, value }, [0x40, 0x78, 0x56, 0x34, 0x12, 0, 0, 0]),
            (R::SwitchSelective { part: Product, value }, [0x41, 0x78, 0x56, 0x34, 0x12, 0, 0, 0]),
            (R::SwitchSelective { part: Revision, value: 1 }, [0x42, 1, 0, 0, 0, 0, 0, 0]),
            (R::SwitchSelective { part: Serial, value: 1 }, [0x43, 1, 0, 0, 0, 0, 0, 0]),
            (R::node_id(NodeId::new(5)), [0x11, 5, 0, 0, 0, 0, 0, 0]),
            (R::node_id(None), [0x11, 0xFF, 0, 0, 0, 0, 0, 0]),
            (R::bit_rate(LssBitRate::Rate250k), [0x13, 0, 3, 0, 0, 0, 0, 0]),
            (R::ActivateBitTiming { delay_ms: 0x0102 }, [0x15, 2, 1, 0, 0, 0, 0, 0]),
            (R::Store, [0x17, 0, 0, 0, 0, 0, 0, 0]),
            (
                R::IdentifyRemote { part: RangePart::Vendor, value },
                [0x46, 0x78, 0x56, 0x34, 0x12, 0, 0, 0],
            ),
            (
                R::IdentifyRemote { part: RangePart::SerialHigh, value: u32::MAX },
                [0x4B, 0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0],
            ),
            (R::IdentifyNonConfigured, [0x4C, 0, 0, 0, 0, 0, 0, 0]),
            (
                R::Fastscan { value, bit_check: 31, part: Product, next: Revision },
                [0x51, 0x78, 0x56, 0x34, 0x12, 31, 1, 2],
            ),
            (
                R::Fastscan { value: 0, bit_check: 128, part: Vendor, next: Vendor },
                [0x51, 0, 0, 0, 0, 0x80, 0, 0],
            ),
            (R::Inquire(Vendor), [0x5A, 0, 0, 0, 0, 0, 0, 0]),
            (R::Inquire(Serial), [0x5D, 0, 0, 0, 0, 0, 0, 0]),
            (R::InquireNodeId, [0x5E, 0, 0, 0, 0, 0, 0, 0]),
        ];
        for (request, bytes) in golden {
            assert_eq!(request.to_bytes(), bytes, "{request:?}");
            assert_eq!(R::parse(&bytes), Some(request));
        }
    }

    #[test]
    fn frames_outside_cia_305_are_not_requests() {
        for bytes in [
            [0x04, 2, 0, 0, 0, 0, 0, 0],
            [0x44, 0, 0, 0, 0, 0, 0, 0],
            [0x51, 0, 0, 0, 0, 32, 0, 0],
            [0x51, 0, 0, 0, 0, 1, 4, 0],
            [0x51, 0, 0, 0, 0, 1, 0, 4],
            [0; 8],
        ] {
            assert_eq!(LssRequest::parse(&bytes), None, "{bytes:X?}");
        }
        assert_eq!(LssRequest::parse(&[0x17; 7]), None);
        assert_eq!(LssRequest::parse(&[]), None);
    }

    proptest! {
        /// A parsed request has the same bytes again, apart from reserved ones.
        #[test]
        fn any_data_is_parsed_or_rejected(data in proptest::collection::vec(any::<u8>(), 0..=9)) {
            if let Some(request) = LssRequest::parse(&data) {
                prop_assert_eq!(LssRequest::parse(&request.to_bytes()), Some(request));
                prop_assert_eq!(request.to_bytes()[0], data[0]);
            }
        }
    }
}
