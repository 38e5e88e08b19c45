//! `ecan-sim variants` lists every switch.

use super::support::program::{run, text};

use ecan_sim::variant::variants;

#[test]
fn text_lists_every_switch_with_its_alternatives() {
    let output = run(&["variants"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let list = text(&output.stdout);
    for variant in variants() {
        let rows = variant.assumptions.join(", ");
        let title = format!("\n{}: {} ({rows})\n", variant.key, variant.description);
        let (_, rest) = list.split_once(&title).unwrap_or_else(|| panic!("{title}{list}"));
        for alternative in variant.alternatives {
            assert!(rest.contains(&format!("    {}", alternative.value)), "{alternative:?}");
        }
    }
}

#[test]
fn json_marks_the_default() {
    let output = run(&["variants", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let rows: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), variants().count());
    for (row, variant) in rows.as_array().unwrap().iter().zip(variants()) {
        assert_eq!(row["key"], variant.key);
        assert_eq!(row["table"], variant.table.header());
        assert_eq!(row["assumptions"][0], variant.assumptions[0]);
        for (number, alternative) in variant.alternatives.iter().enumerate() {
            let entry = &row["alternatives"][number];
            assert_eq!(entry["value"], alternative.value);
            assert_eq!(entry["default"], number == 0);
        }
    }
}
