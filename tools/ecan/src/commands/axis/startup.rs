//! Startup of an axis, with the obstacles to enabling it.

use std::time::Duration;

use ecan_cia402::{AxisError, AxisPhase, CommandError};

use crate::context::{Failure, Result};

use super::dead_man::PermissionArguments;
use super::drive_report::{self, DriveReport};
use super::envelope::Envelope;
use super::session::{AXIS, AxisSession};

const CONFIGURE: Duration = Duration::from_secs(20);
/// Time for the position, beyond the drain of old targets.
const POSITION: Duration = Duration::from_secs(5);
/// Time beyond the enable timeout of the axis.
const ENABLE_RESERVE: Duration = Duration::from_secs(5);

/// Configures the drive, resets a fault if permitted, and returns the actual position in steps.
pub fn prepare(session: &mut AxisSession, permission: &PermissionArguments) -> Result<f64> {
    configure(session)?;
    if permission.resets_fault() {
        reset_fault(session)?;
    }
    if session.cia402().phase(AXIS) == Some(AxisPhase::Fault) {
        let failure = format!("{}: fault", session.label());
        return Err(explained(session, &failure)?);
    }
    read_position(session)
}

/// As [`prepare`], for a motion within limits: returns also those that the drive leaves of them. Rejects an
/// axis that is outside the range by more than an overshoot.
pub fn prepare_within(
    session: &mut AxisSession,
    permission: &PermissionArguments,
    envelope: &Envelope,
) -> Result<(f64, Envelope)> {
    let start = prepare(session, permission)?;
    let envelope = session.narrowed(envelope);
    let units = session.units();
    match envelope.admits(start) {
        true => Ok((start, envelope)),
        false => Err(Failure::Usage(format!(
            "the actual position {} is outside the range {}; extend --range",
            units.position_text(start),
            envelope.text(&units)
        ))),
    }
}

/// Enables the drive, when a key is held if that is required. The error names the obstacles that the
/// drive reports.
pub fn enable(session: &mut AxisSession) -> Result {
    await_key(session)?;
    match begin(session) {
        // A stop by the operator needs no explanation.
        Err(Failure::Rejected(failure)) => Err(explained(session, &failure)?),
        result => result,
    }
}

/// Configures the drive: an enabled one is stopped first. Rejects a drive that would not stop if the
/// host failed.
fn configure(session: &mut AxisSession) -> Result {
    // infallible: the axis exists
    let _ = session.cia402_mut().configure(AXIS);
    let label = session.label().to_owned();
    session.wait("configured", CONFIGURE, |cia402| match cia402.phase(AXIS) {
        _ if cia402.is_configured(AXIS) => Some(Ok(())),
        Some(AxisPhase::SetupFailed) => {
            let error = cia402.error(AXIS).map_or_else(String::new, |it| it.to_string());
            Some(Err(Failure::Rejected(format!("{label}: {error}"))))
        }
        _ => None,
    })?;
    if let Some(finding) = session.cia402().scale_finding(AXIS) {
        session.report(format_args!("warning: {finding}"));
    }
    let Some(loss) = session.cia402().host_loss(AXIS) else { return Ok(()) };
    let text = format!("if this host fails: {}, {}", loss.reaction, loss.watch);
    match loss.reaction.is_controlled_stop() {
        true => session.report(text),
        false if session.accepts_risk() => session.report(format_args!("warning: {text}")),
        false => {
            return Err(Failure::Rejected(format!(
                "{label}: not enabled, since its motor would not stop {text}; configure 0x1016, 0x6007 and \
                 0x605A of the drive, or use --accept-risk"
            )));
        }
    }
    Ok(())
}

/// Resets a fault of the drive and waits for the result.
fn reset_fault(session: &mut AxisSession) -> Result {
    session.cia402_mut().reset_fault(AXIS).map_err(rejected)?;
    let label = session.label().to_owned();
    session.wait("reset", POSITION, |cia402| match (cia402.phase(AXIS), cia402.error(AXIS)) {
        (Some(AxisPhase::ResettingFault), _) => None,
        (_, Some(error @ AxisError::ResetFailed { .. })) => {
            Some(Err(Failure::Rejected(format!("{label}: {error}"))))
        }
        (Some(AxisPhase::Fault), _) => None,
        _ => Some(Ok(())),
    })
}

/// Establishes the actual position, with the drive off.
fn read_position(session: &mut AxisSession) -> Result<f64> {
    session.cia402_mut().read_position(AXIS).map_err(rejected)?;
    session.wait("at a known position", POSITION, |cia402| match cia402.phase(AXIS) {
        Some(AxisPhase::Ready) => Some(Ok(())),
        _ => None,
    })?;
    session.actual()
}

/// Enables the drive; the axis stays at its actual position.
fn begin(session: &mut AxisSession) -> Result {
    session.begin_enable()?;
    let timeout = session.cia402().config(AXIS).map_or(POSITION, |it| it.enable_timeout);
    let label = session.label().to_owned();
    session.wait("enabled", timeout + ENABLE_RESERVE, |cia402| {
        if cia402.is_running(AXIS) {
            return Some(Ok(()));
        }
        let error = cia402.error(AXIS).filter(|error| !matches!(error, AxisError::Held(_)))?;
        Some(Err(Failure::Rejected(format!("{label}: {error}"))))
    })
}

fn rejected(error: CommandError) -> Failure {
    Failure::Rejected(error.to_string())
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
