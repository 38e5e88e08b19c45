//! Bus polling: responding slaves and their states, and the scan after a change.

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{Direction, UNITS_PER_CHUNK};

use super::MasterModel;
use super::activity::{Phase, Scan, polling_round_ns};
use crate::ecrt::slaves::{AL_ERROR, SlaveView, Startup, al_status, assigned_count, find_slave};
use crate::ecrt::timing::{ACTIVE_POLL_NS, IDLE_POLL_NS, SCAN_BASE_NS, SCAN_SLAVE_NS};
use crate::world::{Slot, World};

/// Registers and SII of a slave.
const SCAN_SII_STEPS: u64 = 220;
/// Its PDO categories: 1728 words, two steps for two words.
const SCAN_SII_PDO_STEPS: u64 = 1728;
/// Request, mailbox check, fetch.
const STEPS_PER_UPLOAD: u64 = 3;

impl MasterModel {
    pub(crate) fn run_bus(&mut self, world: &mut World) {
        match self.scan.scan.take() {
            Some(scan) => self.scan_step(scan, world),
            None => self.poll(world),
        }
    }

    fn poll(&mut self, world: &mut World) {
        let now = world.now_ns();
        let active = self.reservation.phase() == Phase::Active;
        self.scan.poll_due = now
            + match self.behaviour.serves_in_turn {
                true => polling_round_ns(self.slaves.len()),
                false if active => ACTIVE_POLL_NS,
                false => IDLE_POLL_NS,
            };
        let (mut responding, mut states) = (0, 0);
        if world.link_is_up() {
            for slot in world.reached() {
                responding += 1;
                states |= al_status(world, slot) & 0x0F;
            }
        }
        (self.scan.responding, self.scan.al_states) = (responding, states);
        let scans_now = self.reservation.phase() == Phase::Idle
            && std::mem::take(&mut self.scan.scans_when_idle);
        let changed = self.scan.is_required
            || scans_now
            || responding as usize != self.slaves.len()
            || self.slaves.iter().any(|slave| !slave.is_present(world));
        // between reservation and activation the slave list does not change
        if changed && self.reservation.phase() != Phase::Reserved {
            self.begin_scan(world);
            return;
        }
        if active && !self.clocks.are_set() {
            let error_ns = self.pacing.clock_error_ns(now);
            self.clocks.set_times(&self.slaves, error_ns, world);
        }
        self.poll_from(0, world);
        self.dictionary.choose(now, self.pacing.steps(), &mut self.slaves, &self.configs);
    }

    /// Polls the slaves from this one on until one must be configured; polling continues after that
    /// configuration. A slave that does not respond ends the poll with a rescan, even if it is back
    /// by then.
    pub(crate) fn poll_from(&mut self, first: usize, world: &World) {
        for index in first..self.slaves.len() {
            if self.poll_slave(index, world) {
                return;
            }
        }
    }

    /// Reads the state of a slave and starts its configuration if the state differs from the
    /// requested one. Returns whether the poll ends here.
    fn poll_slave(&mut self, index: usize, world: &World) -> bool {
        let now = world.now_ns();
        let Some(slave) = self.slaves.get_mut(index) else { return false };
        if !slave.is_present(world) {
            slave.error_flag = true;
            self.scan.is_required = true;
            let may_scan = self.reservation.phase() != Phase::Reserved;
            if may_scan {
                self.scan.poll_due = now;
            }
            return may_scan;
        }
        slave.current = al_status(world, slave.slot);
        let differs = slave.current != slave.requested.raw() || slave.force_config;
        if !differs || slave.error_flag {
            return false;
        }
        let has_error = slave.current & AL_ERROR != 0;
        slave.startup = Some(Startup::BEGIN);
        // a running transfer ends first
        if slave.transfer.is_none() {
            slave.due = now;
        }
        if has_error {
            let code = AlStatusCode(world.line().al_status_code(slave.slot));
            self.log.push_slave(index, &format!("acknowledged AL status code {code}"));
        }
        true
    }

