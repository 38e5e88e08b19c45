//! `ecan axis tune`: response of the controllers of a drive to a step or a sweep.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::{Args, ValueEnum};
use ecan_canopen::OperatingMode;
use serde::Serialize;

use crate::context::{Context, Failure, Result};

use super::axis_choice::ChosenAxis;
use super::frequency_point::FrequencyPoint;
use super::limit_arguments::{PositionBounds, parse_number, parse_positive};
use super::motion_arguments::MotionArguments;
use super::session::AxisSession;
use super::startup;
use super::step_response::StepResponse;
use super::tune_picture::TunePicture;
use super::tune_run::TuneRun;
use super::tune_test::TuneTest;

pub const NOTES: &str = "\
--step moves the target by a distance (CSP), or to a velocity and back to 0 (CSV), within the limits
of velocity and acceleration: a larger --acceleration makes a harder step. --sweep moves it by sines
of rising frequency from the position of the start to one side; --amplitude is peak to peak in CSP,
the peak velocity in CSV, and is reduced where a limit requires it.

Errors are target minus actual value as the host sees them: they include the delay of the
communication, two cycles or more. Any key, Ctrl-C, a lost terminal or a closed pipe of standard
input ends the motion by quick stop (exit status 1). At the end the drive is switched off.";

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum TuneMode {
    #[default]
    Csp,
    Csv,
}

impl TuneMode {
    fn name(self) -> &'static str {
        match self {
            Self::Csp => "CSP",
            Self::Csv => "CSV",
        }
    }
}

/// `FROM..TO` in Hz.
#[derive(Clone, Copy, Debug)]
struct Frequencies(PositionBounds);

impl FromStr for Frequencies {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bounds: Option<PositionBounds> = text.parse().ok();
        let bounds = bounds.filter(|it| it.min >= 0.01 && it.max <= 1_000.0);
        bounds
            .map(Self)
            .ok_or_else(|| "expected FROM..TO in Hz, 0.01 to 1000, for example 0.5..20".to_owned())
    }
}

#[derive(Debug, Args)]
pub struct TuneArguments {
    /// Step by this distance, in UNIT, or with CSV to this velocity, in UNIT/s
    #[arg(long, value_name = "SIZE", value_parser = parse_number, allow_hyphen_values = true,
          required_unless_present = "sweep", conflicts_with = "sweep")]
    step: Option<f64>,
    /// Sweep these frequencies, in Hz
    #[arg(long, value_name = "FROM..TO", requires = "amplitude")]
    sweep: Option<Frequencies>,
    /// Amplitude of the sweep, in UNIT, or with CSV in UNIT/s; its sign is the direction
    #[arg(long, value_name = "AMPLITUDE", value_parser = parse_number, allow_hyphen_values = true)]
    amplitude: Option<f64>,
    /// Frequencies of the sweep
    #[arg(long, value_name = "N", default_value_t = 8,
          value_parser = clap::value_parser!(u32).range(1..=100))]
    points: u32,
    /// Operating mode
    #[arg(long, value_enum, default_value_t, value_name = "MODE")]
    mode: TuneMode,
    /// Time to record after the target is reached, in ms; with CSV also the time at the velocity
    #[arg(long, value_name = "MS", default_value_t = 500,
          value_parser = clap::value_parser!(u64).range(10..=60_000))]
    settle: u64,
    /// Tolerance of the settling time, in UNIT or UNIT/s [default: 2 % of the step]
    #[arg(long, value_name = "TOLERANCE", value_parser = parse_positive)]
    tolerance: Option<f64>,
    /// Write a picture (SVG)
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    motion: MotionArguments,
}

#[derive(Debug, Serialize)]
struct TuneReport {
    axis: String,
    mode: &'static str,
    /// Unit of the figures.
    unit: String,
    period_ms: f64,
    samples: usize,
    max_error: f64,
    step: Option<StepResponse>,
    sweep: Vec<FrequencyPoint>,
    picture: Option<String>,
}

