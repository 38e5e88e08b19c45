//! Published images and their frames, until it is known what the gateway did with them.

use ecan_protocol::image::TxResult;
use ecan_protocol::mapping::{CHANNELS, MAX_PACKETS};

use crate::statistics::SlaveStatistics;

/// Number of images stored. Results arrive one or two images later, later under back pressure.
const DEPTH: usize = 16;

#[derive(Debug, Clone, Copy)]
pub(crate) struct OpenFrame {
    pub(crate) channel: u8,
    pub(crate) tag: Option<u16>,
    /// Index in the image, as in its ticket.
    pub(crate) index: u8,
    /// The frame came from a transmit queue.
    pub(crate) is_queued: bool,
}

#[derive(Debug, Clone)]
struct SentImage {
    sequence: u16,
    count: u8,
    /// The image holds scheduled frames.
    has_scheduled: bool,
    /// The image was sent more than once: a result may belong to any of them.
    is_repeated: bool,
    /// `None` after its result. One for each value of an index.
    frames: [Option<OpenFrame>; MAX_PACKETS + 1],
}

#[derive(Debug, Clone)]
pub(crate) struct TransmitHistory {
    images: Box<[SentImage; DEPTH]>,
}

impl TransmitHistory {
    pub(crate) fn new() -> Self {
        let empty = SentImage {
            sequence: 0,
            count: 0,
            has_scheduled: false,
            is_repeated: false,
            frames: [None; MAX_PACKETS + 1],
        };
        Self { images: Box::new(std::array::from_fn(|_| empty.clone())) }
    }

    /// Stores the frame `index` of the image `sequence`, in order of the index, after
    /// [`make_room`](Self::make_room).
    #[inline]
    pub(crate) fn add_frame(&mut self, sequence: u16, index: u8, channel: u8, tag: Option<u16>) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        if index == 0 {
            image.sequence = sequence;
        }
        // infallible: the last index is 254
        image.count = index.wrapping_add(1);
        image.has_scheduled |= tag.is_some();
        if let Some(slot) = image.frames.get_mut(usize::from(index)) {
            *slot = Some(OpenFrame { channel, tag, index, is_queued: false });
        }
    }

    /// The last frame of the image came from a transmit queue.
    pub(crate) fn set_queued(&mut self, sequence: u16, index: u8) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        if let Some(Some(frame)) = image.frames.get_mut(usize::from(index)) {
            frame.is_queued = true;
        }
    }

    /// Removes the frame that a result belongs to, if it had none yet.
    pub(crate) fn take(&mut self, result: &TxResult) -> Option<OpenFrame> {
        let image = &mut self.images[usize::from(result.sequence) % DEPTH];
        if image.sequence != result.sequence || result.frame_index >= image.count {
            return None;
        }
        let slot = image.frames.get_mut(usize::from(result.frame_index))?;
        slot.take_if(|frame| frame.channel == result.channel)
    }

    /// Removes the scheduled frames of an image; `close` gets each of them.
    pub(crate) fn close_scheduled(&mut self, sequence: u16, close: impl FnMut(u8)) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        if image.sequence == sequence {
            image.close_scheduled(close);
        }
    }

    /// Closes the gaps between the frames of an unpublished image.
    pub(crate) fn move_up(&mut self, sequence: u16) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        if image.sequence != sequence {
            return;
        }
        let mut kept = 0;
        for index in 0..image.count {
            let frame = image.frames.get_mut(usize::from(index)).and_then(Option::take);
            if let (Some(_), Some(slot)) = (frame, image.frames.get_mut(usize::from(kept))) {
                *slot = frame;
                kept += 1;
            }
        }
        image.count = kept;
    }

    /// An image was sent again.
    pub(crate) fn record_repetition(&mut self, sequence: u16) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        image.is_repeated |= image.sequence == sequence;
    }

    pub(crate) fn is_repeated(&self, sequence: u16) -> bool {
        let image = &self.images[usize::from(sequence) % DEPTH];
        image.sequence == sequence && image.is_repeated
    }

    /// Frees the entry of an image; `close` gets each scheduled frame without a result in it.
    pub(crate) fn make_room(&mut self, sequence: u16, close: impl FnMut(u8)) {
        let image = &mut self.images[usize::from(sequence) % DEPTH];
        image.close_scheduled(close);
        image.count = 0;
        image.is_repeated = false;
    }

    /// A new session: removes everything; `close` gets each scheduled frame without a result.
    pub(crate) fn reset(&mut self, mut close: impl FnMut(u8)) {
        for image in self.images.iter_mut() {
            image.close_scheduled(&mut close);
            image.count = 0;
        }
    }
}

