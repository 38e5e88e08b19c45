//! Transmit path of one gateway: frames into the RxPDO image, and the delivery of the image.
//!
//! An unconfirmed image that carries frames is sent again unchanged: for the gateway a repeat is a
//! no-op. Frames sent until its delivery is confirmed are collected in a spare image.

use ecan_host::Delivery;
use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{
    CommitFields, ImageReader, ImageWriter, Packet, PdoProfile, PushError, ResultCode, Schedule,
    Timestamp, TxResult,
};
use ecan_protocol::mapping::{CHANNELS, Direction, HEADER_BYTES};

use crate::schedule::account::{ScheduleAccounts, ScheduledFrameState};
use crate::statistics::SlaveStatistics;
use crate::transmit::history::{OpenFrame, TransmitHistory};
use crate::transmit::window::TransmitWindow;

/// Frames per channel in an image.
type Counts = [u8; CHANNELS];

#[derive(Debug)]
pub(crate) struct Transmitter {
    writer: ImageWriter,
    spare: Box<[u8]>,
    /// Frames of the last published image, until its delivery is known.
    published: Option<Counts>,
    /// The published image is unconfirmed; new frames go to the spare image.
    is_unconfirmed: bool,
    /// An image has begun and not ended.
    is_open: bool,
    /// Unconfirmed images in a row.
    misses: u16,
    history: TransmitHistory,
    /// Scheduled frames of the image being filled and of the last published one.
    filling_scheduled: u8,
    published_scheduled: u8,
    published_sequence: u16,
    accounts: ScheduleAccounts,
    /// The gateway reports a result for each frame.
    has_results: bool,
    discards_missed: bool,
    windows: [TransmitWindow; CHANNELS],
}

impl Transmitter {
    pub(crate) fn new(
        writer: ImageWriter,
        profile: &PdoProfile,
        queue_depth: u16,
        has_results: bool,
        discards_missed: bool,
    ) -> Self {
        Self {
            writer,
            spare: vec![0; profile.pdo_bytes()].into_boxed_slice(),
            published: None,
            is_unconfirmed: false,
            is_open: false,
            misses: 0,
            history: TransmitHistory::new(),
            filling_scheduled: 0,
            published_scheduled: 0,
            published_sequence: 0,
            accounts: ScheduleAccounts::default(),
            has_results,
            discards_missed,
            windows: std::array::from_fn(|_| TransmitWindow::new(queue_depth)),
        }
    }

    pub(crate) fn is_unconfirmed(&self) -> bool {
        self.is_unconfirmed
    }

    pub(crate) fn misses(&self) -> u16 {
        self.misses
    }

    pub(crate) fn window(&mut self, channel: u8) -> &mut TransmitWindow {
        &mut self.windows[usize::from(channel) % CHANNELS]
    }

    pub(crate) fn accounts(&self) -> &ScheduleAccounts {
        &self.accounts
    }

    pub(crate) fn accounts_mut(&mut self) -> &mut ScheduleAccounts {
        &mut self.accounts
    }

    pub(crate) fn has_results(&self) -> bool {
        self.has_results
    }

    /// The sent frame that a result belongs to, if any.
    pub(crate) fn take_result(&mut self, result: &TxResult) -> Option<OpenFrame> {
        let frame = self.history.take(result)?;
        if frame.tag.is_some() {
            // The pulse of an image that was sent more than once is unknown.
            let state = match result.code {
                ResultCode::Ok | ResultCode::Queued
                    if self.history.is_repeated(result.sequence) =>
                {
                    ScheduledFrameState::Unknown
                }
                code => ScheduledFrameState::Result(code),
            };
            self.accounts.ended(frame.channel, state);
        }
        Some(frame)
    }

    pub(crate) fn has_scheduled(&self) -> bool {
        let scheduled =
            if self.is_unconfirmed { self.published_scheduled } else { self.filling_scheduled };
        self.is_open && scheduled > 0
    }

    fn filling(&self) -> Counts {
        // infallible: an image holds 255 frames at most
        self.windows.each_ref().map(|window| window.filling() as u8)
    }

    pub(crate) fn room(&self) -> usize {
        self.writer.room()
    }

