//! Receive path of one gateway: checks TxPDO images once and hands out their packets.

use ecan_host::Delivery;
use ecan_protocol::image::{
    ChannelStatus, Header, Image, ImageFault, ImageReader, Packet, PacketCursor, Packets,
    ParseDiagnosis, PdoProfile,
};
use ecan_protocol::mapping::{CHANNELS, HEADER_BYTES};

use crate::receive::numbering::{ImageNumbering, MissingImages};
use crate::receive::report::ImageReport;
use crate::statistics::SlaveStatistics;

#[derive(Debug)]
pub(crate) struct Receiver {
    reader: ImageReader,
    numbering: ImageNumbering,
    report: ImageReport,
    last_diagnosis: Option<ParseDiagnosis>,
    /// Of the last new image.
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
                        self.numbering.missed(|| true);
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
                self.numbering.missed(|| true);
                statistics.txpdo_repeated += 1;
                self.report = ImageReport::Repeated;
                false
            }
            Err(diagnosis) => {
                self.numbering.missed(|| true);
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
                return self.numbering.missed(|| true);
            }
            _ => {}
        }
        self.numbering.missed(may_publish);
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