impl SentImage {
    fn close_scheduled(&mut self, mut close: impl FnMut(u8)) {
        if !std::mem::take(&mut self.has_scheduled) {
            return;
        }
        for slot in self.frames.iter_mut().take(usize::from(self.count)) {
            if let Some(frame) = slot.take_if(|frame| frame.tag.is_some()) {
                close(frame.channel);
            }
        }
    }
}

/// Frames per channel in an image.
pub(crate) type Counts = [u8; CHANNELS];

/// Number of images that are stored one by one; older ones are proven together.
const UNPROVEN_DEPTH: usize = 16;

#[derive(Debug, Clone, Copy, Default)]
struct Image {
    /// 0 for none.
    number: u64,
    frames: [u64; CHANNELS],
}

impl Image {
    fn add(&mut self, other: &Self) {
        self.number = self.number.max(other.number);
        for (sum, frames) in self.frames.iter_mut().zip(other.frames) {
            *sum += frames;
        }
    }
}

/// Images are numbered in the order of their publication, from 1.
#[derive(Debug, Clone, Default)]
pub(crate) struct UnprovenFrames {
    images: [Image; UNPROVEN_DEPTH],
    next: usize,
    /// Sum of the images before these, with the number of the last one.
    older: Image,
    /// Last image that is proven.
    proven: u64,
}

impl UnprovenFrames {
    /// Adds a delivered image.
    #[inline]
    pub(crate) fn add(&mut self, number: u64, counts: &Counts) {
        if *counts == [0; CHANNELS] {
            return;
        }
        let frames = counts.map(u64::from);
        if let Some(image) = self.images.get_mut(self.next) {
            let replaced = std::mem::replace(image, Image { number, frames });
            if replaced.number != 0 {
                self.older.add(&replaced);
            }
        }
        self.next = (self.next + 1) % UNPROVEN_DEPTH;
    }

    /// Removes the frames of all images up to `number` and returns their numbers per channel.
    #[inline]
    pub(crate) fn prove(&mut self, number: u64) -> [u64; CHANNELS] {
        if number <= self.proven {
            return [0; CHANNELS];
        }
        self.proven = number;
        self.take(|image| image.number <= number)
    }

    /// Removes all frames and returns their numbers per channel.
    pub(crate) fn take_all(&mut self) -> [u64; CHANNELS] {
        self.take(|_| true)
    }

    /// Number of frames per channel.
    pub(crate) fn frames(&self) -> [u64; CHANNELS] {
        let mut sum = self.older;
        self.images.iter().for_each(|image| sum.add(image));
        sum.frames
    }

    fn take(&mut self, matches: impl Fn(&Image) -> bool) -> [u64; CHANNELS] {
        let mut sum = Image::default();
        for image in self.images.iter_mut().chain([&mut self.older]) {
            if matches(image) {
                sum.add(&std::mem::take(image));
            }
        }
        sum.frames
    }
}

/// State of frames that the host does not send any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Withdrawn {
    /// Their image was not published.
    Discarded,
    /// The gateway did not take their image.
    Lost,
    /// The gateway may have taken their image.
    Unknown,
}

/// Counts the frames of a withdrawn image and returns their number.
pub(crate) fn count_withdrawn(
    counts: &Counts,
    state: Withdrawn,
    statistics: &mut SlaveStatistics,
) -> usize {
    let frames: usize = counts.iter().map(|n| usize::from(*n)).sum();
    statistics.rxpdo_discarded += u64::from(frames > 0);
    for (channel, count) in statistics.channels.iter_mut().zip(counts) {
        let counter = match state {
            Withdrawn::Discarded => &mut channel.frames_discarded,
            Withdrawn::Lost => &mut channel.frames_lost,
            Withdrawn::Unknown => &mut channel.frames_unknown,
        };
        *counter += u64::from(*count);
    }
    frames
}

#[cfg(test)]
mod tests {
    use ecan_protocol::image::ResultCode;

    use super::*;

    fn result(sequence: u16, frame_index: u8, channel: u8) -> TxResult {
        TxResult { channel, sequence, frame_index, code: ResultCode::Ok }
    }

