//! Frames that the host does not send any more.

use crate::statistics::SlaveStatistics;
use crate::transmit::unproven::Counts;

/// State of frames that the host does not send any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Withdrawn {
    /// Their image was not published.
    Discarded,
    /// The gateway did not take their image.
    Lost,
    /// It may have taken it.
    Unknown,
}

/// Counts the frames of a withdrawn image and returns their number.
pub(crate) fn count_withdrawn(
    counts: &Counts,
    state: Withdrawn,
    statistics: &mut SlaveStatistics,
) -> usize {
    let frames: usize = counts.iter().map(|n| usize::from(*n)).sum();
    statistics.rxpdo_discarded += u64::from(frames > 0);
    for (channel, count) in statistics.channels.iter_mut().zip(counts) {
        let counter = match state {
            Withdrawn::Discarded => &mut channel.frames_discarded,
            Withdrawn::Lost => &mut channel.frames_lost,
            Withdrawn::Unknown => &mut channel.frames_unknown,
        };
        *counter += u64::from(*count);
    }
    frames
}
