//! Transmit path of one gateway: frames into the RxPDO image, and the delivery of the image.
//!
//! An unconfirmed image that carries frames is sent again unchanged: for the gateway a repeat is a
//! no-op. Frames sent until its delivery is confirmed are collected in a spare image.

use ecan_host::{Delivery, DomainReport};
use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{
    ChannelStatus, CommitFields, FrameBudget, ImageReader, ImageWriter, Packet, PdoProfile,
    PushError, ResultCode, Schedule, Timestamp, TxResult,
};
use ecan_protocol::mapping::{CHANNELS, Direction, HEADER_BYTES};

use super::history::{Counts, UnprovenFrames, Withdrawn, count_withdrawn};
use crate::schedule::account::{ScheduleAccounts, ScheduledFrameState};
use crate::statistics::SlaveStatistics;
use crate::transmit::history::{OpenFrame, TransmitHistory};
use crate::transmit::window::TransmitWindow;

/// Reason for which a frame was not added to the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PushFault {
    /// The image cannot take the frame.
    Image(PushError),
    /// The packet has more bytes than the budget of its channel has left. `most` are those of a channel in an empty
    /// image.
    Share { bytes: usize, most: usize },
}

impl PushFault {
    /// Returns whether a later image may take the frame.
    pub(crate) fn is_temporary(&self) -> bool {
        match self {
            Self::Image(error) => matches!(
                error,
                PushError::NoRoom { .. } | PushError::TooManyPackets | PushError::Buffer { .. }
            ),
            Self::Share { bytes, most } => bytes <= most,
        }
    }
}

#[derive(Debug)]
pub(crate) struct Transmitter {
    writer: ImageWriter,
    /// Bytes that each channel can use, of an empty image and of the one being filled.
    whole_budget: FrameBudget,
    budget: FrameBudget,
    spare: Box<[u8]>,
    /// Frames of the last published image, until its delivery is known.
    published: Option<Counts>,
    /// The published image is unconfirmed; new frames go to the spare image.
    is_unconfirmed: bool,
    /// An exchange of the published image had no certain result: the gateway may have taken it.
    may_be_taken: bool,
    /// Number of the published image, from 1, of the last delivered one, and of the one before.
    published_number: u64,
    delivered_numbers: [u64; 2],
    unproven: UnprovenFrames,
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
            whole_budget: FrameBudget::new(profile),
            budget: FrameBudget::new(profile),
            spare: vec![0; profile.pdo_bytes()].into_boxed_slice(),
            published: None,
            is_unconfirmed: false,
            may_be_taken: false,
            published_number: 0,
            delivered_numbers: [0; 2],
            unproven: UnprovenFrames::default(),
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

