//! I/O slaves on the line, between the gateways.

use crate::io_slave::IoSlave;
use crate::scenario::IoSpec;
use crate::world::World;
use crate::world::fmmu::Fmmu;

#[derive(Clone)]
pub(super) struct IoSlot {
    pub(super) slave: IoSlave,
    pub(super) fmmus: Vec<Fmmu>,
    /// Number of supply losses: a station address does not survive one.
    pub(super) generation: u32,
}

impl IoSlot {
    pub(super) fn new(spec: IoSpec, now: u64) -> Self {
        let mut slave = IoSlave::new(spec);
        slave.power(Some(now));
        Self { slave, fmmus: Vec::new(), generation: 0 }
    }
}

impl World {
    /// Number of I/O slaves.
    pub fn io_count(&self) -> usize {
        self.ios.len()
    }

    /// An I/O slave by its index in the scenario.
    pub fn io(&self, index: usize) -> Option<&IoSlave> {
        self.ios.get(index).map(|slot| &slot.slave)
    }

    /// Changes an I/O slave.
    pub fn io_mut(&mut self, index: usize) -> Option<&mut IoSlave> {
        self.ios.get_mut(index).map(|slot| &mut slot.slave)
    }

    /// Returns whether the I/O slave exists.
    pub(super) fn switch_io_off(&mut self, index: usize, on_at: u64) -> bool {
        let Some(slot) = self.ios.get_mut(index) else { return false };
        slot.slave.power(Some(on_at));
        slot.fmmus.clear();
        slot.generation = slot.generation.wrapping_add(1);
        true
    }
}
