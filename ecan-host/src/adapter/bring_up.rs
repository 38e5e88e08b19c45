//! From slaves that may not be on the bus yet to a master that is configured for them, with the datagrams that help
//! slaves to start.

use std::thread;
use std::time::Duration;

use ecan_protocol::config::ConfigObject;
use ecan_protocol::device::{AlState, Capabilities, OptionalObject};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::describe;
use ecrt_sys::{Clock, Ecrt};
use tracing::{info, warn};

use super::cycle_clock::{CycleClock, deadline_ns};
use super::slave::{Prepared, Slave, settings_of};
use crate::bus::mapping::read_mapping;
use crate::bus::{Diagnostics, recognition};
use crate::clocks::DistributedClocks;
use crate::config::{AdapterConfig, StartupStep};
use crate::error::Error;
use crate::master::{Master, RequestState};
use crate::startup::StartupPlan;

/// Pause between two looks at the slaves that are not found, in nanoseconds.
const FIND_POLL_NS: u64 = 50_000_000;
/// Subindex of 0xF000 that each gateway has: the size of a PDO unit.
const SIZE_UNIT: u8 = 17;

/// The parts of an Adapter that is being configured.
pub(super) struct BringUp<'a> {
    pub(super) ecrt: &'a Ecrt,
    pub(super) master: &'a mut Master,
    pub(super) diagnostics: &'a Diagnostics,
    pub(super) config: &'a AdapterConfig,
    pub(super) startup: &'a mut StartupPlan,
    /// Returns whether the application requests the end of calls that wait.
    pub(super) should_stop: &'a dyn Fn() -> bool,
}

impl BringUp<'_> {
    /// Finds, identifies and reads all slaves before the first one is configured.
    pub(super) fn run(mut self) -> Result<Vec<Slave>, Error> {
        let prepared = self.find_and_prepare_slaves()?;
        for (slave, prepared) in prepared.iter().enumerate() {
            self.startup.leave_out(slave, &prepared.missing);
        }
        let configure = |(slave, prepared)| {
            Slave::configure(self.ecrt, self.master, self.config, self.startup, slave, prepared)
        };
        let slaves = prepared.into_iter().enumerate().map(configure);
        let slaves = slaves.collect::<Result<Vec<Slave>, Error>>()?;
        self.select_reference_clock(&slaves)?;
        Ok(slaves)
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
                    release(self.master, self.config.master_index)?;
                    clock.sleep_until_ns(clock.now_ns() + FIND_POLL_NS);
                }
                result => return result,
            }
            self.check_stop()?;
        }
    }

    fn check_stop(&self) -> Result<(), Error> {
        if (self.should_stop)() { Err(Error::Stopped) } else { Ok(()) }
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
            match recognition::look_for_slaves(self.diagnostics, self.config) {
                Ok(()) if self.master.is_reserved() => return Ok(()),
                Ok(()) => {
                    *self.master = Master::request(self.ecrt, self.config.master_index)?;
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
                Err(Error::NoSuchSlave { .. }) => release(self.master, self.config.master_index)?,
                Err(_) => {}
            }
            clock.sleep_until_ns(clock.now_ns() + FIND_POLL_NS);
        }
    }

    /// Reads every slave; in real time all of them at once, because the master serves the mailboxes
    /// of its slaves in parallel.
    fn prepare_slaves(&self) -> Result<Vec<Prepared>, Error> {
        let slaves = 0..self.config.slaves.len();
        if slaves.len() < 2 || !self.ecrt.clock().is_free_running() {
            let prepare = |slave| {
                self.check_stop()?;
                prepare(self.diagnostics, self.config, self.startup, slave)
            };
            return slaves.map(prepare).collect();
        }
        let (config, startup) = (self.config, &*self.startup);
        thread::scope(|scope| {
            let workers: Vec<_> = slaves
                .map(|slave| {
                    let open = Diagnostics::opener(self.ecrt, config);
                    scope.spawn(move || prepare(&open()?, config, startup, slave))
                })
                .collect();
            let join = |worker: thread::ScopedJoinHandle<'_, _>| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            workers.into_iter().map(join).collect()
        })
    }

    fn select_reference_clock(&mut self, slaves: &[Slave]) -> Result<(), Error> {
        let Some(slave) = self.config.dc.and_then(|dc| dc.reference) else { return Ok(()) };
        // On an attached Adapter the owner chooses.
        if self.master.is_attached() {
            return Ok(());
        }
        let config = slaves.get(slave).map(Slave::config);
        self.master
            .select_reference_clock(config)
            .map_err(|e| Error::library("ecrt_master_select_reference_clock", Some(slave), e))
    }
}

