//! SYNC of the network.

use ecan_mcan_port::Cycle;

use super::config::SyncConfig;
use super::error::NetworkError;
use super::frame_sink::FrameSink;
use super::network::Network;
use super::service_sender::ServiceSender;

impl Network {
    /// Starts producing SYNC on every channel that has a node, or changes how, or stops. Counters
    /// start over, the first SYNC is due in the next cycle. Real-time safe.
    ///
    /// # Errors
    /// [`NetworkError::CounterOverflow`]; nothing was changed.
    pub fn set_sync(&mut self, settings: Option<SyncConfig>) -> Result<(), NetworkError> {
        if let Some(value) = settings.and_then(|settings| settings.counter_overflow)
            && !(2..=240).contains(&value)
        {
            return Err(NetworkError::CounterOverflow { value });
        }
        self.sync = settings;
        for channel in &mut self.channels {
            channel.sync.enable(settings.is_some());
        }
        Ok(())
    }

    /// Leaves one channel out of SYNC, or takes it in again. Real-time safe; does nothing for a
    /// channel without nodes.
    pub fn set_channel_sync(&mut self, slave: usize, channel: u8, enabled: bool) {
        if let Some(place) = self.channel_place(slave, channel)
            && let Some(channel) = self.channels.get_mut(place)
        {
            channel.sync.enable(enabled && self.sync.is_some());
        }
    }

    /// How SYNC is produced.
    pub fn sync(&self) -> Option<SyncConfig> {
        self.sync
    }

    /// Whether a SYNC is due on some channel in this cycle, so that targets go with it; from
    /// [`receive`](Self::receive) on. Real-time safe.
    pub fn sync_is_due(&self) -> bool {
        self.channels.iter().any(|channel| channel.sync.is_due())
    }

    /// Sends the SYNC messages that are due, behind the targets of the cycle: channels send in the
    /// order in which frames were handed over. One that finds no room, or whose gateway's last image
    /// is repeated ([`CycleReport::is_unconfirmed`](ecan_mcan_port::CycleReport::is_unconfirmed)), goes out
    /// in a later cycle, behind the targets of that one, with the next number of the counter. It is
    /// not made up for by two. Gives the number sent.
    ///
    /// Once per cycle, in a cycle. Real-time safe.
    pub fn send_sync(&mut self, cycle: &mut Cycle<'_>) -> usize {
        self.send_sync_to(cycle)
    }

    /// Whether a SYNC was sent to a channel in this cycle. Real-time safe.
    pub fn has_sent_sync(&self, slave: usize, channel: u8) -> bool {
        let place = self.channel_place(slave, channel);
        place.and_then(|place| self.channels.get(place)).is_some_and(|c| c.sync.is_sent())
    }

    pub(super) fn send_sync_to(&mut self, outlet: &mut impl FrameSink) -> usize {
        let Self { config, nodes, channels, sync, statistics } = self;
        let Some(sync) = sync else { return 0 };
        let before = statistics.syncs_sent;
        for channel in channels {
            ServiceSender { outlet, channel, nodes, config, statistics }.send_sync(sync);
        }
        usize::try_from(statistics.syncs_sent - before).unwrap_or(usize::MAX)
    }
}
