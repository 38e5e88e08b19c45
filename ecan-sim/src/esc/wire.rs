//! A line of slave controllers through which Ethernet frames pass.

use super::Context;
use super::controller::SlaveController;
use super::frame::{FrameFault, for_each_datagram, mark_as_processed};
use crate::backend_error::BackendError;
use crate::fault::{CycleFaults, LossDirection};
use crate::node::BridgeFactory;
use crate::scenario::{Scenario, Topology};
use crate::world::World;

/// Time that a frame takes from one slave to the next, ns: processing and cable.
const HOP_NS: u64 = 600;

/// Counters of a [`Wire`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireStatistics {
    /// EtherCAT frames.
    pub frames: u64,
    /// Invalid frames: processed up to the fault, and returned.
    pub faulty: u64,
    /// Frames of other protocols: dropped, as slave controllers do.
    pub foreign: u64,
    /// Frames that did not return: a fault of the scenario, or no slave.
    pub lost: u64,
}

/// Gateways on an Ethernet wire, for any EtherCAT master: frames go in and return as the last slave
/// of the line has left them.
///
/// The world is that of the simulated libethercat: the same firmware, buses, nodes and faults. The
/// caller passes the time, in simulated nanoseconds; it must not run backwards or before the
/// creation of the `Wire`, when the gateways boot.
pub struct Wire {
    world: World,
    controllers: Vec<SlaveController>,
    reached: Vec<usize>,
    /// Lowest logical address so far, and the faults of the present cycle.
    lowest_logical: u32,
    faults: CycleFaults,
    statistics: WireStatistics,
}

impl Wire {
    /// Builds the world of a scenario at `now`, with the gateways switched on; they respond after
    /// their boot.
    ///
    /// # Errors
    /// A recording or an EDS cannot be read; the scenario has a bridge or an I/O slave.
    pub fn new(scenario: &Scenario, now: u64) -> Result<Self, BackendError> {
        Self::with_bridges(scenario, now, None)
    }

    /// As [`new`](Self::new), for a scenario that may have bridges.
    ///
    /// # Errors
    /// A recording or an EDS cannot be read, a bridge cannot be made, or the scenario has an I/O slave.
    pub fn with_bridges(
        scenario: &Scenario,
        now: u64,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        if let Some(io) = scenario.ios.first() {
            return Err(BackendError::IoOnWire(io.name.clone()));
        }
        let mut world = World::new(scenario, now, bridges)?;
        world.begin(&scenario.faults);
        let controllers = (0..world.gateway_count()).map(|_| SlaveController::new()).collect();
        Ok(Self {
            world,
            controllers,
            reached: Vec::new(),
            lowest_logical: u32::MAX,
            faults: CycleFaults::default(),
            statistics: WireStatistics::default(),
        })
    }

    /// A copy of the line in its present state, without the observer of faults; `None` if a node of
    /// the scenario cannot be copied, for example a bridge.
    ///
    /// A copy is much cheaper than a line that a master brings to OP again.
    pub fn try_clone(&self) -> Option<Self> {
        Some(Self {
            world: self.world.try_clone()?,
            controllers: self.controllers.clone(),
            reached: self.reached.clone(),
            ..*self
        })
    }

    /// The simulated world.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The simulated world, for faults and tests.
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// What has come by so far.
    pub fn statistics(&self) -> WireStatistics {
        self.statistics
    }

    /// Advances time without a frame.
    pub fn advance(&mut self, now: u64) {
        self.world.advance(now);
    }

    /// Time of the next event without a frame, if any; [`advance`](Self::advance) is not needed
    /// before it.
    pub fn next_event(&self) -> Option<u64> {
        Some(self.world.next_event()).filter(|at| *at < u64::MAX)
    }

    /// Passes an Ethernet frame, without its checksum, down the line at `now`; returns whether it
    /// returns. Its bytes are then those that the master receives.
    pub fn pass(&mut self, now: u64, frame: &mut [u8]) -> bool {
        self.world.advance(now);
        let mut first_logical = None;
        let checked = for_each_datagram(frame, |datagram| {
            if datagram.is_logical() {
                let address = datagram.logical_address();
                first_logical =
                    Some(first_logical.map_or(address, |first: u32| first.min(address)));
            }
        });
        match checked {
            Ok(()) => {}
            Err(FrameFault::NotEtherCat) => {
                self.statistics.foreign += 1;
                return false;
            }
            Err(_) => self.statistics.faulty += 1,
        }
        self.statistics.frames += 1;
        let faults =
            first_logical.map_or_else(CycleFaults::default, |address| self.faults_of(address));
        self.find_reached();
        if faults.lost == Some(LossDirection::Outward) || self.reached.is_empty() {
            self.statistics.lost += 1;
            return false;
        }
        let hops = self.reached.len() as u64 - 1;
        for (position, index) in (0..).zip(&self.reached) {
            let Some(controller) = self.controllers.get_mut(*index) else { continue };
            let return_ns = (position < hops).then(|| 2 * (hops - position) * HOP_NS);
            self.world.with_gateway(*index, |gateway, now| {
                let delay_ns = position * HOP_NS;
                controller.pass(frame, &mut Context { gateway, now, delay_ns, return_ns });
            });
        }
        if faults.counter_offset != 0 {
            let shift = |mut datagram: super::frame::Datagram<'_>| {
                if datagram.is_logical() {
                    datagram.shift_counter(faults.counter_offset);
                }
            };
            // faults were counted above
            let _ = for_each_datagram(frame, shift);
        }
        mark_as_processed(frame);
        if faults.lost == Some(LossDirection::Return) {
            self.statistics.lost += 1;
            return false;
        }
        true
    }

    /// Faults of a frame with process data. A cycle may have several frames: it begins with the
    /// lowest logical address, and all its frames have the same faults.
    fn faults_of(&mut self, address: u32) -> CycleFaults {
        if address <= self.lowest_logical {
            self.lowest_logical = address;
            self.faults = self.world.begin_cycle();
        }
        self.faults
    }

    fn find_reached(&mut self) {
        self.reached.clear();
        if !self.world.link_is_up() {
            return;
        }
        for index in 0..self.world.gateway_count() {
            if self.world.is_reachable(index) {
                self.reached.push(index);
            } else if self.world.line().topology() == Topology::Line {
                break;
            }
        }
    }
}
