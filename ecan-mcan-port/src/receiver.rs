//! Receive path of one gateway: checks TxPDO images once and hands out their packets.

use ecan_host::{Delivery, DomainReport};
use ecan_protocol::image::{
    Arrival, ChannelStatus, Header, Image, ImageFault, ImageReader, Packet, PacketCursor, Packets,
    ParseDiagnosis, PdoProfile, SequenceTracker,
};
use ecan_protocol::mapping::{CHANNELS, HEADER_BYTES};

use crate::statistics::SlaveStatistics;

#[derive(Debug)]
pub(crate) struct Receiver {
    reader: ImageReader,
    numbering: ImageNumbering,
    report: ImageReport,
    last_diagnosis: Option<ParseDiagnosis>,
    /// Header of the last new image.
    header: Header,
    /// The first of its packets that were not handed out, if any.
    pub(crate) pending: Option<PacketCursor>,
    /// Frames of each channel that were taken out of earlier images.
    taken_before: [u64; CHANNELS],
    /// Cycles in a row without a new image.
    misses: u16,
}

impl Receiver {
    pub(crate) fn new(reader: ImageReader) -> Self {
        Self {
            reader,
            numbering: ImageNumbering::default(),
            report: ImageReport::None,
            last_diagnosis: None,
            header: Header::parse(&[0; HEADER_BYTES]),
            pending: None,
            taken_before: [0; CHANNELS],
            misses: 0,
        }
    }

    /// Frames of each channel that were taken out of the image of this cycle.
    pub(crate) fn frames(&self, statistics: &SlaveStatistics) -> [u8; CHANNELS] {
        let mut frames = [0; CHANNELS];
        if self.report == ImageReport::None {
            return frames;
        }
        let counters = statistics.channels.iter().zip(self.taken_before);
        for (frames, (channel, before)) in frames.iter_mut().zip(counters) {
            // infallible: an image holds 255 frames at most
            *frames = channel.frames_received.saturating_sub(before) as u8;
        }
        frames
    }

    pub(crate) fn misses(&self) -> u16 {
        self.misses
    }

    pub(crate) fn report(&self) -> ImageReport {
        self.report
    }

    pub(crate) fn status(&self) -> &[ChannelStatus; CHANNELS] {
        &self.header.channel_status
    }

    pub(crate) fn profile(&self) -> &PdoProfile {
        self.reader.profile()
    }

    pub(crate) fn last_diagnosis(&self) -> Option<ParseDiagnosis> {
        self.last_diagnosis
    }

    /// A session begins or ends. The last image stays known: the memory still holds it.
    pub(crate) fn reset(&mut self) {
        self.report = ImageReport::None;
        self.pending = None;
        self.misses = 0;
    }

    /// Checks the image of this cycle (manual 6.1); returns whether it is a new one.
    pub(crate) fn begin(
        &mut self,
        image: &[u8],
        fetched: Delivery,
        statistics: &mut SlaveStatistics,
    ) -> bool {
        self.pending = None;
        self.taken_before = statistics.channels.each_ref().map(|channel| channel.frames_received);
        self.misses = self.misses.saturating_add(1);
        match self.reader.read(image) {
            Ok(image) => {
                // Nothing has arrived so far: what the memory holds is not new.
                let is_old = fetched == Delivery::Missed && !self.numbering.has_image();
                let missing = match is_old {
                    true => None,
                    false => self.numbering.observe(image.sequence()),
                };
                let Some(missing) = missing else {
                    if fetched != Delivery::Confirmed {
                        self.numbering.record_miss(|| true);
                    }
                    statistics.txpdo_repeated += 1;
                    self.report = ImageReport::Repeated;
                    return false;
                };
                let lost = missing.lost;
                let (is_incomplete, layout_changed) =
                    (image.is_incomplete(), image.layout_changed());
                self.report = ImageReport::New { lost, is_incomplete, layout_changed };
                self.header = *image.header();
                self.pending = Some(PacketCursor::default());
                self.misses = 0;
                statistics.txpdo_received += 1;
                statistics.txpdo_lost += u64::from(lost);
                statistics.txpdo_unknown += missing.unknown;
                statistics.txpdo_incomplete += u64::from(is_incomplete);
                statistics.txpdo_layout_changes += u64::from(layout_changed);
                true
            }
            Err(_) if fetched == Delivery::Missed => {
                // Still the faulty image of an earlier cycle.
                self.numbering.record_miss(|| true);
                statistics.txpdo_repeated += 1;
                self.report = ImageReport::Repeated;
                false
            }
            Err(diagnosis) => {
                self.numbering.record_miss(|| true);
                self.fault(diagnosis, statistics);
                false
            }
        }
    }