pub fn run(arguments: &TuneArguments, context: &Context) -> Result {
    let motion = &arguments.motion;
    let chosen = motion.choose(context)?;
    let envelope = motion.envelope(&chosen)?;
    let test = TuneTest::of(
        arguments.mode == TuneMode::Csv,
        arguments.step.or(arguments.amplitude).unwrap_or(0.0),
        arguments.sweep.map(|it| (it.0, arguments.points)),
        Duration::from_millis(arguments.settle),
        (&chosen, &envelope),
    )?;
    let operator = motion.permission.obtain("tune", &chosen.label)?;
    let mode = match arguments.mode {
        TuneMode::Csp => OperatingMode::CyclicPosition,
        TuneMode::Csv => OperatingMode::CyclicVelocity,
    };
    let settings = motion.settings(mode, envelope, false);
    let session = AxisSession::start(&chosen, settings, Some(operator), context)?;
    let is_simulated = session.is_simulated();
    let (mut recording, mut period_s) = (Vec::new(), 0.0);
    let result = session.run(|session| {
        let (start, envelope) = startup::prepare_within(session, &motion.permission, &envelope)?;
        test.check_travel(start, &envelope, &chosen)?;
        startup::enable(session)?;
        period_s = session.target_period_s();
        let mut run = TuneRun::new(session, &test, envelope)?;
        let points = run.execute(session, &chosen);
        recording = run.samples;
        points
    });
    let draw = |end: Option<&Failure>| match &arguments.plot {
        Some(path) if !recording.is_empty() => TunePicture {
            title: format!("{}: {} {}", chosen.label, arguments.mode.name(), test.name()),
            subtitle: format!(
                "limits {} and {} {}/s^2, target period {} ms",
                chosen.units.velocity_text(envelope.velocity),
                chosen.units.number(chosen.units.value(envelope.acceleration).abs()),
                chosen.units.unit,
                period_s * 1e3
            ),
            is_velocity: test.is_velocity,
            is_simulated,
            end: end.map(|failure| format!("quick stop: {failure}")),
        }
        .write(path, &recording, &chosen.units),
        _ => Ok(()),
    };
    let points = match result {
        Ok(points) => points,
        Err(failure) => {
            // The error of the motion is reported in any case.
            let _ = draw(Some(&failure));
            return Err(failure);
        }
    };
    draw(None)?;
    let unit = match arguments.mode {
        TuneMode::Csp => chosen.units.unit.to_string(),
        TuneMode::Csv => format!("{}/s", chosen.units.unit),
    };
    let tolerance = arguments.tolerance.map(|it| chosen.units.length(it).abs());
    let tolerance = tolerance.unwrap_or(test.size.abs() * 0.02).max(1.0);
    // With CSV the part until the velocity returns to 0.
    let part = recording.get(..test.end_of_step(&recording)).unwrap_or_default();
    let in_units = |steps: f64| chosen.units.value(steps).abs();
    let step = test.sweep.is_none().then(|| StepResponse::of(part, tolerance)).flatten();
    let step = step.map(|it| StepResponse {
        overshoot: in_units(it.overshoot),
        max_error: in_units(it.max_error),
        rms_error: in_units(it.rms_error),
        steady_error: chosen.units.value(it.steady_error),
        ..it
    });
    let largest = recording.iter().map(|it| it.error.abs()).fold(0.0, f64::max);
    let report = TuneReport {
        axis: chosen.label.clone(),
        mode: arguments.mode.name(),
        unit,
        period_ms: period_s * 1e3,
        samples: recording.len(),
        max_error: in_units(largest),
        step,
        sweep: points,
        picture: arguments.plot.as_ref().map(|it| it.display().to_string()),
    };
    context.output.data(&report, |out| print(&report, &chosen, out))
}

fn print(
    report: &TuneReport,
    chosen: &ChosenAxis,
    out: &mut dyn std::io::Write,
) -> std::io::Result<()> {
    let number = |value: f64| chosen.units.number(value);
    let TuneReport { axis, mode, unit, .. } = report;
    writeln!(out, "{axis}, {mode}, {} samples every {} ms", report.samples, report.period_ms)?;
    if let Some(step) = &report.step {
        let settling = step.settling_s.map_or_else(
            || "not within the recorded time".to_owned(),
            |seconds| format!("{:.0} ms after the end of the target", seconds * 1e3),
        );
        let overshoot =
            format!("{} {unit} ({:.1} %)", number(step.overshoot), step.overshoot_percent);
        let rows = [
            ["overshoot".to_owned(), overshoot],
            ["settling time".to_owned(), settling],
            ["largest error".to_owned(), format!("{} {unit}", number(step.max_error))],
            ["RMS error".to_owned(), format!("{} {unit}", number(step.rms_error))],
            ["error at the end".to_owned(), format!("{} {unit}", number(step.steady_error))],
        ];
        crate::table::print(out, rows, |row| row)?;
    }
    if !report.sweep.is_empty() {
        let titles = ["HZ", "AMPLITUDE", "GAIN", "PHASE", "LARGEST ERROR"];
        crate::table::print_with_titles(out, titles, &report.sweep, |point| {
            [
                format!("{:.2}", point.hertz),
                format!("{} {unit}", number(point.amplitude)),
                format!("{:.3}", point.gain),
                format!("{:.1} deg", point.phase_deg),
                format!("{} {unit}", number(point.max_error)),
            ]
        })?;
    }
    match &report.picture {
        Some(picture) => writeln!(out, "picture: {picture}"),
        None => Ok(()),
    }
}
