//! Checks and SDO downloads of the PDO diagnostic tests (manual 13.2.3).

use crate::object::diagnostic_test::{
    CrcTest, DIAGNOSTIC_TEST, DIAGNOSTIC_TEST_KEY, DiagnosticTest, RxBypass, Sides, TxBypass,
};
use crate::object::{ConfigObject, ObjectType, SdoWrite};

const KEY: u8 = 1;

/// A fault of a test configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DiagnosticFault {
    /// Neither 0 nor the key.
    #[error("invalid test key 0x{0:08X}; allowed: 0 or 0x{DIAGNOSTIC_TEST_KEY:08X}")]
    Key(u32),
    /// A test without the key: the device rejects it.
    #[error("tests need the key 0x{DIAGNOSTIC_TEST_KEY:08X}")]
    Locked,
    /// Bits without a meaning among the TxPDO stages.
    #[error("TxPDO bypass flags 0x{0:08X} are invalid; allowed: the bits of 0x{all:08X}", all = TxBypass::ALL.0)]
    TxBits(u32),
    /// Bits without a meaning among the RxPDO stages.
    #[error("RxPDO bypass flags 0x{0:08X} are invalid; allowed: the bits of 0x{all:08X}", all = RxBypass::ALL.0)]
    RxBits(u32),
}

impl DiagnosticTest {
    /// No test, no key.
    pub const OFF: Self = Self::DEVICE_DEFAULT;

    /// True if no test is selected, with or without key.
    pub fn is_idle(&self) -> bool {
        Self { key: 0, ..*self } == Self::OFF
    }

    /// Returns the downloads. There is no apply command.
    ///
    /// The device rejects a test without key, and key 0 with a test, so the key is written first if
    /// it is set and last if it is 0.
    pub fn writes(&self) -> impl Iterator<Item = SdoWrite> + use<> {
        let key = SdoWrite::new(DIAGNOSTIC_TEST.first, KEY, ObjectType::U32, self.key);
        let tests = self.writes_to(DIAGNOSTIC_TEST.first).filter(|write| write.subindex != KEY);
        let (first, last) = if self.key == 0 { (None, Some(key)) } else { (Some(key), None) };
        first.into_iter().chain(tests).chain(last)
    }

    /// Reads the state of a device; `read` gets a subindex of 0x8030. A number without a meaning
    /// is read as the strongest one (both sides, no CRC).
    ///
    /// # Errors
    /// The first error of `read`.
    pub fn read<E>(mut read: impl FnMut(u8) -> Result<u32, E>) -> Result<Self, E> {
        let sides = |value: u32| Sides::from_raw(value as u8).unwrap_or(Sides::Both);
        Ok(Self {
            key: read(1)?,
            tx_bypass: TxBypass(read(2)?),
            rx_bypass: RxBypass(read(3)?),
            crc: CrcTest::from_raw(read(4)? as u8).unwrap_or(CrcTest::Suppress),
            payload_only: sides(read(5)?),
            app_link_bypass: sides(read(6)?),
        })
    }

    /// Reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(DiagnosticFault)) {
        if self.key != 0 && self.key != DIAGNOSTIC_TEST_KEY {
            report(DiagnosticFault::Key(self.key));
        }
        if self.key == 0 && !self.is_idle() {
            report(DiagnosticFault::Locked);
        }
        if self.tx_bypass.0 & !TxBypass::ALL.0 != 0 {
            report(DiagnosticFault::TxBits(self.tx_bypass.0));
        }
        if self.rx_bypass.0 & !RxBypass::ALL.0 != 0 {
            report(DiagnosticFault::RxBits(self.rx_bypass.0));
        }
    }
}
