//! State of a gateway and its channels in each cycle, and its changes since the last one.
//!
//! The manual does not say whether the count of received frames that wait (manual 7, bits 10 to 12)
//! includes those that the same image brings. It shows by itself: an image with more frames of a
//! channel than its status counts proves that it does not, and answers to SDO requests bring such
//! images long before an axis is activated. Until then it is assumed to include them.
//!
//! An application may skip cycles, or another part of it may take items first. Then the Port's
//! counters show what was missed: a channel that left the bus, and failed transmit results.

use ecan_mcan_port::{
    ChannelStatistics, CycleReport, ImageReport, Port, SlaveStatistics, TransmitReport,
};
use ecan_protocol::image::{ChannelState, ChannelStatus, ImageFault};
use ecan_protocol::mapping::CHANNELS;

use super::terms::{Actual, ChannelView, PathStatus, PositionUnavailable};

/// Value at which the count of waiting frames in a channel's status saturates (manual 7).
const SATURATED: u8 = 7;

/// Cycles in a row in which everything came, the present one included, before a position can be
/// fresh.
const STEADY: u8 = 3;

/// Images whose frames may wait in the gateway while the bus sends: one that the status of the
/// channel does not include yet, and the last one that it includes.
const NEWEST_IMAGES: usize = 2;

/// Numbers of confirmed frames that are kept: for the newest images, and for those that a scheduled
/// frame waits.
const HISTORY: usize = 16;

/// Most cycles without a new image after which the status of a channel is used.
const MAX_IMAGE_AGE: u32 = 1;

/// Frames of a channel that wait in the gateway although newer ones were sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Backlog {
    /// At most the frames of one image wait.
    None,
    /// The frames of more than one image wait, or an unknown number, since the count is saturated or old: a full bus, or
    /// one that does not send. Only answers of drives on the channel show the difference.
    Suspected,
    /// The frames of more than the newest images wait.
    Waiting,
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct GatewayWatch {
    pub(crate) slave: usize,
    /// Of the last cycle that was observed.
    report: CycleReport,
    is_current: bool,
    /// Cycles from SYNC to SYNC.
    sync_cycles: u32,
    /// Cycles since the last new image.
    image_age: u32,
    /// New images that a scheduled frame may wait in the gateway.
    pub(crate) schedule_images: u16,
    is_ready: bool,
    discarded: bool,
    images_discarded: u64,
    incomplete_cycles: u64,
    skipped_incomplete: u16,
    /// The count of waiting frames is known not to include those of its own image.
    counts_left_only: bool,
    channels: [ChannelWatch; CHANNELS],
}

/// What a Port reports of a gateway in a cycle.
struct GatewayCycle {
    report: CycleReport,
    statistics: SlaveStatistics,
    is_ready: bool,
    channels: [ChannelStatus; CHANNELS],
}

#[derive(Debug, Clone, Copy, Default)]
struct ChannelWatch {
    status: ChannelStatus,
    /// Counters of the last cycle that was observed.
    counters: ChannelStatistics,
    queue_rejected: bool,
    image_full: bool,
    /// Frames were withdrawn, a SYNC or targets among them: the image was too late for their phase.
    frames_discarded: bool,
    /// An image since then, observed or not, reported that the channel was off the bus.
    was_bus_off: bool,
    was_stopped: bool,
    /// Failed transmit results that the axes took, in this cycle.
    failures_taken: u64,
    /// Failed transmit results since then that the axes did not take.
    failures_missed: bool,
    /// Frames that the image of this cycle brought.
    in_image: u64,
    /// Frames that the newest image and the one before left in the gateway; `None` is unknown.
    left: Option<u64>,
    left_before: Option<u64>,
    /// Many may be left: the count is saturated, and the image brought fewer than that.
    may_pile_up: bool,
    /// Cycles in a row in which everything came that there was.
    steady: u8,
    /// A drive sent a TPDO: in this cycle, and the cycles since.
    has_answered: bool,
    answer_age: u32,
    /// Frames of confirmed images: now, and one, two, .. new images ago.
    confirmed: [u64; HISTORY],
}

