//! SYNC of the network.

use ecan_mcan_port::Cycle;

use super::config::SyncConfig;
use super::error::NetworkError;
use super::frame_sink::FrameSink;
use super::network::Network;
use super::service_sender::ServiceSender;

impl Network {
    /// Starts, changes or stops the production of SYNC on every channel that has a node. Counters restart;
    /// the first SYNC is due in the next cycle. Real-time safe.
    ///
    /// # Errors
    /// [`NetworkError::CounterOverflow`]; nothing is changed.
    pub fn set_sync(&mut self, config: Option<SyncConfig>) -> Result<(), NetworkError> {
        if let Some(value) = config.and_then(|config| config.counter_overflow)
            && !(2..=240).contains(&value)
        {
            return Err(NetworkError::CounterOverflow { value });
        }
        self.sync = config;
        for channel in &mut self.channels {
            channel.sync.enable(config.is_some() && !channel.nodes.is_empty());
        }
        Ok(())
    }

    /// Configuration of SYNC; `None` if it is off.
    pub fn sync(&self) -> Option<SyncConfig> {
        self.sync
    }

    /// Sends the SYNC messages that are due, after the targets of the cycle: a channel sends in the order in
    /// which it received frames. A SYNC that finds no space, or whose gateway's last image is unconfirmed
    /// ([`CycleReport::is_unconfirmed`](ecan_mcan_port::CycleReport::is_unconfirmed)), is sent in a later
    /// cycle, after the targets of that one, with the next number of the counter; missed ones are not
    /// repeated. Returns the number sent.
    ///
    /// Call once per cycle. Real-time safe.
    pub fn send_sync(&mut self, cycle: &mut Cycle<'_>) -> usize {
        self.send_sync_to(cycle, |_, _| true)
    }

    /// As [`send_sync`](Self::send_sync), but only to the channels for which `may_send` returns true, by slave
    /// and channel. On the others a SYNC that is due waits for a later cycle. Real-time safe if `may_send` is.
    pub fn send_sync_where(
        &mut self,
        cycle: &mut Cycle<'_>,
        may_send: impl FnMut(usize, u8) -> bool,
    ) -> usize {
        self.send_sync_to(cycle, may_send)
    }

    /// Whether [`send_sync`](Self::send_sync) sends a SYNC to a channel in this cycle, if it finds space: one
    /// is due, and the gateway is ready and has confirmed its last image. Real-time safe.
    pub fn sync_is_due(&self, cycle: &Cycle<'_>, slave: usize, channel: u8) -> bool {
        self.sync_is_due_on(cycle, slave, channel)
    }

    /// Whether a SYNC period begins in this cycle, on all channels alike. A late SYNC is due in other cycles,
    /// too. Real-time safe.
    pub fn sync_period_begins(&self) -> bool {
        self.channels.iter().any(|channel| channel.sync.is_planned())
    }

    /// Returns whether a SYNC was sent to a channel in this cycle. Real-time safe.
    pub fn has_sent_sync(&self, slave: usize, channel: u8) -> bool {
        let nth = self.channel_index(slave, channel);
        nth.and_then(|nth| self.channels.get(nth)).is_some_and(|c| c.sync.is_sent())
    }

    pub(super) fn sync_is_due_on(&self, sink: &impl FrameSink, slave: usize, channel: u8) -> bool {
        let nth = self.channel_index(slave, channel);
        nth.and_then(|nth| self.channels.get(nth)).is_some_and(|c| c.sync.is_due() && !c.is_paused)
            && sink.is_ready(slave)
            && !sink.is_unconfirmed(slave)
    }

    pub(super) fn send_sync_to(
        &mut self,
        sink: &mut impl FrameSink,
        mut may_send: impl FnMut(usize, u8) -> bool,
    ) -> usize {
        let Self { config, nodes, channels, sync, statistics, .. } = self;
        let Some(sync) = sync else { return 0 };
        let before = statistics.syncs_sent;
        for channel in channels {
            if channel.sync.is_due() && !may_send(channel.slave, channel.channel) {
                statistics.syncs_late += 1;
                continue;
            }
            ServiceSender { sink, channel, nodes, config, statistics }.send_sync(sync);
        }
        usize::try_from(statistics.syncs_sent - before).unwrap_or(usize::MAX)
    }
}
