//! Output of a client: bounded, with exact counts of what does not fit.

use ecan_protocol::can::CanFrame;

use crate::protocol::{
    FRAME_RECORD_BYTES, FrameEvent, FrameRecord, FrameReport, HEADER_BYTES, IMAGE_HEAD_BYTES,
    ImageMessage, MAX_FRAME_RECORD_BYTES, MessageKind, Response, header,
};

/// Bytes of a batch of frames at which it ends.
const BATCH_BYTES: usize = 32 << 10;

/// Messages for one client. Frames and images that exceed its bytes are lost: counted, and reported
/// before the next one that fits. Responses, and results of the client's own frames, whose number its
/// requests and its window limit, always fit.
#[derive(Debug)]
pub(crate) struct OutputQueue {
    max_bytes: usize,
    bytes: Vec<u8>,
    /// Bytes that were written to the client.
    written: usize,
    /// Records of the batch that is being filled, after the messages in `bytes`.
    batch: Vec<u8>,
    /// Frames and images that were lost and not reported yet.
    unreported_frames: u64,
    unreported_images: u32,
    pub(crate) counters: OutputCounters,
}

/// Counters of a client's output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct OutputCounters {
    pub(crate) frames_delivered: u64,
    pub(crate) frames_lost: u64,
    pub(crate) images_delivered: u64,
    pub(crate) images_lost: u64,
}

impl OutputQueue {
    pub(crate) fn new(max_bytes: usize) -> Self {
        Self {
            max_bytes,
            bytes: Vec::new(),
            written: 0,
            batch: Vec::new(),
            unreported_frames: 0,
            unreported_images: 0,
            counters: OutputCounters::default(),
        }
    }

    /// Bytes that wait.
    pub(crate) fn len(&self) -> usize {
        self.bytes.len() - self.written + self.batch.len()
    }

    /// After a loss there is room again when half of the queue is free, so that losses come in few
    /// groups.
    fn has_room(&self, bytes: usize) -> bool {
        let has_lost = self.unreported_frames > 0 || self.unreported_images > 0;
        let limit = if has_lost { self.max_bytes / 2 } else { self.max_bytes };
        self.len() + bytes <= limit
    }

    /// Adds a frame of the subscription.
    pub(crate) fn push_frame(&mut self, report: &FrameReport) {
        if self.has_room(HEADER_BYTES + FRAME_RECORD_BYTES + MAX_FRAME_RECORD_BYTES) {
            self.push_own(report);
        } else {
            self.lose_frames(1);
        }
    }

    /// Adds the rejection of a frame of the client itself, which counts as no delivered frame.
    pub(crate) fn push_rejection(&mut self, report: &FrameReport) {
        debug_assert!(matches!(report.event, FrameEvent::Rejected(_)));
        self.report_losses(report.time_ns);
        report.encode(&mut self.batch);
    }

    /// Adds the result of a frame of the client itself.
    pub(crate) fn push_own(&mut self, report: &FrameReport) {
        self.report_losses(report.time_ns);
        report.encode(&mut self.batch);
        self.counters.frames_delivered += 1;
        if self.batch.len() >= BATCH_BYTES {
            self.end_batch();
        }
    }

    /// Counts frames that never reached this queue, or found it full.
    pub(crate) fn lose_frames(&mut self, frames: u64) {
        self.unreported_frames += frames;
        self.counters.frames_lost += frames;
    }

    pub(crate) fn lose_images(&mut self, images: u32) {
        self.unreported_images = self.unreported_images.saturating_add(images);
        self.counters.images_lost += u64::from(images);
    }

    fn report_losses(&mut self, time_ns: u64) {
        while self.unreported_frames > 0 {
            let frames = u32::try_from(self.unreported_frames).unwrap_or(u32::MAX);
            FrameRecord::Lost { time_ns, frames }.encode(&mut self.batch);
            self.unreported_frames -= u64::from(frames);
        }
    }

    /// Adds an image; its `lost` is set here.
    pub(crate) fn push_image(&mut self, image: ImageMessage<'_>) {
        let length = IMAGE_HEAD_BYTES + image.image.len();
        if !self.has_room(HEADER_BYTES + length) {
            return self.lose_images(1);
        }
        self.end_batch();
        let lost = std::mem::take(&mut self.unreported_images);
        self.bytes.extend_from_slice(&header(MessageKind::Image, length));
        ImageMessage { lost, ..image }.encode(&mut self.bytes);
        self.counters.images_delivered += 1;
    }

    /// Adds a response or notification.
    pub(crate) fn push_response(&mut self, response: &Response) {
        self.end_batch();
        // infallible: no map of a response has keys that are not text
        let payload = serde_json::to_vec(response).unwrap_or_default();
        self.bytes.extend_from_slice(&header(MessageKind::Rpc, payload.len()));
        self.bytes.extend_from_slice(&payload);
    }

    /// Ends the batch that is being filled; reports losses as soon as there is room.
    pub(crate) fn end_batch(&mut self) {
        if self.unreported_frames > 0 && self.has_room(HEADER_BYTES + FRAME_RECORD_BYTES) {
            self.report_losses(0);
        }
        if !self.batch.is_empty() {
            self.bytes.extend_from_slice(&header(MessageKind::Frames, self.batch.len()));
            self.bytes.append(&mut self.batch);
        }
    }

    /// Bytes to write now.
    pub(crate) fn pending(&self) -> &[u8] {
        self.bytes.get(self.written..).unwrap_or_default()
    }

