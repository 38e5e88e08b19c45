//! LSS frames of master (CAN ID 0x7E5) and slave (0x7E4), addresses and bit rates (CiA 305).

use core::fmt;

use super::UNCONFIGURED_NODE_ID;
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

ecan_protocol::text_enum! {
    /// Part of an LSS address; the number is LSSSub of fastscan, and the subindex of 0x1018 minus 1.
    pub enum LssPart: u8;
    /// Vendor-ID.
    Vendor = 0, "vendor-ID";
    /// Product code.
    Product = 1, "product code";
    /// Revision number.
    Revision = 2, "revision number";
    /// Serial number.
    Serial = 3, "serial number";
}

impl LssPart {
    /// The part after this one; after the serial number the vendor-ID, which ends a fastscan.
    pub const fn next(self) -> Self {
        match self {
            Self::Vendor => Self::Product,
            Self::Product => Self::Revision,
            Self::Revision => Self::Serial,
            Self::Serial => Self::Vendor,
        }
    }
}

/// LSS address of a device: its identity object 0x1018. No two devices have the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct LssAddress {
    /// Vendor-ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision number.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
}

impl LssAddress {
    /// Value of one part.
    pub const fn part(&self, part: LssPart) -> u32 {
        match part {
            LssPart::Vendor => self.vendor,
            LssPart::Product => self.product,
            LssPart::Revision => self.revision,
            LssPart::Serial => self.serial,
        }
    }

    /// Changes one part.
    pub const fn set_part(&mut self, part: LssPart, value: u32) {
        match part {
            LssPart::Vendor => self.vendor = value,
            LssPart::Product => self.product = value,
            LssPart::Revision => self.revision = value,
            LssPart::Serial => self.serial = value,
        }
    }
}

/// `vendor-ID 0x53494D00, product code 0x192, revision number 0x10000, serial number 0x1`
impl fmt::Display for LssAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (nth, part) in LssPart::ALL.iter().enumerate() {
            let separator = if nth > 0 { ", " } else { "" };
            write!(f, "{separator}{part} 0x{:X}", self.part(*part))?;
        }
        Ok(())
    }
}

/// Range of LSS addresses of one product, for the service "identify remote slave".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LssAddressRange {
    /// Vendor-ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Lowest and highest revision number.
    pub revision: (u32, u32),
    /// Lowest and highest serial number.
    pub serial: (u32, u32),
}

impl LssAddressRange {
    /// All revisions and serial numbers of a product.
    pub const fn of_product(vendor: u32, product: u32) -> Self {
        Self { vendor, product, revision: (0, u32::MAX), serial: (0, u32::MAX) }
    }

    /// Returns whether the range contains an address.
    pub const fn contains(&self, address: &LssAddress) -> bool {
        self.vendor == address.vendor
            && self.product == address.product
            && self.revision.0 <= address.revision
            && address.revision <= self.revision.1
            && self.serial.0 <= address.serial
            && address.serial <= self.serial.1
    }
}

ecan_protocol::text_enum! {
    /// Entry of the table of bit timings 0, the table of CiA.
    #[derive(PartialOrd, Ord)]
    pub enum LssBitRate: u8;
    /// 1 Mbit/s.
    Rate1000k = 0, "1 Mbit/s";
    /// 800 kbit/s.
    Rate800k = 1, "800 kbit/s";
    /// 500 kbit/s.
    Rate500k = 2, "500 kbit/s";
    /// 250 kbit/s.
    Rate250k = 3, "250 kbit/s";
    /// 125 kbit/s.
    Rate125k = 4, "125 kbit/s";
    /// 50 kbit/s. The number 5 is reserved.
    Rate50k = 6, "50 kbit/s";
    /// 20 kbit/s.
    Rate20k = 7, "20 kbit/s";
    /// 10 kbit/s.
    Rate10k = 8, "10 kbit/s";
    /// Automatic bit rate detection.
    Automatic = 9, "automatic";
}

impl LssBitRate {
    /// Number of the table.
    pub const TABLE: u8 = 0;

    /// Bit rate in bit/s; `None` for automatic detection.
    pub const fn bit_per_s(self) -> Option<u32> {
        Some(match self {
            Self::Rate1000k => 1_000_000,
            Self::Rate800k => 800_000,
            Self::Rate500k => 500_000,
            Self::Rate250k => 250_000,
            Self::Rate125k => 125_000,
            Self::Rate50k => 50_000,
            Self::Rate20k => 20_000,
            Self::Rate10k => 10_000,
            Self::Automatic => return None,
        })
    }

    /// The entry with this bit rate in bit/s; `None` if the table does not have it.
    pub fn from_bit_per_s(bit_per_s: u32) -> Option<Self> {
        Self::ALL.iter().copied().find(|entry| entry.bit_per_s() == Some(bit_per_s))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use proptest::prelude::*;

    use super::*;

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
            (R::node_id(NodeId::from_raw(5)), [0x11, 5, 0, 0, 0, 0, 0, 0]),
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
        fn any_response_is_parsed_or_rejected(data in proptest::collection::vec(any::<u8>(), 0..=9)) {
            if let Some(response) = LssResponse::parse(&data) {
                prop_assert_eq!(LssResponse::parse(&response.to_bytes()), Some(response));
            }
        }
    }

    const ADDRESS: LssAddress = LssAddress { vendor: 1, product: 0xAB, revision: 3, serial: 4 };

    #[test]
    fn parts_have_their_order_and_text() {
        let parts = LssPart::ALL.iter().map(|part| ADDRESS.part(*part));
        assert!(parts.eq([1, 0xAB, 3, 4]));
        assert_eq!(LssPart::Serial.next(), LssPart::Vendor);
        let mut copy = LssAddress::default();
        for part in LssPart::ALL {
            copy.set_part(*part, ADDRESS.part(*part));
        }
        assert_eq!(copy, ADDRESS);
        assert_eq!(
            ADDRESS.to_string(),
            "vendor-ID 0x1, product code 0xAB, revision number 0x3, serial number 0x4"
        );
    }

    #[test]
    fn range_includes_its_limits() {
        let range = LssAddressRange { revision: (3, 5), serial: (2, 4), ..all() };
        assert!(range.contains(&ADDRESS) && all().contains(&ADDRESS));
        for outside in [
            LssAddress { vendor: 2, ..ADDRESS },
            LssAddress { product: 1, ..ADDRESS },
            LssAddress { revision: 2, ..ADDRESS },
            LssAddress { revision: 6, ..ADDRESS },
            LssAddress { serial: 1, ..ADDRESS },
            LssAddress { serial: 5, ..ADDRESS },
        ] {
            assert!(!range.contains(&outside), "{outside}");
        }
    }

    fn all() -> LssAddressRange {
        LssAddressRange::of_product(1, 0xAB)
    }

    #[test]
    fn table_has_the_numbers_of_cia_305() {
        let numbers = [
            (1_000_000, 0),
            (800_000, 1),
            (500_000, 2),
            (250_000, 3),
            (125_000, 4),
            (50_000, 6),
            (20_000, 7),
            (10_000, 8),
        ];
        for (bit_per_s, number) in numbers {
            let entry = LssBitRate::from_bit_per_s(bit_per_s).unwrap();
            assert_eq!((entry.raw(), entry.bit_per_s()), (number, Some(bit_per_s)));
        }
        assert_eq!(LssBitRate::from_raw(5), None);
        assert_eq!(LssBitRate::from_bit_per_s(100_000), None);
        assert_eq!(LssBitRate::Automatic.bit_per_s(), None);
    }
}
