//! `ecan-sim man` and `ecan-sim completions`.

use std::path::Path;

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use ecan_tool_support::command_line::new_file::{Existing, create};

use crate::failure::Failure;
use crate::screen;

/// Not 1: `ecan-sim.1` is the page of the command `ecan sim`.
const SECTION: &str = "8";

/// Writes a page for the program and for each command.
pub fn write_manual_pages(program: Command, directory: &Path) -> Result<(), Failure> {
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let written = std::fs::create_dir_all(directory).and_then(|()| write_page(&program, directory));
    written.map_err(Failure::file("write the manual pages to", directory))
}

fn write_page(command: &Command, directory: &Path) -> std::io::Result<()> {
    for subcommand in command.get_subcommands() {
        write_page(subcommand, directory)?;
    }
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    let mut page = create(&directory.join(format!("{name}.{SECTION}")), Existing::Replace)?;
    Man::new(command.clone()).section(SECTION).render(&mut page)
}

pub fn print_completions(mut program: Command, shell: Shell) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut program, "ecan-sim", &mut script);
    screen::print(&script)
}

#[cfg(test)]
mod tests {
    use super::write_manual_pages;
    use crate::Arguments;
    use clap::CommandFactory as _;

    #[test]
    fn manual_pages_have_a_section_of_their_own() {
        let directory = tempfile::tempdir().unwrap();
        let directory = directory.path().join("new/man8");
        write_manual_pages(Arguments::command(), &directory).unwrap();
        let mut pages: Vec<_> = std::fs::read_dir(&directory)
            .unwrap()
            .map(|page| page.unwrap().file_name().into_string().unwrap())
            .collect();
        pages.sort();
        let commands = Arguments::command();
        let mut expected: Vec<_> = commands
            .get_subcommands()
            .map(|command| format!("ecan-sim-{}.8", command.get_name()))
            .chain(["ecan-sim.8".to_owned()])
            .collect();
        expected.sort();
        assert_eq!(pages, expected);
        let page = std::fs::read_to_string(directory.join("ecan-sim-wire.8")).unwrap();
        assert!(page.contains(".TH ecan-sim-wire 8"), "{page}");
        assert!(page.contains("\\-\\-interface"), "{page}");
    }
}
