//! The program `ecan-scale`: how cost grows with gateways, axes, frames and clients, and which part becomes the limit,
//! by the formulas of the planner and by runs on the simulator.
//!
//! ```text
//! cargo run --release --manifest-path checks/Cargo.toml -p ecan-bench --bin ecan-scale -- --output docs
//! ```
//!
//! Writes tables of docs/PERFORMANCE.md and their pictures. Simulated times are the same in each run; the times of the host
//! and the startup (section `mailbox`, in real time) are not: run them on an idle machine.
#![forbid(unsafe_code)]

mod bus;
mod clients;
mod host;
mod mailbox;
mod page;
mod wire;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, ValueEnum};

use page::{Page, Section};

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// Measure how cost grows with gateways, axes, frames and clients, and write docs/PERFORMANCE.md
#[derive(Debug, Parser)]
#[command(name = "ecan-scale", version)]
struct Arguments {
    /// Directory with PERFORMANCE.md, and with the folder of its pictures
    #[arg(long, value_name = "DIRECTORY", default_value = "docs")]
    output: PathBuf,
    /// Sections to write [default: all]
    #[arg(long, value_name = "SECTION", value_enum)]
    only: Vec<Name>,
}

/// Name of a section, or of a group of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Name {
    Wire,
    Mailbox,
    Bus,
    Clients,
    Host,
}

impl Name {
    fn sections(self) -> Fallible<Vec<Section>> {
        match self {
            Self::Wire => Ok(vec![wire::section()?]),
            Self::Mailbox => Ok(vec![mailbox::section()?]),
            Self::Bus => Ok(vec![bus::section()?]),
            Self::Clients => Ok(vec![clients::section()?]),
            Self::Host => Ok(host::sections()?.into()),
        }
    }
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
    let is_wanted = |name: &&Name| arguments.only.is_empty() || arguments.only.contains(name);
    for name in Name::value_variants().iter().filter(is_wanted) {
        for section in name.sections()? {
            page.put(section)?;
        }
    }
    page.write()
}
