//! The simulated master: reservation, phases, handles, and its state machines.

mod bus_scan;
mod dc;
mod dictionary;
mod register_access;
mod sdo;
mod startup;
mod transport;

use std::collections::VecDeque;

use ecan_protocol::device::AlState;

use super::sdo_transfer::{MailboxTransfer, Pace};
use crate::ecrt::clocks::Clocks;
use crate::ecrt::datagram::Queued;
use crate::ecrt::domain::Domain;
use crate::ecrt::slave_config::SlaveConfig;
use crate::ecrt::slave_view::SlaveView;
use crate::ecrt::timing::THREAD_GAP_NS;
use crate::random::Random;
use crate::scenario::{EcrtVersion, MasterBehaviour, Scenario};
use crate::world::World;

use bus_scan::Scan;
use dictionary::DictionaryFetch;
pub(crate) use dictionary::{dictionary_ns, object_count};
use sdo::BlockingSdo;

const LOG_LINES: usize = 1000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Phase {
    #[default]
    Idle,
    Reserved,
    /// Activated: its datagrams travel with the application's sends.
    Active,
}

#[derive(Debug, Default)]
pub(crate) struct MasterModel {
    pub(crate) version: EcrtVersion,
    pub(crate) carries_large_pdos: bool,
    /// Another program holds it.
    is_held_elsewhere: bool,
    pub(crate) phase: Phase,
    /// The handle that has reserved it.
    pub(crate) owner: Option<u64>,
    next_client: u64,
    pub(crate) slaves: Vec<SlaveView>,
    pub(crate) scan: Option<Scan>,
    pub(crate) poll_due: u64,
    /// A slave did not respond: the bus must be scanned when that is allowed.
    pub(crate) rescan_required: bool,
    pub(crate) responding: u32,
    pub(crate) al_states: u8,
    pub(crate) domains: Vec<Domain>,
    pub(crate) configs: Vec<SlaveConfig>,
    pub(crate) queue: Vec<Queued>,
    /// The last send stopped at a datagram that fits no frame.
    pub(crate) blocked: bool,
    pub(crate) sends: u64,
    /// Steps of the state machines in the operation phase.
    pub(crate) steps: u64,
    /// Every second send without a gap advances them.
    has_half_step: bool,
    /// The last receive, the last send, and the time between the last two sends.
    received_at: u64,
    sent_at: u64,
    send_interval_ns: u64,
    pub(crate) behaviour: MasterBehaviour,
    random: Random,
    dictionary: Option<DictionaryFetch>,
    /// The master was released: it scans the bus when it is idle.
    scans_when_idle: bool,
    /// When the present round of state polling ends, after which internal requests are served.
    round_ends: u64,
    /// The step in which the last internal request ended: the next one follows in the same.
    last_request_ended: Option<u64>,
    pub(crate) clocks: Clocks,
    /// Lines that the calls for the clocks would have written to stderr.
    pub(crate) stderr_lines: u64,
    pub(crate) blocking: Vec<BlockingSdo>,
    pub(crate) next_blocking: u64,
    log: VecDeque<String>,
}

