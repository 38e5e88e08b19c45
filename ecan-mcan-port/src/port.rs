//! The Port: opening, reconfiguration and the state of its gateways.

use ecan_host::{Adapter, Ecrt, Phase};
use ecan_protocol::device::Capabilities;
use ecan_protocol::image::{ChannelStatus, ParseDiagnosis};
use ecan_protocol::mapping::CHANNELS;

use crate::address::{AddressError, ChannelHandle, GatewayHandle};
use crate::config::{Config, GatewayConfig, PortConfig};
use crate::cycle_state::CycleState;
use crate::error::PortError;
use crate::gateway::Gateway;
use crate::image_stream::{ImageStream, image_stream};
use crate::receiver::CycleReport;
use crate::schedule::account::{ScheduleAccount, ScheduleFault};
use crate::schedule::diagnostics::ScheduleDiagnostics;
use crate::schedule::margin::{NotSchedulable, ScheduleMargin};
use crate::session::machine::Session;
use crate::session::verification::{PendingStep, VerificationFault};
use crate::statistics::SlaveStatistics;
use crate::transmit_queue::{TransmitQueues, transmit_queues};

/// CAN and CAN FD through the gateways of one Adapter (manual 15.1, "MCAN Port").
///
/// Belongs to one thread at a time, like the Adapter that it owns. Dropping it releases the
/// master.
#[derive(Debug)]
pub struct Port {
    pub(crate) adapter: Adapter,
    pub(crate) state: CycleState,
    /// Boxed: a Port is moved by value when it is opened.
    config: Box<PortConfig>,
}

impl Port {
    /// Checks the configuration, opens the Adapter with the startup steps of the gateways, and
    /// prepares the cycle. [`wait_ready`](Self::wait_ready) then starts the bus.
    ///
    /// Blocks, for seconds while slaves are being scanned.
    ///
    /// # Errors
    /// Any [`PortError`]; the master is released.
    pub fn open(ecrt: &Ecrt, config: impl Into<Config>) -> Result<Self, PortError> {
        Self::open_with_stop(ecrt, config, None)
    }

    /// As [`open`](Self::open), with a function that ends the opening and later waits: see
    /// [`Adapter::open_with_stop`](ecan_host::Adapter::open_with_stop).
    ///
    /// # Errors
    /// As [`open`](Self::open), and [`Error::Stopped`](ecan_host::Error::Stopped).
    pub fn open_with_stop(
        ecrt: &Ecrt,
        config: impl Into<Config>,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<Self, PortError> {
        let config = config.into();
        config.check()?;
        let startup = config.port.startup_plan(&config.adapter);
        let adapter = Adapter::open_with_stop(ecrt, config.adapter, startup, stop)?;
        Self::new(adapter, config.port)
    }

    /// Creates a Port on an Adapter that is configured and not active yet, opened or attached, whose
    /// startup plan is that of [`PortConfig::startup_plan`].
    ///
    /// # Errors
    /// Faults of the configuration, a wrong phase, or capabilities that cannot be read.
    pub fn new(adapter: Adapter, config: PortConfig) -> Result<Self, PortError> {
        Self::on(adapter, config).map_err(|(_, error)| error)
    }

    /// As [`new`](Self::new), and returns the Adapter with the error.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn on(mut adapter: Adapter, config: PortConfig) -> Result<Self, (Box<Adapter>, PortError)> {
        let built = config
            .check(adapter.config())
            .map_err(PortError::from)
            .and_then(|()| build_gateways(&mut adapter, &config));
        match built {
            Ok(gateways) => {
                if let Some(warning) = config.sync0_warning(adapter.config()) {
                    tracing::warn!("{warning}");
                }
                let state = CycleState::new(&adapter, gateways);
                let port = Self { adapter, state, config: Box::new(config) };
                for warning in port.profile_warnings() {
                    tracing::warn!("{warning}");
                }
                Ok(port)
            }
            Err(error) => Err((Box::new(adapter), error)),
        }
    }

