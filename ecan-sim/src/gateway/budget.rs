//! Budget policies: division of the frame area of an image among the channels (manual 12).

use ecan_protocol::image::{BudgetPolicy, PdoProfile};
use ecan_protocol::mapping::CHANNELS;

/// Bytes that the balanced policy reserves for each enabled channel: the largest packet of a
/// classic frame without timestamp, padded. The manual specifies only "a minimum packet budget".
const BALANCED_RESERVE: usize = 16;

/// Division of the frame area of one image among the channels.
#[derive(Clone, Debug)]
pub(super) struct Budget {
    reserved: [usize; CHANNELS],
    shared: usize,
    /// Largest packet.
    greatest: usize,
    /// Unused reserves can go to other channels at the end.
    lends: bool,
}

impl Budget {
    pub(super) fn new(profile: &PdoProfile) -> Self {
        let area = profile.frame_area_bytes();
        let enabled = (0..CHANNELS as u8).filter(|&channel| profile.has_channel(channel));
        let count = enabled.clone().count().max(1);
        let even = area / count;
        let (reserve, shared, greatest, lends) = match profile.budget {
            BudgetPolicy::Balanced => {
                let reserve = BALANCED_RESERVE.min(even);
                (reserve, area - reserve * count, area, true)
            }
            BudgetPolicy::SharedOnly => (0, area, area, false),
            BudgetPolicy::Deterministic => (even, 0, even, false),
        };
        let mut reserved = [0; CHANNELS];
        enabled.for_each(|channel| reserved[usize::from(channel)] = reserve);
        Self { reserved, shared, greatest, lends }
    }

    pub(super) fn fits(&self, channel: usize, bytes: usize) -> bool {
        bytes <= self.reserved[channel] + self.shared
    }

    /// Returns whether no image has space for a packet of this size under this policy.
    pub(super) fn never_fits(&self, bytes: usize) -> bool {
        bytes > self.greatest
    }

    /// Takes the bytes of a packet if they fit.
    pub(super) fn try_take(&mut self, channel: usize, bytes: usize) -> bool {
        let fits = self.fits(channel, bytes);
        if fits {
            self.take(channel, bytes);
        }
        fits
    }

    pub(super) fn take(&mut self, channel: usize, bytes: usize) {
        let from_own = bytes.min(self.reserved[channel]);
        self.reserved[channel] -= from_own;
        self.shared = self.shared.saturating_sub(bytes - from_own);
    }

    /// All channels were served: the remaining reserves become common. Returns whether there were
    /// any.
    pub(super) fn release_reserves(&mut self) -> bool {
        if !std::mem::take(&mut self.lends) {
            return false;
        }
        let left: usize = std::mem::take(&mut self.reserved).iter().sum();
        self.shared += left;
        left > 0
    }
}
