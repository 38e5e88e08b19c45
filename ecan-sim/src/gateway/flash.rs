//! Flash sector of the saved configuration. It survives power loss; an interrupted write leaves
//! bytes with an invalid CRC.

use super::configuration_image::{ConfigurationImage, CrcError};

#[derive(Debug, Default)]
pub(super) struct Flash {
    bytes: Vec<u8>,
}

impl Flash {
    /// The stored configuration; `None` if erased.
    pub(super) fn read(&self) -> Result<Option<ConfigurationImage>, CrcError> {
        if self.bytes.is_empty() {
            return Ok(None);
        }
        ConfigurationImage::parse(&self.bytes).map(Some)
    }

    /// CRC32 of the stored configuration, 0 without a valid one.
    pub(super) fn stored_crc(&self) -> u32 {
        match self.read() {
            Ok(Some(image)) => image.crc(),
            Ok(None) | Err(CrcError) => 0,
        }
    }

    /// A write or an erasure begins: the contents are invalid until it completes.
    pub(super) fn begin_change(&mut self) {
        let half = self.bytes.len() / 2;
        self.bytes.truncate(half);
        // erased cells read as ones
        self.bytes.push(0xFF);
    }

    pub(super) fn store(&mut self, image: &ConfigurationImage) {
        self.bytes = image.to_bytes();
    }

    pub(super) fn erase(&mut self) {
        self.bytes.clear();
    }
}
