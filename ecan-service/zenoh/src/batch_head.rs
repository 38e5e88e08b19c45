//! Head of a publication of frames: the attachment of its Zenoh sample.

use thiserror::Error;

/// Bytes of the head.
pub const BATCH_HEAD_BYTES: usize = 32;

/// Counters of a publication: four little-endian numbers of 64 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BatchHead {
    /// Start of the publisher, in nanoseconds since 1970. The counters start at 0 with each epoch.
    pub epoch: u64,
    /// Connections of the publisher to the service in this epoch, this one included. Frames of the
    /// bus between two connections are not counted.
    pub connections: u64,
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
        [self.epoch, self.connections, self.frames, self.lost]
            .iter()
            .flat_map(|number| number.to_le_bytes())
            .collect()
    }

    /// Reads an attachment.
    ///
    /// # Errors
    /// Another length.
    pub fn decode(bytes: &[u8]) -> Result<Self, HeadError> {
        let (numbers, []) = bytes.as_chunks::<8>() else { return Err(HeadError(bytes.len())) };
        match numbers.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect::<Vec<_>>()[..] {
            [epoch, connections, frames, lost] => Ok(Self { epoch, connections, frames, lost }),
            _ => Err(HeadError(bytes.len())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn head_is_four_little_endian_numbers() {
        let head = BatchHead { epoch: 1, connections: 5, frames: 0x0203, lost: 4 };
        let bytes = head.encode();
        let starts = [(0, 1), (8, 5), (16, 3), (17, 2), (24, 4)];
        let expected =
            |at| starts.iter().find(|(start, _)| *start == at).map_or(0, |found| found.1);
        assert_eq!(bytes, (0..32).map(expected).collect::<Vec<_>>());
        assert_eq!(BatchHead::decode(&bytes), Ok(head));
        for length in [0, 8, 24, 31, 33, 40] {
            assert_eq!(BatchHead::decode(&vec![0; length]), Err(HeadError(length)));
        }
    }
}