    /// Stops the bus and configures the gateways again, to change N or channels at run time (manual
    /// 14.2). Call [`wait_ready`](Self::wait_ready) afterwards. Undelivered frames are lost and
    /// statistics start again from 0.
    ///
    /// # Errors
    /// A faulty configuration changes nothing. After any other error no gateway is ready; call
    /// `reconfigure` again, for example with the old configuration.
    pub fn reconfigure(&mut self, config: impl Into<Config>) -> Result<(), PortError> {
        let config = config.into();
        config.check()?;
        let startup = config.port.startup_plan(&config.adapter);
        let result = self.adapter.reconfigure(config.adapter, startup);
        if self.adapter.phase() == Phase::Active {
            // The Adapter rejected it before it changed anything.
            return result.map_err(PortError::from);
        }
        self.state.remove_gateways();
        result?;
        let gateways = build_gateways(&mut self.adapter, &config.port)?;
        *self.config = config.port;
        self.state.set_gateways(&self.adapter, gateways);
        Ok(())
    }

    /// Takes over what concerns the host only from another configuration of the same gateways: `paced`,
    /// `hold_limit` and `input_limit`. All else needs [`reconfigure`](Self::reconfigure). Real-time safe.
    pub fn set_limits(&mut self, config: &PortConfig) {
        let gateways = self.state.gateways.iter_mut().zip(&mut *self.config.gateways);
        for ((gateway, active), new) in gateways.zip(&config.gateways) {
            active.set_limits(new);
            gateway.set_limits(active);
        }
    }

    /// Ends an open cycle and takes the gateways out of OP: see
    /// [`Adapter::leave_op`](ecan_host::Adapter::leave_op). Dropping the Port does the same, but only
    /// then: call it after the last cycle if the program does other work first.
    pub fn leave_op(&mut self) {
        if let Some(cycle) = self.open_cycle() {
            cycle.finish();
        }
        self.adapter.leave_op();
    }

    /// The Adapter of this Port.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The Adapter of this Port, for what the Port itself does not offer. Running its cycle or
    /// writing its RxPDO images breaks the sequence of the images.
    pub fn adapter_mut(&mut self) -> &mut Adapter {
        &mut self.adapter
    }

    /// Returns the Adapter, still active.
    pub fn into_adapter(self) -> Adapter {
        self.adapter
    }

    /// The active configuration.
    pub fn config(&self) -> &PortConfig {
        &self.config
    }

    /// Number of gateways.
    pub fn slave_count(&self) -> usize {
        self.state.gateways.len()
    }

    /// Checks the index of a slave, once.
    ///
    /// # Errors
    /// [`AddressError::Slave`].
    pub fn gateway(&self, slave: usize) -> Result<GatewayHandle, AddressError> {
        match self.state.gateways.len() {
            count if slave < count => Ok(GatewayHandle::new(slave)),
            count => Err(AddressError::Slave { slave, count }),
        }
    }

    /// Checks the address of an enabled channel, once.
    ///
    /// # Errors
    /// [`AddressError`]: no such slave, no such channel, or a channel that is not enabled.
    #[inline]
    pub fn channel(&self, slave: usize, channel: u8) -> Result<ChannelHandle, AddressError> {
        match self.state.gateways.get(slave) {
            Some(gateway) if gateway.has_channel(channel) => Ok(ChannelHandle::new(slave, channel)),
            _ => Err(self.state.wrong_address(slave, channel)),
        }
    }

    /// All gateways, in the order of the slaves.
    pub fn gateways(&self) -> impl Iterator<Item = GatewayHandle> + use<> {
        (0..self.state.gateways.len()).map(GatewayHandle::new)
    }

    /// All enabled channels, in the order of slaves and channels.
    pub fn channels(&self) -> impl Iterator<Item = ChannelHandle> {
        self.state.gateways.iter().enumerate().flat_map(|(slave, gateway)| {
            let channels = (0..CHANNELS as u8).filter(|channel| gateway.has_channel(*channel));
            channels.map(move |channel| ChannelHandle::new(slave, channel))
        })
    }

    /// State of a gateway's session; real-time safe.
    pub fn session(&self, gateway: GatewayHandle) -> Session {
        self.state.find(gateway).map_or(Session::Waiting, |gateway| gateway.session.state())
    }

    /// Step that a gateway waits for until it is ready; real-time safe. `None` for one that is
    /// ready. A gateway that the Port does not have, since a reconfiguration failed or left it out,
    /// waits for [`PendingStep::Configuration`].
    pub fn waiting_for(&self, gateway: GatewayHandle) -> Option<PendingStep> {
        match self.state.find(gateway) {
            Some(gateway) => gateway.session.pending_step(&self.adapter),
            None => Some(PendingStep::Configuration),
        }
    }

