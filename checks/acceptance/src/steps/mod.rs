//! The list, one file for each group.

mod clocks;
mod commands;
mod configuration;
mod demos;
mod distribution;
mod echo;
mod faults;
mod firmware;
mod host;
mod outages;
mod permissions;
mod restarts;
mod running_loop;
mod second_program;
mod sii;
mod startup;

use std::fmt::Write;

use crate::bench::Bench;
use crate::step::Group;
use crate::stop::Stop;

/// All groups, in the order of the list.
pub const GROUPS: &[&Group] = &[
    &host::GROUP,
    &startup::GROUP,
    &clocks::GROUP,
    &demos::GROUP,
    &commands::GROUP,
    &configuration::GROUP,
    &firmware::GROUP,
    &sii::GROUP,
    &second_program::GROUP,
    &permissions::GROUP,
    &faults::GROUP,
    &restarts::GROUP,
    &outages::GROUP,
];

/// A candump log with this number of frames, one per cycle; their data is their number.
fn recording(bench: &Bench, frames: u32) -> Result<String, Stop> {
    let mut log = String::new();
    for number in 0..frames {
        let us = u64::from(number) * u64::from(bench.arguments.cycle_us);
        let (seconds, us) = (us / 1_000_000, us % 1_000_000);
        let _ = writeln!(log, "({seconds}.{us:06}) can0 123#{number:08X}");
    }
    bench.write_file("recording.log", &log)
}
