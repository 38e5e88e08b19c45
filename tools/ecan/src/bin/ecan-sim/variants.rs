//! `ecan-sim variants`: lists what the manual leaves open and a scenario can switch.

use clap::Args;
use ecan_sim::variant::{Alternative, Variant, variants};
use serde::Serialize;

use crate::failure::Failure;
use crate::screen;

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

pub fn run(arguments: &VariantsArguments) -> Result<(), Failure> {
    let text = match arguments.json {
        true => {
            serde_json::to_string_pretty(&variants().map(Row::from).collect::<Vec<_>>())? + "\n"
        }
        false => list(),
    };
    screen::print(text.as_bytes())
}

fn list() -> String {
    let mut text = "The first alternative of each switch is the default.\n".to_owned();
    let mut table = None;
    for variant in variants() {
        if table.replace(variant.table) != Some(variant.table) {
            text += &format!("\n{}\n", variant.table.header());
        }
        add(variant, &mut text);
    }
    text
}

fn add(variant: &Variant, text: &mut String) {
    let rows = variant.assumptions.join(", ");
    *text += &format!("\n{}: {} ({rows})\n", variant.key, variant.description);
    let width = variant.alternatives.iter().map(|it| it.value.len()).max().unwrap_or(0);
    for Alternative { value, description } in variant.alternatives {
        *text += &format!("    {value:width$}  {description}\n");
    }
    if !variant.permitted.is_empty() {
        *text += &format!("    allowed: {}\n", variant.permitted);
    }
}
