//! The startup steps of all slaves, in the order that a gateway needs.
//!
//! The master sends its registered startup SDOs before it writes the PDO assignment itself, but
//! applying a PDO profile needs the assignment (manual 5.4.2). So the list writes the assignment
//! before the steps of the plan. Only leading checks stay first, because capabilities are read
//! before anything is chosen (manual 14).

use ecan_protocol::config::assignment_writes;
use ecan_protocol::device::OptionalObject;
use ecan_protocol::mapping::Direction;

use super::startup_step::StartupStep;
use crate::config::AdapterConfig;

/// Startup steps that the layer above the Adapter needs, for each slave: what an MCAN Port makes of
/// its configuration. Empty by default.
///
/// [`AdapterConfig::startup`] holds the application's own steps.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StartupPlan {
    slaves: Vec<Vec<StartupStep>>,
}

/// From the steps of each slave, in the order of the slaves.
impl FromIterator<Vec<StartupStep>> for StartupPlan {
    fn from_iter<I: IntoIterator<Item = Vec<StartupStep>>>(slaves: I) -> Self {
        Self { slaves: slaves.into_iter().collect() }
    }
}

impl StartupPlan {
    /// The steps of the plan for a slave, without assignment and the application's steps; empty for
    /// a slave that the plan does not have.
    pub fn of_slave(&self, slave: usize) -> &[StartupStep] {
        self.slaves.get(slave).map_or(&[], Vec::as_slice)
    }

    /// The complete startup sequence of a slave, in the order in which the Adapter executes it:
    /// leading checks, PDO assignment from N, the other steps of the plan, the application's steps
    /// (manual 5.4.3). Empty for a slave that is not configured.
    ///
    /// Allocates; not for the cycle.
    pub fn steps(&self, config: &AdapterConfig, slave: usize) -> Vec<StartupStep> {
        let Some(settings) = config.slaves.get(slave) else { return Vec::new() };
        let base = self.of_slave(slave);
        let leading = base.iter().take_while(|step| !step.is_download()).count();
        let (checks, others) = base.split_at(leading);
        let rx = assignment_writes(Direction::RxPdo, settings.rx_multiplier);
        let tx = assignment_writes(Direction::TxPdo, settings.tx_multiplier);
        let mut steps = checks.to_vec();
        steps.extend(rx.chain(tx).map(StartupStep::Download));
        steps.extend_from_slice(others);
        steps.extend(config.startup_of(slave));
        steps
    }

    /// The steps that the Adapter itself executes before the master is activated: the leading checks,
    /// or all steps if the application added checks, which depend on the order. The layer above
    /// verifies its own part later, so that the master alone executes the downloads.
    pub(crate) fn preparation(&self, config: &AdapterConfig, slave: usize) -> Vec<StartupStep> {
        let mut steps = self.steps(config, slave);
        if config.startup_of(slave).all(|step| step.is_download()) {
            let first_download = steps.iter().position(StartupStep::is_download);
            steps.truncate(first_download.unwrap_or(steps.len()));
        }
        steps
    }

    /// The optional objects that the plan writes to a slave.
    pub(crate) fn optional_objects(&self, slave: usize) -> Vec<OptionalObject> {
        let mut optional = Vec::new();
        for step in self.of_slave(slave).iter().filter(|step| step.is_download()) {
            let (index, subindex) = step.object();
            if let Some(object) = OptionalObject::of(index, subindex)
                && !optional.contains(&object)
            {
                optional.push(object);
            }
        }
        optional
    }

    /// Removes the steps of objects that the slave does not have.
    pub(crate) fn leave_out(&mut self, slave: usize, missing: &[OptionalObject]) {
        let Some(steps) = self.slaves.get_mut(slave) else { return };
        steps.retain(|step| {
            let (index, subindex) = step.object();
            !missing.iter().any(|object| object.contains(index, subindex))
        });
    }

    pub(crate) fn download_count(&self, config: &AdapterConfig, slave: usize) -> usize {
        self.steps(config, slave).iter().filter(|step| step.is_download()).count()
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::object::{ObjectType, SdoWrite};

    use super::*;

    #[test]
    fn steps_are_leading_checks_then_assignment_then_the_rest() {
        let mut config = AdapterConfig::new(2);
        config.slaves[1].tx_multiplier = 1;
        let apply = SdoWrite { index: 0x8010, subindex: 1, value: 1, ty: ObjectType::U8 };
        let base = vec![StartupStep::expect(0xF000, 17, 128), StartupStep::Download(apply)];
        let plan = StartupPlan::from_iter([Vec::new(), base]);
        config.add_startup(0, StartupStep::expect(0x8000, 1, 0)).unwrap();
        config.add_startup(1, StartupStep::expect(0x8010, 2, 0)).unwrap();
        let list: Vec<(u16, u8, Option<u32>)> = plan
            .steps(&config, 1)
            .iter()
            .map(|step| {
                let (index, subindex) = step.object();
                let value = match step {
                    StartupStep::Download(sdo) => Some(sdo.value),
                    StartupStep::Expect { .. } => None,
                };
                (index, subindex, value)
            })
            .collect();
        assert_eq!(
            list,
            [
                (0xF000, 17, None),
                (0x1C12, 0, Some(0)),
                (0x1C12, 1, Some(0x1600)),
                (0x1C12, 2, Some(0x1601)),
                (0x1C12, 3, Some(0x1602)),
                (0x1C12, 0, Some(3)),
                (0x1C13, 0, Some(0)),
                (0x1C13, 1, Some(0x1A00)),
                (0x1C13, 0, Some(1)),
                (0x8010, 1, Some(1)),
                (0x8010, 2, None),
            ]
        );
    }
}
