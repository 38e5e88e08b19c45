//! The simulated master: its parts, and the order in which they act.

mod activity;
mod dictionary;
mod polling;
mod startup;
mod transfers;
mod transport;

use activity::{BusScan, KernelLog, Pacing, Requests, Reservation};
use dictionary::DictionaryReader;
pub(crate) use dictionary::{dictionary_ns, object_count};
use ecan_protocol::device::AlState;
use startup::SlaveStartup;
use transport::{Contents, Transport};

use super::clocks::Clocks;
use super::domain::Queued;
use super::slaves::{Configs, SlaveConfig, SlaveView, is_any_configured};
use crate::scenario::{EcrtVersion, MasterBehaviour, Scenario};
use crate::world::{Slot, World};

/// The master with its state machines.
#[derive(Debug)]
pub(crate) struct MasterModel {
    version: EcrtVersion,
    behaviour: MasterBehaviour,
    pub(crate) reservation: Reservation,
    pub(crate) slaves: Vec<SlaveView>,
    pub(crate) configs: Configs,
    pub(crate) clocks: Clocks,
    pub(crate) scan: BusScan,
    pub(crate) transport: Transport,
    pub(crate) requests: Requests,
    pub(crate) log: KernelLog,
    pacing: Pacing,
    dictionary: DictionaryReader,
}

