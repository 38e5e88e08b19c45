//! LSS of the network: configuration of node-IDs and bit rates (CiA 305).

use std::time::Duration;

use ecan_mcan_port::Port;
use ecan_protocol::mapping::CHANNELS;

use super::error::{NetworkError, WaitError};
use super::lss::{Lss, LssCommand, LssConfig, LssFailure, LssFault, LssResult, LssStartError};
use super::network::Network;
use super::wait::run_cycle_until;

impl Network {
    /// Adds a channel that may have no node yet, for LSS and NMT. [`add_node`](Self::add_node) adds the channel of
    /// its node. SYNC, TIME and the host's heartbeat are sent only on channels that have a node. Allocates; call it
    /// before the cycle.
    ///
    /// # Errors
    /// [`NetworkError::NoChannel`].
    pub fn add_channel(&mut self, slave: usize, channel: u8) -> Result<(), NetworkError> {
        if usize::from(channel) >= CHANNELS {
            return Err(NetworkError::NoChannel { slave, channel });
        }
        self.ensure_channel(slave, channel);
        Ok(())
    }

    /// Returns whether the network has a channel. Real-time safe.
    pub fn has_channel(&self, slave: usize, channel: u8) -> bool {
        self.channel_index(slave, channel).is_some()
    }

    /// Starts an LSS command on a channel. Real-time safe; [`lss_state`](Self::lss_state) reports its end in a later
    /// cycle. At most one LSS frame is sent per cycle and channel.
    ///
    /// # Errors
    /// An [`LssStartError`].
    pub fn start_lss(
        &mut self,
        slave: usize,
        channel: u8,
        command: LssCommand,
    ) -> Result<(), LssStartError> {
        let entry = self.channel_mut(slave, channel);
        let entry = entry.ok_or(LssStartError::UnknownChannel { slave, channel })?;
        if entry.lss.start(command) { Ok(()) } else { Err(LssStartError::Busy { slave, channel }) }
    }

    /// State of the LSS master of a channel; [`Lss::Idle`] for a channel that the network does not have. Real-time
    /// safe.
    pub fn lss_state(&self, slave: usize, channel: u8) -> Lss {
        let nth = self.channel_index(slave, channel);
        nth.and_then(|nth| self.channels.get(nth)).map_or(Lss::Idle, |channel| channel.lss.state())
    }

    /// Failure of the last LSS command of a channel. Real-time safe.
    pub fn lss_failure(&self, slave: usize, channel: u8) -> Option<LssFailure> {
        let nth = self.channel_index(slave, channel)?;
        let master = &self.channels.get(nth)?.lss;
        let Lss::Failed(fault) = master.state() else { return None };
        Some(LssFailure { slave, channel, command: master.command(), fault })
    }

    /// Cancels the LSS command of a channel. The state of the slaves is then unknown. Real-time safe.
    pub fn cancel_lss(&mut self, slave: usize, channel: u8) {
        if let Some(channel) = self.channel_mut(slave, channel) {
            channel.lss.cancel(LssFault::Cancelled);
        }
    }

    /// Sets the waiting times of the LSS master of a channel. Ignores a channel that the network does not have.
    /// Real-time safe.
    pub fn set_lss_config(&mut self, slave: usize, channel: u8, config: LssConfig) {
        if let Some(channel) = self.channel_mut(slave, channel) {
            channel.lss.set_config(config);
        }
    }

    /// Executes an LSS command. Blocks.
    ///
    /// ```no_run
    /// use std::time::Duration;
    ///
    /// use ecan_canopen::{
    ///     FastscanFilter, LssCommand, LssResult, Network, NetworkConfig, NodeId,
    /// };
    ///
    /// /// Gives node-IDs from 1 to all slaves without node-ID on the first channel.
    /// fn commission(port: &mut ecan_mcan_port::Port) -> Result<u8, Box<dyn std::error::Error>> {
    ///     let mut network = Network::new(NetworkConfig::default());
    ///     network.add_channel(0, 0)?;
    ///     let mut lss =
    ///         |command| network.lss_blocking(port, (0, 0), command, Duration::from_secs(30));
    ///     let mut count = 0;
    ///     while let LssResult::Address(address) =
    ///         lss(LssCommand::Fastscan(FastscanFilter::default()))?
    ///     {
    ///         count += 1;
    ///         println!("node {count}: {address}");
    ///         lss(LssCommand::ConfigureNodeId(NodeId::new(count)))?;
    ///         lss(LssCommand::Store)?;
    ///         lss(LssCommand::SwitchGlobal { configuration: false })?;
    ///     }
    ///     Ok(count)
    /// }
    /// ```
    ///
    /// # Errors
    /// [`WaitError::Lss`] names channel, command and cause; [`WaitError::LssStart`]; [`WaitError::TimedOut`] after
    /// `timeout` in all, with the command cancelled.
    pub fn lss_blocking(
        &mut self,
        port: &mut Port,
        (slave, channel): (usize, u8),
        command: LssCommand,
        timeout: Duration,
    ) -> Result<LssResult, WaitError> {
        self.start_lss(slave, channel, command)?;
        let ended = run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle, now_ns, |network| match network.lss_state(slave, channel) {
                Lss::Idle | Lss::Busy => None,
                Lss::Done(result) => Some(Ok(result)),
                Lss::Failed(fault) => Some(Err(LssFailure { slave, channel, command, fault })),
            })
        });
        match ended {
            Ok(result) => result.map_err(WaitError::from),
            Err(error) => {
                self.cancel_lss(slave, channel);
                Err(error)
            }
        }
    }
}
