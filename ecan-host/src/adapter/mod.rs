//! The Adapter: opens or attaches to a master, configures the gateways, and runs the cycle.

mod al_status;
mod cycle;
mod cycle_grid;
mod events;
mod investigation;
mod observation;
mod operation;
mod parallel;
mod preparation;
mod process_data;
mod requests;
mod startup_round;

pub use cycle::{Delivery, DomainReport};
pub use cycle_grid::CycleWait;
pub use operation::{OpProgress, OpWait};
pub use parallel::run_in_parallel;
pub use startup_round::StartupRounds;

use std::time::Duration;

use ecan_protocol::device::OptionalObject;
use ecan_protocol::mapping::Direction;
use ecrt_sys::{Clock, Ecrt};
use tracing::{debug, info};

use crate::bus::{CapabilityValues, Diagnostics, identification, mapping};
use crate::clocks::DistributedClocks;
use crate::config::{AdapterConfig, Identity, WATCHDOG_UNIT};
use crate::deadline::deadline_ns;
use crate::error::Error;
use crate::master::{DomainId, ImageId, Master, RegRequestId, SlaveConfigId};
use crate::observer::Publisher;
use crate::phase::Phase;
use crate::plan::{DomainLayout, Plan};
use crate::real_time::{CycleStart, CycleStatistics, CycleTimer, CycleTiming};
use crate::startup::{StartupPlan, StartupStep};
use al_status::AlStatusWatch;
use events::{Outage, Overruns};
use observation::CycleCounts;
use operation::StopCheck;
use preparation::Prepared;

/// Pause between two looks at the slaves that are not found, in nanoseconds.
const FIND_POLL_NS: u64 = 50_000_000;
/// CoE emergencies that the master keeps of a slave.
const EMERGENCIES: usize = 8;

#[derive(Debug)]
struct Slave {
    config: SlaveConfigId,
    domain: DomainId,
    identity: Identity,
    capabilities: CapabilityValues,
    /// Time of an SDO transfer before activation.
    sdo_time: Duration,
    /// Objects of the startup that it does not have.
    missing: Vec<OptionalObject>,
    layout: DomainLayout,
    rx: ImageId,
    tx: ImageId,
    report: DomainReport,
    /// Its last process data were not sent, so the working counter is an old one.
    is_unsent: bool,
    al_status: AlStatusWatch,
    al_control: RegRequestId,
    outage: Outage,
}

/// The master side of one or more ECAN-Lite gateways (manual 15.1, "Adapter").
///
/// Belongs to one thread at a time. Dropping it takes the slaves out of OP
/// ([`leave_op`](Self::leave_op)), except in a panic, and releases the master, also after an error. Its
/// methods fail in the wrong [`Phase`], for an index out of range, and with the library's error.
#[derive(Debug)]
pub struct Adapter {
    ecrt: Ecrt,
    master: Master,
    diagnostics: Diagnostics,
    config: AdapterConfig,
    startup: StartupPlan,
    slaves: Vec<Slave>,
    phase: Phase,
    attached: bool,
    stop: Option<StopCheck>,
    /// The cycle grid, its last point, the start of the cycle that is due there, and the time of
    /// the running cycle.
    cycle_timer: CycleTimer,
    cycle_start: CycleStart,
    cycle_statistics: Option<CycleStatistics>,
    overruns: Overruns,
    cycle_due_ns: Option<u64>,
    cycle_time_ns: u64,
    /// When was sent last, and how long the answer may take.
    sent_ns: u64,
    response_ns: u64,
    /// Distributed clocks, while the bus is active and theirs are the Adapter's.
    clocks: Option<DistributedClocks>,
    clock_correction_ns: i64,
    startup_rounds: StartupRounds,
    /// The slaves leave, or have left, OP on request since the last cycle of the application.
    is_leaving_op: bool,
    counts: CycleCounts,
    publisher: Publisher,
}

