//! The flash sector that holds the saved configuration. It survives power loss and restarts; a
//! write that is cut off leaves bytes whose check fails.

use super::configuration_image::{ConfigurationImage, CrcError};

/// Configuration memory: empty as made.
#[derive(Debug, Default)]
pub(super) struct Flash {
    bytes: Vec<u8>,
}

impl Flash {
    /// What is stored; nothing in an erased flash.
    pub(super) fn read(&self) -> Result<Option<ConfigurationImage>, CrcError> {
        if self.bytes.is_empty() {
            return Ok(None);
        }
        ConfigurationImage::parse(&self.bytes).map(Some)
    }

    /// The CRC32 of what is stored, 0 without a sound image.
    pub(super) fn stored_crc(&self) -> u32 {
        match self.read() {
            Ok(Some(image)) => image.crc(),
            Ok(None) | Err(CrcError) => 0,
        }
    }

    /// A write or an erasure begins: what is stored is sound again only when it is through.
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