    /// Status of the channels in a new TxPDO image.
    #[inline]
    pub(crate) fn status(&mut self, status: &[ChannelStatus; CHANNELS]) {
        for (window, status) in self.windows.iter_mut().zip(status) {
            window.status(*status);
        }
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
    pub(crate) fn take_result(
        &mut self,
        result: &TxResult,
        statistics: &mut SlaveStatistics,
    ) -> Option<OpenFrame> {
        let frame = self.history.take(result)?;
        // A gateway parses images in OP, in order.
        let age = self.published_sequence.wrapping_sub(result.sequence);
        self.prove(self.published_number.saturating_sub(age.into()), statistics);
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
            self.accounts.close_frame(frame.channel, state);
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

    /// Bytes that a channel has left in the image, by its budget.
    pub(crate) fn channel_room(&self, channel: u8) -> usize {
        self.budget.left(channel).min(self.room())
    }

    /// Last image that a gateway which is in OP from now on has parsed: it emptied the buffer for
    /// the one that was delivered after it.
    pub(crate) fn mark(&self) -> u64 {
        self.delivered_numbers[0]
    }

    /// The gateway was in OP when it parsed the images up to this number.
    pub(crate) fn prove(&mut self, number: u64, statistics: &mut SlaveStatistics) {
        let frames = self.unproven.prove(number);
        for (channel, frames) in statistics.channels.iter_mut().zip(frames) {
            channel.frames_delivered += frames;
        }
    }

    /// Nothing proves the state of the gateway when it parsed the images up to this number: their frames
    /// are unknown.
    pub(crate) fn expire_proof(&mut self, number: u64, statistics: &mut SlaveStatistics) {
        let frames = self.unproven.prove(number);
        for (channel, frames) in statistics.channels.iter_mut().zip(frames) {
            channel.frames_unknown += frames;
        }
    }

    /// Frames that were accepted and have no known result yet, per channel.
    pub(crate) fn pending(&self) -> [u64; CHANNELS] {
        let mut pending = self.unproven.frames();
        let (published, filling) = (self.published.unwrap_or_default(), self.filling());
        for (sum, (published, filling)) in pending.iter_mut().zip(published.iter().zip(filling)) {
            *sum += u64::from(*published) + u64::from(filling);
        }
        pending
    }

    /// Start of a cycle: `exchange` of the last published image, whose scheduled frames count from the
    /// same pulse as those of this cycle if `is_same_pulse`.
    pub(crate) fn begin(
        &mut self,
        image: &mut [u8],
        exchange: &DomainReport,
        is_same_pulse: bool,
        statistics: &mut SlaveStatistics,
    ) {
        if self.is_open {
            return;
        }
        let carries_frames = self.published.is_some_and(|counts| counts != [0; CHANNELS]);
        // A working counter of 0 is also that of an answer that was lost.
        let is_missed = exchange.outputs == Delivery::Missed && exchange.working_counter > 0;
        self.may_be_taken |= !is_missed;
        match exchange.outputs {
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
                        self.on_pulse_passed(image, statistics);
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
    fn on_pulse_passed(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        let frames: u16 = self.published.iter().flatten().map(|n| u16::from(*n)).sum();
        if self.discards_missed && frames == u16::from(self.published_scheduled) {
            self.discard_published(statistics);
            self.use_spare(image);
        } else {
            self.history.record_repetition(self.published_sequence);
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
        // Outside a cycle the result of the last exchange is not known.
        let state =
            if self.may_be_taken || !self.is_open { Withdrawn::Unknown } else { Withdrawn::Lost };
        let frames = count_withdrawn(&counts, state, statistics);
        // Results may still arrive for an image that was delivered.
        if !self.has_results {
            self.close_published(ScheduledFrameState::Unknown);
        }
        frames
    }

    fn close_published(&mut self, state: ScheduledFrameState) {
        let Self { history, accounts, published_sequence, .. } = self;
        history
            .close_scheduled(*published_sequence, |channel| accounts.close_frame(channel, state));
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
        if let Some(counts) = self.published.take() {
            self.delivered_numbers = [self.delivered_numbers[1], self.published_number];
            self.unproven.add(self.published_number, &counts);
            for (channel, count) in statistics.channels.iter_mut().zip(counts) {
                channel.frames_confirmed += u64::from(count);
            }
        }
        if self.is_unconfirmed {
            self.use_spare(image);
        } else {
            self.start_image();
        }
    }

    fn start_image(&mut self) {
        self.writer.begin();
        self.budget = self.whole_budget;
        self.filling_scheduled = 0;
        let Self { history, accounts, writer, .. } = self;
        history.make_room(writer.next_sequence(), |channel| {
            accounts.close_frame(channel, ScheduledFrameState::Unknown)
        });
        for window in &mut self.windows {
            window.abandon_image();
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
    ) -> Result<(u16, u8), PushFault> {
        let image = if self.is_unconfirmed { &mut *self.spare } else { image };
        let record = if schedule.is_some() { Timestamp::Full64(0) } else { Timestamp::None };
        let bytes = self.writer.packet_bytes(frame, record);
        if bytes > self.budget.left(channel) && bytes <= self.writer.room() {
            return Err(PushFault::Share { bytes, most: self.whole_budget.left(channel) });
        }
        let pushed = match schedule {
            Some(schedule) => self.writer.push_scheduled(image, channel, id_aux, frame, schedule),
            None => self.writer.push(image, channel, id_aux, frame, Timestamp::None),
        };
        let index = pushed.map_err(PushFault::Image)?;
        self.budget.take(channel, bytes);
        let sequence = self.writer.next_sequence();
        self.window(channel).add_frame();
        self.filling_scheduled += u8::from(schedule.is_some());
        self.history.add_frame(sequence, index, channel, schedule.map(|record| record.tag));
        Ok((sequence, index))
    }

    /// Adds a frame of a transmit queue: the application does not receive its result.
    pub(crate) fn push_queued(
        &mut self,
        image: &mut [u8],
        channel: u8,
        frame: FrameRef<'_>,
    ) -> Result<(), PushFault> {
        let (sequence, index) = self.push(image, channel, 0, frame, None)?;
        self.history.set_queued(sequence, index);
        Ok(())
    }

    /// End of a cycle: publishes the image, or repeats the unconfirmed one. Returns whether the image is
    /// a new one.
    pub(crate) fn end(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) -> bool {
        if !std::mem::take(&mut self.is_open) {
            // Without a begin, the image of the last cycle is sent again.
            self.history.record_repetition(self.published_sequence);
            return false;
        }
        if self.is_unconfirmed {
            statistics.rxpdo_repeated += 1;
            return false;
        }
        self.may_be_taken = false;
        self.published_number += 1;
        self.published_sequence = self.writer.next_sequence();
        self.published_scheduled = std::mem::take(&mut self.filling_scheduled);
        self.writer.commit(image, CommitFields::default());
        self.budget = self.whole_budget;
        statistics.rxpdo_published += 1;
        let filling = self.filling();
        for (channel, count) in filling.iter().enumerate() {
            statistics.channels[channel].frames_sent += u64::from(*count);
        }
        self.published = Some(filling);
        for window in &mut self.windows {
            window.on_published();
        }
        true
    }

    pub(crate) fn profile(&self) -> &PdoProfile {
        self.writer.profile()
    }

    /// Withdraws every frame without confirmed delivery and returns their number. The next published
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
            accounts.close_frame(channel, ScheduledFrameState::Withdrawn)
        });
        let filling = self.filling();
        for window in &mut self.windows {
            window.abandon_image();
        }
        count_withdrawn(&filling, Withdrawn::Discarded, statistics)
    }

    /// Withdraws scheduled frames whose image comes too late for their phase; the others move up.
    /// Frames of an unconfirmed image may have left.
    pub(crate) fn withdraw_late(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        if !self.has_scheduled() {
            return;
        }
        if self.is_unconfirmed {
            self.on_pulse_passed(image, statistics);
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
        let Self { history, accounts, writer, spare, budget, .. } = self;
        history.close_scheduled(sequence, |channel| {
            accounts.close_frame(channel, ScheduledFrameState::Withdrawn)
        });
        history.move_up(sequence);
        writer.begin();
        *budget = self.whole_budget;
        for window in &mut self.windows {
            window.abandon_image();
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
                budget.take(packet.channel, writer.packet_bytes(packet.frame, Timestamp::None));
                self.windows[usize::from(packet.channel) % CHANNELS].add_frame();
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
        for (channel, frames) in statistics.channels.iter_mut().zip(self.unproven.take_all()) {
            channel.frames_unknown += frames;
        }
        self.misses = 0;
        let Self { history, accounts, .. } = self;
        history.reset(|channel| accounts.close_frame(channel, ScheduledFrameState::Unknown));
        accounts.reset();
        for window in &mut self.windows {
            window.reset();
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_host::WcState;
    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags};

    use super::*;

    fn exchange(working_counter: u32) -> DomainReport {
        let outputs = if working_counter & 2 == 0 { Delivery::Missed } else { Delivery::Confirmed };
        let wc_state = if working_counter == 0 { WcState::Zero } else { WcState::Incomplete };
        DomainReport { working_counter, wc_state, outputs, ..DomainReport::default() }
    }

    /// Frames lost and unknown when the session ends after these exchanges of an image.
    fn lost_and_unknown(working_counters: &[u32]) -> (u64, u64) {
        let profile = PdoProfile {
            multiplier: 1,
            channel_mask: 1,
            profile: EncapsulationProfile::Compact,
            budget: BudgetPolicy::Balanced,
            options: OptionFlags::NONE,
        };
        let writer = ImageWriter::new(Direction::RxPdo, profile);
        let mut transmitter = Transmitter::new(writer, &profile, 64, false, true);
        let (mut image, mut statistics) = (vec![0; 128], SlaveStatistics::default());
        transmitter.begin(&mut image, &DomainReport::default(), false, &mut statistics);
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        transmitter.push(&mut image, 0, 0, frame.as_ref(), None).unwrap();
        transmitter.end(&mut image, &mut statistics);
        for (nth, working_counter) in working_counters.iter().enumerate() {
            transmitter.begin(&mut image, &exchange(*working_counter), false, &mut statistics);
            if nth + 1 < working_counters.len() {
                transmitter.end(&mut image, &mut statistics);
            }
        }
        transmitter.reset(&mut statistics);
        (statistics.channels[0].frames_lost, statistics.channels[0].frames_unknown)
    }

    #[test]
    fn image_is_lost_if_no_exchange_can_have_written_it() {
        assert_eq!(lost_and_unknown(&[1, 1, 1]), (1, 0), "reads without the write");
        assert_eq!(lost_and_unknown(&[1, 0, 1]), (0, 1), "an exchange without an answer");
        assert_eq!(lost_and_unknown(&[0, 3]), (0, 1), "taken, not proven");
        assert_eq!(lost_and_unknown(&[]), (0, 1), "no result");
    }
}
