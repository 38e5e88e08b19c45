//! Observations of a motion demo: progress of the axes, plot, table and summary.

use std::collections::{HashMap, HashSet};
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use ecan_canopen::{EmcyLog, error_code_text};
use ecan_cia402::{AxisError, AxisPhase, AxisProgress, AxisRef, Cia402, LoadWarning};
use ecan_host::Clock;
use ecan_mcan_port::{BusChange, Port};
use ecan_tool_support::plot::{AxisRecorder, Heading, PlotError};
use ecan_tool_support::print_line;
use indicatif::ProgressBar;

use crate::{program, real_time};

pub struct MotionRecord {
    printer: ProgressPrinter,
    recorder: AxisRecorder,
    progress: ProgressBar,
    clock: Arc<dyn Clock>,
    start_ns: u64,
    /// Axes at the end of the motion.
    lines: Vec<AxisLine>,
    /// Axes whose drives were found in fault while they were being stopped.
    late_faults: HashSet<usize>,
}

impl MotionRecord {
    /// Starts now, and prints the load of the buses.
    pub fn new(port: &Port, cia402: &Cia402, cycles: u64) -> Self {
        print_loads(cia402, port);
        let clock = port.adapter().ecrt().clock().clone();
        Self {
            printer: ProgressPrinter::new(cia402.axis_count()),
            recorder: AxisRecorder::new(cia402.axis_count(), cycles),
            progress: program::bar(cycles),
            start_ns: clock.now_ns(),
            clock,
            lines: Vec::new(),
            late_faults: HashSet::new(),
        }
    }

    pub fn print_progress(&mut self, axis: &AxisProgress) {
        self.printer.print(axis);
    }

    /// Prints the progress of the shutdown; an error that it finds goes into the plot.
    pub fn on_shutdown(&mut self, axis: &AxisProgress) {
        let seconds = (self.clock.now_ns() - self.start_ns) as f64 / 1e9;
        self.recorder.record_progress(seconds, axis);
        if axis.phase == AxisPhase::Fault {
            self.late_faults.insert(axis.axis);
        }
        self.printer.print(axis);
    }

    /// Reports that all axes are active, which drives would not stop if the host were lost, and
    /// starts the time of the plot.
    pub fn start_motion(&mut self, cia402: &Cia402, cycles: u64) {
        cia402.host_loss_risks().for_each(|risk| print_line!("warning: {risk}"));
        if cia402.host_loss_risks().next().is_none() {
            print_line!("all drives stop if the host is lost");
        }
        let now_ns = self.clock.now_ns();
        let seconds = (now_ns - self.start_ns) as f64 / 1e9;
        print_line!("all axes enabled after {seconds:.2} s, {cycles} cycles of motion");
        self.start_ns = now_ns;
    }

    /// Records a cycle for the plot; prints what changed on the bus, and the axes' progress if an axis rejected its
    /// target.
    pub fn end_cycle(
        &mut self,
        cycle: u64,
        changes: impl Iterator<Item = BusChange>,
        cia402: &Cia402,
        has_rejected: bool,
    ) {
        let seconds = (self.clock.now_ns() - self.start_ns) as f64 / 1e9;
        self.recorder.record(seconds, cycle, cia402);
        changes.for_each(|change| self.progress.suspend(|| print_line!("{change}")));
        if has_rejected {
            let printer = &mut self.printer;
            self.progress
                .suspend(|| cia402.axes().for_each(|axis| printer.print(&axis.progress())));
        }
        self.progress.set_position(cycle);
    }

    /// Prints the statistics of the cycle and writes the picture to the file, if one is given.
    pub fn finish(
        &self,
        port: &Port,
        cia402: &Cia402,
        plot: Option<&Path>,
        heading: Heading,
    ) -> Result<(), PlotError> {
        if let Some(statistics) = port.adapter().cycle_statistics() {
            real_time::print_statistics(port.adapter(), statistics);
        }
        match plot {
            None => Ok(()),
            Some(path) => self.recorder.figure(heading, cia402).write(path),
        }
    }

    /// Notes the axes at the end of the motion, for the [`table`](Self::table).
    pub fn end_motion(&mut self, cia402: &Cia402) {
        self.progress.finish_and_clear();
        self.lines = cia402.axes().map(AxisLine::of).collect();
    }

