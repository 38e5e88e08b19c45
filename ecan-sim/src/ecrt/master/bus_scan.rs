//! Bus polling: responding slaves and their states, and the scan after a change.

use ecan_protocol::device::AlState;

use super::{MasterModel, Phase};
use crate::ecrt::al_status::al_status;
use crate::ecrt::slave_view::SlaveView;
use crate::ecrt::startup_state::Startup;
use crate::ecrt::timing::{ACTIVE_POLL_NS, IDLE_POLL_NS, SCAN_BASE_NS, SCAN_SLAVE_NS};
use crate::world::World;

#[derive(Debug)]
pub(crate) struct Scan {
    /// Gateways that responded at its begin.
    pub(crate) slots: Vec<usize>,
    at: usize,
    prepared: bool,
}

impl MasterModel {
    pub(crate) fn run_bus(&mut self, world: &mut World) {
        match self.scan.take() {
            Some(scan) => self.scan_step(scan, world),
            None => self.poll(world),
        }
    }

    fn poll(&mut self, world: &mut World) {
        let now = world.now_ns();
        let active = self.phase == Phase::Active;
        self.poll_due = now + if active { ACTIVE_POLL_NS } else { IDLE_POLL_NS };
        let (mut responding, mut states) = (0, 0);
        if world.link_is_up() {
            for slot in (0..world.gateway_count()).filter(|slot| world.is_reachable(*slot)) {
                responding += 1;
                states |= al_status(world, slot) & 0x0F;
            }
        }
        (self.responding, self.al_states) = (responding, states);
        let changed = self.rescan_required
            || responding as usize != self.slaves.len()
            || self.slaves.iter().any(|slave| !slave.is_present(world));
        // between reservation and activation the slave list does not change
        if changed && self.phase != Phase::Reserved {
            self.begin_scan(world);
            return;
        }
        if active && !self.clocks.are_set {
            self.set_clocks(world);
        }
        self.poll_from(0, world);
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
            self.rescan_required = true;
            let may_scan = self.phase != Phase::Reserved;
            if may_scan {
                self.poll_due = now;
            }
            return may_scan;
        }
        slave.current = al_status(world, slave.slot);
        let differs = slave.current != slave.requested.raw() || slave.force_config;
        if !differs || slave.error_flag {
            return false;
        }
        slave.startup = Some(Startup::BEGIN);
        // a running transfer ends first
        if slave.transfer.is_none() {
            slave.due = now;
        }
        true
    }

    fn begin_scan(&mut self, world: &World) {
        self.fail_transfers();
        self.slaves.clear();
        self.clocks.are_set = false;
        self.rescan_required = false;
        for config in &mut self.configs {
            config.slave = None;
        }
        let slots: Vec<_> = if world.link_is_up() {
            (0..world.gateway_count()).filter(|slot| world.is_reachable(*slot)).collect()
        } else {
            Vec::new()
        };
        self.scan = Some(Scan { slots, at: 0, prepared: false });
        self.poll_due = world.now_ns() + SCAN_BASE_NS;
    }

    fn scan_step(&mut self, mut scan: Scan, world: &mut World) {
        let now = world.now_ns();
        let Some(slot) = scan.slots.get(scan.at).copied() else {
            self.poll_due = now;
            for config in 0..self.configs.len() {
                self.attach_config(config);
            }
            return;
        };
        if scan.prepared {
            if world.is_reachable(slot) {
                self.slaves.extend(SlaveView::scanned(world, slot));
            }
            scan.at += 1;
            scan.prepared = false;
            self.poll_due = now;
        } else {
            if al_status(world, slot) & 0x0F == AlState::Init.raw() {
                world.with_gateway(slot, |gateway, now| {
                    gateway.set_up_mailboxes();
                    gateway.request_al_state(now, AlState::PreOp);
                });
            }
            scan.prepared = true;
            self.poll_due = now + SCAN_SLAVE_NS;
        }
        self.scan = Some(scan);
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
        if slave.config.is_some() || !config.fits(&slave.spec) {
            return;
        }
        slave.config = Some(index);
        // requests of the configuration may be waiting
        if slave.is_idle() {
            slave.due = 0;
        }
        config.slave = Some(position);
        if self.phase == Phase::Active {
            slave.requested = AlState::Op;
        }
    }
}

/// Position of a slave by alias and distance; alias 0 counts from the master.
pub(crate) fn find_slave(slaves: &[SlaveView], alias: u16, distance: u16) -> Option<usize> {
    let from =
        if alias == 0 { 0 } else { slaves.iter().position(|slave| slave.spec.alias == alias)? };
    let position = from + usize::from(distance);
    (position < slaves.len()).then_some(position)
}
