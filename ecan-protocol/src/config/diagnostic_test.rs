//! PDO diagnostic tests, 0x8030 (manual 13.2.3): parts of the data path cut off to measure the
//! rest. Not for production.

use crate::object::SdoWrite;
use crate::object::{DIAGNOSTIC_TEST, ObjectType};
use crate::raw_enum::raw_enum;

/// The key that unlocks the tests: "ECAN".
pub const DIAGNOSTIC_TEST_KEY: u32 = 0x4543_414E;

/// Number of downloads of [`DiagnosticTest::writes`].
pub const DIAGNOSTIC_TEST_WRITES: usize = 6;

const INDEX: u16 = 0x8030;

raw_enum! {
    /// CRC of the images during a test (0x8030:04).
    pub enum CrcTest: u8 {
        /// As the PDO option says.
        Follow = 0,
        /// With CRC, whatever the option.
        Force = 1,
        /// Without CRC, whatever the option.
        Suppress = 2,
    }
}

raw_enum! {
    /// The directions that a test concerns (0x8030:05, :06).
    pub enum Sides: u8 {
        /// None.
        Off = 0,
        /// TxPDO.
        Tx = 1,
        /// RxPDO.
        Rx = 2,
        /// Both.
        Both = 3,
    }
}

/// Stages of the TxPDO path that are skipped (0x8030:02), as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct TxBypass(pub u32);

impl TxBypass {
    /// Frames are not read from the controller.
    pub const MCAN_READ: Self = Self(1 << 2);
    /// The frame area is not built.
    pub const BUILD: Self = Self(1 << 3);
    /// The image is not published.
    pub const COPY: Self = Self(1 << 4);
    /// All stages.
    pub const ALL: Self = Self(0x1C);
}

/// Stages of the RxPDO path that are skipped (0x8030:03), as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RxBypass(pub u32);

impl RxBypass {
    /// The image is not taken over.
    pub const STAGE: Self = Self(1 << 2);
    /// The payload is not parsed.
    pub const PARSE: Self = Self(1 << 3);
    /// Frames are not queued.
    pub const TX_RING: Self = Self(1 << 4);
    /// Frames are not sent.
    pub const MCAN_WRITE: Self = Self(1 << 5);
    /// All stages.
    pub const ALL: Self = Self(0x3C);
}

/// PDO Diagnostic Test Control. The default is all off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiagnosticTest {
    /// :01 [`DIAGNOSTIC_TEST_KEY`] to test, else 0.
    pub key: u32,
    /// :02 Stages of the TxPDO path that are skipped.
    pub tx_bypass: TxBypass,
    /// :03 Stages of the RxPDO path that are skipped.
    pub rx_bypass: RxBypass,
    /// :04 CRC of the images.
    pub crc: CrcTest,
    /// :05 Directions with header and payload only.
    pub payload_only: Sides,
    /// :06 Directions cut off from the CAN side.
    pub app_link_bypass: Sides,
}

impl Default for DiagnosticTest {
    fn default() -> Self {
        Self::OFF
    }
}

/// A fault of a test configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DiagnosticFault {
    /// Neither 0 nor the key.
    #[error("test key is 0x{0:08X}, possible are 0 and 0x{DIAGNOSTIC_TEST_KEY:08X}")]
    Key(u32),
    /// A test without the key: the device refuses it.
    #[error("tests need the key 0x{DIAGNOSTIC_TEST_KEY:08X}")]
    Locked,
    /// Bits without a meaning among the TxPDO stages.
    #[error("TxPDO bypass flags 0x{0:08X} have bits outside 0x0000001C")]
    TxBits(u32),
    /// Bits without a meaning among the RxPDO stages.
    #[error("RxPDO bypass flags 0x{0:08X} have bits outside 0x0000003C")]
    RxBits(u32),
}

impl DiagnosticTest {
    /// No test, no key.
    pub const OFF: Self = Self {
        key: 0,
        tx_bypass: TxBypass(0),
        rx_bypass: RxBypass(0),
        crc: CrcTest::Follow,
        payload_only: Sides::Off,
        app_link_bypass: Sides::Off,
    };

    /// True when no test is chosen, with or without key.
    pub fn is_idle(&self) -> bool {
        Self { key: 0, ..*self } == Self::OFF
    }

    /// True when a chosen test keeps CAN frames from passing.
    pub fn cuts_can(&self) -> bool {
        self.tx_bypass.0 != 0 || self.rx_bypass.0 != 0 || self.app_link_bypass != Sides::Off
    }

    /// The downloads. The device refuses a test without key and a missing key with a test, so
    /// the key comes first when it is set and last when it is taken away. There is no apply
    /// command.
    pub const fn writes(&self) -> [SdoWrite; DIAGNOSTIC_TEST_WRITES] {
        let key = SdoWrite::new(INDEX, 1, ObjectType::U32, self.key);
        let tx = SdoWrite::new(INDEX, 2, ObjectType::U32, self.tx_bypass.0);
        let rx = SdoWrite::new(INDEX, 3, ObjectType::U32, self.rx_bypass.0);
        let crc = SdoWrite::new(INDEX, 4, ObjectType::U8, self.crc.raw() as u32);
        let payload = SdoWrite::new(INDEX, 5, ObjectType::U8, self.payload_only.raw() as u32);
        let link = SdoWrite::new(INDEX, 6, ObjectType::U8, self.app_link_bypass.raw() as u32);
        if self.key == 0 {
            [tx, rx, crc, payload, link, key]
        } else {
            [key, tx, rx, crc, payload, link]
        }
    }

    /// Reads the state of a device; `read` gets a subindex of 0x8030. A number without a meaning
    /// counts as the most that it could be (both sides, no CRC).
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
        let mask = |subindex| DIAGNOSTIC_TEST.entry(subindex).map_or(0, |entry| entry.bit_mask());
        if self.tx_bypass.0 & !mask(2) != 0 {
            report(DiagnosticFault::TxBits(self.tx_bypass.0));
        }
        if self.rx_bypass.0 & !mask(3) != 0 {
            report(DiagnosticFault::RxBits(self.rx_bypass.0));
        }
    }
}
