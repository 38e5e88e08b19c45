//! Recorded motion of the axes, as diagrams of positions and following errors.

use std::ops::Range;

use ecan_cia402::{AxisError, AxisPhase, AxisProgress, Cia402, Decision, TargetRejection};
use ecan_lite::canopen::{EmcyLog, error_code_text};

use super::canvas::{AxisKind, Heading};
use super::curve_figure::{
    Band, BandKind, CurveFigure, CurvePanel, CurveStack, Mark, Series, Tone,
};

/// Positions of an axis in one cycle, in increments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisSample {
    /// Time in seconds.
    pub seconds: f64,
    /// Target; `None` for an axis that follows none.
    pub target: Option<i32>,
    /// Actual position.
    pub actual: Option<i32>,
    /// Target minus actual position.
    pub following_error: Option<i64>,
}

/// A change of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisEvent {
    /// The axis entered a phase.
    Phase(AxisPhase),
    /// A command failed, or the drive has a fault.
    Error(AxisError),
    /// The drive sent an emergency message with this error code.
    Emergency(u16),
    /// The motion guard rejected a target.
    Rejected(TargetRejection),
}

impl AxisEvent {
    /// Kind of the period without motion by targets that the event begins.
    fn band(self) -> Option<BandKind> {
        match self {
            Self::Phase(AxisPhase::Holding(_)) => Some(BandKind::Hold),
            Self::Phase(AxisPhase::Fault | AxisPhase::ResettingFault) => Some(BandKind::Fault),
            Self::Phase(
                AxisPhase::Stopping(_) | AxisPhase::Stopped(_) | AxisPhase::Uncontrolled(_),
            ) => Some(BandKind::Stop),
            _ => None,
        }
    }

    fn is_fault(self) -> bool {
        match self {
            Self::Error(_) | Self::Emergency(_) => true,
            Self::Phase(AxisPhase::Fault) => true,
            Self::Phase(_) | Self::Rejected(_) => false,
        }
    }

    fn text(self) -> String {
        match self {
            Self::Phase(phase) => phase.to_string(),
            Self::Error(error) => error.to_string(),
            Self::Emergency(code) => {
                let name =
                    error_code_text(code).map_or_else(String::new, |name| format!(" ({name})"));
                format!("emergency message, error code 0x{code:04X}{name}")
            }
            Self::Rejected(rejection) => format!("target rejected: {rejection}"),
        }
    }
}

/// Most recorded events of an axis.
const EVENTS: usize = 128;

/// Recorded motion of one axis. Recording allocates nothing after [`AxisTrace::new`].
#[derive(Debug)]
pub struct AxisTrace {
    samples: Vec<AxisSample>,
    /// Sample with the largest following error since the last one kept, so that no peak is lost.
    pending: Option<AxisSample>,
    events: Vec<(f64, AxisEvent)>,
    lost_events: u64,
}

impl AxisTrace {
    /// Creates a trace with space for this number of samples.
    pub fn new(samples: usize) -> Self {
        Self {
            samples: Vec::with_capacity(samples),
            pending: None,
            events: Vec::with_capacity(EVENTS),
            lost_events: 0,
        }
    }

    /// Adds the positions of a cycle; `is_kept` ends an interval, of which the sample with the
    /// largest following error is kept. Samples beyond the space of the trace are dropped.
    pub fn record(&mut self, sample: AxisSample, is_kept: bool) {
        let size = |sample: &AxisSample| sample.following_error.map_or(0, i64::unsigned_abs);
        if self.pending.is_none_or(|pending| size(&pending) <= size(&sample)) {
            self.pending = Some(sample);
        }
        if is_kept && self.samples.len() < self.samples.capacity() {
            self.samples.extend(self.pending.take());
        }
    }

    /// Adds an event; those beyond the first 128 are counted.
    pub fn record_event(&mut self, seconds: f64, event: AxisEvent) {
        match self.events.len() < EVENTS {
            true => self.events.push((seconds, event)),
            false => self.lost_events += 1,
        }
    }

    /// Returns whether the drive reports the error code of an emergency message as its fault, too.
    fn has_fault_of(&self, code: u16) -> bool {
        let is_same = |event: &(f64, AxisEvent)| matches!(event.1, AxisEvent::Error(AxisError::Fault { error_code }) if error_code == code);
        self.events.iter().any(is_same)
    }

    /// Samples with that of an interval which the end of the run cut short.
    fn all_samples(&self) -> impl Iterator<Item = &AxisSample> {
        self.samples.iter().chain(&self.pending)
    }

    /// Recorded samples.
    pub fn samples(&self) -> &[AxisSample] {
        &self.samples
    }

    /// Largest following error, in increments; `None` without one.
    pub fn largest_following_error(&self) -> Option<u64> {
        self.all_samples().filter_map(|sample| sample.following_error).map(i64::unsigned_abs).max()
    }

