//! The Adapter: opens or attaches to a master, configures the gateways, and runs the cycle.

mod al_status;
pub(crate) mod bring_up;
pub(crate) mod cycle_clock;
pub(crate) mod operation;
pub(crate) mod requests;
pub(crate) mod slave;

use std::fmt;

use bring_up::{BringUp, RoundExchange, StartupRounds};
use cycle_clock::{CycleClock, CycleWait};
use ecrt_sys::{Clock, Ecrt, Errno};
use requests::Requests;
use slave::Slave;

use crate::bus::{Diagnostics, run_in_parallel};
use crate::clocks::{ClockStatus, DistributedClocks};
use crate::config::AdapterConfig;
use crate::cycle_timing::{CycleStart, CycleStatistics, CycleTiming};
use crate::error::Error;
use crate::exchange::{CycleError, DomainReport, Phase};
use crate::master::{Master, SlaveConfigState};
use crate::observer::{Observer, Publisher};
use crate::plan::Plan;
use crate::startup::StartupPlan;

/// Function of the application that decides whether to end a wait.
struct StopCheck(Box<dyn Fn() -> bool + Send>);

impl fmt::Debug for StopCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StopCheck")
    }
}

/// Returns whether an observer or the application requests the end of calls that wait.
fn should_stop(publisher: &Publisher, stop: Option<&StopCheck>) -> bool {
    publisher.is_stop_requested() || stop.is_some_and(|stop| (stop.0)())
}

/// Rejects a call that only the owner of an attached master may make.
fn need_owned(master: &Master, call: &'static str) -> Result<(), Error> {
    if master.is_attached() { Err(Error::Attached { call }) } else { Ok(()) }
}

