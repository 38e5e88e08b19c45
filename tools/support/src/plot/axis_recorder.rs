use ecan_cia402::{AxisError, AxisPhase, Cia402, Decision};

use crate::plot::axis_trace::{AxisEvent, AxisSample, AxisTrace};
use crate::plot::heading::Heading;
use crate::plot::time_figure::TimeFigure;

/// Most samples per axis.
const SAMPLES: u64 = 2_000;
const POSITION_HEIGHT: u32 = 260;
const ERROR_HEIGHT: u32 = 170;
/// Additional height of the last panel, for the name of the time.
const TIME_HEIGHT: u32 = 22;

/// Last observations of an axis, to find changes.
#[derive(Debug, Clone, Copy, Default)]
struct Observed {
    phase: Option<AxisPhase>,
    error: Option<AxisError>,
    is_rejected: bool,
}

/// Recorded motion of the axes of a context, drawn after the run.
#[derive(Debug)]
pub struct AxisRecorder {
    /// Cycles per sample.
    interval: u64,
    axes: Vec<(AxisTrace, Observed)>,
}

impl AxisRecorder {
    /// Creates a recorder for this number of axes and cycles.
    pub fn new(axes: usize, cycles: u64) -> Self {
        let interval = cycles.div_ceil(SAMPLES).max(1);
        let samples = usize::try_from(cycles / interval + 1).unwrap_or(0);
        // A clone of a trace would have no space.
        let axes = (0..axes).map(|_| (AxisTrace::new(samples), Observed::default())).collect();
        Self { interval, axes }
    }

    /// Records a cycle at a time in seconds: positions, changed phases, errors, rejected
    /// targets. Allocates
    /// nothing.
    pub fn record(&mut self, seconds: f64, cycle: u64, cia402: &Cia402) {
        let is_kept = cycle % self.interval == self.interval - 1;
        for (axis, (trace, observed)) in self.axes.iter_mut().enumerate() {
            let (target, actual) = (cia402.target(axis), cia402.actual(axis));
            let following_error = cia402.following_error(axis);
            trace.record(AxisSample { seconds, target, actual, following_error }, is_kept);
            let phase = cia402.phase(axis);
            if let (Some(new), true) = (phase, phase != observed.phase) {
                // A run starts with an axis that follows targets.
                let is_start = observed.phase.is_none() && new == AxisPhase::Running;
                if !is_start {
                    trace.record_event(seconds, AxisEvent::Phase(new));
                }
            }
            observed.phase = phase;
            let error = cia402.error(axis).filter(|error| !matches!(error, AxisError::Held(_)));
            if let (Some(new), true) = (error, error != observed.error) {
                trace.record_event(seconds, AxisEvent::Error(new));
            }
            observed.error = error;
            let rejection = match cia402.decision(axis) {
                Decision::Reject(rejection) => Some(rejection),
                _ => None,
            };
            if let (Some(rejection), false) = (rejection, observed.is_rejected) {
                trace.record_event(seconds, AxisEvent::Rejected(rejection));
            }
            observed.is_rejected = rejection.is_some();
        }
    }

    /// Recorded motion of an axis; `None` for an axis that does not exist.
    pub fn trace(&self, axis: usize) -> Option<&AxisTrace> {
        self.axes.get(axis).map(|it| &it.0)
    }

    /// Returns the figure of all axes: positions and following error of each.
    pub fn figure(&self, heading: Heading, cia402: &Cia402) -> TimeFigure {
        let mut panels = Vec::with_capacity(2 * self.axes.len());
        for (axis, (trace, _)) in self.axes.iter().enumerate() {
            let address = cia402.config(axis).map(|config| config.address.to_string());
            let mode = cia402.mode(axis).map_or_else(String::new, |mode| format!(", {mode}"));
            let title = format!("axis {axis}: {}{mode}", address.unwrap_or_default());
            let [positions, error] = trace.panels(&title);
            panels.extend([(positions, POSITION_HEIGHT), (error, ERROR_HEIGHT)]);
        }
        if let Some((_, height)) = panels.last_mut() {
            *height += TIME_HEIGHT;
        }
        TimeFigure { heading, x_label: "time since the start of motion [s]".to_owned(), panels }
    }
}
