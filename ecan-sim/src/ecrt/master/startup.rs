//! State machine that brings a slave to its requested state.
//!
//! The order is IgH's: INIT, registers cleared, mailboxes, PREOP, startup SDOs, PDO assignment and
//! mapping, watchdog, sync managers, FMMUs, distributed clocks, SAFEOP, OP.

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{Direction, sync_manager};

use super::activity::KernelLog;
use crate::ecrt::clocks::Clocks;
use crate::ecrt::domain::{AssignmentWrite, SyncWatchdog, assignment_writes, pdo_bytes};
use crate::ecrt::sdo_transfer::{
    MailboxTransfer, Pace, Payload, Progress, Receiver, SdoFailure, SdoObject, proceed,
};
use crate::ecrt::slaves::{AL_ERROR, Configs, SlaveConfig, SlaveView, Startup, al_status};
use crate::ecrt::timing::{
    CLOCK_NEAR_NS, CLOCK_SETTLE_NS, CLOCK_TIMEOUT_NS, REGISTER_NS, STATE_POLL_NS, STATE_TIMEOUT_NS,
};
use crate::gateway::{Gateway, SyncManagerConfig};
use crate::sii::sync_manager_config;
use crate::world::World;

/// Control bits of the direction; 1 is written by the master.
const DIRECTION: u8 = 0x0C;
const WRITTEN_BY_MASTER: u8 = 0x04;
/// Control bit that lets a sync manager trigger the watchdog.
const WATCHDOG_TRIGGER: u8 = 0x40;
/// Default of the watchdog divider: 100 µs a step.
const WATCHDOG_DIVIDER: u16 = 2498;
/// Default of the watchdog intervals: 100 ms.
const WATCHDOG_INTERVALS: u16 = 1000;
/// Time of one watchdog divider step, ns.
const WATCHDOG_STEP_NS: u64 = 40;

enum Next {
    Step(Startup, u64),
    Done,
    /// Error: not retried.
    Failed,
    /// No response: retried after the next poll.
    Lost,
}

/// One step of the startup of a slave.
pub(super) struct SlaveStartup<'a> {
    pub(super) index: usize,
    pub(super) slave: &'a mut SlaveView,
    pub(super) configs: &'a Configs,
    pub(super) clocks: &'a Clocks,
    pub(super) log: &'a mut KernelLog,
    pub(super) pace: Pace,
    /// Steps of the master so far.
    pub(super) steps: u64,
}

impl<'a> SlaveStartup<'a> {
    /// Continues the configuration of the slave. Returns whether it ends.
    pub(super) fn run(mut self, world: &mut World) -> bool {
        let now = world.now_ns();
        // The master's thread sleeps between the register accesses of a step.
        let pace = self.pace;
        let idle_ns = |delay_ns| match pace {
            Pace::Timed(step_ns) => delay_ns / REGISTER_NS * step_ns,
            Pace::Sends(_) => 0,
        };
        let Some(step) = self.slave.startup.take() else { return false };
        let next = if self.slave.is_present(world) {
            self.run_step(world, step)
        } else {
            self.log.push_slave(self.index, "does not respond");
            Next::Lost
        };
        let slave = self.slave;
        slave.current = al_status(world, slave.slot);
        slave.due = now;
        match next {
            Next::Step(step, delay) => {
                slave.startup = Some(step);
                slave.due = now + delay.max(idle_ns(delay));
            }
            Next::Done => slave.force_config = false,
            Next::Failed => slave.error_flag = true,
            Next::Lost => {}
        }
        slave.startup.is_none()
    }

