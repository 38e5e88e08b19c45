//! The Port's life, and what it knows of each gateway.

use ecan_host::{Adapter, AdapterConfig, Ecrt, Phase, Plan};
use ecan_protocol::device::Capabilities;
use ecan_protocol::image::{ChannelStatus, ImageReader, ImageWriter, OptionFlags, ParseDiagnosis};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::config::{GatewayConfig, PortConfig};
use crate::cycle::CycleReport;
use crate::error::PortError;
use crate::receiver::Receiver;
use crate::schedule_margin::ScheduleTimes;
use crate::schedule_settings::ScheduleConfig;
use crate::schedule_watch::ScheduleWatch;
use crate::session::{PendingStep, Session, SessionMachine};
use crate::statistics::SlaveStatistics;
use crate::sync0_phase::Sync0Phase;
use crate::transmit_window::DEFAULT_DEPTH;
use crate::transmitter::Transmitter;
use crate::verification::VerificationFault;

/// One gateway in the Port.
#[derive(Debug)]
pub(crate) struct Gateway {
    pub(crate) session: SessionMachine,
    pub(crate) transmitter: Transmitter,
    pub(crate) receiver: Receiver,
    pub(crate) statistics: SlaveStatistics,
    pub(crate) capabilities: Capabilities,
    pub(crate) channel_mask: u8,
    pub(crate) fd_mask: u8,
    pub(crate) can_schedule: bool,
    pub(crate) is_paced: bool,
    pub(crate) hold_limit: u16,
    pub(crate) input_limit: u16,
    pub(crate) schedule: ScheduleConfig,
    pub(crate) schedule_times: ScheduleTimes,
    /// The pulse that scheduled frames of the running cycle count from, in application time since
    /// the first cycle; none where that is not known.
    pub(crate) pulse_ns: Option<u64>,
    pub(crate) watch: ScheduleWatch,
}

/// CAN and CAN FD through the gateways of one Adapter (manual 15.1, "MCAN Port").
///
/// Belongs to one thread at a time, like the Adapter that it owns. Dropping it releases the
/// master.
#[derive(Debug)]
pub struct Port {
    pub(crate) adapter: Adapter,
    pub(crate) gateways: Vec<Gateway>,
    /// Between `cycle_begin` and `cycle_end`.
    pub(crate) cycle_open: bool,
    /// Point of the running cycle on the grid, where the cycle was waited for.
    pub(crate) cycle_point_ns: Option<u64>,
    pub(crate) cycle_place: Sync0Phase,
    /// Application time of the running cycle since the first one.
    pub(crate) since_first_ns: u64,
    config: PortConfig,
}

impl Port {
    /// Checks both configurations, opens the Adapter with the startup steps of the gateways, and
    /// prepares the cycle. [`wait_ready`](Self::wait_ready) brings the gateways into service.
    ///
    /// Blocks, for seconds where slaves are still being scanned.
    ///
    /// # Errors
    /// Any [`PortError`]; the master is released.
    pub fn open(
        ecrt: &Ecrt,
        mut adapter: AdapterConfig,
        config: PortConfig,
    ) -> Result<Self, PortError> {
        config.check(&adapter)?;
        config.apply(&mut adapter);
        Self::new(Adapter::open(ecrt, adapter)?, config)
    }

    /// Puts a Port on an Adapter that is configured and not active yet, opened or attached, whose
    /// configuration went through [`PortConfig::apply`].
    ///
    /// # Errors
    /// Faults of the configuration, a wrong phase, or capabilities that cannot be read.
    pub fn new(adapter: Adapter, config: PortConfig) -> Result<Self, PortError> {
        Self::on(adapter, config).map_err(|(_, error)| error)
    }

    /// As [`new`](Self::new), with the Adapter given back where there can be no Port on it.
    ///
    /// # Errors
    /// As there.
    pub fn on(mut adapter: Adapter, config: PortConfig) -> Result<Self, (Box<Adapter>, PortError)> {
        let built = config
            .check(adapter.config())
            .map_err(PortError::from)
            .and_then(|()| build_gateways(&mut adapter, &config));
        match built {
            Ok(gateways) => Ok(Self {
                adapter,
                gateways,
                cycle_open: false,
                cycle_point_ns: None,
                cycle_place: Sync0Phase::default(),
                since_first_ns: 0,
                config,
            }),
            Err(error) => Err((Box::new(adapter), error)),
        }
    }

    /// Takes the gateways out of service, configures them anew and waits for
    /// [`wait_ready`](Self::wait_ready): the way to switch N or channels at run time (manual
    /// 14.2). Frames not delivered are lost; statistics start anew.
    ///
    /// # Errors
    /// A faulty configuration changes nothing. After any other error nothing is in service and
    /// another `reconfigure` may be tried, for instance with the old configuration.
    pub fn reconfigure(
        &mut self,
        mut adapter: AdapterConfig,
        config: PortConfig,
    ) -> Result<(), PortError> {
        config.check(&adapter)?;
        config.apply(&mut adapter);
        let result = self.adapter.reconfigure(adapter);
        if self.adapter.phase() == Phase::Active {
            // It was refused before anything was touched.
            return result.map_err(PortError::from);
        }
        self.gateways.clear();
        self.cycle_open = false;
        self.cycle_point_ns = None;
        self.cycle_place = Sync0Phase::default();
        result?;
        self.gateways = build_gateways(&mut self.adapter, &config)?;
        self.config = config;
        Ok(())
    }

    /// The Adapter below.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The Adapter below, for what the Port does not do itself. Cycling it or writing its RxPDO
    /// images behind the Port's back breaks the images' sequence.
    pub fn adapter_mut(&mut self) -> &mut Adapter {
        &mut self.adapter
    }

