//! Firmware updates of a gateway (manual 13.7, 15.3.1), and the version that each gateway must run.
//!
//! libethercat has no functions for FoE, so that the file goes to the simulated gateway as its FoE server passes it
//! on: in parts, repeated while the flash is busy.

use ecan_host::Diagnostics;
use ecan_mcan_port::Config;
use ecan_protocol::device::Capabilities;
use ecan_sim::{
    Backend, Fault, FirmwarePackage, FirmwareProgress, FirmwareUpdateError, Gateway, Simulation,
};
use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::draw::{chance, weighted};

const MS: u64 = 1_000_000;
const PART_BYTES: usize = 1024;
/// Wait before a part is repeated.
const BUSY_NS: u64 = 2 * MS;
/// Longest time from the last part until the gateway runs again, and the interval of the attempts to read.
const RESTART_NS: u64 = 10_000 * MS;
const READ_NS: u64 = 500 * MS;
/// Bytes of a file that exceeds a partition.
const TOO_LARGE_BYTES: u32 = 600_000;
/// Outage of the supply in an update, ms.
const OFF_MS: u32 = 300;

/// File of an update, and what happens to its transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Course {
    Complete,
    /// A byte of the file is changed.
    Damaged,
    OtherDevice,
    TooLarge,
    /// The master ends the transfer within the file.
    Aborted,
    /// The supply fails within the file.
    PowerCut,
    /// The supply fails between the end of the file and the restart.
    PowerCutAtEnd,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirmwareUpdate {
    pub course: Course,
    /// 0xF000:05 in the upper half, :06 in the lower one.
    pub version: u32,
    /// Bytes of the package without its header.
    pub bytes: u32,
    /// Offset in the file of the changed byte, or of the end of the transfer.
    pub offset: u32,
    /// The application runs during the update.
    pub in_operation: bool,
}

impl FirmwareUpdate {
    pub fn draw(r: &mut Rng) -> Self {
        let course = weighted(
            r,
            &[
                (6, Course::Complete),
                (2, Course::Damaged),
                (1, Course::OtherDevice),
                (1, Course::TooLarge),
                (1, Course::Aborted),
                (2, Course::PowerCut),
                (1, Course::PowerCutAtEnd),
            ],
        );
        let bytes = if course == Course::TooLarge { TOO_LARGE_BYTES } else { r.u32(..50_000) };
        let offset = r.u32(..FirmwarePackage::HEADER_BYTES as u32 + bytes);
        Self { course, version: r.u32(..), bytes, offset, in_operation: chance(r, 40) }
    }

    fn file(&self) -> Vec<u8> {
        let mut payload = vec![0; self.bytes as usize];
        Rng::with_seed(self.version.into()).fill(&mut payload);
        let device_type = u8::from(self.course == Course::OtherDevice);
        let mut file = FirmwarePackage::new(device_type, self.version, payload).to_bytes();
        if self.course == Course::Damaged {
            file[self.offset as usize] ^= 1;
        }
        file
    }
}

/// Next step of a transfer.
#[derive(Debug, PartialEq, Eq)]
pub enum Step {
    /// Continue after this time, ns.
    Wait(u64),
    /// The gateway has accepted the file, or rejected it; `None` if the transfer was interrupted.
    End(Option<Result<(), FirmwareUpdateError>>),
}

/// An update in progress.
pub struct Transfer {
    simulation: Simulation,
    slave: usize,
    course: Course,
    file: Vec<u8>,
    /// Bytes that the gateway has accepted, after it accepted the begin.
    sent: Option<usize>,
    /// Bytes after which the transfer ends.
    end: usize,
}

impl Transfer {
    pub fn new(simulation: &Simulation, slave: usize, update: &FirmwareUpdate) -> Self {
        let file = update.file();
        let is_cut = matches!(update.course, Course::Aborted | Course::PowerCut);
        let end = if is_cut { update.offset as usize } else { file.len() };
        Self { simulation: simulation.clone(), slave, course: update.course, file, sent: None, end }
    }

