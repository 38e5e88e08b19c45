//! Blocking calls for startup and tools: they run the cycle themselves.

use std::time::Duration;

use ecan_host::CycleError;
use ecan_mcan_port::{Cycle, Port};

use super::boot::{BootProgress, BootState};
use super::config::NodeHandle;
use super::configurator::{Configurator, Progress};
use super::error::WaitError;
use super::lss::{Lss, LssCommand, LssFailure, LssResult};
use super::master::Network;
use super::node_sequence::Configuring;
use super::sdo::Sdo;
use crate::{HistoryEntry, NmtState, object};

/// Most entries of an error history.
const MAX_HISTORY: u8 = 254;

impl Network {
    /// Calls that run the cycle of the Port until they end, each at most for `timeout` by the bus clock.
    pub fn blocking<'a>(&'a mut self, port: &'a mut Port, timeout: Duration) -> Blocking<'a> {
        Blocking { network: self, port, timeout }
    }
}

/// Calls of a [`Network`] that block, from [`Network::blocking`].
///
/// In each cycle they send SYNC if it is enabled, and discard received frames that are not the network's, such as
/// TPDOs. To do more in these cycles, use [`run_cycle_until`] with the non-blocking calls.
///
/// Each ends with [`WaitError::TimedOut`] after the timeout in all, with its transfer or command cancelled, with
/// [`WaitError::Stopped`] if the application cancels, or with [`WaitError::Cycle`] if the bus is not active.
#[derive(Debug)]
pub struct Blocking<'a> {
    network: &'a mut Network,
    port: &'a mut Port,
    timeout: Duration,
}

impl Blocking<'_> {
    /// Uploads an object, given by index and subindex.
    ///
    /// # Errors
    /// [`WaitError::Sdo`] names node, object and cause.
    pub fn upload(
        &mut self,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
    ) -> Result<Vec<u8>, WaitError> {
        self.network.start_upload(handle, index, subindex)?;
        self.finish_transfer(handle)?;
        Ok(self.network.sdo_data(handle).to_vec())
    }

    /// Downloads an object, given by index and subindex.
    ///
    /// # Errors
    /// As [`upload`](Self::upload).
    pub fn download(
        &mut self,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
    ) -> Result<(), WaitError> {
        self.network.start_download(handle, index, subindex, data)?;
        self.finish_transfer(handle)
    }

    /// Waits for the end of the transfer with a node that was started before.
    ///
    /// # Errors
    /// As [`upload`](Self::upload).
    pub fn finish_transfer(&mut self, handle: NodeHandle) -> Result<(), WaitError> {
        let ended = self.run(|network, _| match network.sdo_state(handle) {
            Sdo::Busy => None,
            _ => Some(network.sdo_failure(handle)),
        });
        match ended {
            Ok(None) => Ok(()),
            Ok(Some(failure)) => Err(failure.into()),
            Err(error) => {
                self.network.cancel_sdo(handle);
                Err(error)
            }
        }
    }

    /// Reads the error history 0x1003 of a node, newest entry first.
    ///
    /// # Errors
    /// As [`upload`](Self::upload); the timeout counts for each entry.
    pub fn error_history(&mut self, handle: NodeHandle) -> Result<Vec<HistoryEntry>, WaitError> {
        let mut read = |subindex| {
            let value = self.upload(handle, (object::ERROR_HISTORY, subindex))?;
            Ok::<u32, WaitError>(
                value.iter().rev().fold(0, |raw, byte| raw << 8 | u32::from(*byte)),
            )
        };
        let count = u8::try_from(read(0)?).unwrap_or(MAX_HISTORY).min(MAX_HISTORY);
        (1..=count).map(|nth| read(nth).map(HistoryEntry::from_raw)).collect()
    }

    /// Waits until every node has reported an NMT state by boot-up message, heartbeat or guarding.
    /// [`Network::nmt_state`] shows which node is missing.
    ///
    /// # Errors
    /// As each call.
    pub fn wait_nmt_state(&mut self, state: NmtState) -> Result<(), WaitError> {
        self.run(|network, _| {
            network.handles().all(|node| network.nmt_state(node) == Some(state)).then_some(())
        })
    }

    /// Executes a configuration to its end. `progress` is called for each step of a node, at its begin.
    ///
    /// # Errors
    /// [`WaitError::Step`] with the first node that failed, after all others have ended.
    pub fn configure(
        &mut self,
        configurator: &mut Configurator,
        mut progress: impl FnMut(&Progress),
    ) -> Result<(), WaitError> {
        let mut changes = Changes::default();
        self.run(|network, now_ns| {
            let state = configurator.step(network, now_ns);
            for (nth, node) in configurator.progress(now_ns).enumerate() {
                if changes.is_new(nth, (node.done, node.failure.is_some())) {
                    progress(&node);
                }
            }
            match state {
                Configuring::Running => None,
                Configuring::Done => Some(Ok(())),
                Configuring::Failed(failure) => Some(Err(failure.into())),
            }
        })?
    }

    /// Waits until all mandatory nodes are booted, or one has failed. `progress` is called for each phase of a
    /// node, at its begin.
    ///
    /// # Errors
    /// As each call.
    pub fn wait_booted(
        &mut self,
        mut progress: impl FnMut(&BootProgress),
    ) -> Result<BootState, WaitError> {
        let mut changes = Changes::default();
        self.run(|network, now_ns| {
            for (nth, node) in network.boot_progress(now_ns).enumerate() {
                if changes.is_new(nth, node.phase) {
                    progress(&node);
                }
            }
            Some(network.boot_state()).filter(|state| *state != BootState::Running)
        })
    }

    /// Executes an LSS command on a channel, given by slave and channel.
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
    ///         |command| network.blocking(port, Duration::from_secs(30)).lss((0, 0), command);
    ///     let mut count = 0;
    ///     while let LssResult::Address(address) =
    ///         lss(LssCommand::Fastscan(FastscanFilter::default()))?
    ///     {
    ///         count += 1;
    ///         println!("node {count}: {address}");
    ///         lss(LssCommand::ConfigureNodeId(NodeId::from_raw(count)))?;
    ///         lss(LssCommand::Store)?;
    ///         lss(LssCommand::SwitchGlobal { configuration: false })?;
    ///     }
    ///     Ok(count)
    /// }
    /// ```
    ///
    /// # Errors
    /// [`WaitError::Lss`] names channel, command and cause; [`WaitError::LssStart`].
    pub fn lss(
        &mut self,
        (slave, channel): (usize, u8),
        command: LssCommand,
    ) -> Result<LssResult, WaitError> {
        self.network.start_lss(slave, channel, command)?;
        let ended = self.run(|network, _| match network.lss_state(slave, channel) {
            Lss::Idle | Lss::Busy => None,
            Lss::Done(result) => Some(Ok(result)),
            Lss::Failed(fault) => Some(Err(LssFailure { slave, channel, command, fault })),
        });
        match ended {
            Ok(result) => result.map_err(WaitError::from),
            Err(error) => {
                self.network.cancel_lss(slave, channel);
                Err(error)
            }
        }
    }

    /// Serves the network in cycles until `step` returns a value.
    fn run<T>(
        &mut self,
        mut step: impl FnMut(&mut Network, u64) -> Option<T>,
    ) -> Result<T, WaitError> {
        let Self { network, port, timeout } = self;
        run_cycle_until(port, *timeout, |cycle, now_ns| {
            network.serve(cycle, now_ns, |network| step(network, now_ns))
        })
    }
}

