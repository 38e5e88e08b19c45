//! The check of a configuration before anything touches the bus: every fault, not the first.

use ecan_protocol::mapping::MAX_MULTIPLIER;
use thiserror::Error;

use crate::config::{AdapterConfig, MAX_WATCHDOG_US, SlaveConfig, WATCHDOG_UNIT_US};
use crate::faults::Faults;
use crate::plan::{Plan, PlanError};

/// Shortest cycle that is accepted, in nanoseconds.
const MIN_CYCLE_NS: u32 = 100_000;
/// Longest cycle that is accepted, in nanoseconds.
const MAX_CYCLE_NS: u32 = 100_000_000;

/// One thing that is wrong with an [`AdapterConfig`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConfigFault {
    /// The configuration names no slave.
    #[error("no slave is configured")]
    NoSlaves,
    /// Two entries name the same place on the bus.
    #[error("slaves {first} and {second} are the same: alias {alias}, position {position}")]
    SamePlace {
        /// Index of the first entry.
        first: usize,
        /// Index of the second entry.
        second: usize,
        /// Their alias.
        alias: u16,
        /// Their position.
        position: u16,
    },
    /// N outside the gateway's range.
    #[error("slave {slave}: {pdo} size N = {multiplier} is outside 1..{MAX_MULTIPLIER}")]
    Multiplier {
        /// Slave index.
        slave: usize,
        /// "RxPDO" or "TxPDO".
        pdo: &'static str,
        /// The N asked for.
        multiplier: u8,
    },
    /// Cycle outside what a slave and the master can hold.
    #[error(
        "cycle of {} us is outside {}..{} us",
        cycle_ns / 1000, MIN_CYCLE_NS / 1000, MAX_CYCLE_NS / 1000
    )]
    Cycle {
        /// The cycle asked for, in nanoseconds.
        cycle_ns: u32,
    },
    /// A watchdog that the register cannot hold.
    #[error(
        "watchdog of {watchdog_us} us is no multiple of {WATCHDOG_UNIT_US} us up to \
         {MAX_WATCHDOG_US} us"
    )]
    WatchdogTime {
        /// The watchdog asked for, in microseconds.
        watchdog_us: u32,
    },
    /// The [`Plan`] finds that it would not work on the wire.
    #[error(transparent)]
    Plan(PlanError),
    /// Sync0 period that is no multiple of the cycle.
    #[error(
        "Sync0 period of {} us is not a whole multiple of the cycle of {} us",
        sync0_ns / 1000, cycle_ns / 1000
    )]
    Sync0Cycle {
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
        /// The cycle, in nanoseconds.
        cycle_ns: u32,
    },
    /// Sync0 shift at or beyond its period.
    #[error(
        "Sync0 shift of {} us is not below its period of {} us", shift_ns / 1000, sync0_ns / 1000
    )]
    Sync0Shift {
        /// The shift, in nanoseconds.
        shift_ns: u32,
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
    /// A reference clock that is no slave of the configuration.
    #[error("reference clock: slave index {reference} is not below {slaves}, the number of slaves")]
    ReferenceClock {
        /// The index asked for.
        reference: usize,
        /// Number of slaves.
        slaves: usize,
    },
    /// A fixed identity with an empty half.
    #[error("slave {slave}: identity needs both a vendor id and a product code, neither 0")]
    Identity {
        /// Slave index.
        slave: usize,
    },
    /// A startup step that writes what the Adapter itself manages.
    #[error(
        "slave {slave}: startup step {step} writes the PDO assignment 0x{index:04X}, which the \
         Adapter writes itself from N"
    )]
    StartupAssignment {
        /// Slave index.
        slave: usize,
        /// Index of the step.
        step: usize,
        /// 0x1C12 or 0x1C13.
        index: u16,
    },
}

impl AdapterConfig {
    /// Checks the whole configuration without touching the bus.
    ///
    /// # Errors
    /// Every fault found.
    pub fn check(&self) -> Result<(), Faults<ConfigFault>> {
        let mut faults = Vec::new();
        if self.slaves.is_empty() {
            faults.push(ConfigFault::NoSlaves);
        }
        for (index, slave) in self.slaves.iter().enumerate() {
            self.check_slave(index, slave, &mut faults);
        }
        self.check_cycle(&mut faults);
        self.check_plan(&mut faults);
        Faults::check(faults)
    }

    fn check_slave(&self, index: usize, slave: &SlaveConfig, faults: &mut Vec<ConfigFault>) {
        let earlier = self.slaves.iter().take(index).enumerate();
        for (first, other) in earlier {
            if (other.alias, other.position) == (slave.alias, slave.position) {
                faults.push(ConfigFault::SamePlace {
                    first,
                    second: index,
                    alias: slave.alias,
                    position: slave.position,
                });
            }
        }
        for (pdo, multiplier) in [("RxPDO", slave.rx_multiplier), ("TxPDO", slave.tx_multiplier)] {
            if multiplier == 0 || multiplier > MAX_MULTIPLIER {
                faults.push(ConfigFault::Multiplier { slave: index, pdo, multiplier });
            }
        }
        if slave.identity.is_some_and(|id| id.vendor_id == 0 || id.product_code == 0) {
            faults.push(ConfigFault::Identity { slave: index });
        }
        for (step, startup) in slave.base_startup.iter().chain(&slave.startup).enumerate() {
            let object = startup.object().0;
            if startup.is_download() && (object == 0x1C12 || object == 0x1C13) {
                faults.push(ConfigFault::StartupAssignment { slave: index, step, index: object });
            }
        }
    }