    /// One line per axis at the end of the motion; below it holds, errors and faults, also those that the
    /// shutdown found: a drive that was silent reports its fault late.
    pub fn table(&self, cia402: &Cia402) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "\n{:<38}{:<20}{:>11}{:>11}{:>8}{:>8}{:>8}{:>7}{:>6}",
            "axis", "state", "target", "actual", "error", "max", "TPDOs", "lost", "EMCY"
        );
        for (line, axis) in self.lines.iter().zip(cia402.axes()) {
            let _ = writeln!(text, "{}", line.text);
            let statistics = axis.statistics();
            if let Some(reason) = statistics.last_hold {
                let _ = writeln!(text, "   held {} time(s), last: {reason}", statistics.holds);
            }
            if let Some(error) = line.error {
                let _ = writeln!(text, "   {error}");
            }
            let later = axis.error().filter(|error| line.error != Some(*error));
            let is_fault = |error: &AxisError| matches!(error, AxisError::Fault { .. });
            let is_shown = [line.error, later].iter().flatten().any(is_fault);
            if let Some(error) = later {
                let _ = writeln!(text, "   found while stopping: {error}");
            } else if !is_shown && self.late_faults.contains(&axis.index()) {
                let _ = writeln!(text, "   found while stopping: the drive is in fault");
            }
            // Another error may have replaced that of a fault.
            let code = cia402.network().emcy(axis.node()).map_or(0, EmcyLog::last_code);
            let has_message = statistics.emergencies > 0 && code != 0;
            if !is_shown && statistics.faults > 0 {
                let _ = writeln!(text, "   faults of the drive: {}", statistics.faults);
            }
            if !is_shown && has_message {
                let name =
                    error_code_text(code).map_or_else(String::new, |name| format!(" ({name})"));
                let _ = writeln!(text, "   last emergency message: error code 0x{code:04X}{name}");
            }
        }
        text
    }
}

/// Prints each phase of one axis; of several axes what concerns one of them, and each phase that all of
/// them have entered.
struct ProgressPrinter {
    axis_count: usize,
    printed: HashMap<usize, String>,
    /// Axes that have entered a phase.
    entered: HashMap<String, HashSet<usize>>,
}

impl ProgressPrinter {
    fn new(axis_count: usize) -> Self {
        Self { axis_count, printed: HashMap::new(), entered: HashMap::new() }
    }

    fn print(&mut self, progress: &AxisProgress) {
        let phase = progress.phase.to_string();
        let printed = self.printed.entry(progress.axis).or_default();
        if *printed == phase {
            return;
        }
        printed.clone_from(&phase);
        if self.axis_count == 1 || concerns_one(progress) {
            print_line!("  {progress}");
            return;
        }
        let axes = self.entered.entry(phase).or_default();
        axes.insert(progress.axis);
        if axes.len() == self.axis_count {
            axes.clear();
            print_line!("  all {} axes: {}", self.axis_count, progress.phase);
        }
    }
}

/// Returns whether the other axes need not enter this phase.
fn concerns_one(progress: &AxisProgress) -> bool {
    let is_own_phase = match progress.phase {
        AxisPhase::SetupFailed
        | AxisPhase::Holding(_)
        | AxisPhase::Uncontrolled(_)
        | AxisPhase::ResettingFault
        | AxisPhase::Fault => true,
        AxisPhase::Stopping(cause) | AxisPhase::Stopped(cause) => !cause.is_commanded(),
        _ => false,
    };
    is_own_phase || progress.error.is_some()
}

fn print_loads(cia402: &Cia402, port: &Port) {
    for load in cia402.bus_load(port) {
        let percent = |share: f64| share * 100.0;
        print_line!(
            "slave {} can{}: {} axes, {} + {} frames per cycle, bus load {:.0} to {:.0} %{}",
            load.slave,
            load.channel,
            load.axes,
            load.frames_out,
            load.frames_in,
            percent(load.least),
            percent(load.most),
            match load.warning() {
                None => "",
                Some(LoadWarning::TooMuch) => "; too high: use a longer cycle",
                Some(LoadWarning::Budget) => "; more frames than the gateway serves per cycle",
                Some(LoadWarning::Tight) => "; too high in the worst case of stuff bits",
                Some(LoadWarning::NoReserve) => "; little reserve for SDO and heartbeats",
            }
        );
    }
}

/// An axis at the end of the motion.
pub struct AxisLine {
    text: String,
    error: Option<AxisError>,
}

impl AxisLine {
    /// State, target, actual position, following error, gaps, emergencies.
    fn of(axis: AxisRef<'_>) -> Self {
        let statistics = axis.statistics();
        let error = axis.following_error();
        // The statistics measure the error before the target of the cycle, the column after it.
        let max_error = statistics.max_following_error.max(error.map_or(0, i64::unsigned_abs));
        let number = |value: Option<i64>| value.map_or_else(|| "-".into(), |v| v.to_string());
        let state = axis.drive_state().map_or_else(|| "unknown".into(), |state| state.to_string());
        let text = format!(
            "{:<38}{:<20}{:>11}{:>11}{:>8}{:>8}{:>8}{:>7}{:>6}",
            format!("{}: {}", axis.index(), axis.config().address),
            state,
            number(axis.target().map(i64::from)),
            number(axis.actual().map(i64::from)),
            number(error),
            max_error,
            statistics.tpdos,
            statistics.lost_tpdos,
            statistics.emergencies
        );
        Self { text, error: axis.error() }
    }
}
