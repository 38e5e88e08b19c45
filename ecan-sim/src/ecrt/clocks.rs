//! Distributed clocks of the bus: the application's time, the clock datagrams, and the times of the slaves.

use super::domain::{DatagramState, Queued};
use super::slaves::{Configs, DcConfig, SlaveView};
use super::timing::SYNC0_AHEAD_NS;
use crate::fault::LossDirection;
use crate::gateway::Sync0;
use crate::world::{Slot, World};

/// Tolerated difference of system time to the application time.
const TOLERANCE_NS: u64 = 1_000_000;
/// AssignActivate bit of Sync0.
const SYNC0_ACTIVE: u16 = 0x0200;
const SYNC1_ACTIVE: u16 = 0x0400;

/// Clocks of the bus as the master keeps them.
#[derive(Debug, Default)]
pub(crate) struct Clocks {
    app_time: u64,
    /// Simulated time at which the application time was set.
    set_at_ns: u64,
    /// First application time: Sync0 keeps its phase to it.
    reference_time: u64,
    /// True if the slaves' times were set since activation or scan.
    are_set: bool,
    /// Configuration of the slave that the application has chosen as reference clock.
    selected: Option<usize>,
    /// Time to write into the reference clock.
    reference_target: u64,
    reference: DatagramState,
    slaves: DatagramState,
    monitor: DatagramState,
    /// Result of the datagram for the slaves: lower half of the reference clock.
    reference_value: u32,
    /// Result of the monitor datagram: the slaves' differences, combined by OR.
    monitor_value: u32,
    stderr_lines: u64,
}

impl Clocks {
    pub(crate) fn application_time(&mut self, time: u64, now: u64) {
        self.app_time = time;
        self.set_at_ns = now;
        if self.reference_time == 0 {
            self.reference_time = time;
        }
    }

    pub(crate) fn has_sync1(dc: &DcConfig) -> bool {
        dc.assign_activate & SYNC1_ACTIVE != 0
    }

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

    /// State of a clock datagram.
    pub(crate) fn datagram_state(&mut self, item: Queued) -> Option<&mut DatagramState> {
        match item {
            Queued::ReferenceClock => Some(&mut self.reference),
            Queued::SlaveClocks => Some(&mut self.slaves),
            Queued::ClockMonitor => Some(&mut self.monitor),
            Queued::Domain { .. } => None,
        }
    }

    /// Returns whether the slaves' times were set since activation or scan. Before that no clock datagram is sent.
    pub(crate) fn are_set(&self) -> bool {
        self.are_set
    }

    /// Lets the master set the slaves' times again.
    pub(crate) fn set_again(&mut self) {
        self.are_set = false;
    }

    /// Selects the reference clock by the configuration of its slave; `None` is the first clock.
    pub(crate) fn select_reference(&mut self, config: Option<usize>) {
        self.selected = config;
    }

    /// Sets the time that the next datagram writes into the reference clock; `None` is the application time.
    pub(crate) fn aim_reference(&mut self, target: Option<u64>) {
        self.reference_target = target.unwrap_or(self.app_time);
    }

    pub(crate) fn app_time(&self) -> u64 {
        self.app_time
    }

    /// Returns whether the application has given a time, to which Sync0 keeps its phase.
    pub(crate) fn has_phase(&self) -> bool {
        self.reference_time != 0
    }

    /// Differences of the slaves' clocks; without a result the library writes a line to stderr.
    pub(crate) fn take_monitor_value(&mut self) -> u32 {
        if self.monitor == DatagramState::Received {
            return self.monitor_value;
        }
        self.stderr_lines += 1;
        u32::MAX
    }

    /// Lower half of the reference clock; for each error the library writes a line to stderr.
    pub(crate) fn take_reference_value(&mut self, has_reference: bool) -> Result<u32, i32> {
        let time = match (self.slaves, self.are_set) {
            _ if !has_reference => Err(libc::ENXIO),
            (DatagramState::Received, true) => Ok(self.reference_value),
            (DatagramState::Received, false) => Err(libc::EAGAIN),
            _ => Err(libc::EIO),
        };
        self.stderr_lines += u64::from(time.is_err());
        time
    }

    /// Lines that the calls for the clocks would have written to stderr.
    pub(crate) fn stderr_lines(&self) -> u64 {
        self.stderr_lines
    }

    /// Forgets the clocks of a configuration.
    pub(crate) fn reset(&mut self) {
        *self = Self { stderr_lines: self.stderr_lines, ..Self::default() };
    }

    /// Slave of the reference clock: the one that the application has selected, or the first with a clock.
    pub(crate) fn reference_slave(&self, slaves: &[SlaveView], configs: &Configs) -> Option<Slot> {
        let mut clocks = slaves.iter().filter(|slave| slave.description.has_clock);
        let slave = match self.selected {
            Some(config) => slaves.get(configs.get(config)?.slave?),
            None => clocks.next(),
        };
        slave.map(|slave| slave.slot)
    }

    /// Writes the application time to each slave whose time differs, with an error of the master.
    pub(crate) fn set_times(&mut self, slaves: &[SlaveView], error_ns: u64, world: &mut World) {
        let passed = world.now_ns().saturating_sub(self.set_at_ns);
        let time = self.app_time.saturating_add(passed + error_ns);
        for slave in slaves {
            world.with_gateway_in(slave.slot, |gateway, now| {
                let own = gateway.dc_system_time(now);
                if own.is_none_or(|own| own.abs_diff(time) > TOLERANCE_NS) {
                    gateway.write_dc_system_time(now, time);
                }
            });
        }
        self.are_set = true;
    }

    /// Effect of a clock datagram on the slaves. `reference` is the slave of the reference clock.
    pub(crate) fn exchange(
        &mut self,
        item: Queued,
        reference: Option<Slot>,
        slaves: &[SlaveView],
        world: &mut World,
        lost: Option<LossDirection>,
    ) {
        let now = world.now_ns();
        if lost == Some(LossDirection::Outward) {
            return;
        }
        let Some(reference) = reference.filter(|slot| world.reaches(*slot)) else {
            if item == Queued::SlaveClocks {
                // the datagram returns unchanged
                self.reference_value = 0;
            }
            return;
        };
        let time =
            world.line().gateway_in(reference).and_then(|gateway| gateway.dc_system_time(now));
        match item {
            Queued::ReferenceClock => {
                let target = self.reference_target;
                world.with_gateway_in(reference, |gateway, now| {
                    gateway.correct_dc_system_time(now, target)
                });
            }
            Queued::SlaveClocks => {
                let Some(time) = time else { return };
                self.reference_value = time as u32;
                for slot in slaves.iter().map(|slave| slave.slot) {
                    if slot != reference && world.reaches(slot) {
                        world.with_gateway_in(slot, |gateway, now| {
                            gateway.correct_dc_system_time(now, time)
                        });
                    }
                }
            }
            Queued::ClockMonitor => {
                let slots = slaves.iter().map(|slave| slave.slot);
                let reached = slots.filter(|slot| world.reaches(*slot));
                let shown = reached.filter_map(|slot| world.line().gateway_in(slot));
                self.monitor_value =
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
