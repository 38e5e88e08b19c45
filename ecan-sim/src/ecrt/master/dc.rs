//! Distributed clocks: the application's time and what the slaves' clocks make of it.

use super::MasterModel;
use crate::ecrt::datagram::Queued;
use crate::fault::LossDirection;
use crate::world::World;

/// System time this near to the application's is left as it is.
const TOLERANCE_NS: u64 = 1_000_000;

impl MasterModel {
    /// The reference clock: the slave that the application has chosen, or the first; every gateway
    /// can be it. It is forgotten with the list of slaves and found again when a scan has ended.
    pub(crate) fn reference_clock(&self) -> Option<usize> {
        if self.scan.is_some() {
            return None;
        }
        let position = match self.clocks.selected {
            Some(config) => self.configs.get(config)?.slave?,
            None => 0,
        };
        self.slaves.get(position).map(|slave| slave.slot)
    }

    /// Gives every slave the application's time, where its own is not near it.
    pub(crate) fn set_clocks(&mut self, world: &mut World) {
        let now = world.now_ns();
        let time = self.clocks.app_time.saturating_add(now.saturating_sub(self.clocks.set_at_ns));
        for slave in &self.slaves {
            world.with_gateway(slave.slot, |gateway, now| {
                let own = gateway.dc_system_time(now);
                if own.is_none_or(|own| own.abs_diff(time) > TOLERANCE_NS) {
                    gateway.write_dc_system_time(now, time);
                }
            });
        }
        self.clocks.are_set = true;
    }

    /// What a datagram of the clocks does on its way past the slaves.
    pub(crate) fn exchange_clock(
        &mut self,
        item: Queued,
        world: &mut World,
        lost: Option<LossDirection>,
    ) {
        let now = world.now_ns();
        if lost == Some(LossDirection::Outward) {
            return;
        }
        let reached = self.reference_clock().filter(|slot| world.is_reachable(*slot));
        let Some(reference) = reached else {
            if item == Queued::SlaveClocks {
                // It comes back as it went.
                self.clocks.reference_value = 0;
            }
            return;
        };
        let time = world.gateway(reference).and_then(|gateway| gateway.dc_system_time(now));
        match item {
            Queued::ReferenceClock => {
                let target = self.clocks.reference_target;
                world.with_gateway(reference, |gateway, now| {
                    gateway.correct_dc_system_time(now, target)
                });
            }
            Queued::SlaveClocks => {
                let Some(time) = time else { return };
                self.clocks.reference_value = time as u32;
                for slot in self.slaves.iter().map(|slave| slave.slot) {
                    if slot != reference && world.is_reachable(slot) {
                        world.with_gateway(slot, |gateway, now| {
                            gateway.correct_dc_system_time(now, time)
                        });
                    }
                }
            }
            Queued::ClockMonitor => {
                let slots = self.slaves.iter().map(|slave| slave.slot);
                let reached = slots.filter(|slot| world.is_reachable(*slot));
                let shown = reached.filter_map(|slot| world.gateway(slot));
                self.clocks.monitor_value =
                    shown.fold(0, |sum, gateway| sum | magnitude(gateway.dc_difference_ns()));
            }
            Queued::Domain { .. } => {}
        }
    }
}

/// The 31 bits of a difference without its sign, as the slave shows it.
fn magnitude(difference_ns: i64) -> u32 {
    u32::try_from(difference_ns.unsigned_abs()).unwrap_or(u32::MAX) & 0x7FFF_FFFF
}
