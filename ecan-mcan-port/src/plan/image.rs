//! The images that a plan fills, and the processor time that they take on the host.

use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{
    BudgetPolicy, FrameBudget, ImageWriter, OptionFlags, PdoProfile, ResultCode, Timestamp,
    TxResult,
};
use ecan_protocol::mapping::{CHANNELS, Direction, MAX_MULTIPLIER, MAX_PACKETS};

use super::finding::{PortPlanError, PortWarning};
use super::load::{FrameRoute, FrameStream};

/// Packets of some frames, and the bytes that they take.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImageFill {
    /// Packets, TX_RESULT included.
    pub packets: f64,
    /// Bytes of the frame area, padding included.
    pub bytes: f64,
}

impl ImageFill {
    fn add(&mut self, count: f64, bytes: usize) {
        self.packets += count;
        self.bytes += count * bytes as f64;
    }

    fn exceeds(&self, area_bytes: usize) -> bool {
        self.bytes > area_bytes as f64 || self.packets > MAX_PACKETS as f64
    }

    fn packets_up(&self) -> u64 {
        self.packets.ceil() as u64
    }

    fn bytes_up(&self) -> u64 {
        self.bytes.ceil() as u64
    }
}

/// The image of one direction of a gateway.
#[derive(Debug, Clone, PartialEq)]
pub struct ImagePlan {
    /// The direction.
    pub direction: Direction,
    /// Profile of the image.
    pub profile: PdoProfile,
    /// Mean share of the frames of a cycle.
    pub mean: ImageFill,
    /// Share of the frames of the fullest cycle.
    pub peak: ImageFill,
    /// Parts of the mean by channel, and of the peak.
    channels: [(ImageFill, ImageFill); CHANNELS],
}

