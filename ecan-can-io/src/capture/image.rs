//! PDO images and their header in a capture.

use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;

/// Link type of images.
pub const LINK_TYPE: u16 = 147;
/// Size of the header before an image, in bytes.
pub const IMAGE_HEADER_BYTES: usize = 16;

const MAGIC: [u8; 4] = *b"ECAN";
const VERSION: u8 = 1;

/// Origin and profile of an image.
///
/// Its header of 16 bytes precedes the image, little-endian:
///
/// | Offset | Size | Content |
/// |---|---|---|
/// | 0 | 4 | `ECAN` |
/// | 4 | 1 | version of this header, 1 |
/// | 5 | 1 | size of this header in bytes, 16; the image follows |
/// | 6 | 1 | direction: 0 RxPDO (from the master), 1 TxPDO (from the gateway) |
/// | 7 | 1 | 0 |
/// | 8 | 2 | slave |
/// | 10 | 2 | 0 |
/// | 12 | 4 | profile word: N - 1, channels, profile, budget, options (manual 5.4.4.1) |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageOrigin {
    /// Index of the gateway in the application.
    pub slave: u16,
    /// Direction of the image.
    pub direction: Direction,
    /// Active profile of this direction.
    pub profile: PdoProfile,
}

impl ImageOrigin {
    /// Encodes the header.
    pub fn header(&self) -> [u8; IMAGE_HEADER_BYTES] {
        let [e, c, a, n] = MAGIC;
        let direction = match self.direction {
            Direction::RxPdo => 0,
            Direction::TxPdo => 1,
        };
        let [s0, s1] = self.slave.to_le_bytes();
        let [w0, w1, w2, w3] = self.profile.word().to_le_bytes();
        let length = IMAGE_HEADER_BYTES as u8;
        [e, c, a, n, VERSION, length, direction, 0, s0, s1, 0, 0, w0, w1, w2, w3]
    }
}