    /// Takes steps until the gateway needs time, or to the end.
    pub fn advance(&mut self) -> Step {
        loop {
            match self.step() {
                Ok(None) => {}
                Ok(Some(step)) => return step,
                Err(error) => return Step::End(Some(Err(error))),
            }
        }
    }

    fn step(&mut self) -> Result<Option<Step>, FirmwareUpdateError> {
        let Some(sent) = self.sent else {
            self.gateway(Gateway::begin_firmware_update)?;
            self.sent = Some(0);
            return Ok(None);
        };
        if sent == self.end && self.end < self.file.len() {
            self.interrupt();
            return Ok(Some(Step::End(None)));
        }
        let part = &self.file[sent..self.end.min(sent + PART_BYTES)];
        let progress = match part {
            [] => self.gateway(Gateway::finish_firmware_update)?,
            _ => self.gateway(|gateway, now| gateway.write_firmware(now, part))?,
        };
        match progress {
            FirmwareProgress::Busy { .. } => return Ok(Some(Step::Wait(BUSY_NS))),
            FirmwareProgress::Done if part.is_empty() => {}
            FirmwareProgress::Done => {
                self.sent = Some(sent + part.len());
                return Ok(None);
            }
        }
        if self.course == Course::PowerCutAtEnd {
            self.interrupt();
        }
        Ok(Some(Step::End(Some(Ok(())))))
    }

    fn interrupt(&self) {
        if self.course == Course::Aborted {
            self.gateway(|gateway, _| gateway.abandon_firmware_update());
        } else {
            self.simulation.inject(Fault::PowerCycle { gateway: self.slave, off_ms: OFF_MS });
        }
    }

    fn gateway<R>(&self, action: impl FnOnce(&mut Gateway, u64) -> R) -> R {
        let result = self.simulation.with_world(|world| world.with_gateway(self.slave, action));
        result.expect("the machine has the gateway")
    }
}

/// Versions that the gateways must run.
pub struct Firmware {
    versions: Vec<u32>,
}

impl Firmware {
    pub fn of(simulation: &Simulation, gateways: usize) -> Self {
        Self { versions: (0..gateways).map(|slave| running(simulation, slave)).collect() }
    }

    /// Takes the end of an update.
    pub fn update(
        &mut self,
        slave: usize,
        update: &FirmwareUpdate,
        end: Option<Result<(), FirmwareUpdateError>>,
    ) -> Result<(), String> {
        use FirmwareUpdateError::{Flash, NotBegun, NotReady, Package, TooBig, WrongDevice};
        let is_expected = match (update.course, end) {
            // The gateway may be away, restart in between, or its flash fail.
            (_, Some(Err(NotReady | NotBegun | Flash))) => true,
            (Course::Complete | Course::PowerCutAtEnd, end) => end == Some(Ok(())),
            (Course::Damaged, end) => matches!(end, Some(Err(Package(_) | WrongDevice(_)))),
            (Course::OtherDevice, end) => matches!(end, Some(Err(WrongDevice(_)))),
            (Course::TooLarge, end) => end == Some(Err(TooBig)),
            (Course::Aborted | Course::PowerCut, end) => end.is_none(),
        };
        if end == Some(Ok(())) {
            self.versions[slave] = update.version;
        }
        match is_expected {
            true => Ok(()),
            false => Err(format!("slave {slave}: {update:?} ended with {end:?}")),
        }
    }