    /// Requests the startup of every gateway again that failed ([`PendingStep::StartupRetry`]), as the
    /// cycle does at increasing intervals. Real-time safe unless [`Adapter::retry_startup_blocks`].
    ///
    /// # Errors
    /// As [`Adapter::retry_startup`].
    pub fn retry_startup(&mut self) -> Result<(), PortError> {
        Ok(self.adapter.retry_startup()?)
    }

    /// Fault of the last verification that failed, until one succeeds; real-time safe.
    pub fn last_verification_fault(&self, gateway: GatewayHandle) -> Option<VerificationFault> {
        self.state.find(gateway)?.session.last_fault()
    }

    /// Returns whether every gateway is ready; real-time safe.
    pub fn is_ready(&self) -> bool {
        self.state.is_ready()
    }

    /// Returns whether one gateway is ready, so that frames can be sent; real-time safe.
    pub fn gateway_is_ready(&self, gateway: GatewayHandle) -> bool {
        self.state.find(gateway).is_some_and(|gateway| gateway.session.is_ready())
    }

    /// Status word of a channel from the last TxPDO image (manual 7); real-time safe. All zero,
    /// "disabled", before the first image.
    pub fn channel_status(&self, channel: ChannelHandle) -> ChannelStatus {
        let gateway = self.state.gateways.get(channel.slave());
        gateway
            .and_then(|gateway| gateway.receiver.status().get(usize::from(channel.channel())))
            .copied()
            .unwrap_or_default()
    }

    /// Counters of a gateway and its channels; real-time safe.
    pub fn statistics(&self, gateway: GatewayHandle) -> SlaveStatistics {
        self.state.find(gateway).map_or_else(SlaveStatistics::default, Gateway::statistics)
    }

    /// Last fault of a TxPDO image (manual 16.2); real-time safe.
    pub fn last_diagnosis(&self, gateway: GatewayHandle) -> Option<ParseDiagnosis> {
        self.state.find(gateway)?.receiver.last_diagnosis()
    }

    /// Exchange with a gateway in the current cycle; real-time safe.
    pub fn cycle_report(&self, gateway: GatewayHandle) -> CycleReport {
        let slave = gateway.slave();
        let Some(gateway) = self.state.find(gateway) else { return CycleReport::default() };
        CycleReport {
            domain: self.adapter.domain_report(slave),
            image: gateway.receiver.report(),
            is_unconfirmed: gateway.transmitter.is_unconfirmed(),
            cycle: self.state.number(),
            ready_since: gateway.ready_since,
            frames: gateway.receiver.frames(&gateway.statistics),
        }
    }

    /// Capabilities of a gateway (0xF000, manual 13.8), read when the Port was opened. `None` for
    /// a gateway that a reconfiguration removed.
    pub fn capabilities(&self, gateway: GatewayHandle) -> Option<&Capabilities> {
        self.state.find(gateway).map(|gateway| &gateway.capabilities)
    }

    /// Warnings about gateways that differ from those on which their settings were measured
    /// ([`GatewayConfig::measured_on`](crate::GatewayConfig::measured_on)). Opening logs them.
    /// Allocates; not for the cycle.
    pub fn profile_warnings(&self) -> Vec<String> {
        let gateways = self.config.gateways.iter().zip(&self.state.gateways);
        let warning = |(slave, (config, gateway)): (usize, (&GatewayConfig, &Gateway))| {
            let difference = config.measured_on?.difference(&gateway.capabilities)?;
            Some(format!(
                "slave {slave}: its device profile was measured on a gateway with {difference}; repeat \
                 `ecan probe --write-profile`"
            ))
        };
        gateways.enumerate().filter_map(warning).collect()
    }

    /// Bytes left in the RxPDO image that is being filled; a packet needs 4 to 78 of them (manual
    /// 8.3). Real-time safe.
    pub fn image_room(&self, gateway: GatewayHandle) -> usize {
        self.state.find(gateway).map_or(0, |gateway| gateway.transmitter.room())
    }

    /// Bytes that a channel has left in the RxPDO image that is being filled, by the budget policy of the image
    /// (0x8011:06, manual 12). Real-time safe.
    pub fn channel_room(&self, channel: ChannelHandle) -> usize {
        let gateway = self.state.gateways.get(channel.slave());
        gateway.map_or(0, |gateway| gateway.transmitter.channel_room(channel.channel()))
    }

