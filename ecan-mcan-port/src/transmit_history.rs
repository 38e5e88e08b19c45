//! Which sends the last images carried, to match transmit results with them (manual 10).

use ecan_protocol::{CHANNELS, MAX_PACKETS, TxResult};

/// Images remembered. Results come one or two images later; a channel under back pressure may
/// take longer.
const DEPTH: usize = 16;

#[derive(Debug, Clone)]
struct SentImage {
    sequence: u16,
    count: u8,
    /// Channel per frame; [`ANSWERED`] once its result has come.
    channels: [u8; MAX_PACKETS],
}

const ANSWERED: u8 = u8::MAX;
const _: () = assert!(CHANNELS < ANSWERED as usize);

/// A ring of the last images by sequence.
#[derive(Debug, Clone)]
pub(crate) struct TransmitHistory {
    images: Box<[SentImage]>,
}

impl TransmitHistory {
    pub(crate) fn new() -> Self {
        let empty = SentImage { sequence: 0, count: 0, channels: [0; MAX_PACKETS] };
        Self { images: vec![empty; DEPTH].into_boxed_slice() }
    }

    /// Remembers the frame `index` of the image `sequence`. Frames of an image come in order.
    pub(crate) fn frame_added(&mut self, sequence: u16, index: u8, channel: u8) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        if index == 0 {
            image.sequence = sequence;
        }
        image.count = index.saturating_add(1);
        if let Some(place) = image.channels.get_mut(usize::from(index)) {
            *place = channel;
        }
    }

    /// Whether the result belongs to a send that has had none yet.
    pub(crate) fn take(&mut self, result: &TxResult) -> bool {
        let image = &mut self.images[usize::from(result.sequence) % DEPTH];
        if image.sequence != result.sequence || result.frame_index >= image.count {
            return false;
        }
        match image.channels.get_mut(usize::from(result.frame_index)) {
            Some(channel) if *channel == result.channel => {
                *channel = ANSWERED;
                true
            }
            _ => false,
        }
    }

    /// Forgets everything: the gateway's session starts anew.
    pub(crate) fn reset(&mut self) {
        for image in &mut self.images {
            image.count = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_protocol::ResultCode;

    fn result(sequence: u16, frame_index: u8, channel: u8) -> TxResult {
        TxResult { channel, sequence, frame_index, code: ResultCode::Ok }
    }

    #[test]
    fn a_result_matches_its_send_once() {
        let mut history = TransmitHistory::new();
        history.frame_added(7, 0, 1);
        history.frame_added(7, 1, 2);
        assert!(history.take(&result(7, 1, 2)));
        assert!(!history.take(&result(7, 1, 2)), "answered already");
        assert!(!history.take(&result(7, 0, 2)), "another channel");
        assert!(!history.take(&result(7, 2, 2)), "no such frame");
        assert!(!history.take(&result(8, 0, 1)), "no such image");
        assert!(history.take(&result(7, 0, 1)));
    }

    #[test]
    fn an_old_image_gives_way_to_a_new_one() {
        let mut history = TransmitHistory::new();
        history.frame_added(1, 0, 0);
        history.frame_added(17, 0, 3);
        assert!(!history.take(&result(1, 0, 0)));
        assert!(history.take(&result(17, 0, 3)));
        history.frame_added(18, 0, 3);
        history.reset();
        assert!(!history.take(&result(18, 0, 3)));
    }
}
