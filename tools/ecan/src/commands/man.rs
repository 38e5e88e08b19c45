//! `ecan man`: the help as manual pages.

use std::path::Path;

use clap_mangen::Man;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::new_file::{Existing, create};

use crate::context::{Failure, Result, note};

pub fn write_manual(command: &clap::Command, directory: &Path) -> Result {
    let mut command = command.clone().disable_help_subcommand(true);
    command.build();
    std::fs::create_dir_all(directory)
        .and_then(|()| write_page(&command, directory))
        .map_err(|error| Failure::file("write the manual pages to", directory, error))?;
    note(format_args!("manual pages written to {}", Printable(directory.display())));
    Ok(())
}

/// Writes the pages of a command and its subcommands.
fn write_page(command: &clap::Command, directory: &Path) -> std::io::Result<()> {
    for subcommand in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        write_page(subcommand, directory)?;
    }
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    let mut page = create(&directory.join(format!("{name}.1")), Existing::Replace)?;
    Man::new(command.clone()).render(&mut page)
}
