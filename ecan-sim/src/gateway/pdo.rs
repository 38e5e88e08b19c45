//! RxPDO parser with its copy of the last image, and TxPDO builder (manual 6, 8, 12, 13.2).

use ecan_protocol::image::{
    ChannelStatus, CommitFields, FrameBudget, HeaderFlags, Image, ImageFault, ImageReader,
    ImageWriter, ParseDiagnosis, PdoError, PdoProfile, Timestamp,
};
use ecan_protocol::mapping::{CHANNELS, Direction, HEADER_BYTES, MAX_PACKETS, MAX_PDO_BYTES};

use super::channel::Channel;
use super::diagnostics::GatewayCounters;
use super::transmit_path::ResultQueue;
use super::variant::{Delta16Unit, GatewayVariant, PdoErrorNumbers, RepeatedImage, RxPending};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct UndeliveredFrames {
    /// Frames that wait for the next image.
    pub(super) unpacked: u32,
    /// Frames dropped at the caches since the last image.
    pub(super) dropped: u32,
    /// Frames dropped because no image has space for them.
    pub(super) oversized: u32,
}

#[derive(Clone, Debug)]
pub(super) struct TxPdoBuilder {
    writer: Option<ImageWriter>,
    payload_only: bool,
    shadow: Box<[u8]>,
    payload_bytes: usize,
    last_status: [ChannelStatus; CHANNELS],
    rx_pending: RxPending,
    delta16_unit: Delta16Unit,
}

impl TxPdoBuilder {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        Self {
            rx_pending: variant.rx_pending,
            delta16_unit: variant.delta16_unit,
            writer: None,
            payload_only: false,
            shadow: vec![0; MAX_PDO_BYTES].into_boxed_slice(),
            payload_bytes: 0,
            last_status: Default::default(),
        }
    }

    /// Sets the active profile, whether images carry a CRC, and whether bytes after the payload
    /// keep their value. The sequence numbers continue.
    pub(super) fn configure(&mut self, profile: Option<PdoProfile>, crc: bool, payload_only: bool) {
        let next = self.writer.as_ref().map(ImageWriter::next_sequence);
        self.payload_only = payload_only;
        self.writer = profile.map(|profile| {
            let mut writer = ImageWriter::new(Direction::TxPdo, profile)
                .with_crc(crc)
                .with_payload_only(payload_only);
            writer.use_d64(true);
            if let Some(next) = next {
                writer.set_next_sequence(next);
            }
            writer
        });
    }

    /// The next image gets sequence number 1 again.
    pub(super) fn reset_session(&mut self) {
        if let Some(writer) = &mut self.writer {
            writer.set_next_sequence(1);
        }
    }

    /// Packs results and frames, whole packets only, and commits the image to the shadow buffer.
    /// `scheduled` frames of each channel wait in the schedule. `empty` builds a header without packets. Returns the sequence number and the undelivered
    /// frames; `None` without a profile.
    pub(super) fn build(
        &mut self,
        channels: &mut [Channel; CHANNELS],
        results: &mut ResultQueue,
        scheduled: [usize; CHANNELS],
        time_base_ns: u64,
        empty: bool,
        counters: &mut GatewayCounters,
    ) -> Option<(u16, UndeliveredFrames)> {
        let channel_status = |channels: &[Channel; CHANNELS]| -> [ChannelStatus; CHANNELS] {
            std::array::from_fn(|number| channels[number].status(scheduled[number]))
        };
        let writer = self.writer.as_mut()?;
        let before = channel_status(channels);
        let budget = FrameBudget::new(writer.profile());
        let undelivered = UndeliveredFrames::default();
        let mut packer = Packer { writer, shadow: &mut self.shadow, budget, undelivered, counters };
        if !empty {
            packer.pack_results(results);
            packer.pack_frames(channels, time_base_ns, self.delta16_unit);
        }
        let Packer { writer, shadow, mut undelivered, .. } = packer;
        let status = match self.rx_pending {
            RxPending::WithOwnImage => before,
            RxPending::WithoutOwnImage => channel_status(channels),
        };
        let mask = writer.profile().channel_mask;
        for (number, channel) in channels.iter_mut().enumerate() {
            let dropped = std::mem::take(&mut channel.receive.dropped_since_image);
            // No image misses the frames of a channel that it does not carry.
            undelivered.dropped += if mask >> number & 1 == 1 { dropped } else { 0 };
        }
        let overflow = undelivered.unpacked + undelivered.dropped + undelivered.oversized;
        let has_error = channels.iter().any(Channel::has_error);
        let flags = HeaderFlags::NONE
            .with_if(HeaderFlags::STREAM_TRUNCATED, undelivered.unpacked > 0)
            .with_if(HeaderFlags::ANY_CHANNEL_ERROR, has_error)
            .with_if(HeaderFlags::STATUS_CHANGED, status != self.last_status);
        self.last_status = status;
        self.payload_bytes = writer.used();
        let sequence = writer.commit(
            shadow,
            CommitFields {
                flags,
                overflow: u8::try_from(overflow).unwrap_or(u8::MAX),
                channel_status: status,
            },
        );
        Some((sequence, undelivered))
    }

    /// Bytes for SM3: the whole image, or header and payload only.
    pub(super) fn published(&self) -> &[u8] {
        let whole = self.writer.as_ref().map_or(0, |writer| writer.profile().pdo_bytes());
        let end =
            if self.payload_only { (HEADER_BYTES + self.payload_bytes).min(whole) } else { whole };
        &self.shadow[..end]
    }

    /// Fault: sets `seq_end` to one less than `seq_begin`.
    pub(super) fn tear(&mut self) {
        let seq_begin = u16::from_le_bytes([self.shadow[2], self.shadow[3]]);
        self.shadow[4..6].copy_from_slice(&seq_begin.wrapping_sub(1).to_le_bytes());
    }

    /// Fault: inverts the payload CRC.
    pub(super) fn corrupt_crc(&mut self) {
        self.shadow[8..10].iter_mut().for_each(|byte| *byte = !*byte);
    }
}

