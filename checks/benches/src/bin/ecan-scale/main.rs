//! The program `ecan-scale`: how cost grows with gateways, axes, frames and clients, and which part becomes the limit,
//! by the formulas of the planner and by runs on the simulator.
//!
//! ```text
//! cargo run --release --manifest-path checks/Cargo.toml -p ecan-bench --bin ecan-scale -- --output docs
//! ```
//!
//! Writes tables of docs/PERFORMANCE.md and their pictures. Simulated times are the same in each run; the times of the host
//! are not.
#![forbid(unsafe_code)]

mod bus;
mod clients;
mod host;
mod mailbox;
mod page;
mod wire;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

use page::Page;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// Measure how cost grows with gateways, axes, frames and clients, and write docs/PERFORMANCE.md
#[derive(Debug, Parser)]
#[command(name = "ecan-scale", version)]
struct Arguments {
    /// Directory with PERFORMANCE.md, and with the folder of its pictures
    #[arg(long, value_name = "DIRECTORY", default_value = "docs")]
    output: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ecan-scale: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Fallible<()> {
    let mut page = Page::open(&arguments.output)?;
    for section in [wire::section, mailbox::section, bus::section, clients::section] {
        page.put(section()?)?;
    }
    for section in host::sections()? {
        page.put(section)?;
    }
    page.write()
}