    /// Reads the version over SDO once the gateway runs; a gateway that does not respond is one more thing that
    /// happens.
    pub fn check_objects(
        &self,
        backend: &Backend,
        simulation: &Simulation,
        config: &Config,
        slave: usize,
    ) -> Result<(), String> {
        let mut read = None;
        for _ in 0..RESTART_NS / READ_NS {
            simulation.pass_ns(READ_NS);
            read = Diagnostics::open(&backend.ecrt, &config.adapter).ok().and_then(|bus| {
                let number = |subindex| bus.sdo_upload_u32(slave, Capabilities::INDEX, subindex);
                Some(number(5).ok()? << 16 | number(6).ok()?)
            });
            if read == Some(self.versions[slave]) {
                return Ok(());
            }
        }
        match read {
            Some(read) => Err(self.difference(slave, read)),
            None => Ok(()),
        }
    }

    /// All gateways have started since their last update.
    pub fn check(&self, simulation: &Simulation) -> Result<(), String> {
        for slave in 0..self.versions.len() {
            let found = running(simulation, slave);
            if found != self.versions[slave] {
                return Err(self.difference(slave, found));
            }
        }
        Ok(())
    }

    fn difference(&self, slave: usize, found: u32) -> String {
        format!("slave {slave} runs version {found:#x}, not {:#x}", self.versions[slave])
    }
}

/// Version of the package that a gateway runs.
fn running(simulation: &Simulation, slave: usize) -> u32 {
    let package = simulation.with_world(|world| {
        let gateway = world.gateway(slave).expect("the machine has the gateway");
        FirmwarePackage::parse(gateway.running_firmware())
    });
    package.expect("a gateway runs valid firmware").version
}

#[cfg(test)]
mod tests {
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;

    fn start() -> (Backend, Simulation, Firmware) {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let simulation = backend.simulation.clone().unwrap();
        simulation.pass_ns(1_000 * MS);
        let firmware = Firmware::of(&simulation, 1);
        (backend, simulation, firmware)
    }

    fn transfer(
        simulation: &Simulation,
        update: &FirmwareUpdate,
    ) -> Option<Result<(), FirmwareUpdateError>> {
        let mut transfer = Transfer::new(simulation, 0, update);
        loop {
            match transfer.advance() {
                Step::Wait(ns) => simulation.pass_ns(ns),
                Step::End(end) => return end,
            }
        }
    }

    fn update(course: Course) -> FirmwareUpdate {
        let bytes = if course == Course::TooLarge { TOO_LARGE_BYTES } else { 10_000 };
        FirmwareUpdate { course, version: 0x0304_0005, bytes, offset: 5_000, in_operation: false }
    }

    #[test]
    fn each_course_leaves_the_expected_version() {
        for (course, is_installed) in [
            (Course::Complete, true),
            (Course::Damaged, false),
            (Course::OtherDevice, false),
            (Course::TooLarge, false),
            (Course::Aborted, false),
            (Course::PowerCut, false),
            (Course::PowerCutAtEnd, true),
        ] {
            let (backend, simulation, mut firmware) = start();
            let before = firmware.versions[0];
            let end = transfer(&simulation, &update(course));
            firmware.update(0, &update(course), end).unwrap();
            let config = crate::plan::Plan::draw(0, 1).machine.config();
            firmware.check_objects(&backend, &simulation, &config, 0).unwrap();
            firmware.check(&simulation).unwrap();
            let expected = if is_installed { 0x0304_0005 } else { before };
            assert_eq!(running(&simulation, 0), expected, "{course:?}");
        }
    }

    #[test]
    fn each_violation_is_a_finding() {
        let (_, simulation, mut firmware) = start();
        let accepted = firmware.update(0, &update(Course::Damaged), Some(Ok(())));
        assert!(accepted.unwrap_err().contains("Damaged"));
        // It counts as installed.
        assert!(firmware.check(&simulation).unwrap_err().contains("not 0x3040005"));
        let rejected = Some(Err(FirmwareUpdateError::TooBig));
        assert!(firmware.update(0, &update(Course::Complete), rejected).is_err());
        let away = Some(Err(FirmwareUpdateError::NotReady));
        firmware.update(0, &update(Course::Complete), away).unwrap();
    }
}
