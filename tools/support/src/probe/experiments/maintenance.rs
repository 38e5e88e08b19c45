//! Maintenance: only the command that validates a received firmware image, which changes nothing.

use ecan_host::{Maintenance, MaintenanceError};
use ecan_protocol::device::{AccessMode, MaintenanceCommand, MaintenanceStatus};

use crate::probe::experiment::Experiment;
use crate::probe::interruption::{Interruption, Result};
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H27", "S43"],
        key: "maintenance_mode",
        stage: Stage::PreOp,
        assumption: "validating a firmware image needs engineering mode",
        run: mode,
    },
    Experiment {
        rows: &["H27", "S44"],
        key: "maintenance_status",
        stage: Stage::PreOp,
        assumption: "maintenance status 4 is an invalid image",
        run: status,
    },
];

/// Status of the command in a mode.
fn validate(probe: &Probe, mode: AccessMode) -> Result<MaintenanceStatus> {
    let maintenance = Maintenance::new(&probe.diagnostics, probe.slave);
    let command = || -> Result<MaintenanceStatus> {
        match maintenance.command(MaintenanceCommand::Validate, probe.clock()) {
            Ok(()) => Ok(MaintenanceStatus::Ok),
            Err(MaintenanceError::Status(status)) => Ok(status),
            Err(error) => Err(Interruption::from(error)),
        }
    };
    maintenance.in_mode(mode, command)
}

/// The first mode that permits the command, with its status.
fn permitted(probe: &Probe) -> Result<Option<(AccessMode, MaintenanceStatus)>> {
    for mode in [AccessMode::Run, AccessMode::Engineering, AccessMode::Factory] {
        let status = validate(probe, mode)?;
        if status != MaintenanceStatus::Denied {
            return Ok(Some((mode, status)));
        }
    }
    Ok(None)
}

fn mode(probe: &mut Probe) -> Result<Outcome> {
    if probe.sdo().read(0xB000, 2)? != u32::from(AccessMode::Run.raw()) {
        return Ok(Outcome::undecided("another application has requested an access mode"));
    }
    Ok(match permitted(probe)? {
        Some((AccessMode::Run, _)) => {
            Outcome::differs("the command is permitted in run mode").like("run")
        }
        Some((AccessMode::Engineering, _)) => {
            Outcome::holds("denied in run mode, permitted in engineering mode")
        }
        Some((AccessMode::Factory, _)) => {
            Outcome::differs("denied in engineering mode, permitted in factory mode")
                .like("factory")
        }
        None => Outcome::differs("denied in every mode"),
    })
}

fn status(probe: &mut Probe) -> Result<Outcome> {
    let Some((_, status)) = permitted(probe)? else {
        return Ok(Outcome::undecided("the command is denied in every mode"));
    };
    let detail = format!("validating a firmware image ends with status {}", status.raw());
    Ok(match status {
        MaintenanceStatus::Ok => Outcome::undecided("a valid firmware image is stored"),
        MaintenanceStatus::ImageInvalid => Outcome::holds(detail),
        MaintenanceStatus::CrcError => Outcome::differs(detail).like("swapped"),
        _ => Outcome::differs(detail),
    })
}
