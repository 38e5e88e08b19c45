//! A configured slave: what the master was given for it, and its exchange in the cycle.

use std::time::Duration;

use ecan_protocol::device::{Capabilities, OptionalObject};
use ecan_protocol::image::{CommitFields, ImageWriter, PdoProfile};
use ecan_protocol::mapping::Direction;
use ecrt_sys::Ecrt;
use tracing::{debug, info, warn};

use super::al_status::AlStatusWatch;
use crate::bus::mapping::Unit;
use crate::bus::{CapabilityValues, Diagnostics, mapping};
use crate::config::{AdapterConfig, Identity, SlaveConfig, StartupStep, WATCHDOG_UNIT};
use crate::error::Error;
use crate::exchange::{CycleError, DomainLayout, DomainReport};
use crate::master::{
    DomainId, ImageId, Master, RegRequestId, SlaveConfigId, SlaveConfigState, WcState,
};
use crate::startup::StartupPlan;

/// CoE emergencies that the master keeps of a slave.
const EMERGENCIES: usize = 8;

/// Values that were read of a slave before it is configured.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) identity: Identity,
    pub(super) capabilities: CapabilityValues,
    pub(super) rx_units: Vec<Unit>,
    pub(super) tx_units: Vec<Unit>,
    /// Profile of the RxPDO after the startup.
    pub(super) rx_profile: PdoProfile,
    /// Time of an SDO transfer, measured once.
    pub(super) sdo_time: Duration,
    /// Objects of the startup that the slave does not have.
    pub(super) missing: Vec<OptionalObject>,
}

/// A configured slave, from [`Adapter::slave`](crate::Adapter::slave).
#[derive(Debug)]
pub struct Slave {
    config: SlaveConfigId,
    domain: DomainId,
    identity: Identity,
    capabilities: CapabilityValues,
    /// Time of an SDO transfer before activation.
    sdo_time: Duration,
    /// Objects of the startup that the slave does not have.
    missing: Vec<OptionalObject>,
    layout: DomainLayout,
    rx_profile: PdoProfile,
    rx: ImageId,
    tx: ImageId,
    report: DomainReport,
    /// The last process data were not sent, so the working counter is an old one.
    is_unsent: bool,
    al_status: AlStatusWatch,
    al_control: RegRequestId,
    outage: Outage,
}

impl Slave {
    /// Identity as found on the bus.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// Serial number of the gateway (0xF000:07 and :08); 0 if the gateway does not report it.
    pub fn serial_number(&self) -> u64 {
        let [low, high] = self.capabilities.serial();
        u64::from(high) << 32 | u64::from(low)
    }

    /// Returns whether the gateway has this entry of 0xF000.
    pub fn reports_capability(&self, subindex: u8) -> bool {
        self.capabilities.is_reported(subindex)
    }

    /// Returns whether the startup left this entry out, because the gateway does not have its object.
    pub fn lacks_object(&self, index: u16, subindex: u8) -> bool {
        self.missing.iter().any(|object| object.contains(index, subindex))
    }

    /// Datagram layout of the process data.
    pub fn layout(&self) -> DomainLayout {
        self.layout
    }

    /// Reads a value of 0xF000, unless it is known.
    pub(super) fn capability(
        &mut self,
        diagnostics: &Diagnostics,
        slave: usize,
        subindex: u8,
    ) -> Result<u32, Error> {
        self.capabilities.read(diagnostics, slave, subindex)
    }

