//! Receive path of one gateway: checks TxPDO images once and hands out their packets.

use ecan_host::Delivery;
use ecan_protocol::image::{
    Arrival, ChannelStatus, Header, ImageFault, ImageReader, PacketCursor, Packets, ParseDiagnosis,
    SequenceTracker,
};
use ecan_protocol::mapping::{CHANNELS, HEADER_BYTES};

use crate::receive::report::ImageReport;
use crate::statistics::SlaveStatistics;

#[derive(Debug)]
pub(crate) struct Receiver {
    reader: ImageReader,
    tracker: SequenceTracker,
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
            tracker: SequenceTracker::new(),
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

    pub(crate) fn last_diagnosis(&self) -> Option<ParseDiagnosis> {
        self.last_diagnosis
    }

    pub(crate) fn reset(&mut self) {
        self.tracker.reset();
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
                let lost = match self.tracker.observe(image.sequence()) {
                    Arrival::Repeated => {
                        statistics.txpdo_repeated += 1;
                        self.report = ImageReport::Repeated;
                        return false;
                    }
                    Arrival::First | Arrival::Next => 0,
                    Arrival::Gap { lost } => lost,
                };
                let (is_incomplete, layout_changed) =
                    (image.is_incomplete(), image.layout_changed());
                self.report = ImageReport::New { lost, is_incomplete, layout_changed };
                self.header = *image.header();
                self.pending = Some(PacketCursor::default());
                self.misses = 0;
                statistics.txpdo_received += 1;
                statistics.txpdo_lost += u64::from(lost);
                statistics.txpdo_incomplete += u64::from(is_incomplete);
                statistics.txpdo_layout_changes += u64::from(layout_changed);
                true
            }
            Err(_) if fetched == Delivery::Missed => {
                // Still the faulty image of an earlier cycle.
                statistics.txpdo_repeated += 1;
                self.report = ImageReport::Repeated;
                false
            }
            Err(diagnosis) => {
                self.fault(diagnosis, statistics);
                false
            }
        }
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