impl GatewayWatch {
    pub(crate) fn new(slave: usize, sync_cycles: u32) -> Self {
        Self { slave, sync_cycles, ..Self::default() }
    }

    fn forget_cycles(&mut self) {
        let Self { slave, sync_cycles, schedule_images, .. } = *self;
        *self = Self { schedule_images, ..Self::new(slave, sync_cycles) };
    }

    /// A transmit report that the axes took.
    pub(crate) fn take_report(&mut self, report: &TransmitReport) {
        if report.ticket.is_some()
            && !report.code.is_success()
            && let Some(channel) = self.channels.get_mut(usize::from(report.channel))
        {
            channel.failures_taken += 1;
        }
    }

    /// A TPDO of a drive on a channel arrived: an answer to a SYNC.
    pub(crate) fn take_tpdo(&mut self, channel: u8) {
        if let Some(channel) = self.channels.get_mut(usize::from(channel)) {
            channel.has_answered = true;
        }
    }

    /// Once per cycle, when everything received has been taken out: only then is a fault after
    /// the first packets known. Cycles may be left out; a second call in a cycle does nothing.
    pub(crate) fn observe(&mut self, port: &Port) {
        let Ok(gateway) = port.gateway(self.slave) else {
            // A reconfiguration removed the gateway.
            self.forget_cycles();
            return;
        };
        let report = port.cycle_report(gateway);
        if report.cycle == self.report.cycle {
            return;
        }
        let slave = self.slave;
        let status = |channel| {
            let handle = port.channel(slave, channel);
            handle.map_or_else(|_| ChannelStatus::default(), |handle| port.channel_status(handle))
        };
        self.note_cycle(&GatewayCycle {
            report,
            statistics: port.statistics(gateway),
            is_ready: port.gateway_is_ready(gateway),
            channels: [0, 1, 2, 3].map(status),
        });
    }

    fn note_cycle(&mut self, cycle: &GatewayCycle) {
        let GatewayCycle { report, statistics, is_ready, channels } = cycle;
        let before = std::mem::replace(&mut self.report, *report);
        let is_first = before.cycle == 0;
        let is_same_session = report.ready_since == before.ready_since;
        let was_interrupted = self.is_ready && !is_same_session;
        self.is_ready = *is_ready && !was_interrupted;
        if is_first || !is_same_session {
            // What happened earlier concerns others, and a reconfiguration resets the counters.
            self.images_discarded = statistics.rxpdo_discarded;
            self.incomplete_cycles = statistics.incomplete_cycles;
            for (channel, counters) in self.channels.iter_mut().zip(statistics.channels) {
                *channel = ChannelWatch { counters, ..ChannelWatch::default() };
            }
        }
        self.discarded = statistics.rxpdo_discarded != self.images_discarded;
        self.images_discarded = statistics.rxpdo_discarded;
        let incomplete = statistics.incomplete_cycles.saturating_sub(self.incomplete_cycles);
        self.incomplete_cycles = statistics.incomplete_cycles;
        let skipped = incomplete.saturating_sub(u64::from(!report.domain.is_complete()));
        self.skipped_incomplete = u16::try_from(skipped).unwrap_or(u16::MAX);
        let has_skipped = report.cycle > before.cycle + 1;
        let is_new = matches!(report.image, ImageReport::New { .. });
        for ((channel, status), (counters, frames)) in self
            .channels
            .iter_mut()
            .zip(channels)
            .zip(statistics.channels.iter().zip(report.frames))
        {
            if has_skipped {
                channel.steady = 0;
            }
            channel.in_image = frames.into();
            channel.answer_age = match std::mem::take(&mut channel.has_answered) {
                true => 0,
                false => channel.answer_age.saturating_add(1),
            };
            if is_new {
                channel.status = *status;
                let counted = channel.status.rx_pending();
                self.counts_left_only |=
                    counted < SATURATED && u64::from(counted) < channel.in_image;
                channel.note_left(report.image, self.counts_left_only);
            }
            channel.note(counters, is_new);
        }
        self.image_age = if is_new { 0 } else { self.image_age.saturating_add(1) };
        let flows = report.domain.is_complete() && !report.is_unconfirmed;
        for channel in &mut self.channels {
            let actual = channel.classify(report.image, Some(0));
            let is_clear = flows && matches!(actual, Actual::Fresh(_));
            channel.steady = if is_clear { channel.steady.saturating_add(1) } else { 0 };
        }
    }