/// Runs the cycle of a Port until `step` returns a value. `step` receives each cycle and the time
/// of the bus clock at its start, in nanoseconds.
///
/// Blocks. Keeps the deadlines of [`Port::wait_next_cycle`], with which the caller continues.
/// Errors of single cycles do not end it; such a cycle has received nothing.
///
/// # Errors
/// - [`WaitError::TimedOut`] after `timeout` by the bus clock, or [`WaitError::Cycle`] if the last
///   cycle failed.
/// - [`WaitError::Cycle`] at once if the bus is not active.
/// - [`WaitError::Stopped`] if the application cancels
///   ([`Adapter::stop_waiting_when`](ecan_host::Adapter::stop_waiting_when)).
pub fn run_cycle_until<T>(
    port: &mut Port,
    timeout: Duration,
    step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    run(port, timeout, true, step)
}

/// As [`run_cycle_until`], but ignores the application's request to stop waiting: for a shutdown
/// that must complete.
///
/// # Errors
/// [`WaitError::TimedOut`] or [`WaitError::Cycle`], as [`run_cycle_until`].
pub fn run_cycle_uninterrupted<T>(
    port: &mut Port,
    timeout: Duration,
    step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    run(port, timeout, false, step)
}

fn run<T>(
    port: &mut Port,
    timeout: Duration,
    may_stop: bool,
    mut step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    let clock = port.adapter().ecrt().clock().clone();
    let start_ns = clock.now_ns();
    loop {
        port.wait_next_cycle();
        let now_ns = clock.now_ns();
        let mut cycle = port.begin_cycle();
        let result = step(&mut cycle, now_ns);
        let error = cycle.finish().error();
        if let Some(value) = result {
            return Ok(value);
        }
        if let Some(error @ CycleError::NotActive { .. }) = error {
            return Err(error.into());
        }
        if may_stop && port.adapter().should_stop() {
            return Err(WaitError::Stopped);
        }
        let waited = Duration::from_nanos(now_ns.saturating_sub(start_ns));
        if waited > timeout {
            return Err(error.map_or(WaitError::TimedOut { waited }, WaitError::from));
        }
    }
}

/// States of items that were reported last, so that only changes are reported.
#[derive(Debug)]
pub struct Changes<S>(Vec<Option<S>>);

impl<S> Default for Changes<S> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<S: PartialEq + Copy> Changes<S> {
    /// Returns whether the state of an item, by its index, is another one than in the last call, and the
    /// first time.
    pub fn is_new(&mut self, item: usize, state: S) -> bool {
        if self.0.len() <= item {
            self.0.resize(item + 1, None);
        }
        self.0.get_mut(item).and_then(|last| last.replace(state)) != Some(state)
    }
}