    /// Gives the master the configuration of a slave in PREOP, with its startup SDOs and its domain.
    pub(super) fn configure(
        ecrt: &Ecrt,
        master: &mut Master,
        all: &AdapterConfig,
        startup: &StartupPlan,
        slave: usize,
        prepared: Prepared,
    ) -> Result<Self, Error> {
        let settings = *settings_of(all, slave)?;
        let (rx_n, tx_n) = (settings.rx_multiplier, settings.tx_multiplier);
        let Prepared { identity, capabilities, rx_units, tx_units, rx_profile, sdo_time, missing } =
            prepared;

        let fail = |call| move |errno| Error::library(call, Some(slave), errno);
        let config = master
            .slave_config(
                settings.alias,
                settings.position,
                identity.vendor_id,
                identity.product_code,
            )
            .map_err(fail("ecrt_master_slave_config"))?;
        mapping::configure(master, slave, config, Direction::RxPdo, &rx_units)?;
        mapping::configure(master, slave, config, Direction::TxPdo, &tx_units)?;
        for step in &startup.steps(all, slave) {
            if let StartupStep::Download(sdo) = step {
                let (bytes, length) = sdo.bytes();
                master
                    .config_sdo(
                        config,
                        sdo.index,
                        sdo.subindex,
                        bytes.get(..length).unwrap_or(&bytes),
                    )
                    .map_err(fail("ecrt_slave_config_sdo"))?;
            }
        }
        let intervals = all.watchdog.as_nanos() / WATCHDOG_UNIT.as_nanos();
        master
            .config_watchdog(config, 0, u16::try_from(intervals).unwrap_or(u16::MAX))
            .map_err(fail("ecrt_slave_config_watchdog"))?;
        // Without the queue, emergencies are lost and nothing else. The owner of an attached master may
        // have sized its own.
        if !master.is_attached()
            && let Err(errno) = master.config_emergencies(config, EMERGENCIES)
        {
            debug!(slave, "ecrt_slave_config_emerg_size failed: {errno}");
        }
        if let Some(dc) = all.dc {
            let shift = i32::try_from(dc.shift_ns()).unwrap_or(i32::MAX);
            master
                .config_dc(config, dc.assign_activate, dc.cycle_ns(), shift, 0, 0)
                .map_err(fail("ecrt_slave_config_dc"))?;
        }
        let domain = master.create_domain().map_err(fail("ecrt_master_create_domain"))?;
        let rx_start = mapping::register(master, slave, config, domain, &rx_units)?;
        let tx_start = mapping::register(master, slave, config, domain, &tx_units)?;
        // The master executes requests in the order of their creation: the status is read all the time.
        let al_control = master
            .create_reg_request(config, 2)
            .map_err(fail("ecrt_slave_config_create_reg_request"))?;
        let al_status = master
            .create_reg_request(config, AlStatusWatch::BYTES)
            .map_err(fail("ecrt_slave_config_create_reg_request"))?;
        let layout = DomainLayout::new(rx_n, tx_n);
        Ok(Self {
            config,
            domain,
            identity,
            capabilities,
            sdo_time,
            missing,
            layout,
            rx_profile,
            rx: master.add_image(domain, rx_start..rx_start + layout.rx_bytes),
            tx: master.add_image(domain, tx_start..tx_start + layout.tx_bytes),
            report: DomainReport {
                expected_working_counter: layout.expected_working_counter(ecrt.version()),
                ..DomainReport::default()
            },
            is_unsent: false,
            al_status: AlStatusWatch::new(al_status),
            al_control,
            outage: Outage::default(),
        })
    }

    pub(super) fn config(&self) -> SlaveConfigId {
        self.config
    }

    /// The request that writes the register AL control.
    pub(super) fn al_control(&self) -> RegRequestId {
        self.al_control
    }

    pub(super) fn al_status(&self) -> &AlStatusWatch {
        &self.al_status
    }

    pub(super) fn al_status_mut(&mut self) -> &mut AlStatusWatch {
        &mut self.al_status
    }

    pub(super) fn sdo_time(&self) -> Duration {
        self.sdo_time
    }

    pub(super) fn state(
        &self,
        slave: usize,
        master: &Master,
    ) -> Result<SlaveConfigState, CycleError> {
        let failed = CycleError::of_slave("ecrt_slave_config_state", slave);
        master.config_state(self.config).map_err(failed)
    }

