//! Startup of an axis, `ecan axis enable` and `ecan axis stop`.

use std::time::Duration;

use clap::Args;
use ecan_canopen::OperatingMode;
use ecan_cia402::{AxisCommand, AxisError, AxisPhase, AxisRef};
use ecan_sim::ClockKind;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::milliseconds;

use super::axis_choice::AxisOptions;
use super::envelope::Envelope;
use super::motion_arguments::{MotionArguments, PermissionArguments};
use super::operator::{InputKind, Operator};
use super::session::{AxisSession, SessionSettings};
use super::status;
use super::status::DriveReport;
use crate::context::{Context, Failure, Result};
use crate::frames::GatewayOptions;

pub const NOTES: &str = "\
The drive is configured and enabled at its actual position, and holds it until Enter, q, Esc or
Ctrl-C, or for --for. With --hold-key only while any key is held. When the terminal is lost or a pipe
of standard input is closed, the drive gets a quick stop and is switched off (exit status 1).

If it is not enabled, the error names the obstacles, as `ecan axis status` does.";

#[derive(Debug, Args)]
pub struct EnableArguments {
    /// Stay enabled for this time
    #[arg(long = "for", conflicts_with = "hold_key", value_name = "TIME", value_parser = milliseconds::<u64>(1..=3_600_000))]
    milliseconds: Option<u64>,
    #[command(flatten)]
    motion: MotionArguments,
}

pub fn run(arguments: &EnableArguments, context: &Context) -> Result {
    let motion = &arguments.motion;
    let chosen = motion.choose(context)?;
    let envelope = motion.envelope(&chosen)?;
    let operator = motion.permission.obtain("enable", &chosen.label)?;
    if operator.kind() == InputKind::None && arguments.milliseconds.is_none() {
        let message = "without a terminal or a pipe `enable` needs an end; set --for";
        return Err(Failure::Usage(message.to_owned()));
    }
    let is_interactive = arguments.milliseconds.is_none();
    let settings = motion.settings(OperatingMode::CyclicPosition, envelope, is_interactive);
    let session = AxisSession::start(&chosen, settings, Some(operator), context)?;
    let end = session.run_to_end(|session| {
        prepare_within(session, &motion.permission, &envelope)?;
        enable(session)?;
        hold(session, arguments)
    })?;
    end.print(context)
}

fn hold(session: &mut AxisSession, arguments: &EnableArguments) -> Result {
    let end = match (arguments.milliseconds, arguments.motion.permission.holds_key()) {
        (Some(ms), _) => format!("for {ms} ms"),
        (None, true) => "while a key is held".to_owned(),
        (None, false) => "until Enter, q or Ctrl-C".to_owned(),
    };
    session.report(format_args!("enabled {end}"));
    let start_ns = session.now_ns();
    let time_ns = arguments.milliseconds.map(|ms| ms * 1_000_000);
    loop {
        let now_ns = match session.cycle(None) {
            Ok(end) => end.now_ns,
            // The usual end.
            Err(Failure::Incomplete(_)) if session.is_commanded_end() => return Ok(()),
            Err(failure) => return Err(failure),
        };
        session.check_running()?;
        let operator = session.operator.as_ref();
        if operator.is_some_and(|operator| operator.needs_key() && !operator.has_held_key()) {
            session.report("key released: quick stop");
            return session.stop();
        }
        let is_over = time_ns.is_some_and(|time_ns| now_ns.saturating_sub(start_ns) >= time_ns);
        if is_over || session.operator.as_ref().is_some_and(Operator::has_end_key) {
            return Ok(());
        }
    }
}

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
    if session.axis().map(AxisRef::phase) == Some(AxisPhase::Fault) {
        let failure = format!("{}: fault", session.label());
        return Err(explain(session, &failure)?);
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
    let envelope = session.narrow(envelope);
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
        Err(Failure::Rejected(failure)) => Err(explain(session, &failure)?),
        result => result,
    }
}