    /// Discards every frame that is not known to have reached the gateway, and returns their
    /// number. The gateway may have executed frames of an unconfirmed image all the same: they count
    /// as unknown, the others as discarded.
    /// Real-time safe.
    pub fn discard_pending(&mut self, gateway: GatewayHandle) -> usize {
        self.state
            .gateways
            .get_mut(gateway.slave())
            .map_or(0, |gateway| gateway.transmitter.discard(&mut gateway.statistics))
    }

    /// Margin of a Sync0 phase, from the cycle and the times of
    /// [`ScheduleConfig`](crate::ScheduleConfig). Real-time safe. On an attached Adapter it applies
    /// if the owner sets its application time at the start of the cycle.
    ///
    /// # Errors
    /// [`NotSchedulable`] if no frame can be scheduled at this phase: without Sync0, on a gateway
    /// without the capability, beyond the Sync0 period.
    pub fn schedule_margin(
        &self,
        gateway: GatewayHandle,
        offset_ns: u32,
    ) -> Result<ScheduleMargin, NotSchedulable> {
        self.state.find(gateway).ok_or(NotSchedulable::NotSupported)?.schedule_margin(offset_ns)
    }

    /// Results of a channel's scheduled frames, as reported by the gateway; real-time safe.
    ///
    /// Without [`OptionFlags::TX_RESULT`](ecan_protocol::image::OptionFlags::TX_RESULT) only the
    /// flags of 0xB000:06 report losses: frames count as sent until a flag is set, and as unknown
    /// from then on.
    pub fn schedule_account(&self, channel: ChannelHandle) -> ScheduleAccount {
        self.state
            .gateways
            .get(channel.slave())
            .map(|gateway| gateway.transmitter.accounts().account(channel.channel()))
            .unwrap_or_default()
    }

    /// Last reading of the gateway's schedule diagnostics, once each object was read in this session;
    /// real-time safe. They are read every [`watch_ms`](crate::ScheduleConfig::watch_ms) after the
    /// first scheduled frame.
    pub fn schedule_diagnostics(&self, gateway: GatewayHandle) -> Option<ScheduleDiagnostics> {
        self.state.find(gateway)?.watch.last().copied()
    }

    /// Reason for which the account of this gateway counts accepted frames as unknown, by the last reading
    /// of its flags; real-time safe. A change is also logged. `None` while the results are certain, and
    /// before the first reading.
    pub fn schedule_fault(&self, gateway: GatewayHandle) -> Option<ScheduleFault> {
        self.state.find(gateway)?.schedule_fault
    }

    /// Requests the gateway to clear the flags of 0xB000:06 and its other runtime diagnostics
    /// (manual 13.7, bit 5), in the next cycles; real-time safe. A set flag makes the result of
    /// every frame unknown that has no transmit result. Frames without a result when the flags are
    /// cleared count as unknown. Codes of TX_RESULT that were contradicted are verified again.
    pub fn clear_schedule_flags(&mut self, gateway: GatewayHandle) {
        if let Some(gateway) = self.state.gateways.get_mut(gateway.slave()) {
            gateway.watch.want_clear();
        }
    }

    /// Starts to copy the images of all gateways into a ring of at least `capacity_bytes`, and returns
    /// its reading end, for one other thread. Allocates; not for the cycle.
    ///
    /// An earlier stream is closed. The stream continues over [`reconfigure`](Self::reconfigure).
    pub fn image_stream(&mut self, capacity_bytes: usize) -> ImageStream {
        let (recorder, stream) = image_stream(capacity_bytes);
        self.state.set_recorder(recorder);
        stream
    }

    /// Creates queues of at least `depth` frames for each channel of every gateway, filled by one other
    /// thread. Allocates; not for the cycle.
    ///
    /// Earlier queues are closed. The queues remain over [`reconfigure`](Self::reconfigure), for the
    /// gateways that existed when they were created.
    pub fn transmit_queues(&mut self, depth: usize) -> TransmitQueues {
        let (of_cycle, queues) = transmit_queues(&self.state.gateways, depth);
        self.state.set_queues(of_cycle);
        queues
    }
}

fn build_gateways(adapter: &mut Adapter, config: &PortConfig) -> Result<Vec<Gateway>, PortError> {
    let gateways = config.gateways.iter().enumerate();
    gateways.map(|(slave, gateway)| Ok(Gateway::new(adapter, slave, gateway)?)).collect()
}