impl MasterModel {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        Self {
            version: scenario.version,
            carries_large_pdos: scenario.carries_large_pdos,
            is_held_elsewhere: scenario.reserved,
            queue: Vec::with_capacity(16),
            behaviour: scenario.master,
            random: Random::new(scenario.seed),
            ..Self::default()
        }
    }

    /// Writes a line about a slave to the kernel log.
    pub(crate) fn log(&mut self, slave: usize, text: &str) {
        self.log_line(format!("EtherCAT 0-{slave}: {text}"));
    }

    pub(crate) fn log_line(&mut self, line: String) {
        if self.log.len() == LOG_LINES {
            self.log.pop_front();
        }
        self.log.push_back(line);
    }

    pub(crate) fn log_lines(&self) -> impl Iterator<Item = &str> {
        self.log.iter().map(String::as_str)
    }

    pub(crate) fn new_client(&mut self) -> u64 {
        self.next_client += 1;
        self.next_client
    }

    /// Returns whether the bus is scanned and every slave has reached its requested state or failed.
    pub(crate) fn is_settled(&self) -> bool {
        let settled = |slave: &SlaveView| {
            slave.error_flag
                || (slave.is_idle()
                    && !slave.force_config
                    && slave.current == slave.requested.raw())
        };
        self.scan.is_none() && self.slaves.iter().all(settled)
    }

    pub(crate) fn is_free(&self) -> bool {
        !self.is_held_elsewhere && self.owner.is_none()
    }

    pub(crate) fn reserve(&mut self, client: u64) {
        self.owner = Some(client);
        self.phase = Phase::Reserved;
        self.scans_when_idle = false;
    }

    /// Releases the master; its configuration is lost.
    pub(crate) fn release(&mut self, client: u64, world: &World) {
        if self.owner == Some(client) {
            self.deactivate(world);
            self.owner = None;
            self.phase = Phase::Idle;
            self.scans_when_idle = self.behaviour.scans_after_release;
        }
    }

    /// Returns whether this handle can configure: it has reserved the master, which is not active.
    pub(crate) fn may_configure(&self, client: u64) -> Result<(), i32> {
        match (self.owner == Some(client), self.phase) {
            (false, _) => Err(libc::EPERM),
            (true, Phase::Active) => Err(libc::EBUSY),
            (true, _) => Ok(()),
        }
    }

    pub(crate) fn may_exchange(&self, client: u64) -> Result<(), i32> {
        if self.owner == Some(client) { Ok(()) } else { Err(libc::EPERM) }
    }

    pub(crate) fn activate(&mut self, world: &World) {
        self.advance_dictionary(world);
        let now = world.now_ns();
        let (mut base, mut datagrams) = (0u32, 0);
        for domain in &mut self.domains {
            domain.finish(base, self.version);
            base = base.wrapping_add(domain.size as u32);
            datagrams += domain.datagrams.len();
        }
        self.queue.reserve(datagrams + 3);
        self.phase = Phase::Active;
        self.clocks.are_set = false;
        // restart a configuration in progress for the new requested state
        for slave in &mut self.slaves {
            slave.startup = None;
            slave.due = now;
        }
        self.reset();
        self.poll_due = now;
    }

    /// Requests OP of every configured slave, including failed ones.
    pub(crate) fn reset(&mut self) {
        if self.phase != Phase::Active {
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
        self.domains.clear();
        self.configs.clear();
        self.queue.clear();
        self.blocked = false;
        self.clocks = Clocks::default();
        for slave in &mut self.slaves {
            slave.config = None;
            slave.requested = AlState::PreOp;
            slave.error_flag = false;
            slave.startup = None;
            slave.transfer = None;
            slave.force_config = self.phase == Phase::Active || slave.force_config;
            slave.due = now;
        }
        for sdo in &mut self.blocking {
            sdo.taken = false;
        }
        if self.phase == Phase::Active {
            self.phase = Phase::Reserved;
        }
        self.poll_due = now;
    }

    pub(crate) fn next_due(&self) -> u64 {
        let slaves = self.slaves.iter().map(|slave| slave.due).min().unwrap_or(u64::MAX);
        match self.dictionary_due() {
            Some(due) => slaves.min(due),
            None if self.is_configuring() => slaves,
            None => slaves.min(self.poll_due),
        }
    }

    /// Returns whether a slave is being configured. The master polls no other slave until that has ended.
    fn is_configuring(&self) -> bool {
        self.slaves.iter().any(|slave| slave.startup.is_some())
    }

    /// Returns whether one activity keeps the master from all others: a configuration, or the fetch
    /// of a dictionary.
    fn is_busy(&self) -> bool {
        self.dictionary.is_some() || self.is_configuring()
    }

    /// Returns whether the master's thread does not run between the last receive and a send now.
    fn lacks_gap(&self, now: u64) -> bool {
        self.behaviour.needs_gap && now.saturating_sub(self.received_at) < THREAD_GAP_NS
    }

    /// Counts a send in the operation phase; returns whether the state machines advance with it.
    pub(crate) fn advances_with_send(&mut self, now: u64) -> bool {
        self.send_interval_ns = now.saturating_sub(self.sent_at);
        self.sent_at = now;
        let advances = !self.lacks_gap(now) || self.has_half_step;
        self.has_half_step = !advances;
        self.steps = self.steps.wrapping_add(u64::from(advances));
        advances
    }

    pub(crate) fn step(&mut self, world: &mut World) {
        let now = world.now_ns();
        self.advance_dictionary(world);
        if self.poll_due <= now && !self.is_busy() {
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

    fn begin_transfer(&self, now: u64) -> MailboxTransfer {
        MailboxTransfer::begin(now, self.steps)
    }

    fn idle_step_ns(&self) -> u64 {
        u64::from(self.behaviour.idle_step_us) * 1_000
    }

    fn pace(&self) -> Pace {
        match self.phase {
            Phase::Active => Pace::Sends(self.steps),
            Phase::Idle | Phase::Reserved => Pace::Timed(self.idle_step_ns()),
        }
    }

    pub(crate) fn config(&mut self, index: usize) -> Result<&mut SlaveConfig, i32> {
        self.configs.get_mut(index).ok_or(libc::ENOENT)
    }

    pub(crate) fn domain(&mut self, index: usize) -> Result<&mut Domain, i32> {
        self.domains.get_mut(index).ok_or(libc::ENOENT)
    }

    /// Lets the slave of a configuration choose its next transfer.
    fn wake(&mut self, config: usize, now: u64) {
        let slave = self.configs.get(config).and_then(|config| config.slave);
        if let Some(slave) = slave.and_then(|slave| self.slaves.get_mut(slave)) {
            slave.due = slave.due.min(now);
        }
    }

    pub(crate) fn attached(&self, slave: usize) -> Option<&SlaveConfig> {
        self.configs.get(self.slaves.get(slave)?.config?)
    }

    pub(crate) fn slave_config(
        &mut self,
        alias: u16,
        position: u16,
        vendor_id: u32,
        product_code: u32,
    ) -> Result<usize, i32> {
        let known = self
            .configs
            .iter()
            .position(|config| config.alias == alias && config.position == position);
        if let Some(index) = known {
            let same = self.configs.get(index).is_some_and(|config| {
                config.vendor_id == vendor_id && config.product_code == product_code
            });
            return if same { Ok(index) } else { Err(libc::ENOENT) };
        }
        let index = self.configs.len();
        let identity =
            SlaveConfig { alias, position, vendor_id, product_code, ..Default::default() };
        self.configs.push(identity);
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