impl Adapter {
    /// Checks the configuration, reserves the master, finds and identifies the gateways, executes
    /// the leading checks of their startup, registers their startup SDOs with the master, and sets
    /// up one domain per slave.
    ///
    /// Writes nothing to the slaves: the master executes the startup SDOs after
    /// [`activate`](Self::activate) or [`wait_op`](Self::wait_op), and at every return of a slave.
    /// Blocks, for seconds where slaves are still being scanned.
    ///
    /// # Errors
    /// Any [`Error`]; the master is released.
    pub fn open(ecrt: &Ecrt, config: AdapterConfig, startup: StartupPlan) -> Result<Self, Error> {
        Self::open_with_stop(ecrt, config, startup, None)
    }

    /// As [`open`](Self::open), with the function of [`stop_waiting_when`](Self::stop_waiting_when) in
    /// force from the start: it is also called while slaves are being scanned and read, many times per
    /// second, and ends the opening with [`Error::Stopped`]. An SDO transfer that runs is completed
    /// before.
    ///
    /// # Errors
    /// As [`open`](Self::open), and [`Error::Stopped`].
    pub fn open_with_stop(
        ecrt: &Ecrt,
        config: AdapterConfig,
        startup: StartupPlan,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<Self, Error> {
        config.check()?;
        let master = Master::request(ecrt, config.master_index)?;
        Self::build(ecrt, master, config, startup, false, stop)
    }

    /// Adds gateways to a master that the application runs itself, for its other slaves on the
    /// same bus.
    ///
    /// `master` wraps the owner's handle ([`Master::from_raw`]). The Adapter adds slaves
    /// and domains to it; requesting, activating, sending and receiving stay with the owner, who
    /// calls [`owner_activated`](Self::owner_activated) after `ecrt_master_activate`, then in each
    /// cycle [`receive`](Self::receive) after its `ecrt_master_receive` and [`send`](Self::send)
    /// before its `ecrt_master_send`. `config.master_index` must be the index of that master.
    ///
    /// # Errors
    /// Any [`Error`]; the owner's handle stays as it is, with what was added until then.
    pub fn attach(
        ecrt: &Ecrt,
        master: Master,
        config: AdapterConfig,
        startup: StartupPlan,
    ) -> Result<Self, Error> {
        Self::attach_with_stop(ecrt, master, config, startup, None)
    }

    /// As [`attach`](Self::attach), with a stop function as of
    /// [`open_with_stop`](Self::open_with_stop).
    ///
    /// # Errors
    /// As [`attach`](Self::attach), and [`Error::Stopped`].
    pub fn attach_with_stop(
        ecrt: &Ecrt,
        master: Master,
        config: AdapterConfig,
        startup: StartupPlan,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<Self, Error> {
        if !master.is_attached() {
            return Err(Error::OwnedMaster);
        }
        config.check()?;
        Self::build(ecrt, master, config, startup, true, stop)
    }

    fn build(
        ecrt: &Ecrt,
        master: Master,
        config: AdapterConfig,
        startup: StartupPlan,
        attached: bool,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<Self, Error> {
        let diagnostics = Diagnostics::open(ecrt, &config)?;
        let cycle_timer = CycleTimer::new(config.cycle_ns(), CycleTiming::default());
        let mut adapter = Self {
            ecrt: ecrt.clone(),
            master,
            diagnostics,
            config,
            startup,
            slaves: Vec::new(),
            phase: Phase::Down,
            attached,
            stop: stop.map(StopCheck),
            cycle_timer,
            cycle_start: CycleStart::default(),
            cycle_statistics: None,
            overruns: Overruns::default(),
            cycle_due_ns: None,
            cycle_time_ns: 0,
            sent_ns: 0,
            response_ns: 0,
            clocks: None,
            clock_correction_ns: 0,
            startup_rounds: StartupRounds::Off,
            is_leaving_op: false,
            counts: CycleCounts::default(),
            publisher: Publisher::default(),
        };
        adapter.configure()?;
        Ok(adapter)
    }

    /// From PREOP slaves to a configured master.
    fn configure(&mut self) -> Result<(), Error> {
        self.diagnostics.set_addresses(&self.config);
        self.response_ns = Plan::of(&self.config).response_ns();
        // All slaves are identified before the first one is configured.
        let prepared = self.find_and_prepare_slaves()?;
        for (slave, prepared) in prepared.iter().enumerate() {
            self.startup.leave_out(slave, &prepared.missing);
        }
        self.slaves = prepared
            .into_iter()
            .enumerate()
            .map(|(index, prepared)| self.configure_slave(index, prepared))
            .collect::<Result<Vec<Slave>, Error>>()?;
        self.select_reference_clock()?;
        self.publisher.reserve_cycle(self.slaves.len());
        self.phase = Phase::Configured;
        Ok(())
    }

    /// A slave that was lost while it was read is looked for again.
    fn find_and_prepare_slaves(&mut self) -> Result<Vec<Prepared>, Error> {
        let clock = self.ecrt.clock().clone();
        let deadline_ns = deadline_ns(clock.as_ref(), self.config.preop_timeout);
        loop {
            self.find_slaves()?;
            self.check_stop()?;
            match self.prepare_slaves() {
                Err(error) if error.is_temporary() && clock.now_ns() < deadline_ns => {
                    info!("slaves: search repeated ({error})");
                    self.release()?;
                    clock.sleep_until_ns(clock.now_ns() + FIND_POLL_NS);
                }
                result => return result,
            }
            self.check_stop()?;
        }
    }

    fn check_stop(&self) -> Result<(), Error> {
        if self.should_stop() { Err(Error::Stopped) } else { Ok(()) }
    }

    /// Waits until all slaves are on the bus in PREOP, and the master is reserved.
    ///
    /// A reserved master that is not active does not scan: a missing slave is waited for without the
    /// reservation.
    fn find_slaves(&mut self) -> Result<(), Error> {
        let clock = self.ecrt.clock().clone();
        let deadline_ns = deadline_ns(clock.as_ref(), self.config.preop_timeout);
        loop {
            self.check_stop()?;
            match identification::look_for_slaves(&self.diagnostics, &self.config) {
                Ok(()) if self.master.is_reserved() => return Ok(()),
                Ok(()) => {
                    self.master = Master::request(&self.ecrt, self.config.master_index)?;
                    continue;
                }
                Err(error) if clock.now_ns() >= deadline_ns => {
                    return match error {
                        // Without a link every slave is missing.
                        Error::NoSuchSlave { .. } => {
                            self.diagnostics.require_link().and(Err(error))
                        }
                        other => Err(other),
                    };
                }
                Err(Error::NoSuchSlave { .. }) => self.release()?,
                Err(_) => {}
            }
            clock.sleep_until_ns(clock.now_ns() + FIND_POLL_NS);
        }
    }

    /// Releases the master, and with it a configuration that was never activated.
    fn release(&mut self) -> Result<(), Error> {
        if self.master.is_reserved() && !self.attached {
            self.master = Master::open(&self.ecrt, self.config.master_index)?;
        }
        Ok(())
    }

    fn select_reference_clock(&mut self) -> Result<(), Error> {
        let Some(slave) = self.config.dc.and_then(|dc| dc.reference) else { return Ok(()) };
        // On an attached Adapter the owner chooses.
        if self.attached {
            return Ok(());
        }
        let config = self.slaves.get(slave).map(|slave| slave.config);
        self.master
            .select_reference_clock(config)
            .map_err(|e| Error::library("ecrt_master_select_reference_clock", Some(slave), e))
    }

    fn configure_slave(&mut self, slave: usize, prepared: Prepared) -> Result<Slave, Error> {
        let count = self.config.slaves.len();
        let settings =
            self.config.slaves.get(slave).copied().ok_or(Error::SlaveIndex { slave, count })?;
        let (rx_n, tx_n) = (settings.rx_multiplier, settings.tx_multiplier);
        let Prepared { identity, capabilities, rx_units, tx_units, sdo_time, missing } = prepared;

        let fail = |call| move |errno| Error::library(call, Some(slave), errno);
        let master = &mut self.master;
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
        for step in &self.startup.steps(&self.config, slave) {
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
        let intervals = self.config.watchdog.as_nanos() / WATCHDOG_UNIT.as_nanos();
        master
            .config_watchdog(config, 0, u16::try_from(intervals).unwrap_or(u16::MAX))
            .map_err(fail("ecrt_slave_config_watchdog"))?;
        // Without the queue, emergencies are lost and nothing else. The owner of an attached master may
        // have sized its own.
        if !self.attached
            && let Err(errno) = master.config_emergencies(config, EMERGENCIES)
        {
            debug!(slave, "ecrt_slave_config_emerg_size failed: {errno}");
        }
        if let Some(dc) = self.config.dc {
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
        Ok(Slave {
            config,
            domain,
            identity,
            capabilities,
            sdo_time,
            missing,
            layout,
            rx: master.add_image(domain, rx_start..rx_start + layout.rx_bytes),
            tx: master.add_image(domain, tx_start..tx_start + layout.tx_bytes),
            report: DomainReport {
                expected_working_counter: layout.expected_working_counter(self.ecrt.version()),
                ..DomainReport::default()
            },
            is_unsent: false,
            al_status: AlStatusWatch::new(al_status),
            al_control,
            outage: Outage::default(),
        })
    }

    /// Starts cyclic operation: from here the application calls [`receive`](Self::receive) and
    /// [`send`](Self::send) every cycle, also while the slaves are still on their way to OP.
    pub fn activate(&mut self) -> Result<(), Error> {
        self.need_owned("activate")?;
        self.need_phase("activate", Phase::Configured)?;
        let cycle_us = self.config.cycle_ns() / 1_000;
        self.master
            .set_send_interval(cycle_us as usize)
            .map_err(|e| Error::library("ecrt_master_set_send_interval", None, e))?;
        if self.config.dc.is_some() {
            self.reset_clock_differences();
        } else {
            // Without a time the master complains at each scan.
            let now_ns = self.ecrt.clock().now_ns();
            self.master
                .application_time(now_ns)
                .map_err(|e| Error::library("ecrt_master_application_time", None, e))?;
        }
        self.master.activate().map_err(|e| Error::library("ecrt_master_activate", None, e))?;
        // The grid starts with the first cycle, and with it the application time, to which the
        // master refers the phase of Sync0.
        self.cycle_timer.restart();
        let cycle_ns = self.config.cycle_ns();
        self.clocks = self.config.dc.map(|dc| DistributedClocks::new(dc, cycle_ns));
        self.phase = Phase::Active;
        Ok(())
    }

    /// Informs an attached Adapter that the owner has activated the master.
    ///
    /// # Errors
    /// A wrong phase, an Adapter that is not attached, or a domain without data.
    pub fn owner_activated(&mut self) -> Result<(), Error> {
        if !self.attached {
            return Err(Error::NotAttached { call: "owner_activated" });
        }
        self.need_phase("owner_activated", Phase::Configured)?;
        self.master
            .refresh_domain_data()
            .map_err(|e| Error::library("ecrt_domain_data", None, e))?;
        self.phase = Phase::Active;
        Ok(())
    }

    /// Leaves cyclic operation, takes another configuration and applies it (manual 14.2): the
    /// way to switch N at run time. The slaves change to PREOP, are configured again and wait for
    /// [`activate`](Self::activate) or [`wait_op`](Self::wait_op). Create requests again.
    ///
    /// # Errors
    /// A faulty configuration changes nothing. After any other error the Adapter is
    /// [`Phase::Down`] and takes another `reconfigure`, for instance with the old configuration.
    pub fn reconfigure(
        &mut self,
        config: AdapterConfig,
        startup: StartupPlan,
    ) -> Result<(), Error> {
        self.need_owned("reconfigure")?;
        config.check()?;
        let (is, configured) = (self.config.master_index, config.master_index);
        if is != configured {
            return Err(Error::OtherMaster { is, configured });
        }
        let was_active = self.phase == Phase::Active;
        self.leave_op();
        self.phase = Phase::Down;
        self.slaves.clear();
        self.clocks = None;
        if was_active {
            let failed = |e| Error::library("ecrt_master_deactivate", None, e);
            self.master.deactivate().map_err(failed)?;
        } else {
            self.release()?;
        }
        self.cycle_timer.set_cycle_ns(config.cycle_ns());
        (self.config, self.startup) = (config, startup);
        if self.cycle_statistics.is_some() {
            self.measure_cycles();
        }
        self.configure()
    }

    /// Current phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns whether another owner drives the master.
    pub fn is_attached(&self) -> bool {
        self.attached
    }

    /// Returns whether the bus is simulated.
    pub fn is_simulated(&self) -> bool {
        self.ecrt.is_simulated()
    }

    /// The loaded library.
    pub fn ecrt(&self) -> &Ecrt {
        &self.ecrt
    }

    /// The time base that the master lives in.
    pub fn clock(&self) -> &dyn Clock {
        self.ecrt.clock().as_ref()
    }

    /// The configuration in force.
    pub fn config(&self) -> &AdapterConfig {
        &self.config
    }

    /// Number of configured slaves.
    pub fn slave_count(&self) -> usize {
        self.config.slaves.len()
    }

    /// Identity of a slave as found on the bus.
    pub fn identity(&self, slave: usize) -> Result<Identity, Error> {
        Ok(self.slave(slave)?.identity)
    }

    /// Serial number of the gateway at a slave's address (0xF000:07 and :08); 0 if the gateway does not
    /// report it.
    pub fn serial_number(&self, slave: usize) -> Result<u64, Error> {
        let [low, high] = self.slave(slave)?.capabilities.serial();
        Ok(u64::from(high) << 32 | u64::from(low))
    }

    /// Returns whether the gateway has this entry of 0xF000.
    pub fn reports_capability(&self, slave: usize, subindex: u8) -> Result<bool, Error> {
        Ok(self.slave(slave)?.capabilities.is_reported(subindex))
    }

    /// Returns whether the startup left this entry out, because the gateway does not have its object.
    pub fn lacks_object(&self, slave: usize, index: u16, subindex: u8) -> Result<bool, Error> {
        Ok(self.slave(slave)?.missing.iter().any(|object| object.contains(index, subindex)))
    }

    /// A value of a gateway's 0xF000 (manual 13.8), as read when it was configured; the
    /// [assumed](ecan_protocol::device::assumed_value) one if the gateway does not have the entry. Blocks
    /// for a value that the gateway rejected then; not for the cycle.
    ///
    /// # Errors
    /// [`Error::SlaveIndex`]; [`Error::Sdo`] for a value that the gateway rejects for another reason.
    pub fn capability(&mut self, slave: usize, subindex: u8) -> Result<u32, Error> {
        let count = self.slaves.len();
        let found = self.slaves.get_mut(slave).ok_or(Error::SlaveIndex { slave, count })?;
        found.capabilities.read(&self.diagnostics, slave, subindex)
    }

    /// Datagram layout of a slave.
    pub fn domain_layout(&self, slave: usize) -> Result<DomainLayout, Error> {
        Ok(self.slave(slave)?.layout)
    }

    /// State of the bus and its slaves at any time, and blocking SDO transfers before activation;
    /// afterwards see [`diagnose`](Self::diagnose). Not for the cycle.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    /// Opens another diagnostics handle, which may move to another thread.
    pub fn open_diagnostics(&self) -> Result<Diagnostics, Error> {
        Diagnostics::open(&self.ecrt, &self.config)
    }

    /// A function that opens another diagnostics handle, on the thread that calls it: for
    /// [`run_in_parallel`](crate::run_in_parallel).
    pub fn diagnostics_opener(&self) -> impl FnOnce() -> Result<Diagnostics, Error> + Send + use<> {
        let (ecrt, config) = (self.ecrt.clone(), self.config);
        move || Diagnostics::open(&ecrt, &config)
    }

    fn slave(&self, slave: usize) -> Result<&Slave, Error> {
        self.slaves.get(slave).ok_or(Error::SlaveIndex { slave, count: self.slaves.len() })
    }

    fn need_phase(&self, call: &'static str, needed: Phase) -> Result<(), Error> {
        if self.phase == needed {
            Ok(())
        } else {
            Err(Error::Phase { call, needed, is: self.phase })
        }
    }

    fn need_owned(&self, call: &'static str) -> Result<(), Error> {
        if self.attached { Err(Error::Attached { call }) } else { Ok(()) }
    }
}