    fn begin_scan(&mut self, world: &World) {
        let keeps_lost_requests = self.behaviour.keeps_lost_requests;
        self.requests.fail_all(&mut self.slaves, &mut self.configs, keeps_lost_requests);
        self.slaves.clear();
        self.clocks.set_again();
        self.scan.is_required = false;
        for config in self.configs.iter_mut() {
            config.slave = None;
        }
        let slots: Vec<_> = if world.link_is_up() { world.reached().collect() } else { Vec::new() };
        self.scan.scan =
            Some(Scan { slots, at: 0, prepared: false, was_in_init: false, until_step: 0 });
        self.scan.poll_due = world.now_ns() + SCAN_BASE_NS;
    }

    fn scan_step(&mut self, mut scan: Scan, world: &mut World) {
        let now = world.now_ns();
        let Some(slot) = scan.slots.get(scan.at).copied() else {
            self.scan.poll_due = now;
            for config in 0..self.configs.len() {
                self.attach_config(config);
            }
            return;
        };
        let by_steps = self.behaviour.scans_in_steps && self.reservation.phase() == Phase::Active;
        if scan.prepared && by_steps && self.pacing.steps() < scan.until_step {
            self.scan.poll_due = now;
            self.scan.scan = Some(scan);
            return;
        }
        if scan.prepared {
            if world.reaches(slot) {
                let mut scanned = SlaveView::scanned(world, slot);
                if let Some(slave) = &mut scanned {
                    let stays = self.reservation.phase() == Phase::Active && !scan.was_in_init;
                    slave.preop_at = (!stays).then_some(now);
                    slave.has_dictionary =
                        !self.behaviour.fetches_dictionary && slave.description.has_information;
                }
                self.slaves.extend(scanned);
            }
            scan.at += 1;
            scan.prepared = false;
            self.scan.poll_due = now;
        } else {
            scan.was_in_init = al_status(world, slot) & 0x0F == AlState::Init.raw();
            if scan.was_in_init {
                world.with_gateway_in(slot, |gateway, _| gateway.set_up_mailboxes());
                world.request_al_state(slot, AlState::PreOp);
            }
            scan.prepared = true;
            scan.until_step = self.pacing.steps() + scan_steps(world, slot);
            self.scan.poll_due = now + if by_steps { 0 } else { SCAN_SLAVE_NS };
        }
        self.scan.scan = Some(scan);
    }

    /// Attaches one configuration if its slave is present, unconfigured, and has the configured
    /// identity.
    pub(crate) fn attach_config(&mut self, index: usize) {
        let Some(config) = self.configs.get_mut(index) else { return };
        if config.slave.is_some() {
            return;
        }
        let Some(position) = find_slave(&self.slaves, config.alias, config.position) else {
            return;
        };
        let Some(slave) = self.slaves.get_mut(position) else { return };
        if slave.config.is_some() || !config.fits(&slave.description) {
            return;
        }
        slave.config = Some(index);
        // requests of the configuration may be waiting
        if slave.is_idle() {
            slave.due = 0;
        }
        config.slave = Some(position);
        if self.reservation.phase() == Phase::Active {
            slave.requested = AlState::Op;
        }
    }
}

/// Steps of the scan of a slave: its SII, and by SDO the assignment and every assigned PDO.
fn scan_steps(world: &mut World, slot: Slot) -> u64 {
    if let Slot::Io(_) = slot {
        return SCAN_SII_STEPS;
    }
    let chunks: u64 = [Direction::RxPdo, Direction::TxPdo]
        .into_iter()
        .map(|direction| u64::from(assigned_count(world, slot, direction)))
        .sum();
    // a count per direction; of each PDO its index, its count and its entries
    let uploads = 2 + chunks * (2 + UNITS_PER_CHUNK as u64);
    let has_pdos = world.line().describe(slot).is_some_and(|slave| slave.sii_pdos);
    let sii = SCAN_SII_STEPS + if has_pdos { SCAN_SII_PDO_STEPS } else { 0 };
    sii + uploads * STEPS_PER_UPLOAD
}