/// Keeps the first error while the rest of the cycle continues.
fn keep(first: &mut Result<(), CycleError>, next: Result<(), CycleError>) {
    if next.is_err() && first.is_ok() {
        *first = next;
    }
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
    stop: Option<StopCheck>,
    cycle_clock: CycleClock,
    /// Distributed clocks, while the bus is active and theirs are the Adapter's.
    clocks: Option<DistributedClocks>,
    startup_rounds: StartupRounds,
    /// The slaves leave, or have left, OP on request since the last cycle of the application.
    is_leaving_op: bool,
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
        Self::build(ecrt, master, config, startup, stop)
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
        Self::build(ecrt, master, config, startup, stop)
    }

    fn build(
        ecrt: &Ecrt,
        master: Master,
        config: AdapterConfig,
        startup: StartupPlan,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<Self, Error> {
        let diagnostics = Diagnostics::open(ecrt, &config)?;
        let cycle_clock = CycleClock::new(ecrt.clock().clone(), config.cycle_ns());
        let mut adapter = Self {
            ecrt: ecrt.clone(),
            master,
            diagnostics,
            config,
            startup,
            slaves: Vec::new(),
            phase: Phase::Down,
            stop: stop.map(StopCheck),
            cycle_clock,
            clocks: None,
            startup_rounds: StartupRounds::Off,
            is_leaving_op: false,
            publisher: Publisher::default(),
        };
        adapter.configure()?;
        Ok(adapter)
    }

    /// From PREOP slaves to a configured master.
    fn configure(&mut self) -> Result<(), Error> {
        self.diagnostics.set_addresses(&self.config);
        self.cycle_clock.set_response_ns(Plan::of(&self.config).response_ns());
        let (publisher, stop) = (&self.publisher, &self.stop);
        let bring_up = BringUp {
            ecrt: &self.ecrt,
            master: &mut self.master,
            diagnostics: &self.diagnostics,
            config: &self.config,
            startup: &mut self.startup,
            should_stop: &|| should_stop(publisher, stop.as_ref()),
        };
        self.slaves = bring_up.run()?;
        self.publisher.reserve_cycle(self.slaves.len());
        self.phase = Phase::Configured;
        Ok(())
    }

    /// Starts cyclic operation: from here the application calls [`receive`](Self::receive) and
    /// [`send`](Self::send) every cycle, also while the slaves are still on their way to OP.
    pub fn activate(&mut self) -> Result<(), Error> {
        need_owned(&self.master, "activate")?;
        self.phase.need("activate", Phase::Configured)?;
        let cycle_us = self.config.cycle_ns() / 1_000;
        self.master
            .set_send_interval(cycle_us as usize)
            .map_err(|e| Error::library("ecrt_master_set_send_interval", None, e))?;
        if self.config.dc.is_some() {
            let (clock, slaves) = (self.ecrt.clock().as_ref(), &self.slaves);
            bring_up::reset_clock_differences(clock, &mut self.master, slaves);
        } else {
            // Without a time the master complains at each scan.
            let now_ns = self.ecrt.clock().now_ns();
            self.master
                .application_time(now_ns)
                .map_err(|e| Error::library("ecrt_master_application_time", None, e))?;
        }
        self.master.activate().map_err(|e| Error::library("ecrt_master_activate", None, e))?;
        self.write_empty_images();
        // The grid starts with the first cycle, and with it the application time, to which the
        // master refers the phase of Sync0.
        self.cycle_clock.restart();
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
        if !self.is_attached() {
            return Err(Error::NotAttached { call: "owner_activated" });
        }
        self.phase.need("owner_activated", Phase::Configured)?;
        self.master
            .refresh_domain_data()
            .map_err(|e| Error::library("ecrt_domain_data", None, e))?;
        self.write_empty_images();
        self.phase = Phase::Active;
        Ok(())
    }

    fn write_empty_images(&mut self) {
        for slave in &self.slaves {
            slave.write_empty_image(&mut self.master);
        }
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
        need_owned(&self.master, "reconfigure")?;
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
            bring_up::release(&mut self.master, self.config.master_index)?;
        }
        self.cycle_clock.set_cycle_ns(config.cycle_ns());
        (self.config, self.startup) = (config, startup);
        self.configure()
    }

    /// Current phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns whether another owner drives the master.
    pub fn is_attached(&self) -> bool {
        self.master.is_attached()
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

    /// A configured slave.
    ///
    /// # Errors
    /// [`Error::SlaveIndex`].
    pub fn slave(&self, slave: usize) -> Result<&Slave, Error> {
        requests::find_slave(&self.slaves, slave)
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
        found.capability(&self.diagnostics, slave, subindex)
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
    /// [`run_in_parallel`].
    pub fn diagnostics_opener(&self) -> impl FnOnce() -> Result<Diagnostics, Error> + Send + use<> {
        Diagnostics::opener(&self.ecrt, &self.config)
    }

    /// Receives the process data and evaluates every slave's working counter.
    ///
    /// Real-time safe: no allocation, no lock, no call beyond the master's own. First in the
    /// cycle, since with distributed clocks its time is that of the cycle; on an attached Adapter
    /// after the owner's `ecrt_master_receive`.
    ///
    /// # Errors
    /// The first [`CycleError`]. Every other slave was served all the same; for those that were
    /// not, [`DomainReport`] reports [`Delivery::Unknown`](crate::Delivery::Unknown).
    pub fn receive(&mut self) -> Result<(), CycleError> {
        self.is_leaving_op = false;
        self.exchange_inputs()
    }

    fn exchange_inputs(&mut self) -> Result<(), CycleError> {
        if self.phase != Phase::Active {
            return Err(CycleError::NotActive { is: self.phase });
        }
        // The cycles after the last one of the application are not for observers.
        if !self.is_leaving_op {
            self.publisher.begin();
        }
        let time_ns = self.cycle_clock.start_cycle(!self.is_leaving_op);
        if let Some(clocks) = &mut self.clocks {
            clocks.start_cycle(time_ns);
        }
        self.master.count_cycle();
        let mut result = Ok(());
        if !self.is_attached() {
            let received = self.master.receive();
            keep(&mut result, received.map_err(CycleError::library("ecrt_master_receive")));
        }
        let has_received = result.is_ok();
        let mut answering = 0;
        for (index, slave) in self.slaves.iter_mut().enumerate() {
            slave.clear_report();
            if has_received {
                let evaluated =
                    slave.evaluate_exchange(index, &mut self.master, self.is_leaving_op);
                keep(&mut result, evaluated);
                answering += usize::from(slave.report().working_counter > 0);
            }
        }
        self.cycle_clock.clear_correction();
        if let Some(clocks) = &mut self.clocks {
            match clocks.receive(&mut self.master, answering) {
                Ok(correction_ns) => self.cycle_clock.correct_deadline(correction_ns),
                Err(error) => keep(&mut result, Err(error)),
            }
        }
        result
    }

    /// Queues every slave's process data, serves the distributed clocks and sends.
    ///
    /// Real-time safe, as [`receive`](Self::receive). Last in the cycle; on an attached Adapter
    /// before the owner's `ecrt_master_send`, who also serves the clocks.
    ///
    /// # Errors
    /// The first [`CycleError`]. What could be sent was sent all the same: a bus on which nothing
    /// is sent never recovers.
    pub fn send(&mut self) -> Result<(), CycleError> {
        if self.phase != Phase::Active {
            return Err(CycleError::NotActive { is: self.phase });
        }
        let mut result = Ok(());
        for (index, slave) in self.slaves.iter_mut().enumerate() {
            keep(&mut result, slave.queue(index, &mut self.master));
        }
        if !self.is_attached() {
            if let Some(clocks) = &mut self.clocks {
                let now_ns = self.ecrt.clock().now_ns();
                keep(&mut result, clocks.send(&mut self.master, now_ns));
            }
            let sent = self.master.send();
            if sent.is_err() {
                self.slaves.iter_mut().for_each(Slave::mark_unsent);
            }
            keep(&mut result, sent.map_err(CycleError::library("ecrt_master_send")));
        }
        self.cycle_clock.end_cycle();
        if !self.is_leaving_op {
            // A send without a cycle: the images of the last one were repeated.
            self.publisher.begin();
            let reports = self.slaves.iter().map(Slave::report);
            self.publisher.publish_cycle(self.cycle_clock.record(), reports);
        }
        result
    }

    /// Outcome of the last [`receive`](Self::receive) for a slave; real-time safe. A slave index
    /// out of range reads as nothing exchanged.
    pub fn domain_report(&self, slave: usize) -> DomainReport {
        self.slaves.get(slave).map_or_else(DomainReport::default, |slave| *slave.report())
    }

    /// Returns whether every slave exchanged both directions in the last cycle; real-time safe.
    pub fn domain_is_complete(&self) -> bool {
        !self.slaves.is_empty() && self.slaves.iter().all(|slave| slave.report().is_complete())
    }

    /// The RxPDO of a slave, written by the application: 128 * N continuous bytes.
    ///
    /// Real-time safe. Empty before activation and for an index out of range. What is written
    /// between [`receive`](Self::receive) and [`send`](Self::send) goes out with that send. After
    /// activation it is a valid image without packets, of sequence number 0xFFFF (manual 6.1).
    #[inline]
    pub fn rx_pdo_mut(&mut self, slave: usize) -> &mut [u8] {
        let Some(slave) = self.slaves.get(slave) else { return &mut [] };
        self.master.image_mut(slave.rx())
    }

    /// The current RxPDO image. Real-time safe; empty as above.
    #[inline]
    pub fn rx_pdo(&self, slave: usize) -> &[u8] {
        let Some(slave) = self.slaves.get(slave) else { return &[] };
        self.master.image(slave.rx())
    }

    /// The TxPDO of a slave as of the last [`receive`](Self::receive): 128 * N continuous bytes.
    ///
    /// Real-time safe. Empty before activation and for an index out of range. An image that was
    /// not exchanged keeps its old content: see [`domain_report`](Self::domain_report) and the
    /// sequence in its header.
    #[inline]
    pub fn tx_pdo(&self, slave: usize) -> &[u8] {
        let Some(slave) = self.slaves.get(slave) else { return &[] };
        self.master.image(slave.tx())
    }

    /// Sleeps until the next deadline and returns the number of deadlines that were skipped because
    /// they had passed already.
    ///
    /// All waiting calls of the SDK use the same grid, so an application that continues with it
    /// after [`wait_op`](Self::wait_op) stays in phase with Sync0. The first call starts the grid.
    /// An application with its own cycle timer need not call it; then the time of each
    /// [`receive`](Self::receive) is the time of its cycle.
    ///
    /// A cycle lasts until the response of the bus, [`response_ns`](Self::response_ns) after the
    /// last [`send`](Self::send); a late send may therefore miss the next deadline. A datagram that
    /// is sent again before its response loses the response, and with it the TxPDO image. On an
    /// attached Adapter the owner sends later and more; the owner must leave the time for that.
    ///
    /// [`set_cycle_timing`](Self::set_cycle_timing) selects a spin before the deadline, and catching
    /// up instead of skipping. Real-time safe: it does not allocate.
    pub fn wait_next_cycle(&mut self) -> u64 {
        let start = self.begin_wait().sleep();
        self.end_wait(start)
    }

    /// First part of [`wait_next_cycle`](Self::wait_next_cycle), for an application that protects the
    /// Adapter by a lock: other threads may use it during [`CycleWait::sleep`], which does not.
    /// [`end_wait`](Self::end_wait) is the last part. Real-time safe.
    pub fn begin_wait(&mut self) -> CycleWait {
        let exchanges_rounds = self.phase == Phase::Active && !self.is_leaving_op;
        if exchanges_rounds && !self.is_attached() {
            let mut exchange = RoundExchange {
                master: &mut self.master,
                slaves: &self.slaves,
                clocks: self.clocks.as_mut(),
                cycle_clock: &self.cycle_clock,
            };
            exchange.run(self.ecrt.clock().as_ref(), self.startup_rounds);
        }
        self.cycle_clock.begin_wait()
    }

    /// Last part of [`wait_next_cycle`](Self::wait_next_cycle): the cycle starts. Returns the number
    /// of deadlines that were skipped. Real-time safe.
    pub fn end_wait(&mut self, start: CycleStart) -> u64 {
        self.cycle_clock.end_wait(start);
        start.skipped
    }

    /// Result of the last [`wait_next_cycle`](Self::wait_next_cycle): deadline, delay, skipped
    /// deadlines; all 0 before the first. For
    /// [`CycleStatistics::begin`](crate::CycleStatistics::begin). Real-time safe.
    pub fn cycle_start(&self) -> CycleStart {
        self.cycle_clock.start()
    }

    /// Starts or restarts the statistics of the cycle, as [`reconfigure`](Self::reconfigure) does:
    /// from the next [`wait_next_cycle`](Self::wait_next_cycle) on, each wait is a start and each
    /// [`send`](Self::send) an end. Allocates; not for the cycle.
    pub fn measure_cycles(&mut self) {
        self.cycle_clock.measure(self.config.cycle_ns());
    }

    /// Statistics since [`measure_cycles`](Self::measure_cycles); `None` without it.
    /// Real-time safe, but not its distributions.
    pub fn cycle_statistics(&self) -> Option<&CycleStatistics> {
        self.cycle_clock.statistics()
    }

    /// Sets final spin and overrun policy of [`wait_next_cycle`](Self::wait_next_cycle), from the
    /// next wait on; the grid stays. By default it neither spins nor catches up. A spin
    /// above [`MAX_SPIN_NS`](crate::MAX_SPIN_NS) is cut to that. Real-time safe.
    pub fn set_cycle_timing(&mut self, timing: CycleTiming) {
        self.cycle_clock.set_timing(timing);
    }

    /// The time that the running cycle has on the grid, in nanoseconds of the library's clock.
    pub fn cycle_time_ns(&self) -> u64 {
        self.cycle_clock.time_ns()
    }

    /// Waiting time for the response of the bus, in nanoseconds
    /// ([`Plan::response_ns`](crate::Plan::response_ns)). Real-time safe.
    pub fn response_ns(&self) -> u64 {
        self.cycle_clock.response_ns()
    }

    /// Differences of the distributed clocks; `None` without them, before activation, and on an
    /// attached Adapter, whose owner serves the clocks. Real-time safe.
    pub fn clock_status(&self) -> Option<ClockStatus> {
        self.clocks.as_ref().map(DistributedClocks::status)
    }

    /// Shift of the next deadline by the last [`receive`](Self::receive), in nanoseconds, so that
    /// the host follows the reference clock
    /// ([`ClockSource::Reference`](crate::ClockSource::Reference)); otherwise 0.
    /// [`wait_next_cycle`](Self::wait_next_cycle) applies it. Real-time safe.
    pub fn clock_correction_ns(&self) -> i64 {
        self.cycle_clock.correction_ns()
    }

    /// A handle for other threads: reads snapshots of the cycle, and gives commands. Allocates; not for
    /// the cycle.
    pub fn observer(&self) -> Observer {
        self.publisher.observer()
    }

    /// Number of the running cycle, or of the last one: [`receive`](Self::receive) counts from 1.
    /// Real-time safe.
    pub fn cycle_number(&self) -> u64 {
        self.cycle_clock.cycle_number()
    }

    /// Returns whether an observer requested the application to stop
    /// ([`Observer::request_stop`]); also [`should_stop`](Self::should_stop) returns true then.
    /// Real-time safe.
    pub fn is_stop_requested(&self) -> bool {
        self.publisher.is_stop_requested()
    }

    /// Ends a request to stop: calls wait again. Real-time safe.
    pub fn clear_stop_request(&self) {
        self.publisher.clear_stop_request();
    }

    /// Publisher of the snapshots, for the layers of the SDK: their sections, and the quick stops that
    /// observers command.
    #[inline]
    pub fn publisher(&self) -> &Publisher {
        &self.publisher
    }

    /// Requests to the slaves, executed in parallel with the cycle. Real-time safe.
    #[inline]
    pub fn requests(&mut self) -> Requests<'_> {
        Requests { master: &mut self.master, slaves: &self.slaves, phase: self.phase }
    }

    /// Runs `work` with a diagnostics handle of its own while the cycle continues.
    ///
    /// On an active bus `work` runs on another thread and `cycle` on this one, every cycle, until
    /// `work` is done; otherwise `work` runs on this thread. Blocks; for SDO transfers in or
    /// between cycles use [`requests`](Self::requests).
    ///
    /// # Errors
    /// The handle cannot be opened. Errors of single cycles do not end the work.
    pub fn diagnose<R: Send>(
        &mut self,
        mut cycle: impl FnMut(&mut Self) -> Result<(), CycleError>,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, Error> {
        if self.phase != Phase::Active {
            return Ok(work(&self.diagnostics));
        }
        let clock = self.ecrt.clock().clone();
        run_in_parallel(clock.as_ref(), self.diagnostics_opener(), work, || {
            self.wait_next_cycle();
            // The transfer needs a running bus, whatever the result of a single cycle.
            let _ = cycle(self);
        })
    }

    /// Requests OP of every slave again. The master stops the startup of a slave, with its error flag,
    /// when a startup SDO failed, also because the mailbox did not answer in time, or when a change of
    /// state was rejected; only this call, or the loss of the slave, makes it try again. Slaves in OP
    /// and slaves that are being configured are not affected.
    ///
    /// Real-time safe if [`retry_startup_blocks`](Self::retry_startup_blocks) is false. Otherwise it
    /// takes the master's semaphore, usually for microseconds but without a bound: call it between two
    /// cycles, not while axes of other gateways move.
    ///
    /// # Errors
    /// The library's error; [`Error::Phase`] if the bus is not active; [`Error::Attached`]: the owner
    /// of the master calls `ecrt_master_reset`.
    pub fn retry_startup(&mut self) -> Result<(), Error> {
        need_owned(&self.master, "retry_startup")?;
        self.phase.need("retry_startup", Phase::Active)?;
        self.master.reset().map_err(|e| Error::library("ecrt_master_reset", None, e))
    }

    /// Returns whether [`retry_startup`](Self::retry_startup) takes the master's semaphore: before
    /// version 1.6 of the library. Later ones only schedule the work.
    pub fn retry_startup_blocks(&self) -> bool {
        self.ecrt.version() < (1, 6)
    }

    /// Speeds up slaves that start: [`wait_next_cycle`](Self::wait_next_cycle) then lets the master
    /// receive and send every half millisecond, without process data. Otherwise each step of a scan
    /// and of an SDO transfer takes two cycles. [`wait_op`](Self::wait_op) and the layers above set
    /// this. Without effect on an attached Adapter. Real-time safe.
    pub fn set_startup_rounds(&mut self, rounds: StartupRounds) {
        self.startup_rounds = rounds;
    }

    /// Online, OP and AL state of a slave as the master's configuration sees it. It lags the
    /// working counter by seconds. Real-time safe.
    pub fn slave_state(&self, slave: usize) -> Result<SlaveConfigState, CycleError> {
        match self.slaves.get(slave) {
            Some(found) => found.state(slave, &self.master),
            None => Err(CycleError::of_slave("ecrt_slave_config_state", slave)(Errno::EINVAL)),
        }
    }

    /// Returns whether a network link of the master is up, as far as the library tells; real-time safe.
    pub fn has_link(&self) -> bool {
        self.master.state().map_or(true, |state| state.link_up)
    }

    /// Takes a CoE emergency of a slave (8 bytes: error code, error register, data). The master receives it with
    /// the response of an SDO transfer, and keeps eight; on an attached Adapter the owner sets the size of the queue.
    /// `None` without one; then IgH writes a line to stderr. Not real-time safe; not for the cycle.
    pub fn take_emergency(&mut self, slave: usize) -> Option<[u8; 8]> {
        let config = self.slaves.get(slave)?.config();
        self.master.take_emergency(config).ok()
    }
}
