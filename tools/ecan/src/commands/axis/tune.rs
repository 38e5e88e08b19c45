//! `ecan axis tune`: response of the controllers of a drive to a step or a sweep, and the run of the test.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::{Args, ValueEnum};
use ecan_canopen::OperatingMode;
use ecan_cia402::{AxisRef, Decision};
use ecan_tool_support::command_line::options::{milliseconds, parse_svg_path};
use ecan_tool_support::plot;
use ecan_tool_support::print_error_line;
use serde::Serialize;

use super::axis_choice::ChosenAxis;
use super::enable;
use super::envelope::{
    Envelope, PositionBounds, PositionProfile, parse_number, parse_positive, velocity_factor,
};
use super::motion_arguments::MotionArguments;
use super::session::AxisSession;
use super::tune_analysis::{
    FrequencyPoint, Sample, StepResponse, TunePicture, frequencies, plot_failure,
};
use crate::context::{Context, Failure, Result};

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
        let bounds = bounds.filter(|bounds| bounds.min >= 0.01 && bounds.max <= 1_000.0);
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
    /// Time to record after the target is reached; with CSV also the time at the velocity
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = milliseconds::<u64>(10..=60_000))]
    settle: u64,
    /// Tolerance of the settling time, in UNIT or UNIT/s [default: 2 % of the step]
    #[arg(long, value_name = "TOLERANCE", value_parser = parse_positive)]
    tolerance: Option<f64>,
    /// Write a picture of the response
    #[arg(long, value_name = "FILE.svg", value_parser = parse_svg_path)]
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
    if let Some(path) = &arguments.plot {
        // A file that cannot be written is reported before the axis moves.
        plot::check_file(Some(path)).map_err(|error| plot_failure(path, error))?;
    }
    let chosen = motion.choose(context)?;
    let envelope = motion.envelope(&chosen)?;
    let test = TuneTest::of(
        arguments.mode == TuneMode::Csv,
        arguments.step.or(arguments.amplitude).unwrap_or(0.0),
        arguments.sweep.map(|sweep| (sweep.0, arguments.points)),
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
    let (mut recording, mut points, mut period_s) = (Vec::new(), Vec::new(), 0.0);
    let result = session.run(|session| {
        let (start, envelope) = enable::prepare_within(session, &motion.permission, &envelope)?;
        test.check_travel(start, &envelope, &chosen)?;
        enable::enable(session)?;
        period_s = session.target_period_s();
        let mut run = TuneRun::new(session, &test, envelope)?;
        let result = run.execute(session, &chosen);
        (recording, points) = (run.samples, run.points);
        result
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
        .write(path, (&recording, &points), &chosen.units),
        _ => Ok(()),
    };
    if let Err(failure) = result {
        // The error of the motion decides on the exit status.
        if let Err(error) = draw(Some(&failure)) {
            print_error_line!("ecan: {error}");
        }
        return Err(failure);
    }
    let drawn = draw(None);
    let unit = match arguments.mode {
        TuneMode::Csp => chosen.units.unit.to_string(),
        TuneMode::Csv => format!("{}/s", chosen.units.unit),
    };
    let tolerance = arguments.tolerance.map(|tolerance| chosen.units.length(tolerance).abs());
    let tolerance = tolerance.unwrap_or(test.size.abs() * 0.02).max(1.0);
    // With CSV the part until the velocity returns to 0.
    let part = recording.get(..test.end_of_step(&recording)).unwrap_or_default();
    let in_units = |steps: f64| chosen.units.value(steps).abs();
    let step = test.sweep.is_none().then(|| StepResponse::of(part, tolerance)).flatten();
    let step = step.map(|step| StepResponse {
        overshoot: in_units(step.overshoot),
        max_error: in_units(step.max_error),
        rms_error: in_units(step.rms_error),
        steady_error: chosen.units.value(step.steady_error),
        ..step
    });
    let largest = recording.iter().map(|sample| sample.error.abs()).fold(0.0, f64::max);
    let report = TuneReport {
        axis: chosen.label.clone(),
        mode: arguments.mode.name(),
        unit,
        period_ms: period_s * 1e3,
        samples: recording.len(),
        max_error: in_units(largest),
        step,
        sweep: points,
        picture: arguments
            .plot
            .as_ref()
            .filter(|_| drawn.is_ok())
            .map(|path| path.display().to_string()),
    };
    context.output.data(&report, |out| print(&report, &chosen, out))?;
    drawn
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
        crate::output::print(out, rows, |row| row)?;
    }
    if !report.sweep.is_empty() {
        let titles = ["HZ", "AMPLITUDE", "GAIN", "PHASE", "LARGEST ERROR"];
        crate::output::print_with_titles(out, titles, &report.sweep, |point| {
            [
                format!("{:.2}", point.hertz),
                format!("{} {unit}", number(point.amplitude)),
                format!("{:.3}, {:.2} dB", point.gain, point.gain_db()),
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

/// Periods of a frequency that are recorded, after one that is not.
const PERIODS: f64 = 3.0;
/// Most samples: ten minutes at 1 ms.
const SAMPLES: usize = 600_000;

/// A test with its recording.
pub struct TuneRun {
    test: TuneTest,
    envelope: Envelope,
    pub samples: Vec<Sample>,
    /// Measured points of a sweep.
    pub points: Vec<FrequencyPoint>,
    period_s: f64,
    /// Units of the drive's velocity per step/s.
    factor: f64,
    /// Accepted targets.
    sent: u64,
    start: f64,
}

impl TuneRun {
    pub fn new(session: &AxisSession, test: &TuneTest, envelope: Envelope) -> Result<Self> {
        let period_s = session.target_period_s();
        let seconds = match test.sweep {
            Some((bounds, count)) => frequencies(bounds.min, bounds.max, count)
                .map(|hertz| (PERIODS + 1.0) / hertz)
                .sum(),
            None => {
                test.settle * 2.0
                    + 2.0 * envelope.velocity / envelope.acceleration
                    + test.size.abs() / envelope.velocity
            }
        };
        // The cast saturates.
        let space = (seconds / period_s) as usize + 1_000;
        if space > SAMPLES {
            return Err(Failure::Usage(format!(
                "the test takes {seconds:.0} s; allowed: {:.0} s; use higher frequencies or fewer points",
                SAMPLES as f64 * period_s
            )));
        }
        let start = match test.is_velocity {
            true => 0.0,
            false => Ok(session.axis().and_then(AxisRef::target).map(f64::from))
                .and_then(|target| target.map_or_else(|| session.actual(), Ok))?,
        };
        Ok(Self {
            test: *test,
            envelope,
            samples: Vec::with_capacity(space),
            points: Vec::new(),
            period_s,
            factor: session.axis().map_or(1.0, |axis| velocity_factor(axis.config())),
            sent: 0,
            start,
        })
    }

    pub fn execute(&mut self, session: &mut AxisSession, chosen: &ChosenAxis) -> Result {
        session.report(format_args!("{} begins", self.test.name()));
        match (self.test.sweep, self.test.is_velocity) {
            (None, false) => self.step_position(session),
            (None, true) => self.step_velocity(session),
            (Some((bounds, count)), _) => {
                for hertz in frequencies(bounds.min, bounds.max, count) {
                    let point = self.frequency(session, hertz, chosen)?;
                    self.points.extend(point);
                }
                Ok(())
            }
        }
    }

    /// Sends a target in steps or steps/s, and records it when it is accepted.
    fn send(&mut self, session: &mut AxisSession, target: f64) -> Result {
        loop {
            let raw = match self.test.is_velocity {
                true => target * self.factor,
                false => target,
            };
            let end = session.cycle(Some(raw.round() as i32))?;
            session.check_running()?;
            session.check_key()?;
            // Otherwise the motion continues when targets are accepted again.
            if matches!(end.decision, Decision::Target(_)) {
                break;
            }
        }
        self.sent += 1;
        let axis = session.axis();
        let (actual, error) = match self.test.is_velocity {
            false => (
                axis.and_then(AxisRef::actual).map(f64::from),
                axis.and_then(AxisRef::following_error).map(|error| error as f64),
            ),
            true => {
                let velocity = axis.and_then(|axis| axis.status().inputs.velocity());
                let velocity = velocity.map(|velocity| f64::from(velocity) / self.factor);
                (velocity, velocity.map(|velocity| target - velocity))
            }
        };
        if let (Some(actual), true) = (actual, self.samples.len() < self.samples.capacity()) {
            let seconds = self.sent as f64 * self.period_s;
            let error = error.unwrap_or(target - actual);
            self.samples.push(Sample { seconds, target, actual, error });
        }
        Ok(())
    }

    fn hold(&mut self, session: &mut AxisSession, target: f64, seconds: f64) -> Result {
        let count = (seconds / self.period_s).ceil() as u64;
        (0..count).try_for_each(|_| self.send(session, target))
    }

    fn step_position(&mut self, session: &mut AxisSession) -> Result {
        let goal = (self.start + self.test.size).round();
        let mut profile = PositionProfile::at_rest(self.start);
        self.send(session, self.start)?;
        while !profile.is_at(goal) {
            profile = profile.toward(goal, self.envelope.profile(), self.period_s);
            self.send(session, profile.position())?;
        }
        self.hold(session, goal, self.test.settle)
    }

    fn step_velocity(&mut self, session: &mut AxisSession) -> Result {
        let change = self.envelope.acceleration * self.period_s;
        self.send(session, 0.0)?;
        let mut velocity = 0.0;
        for (goal, seconds) in [(self.test.size, self.test.settle), (0.0, self.test.settle)] {
            while velocity != goal {
                velocity += (goal - velocity).clamp(-change, change);
                self.send(session, velocity)?;
            }
            self.hold(session, goal, seconds)?;
        }
        Ok(())
    }

    /// Moves by a sine for whole periods; the first is not evaluated.
    fn frequency(
        &mut self,
        session: &mut AxisSession,
        hertz: f64,
        chosen: &ChosenAxis,
    ) -> Result<Option<FrequencyPoint>> {
        // Whole samples per period, so that the frequency is exact.
        let per_period = (1.0 / (hertz * self.period_s)).round().max(8.0);
        let hertz = 1.0 / (per_period * self.period_s);
        let amplitude = self.test.amplitude(hertz, &self.envelope);
        let begin = self.samples.len() + per_period as usize;
        let count = (per_period * (PERIODS + 1.0)) as u64;
        for nth in 1..=count {
            let angle = TAU * (nth as f64 / per_period).fract();
            let target = match self.test.is_velocity {
                true => amplitude * angle.sin(),
                false => self.start + amplitude / 2.0 * (1.0 - angle.cos()),
            };
            self.send(session, target)?;
        }
        let samples = self.samples.get(begin..).unwrap_or_default();
        let size = chosen.units.value(amplitude).abs();
        let point = FrequencyPoint::of(samples, hertz, size);
        Ok(point.map(|point| FrequencyPoint {
            max_error: chosen.units.value(point.max_error).abs(),
            ..point
        }))
    }
}

/// The motion of a test, in steps and seconds.
#[derive(Clone, Copy, Debug)]
pub struct TuneTest {
    pub is_velocity: bool,
    /// Size of the step, or amplitude of the sweep, with sign.
    pub size: f64,
    pub sweep: Option<(PositionBounds, u32)>,
    /// Time at the target, in seconds.
    pub settle: f64,
}

impl TuneTest {
    /// A test of this size, in the unit of the command line; `sweep`: frequencies and their number.
    pub fn of(
        is_velocity: bool,
        size: f64,
        sweep: Option<(PositionBounds, u32)>,
        settle: Duration,
        (chosen, envelope): (&ChosenAxis, &Envelope),
    ) -> Result<Self> {
        let steps = chosen.units.length(size);
        if steps.abs() < 1.0 {
            return Err(Failure::Usage(format!(
                "the size {size} {} is less than a step of the position counter; set a larger one",
                chosen.units.unit
            )));
        }
        if is_velocity && steps.abs() > envelope.velocity * (1.0 + 1e-9) {
            return Err(Failure::Usage(format!(
                "the velocity {} is out of range; allowed: up to {}",
                chosen.units.velocity_text(steps),
                chosen.units.velocity_text(envelope.velocity)
            )));
        }
        Ok(Self { is_velocity, size: steps, sweep, settle: settle.as_secs_f64() })
    }

    pub fn name(&self) -> &'static str {
        if self.sweep.is_some() { "sweep" } else { "step" }
    }

    /// Amplitude at a frequency within the limits: peak to peak of a position, peak of a velocity.
    pub fn amplitude(&self, hertz: f64, envelope: &Envelope) -> f64 {
        let omega = TAU * hertz;
        let most = match self.is_velocity {
            false => (envelope.velocity / (PI * hertz))
                .min(2.0 * envelope.acceleration / (omega * omega)),
            true => envelope.velocity.min(envelope.acceleration / omega),
        };
        self.size.abs().min(most).copysign(self.size)
    }

    /// Rejects a test that would leave the range.
    pub fn check_travel(&self, start: f64, envelope: &Envelope, chosen: &ChosenAxis) -> Result {
        let travel = match (self.is_velocity, self.sweep) {
            (false, _) => self.size,
            (true, None) => {
                self.size * self.settle + self.size * self.size.abs() / envelope.acceleration
            }
            (true, Some((bounds, _))) => {
                // Peak to peak of the position, at the lowest frequency.
                self.amplitude(bounds.min, envelope) / (PI * bounds.min)
            }
        };
        let end = start + travel;
        match envelope.contains(end) {
            true => Ok(()),
            false => Err(Failure::Usage(format!(
                "the test would move the axis to {}, outside the range; use a smaller size, another \
                 direction, or a larger --range",
                chosen.units.position_text(end)
            ))),
        }
    }

    /// Number of samples until a velocity step returns.
    pub fn end_of_step(&self, samples: &[Sample]) -> usize {
        if !self.is_velocity || self.sweep.is_some() {
            return samples.len();
        }
        samples
            .iter()
            .rposition(|sample| sample.target == self.size)
            .map_or(samples.len(), |at| at + 1)
    }
}
