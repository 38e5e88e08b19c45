//! The table of variants: keys of scenario files, and rows of docs/ASSUMPTIONS.md.

use std::collections::BTreeSet;
use std::path::Path;

use ecan_sim::variant::{NodeModes, RepeatedImage, VariantTable, variants};
use ecan_sim::{GatewaySpec, Scenario};

fn read(text: &str) -> Result<GatewaySpec, String> {
    let scenario = Scenario::from_toml(text, "test", Path::new("."));
    scenario.map(|mut scenario| scenario.gateways.remove(0)).map_err(|error| error.to_string())
}

#[test]
fn switches_arrive_at_their_gateway() {
    let text = "[[gateway]]\nalias = 1\n[gateway.variant]\nnode_modes = \"loopback_first\"\n\
        repeated_image = \"error_10\"\n[[gateway]]\nalias = 2\n";
    let scenario = Scenario::from_toml(text, "test", Path::new(".")).unwrap();
    let [first, second] = &scenario.gateways[..] else { panic!("{:?}", scenario.gateways) };
    assert_eq!(first.config.variant.node_modes, NodeModes::LoopbackFirst);
    assert_eq!(first.config.variant.repeated_image, RepeatedImage::CountedAsError);
    assert_eq!(second.config.variant, Default::default());
}

#[test]
fn wrong_switches_are_reported_with_their_line() {
    let head = "[[gateway]]\nalias = 1\n[gateway.variant]\nnode_modes = \"manual\"\n";
    for (line, expected) in [
        ("node_mode = 1", "line 5: unknown variant `node_mode`; allowed: "),
        (
            "repeated_image = \"error\"",
            "line 5: `repeated_image` = \"error\" is not an alternative; allowed: no_op, error_10",
        ),
        ("repeated_image = 10", "line 5: `repeated_image` = 10 is not an alternative; allowed: "),
    ] {
        let error = read(&format!("{head}{line}\n")).unwrap_err();
        assert!(error.starts_with(expected), "{error}");
    }
    let unknown = read(&format!("{head}serial = 1\n")).unwrap_err();
    for variant in variants().filter(|variant| variant.table == VariantTable::Variant) {
        assert!(unknown.contains(variant.key), "{unknown}");
    }
}

/// The first alternative is the default; each of the others changes the gateway.
#[test]
fn every_alternative_can_be_selected() {
    let default = read("[[gateway]]\n").unwrap();
    for variant in variants() {
        for (number, alternative) in variant.alternatives.iter().enumerate() {
            let text = format!("[[gateway]]\n{}", variant.toml(alternative));
            let spec = read(&text).unwrap_or_else(|error| panic!("{text}{error}"));
            assert_eq!(spec == default, number == 0, "{text}");
        }
    }
}

#[test]
fn keys_are_unique() {
    let mut keys = BTreeSet::new();
    for variant in variants() {
        assert!(keys.insert(variant.key), "{}", variant.key);
        assert!(variant.alternatives.len() >= 2, "{}", variant.key);
    }
}

/// Rows of docs/ASSUMPTIONS.md, with their numbers.
fn assumptions() -> Vec<(String, String)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/ASSUMPTIONS.md");
    let text = std::fs::read_to_string(path).unwrap();
    let rows = text.lines().filter_map(|line| {
        let number = line.strip_prefix("| ")?.split(' ').next()?;
        Some((number.to_owned(), line.to_owned()))
    });
    rows.collect()
}

#[test]
fn every_named_assumption_exists_and_names_its_switch() {
    let rows = assumptions();
    for variant in variants() {
        assert!(!variant.assumptions.is_empty(), "{}", variant.key);
        for name in variant.assumptions {
            let row = rows.iter().find(|(number, _)| number == name);
            let (_, row) = row.unwrap_or_else(|| panic!("{}: no row {name}", variant.key));
            assert!(row.contains(&format!("`{}`", variant.key)), "{}: {row}", variant.key);
        }
    }
}

/// A row that names a switch is one of the rows of this switch.
#[test]
fn every_switch_of_an_assumption_exists() {
    for (number, row) in assumptions() {
        let Some((_, switches)) = row.split_once("Switch: ") else { continue };
        let switches = switches.split(" |").next().unwrap_or_default();
        let keys = switches.split(", ").map_while(|item| item.strip_prefix('`')?.split('`').next());
        for key in keys {
            let variant = variants().find(|variant| variant.key == key);
            let variant = variant.unwrap_or_else(|| panic!("{number}: no switch {key}"));
            assert!(variant.assumptions.contains(&&*number), "{number}: {key}");
        }
    }
}
