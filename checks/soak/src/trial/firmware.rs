//! A firmware update in a trial.

use super::{Check, Trial};
use crate::finding::Rule;
use crate::firmware_update::{FirmwareUpdate, Step, Transfer};

impl Trial {
    /// Updates a gateway while the application runs, or between two runs of it.
    pub(super) fn update_firmware(&mut self, slave: usize, update: &FirmwareUpdate) -> Check {
        if !update.in_operation {
            self.close();
            self.end_statistics();
        }
        let mut transfer = Transfer::new(&self.simulation, slave, update);
        let end = loop {
            match transfer.advance() {
                Step::Wait(ns) => self.pass(ns)?,
                Step::End(end) => break end,
            }
        };
        let finding = |text| (Rule::Firmware, text);
        self.firmware.update(slave, update, end).map_err(finding)?;
        if !update.in_operation {
            let config = self.plan.machine.config();
            let check =
                self.firmware.check_objects(&self.backend, &self.simulation, &config, slave);
            check.map_err(finding)?;
            self.repeat(Self::open)?;
        }
        Ok(())
    }

    fn pass(&mut self, ns: u64) -> Check {
        let end = self.now_ns() + ns;
        while self.application.is_some() && self.now_ns() < end {
            self.cycle(true)?;
            self.cycle += 1;
        }
        if self.application.is_none() {
            self.simulation.pass_ns(ns);
        }
        Ok(())
    }
}
