//! Execution of startup steps with blocking transfers.

use std::time::Duration;

use ecan_protocol::device::Capabilities;
use ecan_protocol::object::AbortCode;
use ecan_protocol::sequence::{
    NoAction, ObjectAccess, Sequence, SequenceState, StepError, Transfer,
};

use super::startup_step::StartupStep;
use crate::bus::{CapabilityValues, Diagnostics};
use crate::error::Error;

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