    /// Counts the image of a cycle in which the gateway is not ready: nothing is handed out.
    /// `may_publish`: it may be in SAFEOP or OP.
    pub(crate) fn pass_over(
        &mut self,
        image: &[u8],
        fetched: Delivery,
        may_publish: impl FnOnce() -> bool,
        statistics: &mut SlaveStatistics,
    ) {
        self.numbering.allow_restart();
        let read = (fetched != Delivery::Missed).then(|| self.reader.read(image));
        match read {
            Some(Ok(image)) => {
                if let Some(missing) = self.numbering.observe(image.sequence()) {
                    if statistics.sessions > 0 {
                        count_passed_over(&image, missing, statistics);
                    }
                    return;
                }
                if fetched == Delivery::Confirmed {
                    return;
                }
            }
            Some(Err(_)) if fetched == Delivery::Confirmed => {
                return self.numbering.record_miss(|| true);
            }
            _ => {}
        }
        self.numbering.record_miss(may_publish);
    }

    /// Records a fault; the packets before it were handed out and stay valid.
    #[cold]
    pub(crate) fn fault(&mut self, diagnosis: ParseDiagnosis, statistics: &mut SlaveStatistics) {
        match diagnosis.fault {
            ImageFault::Updating | ImageFault::Torn => statistics.txpdo_torn += 1,
            ImageFault::Pdo(_) => statistics.parse_errors += 1,
        }
        self.last_diagnosis = Some(diagnosis);
        self.report = ImageReport::Fault(diagnosis);
    }

    /// Hands out the packets that are left of the image of this cycle.
    #[inline]
    pub(crate) fn resume<'i>(&mut self, image: &'i [u8]) -> Option<Packets<'i>> {
        let cursor = self.pending.take()?;
        Some(self.reader.resume(image, &self.header, cursor))
    }
}

fn count_passed_over(image: &Image<'_>, missing: MissingImages, statistics: &mut SlaveStatistics) {
    statistics.txpdo_discarded += 1;
    statistics.txpdo_lost += u64::from(missing.lost);
    statistics.txpdo_unknown += missing.unknown;
    for packet in image.packets().flatten() {
        if let Packet::Frame(packet) = packet {
            statistics.channel(packet.channel).frames_not_taken += 1;
        }
    }
}

/// Images that a gateway published before a new one, and that did not arrive.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct MissingImages {
    /// By the sequence.
    pub(crate) lost: u16,
    /// At most, before the gateway started its sequence again.
    pub(crate) unknown: u64,
}

/// Exchanges after an image that count as possible even if the master reports the slave as absent:
/// its report may be wrong for some cycles.
const ALWAYS_POSSIBLE: u64 = 32;

#[derive(Debug, Clone, Default)]
pub(crate) struct ImageNumbering {
    tracker: SequenceTracker,
    /// Exchanges without a known result since the last image, and those of them that may have taken
    /// another image.
    missed: u64,
    open: u64,
    /// The numbers may have started again since the last image.
    may_restart: bool,
}

impl ImageNumbering {
    /// Returns whether an image was observed.
    pub(crate) fn has_image(&self) -> bool {
        self.tracker.last().is_some()
    }

    /// An exchange without a known result. `may_publish`: the gateway may be in SAFEOP or OP.
    #[inline]
    pub(crate) fn record_miss(&mut self, may_publish: impl FnOnce() -> bool) {
        self.missed = self.missed.saturating_add(1);
        if self.missed <= ALWAYS_POSSIBLE || may_publish() {
            self.open = self.open.saturating_add(1);
        }
    }

    /// The numbers may start again from here on, until the next image.
    #[inline]
    pub(crate) fn allow_restart(&mut self) {
        self.may_restart = true;
    }

