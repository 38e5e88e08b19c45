//! Sweep over Sync0 shifts and offsets with the frames of the transmission probe (manual 15.6.1).

use std::error::Error;

use ecan_mcan_port::Port;

use crate::interrupt::Interrupt;
use crate::phase_sweep::{PhaseSweep, sweep_phase};
use crate::progress;
use crate::tx_probe::Target;

/// Tries shifts and offsets with this number of frames each and prints the table. Returns whether one
/// of them loses nothing.
///
/// # Errors
/// The user stopped the program, or the Port failed.
pub fn print_sweep(
    port: &mut Port,
    target: Target,
    frames: u64,
    setting: &str,
    interrupt: &Interrupt,
) -> Result<bool, Box<dyn Error>> {
    let cycle = port.adapter().config().cycle;
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
    println!("{setting} with {} cycles for each point", sweep.cycles);
    println!("{table}");
    if let Some(best) = table.recommended() {
        println!(
            "confirm this point in a run of minutes: --dc-shift-us {:.0} --offset-ns {} --frames {}",
            f64::from(best.shift_ns) / 1e3,
            best.offset_ns,
            120_000_000 / cycle.as_micros().max(1)
        );
    }
    Ok(table.recommended().is_some())
}