/// Releases the master, and with it a configuration that was never activated.
pub(super) fn release(master: &mut Master, master_index: u32) -> Result<(), Error> {
    if master.is_reserved() && !master.is_attached() {
        *master = Master::open(&master.ecrt().clone(), master_index)?;
    }
    Ok(())
}

fn prepare(
    diagnostics: &Diagnostics,
    config: &AdapterConfig,
    startup: &StartupPlan,
    slave: usize,
) -> Result<Prepared, Error> {
    let settings = settings_of(config, slave)?;
    let identified = recognition::identify(diagnostics, slave, settings)?;
    let mut capabilities = identified.capabilities;
    let missing = find_missing(diagnostics, startup, slave)?;
    let mut available = startup.clone();
    available.leave_out(slave, &missing);
    let steps = available.preparation(config, slave);
    diagnostics.run_startup_with(slave, &steps, &mut capabilities, |_| {})?;
    let begun_ns = diagnostics.clock().now_ns();
    diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, SIZE_UNIT)?;
    let sdo_time = Duration::from_nanos(diagnostics.clock().now_ns().saturating_sub(begun_ns));
    let mapping = |direction, n| read_mapping(diagnostics, slave, direction, n);
    Ok(Prepared {
        identity: identified.identity,
        capabilities,
        rx_units: mapping(Direction::RxPdo, settings.rx_multiplier)?,
        tx_units: mapping(Direction::TxPdo, settings.tx_multiplier)?,
        rx_profile: requested_profile(diagnostics, config, &available, slave)?,
        sdo_time,
        missing,
    })
}

/// The RxPDO profile after the startup: what its last steps write, and what the slave has where none writes.
fn requested_profile(
    diagnostics: &Diagnostics,
    config: &AdapterConfig,
    startup: &StartupPlan,
    slave: usize,
) -> Result<PdoProfile, Error> {
    let object = Direction::RxPdo.profile_object();
    let multiplier = settings_of(config, slave)?.rx_multiplier;
    let mut profile = PdoProfile { multiplier, ..PdoProfile::default() };
    let steps = startup.steps(config, slave);
    for subindex in PdoProfile::fields().map(|entry| entry.subindex) {
        let written = steps.iter().rev().find_map(|step| match step {
            StartupStep::Download(sdo) if step.object() == (object, subindex) => Some(sdo.value),
            _ => None,
        });
        let value = match written {
            _ if subindex == PdoProfile::MULTIPLIER => continue,
            Some(value) => value,
            None => match diagnostics.sdo_upload_u32(slave, object, subindex) {
                Err(error) if error.is_missing_object() => continue,
                value => value?,
            },
        };
        // The gateway rejects a value without meaning, and keeps the profile that it has.
        let _ = profile.set_value(subindex, value);
    }
    Ok(profile)
}

/// Reads an entry of each optional object of the startup, since a write that the slave rejects would end the startup.
fn find_missing(
    diagnostics: &Diagnostics,
    startup: &StartupPlan,
    slave: usize,
) -> Result<Vec<OptionalObject>, Error> {
    let mut missing = Vec::new();
    for object in startup.optional_objects(slave) {
        let (index, subindex) = object.probe();
        match diagnostics.sdo_upload_u32(slave, index, subindex) {
            Err(error) if error.is_missing_object() => {
                let name = describe(index, subindex);
                warn!(
                    slave,
                    "slave {slave}: the firmware does not have {name} (assumption H42): not configured, it keeps its \
                     own behaviour"
                );
                missing.push(object);
            }
            // One that cannot be read can still be written.
            Err(error @ Error::Sdo { abort_code: None, .. }) => return Err(error),
            _ => {}
        }
    }
    Ok(missing)
}

