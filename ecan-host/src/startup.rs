//! The startup of the slaves: its steps, in the order that a gateway needs, and their execution with
//! blocking transfers.
//!
//! The master sends its registered startup SDOs before it writes the PDO assignment itself, but
//! applying a PDO profile needs the assignment (manual 5.4.2). So the list writes the assignment
//! before the steps of the plan. Only leading checks stay first, because capabilities are read
//! before anything is chosen (manual 14).

use std::time::Duration;

use ecan_protocol::config::assignment_writes;
use ecan_protocol::device::{Capabilities, OptionalObject};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::AbortCode;
use ecan_protocol::sequence::{
    NoAction, ObjectAccess, Sequence, SequenceState, StepError, Transfer,
};

use crate::bus::{CapabilityValues, Diagnostics};
use crate::config::{AdapterConfig, StartupStep};
use crate::error::Error;

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

const POLL_NS: u64 = 10_000_000;

struct SlaveObjects<'a> {
    diagnostics: &'a Diagnostics,
    slave: usize,
    capabilities: &'a mut CapabilityValues,
    result: u64,
}

impl ObjectAccess for SlaveObjects<'_> {
    type Action = NoAction;
    type Error = Error;

    fn start_write(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<bool, Error> {
        self.diagnostics.sdo_download(self.slave, index, subindex, data)?;
        Ok(true)
    }

    fn start_read(&mut self, index: u16, subindex: u8) -> Result<bool, Error> {
        let value = match index {
            Capabilities::INDEX => self.capabilities.read(self.diagnostics, self.slave, subindex),
            _ => {
                let value = self.diagnostics.sdo_upload_u32(self.slave, index, subindex);
                Error::or_assumed(value, index, subindex)
            }
        };
        self.result = value?.into();
        Ok(true)
    }

    fn poll(&mut self) -> Result<Transfer, Error> {
        Ok(Transfer::Done(self.result))
    }

    fn act(&mut self, action: &NoAction, _: Duration) -> Result<bool, Error> {
        match *action {}
    }

    fn abort_code(error: &Error) -> Option<AbortCode> {
        match error {
            Error::Sdo { abort_code, .. } => *abort_code,
            _ => None,
        }
    }
}

impl Diagnostics {
    /// Executes startup steps of a slave and reports each completed one. Blocks for a transfer per
    /// step.
    ///
    /// # Errors
    /// [`Error::Sdo`] or [`Error::Readback`] of the first step that failed.
    pub fn run_startup(
        &self,
        slave: usize,
        steps: &[StartupStep],
        on_step: impl FnMut(&StartupStep),
    ) -> Result<(), Error> {
        self.run_startup_with(slave, steps, &mut CapabilityValues::default(), on_step)
    }

    /// As [`run_startup`](Self::run_startup), with the values of 0xF000 that are known.
    pub(crate) fn run_startup_with(
        &self,
        slave: usize,
        steps: &[StartupStep],
        capabilities: &mut CapabilityValues,
        mut on_step: impl FnMut(&StartupStep),
    ) -> Result<(), Error> {
        let mut objects = SlaveObjects { diagnostics: self, slave, capabilities, result: 0 };
        for step in steps {
            let shared = [(*step).into()];
            let mut sequence = Sequence::new(&shared[..]);
            loop {
                let now_ns = self.clock().now_ns();
                match sequence.advance(&mut objects, now_ns, |_, _, _| {}) {
                    SequenceState::Done => break,
                    SequenceState::Running => self.clock().sleep_until_ns(now_ns + POLL_NS),
                    SequenceState::Failed(StepError::Access(error)) => return Err(error),
                    SequenceState::Failed(
                        StepError::Mismatch { found, expected }
                        | StepError::TimedOut { found, expected, .. },
                    ) => {
                        let (index, subindex) = step.object();
                        let found = found as u32;
                        return Err(Error::Readback { slave, index, subindex, expected, found });
                    }
                    SequenceState::Failed(_) => return Ok(()),
                }
            }
            on_step(step);
        }
        Ok(())
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
