//! `ecan man`: the help as manual pages.

use std::path::Path;

use crate::context::{Failure, Result, note};

pub fn run(command: &clap::Command, directory: &Path) -> Result {
    std::fs::create_dir_all(directory)
        .and_then(|()| clap_mangen::generate_to(command.clone(), directory))
        .map_err(|error| Failure::file("write the manual pages to", directory, error))?;
    note(format_args!("manual pages written to {}", directory.display()));
    Ok(())
}
