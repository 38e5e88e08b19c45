//! Distributed clocks: setting and correcting the clocks of the slaves.

use super::MasterModel;
use crate::ecrt::datagram::Queued;
use crate::ecrt::timing::TICK_NS;
use crate::fault::LossDirection;
use crate::world::{Slot, World};

/// Tolerated difference of system time to the application time.
const TOLERANCE_NS: u64 = 1_000_000;

impl MasterModel {
    /// The reference clock: the slave selected by the application, or the first one with a clock. It is
    /// unknown during a scan.
    pub(crate) fn reference_clock(&self) -> Option<Slot> {
        if self.scan.is_some() {
            return None;
        }
        let mut clocks = self.slaves.iter().filter(|slave| slave.description.has_clock);
        let slave = match self.clocks.selected {
            Some(config) => self.slaves.get(self.configs.get(config)?.slave?),
            None => clocks.next(),
        };
        slave.map(|slave| slave.slot)
    }

    /// Writes the application time to each slave whose time differs.
    pub(crate) fn set_clocks(&mut self, world: &mut World) {
        let now = world.now_ns();
        let passed = now.saturating_sub(self.clocks.set_at_ns);
        let time = self.clocks.app_time.saturating_add(passed + self.offset_error_ns(now));
        for slave in &self.slaves {
            world.with_gateway_in(slave.slot, |gateway, now| {
                let own = gateway.dc_system_time(now);
                if own.is_none_or(|own| own.abs_diff(time) > TOLERANCE_NS) {
                    gateway.write_dc_system_time(now, time);
                }
            });
        }
        self.clocks.are_set = true;
    }

    /// Error of the written time. IgH adds whole ticks for the time since it read the slave's clock;
    /// without a gap between receive and send it has read it one interval ago.
    fn offset_error_ns(&self, now: u64) -> u64 {
        if self.lacks_gap(now) { self.send_interval_ns % TICK_NS } else { 0 }
    }

    /// Effect of a clock datagram on the slaves.
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
        let reached = self.reference_clock().filter(|slot| world.reaches(*slot));
        let Some(reference) = reached else {
            if item == Queued::SlaveClocks {
                // it returns unchanged
                self.clocks.reference_value = 0;
            }
            return;
        };
        let time =
            world.line().gateway_in(reference).and_then(|gateway| gateway.dc_system_time(now));
        match item {
            Queued::ReferenceClock => {
                let target = self.clocks.reference_target;
                world.with_gateway_in(reference, |gateway, now| {
                    gateway.correct_dc_system_time(now, target)
                });
            }
            Queued::SlaveClocks => {
                let Some(time) = time else { return };
                self.clocks.reference_value = time as u32;
                for slot in self.slaves.iter().map(|slave| slave.slot) {
                    if slot != reference && world.reaches(slot) {
                        world.with_gateway_in(slot, |gateway, now| {
                            gateway.correct_dc_system_time(now, time)
                        });
                    }
                }
            }
            Queued::ClockMonitor => {
                let slots = self.slaves.iter().map(|slave| slave.slot);
                let reached = slots.filter(|slot| world.reaches(*slot));
                let shown = reached.filter_map(|slot| world.line().gateway_in(slot));
                self.clocks.monitor_value =
                    shown.fold(0, |sum, gateway| sum | magnitude(gateway.dc_difference_ns()));
            }
            Queued::Domain { .. } => {}
        }
    }
}

/// Magnitude of a difference in 31 bits, as the slave reports it.
fn magnitude(difference_ns: i64) -> u32 {
    u32::try_from(difference_ns.unsigned_abs()).unwrap_or(u32::MAX) & 0x7FFF_FFFF
}