    /// The configuration of the slave.
    fn config(&self) -> Option<&'a SlaveConfig> {
        self.configs.get(self.slave.config?)
    }

    fn begin_transfer(&self, now: u64) -> MailboxTransfer {
        MailboxTransfer::begin(now, self.steps)
    }

    fn run_step(&mut self, world: &mut World, step: Startup) -> Next {
        let (slot, now) = (self.slave.slot, world.now_ns());
        match step {
            Startup::Request(to) => {
                let from = self.slave.current & 0x0F;
                world.request_al_state(slot, to);
                Next::Step(Startup::Wait { to, from, since: now }, STATE_POLL_NS)
            }
            Startup::Wait { to, from, since } => self.wait_state(world, to, from, since),
            Startup::ClearRegisters => {
                world.line_mut().set_fmmus(slot, []);
                world.with_gateway_in(slot, |gateway, _| {
                    for number in 0..4 {
                        gateway.configure_sync_manager(number, None);
                    }
                    gateway.set_dc_sync0(None);
                });
                if let Some(io) = world.line_mut().io_in_mut(slot) {
                    io.clear_registers();
                }
                Next::Step(Startup::Mailboxes, 3 * REGISTER_NS)
            }
            Startup::Mailboxes => {
                world.with_gateway_in(slot, |gateway, _| gateway.set_up_mailboxes());
                Next::Step(Startup::Request(AlState::PreOp), REGISTER_NS)
            }
            Startup::Sdo { at, mailbox } => self.run_sdo(world, at, mailbox),
            Startup::Assignment { list, at, mailbox } => {
                self.run_assignment(world, list, at, mailbox)
            }
            Startup::Watchdog => {
                // without a setting the slave keeps its values; one of both sets the other to its
                // default
                let (divider, intervals) = self.config().map_or((0, 0), |c| c.watchdog);
                if (divider, intervals) != (0, 0) {
                    let divider = if divider == 0 { WATCHDOG_DIVIDER } else { divider };
                    let intervals = if intervals == 0 { WATCHDOG_INTERVALS } else { intervals };
                    let ns = (u64::from(divider) + 2) * WATCHDOG_STEP_NS * u64::from(intervals);
                    world.with_gateway_in(slot, |gateway, _| gateway.set_watchdog_ns(ns));
                    if let Some(io) = world.line_mut().io_in_mut(slot) {
                        io.set_watchdog_ns(ns);
                    }
                }
                Next::Step(Startup::SyncManagers, 2 * REGISTER_NS)
            }
            Startup::SyncManagers => {
                self.set_up_sync_managers(world);
                Next::Step(Startup::Fmmus, REGISTER_NS)
            }
            Startup::Fmmus => {
                if let Some(config) = self.slave.config {
                    let fmmus = self.configs.domains().iter().flat_map(|domain| {
                        let own = domain.fmmus.iter().filter(move |fmmu| fmmu.config == config);
                        own.map(|fmmu| domain.slave_fmmu(fmmu))
                    });
                    world.line_mut().set_fmmus(slot, fmmus);
                }
                let dc = self.config().and_then(|config| config.dc);
                let has_clock = self.slave.description.has_clock;
                let next = match dc {
                    Some(dc) if dc.assign_activate != 0 && has_clock => Startup::ClockCycle,
                    _ => Startup::Request(AlState::SafeOp),
                };
                if dc.is_some() && !has_clock {
                    self.log.push_slave(self.index, "does not support distributed clocks");
                }
                Next::Step(next, REGISTER_NS)
            }
            Startup::ClockCycle => Next::Step(Startup::ClockSettle { since: now }, CLOCK_SETTLE_NS),
            Startup::ClockSettle { since } => {
                let difference = world.line().gateway_in(slot).map_or(0, Gateway::dc_difference_ns);
                if difference.unsigned_abs() > CLOCK_NEAR_NS {
                    if now.saturating_sub(since) < CLOCK_TIMEOUT_NS {
                        return Next::Step(Startup::ClockSettle { since }, STATE_POLL_NS);
                    }
                    self.log.push_slave(self.index, "did not follow the reference clock in time");
                }
                Next::Step(Startup::ClockStart, 0)
            }
            Startup::ClockStart => {
                let dc = self.config().and_then(|config| config.dc);
                let sync0 = dc.and_then(|dc| self.clocks.sync0(&dc));
                if !self.clocks.has_phase() {
                    self.log.push_slave(
                        self.index,
                        "has no application time: Sync0 will not be in phase",
                    );
                }
                let has_sync1 = dc.is_some_and(|dc| Clocks::has_sync1(&dc));
                world.with_gateway_in(slot, |gateway, _| {
                    gateway.set_dc_sync1(has_sync1);
                    gateway.set_dc_sync0(sync0);
                });
                Next::Step(Startup::Request(AlState::SafeOp), 2 * REGISTER_NS)
            }
        }
    }

    fn wait_state(&mut self, world: &mut World, to: AlState, from: u8, since: u64) -> Next {
        let now = world.now_ns();
        let (slot, requested) = (self.slave.slot, self.slave.requested);
        let status = al_status(world, slot);
        if status == to.raw() {
            if to == AlState::PreOp {
                self.slave.preop_at = Some(now);
            }
            if to == requested {
                return Next::Done;
            }
            return match to {
                AlState::Init => Next::Step(Startup::ClearRegisters, REGISTER_NS),
                AlState::PreOp => {
                    Next::Step(Startup::Sdo { at: 0, mailbox: self.begin_transfer(now) }, 0)
                }
                AlState::SafeOp => Next::Step(Startup::Request(AlState::Op), REGISTER_NS),
                _ => Next::Done,
            };
        }
        if status & AL_ERROR != 0 {
            let code = world.line().al_status_code(slot);
            self.log.push_slave(
                self.index,
                &format!("rejected the change to {to}: AL status code {}", AlStatusCode(code)),
            );
            // the master acknowledges the error in the state that the slave reports
            if let Some(shown) = AlState::from_raw(status & 0x0F) {
                world.request_al_state(slot, shown);
            }
            return Next::Failed;
        }
        let limit = self
            .config()
            .and_then(|config| {
                let known = config.state_timeouts.iter().rev();
                known.clone().find(|(f, t, _)| *f == from && *t == to.raw())
            })
            .map_or(STATE_TIMEOUT_NS, |(_, _, limit)| *limit);
        if now.saturating_sub(since) > limit {
            self.log.push_slave(self.index, &format!("did not change to {to} in time"));
            return Next::Failed;
        }
        Next::Step(Startup::Wait { to, from, since }, STATE_POLL_NS)
    }

    /// Continues a download.
    fn download(
        &self,
        world: &mut World,
        mailbox: &mut MailboxTransfer,
        object: SdoObject,
        data: &[u8],
    ) -> Progress {
        let receiver = Receiver { slot: self.slave.slot, is_present: true };
        proceed(world, receiver, mailbox, self.pace, object, Payload::Download(data))
    }

    fn run_sdo(&mut self, world: &mut World, at: usize, mut mailbox: MailboxTransfer) -> Next {
        let Some(config) = self.config() else {
            return Next::Step(Startup::Watchdog, REGISTER_NS);
        };
        let next = self.begin_transfer(world.now_ns());
        let Some(sdo) = config.sdos.get(at) else {
            let list = assignment_writes(&config.syncs, &self.slave.description);
            return Next::Step(Startup::Assignment { list, at: 0, mailbox: next }, 0);
        };
        let object = sdo.object;
        if !self.slave.description.has_coe {
            self.log.push_sdo(self.index, "startup SDO", object, SdoFailure::NO_COE);
            return Next::Failed;
        }
        match self.download(world, &mut mailbox, object, &sdo.data) {
            Progress::Waiting(delay) => Next::Step(Startup::Sdo { at, mailbox }, delay),
            Progress::Done(Ok(())) => Next::Step(Startup::Sdo { at: at + 1, mailbox: next }, 0),
            Progress::Done(Err(failure)) => {
                self.log.push_sdo(self.index, "startup SDO", object, failure);
                Next::Failed
            }
        }
    }

    fn run_assignment(
        &mut self,
        world: &mut World,
        list: Vec<AssignmentWrite>,
        at: usize,
        mut mailbox: MailboxTransfer,
    ) -> Next {
        let Some(write) = list.get(at).copied() else {
            self.note_assignment();
            return Next::Step(Startup::Watchdog, REGISTER_NS);
        };
        let object = SdoObject::entry(write.index, write.subindex);
        let bytes = write.value.to_le_bytes();
        let data = bytes.get(..write.size).unwrap_or(&bytes);
        let at = match self.download(world, &mut mailbox, object, data) {
            Progress::Waiting(delay) => {
                return Next::Step(Startup::Assignment { list, at, mailbox }, delay);
            }
            Progress::Done(Ok(())) => at + 1,
            Progress::Done(Err(failure)) => {
                self.log.push_sdo(self.index, "warning: PDO configuration", object, failure);
                write.after_failure
            }
        };
        let mailbox = self.begin_transfer(world.now_ns());
        Next::Step(Startup::Assignment { list, at, mailbox }, 0)
    }

    /// The configured assignment replaces the one that the scan found.
    fn note_assignment(&mut self) {
        let Some(config) = self.config() else { return };
        let slave = &mut *self.slave;
        if !slave.description.pdo_assign {
            return;
        }
        for direction in [Direction::RxPdo, Direction::TxPdo] {
            let number = usize::from(sync_manager(direction));
            if let (Some(known), Some(sync)) =
                (slave.assigned.get_mut(number), config.syncs.get(number))
            {
                known.clone_from(&sync.pdos);
            }
        }
    }

    /// Start and control byte are those of the SII, the length is that of the assigned PDOs; the
    /// configuration determines direction and watchdog.
    fn set_up_sync_managers(&mut self, world: &mut World) {
        let slot = self.slave.slot;
        if world.line().io_in(slot).is_some() {
            return self.set_up_io(world);
        }
        for direction in [Direction::RxPdo, Direction::TxPdo] {
            let number = sync_manager(direction);
            let sync = self.config().and_then(|config| config.syncs.get(usize::from(number)));
            let length = sync.map_or(0, |sync| pdo_bytes(&sync.pdos));
            let watchdog = sync.map_or(SyncWatchdog::Default, |sync| sync.watchdog);
            let sii = world.line().gateway_in(slot).map_or(&[][..], Gateway::eeprom);
            let Some(sii) = sync_manager_config(sii, number) else { continue };
            let written_by_master =
                if direction == Direction::RxPdo { WRITTEN_BY_MASTER } else { 0 };
            let control = sii.control & !DIRECTION | written_by_master;
            let config = SyncManagerConfig {
                start: sii.start,
                length: u16::try_from(length).unwrap_or(u16::MAX),
                control: match watchdog {
                    SyncWatchdog::Default => control,
                    SyncWatchdog::Enable => control | WATCHDOG_TRIGGER,
                    SyncWatchdog::Disable => control & !WATCHDOG_TRIGGER,
                },
            };
            let config = (length > 0).then_some(config);
            world.with_gateway_in(slot, |gateway, _| {
                gateway.configure_sync_manager(number, config);
            });
        }
    }

    /// The sync managers of an I/O have the lengths of the configured PDOs, otherwise those of its SII.
    fn set_up_io(&mut self, world: &mut World) {
        let slot = self.slave.slot;
        let lengths: Vec<_> = self
            .slave
            .assigned
            .iter()
            .enumerate()
            .map(|(number, assigned)| {
                let configured = self.config().and_then(|config| config.syncs.get(number));
                let length = |pdos: &[_]| u16::try_from(pdo_bytes(pdos)).unwrap_or(u16::MAX);
                (length(assigned), configured.map_or(0, |sync| length(&sync.pdos)))
            })
            .collect();
        if lengths.iter().any(|(fixed, configured)| fixed != configured) {
            self.log
                .push_slave(self.index, "does not support changing its PDO assignment and mapping");
        }
        if let Some(io) = world.line_mut().io_in_mut(slot) {
            for (number, (_, configured)) in lengths.into_iter().enumerate() {
                io.configure_sync_manager(number, configured);
            }
        }
    }
}
