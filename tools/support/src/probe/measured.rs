//! Measurements that several experiments share.

use ecan_protocol::image::ChannelState;
use ecan_protocol::mapping::CHANNELS;

/// A restart and the state of the gateway after it.
#[derive(Clone, Debug)]
pub(crate) struct Restart {
    pub(crate) is_answered: bool,
    /// From the command to the first transfer without response, and from there to the first response.
    pub(crate) vanished_ns: u64,
    pub(crate) boot_ns: u64,
    pub(crate) mark: u32,
    pub(crate) chunks: [u32; 2],
    pub(crate) channels: [Option<ChannelState>; CHANNELS],
}

/// A scheduled frame: the time of its image before the pulse, whether it came back, and its result codes.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    pub(crate) before_us: u64,
    /// The firmware read the image only after the pulse (`sync0_window`).
    pub(crate) is_missed: bool,
    pub(crate) is_sent: bool,
    pub(crate) codes: Vec<u8>,
}

/// Time from an SM2 write until SM2 can be written again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServiceTime {
    /// Smallest distance of two images that the host reached, in us.
    pub(crate) least_us: u32,
    /// Largest distance up to which no second image was taken.
    pub(crate) never_us: u32,
    /// Largest distance at which a second image was missed, and smallest from which all were taken: the longest
    /// wait is between them.
    pub(crate) last_missed_us: u32,
    pub(crate) always_us: u32,
    pub(crate) mean_us: u32,
    /// Time in which the host sends an image, in us: the distances are not more exact.
    pub(crate) resolution_us: u32,
}

/// Distances before a Sync0 pulse at which images are missed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MissedImages {
    /// First and last distance, in us; `None` without any.
    pub(crate) range_us: Option<(i64, i64)>,
    /// Usual deviation of a send from its time, in us.
    pub(crate) resolution_us: i64,
}