    /// Bytes were written.
    pub(crate) fn advance(&mut self, written: usize) {
        self.written += written;
        if self.written >= self.bytes.len() {
            self.bytes.clear();
            self.written = 0;
            // Memory of a burst.
            self.bytes.shrink_to(2 * BATCH_BYTES);
        } else if self.written > self.max_bytes {
            self.bytes.drain(..self.written);
            self.written = 0;
        }
    }
}

/// Report of a frame that the service rejected.
pub(crate) fn rejection(
    (gateway, channel): (u16, u8),
    tag: u32,
    frame: CanFrame,
    reason: crate::protocol::RejectReason,
) -> FrameReport {
    FrameReport { time_ns: 0, gateway, channel, tag, event: FrameEvent::Rejected(reason), frame }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::CanId;
    use ecan_protocol::image::PdoProfile;
    use ecan_protocol::mapping::Direction;
    use proptest::prelude::*;

    use super::*;
    use crate::protocol::{FrameRecords, MessageReader, Sender};

    fn report(number: u64) -> FrameReport {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &number.to_le_bytes()).unwrap();
        FrameReport {
            time_ns: number,
            gateway: 0,
            channel: 0,
            tag: 0,
            event: FrameEvent::Received,
            frame,
        }
    }

    #[derive(Debug, Clone, Copy)]
    enum Step {
        Frame,
        Own,
        Image,
        Response,
        LoseInRing(u64),
        EndBatch,
        Write(usize),
    }

    #[test]
    fn room_is_that_of_the_longest_record_and_half_of_it_after_a_loss() {
        let longest = HEADER_BYTES + FRAME_RECORD_BYTES + MAX_FRAME_RECORD_BYTES;
        let lost = |max_bytes| {
            let mut queue = OutputQueue::new(max_bytes);
            queue.push_frame(&report(1));
            queue.counters.frames_lost
        };
        assert_eq!([longest - 1, longest].map(lost), [1, 0]);
        let mut queue = OutputQueue::new(2 * longest);
        queue.push_frame(&report(1));
        let waiting = queue.len();
        assert!(queue.has_room(2 * longest - waiting));
        queue.lose_images(1);
        assert!(!queue.has_room(longest - waiting + 1) && queue.has_room(longest - waiting));
    }

    fn any_step() -> impl Strategy<Value = Step> {
        prop_oneof![
            30 => Just(Step::Frame),
            3 => Just(Step::Own),
            5 => Just(Step::Image),
            1 => Just(Step::Response),
            1 => (0_u64..9).prop_map(Step::LoseInRing),
            10 => Just(Step::EndBatch),
            8 => (0_usize..4000).prop_map(Step::Write),
        ]
    }

    proptest! {
        /// The client can reconstruct all losses from its bytes: frames arrive in order, and each gap
        /// has a record with its length before the next frame.
        #[test]
        fn every_loss_is_reported_in_order(steps in prop::collection::vec(any_step(), 1..400)) {
            let max_bytes = 8192;
            let mut queue = OutputQueue::new(max_bytes);
            let mut stream = Vec::new();
            let (mut next, mut images) = (0, 0);
            let profile = PdoProfile::default();
            let image = vec![0; profile.pdo_bytes()];
            let mut own = 0;
            for step in steps {
                match step {
                    Step::Frame => queue.push_frame(&report(next)),
                    Step::Own => {
                        queue.push_own(&report(next));
                        own += 2 * MAX_FRAME_RECORD_BYTES;
                    }
                    Step::LoseInRing(frames) => {
                        queue.lose_frames(frames);
                        next += frames;
                    }
                    Step::Image => queue.push_image(ImageMessage {
                        time_ns: 0,
                        cycle: 0,
                        lost: 0,
                        gateway: 0,
                        direction: Direction::TxPdo,
                        profile,
                        image: &image,
                    }),
                    Step::Response => {
                        queue.push_response(&Response::notification("x", Default::default()));
                        own += 64;
                    }
                    Step::EndBatch => queue.end_batch(),
                    Step::Write(bytes) => {
                        let count = bytes.min(queue.pending().len());
                        stream.extend_from_slice(&queue.pending()[..count]);
                        queue.advance(count);
                    }
                }
                next += u64::from(matches!(step, Step::Frame | Step::Own));
                images += u64::from(matches!(step, Step::Image));
                prop_assert!(queue.len() <= max_bytes + own);
            }
            // Until everything is written.
            for _ in 0..3 {
                queue.end_batch();
                stream.extend_from_slice(queue.pending());
                queue.advance(queue.pending().len());
            }
            let counters = queue.counters;
            prop_assert_eq!(counters.frames_delivered + counters.frames_lost, next);
            prop_assert_eq!(counters.images_delivered + counters.images_lost, images);
            let (mut expected, mut seen_images) = (0, 0);
            let mut reader = MessageReader::new(Sender::Service);
            reader.push(&stream);
            while let Some((kind, payload)) = reader.next_message().unwrap() {
                match kind {
                    MessageKind::Frames => {
                        for record in FrameRecords::new(payload) {
                            match record.unwrap() {
                                FrameRecord::Lost { frames, .. } => expected += u64::from(frames),
                                FrameRecord::Frame(report) => {
                                    prop_assert_eq!(report.time_ns, expected);
                                    expected += 1;
                                }
                            }
                        }
                    }
                    MessageKind::Image => {
                        let lost = ImageMessage::decode(payload).unwrap().lost;
                        seen_images += 1 + u64::from(lost);
                    }
                    _ => {}
                }
            }
            prop_assert_eq!(expected, next);
            prop_assert_eq!(seen_images + u64::from(queue.unreported_images), images);
            prop_assert_eq!(reader.pending_bytes(), 0);
        }
    }
}