/// A TX_RESULT packet with padding.
const RESULT_BYTES_MAX: usize = 8;

/// The packets of one image.
struct Packer<'a> {
    writer: &'a mut ImageWriter,
    shadow: &'a mut [u8],
    budget: FrameBudget,
    undelivered: UndeliveredFrames,
    counters: &'a mut GatewayCounters,
}

impl Packer<'_> {
    fn pack_results(&mut self, results: &mut ResultQueue) {
        let Self { writer, shadow, budget, counters, .. } = self;
        while let Some(result) = results.front().copied() {
            if !writer.profile().has_channel(result.channel) {
                results.pop();
                counters.results_lost += 1;
                continue;
            }
            let before = writer.used();
            if RESULT_BYTES_MAX > budget.left(result.channel)
                || writer.push_tx_result(shadow, &result).is_err()
            {
                break;
            }
            budget.take(result.channel, writer.used() - before);
            results.pop();
            counters.results_to_master += 1;
        }
    }

    /// Packs frames, the oldest first over all channels, each channel in order and within its
    /// budget. A channel whose next frame does not fit waits for the next image.
    fn pack_frames(
        &mut self,
        channels: &mut [Channel; CHANNELS],
        time_base_ns: u64,
        unit: Delta16Unit,
    ) {
        let Self { writer, shadow, budget, undelivered, counters } = self;
        let has_timestamp = writer.profile().profile.allows_delta16();
        let mut whole = FrameBudget::new(writer.profile());
        whole.release_reserves();
        let mut blocked = [false; CHANNELS];
        let mut consumed = [0; CHANNELS];
        loop {
            let Some(number) = oldest(channels, &blocked) else {
                if blocked.contains(&true) && budget.release_reserves() {
                    blocked = [false; CHANNELS];
                    continue;
                }
                break;
            };
            let receive = &mut channels[number].receive;
            let Some(head) = receive.front() else {
                break;
            };
            let timestamp = match has_timestamp {
                true => Timestamp::Delta16(delta16(head.at_ns, time_base_ns, unit)),
                false => Timestamp::None,
            };
            let frame = head.frame.as_ref();
            let bytes = writer.packet_bytes(frame, timestamp);
            if bytes > whole.left(number as u8) {
                receive.pop();
                undelivered.oversized += 1;
                counters.receive_losses.oversized += 1;
                continue;
            }
            let pushed = bytes <= budget.left(number as u8)
                && usize::from(writer.frames()) < MAX_PACKETS
                && writer.push(shadow, number as u8, head.source, frame, timestamp).is_ok();
            if !pushed {
                blocked[number] = true;
                continue;
            }
            budget.take(number as u8, bytes);
            receive.pop();
            consumed[number] += 1;
            counters.frames_to_master += 1;
        }
        for (channel, consumed) in channels.iter_mut().zip(consumed) {
            channel.receive.note_consumed(consumed);
            undelivered.unpacked += channel.receive.available() as u32;
        }
    }
}

/// Channel with the oldest waiting frame; the lower one of two.
fn oldest(channels: &[Channel; CHANNELS], blocked: &[bool; CHANNELS]) -> Option<usize> {
    channels
        .iter()
        .zip(blocked)
        .enumerate()
        .filter(|(_, (_, blocked))| !**blocked)
        .filter_map(|(number, (channel, _))| Some((channel.receive.front()?.at_ns, number)))
        .min()
        .map(|(_, number)| number)
}