    #[test]
    fn result_matches_its_frame_once() {
        let mut history = TransmitHistory::new();
        history.add_frame(7, 0, 1, None);
        history.add_frame(7, 1, 2, None);
        assert!(history.take(&result(7, 1, 2)).is_some());
        assert!(history.take(&result(7, 1, 2)).is_none(), "answered already");
        assert!(history.take(&result(7, 0, 2)).is_none(), "another channel");
        assert!(history.take(&result(7, 2, 2)).is_none(), "no such frame");
        assert!(history.take(&result(8, 0, 1)).is_none(), "no such image");
        assert!(history.take(&result(7, 0, 1)).is_some());
    }

    #[test]
    fn new_image_replaces_an_old_one() {
        let mut history = TransmitHistory::new();
        history.add_frame(1, 0, 0, None);
        history.add_frame(17, 0, 3, None);
        assert!(history.take(&result(1, 0, 0)).is_none());
        assert!(history.take(&result(17, 0, 3)).is_some());
        history.add_frame(18, 0, 3, None);
        history.reset(|_| ());
        assert!(history.take(&result(18, 0, 3)).is_none());
    }

    #[test]
    fn remaining_frames_move_up_and_keep_their_tickets() {
        let mut history = TransmitHistory::new();
        for (index, tag) in [Some(1), None, Some(2), None].into_iter().enumerate() {
            history.add_frame(9, index as u8, 0, tag);
        }
        history.close_scheduled(9, |_| ());
        history.move_up(8);
        history.move_up(9);
        assert_eq!(history.take(&result(9, 0, 0)).unwrap().index, 1);
        assert_eq!(history.take(&result(9, 1, 0)).unwrap().index, 3);
        assert!(history.take(&result(9, 2, 0)).is_none(), "there are two");
    }

    #[test]
    fn image_is_repeated_until_its_entry_is_reused() {
        let mut history = TransmitHistory::new();
        history.add_frame(3, 0, 0, Some(1));
        history.record_repetition(19);
        assert!(!history.is_repeated(3), "another image");
        history.record_repetition(3);
        assert!(history.is_repeated(3) && !history.is_repeated(19));
        history.make_room(19, |_| ());
        history.add_frame(19, 0, 0, None);
        assert!(!history.is_repeated(19));
    }

    #[test]
    fn scheduled_frames_are_closed_once() {
        let mut history = TransmitHistory::new();
        history.add_frame(5, 0, 1, Some(70));
        history.add_frame(5, 1, 2, None);
        history.add_frame(5, 2, 3, Some(71));
        assert_eq!(history.take(&result(5, 0, 1)).unwrap().tag, Some(70));
        let mut closed = Vec::new();
        history.close_scheduled(6, |channel| closed.push(channel));
        history.close_scheduled(5, |channel| closed.push(channel));
        history.make_room(21, |channel| closed.push(channel));
        assert_eq!(closed, [3]);
        assert!(history.take(&result(5, 1, 2)).is_none(), "its slot is free");
        history.add_frame(21, 0, 1, Some(1));
        history.reset(|channel| closed.push(channel));
        assert_eq!(closed, [3, 1]);
    }

    #[test]
    fn images_up_to_the_number_are_proven_once() {
        let mut unproven = UnprovenFrames::default();
        unproven.add(1, &[1, 0, 0, 0]);
        unproven.add(2, &[0; CHANNELS]);
        unproven.add(3, &[2, 5, 0, 0]);
        assert_eq!(unproven.prove(2), [1, 0, 0, 0]);
        assert_eq!(unproven.prove(2), [0; CHANNELS]);
        assert_eq!(unproven.frames(), [2, 5, 0, 0]);
        assert_eq!(unproven.prove(9), [2, 5, 0, 0]);
        assert_eq!(unproven.take_all(), [0; CHANNELS]);
    }

    #[test]
    fn old_images_are_proven_together() {
        let mut unproven = UnprovenFrames::default();
        for number in 1..=40 {
            unproven.add(number, &[1, 0, 0, 0]);
        }
        assert_eq!(unproven.frames()[0], 40);
        assert_eq!(unproven.prove(20)[0], 0, "24 images are one sum");
        assert_eq!(unproven.prove(30)[0], 30);
        assert_eq!(unproven.take_all()[0], 10);
    }
}