    /// Gives the Adapter back, still active.
    pub fn into_adapter(self) -> Adapter {
        self.adapter
    }

    /// The configuration in force.
    pub fn config(&self) -> &PortConfig {
        &self.config
    }

    /// Number of gateways.
    pub fn slave_count(&self) -> usize {
        self.gateways.len()
    }

    /// How a gateway's session stands; real-time safe. Waiting for an index out of range.
    pub fn session(&self, slave: usize) -> Session {
        self.gateways.get(slave).map_or(Session::Waiting, |gateway| gateway.session.state())
    }

    /// What a gateway that is not in service waits for; real-time safe. None for one in service and
    /// for an index out of range.
    pub fn waiting_for(&self, slave: usize) -> Option<PendingStep> {
        self.gateways.get(slave)?.session.awaited(&self.adapter)
    }

    /// Why the last verification of a gateway failed, also while the next one is running; none once
    /// one has succeeded. Real-time safe.
    pub fn last_verification_fault(&self, slave: usize) -> Option<VerificationFault> {
        self.gateways.get(slave)?.session.last_fault()
    }

    /// Whether every gateway is in service; real-time safe.
    pub fn is_ready(&self) -> bool {
        !self.gateways.is_empty() && self.gateways.iter().all(|g| g.session.is_ready())
    }

    /// Status word of a channel from the last TxPDO image (manual 7); real-time safe. All zero,
    /// "disabled", before the first image and for an index out of range.
    pub fn channel_status(&self, slave: usize, channel: u8) -> ChannelStatus {
        self.gateways
            .get(slave)
            .and_then(|gateway| gateway.receiver.status().get(usize::from(channel)))
            .copied()
            .unwrap_or_default()
    }

    /// Counters of a gateway; real-time safe. All zero for an index out of range.
    pub fn statistics(&self, slave: usize) -> SlaveStatistics {
        self.gateways.get(slave).map_or_else(SlaveStatistics::default, |g| g.statistics)
    }

    /// The last fault in a TxPDO image (manual 16.2); real-time safe.
    pub fn last_diagnosis(&self, slave: usize) -> Option<ParseDiagnosis> {
        self.gateways.get(slave).and_then(|gateway| gateway.receiver.last_diagnosis())
    }

    /// What the current cycle brought from a gateway; real-time safe.
    pub fn cycle_report(&self, slave: usize) -> CycleReport {
        let Some(gateway) = self.gateways.get(slave) else { return CycleReport::default() };
        CycleReport {
            domain: self.adapter.domain_report(slave),
            image: gateway.receiver.report(),
            is_holding: gateway.transmitter.is_holding(),
        }
    }

    /// Capabilities of a gateway (0xF000, manual 13.8), read when the Port was opened.
    pub fn capabilities(&self, slave: usize) -> Option<&Capabilities> {
        self.gateways.get(slave).map(|gateway| &gateway.capabilities)
    }
}

fn build_gateways(adapter: &mut Adapter, config: &PortConfig) -> Result<Vec<Gateway>, PortError> {
    (0..config.gateways.len())
        .map(|slave| build_gateway(adapter, slave, &config.gateways[slave]))
        .collect()
}

fn build_gateway(
    adapter: &mut Adapter,
    slave: usize,
    config: &GatewayConfig,
) -> Result<Gateway, PortError> {
    let read =
        |subindex| adapter.diagnostics().sdo_upload_u32(slave, Capabilities::INDEX, subindex);
    let capabilities = Capabilities::read(read)?;
    let settings = &adapter.config().slaves[slave];
    let rx = config.profile(Direction::RxPdo, settings.rx_multiplier);
    let tx = config.profile(Direction::TxPdo, settings.tx_multiplier);
    let mut writer = ImageWriter::new(Direction::RxPdo, rx);
    let mut reader = ImageReader::new(Direction::TxPdo, tx);
    if config.allow_diagnostic_tests {
        // 0x8030:04 overrides the CRC option of both directions (manual 13.2.3).
        match adapter.diagnostics().sdo_upload_u32(slave, 0x8030, 4)? {
            1 => (writer, reader) = (writer.with_crc(true), reader.with_crc(true)),
            2 => (writer, reader) = (writer.with_crc(false), reader.with_crc(false)),
            _ => {}
        }
    }
    let depth = match capabilities.tx_cache_max {
        0 => DEFAULT_DEPTH,
        depth => depth,
    };
    let fd_mask = (0..CHANNELS).fold(0, |mask, channel| {
        let is_fd = config.channels[channel].as_ref().is_some_and(|c| c.can.fd);
        mask | u8::from(is_fd) << channel
    });
    let has_results = config.tx_options.contains(OptionFlags::TX_RESULT);
    let schedule = config.schedule;
    let dc = adapter.config().dc;
    let plan = Plan::of(adapter.config());
    let schedule_times = ScheduleTimes::new(&schedule, adapter.config(), &plan.slaves[slave]);
    let channel_mask = config.channel_mask();
    Ok(Gateway {
        session: SessionMachine::new(adapter, slave, config)?,
        watch: ScheduleWatch::new(adapter, slave, channel_mask, &schedule, dc)?,
        transmitter: Transmitter::new(writer, &rx, depth, has_results, schedule.give_up_missed),
        receiver: Receiver::new(reader),
        statistics: SlaveStatistics::default(),
        can_schedule: capabilities.has_scheduled_tx(),
        capabilities,
        channel_mask,
        schedule,
        schedule_times,
        pulse_ns: None,
        fd_mask,
        is_paced: config.paced,
        hold_limit: config.hold_limit,
        input_limit: config.input_limit,
    })
}