/// Configures the drive: an enabled one is stopped first. Rejects a drive that would not stop if the
/// host failed.
fn configure(session: &mut AxisSession) -> Result {
    session.command(AxisCommand::Configure)?;
    let label = session.label().to_owned();
    session.wait("configured", CONFIGURE, |axis| match axis.phase() {
        _ if axis.is_configured() => Some(Ok(())),
        AxisPhase::SetupFailed => {
            let error = axis.error().map_or_else(String::new, |error| error.to_string());
            Some(Err(Failure::Rejected(format!("{label}: {error}"))))
        }
        _ => None,
    })?;
    if let Some(finding) = session.axis().and_then(|axis| axis.drive().scale_finding) {
        session.report(format_args!("warning: {finding}"));
    }
    let Some(loss) = session.axis().map(AxisRef::host_loss) else { return Ok(()) };
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
    session.command(AxisCommand::ResetFault)?;
    let label = session.label().to_owned();
    session.wait("reset", POSITION, |axis| match (axis.phase(), axis.error()) {
        (AxisPhase::ResettingFault, _) => None,
        (_, Some(error @ AxisError::ResetFailed { .. })) => {
            Some(Err(Failure::Rejected(format!("{label}: {error}"))))
        }
        (AxisPhase::Fault, _) => None,
        _ => Some(Ok(())),
    })
}

/// Establishes the actual position, with the drive off.
fn read_position(session: &mut AxisSession) -> Result<f64> {
    session.command(AxisCommand::ReadPosition)?;
    session.wait("at a known position", POSITION, |axis| {
        (axis.phase() == AxisPhase::Ready).then_some(Ok(()))
    })?;
    session.actual()
}

/// Enables the drive; the axis stays at its actual position.
fn begin(session: &mut AxisSession) -> Result {
    session.command(AxisCommand::Enable)?;
    let timeout = session.axis().map_or(POSITION, |axis| axis.config().enable_timeout);
    let label = session.label().to_owned();
    session.wait("enabled", timeout + ENABLE_RESERVE, |axis| {
        if axis.is_running() {
            return Some(Ok(()));
        }
        let error = axis.error().filter(|error| !matches!(error, AxisError::Held(_)))?;
        Some(Err(Failure::Rejected(format!("{label}: {error}"))))
    })
}

/// Waits for a held key, if a motion needs one.
pub fn await_key(session: &mut AxisSession) -> Result {
    let is_missing = |session: &AxisSession| {
        session
            .operator
            .as_ref()
            .is_some_and(|operator| operator.needs_key() && !operator.has_held_key())
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
fn explain(session: &mut AxisSession, failure: &str) -> Result<Failure> {
    let (label, units) = (session.label().to_owned(), session.units());
    let read = &mut |index, subindex| Ok(session.number(index, subindex));
    let report = DriveReport::read(label, units, None, read)?;
    let mut obstacles = Vec::new();
    status::print_obstacles(&report, &mut obstacles)?;
    let obstacles = String::from_utf8_lossy(&obstacles);
    Ok(Failure::Rejected(format!("{failure}\n{}", obstacles.trim_end())))
}

pub const STOP_NOTES: &str = "\
The drive gets a quick stop in every state, by SDO, and is switched off at rest. It is not
configured, and needs no limits. Exit status 5 if the drive does not report that it is off: it may
be moving; remove its power.";

#[derive(Debug, Args)]
pub struct StopArguments {
    #[command(flatten)]
    axis: AxisOptions,
    #[command(flatten)]
    options: GatewayOptions,
}

pub fn run_stop(arguments: &StopArguments, context: &Context) -> Result {
    let StopArguments { axis, options } = arguments;
    let chosen = axis.choose(options.setup.config.as_deref(), false, context)?;
    // The first Ctrl-C does not end the stop; the second one ends the program.
    let _interrupt = Interrupt::install()?;
    let settings = SessionSettings {
        options,
        mode: None,
        envelope: None,
        clock: ClockKind::Stepped,
        accepts_risk: true,
    };
    AxisSession::start(&chosen, settings, None, context)?.stop_only()?.print(context)
}