/// Time from a send to a receive and from a receive to the next send, in nanoseconds. In between, the
/// master's thread evaluates a response and prepares the next datagram; without the pause after the
/// receive each step would take two sends.
const PAUSE_NS: u64 = 250_000;

/// ESC register speed counter start, and its default.
const SPEED_COUNTER: u16 = 0x0930;
const SPEED_COUNTER_START: u16 = 0x1000;
/// Longest wait for the writes, and the interval of looking, in nanoseconds.
const RESET_LIMIT_NS: u64 = 1_000_000_000;
const RESET_POLL_NS: u64 = 5_000_000;

/// When the master exchanges its own datagrams between two cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartupRounds {
    /// Only in the cycles.
    #[default]
    Off,
    /// While a slave is below SAFEOP or exchanges no process data: while the master reads an SDO
    /// dictionary it polls no states. Once all are in OP, the first SDO request must follow within the
    /// few sends in which the master polls the slaves; otherwise it begins to read the SDO dictionary,
    /// and executes no requests until that is done.
    UntilSafeOp,
    /// Always: requests are queued.
    On,
}

/// The master and its slaves between two cycles.
pub(super) struct RoundExchange<'a> {
    pub(super) master: &'a mut Master,
    pub(super) slaves: &'a [Slave],
    pub(super) clocks: Option<&'a mut DistributedClocks>,
    pub(super) cycle_clock: &'a CycleClock,
}

impl RoundExchange<'_> {
    /// Lets the master receive and send until the next cycle, while the slaves need it.
    pub(super) fn run(&mut self, clock: &dyn Clock, rounds: StartupRounds) {
        let end_ns =
            self.cycle_clock.next_deadline_ns().map(|deadline| deadline.saturating_sub(PAUSE_NS));
        // Each receive makes the master give up datagrams that were sent more than 500 us ago.
        let back_ns = self.cycle_clock.answered_ns();
        let pause = || {
            let next_ns = back_ns.max(clock.now_ns() + PAUSE_NS);
            let in_time = end_ns.is_some_and(|end_ns| next_ns <= end_ns);
            if in_time {
                clock.sleep_until_ns(next_ns);
            }
            in_time
        };
        // The next cycle reports what fails.
        while self.needs_round(rounds) && pause() {
            let _ = self.master.receive();
            if !pause() {
                return;
            }
            // This datagram takes the place of the cycle's reading of the reference clock.
            if self.has_slave_below_safeop()
                && let Some(clocks) = &mut self.clocks
            {
                let _ = clocks.send_between_cycles(self.master, clock.now_ns());
            }
            let _ = self.master.send();
        }
    }

    fn needs_round(&self, rounds: StartupRounds) -> bool {
        let is_silent = |slave: &Slave| slave.report().working_counter == 0;
        match rounds {
            StartupRounds::Off => false,
            StartupRounds::UntilSafeOp => {
                self.slaves.iter().any(is_silent) || self.has_slave_below_safeop()
            }
            StartupRounds::On => true,
        }
    }

    fn has_slave_below_safeop(&self) -> bool {
        self.slaves.iter().any(|slave| {
            let state = self.master.config_state(slave.config());
            state.is_ok_and(|state| !state.online || state.al_state < AlState::SafeOp.raw())
        })
    }
}

/// Clears the filtered time difference (0x092C) of each slave by writing its speed counter start.
/// The difference outlasts a program whose host led the clocks. The master waits five seconds for it to
/// become small, although nothing changes it when the reference clock leads.
pub(super) fn reset_clock_differences(clock: &dyn Clock, master: &mut Master, slaves: &[Slave]) {
    let end_ns = clock.now_ns() + RESET_LIMIT_NS;
    for slave in slaves {
        let start = SPEED_COUNTER_START.to_le_bytes();
        // Without it the startup only lasts longer.
        let _ = master.requests().register_write(slave.al_control(), SPEED_COUNTER, &start);
    }
    let is_busy = |master: &mut Master, slave: &Slave| {
        matches!(master.requests().register_state(slave.al_control()), Ok(RequestState::Busy))
    };
    while slaves.iter().any(|slave| is_busy(master, slave)) && clock.now_ns() < end_ns {
        clock.sleep_until_ns(clock.now_ns() + RESET_POLL_NS);
    }
}
