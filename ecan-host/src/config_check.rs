//! Check of a configuration before anything touches the bus. It reports every fault.

use std::time::Duration;

use ecan_protocol::mapping::MAX_MULTIPLIER;
use thiserror::Error;

use crate::config::{AdapterConfig, Faults, MAX_WATCHDOG, SlaveConfig, WATCHDOG_UNIT};
use crate::plan::{Plan, PlanError};

const MIN_CYCLE: Duration = Duration::from_micros(100);
const MAX_CYCLE: Duration = Duration::from_millis(100);

/// One fault of an [`AdapterConfig`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConfigFault {
    /// The configuration has no slave.
    #[error("no slave is configured")]
    NoSlaves,
    /// Two entries have the same address on the bus.
    #[error("slaves {first} and {second} are the same: alias {alias}, position {position}")]
    SameAddress {
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
    #[error(
        "slave {slave}: {pdo} size N = {multiplier} is out of range; allowed: 1 to {MAX_MULTIPLIER}"
    )]
    Multiplier {
        /// Slave index.
        slave: usize,
        /// "RxPDO" or "TxPDO".
        pdo: &'static str,
        /// The configured N.
        multiplier: u8,
    },
    /// Cycle outside the range of slaves and master.
    #[error(
        "cycle of {} us is out of range; allowed: {} to {} us",
        cycle.as_micros(), MIN_CYCLE.as_micros(), MAX_CYCLE.as_micros()
    )]
    Cycle {
        /// The configured cycle.
        cycle: Duration,
    },
    /// Watchdog that the slave's register cannot hold.
    #[error(
        "watchdog of {} us is invalid; allowed: multiples of {} us from {} to {} us",
        watchdog.as_micros(), WATCHDOG_UNIT.as_micros(), WATCHDOG_UNIT.as_micros(),
        MAX_WATCHDOG.as_micros()
    )]
    WatchdogTime {
        /// The configured watchdog.
        watchdog: Duration,
    },
    /// The [`Plan`] finds that the configuration does not work on the wire.
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
    /// Index of the reference clock out of range.
    #[error(
        "reference clock: slave index {reference} is out of range: {slaves} slave(s) are configured"
    )]
    ReferenceClock {
        /// The configured index.
        reference: usize,
        /// Number of slaves.
        slaves: usize,
    },
    /// A fixed identity with a 0.
    #[error("slave {slave}: identity needs a vendor ID and a product code; neither may be 0")]
    Identity {
        /// Slave index.
        slave: usize,
    },
    /// Slave index of a startup step out of range.
    #[error(
        "startup step {step}: slave index {slave} is out of range: {slaves} slave(s) are configured"
    )]
    StartupSlave {
        /// Slave index of the step.
        slave: usize,
        /// Index of the step.
        step: usize,
        /// Number of slaves.
        slaves: usize,
    },
    /// A startup step that writes what the Adapter itself writes.
    #[error(
        "slave {slave}: startup step {step} writes the PDO assignment 0x{index:04X}; the Adapter \
         writes it from N; remove the step"
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
        self.check_startup(&mut faults);
        self.check_cycle(&mut faults);
        self.check_plan(&mut faults);
        Faults::check(faults)
    }

    fn check_slave(&self, index: usize, slave: &SlaveConfig, faults: &mut Vec<ConfigFault>) {
        let earlier = self.slaves.iter().take(index).enumerate();
        for (first, other) in earlier {
            if (other.alias, other.position) == (slave.alias, slave.position) {
                faults.push(ConfigFault::SameAddress {
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
    }

    fn check_startup(&self, faults: &mut Vec<ConfigFault>) {
        let slaves = self.slaves.len();
        for (step, entry) in self.startup.iter().enumerate() {
            let (slave, index) = (entry.slave, entry.step.object().0);
            if slave >= slaves {
                faults.push(ConfigFault::StartupSlave { slave, step, slaves });
            }
            if entry.step.is_download() && matches!(index, 0x1C12 | 0x1C13) {
                faults.push(ConfigFault::StartupAssignment { slave, step, index });
            }
        }
    }

    fn check_cycle(&self, faults: &mut Vec<ConfigFault>) {
        let (watchdog, cycle, cycle_ns) = (self.watchdog, self.cycle, self.cycle_ns());
        if !watchdog.as_nanos().is_multiple_of(WATCHDOG_UNIT.as_nanos())
            || !(WATCHDOG_UNIT..=MAX_WATCHDOG).contains(&watchdog)
        {
            faults.push(ConfigFault::WatchdogTime { watchdog });
        }
        if !(MIN_CYCLE..=MAX_CYCLE).contains(&cycle) {
            faults.push(ConfigFault::Cycle { cycle });
            return;
        }
        if let Some(dc) = self.dc {
            if [0, u32::MAX].contains(&dc.cycle_ns()) || dc.cycle_ns() % cycle_ns != 0 {
                faults.push(ConfigFault::Sync0Cycle { sync0_ns: dc.cycle_ns(), cycle_ns });
            }
            if dc.shift_ns() >= dc.cycle_ns() {
                faults.push(ConfigFault::Sync0Shift {
                    shift_ns: dc.shift_ns(),
                    sync0_ns: dc.cycle_ns(),
                });
            }
            let slaves = self.slaves.len();
            if let Some(reference) = dc.reference.filter(|reference| *reference >= slaves) {
                faults.push(ConfigFault::ReferenceClock { reference, slaves });
            }
        }
    }

    /// Adds the errors of the plan, except consequences of a fault found before.
    fn check_plan(&self, faults: &mut Vec<ConfigFault>) {
        let is_real_size = |multiplier| (1..=MAX_MULTIPLIER).contains(&multiplier);
        let has_cycle = (MIN_CYCLE..=MAX_CYCLE).contains(&self.cycle);
        let is_watchdog = |fault: &ConfigFault| matches!(fault, ConfigFault::WatchdogTime { .. });
        let has_watchdog = !faults.iter().any(is_watchdog);
        let counts = |error: &PlanError| match error {
            PlanError::LargePdo { multiplier, .. } => is_real_size(*multiplier),
            PlanError::Watchdog { .. } => has_cycle && has_watchdog,
            _ => has_cycle,
        };
        faults.extend(Plan::of(self).rejections.into_iter().filter(counts).map(ConfigFault::Plan));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DcSync;

    #[test]
    fn default_configuration_has_no_fault() {
        assert_eq!(AdapterConfig::new(1).check(), Ok(()));
        assert_eq!(AdapterConfig::new(3).with_multiplier(11).check(), Ok(()));
    }

    #[test]
    fn check_reports_every_fault() {
        let mut config = AdapterConfig::new(3).with_cycle(Duration::from_millis(1));
        config.slaves[0].rx_multiplier = 0;
        config.slaves[1].tx_multiplier = 12;
        config.slaves[2].position = 1;
        config.dc = Some(DcSync {
            reference: Some(3),
            ..DcSync::new(Duration::from_micros(1500), Duration::from_micros(1500))
        });
        let faults = config.check().unwrap_err().0;
        assert_eq!(faults.len(), 6, "{faults:?}");
    }

    #[test]
    fn twelve_chunks_need_the_large_pdo_permission() {
        let mut config = AdapterConfig::new(1).with_multiplier(12);
        let text = config.check().unwrap_err().to_string();
        assert!(text.contains("1536 bytes") && text.contains("1486"), "{text}");
        config.allow_large_pdos = true;
        assert_eq!(config.check(), Ok(()));
    }

    #[test]
    fn process_data_must_leave_space_for_the_mailbox() {
        let rejected = |slaves, multiplier, cycle_us| {
            let config = AdapterConfig::new(slaves)
                .with_multiplier(multiplier)
                .with_cycle(Duration::from_micros(cycle_us));
            config.check().unwrap_err().0
        };
        assert!(matches!(
            rejected(3, 11, 500).as_slice(),
            [ConfigFault::Plan(PlanError::WireTime { wire_ns: 700_800, cycle_ns: 500_000 })]
        ));
        assert!(matches!(
            rejected(3, 11, 800).as_slice(),
            [ConfigFault::Plan(PlanError::MailboxStarved { needed: 9_068, available: 9_000, .. })]
        ));
    }

    #[test]
    fn sync0_period_beyond_its_range_is_rejected() {
        // A divisor of the period's upper limit.
        let cycle_ns = 983_055;
        let mut config = AdapterConfig::new(1).with_cycle(Duration::from_nanos(cycle_ns.into()));
        config.dc = Some(DcSync::new(Duration::from_secs(5), Duration::ZERO));
        let faults = config.check().unwrap_err().0;
        assert_eq!(faults, [ConfigFault::Sync0Cycle { sync0_ns: u32::MAX, cycle_ns }]);
    }

    #[test]
    fn watchdog_is_a_multiple_of_its_unit_and_longer_than_the_cycle() {
        let us = Duration::from_micros;
        let faults = |cycle_us, watchdog_us| {
            let config = AdapterConfig::new(1).with_cycle(us(cycle_us));
            let checked = config.with_watchdog(us(watchdog_us)).check();
            checked.err().map_or(Vec::new(), |faults| faults.0)
        };
        assert_eq!(faults(1_000, 2_000), []);
        assert_eq!(faults(1_000, 6_553_500), []);
        for watchdog_us in [0, 2_050, 6_553_600] {
            let expected = [ConfigFault::WatchdogTime { watchdog: us(watchdog_us) }];
            assert_eq!(faults(1_000, watchdog_us), expected);
            assert_eq!(faults(0, watchdog_us).len(), 2);
        }
        let rejected = |watchdog_us, cycle_ns| {
            vec![ConfigFault::Plan(PlanError::Watchdog { watchdog_us, cycle_ns })]
        };
        assert_eq!(faults(1_000, 1_000), rejected(1_000, 1_000_000));
        assert_eq!(faults(100_000, 100_000), rejected(100_000, 100_000_000));
        assert_eq!(faults(100_000, 200_000), []);
    }

    #[test]
    fn consequence_of_a_fault_is_not_reported() {
        let mut config = AdapterConfig::new(1).with_cycle(Duration::ZERO);
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