    /// Before sending: notes whether this cycle is the last one observed.
    pub(crate) fn begin_send(&mut self, port: &Port) {
        let gateway = port.gateway(self.slave);
        self.is_current =
            gateway.is_ok_and(|gateway| port.cycle_report(gateway).cycle == self.report.cycle);
    }

    /// Returns whether the present cycle was observed.
    pub(crate) fn is_current(&self) -> bool {
        self.is_current
    }

    /// Returns whether the last image is repeated, so that nothing should be added.
    pub(crate) fn is_unconfirmed(&self) -> bool {
        self.report.is_unconfirmed
    }

    /// Returns whether frames can be sent now.
    pub(crate) fn is_open(&self) -> bool {
        self.is_ready && !self.is_unconfirmed()
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// Returns whether frames of the gateway may be missing in this cycle.
    pub(crate) fn lacks_image(&self) -> bool {
        self.image_age > 0
    }

    pub(crate) fn path(&self, channel: u8, target_lost: bool) -> PathStatus {
        let watch = self.channel(channel);
        let [confirmed, _, covered, ..] = watch.confirmed;
        PathStatus {
            is_ready: self.is_ready,
            is_complete: self.report.domain.is_complete(),
            is_unconfirmed: self.report.is_unconfirmed,
            discarded: self.discarded || watch.frames_discarded,
            queue_rejected: watch.queue_rejected,
            image_full: watch.image_full,
            skipped_incomplete: self.skipped_incomplete,
            target_lost: target_lost || watch.failures_missed,
            channel: watch.view(self.report.image),
            has_backlog: match self.backlog(channel) {
                Backlog::None => false,
                Backlog::Suspected => !watch.is_answering(self.sync_cycles),
                Backlog::Waiting => true,
            },
            confirmed,
            covered,
        }
    }

    /// Returns whether a SYNC would only be added to frames that wait in the gateway. While no axis of the
    /// channel is active, nothing but its SYNC can bring an answer.
    pub(crate) fn withholds_sync(&self, channel: u8, has_active_axis: bool) -> bool {
        match self.backlog(channel) {
            Backlog::None => false,
            Backlog::Suspected => {
                has_active_axis && !self.channel(channel).is_answering(self.sync_cycles)
            }
            Backlog::Waiting => true,
        }
    }

    /// Frames of a channel that wait in the gateway, by the newest status and the images since.
    fn backlog(&self, channel: u8) -> Backlog {
        let watch = self.channel(channel);
        let pending = watch.status.tx_pending();
        let waiting = u64::from(pending);
        let scheduled = usize::from(self.schedule_images).min(HISTORY - 1 - NEWEST_IMAGES);
        if watch.status.tx_pressure() || waiting > watch.confirmed_in(0, NEWEST_IMAGES + scheduled)
        {
            Backlog::Waiting
        } else if pending >= SATURATED
            || waiting > watch.confirmed_in(1, 1 + scheduled)
            || self.image_age > MAX_IMAGE_AGE
        {
            Backlog::Suspected
        } else {
            Backlog::None
        }
    }

    pub(crate) fn actual(&self, channel: u8, position: Option<i32>) -> Actual {
        let watch = self.channel(channel);
        match watch.classify(self.report.image, position) {
            Actual::Fresh(position) if watch.steady < STEADY => Actual::Late(position),
            actual => actual,
        }
    }

    /// Channels above 3 do not occur; they share the last one.
    fn channel(&self, channel: u8) -> &ChannelWatch {
        let [.., last] = &self.channels;
        self.channels.get(usize::from(channel)).unwrap_or(last)
    }
}

impl ChannelWatch {
    /// Changes of the counters since the last cycle that was observed.
    fn note(&mut self, counters: &ChannelStatistics, is_new: bool) {
        let before = std::mem::replace(&mut self.counters, *counters);
        self.queue_rejected = counters.rejected_queue_full != before.rejected_queue_full;
        self.frames_discarded = counters.frames_discarded != before.frames_discarded;
        self.image_full = counters.rejected_image_full != before.rejected_image_full;
        self.was_bus_off = counters.bus_off_images != before.bus_off_images;
        self.was_stopped = counters.not_running_images != before.not_running_images;
        let failures = counters.results_failed.saturating_sub(before.results_failed);
        self.failures_missed = failures > std::mem::take(&mut self.failures_taken);
        if is_new {
            self.confirmed.rotate_right(1);
        }
        if let Some(latest) = self.confirmed.first_mut() {
            *latest = counters.frames_confirmed;
        }
    }

