//! The Port's part of a snapshot.

use std::fmt;

use ecan_host::{Adapter, Section, Snapshot, WordGroup};
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;

use crate::gateway::Gateway;
use crate::session::machine::Session;
use crate::session::verification::PendingStep;
use crate::statistics::{ChannelStatistics, SlaveStatistics};

/// State of a gateway's session in a snapshot: a [`Session`] without the fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SessionState {
    /// The slave is not in OP, or its process data are not confirmed.
    #[default]
    Waiting,
    /// In OP, being verified.
    Verifying,
    /// Verified; frames can be sent.
    Ready,
    /// Verification failed; it is repeated every second.
    Failed,
}

impl From<Session> for SessionState {
    fn from(session: Session) -> Self {
        match session {
            Session::Waiting => Self::Waiting,
            Session::Verifying => Self::Verifying,
            Session::Ready => Self::Ready,
            Session::Failed(_) => Self::Failed,
        }
    }
}

impl fmt::Display for SessionState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Waiting => "waiting for OP",
            Self::Verifying => "being verified",
            Self::Ready => "ready",
            Self::Failed => "verification failed",
        })
    }
}

const CHANNEL_FREQUENT: usize = ChannelStatistics::FREQUENT;
const CHANNEL_RARE: usize = ChannelStatistics::RARE;
const SLAVE_FREQUENT: usize = SlaveStatistics::FREQUENT;
const SLAVE_RARE: usize = SlaveStatistics::RARE;
const STATUS_BITS: usize = 16;
/// Positions in the word of the session.
const MASK_SHIFT: u32 = 8;
const PENDING_SHIFT: u32 = 16;
const STATE_WORDS: usize = 2;
const CHANNELS_START: usize = STATE_WORDS + SLAVE_FREQUENT;
const CHANNELS_FREQUENT: usize = CHANNELS * CHANNEL_FREQUENT;
/// Words that the cycle always writes.
const FREQUENT: usize = CHANNELS_START + CHANNELS_FREQUENT;
/// The sum of the rare counters, with the number of the reservation, and these counters.
const RARE: usize = 1 + SLAVE_RARE + CHANNELS * CHANNEL_RARE;
const GATEWAY_WORDS: usize = FREQUENT + RARE;

/// Position of the number of the reservation in the sum: the counters stay below it.
const RESERVATION_SHIFT: u32 = 40;

/// Returns a number that no other reservation has.
pub(crate) fn reserve(adapter: &Adapter, gateways: usize) -> u64 {
    adapter.publisher().reserve(Section::Port, &vec![0; gateways * GATEWAY_WORDS])
}

/// Writes the Port's section of this cycle.
pub(crate) fn publish(adapter: &Adapter, gateways: &[Gateway], reservation: u64) {
    let Some(mut writer) = adapter.publisher().section(Section::Port) else { return };
    let Some(words) = writer.groups::<GATEWAY_WORDS>(gateways.len()) else { return };
    for (gateway, words) in gateways.iter().zip(words.iter()) {
        let session = match gateway.session.state() {
            Session::Waiting => 0,
            Session::Verifying => 1,
            Session::Ready => 2,
            Session::Failed(_) => 3,
        };
        let [first, second, third, fourth] =
            gateway.receiver.status().map(|status| u64::from(status.raw()));
        let status: u64 = first | second << 16 | third << 32 | fourth << 48;
        let pending = match gateway.session.is_ready() {
            true => 0,
            false => PendingStep::encode(gateway.session.pending_step(adapter)),
        };
        let state =
            session | u64::from(gateway.channel_mask) << MASK_SHIFT | pending << PENDING_SHIFT;
        words.part::<0, STATE_WORDS>().write([state, status]);
        let statistics = &gateway.statistics;
        words.part::<STATE_WORDS, SLAVE_FREQUENT>().write(statistics.frequent());
        let mut sum = statistics.rare_sum().wrapping_add(reservation << RESERVATION_SHIFT);
        let channels =
            words.part::<CHANNELS_START, CHANNELS_FREQUENT>().groups::<CHANNEL_FREQUENT>();
        for (channel, (counters, words)) in
            statistics.channels.iter().zip(channels.iter()).enumerate()
        {
            // The counters of another channel are all 0.
            if gateway.channel_mask >> channel & 1 == 1 {
                words.write(counters.frequent());
                sum = sum.wrapping_add(counters.rare_sum());
            }
        }
        if !words.part::<FREQUENT, 1>().has([sum]) {
            write_rare(words.part::<FREQUENT, RARE>(), statistics, sum);
        }
    }
}

