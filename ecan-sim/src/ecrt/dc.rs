//! Distributed clocks: the application's time and what the slaves' clocks make of it.

use crate::ecrt::master::MasterModel;
use crate::ecrt::slave_config::DcConfig;
use crate::ecrt::timing::SYNC0_AHEAD_NS;
use crate::ecrt::transport::Queued;
use crate::fault::LossDirection;
use crate::gateway::Sync0;
use crate::world::World;

/// AssignActivate bit that switches Sync0 on.
const SYNC0_ACTIVE: u16 = 0x0200;
/// System time this near to the application's is left as it is.
const TOLERANCE_NS: u64 = 1_000_000;

/// State of a datagram of the clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ClockDatagram {
    #[default]
    Idle,
    Queued,
    Sent {
        at_ns: u64,
        arrives_ns: Option<u64>,
    },
    Received,
    Lost,
}

/// What the master knows of the clocks of the bus.
#[derive(Debug, Default)]
pub(crate) struct Clocks {
    /// Last application time.
    pub(crate) app_time: u64,
    /// When it was told, in simulated time.
    told_ns: u64,
    /// First application time: Sync0 keeps its phase to it.
    pub(crate) reference_time: u64,
    /// Whether the slaves have got their time since the master was activated or scanned them.
    pub(crate) are_set: bool,
    /// Configuration of the slave that the application has chosen as reference clock.
    pub(crate) selected: Option<usize>,
    /// Time to write into the reference clock.
    pub(crate) reference_target: u64,
    pub(crate) reference: ClockDatagram,
    pub(crate) slaves: ClockDatagram,
    pub(crate) monitor: ClockDatagram,
    /// What the datagram for the slaves brought back: lower half of the reference clock.
    pub(crate) reference_value: u32,
    /// What the monitor's datagram brought back: the slaves' differences, combined bit by bit.
    pub(crate) monitor_value: u32,
}

impl Clocks {
    pub(crate) fn application_time(&mut self, time: u64, now: u64) {
        self.app_time = time;
        self.told_ns = now;
        if self.reference_time == 0 {
            self.reference_time = time;
        }
    }

    /// Sync0 of a slave that is started now.
    pub(crate) fn sync0(&self, dc: &DcConfig) -> Option<Sync0> {
        if dc.assign_activate & SYNC0_ACTIVE == 0 {
            return None;
        }
        let cycle = u64::from(dc.sync0_cycle) + u64::from(dc.sync1_cycle);
        let mut start_ns = self.app_time.wrapping_add(SYNC0_AHEAD_NS);
        if cycle > 0 && self.reference_time != 0 {
            start_ns += cycle - start_ns.wrapping_sub(self.reference_time) % cycle;
        }
        Some(Sync0 { start_ns, cycle_ns: dc.sync0_cycle, shift_ns: dc.sync0_shift })
    }
}

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
        let time = self.clocks.app_time.saturating_add(now.saturating_sub(self.clocks.told_ns));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sync0_keeps_its_phase_to_the_first_application_time() {
        let mut clocks = Clocks::default();
        clocks.application_time(5_000_000_300, 1_000_000_000);
        clocks.application_time(5_007_000_300, 1_007_000_000);
        let dc = DcConfig {
            assign_activate: 0x0300,
            sync0_cycle: 1_000_000,
            sync0_shift: 250_000,
            sync1_cycle: 0,
        };
        let sync0 = clocks.sync0(&dc).unwrap();
        assert_eq!(sync0.shift_ns, 250_000);
        assert_eq!((sync0.start_ns - 5_000_000_300) % 1_000_000, 0);
        assert!(sync0.start_ns > 5_007_000_000 + SYNC0_AHEAD_NS - 1);
        assert!(clocks.sync0(&DcConfig { assign_activate: 0, ..dc }).is_none());
    }
}
