//! The Port's part of a snapshot.

use std::fmt;

use ecan_host::{Adapter, Section, Snapshot};
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;

use crate::gateway::Gateway;
use crate::session::machine::Session;
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

/// Conversion of counters to words and back.
macro_rules! counter_words {
    ($name:ident [$words:literal] $($field:ident)* $(; $other:ident)?) => {
        impl $name {
            #[inline(always)]
            fn words(&self) -> [u64; $words] {
                let Self { $($field,)* $($other: _,)? } = *self;
                [$($field),*]
            }

            fn of_words([$($field),*]: [u64; $words]) -> Self {
                Self { $($field,)* $($other: Default::default(),)? }
            }
        }
    };
}

counter_words! { ChannelStatistics [17]
    frames_accepted frames_sent frames_confirmed frames_delivered frames_lost frames_discarded
    frames_unknown frames_pending frames_received frames_not_taken rejected_image_full
    rejected_queue_full rejected_bus_off results_ok results_failed bus_off_images
    not_running_images
}

counter_words! { SlaveStatistics [19]
    cycles incomplete_cycles rxpdo_published rxpdo_repeated rxpdo_discarded txpdo_received
    txpdo_repeated txpdo_lost txpdo_discarded txpdo_unknown txpdo_torn txpdo_incomplete
    txpdo_layout_changes parse_errors unmatched_results sessions sessions_lost
    verification_failures startup_requests; channels
}

const STATE_WORDS: usize = 2;
const SLAVE_WORDS: usize = 19;
const CHANNEL_WORDS: usize = 17;
const GATEWAY_WORDS: usize = STATE_WORDS + SLAVE_WORDS + CHANNELS * CHANNEL_WORDS;
const STATUS_BITS: usize = 16;

pub(crate) fn reserve(adapter: &Adapter, gateways: usize) {
    adapter.reserve_section(Section::Port, &vec![0; gateways * GATEWAY_WORDS]);
}

/// Writes the Port's section of this cycle.
pub(crate) fn publish(adapter: &Adapter, gateways: &[Gateway]) {
    let Some(mut writer) = adapter.section_writer(Section::Port) else { return };
    for gateway in gateways {
        let session = match gateway.session.state() {
            Session::Waiting => 0,
            Session::Verifying => 1,
            Session::Ready => 2,
            Session::Failed(_) => 3,
        };
        let mut status = 0;
        for (channel, word) in gateway.receiver.status().iter().enumerate() {
            status |= u64::from(word.raw()) << (channel * STATUS_BITS);
        }
        writer.write([session | u64::from(gateway.channel_mask) << 8, status]);
        writer.write(gateway.statistics.words());
        let channels = gateway.statistics.channels.iter().zip(gateway.transmitter.pending());
        for (channel, (counters, frames_pending)) in channels.enumerate() {
            if gateway.has_channel(channel as u8) {
                writer.write(ChannelStatistics { frames_pending, ..*counters }.words());
            } else {
                // All 0.
                writer.skip(CHANNEL_WORDS);
            }
        }
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

    /// Returns whether a channel is enabled.
    pub fn has_channel(&self, slave: usize, channel: u8) -> Option<bool> {
        let words = self.gateways.get(slave)?;
        Some(usize::from(channel) < CHANNELS && words[0] >> (8 + channel) & 1 == 1)
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
        let words = self.gateways.get(slave)?;
        let words = words.get(STATE_WORDS..)?;
        let (counters, rest) = words.split_first_chunk::<SLAVE_WORDS>()?;
        let mut statistics = SlaveStatistics::of_words(*counters);
        for (channel, words) in statistics.channels.iter_mut().zip(rest.as_chunks().0) {
            *channel = ChannelStatistics::of_words(*words);
        }
        Some(statistics)
    }

    /// Counters of an enabled channel.
    pub fn channel_statistics(&self, slave: usize, channel: u8) -> Option<ChannelStatistics> {
        self.has_channel(slave, channel)?.then_some(())?;
        let start = STATE_WORDS + SLAVE_WORDS + usize::from(channel) * CHANNEL_WORDS;
        let words = self.gateways.get(slave)?.get(start..)?.first_chunk()?;
        Some(ChannelStatistics::of_words(*words))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counters_are_read_as_written(slave in any::<[u64; 19]>(), channel in any::<[u64; 17]>()) {
            prop_assert_eq!(SlaveStatistics::of_words(slave).words(), slave);
            prop_assert_eq!(ChannelStatistics::of_words(channel).words(), channel);
        }
    }
}
