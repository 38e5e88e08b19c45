//! 0x8030 PDO Diagnostic Test Control (manual 13.2.3): parts of the data path disconnected to
//! measure the rest. Not for production.

use super::ObjectType::{U8, U32};
use super::declare::object;
use super::entry::{Entry, Object};
use super::value::{raw_enum, raw_flags};
use super::{ConfigObject, ObjectType, SdoWrite};

/// The key that enables the tests: "ECAN".
pub const DIAGNOSTIC_TEST_KEY: u32 = 0x4543_414E;

raw_enum! {
    /// CRC of the images during a test (0x8030:04).
    pub enum CrcTest: u8;
    Follow = 0, "follow PDO option";
    /// With CRC, regardless of the option.
    Force = 1, "force CRC16";
    /// Without CRC, regardless of the option.
    Suppress = 2, "force no CRC16";
}

raw_enum! {
    /// Directions that a test applies to (0x8030:05, :06).
    pub enum Sides: u8;
    Off = 0, "off";
    Tx = 1, "Tx";
    Rx = 2, "Rx";
    Both = 3, "Tx and Rx";
}

/// Stages of the TxPDO path that are skipped (0x8030:02), as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TxBypass(pub u32);

raw_flags! {
    TxBypass: u32;
    /// Frames are not read from the controller.
    MCAN_READ = 2, "MCAN_READ";
    /// The frame area is not built.
    BUILD = 3, "BUILD";
    /// The image is not published.
    COPY = 4, "COPY";
}

/// Stages of the RxPDO path that are skipped (0x8030:03), as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RxBypass(pub u32);

raw_flags! {
    RxBypass: u32;
    /// The image is not copied.
    STAGE = 2, "STAGE";
    /// The payload is not parsed.
    PARSE = 3, "PARSE";
    /// Frames are not queued.
    TX_RING = 4, "TX_RING";
    /// Frames are not sent.
    MCAN_WRITE = 5, "MCAN_WRITE";
}

/// Tests that a device offers (0x8030:08, 0xF000:24 and :25).
pub(super) const TESTS: &[(u8, &str)] = &[
    (0, "TX_BYPASS"),
    (1, "RX_BYPASS"),
    (2, "CRC_POLICY"),
    (3, "PAYLOAD_ONLY"),
    (4, "APP_BYPASS"),
];

object! {
    /// PDO Diagnostic Test Control, 0x8030. The default is all off.
    pub struct DiagnosticTest {}
    const DIAGNOSTIC_TEST =
        Object::single(0x8030, "PDO Diagnostic Test Control", "13.2.3", DiagnosticTest::ENTRIES);
    entries {
        entry(Entry::highest(10));
        /// [`DIAGNOSTIC_TEST_KEY`] to test, otherwise 0 (:01).
        1 "Test enable key" key: u32 = 0, key("enable_key"),
            values(&[(0, "test mode off"), (DIAGNOSTIC_TEST_KEY, "test controls allowed")]);
        /// Stages of the TxPDO path that are skipped (:02).
        2 "TxPDO bypass flags" tx_bypass: TxBypass = TxBypass(0);
        /// Stages of the RxPDO path that are skipped (:03).
        3 "RxPDO bypass flags" rx_bypass: RxBypass = RxBypass(0);
        /// CRC of the images (:04).
        4 "CRC test policy" crc: CrcTest = CrcTest::Follow;
        /// Directions with header and payload only (:05).
        5 "Payload only policy" payload_only: Sides = Sides::Off;
        /// Directions disconnected from the CAN side (:06).
        6 "App link bypass policy" app_link_bypass: Sides = Sides::Off;
        entry(Entry::ro(7, "ReservedPad", U8).default(0));
        entry(Entry::ro(8, "Legal combination mask", U32).default(0x1F).bits(TESTS));
        entry(Entry::ro(9, "Last reject reason", U32).default(0));
        entry(Entry::ro(10, "Reserved0", U32).default(0));
    }
}

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