/// Time from the time base to the reception, modulo 2^16. The negative difference of a frame from an
/// earlier cycle wraps.
fn delta16(at_ns: u64, time_base_ns: u64, unit: Delta16Unit) -> u16 {
    let count = |ns: u64| match unit {
        Delta16Unit::Microseconds => ns / 1000,
        Delta16Unit::Ticks => ns / 125 * 3 + ns % 125 * 3 / 125,
    };
    let [low, high, ..] = count(at_ns).wrapping_sub(count(time_base_ns)).to_le_bytes();
    u16::from_le_bytes([low, high])
}

#[derive(Clone, Debug)]
pub(super) struct RxPdoParser {
    reader: Option<ImageReader>,
    last_image: Vec<u8>,
    last_sequence: Option<u16>,
    /// The previous image, if it was rejected.
    rejected_image: Vec<u8>,
    repeated: RepeatedImage,
    errors: PdoErrorNumbers,
}

impl RxPdoParser {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        Self {
            reader: None,
            last_image: Vec::with_capacity(MAX_PDO_BYTES),
            last_sequence: None,
            rejected_image: Vec::with_capacity(MAX_PDO_BYTES),
            repeated: variant.repeated_image,
            errors: variant.pdo_errors,
        }
    }

    pub(super) fn configure(&mut self, profile: Option<PdoProfile>, crc: bool) {
        self.reader =
            profile.map(|profile| ImageReader::new(Direction::RxPdo, profile).with_crc(crc));
        self.rejected_image.clear();
    }

    /// Clears the last sequence number, so that the next image is new with any number.
    pub(super) fn reset_session(&mut self) {
        self.last_sequence = None;
        self.last_image.clear();
        self.rejected_image.clear();
    }

    /// Returns whether the previous image was rejected and comes again, byte for byte: a no-op, unless
    /// the variant counts it as an error (manual 13.8).
    pub(super) fn repeats_rejected(&self, image: &[u8]) -> bool {
        self.repeated == RepeatedImage::NoOp
            && !self.rejected_image.is_empty()
            && self.rejected_image == image
    }

    /// Keeps a copy of an image that was rejected; an accepted one ends the repetition.
    pub(super) fn note_rejected(&mut self, image: &[u8], is_rejected: bool) {
        self.rejected_image.clear();
        if is_rejected {
            self.rejected_image.extend_from_slice(image);
        }
    }

    /// Checks header, CRC and sequence number of an image, and keeps a copy of a new one; `None` for
    /// the previous image again, byte for byte: a no-op, unless the variant counts it as an error.
    pub(super) fn parse<'a>(&mut self, image: &'a [u8]) -> Result<Option<Image<'a>>, PdoError> {
        let reader = self.reader.as_ref().ok_or(PdoError::ActiveArea)?;
        let read = reader.read(image).map_err(|diagnosis| error_of(&diagnosis))?;
        if read.layout_changed() {
            // built for another size, mask, profile or option than the active ones
            return Err(match self.errors {
                PdoErrorNumbers::Assumed => PdoError::ActiveArea,
                PdoErrorNumbers::HeaderAndTruncated => PdoError::BadHeader,
            });
        }
        let end = ecan_protocol::mapping::HEADER_BYTES + read.payload().len();
        let content = image.get(..end).unwrap_or_default();
        if self.last_sequence == Some(read.sequence()) {
            let is_repeated = self.last_image == content && self.repeated == RepeatedImage::NoOp;
            return if is_repeated { Ok(None) } else { Err(PdoError::DuplicateSequence) };
        }
        self.last_sequence = Some(read.sequence());
        self.last_image.clear();
        self.last_image.extend_from_slice(content);
        Ok(Some(read))
    }

    /// PDO error of a packet. A packet that ends beyond the frame area is an overrun; one that
    /// ends beyond the payload only is truncated.
    pub(super) fn packet_error(&self, diagnosis: &ParseDiagnosis) -> PdoError {
        let area_end =
            self.reader.as_ref().map_or(MAX_PDO_BYTES, |reader| reader.profile().pdo_bytes());
        match error_of(diagnosis) {
            PdoError::Truncated
                if usize::from(diagnosis.packet_end) > area_end
                    && self.errors == PdoErrorNumbers::Assumed =>
            {
                PdoError::PacketOverrun
            }
            error => error,
        }
    }
}

/// A single buffer is never read while it is written, so differing sequence numbers are an error
/// of the sender: a bad header.
fn error_of(diagnosis: &ParseDiagnosis) -> PdoError {
    match diagnosis.fault {
        ImageFault::Pdo(error) => error,
        ImageFault::Updating | ImageFault::Torn => PdoError::BadHeader,
    }
}