    /// Start of a cycle: `delivery` of the last published image, whose scheduled frames count from the
    /// same pulse as those of this cycle if `is_same_pulse`.
    pub(crate) fn begin(
        &mut self,
        image: &mut [u8],
        delivery: Delivery,
        is_same_pulse: bool,
        statistics: &mut SlaveStatistics,
    ) {
        if self.is_open {
            return;
        }
        let carries_frames = self.published.is_some_and(|counts| counts.iter().any(|n| *n > 0));
        match delivery {
            Delivery::Confirmed => {
                self.misses = 0;
                self.release(image, statistics);
            }
            Delivery::Missed | Delivery::Unknown => {
                self.misses = self.misses.saturating_add(1);
                if carries_frames {
                    if !self.is_unconfirmed {
                        self.is_unconfirmed = true;
                        self.start_image();
                    }
                    if !is_same_pulse {
                        self.pulse_passed(image, statistics);
                    }
                } else {
                    self.published = None;
                    self.start_image();
                }
            }
            Delivery::None => self.start_image(),
        }
        self.is_open = true;
    }

    /// The pulse of the unconfirmed image has passed: sent again, its scheduled frames leave a period
    /// late. An image without other frames is discarded.
    fn pulse_passed(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        let frames: u16 = self.published.iter().flatten().map(|n| u16::from(*n)).sum();
        if self.discards_missed && frames == u16::from(self.published_scheduled) {
            self.discard_published(statistics);
            self.use_spare(image);
        } else {
            self.history.repeated(self.published_sequence);
        }
    }

    /// The spare image replaces the unconfirmed one.
    fn use_spare(&mut self, image: &mut [u8]) {
        self.is_unconfirmed = false;
        let packets = HEADER_BYTES..HEADER_BYTES + self.writer.used();
        if let (Some(to), Some(from)) = (image.get_mut(packets.clone()), self.spare.get(packets)) {
            to.copy_from_slice(from);
        }
        self.writer.assume_dirty();
    }

    fn discard_published(&mut self, statistics: &mut SlaveStatistics) -> usize {
        let Some(counts) = self.published.take() else { return 0 };
        let frames = count_discarded(&counts, statistics);
        // Results may still arrive for an image that was delivered.
        if !self.has_results {
            self.close_published(ScheduledFrameState::Unknown);
        }
        frames
    }

    fn close_published(&mut self, state: ScheduledFrameState) {
        let Self { history, accounts, published_sequence, .. } = self;
        history.close_scheduled(*published_sequence, |channel| accounts.ended(channel, state));
    }

    fn release(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        if !self.has_results && self.published_scheduled > 0 {
            let is_repeated = self.history.is_repeated(self.published_sequence);
            self.close_published(if is_repeated {
                ScheduledFrameState::Unknown
            } else {
                ScheduledFrameState::Taken
            });
        }
        for (channel, count) in self.published.take().iter().flatten().enumerate() {
            statistics.channels[channel].frames_delivered += u64::from(*count);
        }
        if self.is_unconfirmed {
            self.use_spare(image);
        } else {
            self.start_image();
        }
    }

    fn start_image(&mut self) {
        self.writer.begin();
        self.filling_scheduled = 0;
        let Self { history, accounts, writer, .. } = self;
        history.make_room(writer.next_sequence(), |channel| {
            accounts.ended(channel, ScheduledFrameState::Unknown)
        });
        for window in &mut self.windows {
            window.abandoned();
        }
    }

    /// Adds a frame to the image being filled; returns its sequence and index.
    #[inline(always)]
    pub(crate) fn push(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
        schedule: Option<Schedule>,
    ) -> Result<(u16, u8), PushError> {
        let image = if self.is_unconfirmed { &mut *self.spare } else { image };
        let index = match schedule {
            Some(schedule) => {
                self.writer.push_scheduled(image, channel, id_aux, frame, schedule)?
            }
            None => self.writer.push(image, channel, id_aux, frame, Timestamp::None)?,
        };
        let sequence = self.writer.next_sequence();
        self.window(channel).frame_added();
        self.filling_scheduled += u8::from(schedule.is_some());
        self.history.frame_added(sequence, index, channel, schedule.map(|it| it.tag));
        Ok((sequence, index))
    }

    /// End of a cycle: publishes the image, or repeats the unconfirmed one.
    pub(crate) fn end(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        if !std::mem::take(&mut self.is_open) {
            // Without a begin, the image of the last cycle is sent again.
            self.history.repeated(self.published_sequence);
            return;
        }
        if self.is_unconfirmed {
            statistics.rxpdo_repeated += 1;
            return;
        }
        self.published_sequence = self.writer.next_sequence();
        self.published_scheduled = std::mem::take(&mut self.filling_scheduled);
        self.writer.commit(image, CommitFields::default());
        statistics.rxpdo_published += 1;
        let filling = self.filling();
        for (channel, count) in filling.iter().enumerate() {
            statistics.channels[channel].frames_sent += u64::from(*count);
        }
        self.published = Some(filling);
        for window in &mut self.windows {
            window.published();
        }
    }

