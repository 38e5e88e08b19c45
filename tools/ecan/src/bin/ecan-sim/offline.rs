//! Commands of `ecan-sim` that need no network: a firmware package for simulated gateways, the list of what the
//! manual leaves open and a scenario can switch, the manual pages and completions.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use ecan_protocol::text::Printable;
use ecan_sim::FirmwarePackage;
use ecan_sim::variant::{Alternative, Variant, variants};
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::command_line::new_file::{Existing, create};
use serde::Serialize;

use crate::failure;
use crate::failure::{Failure, Screen};

/// Size of the default application: some packets and flash sectors.
const APPLICATION_BYTES: usize = 64 << 10;

/// Write a firmware package for simulated gateways.
///
/// The FoE file name is ecan_lite_app. Real gateways reject it: the package format is the
/// simulator's own.
#[derive(Debug, Args)]
#[command(after_help = "Example: ecan-sim firmware --version 2.3.1 --out new.bin")]
pub struct FirmwareArguments {
    /// Firmware version: MAJOR.MINOR.BUILD, 0xF000:05 and :06
    #[arg(long)]
    version: Version,
    /// Output file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Device type, 0xF000:01; a gateway rejects other types than its own
    #[arg(long, default_value_t = 0, value_name = "N")]
    device_type: u8,
    /// Application file [default: a pattern of 64 KiB]
    #[arg(long, value_name = "FILE")]
    application: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Version {
    major: u8,
    minor: u8,
    build: u16,
}

impl FromStr for Version {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parse = || {
            let parts: Vec<_> = text.split('.').collect();
            let [major, minor, build] = parts.try_into().ok()?;
            Some(Self {
                major: u8::from_str(major).ok()?,
                minor: u8::from_str(minor).ok()?,
                build: u16::from_str(build).ok()?,
            })
        };
        parse().ok_or_else(|| "expected MAJOR.MINOR.BUILD, at most 255.255.65535".to_owned())
    }
}

impl Version {
    fn raw(self) -> u32 {
        u32::from_be_bytes([self.major, self.minor, 0, 0]) | u32::from(self.build)
    }
}

pub fn write_firmware(arguments: &FirmwareArguments) -> Result<(), Failure> {
    let FirmwareArguments { version, out, device_type, application } = arguments;
    let application = match application {
        Some(path) => std::fs::read(path).map_err(Failure::file("read", path))?,
        None => (0..APPLICATION_BYTES).map(|at| (at ^ (at >> 8)) as u8).collect(),
    };
    let file = FirmwarePackage::new(*device_type, version.raw(), application).to_bytes();
    new_file::write(out, &file).map_err(Failure::file("write", out))?;
    let Version { major, minor, build } = version;
    Screen::Output.line(format_args!(
        "{}: version {major}.{minor}.{build}, {} bytes, for simulated gateways only",
        Printable(out.display()),
        file.len()
    ));
    Ok(())
}

/// List the switches of simulated gateways for what the manual leaves open.
///
/// They are keys of a scenario file, in [gateway.variant] or [[gateway]]. The rows are those of
/// docs/ASSUMPTIONS.md.
#[derive(Debug, Args)]
#[command(after_help = "Example: ecan-sim variants --json")]
pub struct VariantsArguments {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row {
    key: &'static str,
    table: &'static str,
    assumptions: &'static [&'static str],
    description: &'static str,
    alternatives: Vec<AlternativeRow>,
    permitted: Option<&'static str>,
}

#[derive(Serialize)]
struct AlternativeRow {
    value: &'static str,
    description: &'static str,
    default: bool,
}

impl From<&'static Variant> for Row {
    fn from(variant: &'static Variant) -> Self {
        let Variant { key, table, assumptions, description, alternatives, permitted } = *variant;
        let alternative = |(number, alternative): (usize, &Alternative)| AlternativeRow {
            value: alternative.value,
            description: alternative.description,
            default: number == 0,
        };
        Self {
            key,
            table: table.header(),
            assumptions,
            description,
            alternatives: alternatives.iter().enumerate().map(alternative).collect(),
            permitted: Some(permitted).filter(|text| !text.is_empty()),
        }
    }
}

pub fn list_variants(arguments: &VariantsArguments) -> Result<(), Failure> {
    let text = match arguments.json {
        true => {
            serde_json::to_string_pretty(&variants().map(Row::from).collect::<Vec<_>>())? + "\n"
        }
        false => variants_text(),
    };
    failure::print(text.as_bytes())
}

fn variants_text() -> String {
    let mut text = "The first alternative of each switch is the default.\n".to_owned();
    let mut table = None;
    for variant in variants() {
        if table.replace(variant.table) != Some(variant.table) {
            text += &format!("\n{}\n", variant.table.header());
        }
        add_variant(variant, &mut text);
    }
    text
}

fn add_variant(variant: &Variant, text: &mut String) {
    let rows = variant.assumptions.join(", ");
    *text += &format!("\n{}: {} ({rows})\n", variant.key, variant.description);
    let width =
        variant.alternatives.iter().map(|alternative| alternative.value.len()).max().unwrap_or(0);
    for Alternative { value, description } in variant.alternatives {
        *text += &format!("    {value:width$}  {description}\n");
    }
    if !variant.permitted.is_empty() {
        *text += &format!("    allowed: {}\n", variant.permitted);
    }
}

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
    failure::print(&script)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::{write_manual_pages, *};
    use crate::Arguments;

    #[test]
    fn versions_are_three_numbers() {
        let version: Version = "14.4.24079".parse().unwrap();
        assert_eq!(version.raw(), 0x0E04_5E0F);
        for wrong in ["", "1", "1.2", "1.2.3.4", "256.0.0", "1.2.65536", "a.b.c", "-1.0.0"] {
            assert!(wrong.parse::<Version>().is_err(), "{wrong}");
        }
    }

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
