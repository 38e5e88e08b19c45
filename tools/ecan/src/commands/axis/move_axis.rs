//! `ecan axis move`: to a position, or by a distance.

use ecan_cia402::AxisRef;
use std::time::Duration;

use clap::{Args, ValueEnum};
use ecan_canopen::OperatingMode;
use serde::Serialize;

use super::enable;
use super::envelope::{Envelope, parse_number, parse_positive};
use super::motion_arguments::MotionArguments;
use super::session::{AxisSession, Motion};
use super::unit::AxisUnits;
use crate::context::{Context, Failure, Result};

pub const NOTES: &str = "\
The axis moves with a trapezoidal velocity. In CSP the host generates the targets within the limits;
in PP the drive does, by 0x6081, 0x6083 and 0x6084, which are written. Any key, Ctrl-C, a lost
terminal or a closed pipe of standard input ends the motion by quick stop (exit status 1). At the
end the drive is switched off.";

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum MoveMode {
    #[default]
    Csp,
    Pp,
}

#[derive(Debug, Args)]
pub struct MoveArguments {
    /// Position to move to, in UNIT
    #[arg(long, value_name = "POSITION", value_parser = parse_number, allow_hyphen_values = true,
          required_unless_present = "by", conflicts_with = "by")]
    to: Option<f64>,
    /// Distance to move by, in UNIT
    #[arg(long, value_name = "DISTANCE", value_parser = parse_number, allow_hyphen_values = true)]
    by: Option<f64>,
    /// Velocity, in UNIT/s [default: --max-velocity]
    #[arg(long, value_name = "VELOCITY", value_parser = parse_positive)]
    velocity: Option<f64>,
    /// Operating mode
    #[arg(long, value_enum, default_value_t, value_name = "MODE")]
    mode: MoveMode,
    /// Tolerance of the end position, in UNIT [default: 10 ms of motion at --max-velocity]
    #[arg(long, value_name = "TOLERANCE", value_parser = parse_positive)]
    tolerance: Option<f64>,
    #[command(flatten)]
    motion: MotionArguments,
}

#[derive(Debug, Serialize)]
struct Moved {
    axis: String,
    unit: String,
    start: f64,
    target: f64,
    end: f64,
    seconds: f64,
}

/// Time to come to rest at the goal after the last target.
const SETTLING: Duration = Duration::from_secs(3);
/// Cycles at the goal that count as rest.
const REST_CYCLES: u32 = 20;

pub fn run(arguments: &MoveArguments, context: &Context) -> Result {
    let motion = &arguments.motion;
    let chosen = motion.choose(context)?;
    let envelope = motion.envelope(&chosen)?;
    let envelope = match arguments.velocity.map(|velocity| chosen.units.length(velocity).abs()) {
        Some(velocity) if velocity > envelope.velocity => {
            return Err(Failure::Usage(format!(
                "--velocity {} is out of range; allowed: up to {}",
                chosen.units.velocity_text(velocity),
                chosen.units.velocity_text(envelope.velocity)
            )));
        }
        Some(velocity) => Envelope { velocity, ..envelope },
        None => envelope,
    };
    if let Some(to) = arguments.to {
        check_goal(&envelope, chosen.units.steps(to), &chosen.units)?;
    }
    let operator = motion.permission.obtain("move", &chosen.label)?;
    let mode = match arguments.mode {
        MoveMode::Csp => OperatingMode::CyclicPosition,
        MoveMode::Pp => OperatingMode::ProfilePosition,
    };
    let settings = motion.settings(mode, envelope, false);
    let session = AxisSession::start(&chosen, settings, Some(operator), context)?;
    let moved = session.run(|session| {
        let (start, envelope) = enable::prepare_within(session, &motion.permission, &envelope)?;
        let goal = match (arguments.to, arguments.by) {
            (Some(to), _) => chosen.units.steps(to),
            (None, by) => start + chosen.units.length(by.unwrap_or(0.0)),
        };
        check_goal(&envelope, goal, &chosen.units)?;
        enable::enable(session)?;
        let tolerance = arguments.tolerance.map(|tolerance| chosen.units.length(tolerance).abs());
        let tolerance = tolerance.unwrap_or(envelope.velocity * 0.01).max(1.0);
        session.report(format_args!(
            "moving from {} to {}",
            chosen.units.position_text(start),
            chosen.units.position_text(goal)
        ));
        let begin_ns = session.now_ns();
        match mode {
            OperatingMode::ProfilePosition => move_pp(session, goal, &envelope)?,
            _ => move_csp(session, goal, &envelope)?,
        }
        settle(session, goal, tolerance)?;
        let seconds = session.now_ns().saturating_sub(begin_ns) as f64 / 1e9;
        let end = session.actual()?;
        Ok(Moved {
            axis: chosen.label.clone(),
            unit: chosen.units.unit.to_string(),
            start: chosen.units.position(start),
            target: chosen.units.position(goal),
            end: chosen.units.position(end),
            seconds,
        })
    })?;
    context.output.data(&moved, |out| {
        let Moved { axis, unit, start, target, end, seconds } = &moved;
        let number = |value: &f64| chosen.units.number(*value);
        writeln!(
            out,
            "{axis}: moved from {} to {} {unit} (target {} {unit}) in {seconds:.2} s",
            number(start),
            number(end),
            number(target)
        )
    })
}