    /// Discards every frame without confirmed delivery and returns their number. The next published
    /// image is a new one.
    pub(crate) fn discard(&mut self, statistics: &mut SlaveStatistics) -> usize {
        let discarded = self.discard_published(statistics) + self.withdraw(statistics);
        self.is_unconfirmed = false;
        self.start_image();
        self.writer.assume_dirty();
        discarded
    }

    fn withdraw(&mut self, statistics: &mut SlaveStatistics) -> usize {
        let sequence = self.writer.next_sequence();
        let Self { history, accounts, .. } = self;
        history.close_scheduled(sequence, |channel| {
            accounts.ended(channel, ScheduledFrameState::Withdrawn)
        });
        let filling = self.filling();
        for window in &mut self.windows {
            window.abandoned();
        }
        count_discarded(&filling, statistics)
    }

    /// Withdraws scheduled frames whose image comes too late for their phase; the others move up.
    /// Frames of an unconfirmed image may have left.
    pub(crate) fn withdraw_late(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        if !self.has_scheduled() {
            return;
        }
        if self.is_unconfirmed {
            self.pulse_passed(image, statistics);
            return;
        }
        let filled = self.filling();
        let frames: u16 = filled.iter().map(|n| u16::from(*n)).sum();
        if frames == u16::from(self.filling_scheduled) {
            self.withdraw(statistics);
            self.start_image();
            return;
        }
        // A copy as a complete image, to be read.
        let packets = HEADER_BYTES..HEADER_BYTES + self.writer.used();
        if let (Some(to), Some(from)) = (self.spare.get_mut(packets.clone()), image.get(packets)) {
            to.copy_from_slice(from);
        }
        self.writer.clone().commit(&mut self.spare, CommitFields::default());
        let reader = ImageReader::new(Direction::RxPdo, *self.writer.profile()).with_crc(false);
        let sequence = self.writer.next_sequence();
        let Self { history, accounts, writer, spare, .. } = self;
        history.close_scheduled(sequence, |channel| {
            accounts.ended(channel, ScheduledFrameState::Withdrawn)
        });
        history.move_up(sequence);
        writer.begin();
        for window in &mut self.windows {
            window.abandoned();
        }
        self.filling_scheduled = 0;
        for packet in reader.read(spare).into_iter().flat_map(|read| read.packets()).flatten() {
            let Packet::Frame(packet) = packet else { continue };
            // In an RxPDO only a schedule is a timestamp.
            let is_kept = packet.timestamp == Timestamp::None
                && writer
                    .push(image, packet.channel, packet.id_aux, packet.frame, Timestamp::None)
                    .is_ok();
            if is_kept {
                self.windows[usize::from(packet.channel) % CHANNELS].frame_added();
            }
        }
        for (channel, (before, now)) in filled.iter().zip(&self.filling()).enumerate() {
            statistics.channels[channel].frames_discarded += u64::from(before.saturating_sub(*now));
        }
    }

    pub(crate) fn published_sequence(&self) -> u16 {
        self.published_sequence
    }

    /// As [`reset`](Self::reset); the sequence continues at another number.
    pub(crate) fn restart(&mut self, sequence: u16, statistics: &mut SlaveStatistics) {
        self.writer.set_next_sequence(sequence);
        self.reset(statistics);
    }

    pub(crate) fn reset(&mut self, statistics: &mut SlaveStatistics) {
        self.discard(statistics);
        self.misses = 0;
        let Self { history, accounts, .. } = self;
        history.reset(|channel| accounts.ended(channel, ScheduledFrameState::Unknown));
        accounts.reset();
        for window in &mut self.windows {
            window.reset();
        }
    }
}

fn count_discarded(counts: &Counts, statistics: &mut SlaveStatistics) -> usize {
    let frames: usize = counts.iter().map(|n| usize::from(*n)).sum();
    statistics.rxpdo_discarded += u64::from(frames > 0);
    for (channel, count) in counts.iter().enumerate() {
        statistics.channels[channel].frames_discarded += u64::from(*count);
    }
    frames
}