impl MasterModel {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        Self {
            version: scenario.version,
            behaviour: scenario.master,
            reservation: Reservation::new(scenario.reserved),
            slaves: Vec::new(),
            configs: Configs::default(),
            clocks: Clocks::default(),
            scan: BusScan::default(),
            transport: Transport::new(scenario.carries_large_pdos),
            requests: Requests::default(),
            log: KernelLog::default(),
            pacing: Pacing::new(&scenario.master),
            dictionary: DictionaryReader::new(scenario.seed),
        }
    }

    /// Returns whether the bus is scanned and every slave has reached its requested state or failed.
    pub(crate) fn is_settled(&self) -> bool {
        let settled = |slave: &SlaveView| {
            slave.error_flag
                || (slave.is_idle()
                    && !slave.force_config
                    && slave.current == slave.requested.raw())
        };
        !self.scan.is_running() && self.slaves.iter().all(settled)
    }

    pub(crate) fn reserve(&mut self, client: u64) {
        self.reservation.reserve(client);
        self.scan.set_scan_when_idle(false);
    }

    /// Releases the master; its configuration is lost.
    pub(crate) fn release(&mut self, client: u64, world: &World) {
        if self.reservation.is_owner(client) {
            self.deactivate(world);
            self.reservation.release();
            self.scan.set_scan_when_idle(self.behaviour.scans_after_release);
        }
    }

    pub(crate) fn activate(&mut self, world: &World) {
        self.advance_dictionary(world);
        let now = world.now_ns();
        let (mut base, mut datagrams) = (0u32, 0);
        for domain in self.configs.domains_mut() {
            domain.finish(base, self.version);
            base = base.wrapping_add(domain.size as u32);
            datagrams += domain.datagrams.len();
        }
        self.transport.reserve(datagrams + 3);
        self.reservation.activate();
        self.clocks.set_again();
        // restart a configuration in progress for the new requested state
        for slave in &mut self.slaves {
            slave.startup = None;
            slave.due = now;
        }
        self.reset();
        self.scan.poll_at(now);
    }

    /// Requests OP of every configured slave, including failed ones.
    pub(crate) fn reset(&mut self) {
        if !self.reservation.is_active() {
            return;
        }
        for slave in self.slaves.iter_mut().filter(|slave| slave.config.is_some()) {
            slave.requested = AlState::Op;
            slave.error_flag = false;
        }
    }

    /// Ends the operation phase; the slaves return to PREOP.
    pub(crate) fn deactivate(&mut self, world: &World) {
        self.advance_dictionary(world);
        let now = world.now_ns();
        let was_active = self.reservation.is_active();
        self.configs.clear();
        self.transport.clear();
        self.clocks.reset();
        for slave in &mut self.slaves {
            slave.config = None;
            slave.requested = AlState::PreOp;
            slave.error_flag = false;
            slave.startup = None;
            slave.transfer = None;
            slave.force_config = was_active || slave.force_config;
            slave.due = now;
        }
        self.requests.restart();
        self.reservation.deactivate();
        self.scan.poll_at(now);
    }

    pub(crate) fn next_due(&self) -> u64 {
        let slaves = self.slaves.iter().map(|slave| slave.due).min().unwrap_or(u64::MAX);
        match self.dictionary.due() {
            Some(due) => slaves.min(due),
            None if is_any_configured(&self.slaves) => slaves,
            None => slaves.min(self.scan.poll_due()),
        }
    }

    /// Continues the state machines.
    pub(crate) fn step(&mut self, world: &mut World) {
        let now = world.now_ns();
        self.advance_dictionary(world);
        if self.scan.poll_due() <= now
            && !self.dictionary.is_running()
            && !is_any_configured(&self.slaves)
        {
            self.run_bus(world);
        }
        for index in 0..self.slaves.len() {
            let Some(slave) = self.slaves.get(index) else { break };
            if slave.due > now {
                continue;
            }
            if slave.transfer.is_some() {
                self.run_transfer(index, world);
            } else if slave.startup.is_some() {
                self.run_startup(index, world);
            } else {
                self.choose_transfer(index, world);
            }
        }
    }

    fn advance_dictionary(&mut self, world: &World) {
        let (step, is_active) = (self.pacing.steps(), self.reservation.is_active());
        if self.dictionary.advance(step, is_active, &self.slaves, world) {
            self.scan.poll_at(world.now_ns());
        }
    }

    /// Continues the configuration of a slave. After it the master polls the following slaves.
    fn run_startup(&mut self, index: usize, world: &mut World) {
        let Self { slaves, configs, clocks, log, pacing, reservation, .. } = self;
        let Some(slave) = slaves.get_mut(index) else { return };
        let (pace, steps) = (pacing.pace(reservation.phase()), pacing.steps());
        let startup = SlaveStartup { index, slave, configs, clocks, log, pace, steps };
        if startup.run(world) {
            self.poll_from(index + 1, world);
        }
    }

    /// Slave of the reference clock. It is unknown during a scan.
    pub(crate) fn reference_clock(&self) -> Option<Slot> {
        if self.scan.is_running() {
            return None;
        }
        self.clocks.reference_slave(&self.slaves, &self.configs)
    }

    /// The send queue with the contents of its datagrams. Only a send needs the reference clock.
    fn transport(&mut self, reference: Option<Slot>) -> (&mut Transport, Contents<'_>) {
        let Self { transport, configs, clocks, slaves, .. } = self;
        (transport, Contents { configs, clocks, slaves, reference })
    }

    pub(crate) fn enqueue(&mut self, item: Queued) {
        let (transport, mut contents) = self.transport(None);
        transport.enqueue(item, &mut contents);
    }

    /// Sends the queue. In the operation phase the state machines may advance with it.
    pub(crate) fn send(&mut self, world: &mut World) {
        let (transport, mut contents) = self.transport(self.reference_clock());
        transport.send(world, &mut contents);
        let is_blocked = transport.is_blocked();
        if self.reservation.is_active()
            && !is_blocked
            && self.pacing.advance_with_send(world.now_ns())
        {
            self.step(world);
        }
    }

    pub(crate) fn receive(&mut self, now: u64) {
        self.pacing.note_receive(now);
        let (transport, mut contents) = self.transport(None);
        transport.receive(now, &mut contents);
    }

    pub(crate) fn config(&mut self, index: usize) -> Result<&mut SlaveConfig, i32> {
        self.configs.get_mut(index).ok_or(libc::ENOENT)
    }

    /// The slave of a configuration, if it is present.
    pub(crate) fn slave_of(&self, config: usize) -> Result<Option<&SlaveView>, i32> {
        let slave = self.configs.get(config).ok_or(libc::ENOENT)?.slave;
        Ok(slave.and_then(|slave| self.slaves.get(slave)))
    }

    /// Index of the configuration of a slave, which is made if necessary.
    pub(crate) fn slave_config(
        &mut self,
        alias: u16,
        position: u16,
        vendor_id: u32,
        product_code: u32,
    ) -> Result<usize, i32> {
        if let Some(index) = self.configs.find(alias, position) {
            let same = self.configs.get(index).is_some_and(|config| {
                config.vendor_id == vendor_id && config.product_code == product_code
            });
            return if same { Ok(index) } else { Err(libc::ENOENT) };
        }
        let index = self.configs.add(SlaveConfig {
            alias,
            position,
            vendor_id,
            product_code,
            ..Default::default()
        });
        self.attach_config(index);
        let slave = self.configs.get(index).and_then(|config| config.slave);
        if let (Some(config), Some(slave)) =
            (self.configs.get_mut(index), slave.and_then(|slave| self.slaves.get(slave)))
        {
            config.load_defaults(&slave.assigned);
        }
        Ok(index)
    }
}
