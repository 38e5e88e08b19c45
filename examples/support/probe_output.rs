//! Output of a transmission probe and of its sweep over Sync0 shifts (manual 15.6.1): terminal, bus recording, CSV,
//! picture.

use std::error::Error;
use std::path::{Path, PathBuf};

use ecan_host::Plan;
use ecan_mcan_port::Port;
use ecan_protocol::mapping::CHUNK_BYTES;
use ecan_protocol::text::Printable;
use ecan_sim::{BusFrame, Simulation};
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::plot;
use ecan_tool_support::plot::{Heading, ShiftFigure};
use ecan_tool_support::print_line;

use crate::bus_periods::BusRecord;
use crate::interrupt::Interrupt;
use crate::phase_sweep::{PhaseSweep, sweep_phase};
use crate::probe_report::{Report, Row};
use crate::shift_windows::{HEADING, ShiftWindows};
use crate::tx_probe::{ModeResult, Target, probe_id};
use crate::{RunInfo, log_file, program, real_time};

/// Files of a transmission probe.
#[derive(Debug, Clone, Copy, Default)]
pub struct ProbeFiles<'a> {
    /// Analyser's recording of the bus, read after the measurement.
    pub bus_log: Option<&'a Path>,
    /// Recording of the simulated bus.
    pub bus_dump: Option<&'a Path>,
    /// One line per frame.
    pub csv: Option<&'a Path>,
    /// Histograms.
    pub picture: Option<&'a Path>,
}

impl ProbeFiles<'_> {
    /// Checks before the measurement that the files can be written.
    ///
    /// # Errors
    /// A file cannot be written, or a recording needs a simulated bus.
    pub fn check(&self, is_simulated: bool) -> Result<(), Box<dyn Error>> {
        for path in [self.csv, self.picture, self.bus_dump] {
            plot::check_file(path)?;
        }
        if self.bus_dump.is_some() && !is_simulated {
            return Err("--bus-dump needs a simulated bus".into());
        }
        Ok(())
    }

    /// Prints the results and writes the files. The frames were sent to `target`.
    ///
    /// # Errors
    /// A file cannot be written, or the log of the bus cannot be read; the results are printed anyway.
    pub fn report(
        &self,
        port: &Port,
        simulation: Option<&Simulation>,
        setting: String,
        run: RunInfo,
        target: Target,
        results: Vec<ModeResult>,
    ) -> Result<(), Box<dyn Error>> {
        let recorded =
            simulation.map(|simulation| simulation.with_world(|world| world.take_recorded()));
        let (record, bus_source, log_error) = match self.bus_record(recorded.as_deref()) {
            Ok((record, source)) => (record, source, Ok(())),
            Err(error) => (None, "no times on the bus: the log cannot be used".into(), Err(error)),
        };
        for result in &results {
            print_line!("\n{}:", result.mode);
            real_time::print_statistics(port.adapter(), &result.statistics);
        }
        let row = |result: ModeResult| Row {
            bus: record.as_ref().map(|record| record.periods(result.numbers.clone())),
            result,
        };
        let report = Report {
            cycle: port.adapter().config().cycle,
            setting,
            run,
            banner: simulation.map(Simulation::banner),
            bus_source,
            rows: results.into_iter().map(row).collect(),
        };
        print_line!("\n{}\n{}", report.run, report.setting);
        print(Stream::Output, report.table());
        for note in report.notes().iter().skip(1) {
            print_line!("{note}");
        }
        if let (Some(path), Some(frames)) = (self.bus_dump, &recorded) {
            let mut dump = log_file::Writer::create(path)?;
            for frame in frames {
                dump.write(frame.start_ns, usize::from(target.channel), frame.frame)?;
            }
            dump.finish()?;
        }
        if let Some(path) = self.csv {
            report.write_csv(path)?;
        }
        if let Some(path) = self.picture {
            report.write_picture(path)?;
        }
        log_error
    }

    /// Times on the bus, and a description of their source.
    fn bus_record(
        &self,
        recorded: Option<&[BusFrame]>,
    ) -> Result<(Option<BusRecord>, String), Box<dyn Error>> {
        if let Some(path) = self.bus_log {
            let record = BusRecord::from_log(path, probe_id())?;
            let resolution = match record.resolution_ns {
                1 => "",
                _ => ", with timestamps in whole microseconds",
            };
            let source = format!("times on the bus from {}{resolution}", Printable(path.display()));
            return Ok((Some(record), source));
        }
        Ok(match recorded {
            Some(frames) => {
                let record = BusRecord::from_simulation(frames, probe_id());
                (Some(record), "times on the bus from the simulated bus".into())
            }
            None => (None, "no bus log; --bus-log FILE provides the times on the bus".into()),
        })
    }
}

/// Parses the name of a picture.
///
/// # Errors
/// The name does not end in `.html` or `.svg`.
pub fn parse_picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_known =
        path.extension().is_some_and(|extension| extension == "html" || extension == "svg");
    if is_known {
        Ok(path)
    } else {
        Err("only HTML and SVG are written: use a name that ends in .html or .svg".into())
    }
}

/// Tries shifts and offsets with this number of frames each, prints the table and the usable shifts, and
/// draws them. Returns whether one of them loses nothing.
///
/// # Errors
/// The user stopped the program, the Port failed, or the picture cannot be written.
pub fn print_sweep(
    port: &mut Port,
    target: Target,
    frames: u64,
    setting: &str,
    picture: Option<(&Path, Heading)>,
    interrupt: &Interrupt,
) -> Result<bool, Box<dyn Error>> {
    let config = *port.adapter().config();
    let cycle = config.cycle;
    let sweep = PhaseSweep {
        cycles: u32::try_from(frames)?,
        ..PhaseSweep::over(u32::try_from(cycle.as_nanos())?)
    };
    let (count, mut done) = (sweep.shifts_ns.len() * sweep.offsets_ns.len(), 0);
    let progress = program::bar(count as u64);
    let table = sweep_phase(
        port,
        &sweep,
        |port, offset_ns| -> Result<(), Box<dyn Error>> {
            if interrupt.is_set() {
                return Err("stopped by the user".into());
            }
            Ok(target.sweep_cycle(port, offset_ns)?)
        },
        |_| {
            done += 1;
            progress.set_position(done);
        },
    );
    progress.finish_and_clear();
    let table = table?;
    print_line!("{setting} with {} cycles for each point", sweep.cycles);
    print_line!("{table}");
    let arrivals = Plan::of(&config).output_arrivals();
    let windows = ShiftWindows::new(
        &table,
        config.slaves.iter().map(|slave| usize::from(slave.rx_multiplier)).max().unwrap_or(0)
            * CHUNK_BYTES,
        arrivals.and_then(|arrivals| arrivals.usable_shifts_ns()),
    );
    print_line!("\n{HEADING}\n{windows}");
    if let Some(best) = table.recommended() {
        print_line!(
            "confirm this point in a run of minutes: --dc-shift-us {:.0} --offset-ns {} --frames {}",
            f64::from(best.shift_ns) / 1e3,
            best.offset_ns,
            120_000_000 / cycle.as_micros().max(1)
        );
    }
    if let Some((path, heading)) = picture {
        ShiftFigure { heading, rows: vec![windows.row()] }.write(path)?;
    }
    Ok(table.recommended().is_some())
}