    /// The startup steps once more, on the very gateway, and then the sizes that it has active: one
    /// that does not fit the process data is answered with AL status 0x001D or 0x001E.
    pub(super) fn steps_to_try(&self, startup: &[StartupStep]) -> Vec<StartupStep> {
        let layout = self.layout;
        let [low, high] = self.capabilities.serial();
        let same = [(7, low), (8, high)]
            .map(|(subindex, half)| StartupStep::expect(Capabilities::INDEX, subindex, half));
        let sizes = [(Direction::RxPdo, layout.rx_bytes), (Direction::TxPdo, layout.tx_bytes)].map(
            |(direction, bytes)| StartupStep::expect(direction.profile_object(), 9, bytes as u32),
        );
        [&same[..], startup, &sizes].concat()
    }

    #[inline]
    pub(super) fn rx(&self) -> ImageId {
        self.rx
    }

    #[inline]
    pub(super) fn tx(&self) -> ImageId {
        self.tx
    }

    #[inline]
    pub(super) fn report(&self) -> &DomainReport {
        &self.report
    }

    /// Writes an image without packets into the process data, since the gateway counts zeros as a bad
    /// header. The sequence number precedes 0 and 1, with which applications start.
    pub(super) fn write_empty_image(&self, master: &mut Master) {
        let mut writer = ImageWriter::new(Direction::RxPdo, self.rx_profile);
        writer.set_next_sequence(u16::MAX);
        writer.commit(master.image_mut(self.rx), CommitFields::default());
    }

    /// Forgets the last exchange before the next one is evaluated.
    #[inline]
    pub(super) fn clear_report(&mut self) {
        self.report.clear();
    }

    /// Evaluates the exchange that the master has received. While slaves leave OP, one without process
    /// data has no outage.
    #[inline]
    pub(super) fn evaluate_exchange(
        &mut self,
        slave: usize,
        master: &mut Master,
        is_leaving_op: bool,
    ) -> Result<(), CycleError> {
        master
            .domain_process(self.domain)
            .map_err(CycleError::of_slave("ecrt_domain_process", slave))?;
        let state = master
            .domain_state(self.domain)
            .map_err(CycleError::of_slave("ecrt_domain_state", slave))?;
        if !self.is_unsent {
            self.report.record(self.layout, state);
            let is_silent = state.wc_state == WcState::Zero && !is_leaving_op;
            self.outage.update(slave, is_silent);
        }
        Ok(())
    }

    #[inline]
    pub(super) fn queue(&mut self, slave: usize, master: &mut Master) -> Result<(), CycleError> {
        let queued = master.domain_queue(self.domain);
        self.is_unsent = queued.is_err();
        queued.map_err(CycleError::of_slave("ecrt_domain_queue", slave))
    }

    /// Records that the queued process data were not sent.
    pub(super) fn mark_unsent(&mut self) {
        self.is_unsent = true;
    }
}

/// Cycles without process data of one slave.
#[derive(Debug, Clone, Copy, Default)]
struct Outage {
    has_exchanged: bool,
    cycles: u64,
}

impl Outage {
    /// Counts a cycle, and logs the first and the last one without process data.
    fn update(&mut self, slave: usize, is_lost: bool) {
        match (self.cycles, is_lost) {
            (0, true) if !self.has_exchanged => {}
            (0, true) => {
                warn!(slave, "slave {slave}: no process data (working counter 0)");
                self.cycles = 1;
            }
            (_, true) => self.cycles += 1,
            (0, false) => self.has_exchanged = true,
            (cycles, false) => {
                info!(slave, cycles, "slave {slave}: process data resumed ({cycles} cycles lost)");
                self.cycles = 0;
            }
        }
    }
}

/// Returns the settings of a slave.
pub(super) fn settings_of(config: &AdapterConfig, slave: usize) -> Result<&SlaveConfig, Error> {
    let count = config.slaves.len();
    config.slaves.get(slave).ok_or(Error::SlaveIndex { slave, count })
}