    fn check_cycle(&self, faults: &mut Vec<ConfigFault>) {
        let watchdog_us = self.watchdog_us;
        if !watchdog_us.is_multiple_of(WATCHDOG_UNIT_US)
            || !(WATCHDOG_UNIT_US..=MAX_WATCHDOG_US).contains(&watchdog_us)
        {
            faults.push(ConfigFault::WatchdogTime { watchdog_us });
        }
        if !(MIN_CYCLE_NS..=MAX_CYCLE_NS).contains(&self.cycle_ns) {
            faults.push(ConfigFault::Cycle { cycle_ns: self.cycle_ns });
            return;
        }
        if let Some(dc) = self.dc {
            if dc.cycle_ns == 0 || dc.cycle_ns % self.cycle_ns != 0 {
                faults.push(ConfigFault::Sync0Cycle {
                    sync0_ns: dc.cycle_ns,
                    cycle_ns: self.cycle_ns,
                });
            }
            if dc.shift_ns >= dc.cycle_ns {
                faults
                    .push(ConfigFault::Sync0Shift { shift_ns: dc.shift_ns, sync0_ns: dc.cycle_ns });
            }
            let slaves = self.slaves.len();
            if let Some(reference) = dc.reference.filter(|reference| *reference >= slaves) {
                faults.push(ConfigFault::ReferenceClock { reference, slaves });
            }
        }
    }

    /// What the plan refuses, as far as it is not the consequence of a fault found before.
    fn check_plan(&self, faults: &mut Vec<ConfigFault>) {
        let is_real_size = |multiplier| (1..=MAX_MULTIPLIER).contains(&multiplier);
        let has_cycle = (MIN_CYCLE_NS..=MAX_CYCLE_NS).contains(&self.cycle_ns);
        let is_watchdog = |fault: &ConfigFault| matches!(fault, ConfigFault::WatchdogTime { .. });
        let has_watchdog = !faults.iter().any(is_watchdog);
        let counts = |refusal: &PlanError| match refusal {
            PlanError::LargePdo { multiplier, .. } => is_real_size(*multiplier),
            PlanError::Watchdog { .. } => has_cycle && has_watchdog,
            _ => has_cycle,
        };
        faults.extend(Plan::of(self).refusals.into_iter().filter(counts).map(ConfigFault::Plan));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DcSync;

    #[test]
    fn the_default_is_sound() {
        assert_eq!(AdapterConfig::new(1).check(), Ok(()));
        assert_eq!(AdapterConfig::new(3).with_multiplier(11).check(), Ok(()));
    }

    #[test]
    fn every_fault_is_reported() {
        let mut config = AdapterConfig::new(3).with_cycle_us(1_000);
        config.slaves[0].rx_multiplier = 0;
        config.slaves[1].tx_multiplier = 12;
        config.slaves[2].position = 1;
        config.dc = Some(DcSync { reference: Some(3), ..DcSync::new(1_500_000, 1_500_000) });
        let faults = config.check().unwrap_err().0;
        assert_eq!(faults.len(), 6, "{faults:?}");
    }

    #[test]
    fn twelve_chunks_are_refused_with_the_reason_and_allowed_by_permission() {
        let mut config = AdapterConfig::new(1).with_multiplier(12);
        let text = config.check().unwrap_err().to_string();
        assert!(text.contains("1536 bytes") && text.contains("1486"), "{text}");
        config.allow_large_pdos = true;
        assert_eq!(config.check(), Ok(()));
    }

    #[test]
    fn process_data_must_leave_room_for_the_mailbox() {
        let refused = |slaves, multiplier, cycle_us| {
            let config =
                AdapterConfig::new(slaves).with_multiplier(multiplier).with_cycle_us(cycle_us);
            config.check().unwrap_err().0
        };
        assert!(matches!(
            refused(3, 11, 500).as_slice(),
            [ConfigFault::Plan(PlanError::WireTime { wire_ns: 700_800, cycle_ns: 500_000 })]
        ));
        assert!(matches!(
            refused(3, 11, 800).as_slice(),
            [ConfigFault::Plan(PlanError::MailboxStarved { needed: 9_068, available: 9_000, .. })]
        ));
    }

    #[test]
    fn a_watchdog_is_told_in_its_unit_and_outlasts_the_cycle() {
        let faults = |cycle_us, watchdog_us| {
            let config = AdapterConfig::new(1).with_cycle_us(cycle_us);
            AdapterConfig { watchdog_us, ..config }.check().err().map_or(Vec::new(), |it| it.0)
        };
        assert_eq!(faults(1_000, 2_000), []);
        assert_eq!(faults(1_000, 6_553_500), []);
        for watchdog_us in [0, 2_050, 6_553_600] {
            let expected = [ConfigFault::WatchdogTime { watchdog_us }];
            assert_eq!(faults(1_000, watchdog_us), expected);
            assert_eq!(faults(0, watchdog_us).len(), 2);
        }
        let refused = |watchdog_us, cycle_ns| {
            vec![ConfigFault::Plan(PlanError::Watchdog { watchdog_us, cycle_ns })]
        };
        assert_eq!(faults(1_000, 1_000), refused(1_000, 1_000_000));
        assert_eq!(faults(100_000, 100_000), refused(100_000, 100_000_000));
        assert_eq!(faults(100_000, 200_000), []);
    }

    #[test]
    fn a_fault_is_not_reported_by_its_consequences() {
        let mut config = AdapterConfig::new(1).with_cycle_us(0);
        config.slaves[0].rx_multiplier = 200;
        let faults = config.check().unwrap_err().0;
        assert!(
            matches!(
                faults.as_slice(),
                [ConfigFault::Multiplier { multiplier: 200, .. }, ConfigFault::Cycle { .. }]
            ),
            "{faults:?}"
        );
    }
}
