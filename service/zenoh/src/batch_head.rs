//! Head of a publication of frames: the attachment of its Zenoh sample.

use thiserror::Error;

/// Bytes of the head.
pub const BATCH_HEAD_BYTES: usize = 24;

/// Counters of a publication: three little-endian numbers of 64 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BatchHead {
    /// Start of the publisher's connection to the service, in nanoseconds since 1970. The counters
    /// start at 0 with each connection.
    pub epoch: u64,
    /// Frames of this key that were published before this payload.
    pub frames: u64,
    /// Frames of all keys that the publisher lost: records of kind 3 of the service, and losses in
    /// the publisher.
    pub lost: u64,
}

/// The attachment is not a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("attachment of frames has {0} bytes; allowed: {BATCH_HEAD_BYTES}")]
pub struct HeadError(pub usize);

impl BatchHead {
    /// Bytes of the attachment.
    pub fn encode(&self) -> Vec<u8> {
        [self.epoch, self.frames, self.lost].iter().flat_map(|it| it.to_le_bytes()).collect()
    }

    /// Reads an attachment.
    ///
    /// # Errors
    /// Another length.
    pub fn decode(bytes: &[u8]) -> Result<Self, HeadError> {
        let (numbers, []) = bytes.as_chunks::<8>() else { return Err(HeadError(bytes.len())) };
        match numbers.iter().map(|it| u64::from_le_bytes(*it)).collect::<Vec<_>>()[..] {
            [epoch, frames, lost] => Ok(Self { epoch, frames, lost }),
            _ => Err(HeadError(bytes.len())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn head_is_three_little_endian_numbers() {
        let head = BatchHead { epoch: 1, frames: 0x0203, lost: 4 };
        let bytes = head.encode();
        assert_eq!(bytes, [1, 0, 0, 0, 0, 0, 0, 0, 3, 2, 0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(BatchHead::decode(&bytes), Ok(head));
        for length in [0, 8, 23, 25, 32] {
            assert_eq!(BatchHead::decode(&vec![0; length]), Err(HeadError(length)));
        }
    }
}
