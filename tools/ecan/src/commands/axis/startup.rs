//! Startup of an axis, with the obstacles to enabling it.

use ecan_cia402::AxisPhase;

use crate::context::{Failure, Result};

use super::dead_man::PermissionArguments;
use super::drive_report::{self, DriveReport};
use super::session::{AXIS, AxisSession};

/// Configures the drive, resets a fault if permitted, and returns the actual position in steps.
pub fn prepare(session: &mut AxisSession, permission: &PermissionArguments) -> Result<f64> {
    session.configure()?;
    if permission.resets_fault() {
        session.reset_fault()?;
    }
    if session.cia402().phase(AXIS) == Some(AxisPhase::Fault) {
        let failure = format!("{}: fault", session.label());
        return Err(explained(session, &failure)?);
    }
    session.read_position()
}

/// Enables the drive, when a key is held if that is required. The error names the obstacles that the
/// drive reports.
pub fn enable(session: &mut AxisSession) -> Result {
    await_key(session)?;
    match session.enable() {
        // A stop by the operator needs no explanation.
        Err(Failure::Rejected(failure)) => Err(explained(session, &failure)?),
        result => result,
    }
}

/// Waits for a held key, if a motion needs one.
pub fn await_key(session: &mut AxisSession) -> Result {
    let is_missing = |session: &AxisSession| {
        session.operator.as_ref().is_some_and(|it| it.needs_key() && !it.has_held_key())
    };
    if is_missing(session) {
        session.report("hold a key to enable the drive");
    }
    while is_missing(session) {
        session.cycle(None)?;
    }
    Ok(())
}

/// Adds the obstacles that the drive reports.
fn explained(session: &mut AxisSession, failure: &str) -> Result<Failure> {
    let (label, units) = (session.label().to_owned(), session.units());
    let read = &mut |index, subindex| Ok(session.number(index, subindex));
    let report = DriveReport::read(label, units, None, read)?;
    let mut obstacles = Vec::new();
    drive_report::print_obstacles(&report, &mut obstacles)?;
    let obstacles = String::from_utf8_lossy(&obstacles);
    Ok(Failure::Rejected(format!("{failure}\n{}", obstacles.trim_end())))
}
