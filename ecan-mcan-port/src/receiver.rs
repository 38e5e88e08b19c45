//! The way in from one gateway: TxPDO images judged once, packets handed out as they are asked
//! for.

use ecan_host::Delivery;
use ecan_protocol::image::{
    Arrival, ChannelStatus, Header, ImageFault, ImageReader, Packet, PacketCursor, ParseDiagnosis,
    SequenceTracker,
};
use ecan_protocol::mapping::CHANNELS;

use crate::cycle::ImageReport;
use crate::received::ReceivedView;
use crate::statistics::SlaveStatistics;
use crate::transmitter::Transmitter;

#[derive(Debug)]
pub(crate) struct Receiver {
    reader: ImageReader,
    tracker: SequenceTracker,
    report: ImageReport,
    status: [ChannelStatus; CHANNELS],
    last_diagnosis: Option<ParseDiagnosis>,
    /// The image whose packets are not all handed out, and how far they are.
    pending: Option<(Header, PacketCursor)>,
    /// Cycles in a row without a new image.
    misses: u16,
}

impl Receiver {
    pub(crate) fn new(reader: ImageReader) -> Self {
        Self {
            reader,
            tracker: SequenceTracker::new(),
            report: ImageReport::None,
            status: [ChannelStatus::default(); CHANNELS],
            last_diagnosis: None,
            pending: None,
            misses: 0,
        }
    }

    pub(crate) fn misses(&self) -> u16 {
        self.misses
    }

    pub(crate) fn report(&self) -> ImageReport {
        self.report
    }

    pub(crate) fn status(&self) -> &[ChannelStatus; CHANNELS] {
        &self.status
    }

    pub(crate) fn last_diagnosis(&self) -> Option<ParseDiagnosis> {
        self.last_diagnosis
    }

    /// The gateway's session starts anew: its next image is the first.
    pub(crate) fn reset(&mut self) {
        self.tracker.reset();
        self.report = ImageReport::None;
        self.pending = None;
        self.misses = 0;
    }

    /// Judges the image of this cycle (manual 6.1). Gives whether it is a new one.
    pub(crate) fn begin(
        &mut self,
        image: &[u8],
        fetched: Delivery,
        statistics: &mut SlaveStatistics,
    ) -> bool {
        self.pending = None;
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
                self.status = image.header().channel_status;
                self.pending = Some((*image.header(), PacketCursor::default()));
                self.misses = 0;
                statistics.txpdo_received += 1;
                statistics.txpdo_lost += u64::from(lost);
                statistics.txpdo_incomplete += u64::from(is_incomplete);
                statistics.txpdo_layout_changes += u64::from(layout_changed);
                true
            }
            Err(_) if fetched == Delivery::Missed => {
                // The faulty image of an earlier cycle still lies there.
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

    fn fault(&mut self, diagnosis: ParseDiagnosis, statistics: &mut SlaveStatistics) {
        match diagnosis.fault {
            ImageFault::Updating | ImageFault::Torn => statistics.txpdo_torn += 1,
            ImageFault::Pdo(_) => statistics.parse_errors += 1,
        }
        self.last_diagnosis = Some(diagnosis);
        self.report = ImageReport::Fault(diagnosis);
    }

    /// Hands out the next packets until `take` says stop or the image is through.
    #[inline]
    pub(crate) fn drain(
        &mut self,
        slave: usize,
        image: &[u8],
        transmitter: &mut Transmitter,
        statistics: &mut SlaveStatistics,
        mut take: impl FnMut(ReceivedView<'_>) -> bool,
    ) {
        let Some((header, cursor)) = self.pending else { return };
        let mut packets = self.reader.resume(image, &header, cursor);
        loop {
            let received = match packets.next() {
                Some(Ok(Packet::Frame(packet))) => {
                    statistics.channel(packet.channel).frames_received += 1;
                    ReceivedView::Frame { slave, packet }
                }
                Some(Ok(Packet::TxResult(result))) => {
                    let send = transmitter.take_result(&result);
                    if send.is_none() {
                        statistics.unmatched_results += 1;
                    } else if result.code.is_success() {
                        statistics.channel(result.channel).results_ok += 1;
                    } else {
                        statistics.channel(result.channel).results_failed += 1;
                    }
                    ReceivedView::from_result(slave, &result, send)
                }
                Some(Err(diagnosis)) => {
                    // What came before the fault has been handed out and stays valid.
                    self.pending = None;
                    self.fault(diagnosis, statistics);
                    return;
                }
                None => {
                    self.pending = None;
                    return;
                }
            };
            if !take(received) {
                self.pending = Some((header, packets.cursor()));
                return;
            }
        }
    }
}