    /// A valid image; `None` if it is the last one again.
    #[inline]
    pub(crate) fn observe(&mut self, sequence: u16) -> Option<MissingImages> {
        let is_first = !self.has_image();
        let arrival = self.tracker.observe(sequence);
        if arrival == Arrival::Repeated {
            return None;
        }
        let (missed, open) = (std::mem::take(&mut self.missed), std::mem::take(&mut self.open));
        let may_restart = std::mem::take(&mut self.may_restart);
        let lost = match arrival {
            _ if is_first => return Some(MissingImages::default()),
            Arrival::Gap { lost } => Some(lost),
            Arrival::Repeated | Arrival::Next => Some(0),
            Arrival::First => None,
        };
        // The image in the buffer is dropped when the gateway leaves SAFEOP.
        let most = missed + u64::from(missed > 0);
        let restarts = may_restart && u64::from(sequence) <= most + 1 && missed > 0;
        let is_exact = |lost: &u16| !may_restart || (!restarts && u64::from(*lost) <= most);
        Some(match lost.filter(is_exact) {
            Some(lost) => MissingImages { lost, unknown: 0 },
            None => {
                let since_restart = u64::from(sequence).saturating_sub(1).min(most);
                let unknown = open + u64::from(open > 0) + since_restart;
                MissingImages { lost: 0, unknown }
            }
        })
    }
}

/// Result of checking the TxPDO image of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ImageReport {
    /// The gateway is not ready.
    #[default]
    None,
    /// A new image.
    New {
        /// Images that were lost before it, by the sequence.
        lost: u16,
        /// The gateway marked it as incomplete (truncated or overflowed, manual 6.1).
        is_incomplete: bool,
        /// The layout of the image is not the configured one: its frames may be misread.
        layout_changed: bool,
    },
    /// The image of an earlier cycle again: nothing new arrived.
    Repeated,
    /// An image that cannot be used, or only up to the fault.
    Fault(ParseDiagnosis),
}

/// One cycle with one gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleReport {
    /// The working counter and its meaning.
    pub domain: DomainReport,
    /// The TxPDO image.
    pub image: ImageReport,
    /// The delivery of the last RxPDO image is not confirmed, and it is sent again unchanged. Frames
    /// sent now wait for the next image.
    pub is_unconfirmed: bool,
    /// Number of the cycle, from 1, over all reconfigurations of the Port. An observer that finds
    /// a gap has not seen every cycle.
    pub cycle: u64,
    /// Cycle in which the gateway became ready the last time; 0 if it never was. A change means
    /// that it was not ready in between.
    pub ready_since: u64,
    /// Frames of each channel that were taken out of the TxPDO image of this cycle, by any part of
    /// the application.
    pub frames: [u8; CHANNELS],
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: MissingImages = MissingImages { lost: 0, unknown: 0 };

    fn after(sequence: u16, missed: u64, may_restart: bool) -> ImageNumbering {
        let mut numbering = ImageNumbering::default();
        assert_eq!(numbering.observe(sequence), Some(KNOWN));
        (0..missed).for_each(|_| numbering.record_miss(|| false));
        if may_restart {
            numbering.allow_restart();
        }
        numbering
    }

    fn unknown(unknown: u64) -> Option<MissingImages> {
        Some(MissingImages { lost: 0, unknown })
    }

    fn lost(lost: u16) -> Option<MissingImages> {
        Some(MissingImages { lost, unknown: 0 })
    }

    #[test]
    fn gap_in_a_session_is_exact() {
        let mut numbering = after(7, 3, false);
        assert_eq!(numbering.observe(7), None);
        assert_eq!(numbering.observe(10), lost(2));
        assert_eq!(numbering.observe(11), Some(KNOWN));
    }

    #[test]
    fn numbers_that_continue_over_an_outage_are_exact() {
        assert_eq!(after(500, 20, true).observe(505), lost(4));
        assert_eq!(
            after(500, 200, true).observe(650),
            lost(149),
            "the state in the master does not count"
        );
    }

    #[test]
    fn gap_over_the_wrap_is_exact() {
        assert_eq!(after(0xFFFE, 0, false).observe(0xFFFF), Some(KNOWN));
        assert_eq!(after(0xFFFF, 0, false).observe(0), Some(KNOWN));
        assert_eq!(after(0xFFFF, 0, false).observe(0xFFFF), None);
        assert_eq!(after(0xFFFD, 3, false).observe(1), lost(3));
        assert_eq!(after(0xFFF8, 20, true).observe(4), unknown(24), "either is possible");
    }

    #[test]
    fn numbers_that_start_again_leave_unknown_images() {
        assert_eq!(after(500, 20, true).observe(1), unknown(21), "step back");
        assert_eq!(after(3, 20, true).observe(5), unknown(25), "either is possible");
        assert_eq!(after(500, 20, true).observe(900), unknown(42), "too large a gap");
        assert_eq!(after(500, 200, true).observe(1), unknown(33), "the slave was absent");
        assert_eq!(after(500, 0, true).observe(1), Some(KNOWN), "every exchange is known");
        assert_eq!(after(500, 0, true).observe(501), Some(KNOWN));
    }
}