#[cold]
fn write_rare(words: WordGroup<'_, RARE>, statistics: &SlaveStatistics, sum: u64) {
    words.part::<0, 1>().write([sum]);
    words.part::<1, SLAVE_RARE>().write(statistics.rare());
    let channels = words.part::<{ 1 + SLAVE_RARE }, { CHANNELS * CHANNEL_RARE }>();
    for (counters, words) in statistics.channels.iter().zip(channels.groups().iter()) {
        words.write(counters.rare());
    }
}

/// The gateways and channels of a Port in a [`Snapshot`].
#[derive(Debug, Clone, Copy)]
pub struct PortSnapshot<'a> {
    gateways: &'a [[u64; GATEWAY_WORDS]],
}

impl<'a> PortSnapshot<'a> {
    /// The Port's part of a snapshot; `None` if no Port ran the cycle.
    pub fn of(snapshot: &'a Snapshot) -> Option<Self> {
        Some(Self { gateways: snapshot.section(Section::Port)?.as_chunks().0 })
    }

    /// Number of gateways.
    pub fn slave_count(&self) -> usize {
        self.gateways.len()
    }

    /// State of a gateway's session; `None` without such a slave, as all methods below.
    pub fn session(&self, slave: usize) -> Option<SessionState> {
        Some(match self.gateways.get(slave)?[0] & 0xFF {
            1 => SessionState::Verifying,
            2 => SessionState::Ready,
            3 => SessionState::Failed,
            _ => SessionState::Waiting,
        })
    }

    /// Step that a gateway waits for until it is ready; `None` also for one that is ready.
    pub fn waiting_for(&self, slave: usize) -> Option<PendingStep> {
        PendingStep::decode(self.gateways.get(slave)?[0] >> PENDING_SHIFT)
    }

    /// Returns whether a channel is enabled.
    pub fn has_channel(&self, slave: usize, channel: u8) -> Option<bool> {
        let words = self.gateways.get(slave)?;
        Some(
            usize::from(channel) < CHANNELS
                && words[0] >> (MASK_SHIFT + u32::from(channel)) & 1 == 1,
        )
    }

    /// Status word of an enabled channel: see [`Port::channel_status`](crate::Port::channel_status).
    pub fn channel_status(&self, slave: usize, channel: u8) -> Option<ChannelStatus> {
        self.has_channel(slave, channel)?.then_some(())?;
        let words = self.gateways.get(slave)?;
        let status = words[1] >> (usize::from(channel) * STATUS_BITS);
        Some(ChannelStatus::from_raw(status as u16))
    }

    /// Counters of a gateway and its channels.
    pub fn statistics(&self, slave: usize) -> Option<SlaveStatistics> {
        let (frequent, rare) = self.gateways.get(slave)?.split_first_chunk::<FREQUENT>()?;
        let frequent = frequent.get(STATE_WORDS..)?.first_chunk()?;
        let rare = rare.get(1..)?.first_chunk()?;
        let mut statistics = SlaveStatistics::of_words(*frequent, *rare);
        for (channel, counters) in (0..).zip(&mut statistics.channels) {
            *counters = self.counters(slave, channel)?;
        }
        Some(statistics)
    }

    /// Counters of an enabled channel.
    pub fn channel_statistics(&self, slave: usize, channel: u8) -> Option<ChannelStatistics> {
        self.has_channel(slave, channel)?.then_some(())?;
        self.counters(slave, channel)
    }

    fn counters(&self, slave: usize, channel: u8) -> Option<ChannelStatistics> {
        let (frequent, rare) = self.gateways.get(slave)?.split_first_chunk::<FREQUENT>()?;
        let channel = usize::from(channel);
        let frequent = frequent.get(STATE_WORDS + SLAVE_FREQUENT..)?.as_chunks().0.get(channel)?;
        let rare = rare.get(1 + SLAVE_RARE..)?.as_chunks().0.get(channel)?;
        let mut counters = ChannelStatistics::of_words(*frequent, *rare);
        // Each accepted frame is in exactly one column.
        let ended = counters.frames_delivered
            + counters.frames_lost
            + counters.frames_discarded
            + counters.frames_unknown;
        counters.frames_pending = counters.frames_accepted.wrapping_sub(ended);
        Some(counters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_are_read_as_written() {
        let slave = SlaveStatistics::of_words([1, 2, 3], std::array::from_fn(|n| n as u64 + 10));
        assert_eq!(slave.frequent(), [1, 2, 3]);
        assert_eq!(slave.rare(), std::array::from_fn(|n| n as u64 + 10));
        assert_eq!(slave.rare_sum(), slave.rare().iter().sum());
        let channel = ChannelStatistics::of_words([1, 2, 3, 4, 5, 6], [7; CHANNEL_RARE]);
        assert_eq!(channel.frequent(), [1, 2, 3, 4, 5, 6]);
        assert_eq!(channel.rare_sum(), 7 * CHANNEL_RARE as u64);
    }
}
