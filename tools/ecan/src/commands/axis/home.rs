//! `ecan axis home`: homing by the drive.

use std::time::Duration;

use clap::Args;
use ecan_canopen::OperatingMode;
use ecan_cia402::{AxisCommand, AxisError, AxisPhase, AxisRef, HomingConfig};
use ecan_tool_support::command_line::options::seconds;
use serde::Serialize;

use super::enable;
use super::envelope::{Envelope, parse_number, parse_positive};
use super::motion_arguments::MotionArguments;
use super::session::AxisSession;
use crate::context::{Context, Failure, Result};

pub const NOTES: &str = "\
The drive generates the motion, by the method 0x6098. Speeds and acceleration are always written, so that
--max-velocity limits them. --range is the allowed travel relative to the position at the start:
-360..10 allows 360 units in negative and 10 in positive direction. The host watches velocity and
travel, and sends a quick stop when a limit is exceeded, a key is pressed, or the operator is lost.
At the end the drive is switched off.";

#[derive(Debug, Args)]
pub struct HomeArguments {
    /// Homing method 0x6098; 35 and 37 take the present position, 1 to 34 look for switches
    #[arg(long, value_name = "N", allow_hyphen_values = true,
          value_parser = clap::value_parser!(i8).range(-128..=37))]
    method: i8,
    /// Speed toward the switch 0x6099:01, in UNIT/s [default: --max-velocity]
    #[arg(long, value_name = "VELOCITY", value_parser = parse_positive)]
    switch_speed: Option<f64>,
    /// Speed toward the zero 0x6099:02, in UNIT/s [default: a tenth of the other]
    #[arg(long, value_name = "VELOCITY", value_parser = parse_positive)]
    zero_speed: Option<f64>,
    /// Position that the home position gets 0x607C, in UNIT [default: unchanged]
    #[arg(long, value_name = "POSITION", value_parser = parse_number, allow_hyphen_values = true)]
    offset: Option<f64>,
    /// Longest time of the homing
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = seconds::<u64>(1..=3_600))]
    timeout: u64,
    #[command(flatten)]
    motion: MotionArguments,
}

#[derive(Debug, Serialize)]
struct Homed {
    axis: String,
    method: i8,
    unit: String,
    position: f64,
    seconds: f64,
}

pub fn run(arguments: &HomeArguments, context: &Context) -> Result {
    let motion = &arguments.motion;
    let chosen = motion.choose(context)?;
    let units = chosen.units;
    // Positions before the homing mean nothing; velocity and acceleration do.
    let mut unbounded = chosen.config.clone();
    unbounded.bounds = None;
    let envelope = motion.limits.envelope(&units, &unbounded).map_err(Failure::Usage)?;
    let switch_speed = arguments
        .switch_speed
        .map_or(envelope.velocity, |switch_speed| units.length(switch_speed).abs());
    let zero_speed = arguments
        .zero_speed
        .map_or(switch_speed / 10.0, |zero_speed| units.length(zero_speed).abs());
    for (option, speed) in [("--switch-speed", switch_speed), ("--zero-speed", zero_speed)] {
        if speed > envelope.velocity * (1.0 + 1e-9) {
            return Err(Failure::Usage(format!(
                "{option} {} is out of range; allowed: up to {}",
                units.velocity_text(speed),
                units.velocity_text(envelope.velocity)
            )));
        }
    }
    let range = motion.limits.range();
    if range.min > 0.0 || range.max < 0.0 {
        return Err(Failure::Usage(format!(
            "--range {}..{} of `home` is relative to the start; must include 0",
            range.min, range.max
        )));
    }
    let drive = |speed: f64| envelope.drive_units(&chosen.config, speed);
    let homing = HomingConfig {
        switch_speed: Some(drive(switch_speed)),
        zero_speed: Some(drive(zero_speed)),
        acceleration: Some(drive(envelope.acceleration)),
        offset: arguments.offset.map(|offset| units.steps(offset).round() as i32),
        timeout: Duration::from_secs(arguments.timeout),
        ..HomingConfig::new(arguments.method)
    };
    let operator = motion.permission.obtain("home", &chosen.label)?;
    // The counter after homing is anywhere.
    let anywhere = Envelope { min: i32::MIN, max: i32::MAX, ..envelope };
    let settings = motion.settings(OperatingMode::CyclicPosition, anywhere, false);
    let session = AxisSession::start(&chosen, settings, Some(operator), context)?;
    let homed = session.run(|session| {
        let start = enable::prepare(session, &motion.permission)?;
        let travel = |value: f64| (start + units.length(value)) as i32;
        let (a, b) = (travel(range.min), travel(range.max));
        session.watch_envelope(Envelope { min: a.min(b), max: a.max(b), ..envelope });
        enable::await_key(session)?;
        session.report(format_args!("homing by method {}", arguments.method));
        let begin_ns = session.now_ns();
        home(session, homing)?;
        let seconds = session.now_ns().saturating_sub(begin_ns) as f64 / 1e9;
        Ok(Homed {
            axis: chosen.label.clone(),
            method: arguments.method,
            unit: units.unit.to_string(),
            position: units.position(session.actual()?),
            seconds,
        })
    })?;
    context.output.data(&homed, |out| {
        let Homed { axis, method, unit, position, seconds } = &homed;
        let position = units.number(*position);
        writeln!(
            out,
            "{axis}: homed by method {method} in {seconds:.2} s, now at {position} {unit}"
        )
    })
}

fn home(session: &mut AxisSession, homing: HomingConfig) -> Result {
    session.command(AxisCommand::Home(homing))?;
    loop {
        session.cycle(None)?;
        session.check_key()?;
        let axis = session.axis();
        let is_busy = matches!(
            axis.map(AxisRef::phase),
            Some(
                AxisPhase::ChangingMode(_)
                    | AxisPhase::PreparingHoming
                    | AxisPhase::Homing(_)
                    | AxisPhase::Uncontrolled(_)
            )
        );
        match axis.and_then(AxisRef::error).filter(|error| !matches!(error, AxisError::Held(_))) {
            Some(error) if !is_busy => {
                return Err(Failure::Rejected(format!("{}: {error}", session.label())));
            }
            None if !is_busy => return Ok(()),
            _ => {}
        }
    }
}