    /// Returns whether the bus has sent the SYNC of the last period.
    fn is_answering(&self, sync_cycles: u32) -> bool {
        self.answer_age < sync_cycles
    }

    /// Frames confirmed with a number of images, without the newest ones.
    fn confirmed_in(&self, newest: usize, images: usize) -> u64 {
        let at = |nth: usize| self.confirmed.get(nth).copied().unwrap_or_default();
        at(newest).saturating_sub(at(newest + images))
    }

    fn view(&self, image: ImageReport) -> ChannelView {
        match view(image, self.status) {
            // The channel is on the bus again; the frames that waited in the gateway are lost.
            ChannelView::NotSeen | ChannelView::Running { .. } if self.was_bus_off => {
                ChannelView::BusOff
            }
            ChannelView::NotSeen | ChannelView::Running { .. } if self.was_stopped => {
                ChannelView::NotRunning
            }
            view => view,
        }
    }

    /// A new image: notes what it left in the gateway. `left_only`: its status does not count the
    /// frames that it brought.
    fn note_left(&mut self, image: ImageReport, left_only: bool) {
        let counted = self.status.rx_pending();
        let own = if left_only { 0 } else { self.in_image };
        let was_lost = matches!(image, ImageReport::New { lost: 1.., .. });
        self.left_before = if was_lost { None } else { self.left };
        self.left = (counted < SATURATED).then(|| u64::from(counted).saturating_sub(own));
        self.may_pile_up = counted >= SATURATED && own < u64::from(SATURATED);
    }

    fn classify(&self, image: ImageReport, position: Option<i32>) -> Actual {
        match image {
            ImageReport::None | ImageReport::Repeated => Actual::None(PositionUnavailable::NoImage),
            ImageReport::Fault(diagnosis) => Actual::None(match diagnosis.fault {
                ImageFault::Updating | ImageFault::Torn => PositionUnavailable::NoImage,
                ImageFault::Pdo(_) => PositionUnavailable::Damaged,
            }),
            ImageReport::New { layout_changed: true, .. } => {
                Actual::None(PositionUnavailable::Layout)
            }
            ImageReport::New { is_incomplete: true, .. } => {
                Actual::None(PositionUnavailable::Incomplete)
            }
            ImageReport::New { .. } => match position {
                None => Actual::None(PositionUnavailable::NoTpdo),
                Some(position) => self.classify_age(position),
            },
        }
    }

    /// The gateway keeps the order of the frames: once those come that the last image left, what is
    /// left now arrived after the last image was built.
    fn classify_age(&self, position: i32) -> Actual {
        let has_caught_up = self.left_before.is_some_and(|left| left <= self.in_image);
        if self.status.rx_pressure() {
            Actual::None(PositionUnavailable::Backlog)
        } else if has_caught_up || self.left == Some(0) {
            Actual::Fresh(position)
        } else if self.may_pile_up {
            Actual::None(PositionUnavailable::Backlog)
        } else {
            Actual::Late(position)
        }
    }
}

fn view(image: ImageReport, status: ChannelStatus) -> ChannelView {
    if !matches!(image, ImageReport::New { .. }) {
        return ChannelView::NotSeen;
    }
    if status.bus_off() || status.state() == ChannelState::BusOff {
        return ChannelView::BusOff;
    }
    match status.state() {
        ChannelState::Run => {
            ChannelView::Running { pending: status.tx_pending(), pressure: status.tx_pressure() }
        }
        _ => ChannelView::NotRunning,
    }
}

#[cfg(test)]
mod tests;
