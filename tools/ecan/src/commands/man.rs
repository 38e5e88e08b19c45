//! `ecan man`: the help as manual pages.

use std::path::Path;

use crate::failure::Failure;
use crate::output::Output;

/// Writes a page for the program and one for each command.
pub fn run(command: &clap::Command, directory: &Path, output: &Output) -> Result<(), Failure> {
    clap_mangen::generate_to(command.clone(), directory).map_err(|error| Failure::File {
        what: "write the manual pages to",
        path: directory.to_owned(),
        reason: error.to_string(),
    })?;
    output.note(format_args!("manual pages written to {}", directory.display()));
    Ok(())
}