    /// Returns the panels of the axis: positions, and the following error below.
    pub fn panels(&self, title: &str) -> [CurvePanel; 2] {
        let (bands, mut marks) = self.marks();
        if self.lost_events > 0 {
            let seconds = self.events.last().map_or(0.0, |event| event.0);
            let text = format!("{} more events, not recorded", self.lost_events);
            marks.push(Mark { seconds, text, is_fault: false });
        }
        let series = |name: &str, tone, value: fn(&AxisSample) -> Option<f64>| Series {
            name: name.to_owned(),
            tone,
            points: self.all_samples().map(|sample| (sample.seconds, value(sample))).collect(),
        };
        let largest = self.largest_following_error();
        let largest = largest.map_or("none".to_owned(), |error| format!("largest {error} inc"));
        let positions = CurvePanel {
            title: title.to_owned(),
            y_label: "position [inc]".to_owned(),
            y_kind: AxisKind::Count,
            least_width: 4.0,
            series: vec![
                series("target", Tone::Target, |sample| sample.target.map(f64::from)),
                series("actual position", Tone::Actual, |sample| sample.actual.map(f64::from)),
            ],
            bands: bands.clone(),
            marks: marks.clone(),
            has_texts: true,
            ..CurvePanel::default()
        };
        let error = CurvePanel {
            title: format!("following error: {largest}"),
            y_label: "error [inc]".to_owned(),
            y_kind: AxisKind::Count,
            least_width: 4.0,
            series: vec![series("target - actual position", Tone::Difference, |sample| {
                sample.following_error.map(|error| error as f64)
            })],
            bands,
            marks,
            ..CurvePanel::default()
        };
        [positions, error]
    }

