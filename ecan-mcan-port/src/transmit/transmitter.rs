//! The way out to one gateway: frames into the RxPDO image, and what becomes of the image.
//!
//! An image that carries frames and may not have arrived is published again unchanged: for the
//! gateway a repeat is a no-op. Frames sent meanwhile are collected in a spare image and move
//! into the process image once the held one has arrived.

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
    /// Frames of the image that was published last, until its delivery is known.
    published: Option<Counts>,
    /// The process image holds an image that may not have arrived; filling goes to the spare.
    is_unconfirmed: bool,
    /// The image being filled was begun and not yet ended.
    is_open: bool,
    /// Images in a row whose arrival was not confirmed.
    misses: u16,
    history: TransmitHistory,
    /// Scheduled frames of the image being filled and of the one that was published last.
    filling_scheduled: u8,
    published_scheduled: u8,
    published_sequence: u16,
    accounts: ScheduleAccounts,
    /// The gateway tells of each frame what became of it.
    has_results: bool,
    gives_up_missed: bool,
    windows: [TransmitWindow; CHANNELS],
}

impl Transmitter {
    pub(crate) fn new(
        writer: ImageWriter,
        profile: &PdoProfile,
        queue_depth: u16,
        has_results: bool,
        gives_up_missed: bool,
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
            gives_up_missed,
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

    /// The send that a result belongs to; none where there is no such send.
    pub(crate) fn take_result(&mut self, result: &TxResult) -> Option<OpenFrame> {
        let frame = self.history.take(result)?;
        if frame.tag.is_some() {
            // Of an image that went out more than once, no result tells at which pulse it was there.
            let fate = match result.code {
                ResultCode::Ok | ResultCode::Queued
                    if self.history.is_repeated(result.sequence) =>
                {
                    ScheduledFrameState::Unknown
                }
                code => ScheduledFrameState::Result(code),
            };
            self.accounts.ended(frame.channel, fate);
        }
        Some(frame)
    }

    /// Whether the image that will be published holds scheduled frames.
    pub(crate) fn has_scheduled(&self) -> bool {
        let scheduled =
            if self.is_unconfirmed { self.published_scheduled } else { self.filling_scheduled };
        self.is_open && scheduled > 0
    }

    /// Frames of the image being filled.
    fn filling(&self) -> Counts {
        // infallible: an image holds 255 frames at most
        self.windows.each_ref().map(|window| window.filling() as u8)
    }

    /// Bytes left in the image being filled.
    pub(crate) fn room(&self) -> usize {
        self.writer.room()
    }

    /// Start of a cycle: `delivery` is the fate of the image published in the last one, whose
    /// scheduled frames count from the same pulse as those of this cycle if `is_same_pulse`.
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

    /// The pulse of the held image has passed: published again it sends its scheduled frames a
    /// period late. Where it could do nothing else, it is given up.
    fn pulse_passed(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        let frames: u16 = self.published.iter().flatten().map(|n| u16::from(*n)).sum();
        if self.gives_up_missed && frames == u16::from(self.published_scheduled) {
            self.give_up_published(statistics);
            self.let_go(image);
        } else {
            self.history.repeated(self.published_sequence);
        }
    }

    /// What was filled beside the held image takes its place.
    fn let_go(&mut self, image: &mut [u8]) {
        self.is_unconfirmed = false;
        let packets = HEADER_BYTES..HEADER_BYTES + self.writer.used();
        if let (Some(to), Some(from)) = (image.get_mut(packets.clone()), self.spare.get(packets)) {
            to.copy_from_slice(from);
        }
        self.writer.assume_dirty();
    }

    /// Gives up the published image, of which it is not known whether it arrived.
    fn give_up_published(&mut self, statistics: &mut SlaveStatistics) -> usize {
        let Some(counts) = self.published.take() else { return 0 };
        let frames = count_discarded(&counts, statistics);
        // Results may still come of an image that did arrive.
        if !self.has_results {
            self.close_published(ScheduledFrameState::Unknown);
        }
        frames
    }

    fn close_published(&mut self, fate: ScheduledFrameState) {
        let Self { history, accounts, published_sequence, .. } = self;
        history.close_scheduled(*published_sequence, |channel| accounts.ended(channel, fate));
    }

    /// The published image has arrived.
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
            self.let_go(image);
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

    /// Adds a frame to the image being filled; gives its sequence and index.
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

    /// End of a cycle: publishes the image, or the held one once more.
    pub(crate) fn end(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        if !std::mem::take(&mut self.is_open) {
            // Nothing was begun: the image of the last cycle goes out once more.
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

    /// Gives up every frame that is not known to have arrived, and gives their number. The next
    /// image published is a new one, empty unless frames are sent into it.
    pub(crate) fn discard(&mut self, statistics: &mut SlaveStatistics) -> usize {
        let discarded = self.give_up_published(statistics) + self.withdraw(statistics);
        self.is_unconfirmed = false;
        self.start_image();
        self.writer.assume_dirty();
        discarded
    }

    /// Takes back the frames of the image being filled, and gives their number.
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

    /// The image to be published comes too late for the phase of its scheduled frames: they are
    /// taken back, and the others move up; those of a held one may have left.
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
        // What there is as an image, to be read.
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

    /// The gateway's session starts anew.
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

/// Counts the frames of an image that is given up, and gives their number.
fn count_discarded(counts: &Counts, statistics: &mut SlaveStatistics) -> usize {
    let frames: usize = counts.iter().map(|n| usize::from(*n)).sum();
    statistics.rxpdo_discarded += u64::from(frames > 0);
    for (channel, count) in counts.iter().enumerate() {
        statistics.channels[channel].frames_discarded += u64::from(*count);
    }
    frames
}
