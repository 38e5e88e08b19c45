//! LSS address: the identity of a device (CiA 305, object 0x1018 of CiA 301).

use core::fmt;

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

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

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
}