    fn marks(&self) -> (Vec<Band>, Vec<Mark>) {
        let sampled = self.all_samples().last().map_or(0.0, |sample| sample.seconds);
        let end = self.events.last().map_or(sampled, |event| sampled.max(event.0));
        let (mut bands, mut marks) = (Vec::new(), Vec::new());
        for (number, &(seconds, event)) in self.events.iter().enumerate() {
            // The message and the status of the same fault are one event.
            if matches!(event, AxisEvent::Emergency(code) if self.has_fault_of(code)) {
                continue;
            }
            let later = self.events.get(number + 1..).unwrap_or_default();
            let is_phase = |event: &&(f64, AxisEvent)| matches!(event.1, AxisEvent::Phase(_));
            let until = later.iter().find(is_phase).map_or(end, |event| event.0);
            let text = event.text();
            match event.band() {
                Some(kind) => {
                    let seconds = Range { start: seconds, end: until.max(seconds) };
                    bands.push(Band { seconds, text, kind });
                }
                None => marks.push(Mark { seconds, text, is_fault: event.is_fault() }),
            }
        }
        (bands, marks)
    }
}

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
    /// Emergency messages; `None` before the first cycle.
    emergencies: Option<u32>,
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

    /// Records a cycle at a time in seconds: positions, changed phases, errors, emergency messages,
    /// rejected targets. Allocates nothing.
    pub fn record(&mut self, seconds: f64, cycle: u64, cia402: &Cia402) {
        let is_kept = cycle % self.interval == self.interval - 1;
        for (axis, (trace, observed)) in cia402.axes().zip(&mut self.axes) {
            let (target, actual) = (axis.target(), axis.actual());
            let following_error = axis.following_error();
            trace.record(AxisSample { seconds, target, actual, following_error }, is_kept);
            let phase = axis.phase();
            if observed.phase != Some(phase) {
                // A run starts with an axis that follows targets.
                let is_start = observed.phase.is_none() && phase == AxisPhase::Running;
                if !is_start {
                    trace.record_event(seconds, AxisEvent::Phase(phase));
                }
            }
            observed.phase = Some(phase);
            let error = axis.error().filter(|error| !matches!(error, AxisError::Held(_)));
            if let (Some(new), true) = (error, error != observed.error) {
                trace.record_event(seconds, AxisEvent::Error(new));
            }
            observed.error = error;
            let rejection = match axis.decision() {
                Decision::Reject(rejection) => Some(rejection),
                _ => None,
            };
            if let (Some(rejection), false) = (rejection, observed.is_rejected) {
                trace.record_event(seconds, AxisEvent::Rejected(rejection));
            }
            observed.is_rejected = rejection.is_some();
            let emergencies = axis.statistics().emergencies;
            if observed.emergencies.is_some_and(|before| emergencies > before) {
                let code = cia402.network().emcy(axis.node()).map_or(0, EmcyLog::last_code);
                // The code 0 reports that there is no error any more.
                if code != 0 {
                    trace.record_event(seconds, AxisEvent::Emergency(code));
                }
            }
            observed.emergencies = Some(emergencies);
        }
    }

    /// Records an error or a fault that is found after the last cycle, while the drives are being
    /// stopped.
    pub fn record_progress(&mut self, seconds: f64, progress: &AxisProgress) {
        let Some((trace, observed)) = self.axes.get_mut(progress.axis) else { return };
        let phase = progress.phase;
        if phase == AxisPhase::Fault && observed.phase != Some(phase) {
            trace.record_event(seconds, AxisEvent::Phase(phase));
            observed.phase = Some(phase);
        }
        let error = progress.error.filter(|error| !matches!(error, AxisError::Held(_)));
        if let (Some(new), true) = (error, error != observed.error) {
            trace.record_event(seconds, AxisEvent::Error(new));
        }
        observed.error = error;
    }

    /// Recorded motion of an axis; `None` for an axis that does not exist.
    pub fn trace(&self, axis: usize) -> Option<&AxisTrace> {
        self.axes.get(axis).map(|recorded| &recorded.0)
    }

    /// Returns the figure of all axes: positions and following error of each.
    pub fn figure(&self, heading: Heading, cia402: &Cia402) -> CurveFigure {
        let mut panels = Vec::with_capacity(2 * self.axes.len());
        for (axis, (trace, _)) in cia402.axes().zip(&self.axes) {
            let title =
                format!("axis {}: {}, {}", axis.index(), axis.config().address, axis.mode());
            let [positions, error] = trace.panels(&title);
            panels.extend([(positions, POSITION_HEIGHT), (error, ERROR_HEIGHT)]);
        }
        if let Some((_, height)) = panels.last_mut() {
            *height += TIME_HEIGHT;
        }
        let x_label = "time since the start of motion [s]".to_owned();
        CurveFigure {
            heading,
            stacks: vec![CurveStack { x_label, x_kind: AxisKind::Linear, panels }],
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_cia402::HoldReason;

    use super::*;

    fn sample(seconds: f64, following_error: i64) -> AxisSample {
        let actual = Some(0);
        let target = i32::try_from(following_error).ok();
        AxisSample { seconds, target, actual, following_error: Some(following_error) }
    }

    #[test]
    fn peak_between_two_kept_cycles_is_recorded() {
        let mut trace = AxisTrace::new(2);
        for (cycle, error) in [1, -90, 3, 4, 5, 6].into_iter().enumerate() {
            trace.record(sample(cycle as f64, error), cycle % 3 == 2);
        }
        assert_eq!(trace.samples(), [sample(1.0, -90), sample(5.0, 6)]);
        assert_eq!(trace.largest_following_error(), Some(90));
        trace.record(sample(9.0, 100), true);
        assert_eq!(trace.samples().len(), 2, "the space is used up");
    }

    #[test]
    fn hold_lasts_until_the_next_phase() {
        let mut trace = AxisTrace::new(8);
        trace.record(sample(9.0, 0), true);
        let hold = AxisPhase::Holding(HoldReason::BusOff);
        trace.record_event(1.0, AxisEvent::Phase(hold));
        trace.record_event(2.5, AxisEvent::Phase(AxisPhase::Running));
        trace.record_event(4.0, AxisEvent::Phase(AxisPhase::Fault));
        let [positions, error] = trace.panels("axis 0");
        let seconds: Vec<_> = positions.bands.iter().map(|band| band.seconds.clone()).collect();
        assert_eq!(seconds, [1.0..2.5, 4.0..9.0]);
        assert_eq!(positions.bands, error.bands);
        assert_eq!(positions.bands[0].text, "holding: the channel went bus-off");
        let text = "following targets".into();
        assert_eq!(positions.marks, [Mark { seconds: 2.5, text, is_fault: false }]);
    }

    #[test]
    fn fault_during_a_hold_has_its_own_band_and_mark() {
        let mut trace = AxisTrace::new(8);
        trace.record(sample(9.0, 0), true);
        let hold = AxisPhase::Holding(HoldReason::BusOff);
        trace.record_event(1.0, AxisEvent::Phase(hold));
        trace.record_event(2.0, AxisEvent::Emergency(0x2310));
        trace.record_event(2.5, AxisEvent::Phase(AxisPhase::Fault));
        trace.record_event(2.5, AxisEvent::Error(AxisError::Fault { error_code: 0x2310 }));
        trace.record_event(4.0, AxisEvent::Emergency(0x8611));
        let [positions, _] = trace.panels("axis 0");
        let kinds: Vec<_> = positions.bands.iter().map(|band| band.kind).collect();
        assert_eq!(kinds, [BandKind::Hold, BandKind::Fault]);
        let texts: Vec<_> = positions.marks.iter().map(|mark| mark.text.as_str()).collect();
        assert!(texts[0].starts_with("the drive is in fault, error code 0x2310"), "{texts:?}");
        assert!(texts[1].starts_with("emergency message, error code 0x8611"), "{texts:?}");
        assert!(texts.len() == 2 && positions.marks.iter().all(|mark| mark.is_fault));
    }

    #[test]
    fn events_beyond_the_space_are_counted() {
        let mut trace = AxisTrace::new(1);
        (0..EVENTS + 3).for_each(|_| trace.record_event(1.0, AxisEvent::Phase(AxisPhase::Fault)));
        let [positions, _] = trace.panels("");
        assert_eq!(positions.marks[0].text, "3 more events, not recorded");
    }
}