impl ImagePlan {
    pub(super) fn new<'a>(
        direction: Direction,
        profile: PdoProfile,
        streams: impl Iterator<Item = &'a FrameStream>,
        cycle_ns: u32,
    ) -> Self {
        let mut plan = Self {
            direction,
            profile,
            mean: ImageFill::default(),
            peak: ImageFill::default(),
            channels: Default::default(),
        };
        let reports = profile.options.contains(OptionFlags::TX_RESULT);
        for stream in streams {
            let bytes = match (direction, stream.way) {
                (Direction::RxPdo, FrameRoute::ToBus) | (Direction::TxPdo, FrameRoute::FromBus) => {
                    if !profile.has_channel(stream.channel) {
                        continue;
                    }
                    plan.packet_bytes(stream.frame.as_ref(), stream.offset_ns().is_some())
                }
                (Direction::TxPdo, FrameRoute::ToBus) if reports => plan.result_bytes(),
                _ => continue,
            };
            let (mean, peak) = (stream.rate.mean(cycle_ns), stream.rate.peak(cycle_ns).into());
            plan.mean.add(mean, bytes);
            plan.peak.add(peak, bytes);
            if let Some((of_mean, of_peak)) = plan.channels.get_mut(usize::from(stream.channel)) {
                of_mean.add(mean, bytes);
                of_peak.add(peak, bytes);
            }
        }
        plan
    }

    /// Bytes for packets.
    pub fn area_bytes(&self) -> usize {
        self.profile.frame_area_bytes()
    }

    /// Bytes of an otherwise empty image that one channel can use, by the budget policy (manual 12).
    pub fn channel_bytes(&self) -> usize {
        let first = self.profile.channel_mask.trailing_zeros() as u8;
        self.budget().left(first)
    }

    /// The gateway lends unused reserves of a TxPDO when it has served all channels; the Port keeps those of an
    /// RxPDO, since the application may send on any channel until the end of the cycle.
    fn budget(&self) -> FrameBudget {
        let mut budget = FrameBudget::new(&self.profile);
        if self.direction == Direction::TxPdo {
            budget.release_reserves();
        }
        budget
    }

    /// Bytes that a channel has left by the budget policy beside these of all channels.
    fn share(&self, channel: u8, bytes: impl Fn(&(ImageFill, ImageFill)) -> f64) -> f64 {
        let mut budget = self.budget();
        for (other, fills) in (0u8..).zip(&self.channels).filter(|(other, _)| *other != channel) {
            budget.take(other, bytes(fills).ceil() as usize);
        }
        budget.left(channel) as f64
    }

    /// Bytes that a frame takes: scheduled ones carry their record, received ones a timestamp of
    /// 16 bits and a window of 64 bytes wherever the profile allows them.
    pub fn packet_bytes(&self, frame: FrameRef<'_>, is_scheduled: bool) -> usize {
        let mut writer = ImageWriter::new(self.direction, self.profile);
        let timestamp = match self.direction {
            Direction::RxPdo if is_scheduled => Timestamp::Full64(0),
            Direction::TxPdo if self.profile.profile.allows_delta16() => Timestamp::Delta16(0),
            _ => Timestamp::None,
        };
        writer.use_d64(self.direction == Direction::TxPdo);
        writer.packet_bytes(frame, timestamp)
    }

    fn result_bytes(&self) -> usize {
        let options = self.profile.options.with(OptionFlags::TX_RESULT);
        let profile = PdoProfile { multiplier: 1, options, ..self.profile };
        let mut writer = ImageWriter::new(Direction::TxPdo, profile);
        let result = TxResult { channel: 0, sequence: 0, frame_index: 0, code: ResultCode::Ok };
        // infallible: an empty image has room for one
        let _ = writer.push_tx_result(&mut [0; ecan_protocol::mapping::CHUNK_BYTES], &result);
        writer.used()
    }

    /// Number of such frames of one channel that an otherwise empty image holds; 255 at most.
    pub fn frames_per_image(&self, frame: FrameRef<'_>, is_scheduled: bool) -> usize {
        (self.channel_bytes() / self.packet_bytes(frame, is_scheduled).max(1)).min(MAX_PACKETS)
    }

    /// Returns whether every packet of these parts of the channels fits its image.
    fn carries(&self, part: impl Fn(&(ImageFill, ImageFill)) -> ImageFill) -> bool {
        let mut all = ImageFill::default();
        for fills in &self.channels {
            let ImageFill { packets, bytes } = part(fills);
            (all.packets, all.bytes) = (all.packets + packets, all.bytes + bytes);
        }
        let fits =
            |(channel, fills)| part(fills).bytes <= self.share(channel, |other| part(other).bytes);
        !all.exceeds(self.area_bytes()) && (0u8..).zip(&self.channels).all(fits)
    }

    /// Smallest N whose image carries the frames of the fullest cycle, else those of the mean.
    fn needed_multiplier(&self) -> Option<u8> {
        let with = |multiplier| {
            let profile = PdoProfile { multiplier, ..self.profile };
            Self { profile, ..self.clone() }
        };
        let all = || 1..=MAX_MULTIPLIER;
        let of_peak = all().find(|n| with(*n).carries(|(_, peak)| *peak));
        of_peak.or_else(|| all().find(|n| with(*n).carries(|(mean, _)| *mean)))
    }

    pub(super) fn check(
        &self,
        slave: usize,
        rejections: &mut Vec<PortPlanError>,
        warnings: &mut Vec<PortWarning>,
    ) {
        if self.carries(|(_, peak)| *peak) && self.carries(|(mean, _)| *mean) {
            return;
        }
        let (direction, area) = (self.direction, self.area_bytes() as u64);
        let needed = self.needed_multiplier();
        let is_mean_too_large = self.mean.exceeds(self.area_bytes());
        let is_peak_too_large = self.peak.exceeds(self.area_bytes());
        if is_mean_too_large {
            let (packets, bytes) = (self.mean.packets_up(), self.mean.bytes_up());
            rejections.push(PortPlanError::ImageTooSmall {
                slave,
                direction,
                packets,
                bytes,
                area,
                needed,
            });
        } else if is_peak_too_large {
            let (packets, bytes) = (self.peak.packets_up(), self.peak.bytes_up());
            warnings.push(PortWarning::ImagePeak {
                slave,
                direction,
                packets,
                bytes,
                area,
                needed,
            });
        }
        // The shares of other policies depend on all channels: the whole is too large, or one of them.
        let is_fixed = self.profile.budget == BudgetPolicy::Deterministic;
        for (channel, (mean, peak)) in (0u8..).zip(&self.channels) {
            let share = self.share(channel, |(mean, _)| mean.bytes);
            let peak_share = self.share(channel, |(_, peak)| peak.bytes);
            if mean.bytes > share && (is_fixed || !is_mean_too_large) {
                let (bytes, share) = (mean.bytes_up(), share as u64);
                rejections.push(PortPlanError::ShareTooSmall {
                    slave,
                    channel,
                    direction,
                    bytes,
                    share,
                    needed,
                });
            } else if peak.bytes > peak_share && (is_fixed || !is_peak_too_large) {
                let (bytes, share) = (peak.bytes_up(), peak_share as u64);
                warnings.push(PortWarning::SharePeak {
                    slave,
                    channel,
                    direction,
                    bytes,
                    share,
                    needed,
                });
            }
        }
    }
}

/// Time to make or to read one process image.
///
/// The master's own work in kernel and network driver is not in it, nor is the application's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CpuCost {
    /// Nanoseconds per image: header, sequence, call.
    pub image_ns: f64,
    /// Nanoseconds per packet.
    pub packet_ns: f64,
    /// Nanoseconds per byte of the frame area that is in use: copying and CRC.
    pub byte_ns: f64,
}

impl CpuCost {
    /// Half of what an encode and a decode of one image took on an AMD EPYC server with
    /// accelerated CRC and warm caches: medians of images with 1 to 254 classic and 14 to 44 CAN
    /// FD frames, fitted to 100 ns, 18 ns a packet and 0.15 ns a byte for both. A small embedded
    /// processor takes several times as long, and so do cold caches.
    pub const MEASURED: Self = Self { image_ns: 50.0, packet_ns: 9.0, byte_ns: 0.08 };

    /// Nanoseconds for an image with this in it.
    pub fn image(&self, fill: ImageFill) -> f64 {
        self.image_ns + fill.packets * self.packet_ns + fill.bytes * self.byte_ns
    }
}

impl Default for CpuCost {
    fn default() -> Self {
        Self::MEASURED
    }
}
