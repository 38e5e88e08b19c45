//! Sweep over Sync0 shifts and offsets with the frames of the transmission probe (manual 15.6.1).

use std::error::Error;
use std::path::Path;

use ecan_host::Plan;
use ecan_mcan_port::Port;
use ecan_protocol::mapping::CHUNK_BYTES;
use ecan_tool_support::plot::{Heading, ShiftFigure};
use ecan_tool_support::print_line;

use crate::interrupt::Interrupt;
use crate::phase_sweep::{PhaseSweep, sweep_phase};
use crate::progress;
use crate::shift_windows::{HEADING, ShiftWindows};
use crate::tx_probe::Target;

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
    plot: Option<(&Path, Heading)>,
    interrupt: &Interrupt,
) -> Result<bool, Box<dyn Error>> {
    let config = *port.adapter().config();
    let cycle = config.cycle;
    let sweep = PhaseSweep {
        cycles: u32::try_from(frames)?,
        ..PhaseSweep::over(u32::try_from(cycle.as_nanos())?)
    };
    let (count, mut done) = (sweep.shifts_ns.len() * sweep.offsets_ns.len(), 0);
    let progress = progress::bar(count as u64);
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
    if let Some((path, heading)) = plot {
        ShiftFigure { heading, rows: vec![windows.row()] }.write(path)?;
    }
    if let Some(best) = table.recommended() {
        print_line!(
            "confirm this point in a run of minutes: --dc-shift-us {:.0} --offset-ns {} --frames {}",
            f64::from(best.shift_ns) / 1e3,
            best.offset_ns,
            120_000_000 / cycle.as_micros().max(1)
        );
    }
    Ok(table.recommended().is_some())
}
