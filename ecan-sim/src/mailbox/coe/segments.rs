use ecan_protocol::object::AbortCode;

use super::target::Target;

pub(super) const SMALLEST_SEGMENT: usize = 7;

#[derive(Clone, Debug)]
pub(super) struct SegmentedUpload {
    pub(super) target: Target,
    data: Vec<u8>,
    sent: usize,
    toggle: bool,
}

impl SegmentedUpload {
    pub(super) fn new(target: Target, data: Vec<u8>, sent: usize) -> Self {
        Self { target, data, sent, toggle: false }
    }

    /// The next segment of up to `room` bytes, and whether it is the last.
    pub(super) fn next(&mut self, toggle: bool, room: usize) -> Result<(&[u8], bool), AbortCode> {
        if toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        self.toggle = !toggle;
        let from = self.sent;
        self.sent = self.data.len().min(from + room.max(SMALLEST_SEGMENT));
        let is_last = self.sent == self.data.len();
        Ok((self.data.get(from..self.sent).unwrap_or_default(), is_last))
    }
}

#[derive(Clone, Debug)]
pub(super) struct SegmentedDownload {
    pub(super) target: Target,
    data: Vec<u8>,
    announced: usize,
    toggle: bool,
}

impl SegmentedDownload {
    pub(super) fn new(target: Target, first: &[u8], announced: usize) -> Self {
        Self { target, data: first.to_vec(), announced, toggle: false }
    }

    /// Adds a segment; returns all the data after the last one.
    pub(super) fn take(
        &mut self,
        toggle: bool,
        segment: &[u8],
        is_last: bool,
    ) -> Result<Option<&[u8]>, AbortCode> {
        if toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        self.toggle = !toggle;
        if self.data.len() + segment.len() > self.announced {
            return Err(AbortCode::TOO_LONG);
        }
        self.data.extend_from_slice(segment);
        match is_last {
            true if self.data.len() < self.announced => Err(AbortCode::TOO_SHORT),
            true => Ok(Some(&self.data)),
            false => Ok(None),
        }
    }
}
