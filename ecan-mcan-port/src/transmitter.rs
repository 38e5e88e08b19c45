//! The way out to one gateway: frames into the RxPDO image, and what becomes of the image.
//!
//! An image that carries frames and may not have arrived is published again unchanged: for the
//! gateway a repeat is a no-op. Frames sent meanwhile are collected in a spare image and move
//! into the process image once the held one has arrived.

use ecan_host::Delivery;
use ecan_protocol::{
    CHANNELS, CommitFields, FrameRef, HEADER_BYTES, ImageWriter, PdoProfile, PushError, Schedule,
    Timestamp,
};

use crate::statistics::SlaveStatistics;
use crate::transmit_history::TransmitHistory;
use crate::transmit_window::TransmitWindow;

/// Frames per channel in an image.
type Counts = [u8; CHANNELS];

#[derive(Debug)]
pub(crate) struct Transmitter {
    writer: ImageWriter,
    spare: Box<[u8]>,
    /// Frames of the image being filled.
    filling: Counts,
    /// Frames of the image that was published last, until its delivery is known.
    published: Option<Counts>,
    /// The process image holds an image that may not have arrived; filling goes to the spare.
    is_holding: bool,
    /// The image being filled was begun and not yet ended.
    is_open: bool,
    /// Images in a row whose arrival was not confirmed.
    misses: u16,
    history: TransmitHistory,
    windows: [TransmitWindow; CHANNELS],
}

impl Transmitter {
    pub(crate) fn new(writer: ImageWriter, profile: &PdoProfile, queue_depth: u16) -> Self {
        Self {
            writer,
            spare: vec![0; profile.pdo_bytes()].into_boxed_slice(),
            filling: Counts::default(),
            published: None,
            is_holding: false,
            is_open: false,
            misses: 0,
            history: TransmitHistory::new(),
            windows: std::array::from_fn(|_| TransmitWindow::new(queue_depth)),
        }
    }

    pub(crate) fn is_holding(&self) -> bool {
        self.is_holding
    }

    pub(crate) fn misses(&self) -> u16 {
        self.misses
    }

    pub(crate) fn window(&mut self, channel: u8) -> &mut TransmitWindow {
        &mut self.windows[usize::from(channel) % CHANNELS]
    }

    pub(crate) fn history(&mut self) -> &mut TransmitHistory {
        &mut self.history
    }

    /// Bytes left in the image being filled.
    pub(crate) fn room(&self) -> usize {
        self.writer.room()
    }

    /// Start of a cycle: `delivery` is the fate of the image published in the last one.
    pub(crate) fn begin(
        &mut self,
        image: &mut [u8],
        delivery: Delivery,
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
                    if !self.is_holding {
                        self.is_holding = true;
                        self.start_image();
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

    /// The published image has arrived.
    fn release(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        for (channel, count) in self.published.take().iter().flatten().enumerate() {
            statistics.channels[channel].frames_delivered += u64::from(*count);
        }
        if !self.is_holding {
            self.start_image();
            return;
        }
        self.is_holding = false;
        let packets = HEADER_BYTES..HEADER_BYTES + self.writer.used();
        if let (Some(to), Some(from)) = (image.get_mut(packets.clone()), self.spare.get(packets)) {
            to.copy_from_slice(from);
        }
        self.writer.assume_dirty();
    }

    fn start_image(&mut self) {
        self.writer.begin();
        self.filling = Counts::default();
        for window in &mut self.windows {
            window.abandoned();
        }
    }

    /// Adds a frame to the image being filled; gives its sequence and index.
    pub(crate) fn push(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
        schedule: Option<Schedule>,
    ) -> Result<(u16, u8), PushError> {
        let image = if self.is_holding { &mut *self.spare } else { image };
        let index = match schedule {
            Some(schedule) => {
                self.writer.push_scheduled(image, channel, id_aux, frame, schedule)?
            }
            None => self.writer.push(image, channel, id_aux, frame, Timestamp::None)?,
        };
        let sequence = self.writer.next_sequence();
        self.filling[usize::from(channel) % CHANNELS] += 1;
        self.window(channel).frame_added();
        self.history.frame_added(sequence, index, channel);
        Ok((sequence, index))
    }

    /// End of a cycle: publishes the image, or the held one once more.
    pub(crate) fn end(&mut self, image: &mut [u8], statistics: &mut SlaveStatistics) {
        if !std::mem::take(&mut self.is_open) {
            // Nothing was begun: the image of the last cycle goes out once more.
            return;
        }
        if self.is_holding {
            statistics.rxpdo_repeated += 1;
            return;
        }
        self.writer.commit(image, CommitFields::default());
        statistics.rxpdo_published += 1;
        for (channel, count) in self.filling.iter().enumerate() {
            statistics.channels[channel].frames_sent += u64::from(*count);
        }
        self.published = Some(std::mem::take(&mut self.filling));
        for window in &mut self.windows {
            window.published();
        }
    }

    /// Gives up every frame that is not known to have arrived, and gives their number. The next
    /// image published is a new one, empty unless frames are sent into it.
    pub(crate) fn discard(&mut self, statistics: &mut SlaveStatistics) -> usize {
        let mut discarded = 0;
        for counts in [self.published.take(), Some(self.filling)].into_iter().flatten() {
            let frames: usize = counts.iter().map(|n| usize::from(*n)).sum();
            if frames > 0 {
                statistics.rxpdo_discarded += 1;
            }
            for (channel, count) in counts.iter().enumerate() {
                statistics.channels[channel].frames_discarded += u64::from(*count);
            }
            discarded += frames;
        }
        self.is_holding = false;
        self.start_image();
        self.writer.assume_dirty();
        discarded
    }

    /// The gateway's session starts anew.
    pub(crate) fn reset(&mut self, statistics: &mut SlaveStatistics) {
        self.discard(statistics);
        self.misses = 0;
        self.history.reset();
        for window in &mut self.windows {
            window.reset();
        }
    }
}
