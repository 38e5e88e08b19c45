//! Records of frames to send, to the service.

use ecan_protocol::can::CanFrame;

use crate::protocol::frame_record::check_channel;
use crate::protocol::wire_frame::{RecordError, fields_of, push_data, read_frame};

/// Bytes of a record without its data.
pub const TRANSMIT_RECORD_BYTES: usize = 16;

/// A frame to send.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TransmitRecord {
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Tag of the frame records that report on it; not 0.
    pub tag: u32,
    /// Age limit in milliseconds, counted from the arrival at the service: a frame that waits longer is
    /// rejected. 0 for [`DEFAULT_MAX_AGE_MS`](crate::protocol::DEFAULT_MAX_AGE_MS).
    pub max_age_ms: u16,
    /// The frame.
    pub frame: CanFrame,
}

impl TransmitRecord {
    /// Appends the record to a batch.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let (can_id, length, flags) = fields_of(&self.frame);
        out.extend_from_slice(&can_id.to_le_bytes());
        out.extend_from_slice(&[length, flags]);
        out.extend_from_slice(&self.gateway.to_le_bytes());
        out.extend_from_slice(&[self.channel, 0]);
        out.extend_from_slice(&self.max_age_ms.to_le_bytes());
        out.extend_from_slice(&self.tag.to_le_bytes());
        push_data(&self.frame, out);
    }
}

/// Records of a transmit batch, in order. Ends after the first error.
#[derive(Debug, Clone)]
pub struct TransmitRecords<'a> {
    rest: &'a [u8],
}

impl<'a> TransmitRecords<'a> {
    /// Creates the reader of a batch.
    pub const fn new(batch: &'a [u8]) -> Self {
        Self { rest: batch }
    }

    fn read(&mut self) -> Result<TransmitRecord, RecordError> {
        let incomplete = RecordError::Incomplete(self.rest.len());
        let (head, rest) =
            self.rest.split_first_chunk::<TRANSMIT_RECORD_BYTES>().ok_or(incomplete)?;
        let [i0, i1, i2, i3, length, flags, g0, g1, channel, reserved, m0, m1, a0, a1, a2, a3] =
            *head;
        if reserved != 0 {
            return Err(RecordError::Reserved);
        }
        let tag = u32::from_le_bytes([a0, a1, a2, a3]);
        if tag == 0 {
            return Err(RecordError::Tag);
        }
        check_channel(channel)?;
        let can_id = u32::from_le_bytes([i0, i1, i2, i3]);
        let (frame, rest) = read_frame(can_id, length, flags, rest)?;
        self.rest = rest;
        let (gateway, max_age_ms) = (u16::from_le_bytes([g0, g1]), u16::from_le_bytes([m0, m1]));
        Ok(TransmitRecord { gateway, channel, tag, max_age_ms, frame })
    }
}

impl Iterator for TransmitRecords<'_> {
    type Item = Result<TransmitRecord, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        Some(self.read().inspect_err(|_| self.rest = &[]))
    }
}