fn check_goal(envelope: &Envelope, goal: f64, units: &AxisUnits) -> Result {
    match envelope.contains(goal.round()) {
        true => Ok(()),
        false => Err(Failure::Usage(format!(
            "the target {} is outside the range {}; move less far, or extend --range",
            units.position_text(goal),
            envelope.text(units)
        ))),
    }
}

fn move_csp(session: &mut AxisSession, goal: f64, envelope: &Envelope) -> Result {
    let goal = goal.round();
    let mut motion = Motion::begin(session)?;
    while !motion.profile().is_at(goal) {
        motion.toward(session, goal, envelope.profile())?;
        session.check_running()?;
        session.check_key()?;
    }
    Ok(())
}

fn move_pp(session: &mut AxisSession, goal: f64, envelope: &Envelope) -> Result {
    let start = session.actual()?;
    // Twice the time of the trapezoid.
    let seconds =
        (goal - start).abs() / envelope.velocity + envelope.velocity / envelope.acceleration;
    let end_ns =
        session.now_ns().saturating_add((seconds * 2e9) as u64 + SETTLING.as_nanos() as u64);
    loop {
        let end = session.cycle(Some(goal.round() as i32))?;
        session.check_running()?;
        session.check_key()?;
        if session.axis().is_some_and(AxisRef::is_target_reached) {
            return Ok(());
        }
        if end.now_ns > end_ns {
            return Err(Failure::Rejected(format!(
                "{}: the drive does not report that the target is reached (statusword bit 10)",
                session.label()
            )));
        }
    }
}

/// Waits until the actual position rests at the goal.
fn settle(session: &mut AxisSession, goal: f64, tolerance: f64) -> Result {
    let end_ns = session.now_ns().saturating_add(SETTLING.as_nanos() as u64);
    let mut at_goal = 0;
    while at_goal < REST_CYCLES {
        let end = session.cycle(None)?;
        session.check_running()?;
        session.check_key()?;
        let distance = (session.actual()? - goal).abs();
        at_goal = if distance <= tolerance { at_goal + 1 } else { 0 };
        if end.now_ns > end_ns {
            return Err(Failure::Rejected(format!(
                "{}: the axis is {} from its target after {} s; allowed: {}; see the following error, or \
                 set --tolerance",
                session.label(),
                session.units().length_text(distance),
                SETTLING.as_secs(),
                session.units().length_text(tolerance),
            )));
        }
    }
    Ok(())
}
