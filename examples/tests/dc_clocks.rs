//! The program on distributed clocks as a user runs it.

use crate::program::{all_fail, contains_all, run, succeeds, text};

const PROGRAM: &str = "dc_clocks";
const DRIFT: &str = concat!("sim:", env!("CARGO_MANIFEST_DIR"), "/scenarios/drift.toml");

#[test]
fn clocks_settle_with_either_reference() {
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("clocks.svg");
    let base = ["--ecrt", DRIFT, "--slaves", "3", "--plot", plot.to_str().unwrap()];
    let printed = succeeds(PROGRAM, &[&base[..], &["--source", "reference"]].concat());
    // The scenario loses 51 frames and lets the reference clock, which is 50 ppm fast, jump.
    let is_jump = ["largest 200.0", "largest 199.9"].iter().any(|text| printed.contains(text));
    assert!(is_jump, "{printed}");
    assert!(printed.contains("clock: -50.0") || printed.contains("clock: -49.9"), "{printed}");
    let parts = ["below 1 us since cycle ", "readings missed: 51", "master_period: "];
    contains_all(&printed, &parts);
    let svg = std::fs::read_to_string(&plot).unwrap();
    let parts = [
        "phase error [us]",
        "phase error, enlarged",
        "reading missed (51)",
        "clipped: ",
        "SIMULATED",
    ];
    contains_all(&svg, &parts);
    assert!(svg.ends_with("</svg>\n"));

    contains_all(&succeeds(PROGRAM, &base), &["below 1 us since cycle ", "clock: +0.000 ppm"]);
}

#[test]
fn shift_among_the_arrivals_is_a_warning() {
    let base = ["--ecrt", "sim", "--cycles", "5000", "--shift-us"];
    for (shift_us, is_warned) in [("175", true), ("700", false)] {
        let output = run(PROGRAM, &[&base[..], &[shift_us]].concat());
        let errors = text(&output.stderr);
        assert!(output.status.success(), "{errors}");
        let warning = "warning: Sync0 175.0 us after the start of the cycle falls into the arrival";
        assert_eq!(errors.contains(warning), is_warned, "{errors}");
    }
}

#[test]
fn invalid_options_return_errors() {
    let cases: &[(&[&str], &str)] = &[
        (&["--reference", "1"], "slave index 1 is out of range"),
        (&["--shift-us", "1000"], "shift of 1000 us is not below its period"),
        (&["--cycles", "10", "--plot", "/no/where.svg"], "cannot write /no/where.svg"),
        (&["--plot", "clocks.png"], "only SVG is written"),
        (&["--source", "other"], ""),
    ];
    all_fail(PROGRAM, &["--ecrt", "sim"], cases);
    let output = run(PROGRAM, &["--ecrt", "sim", "--plot", "/no/where.svg"]);
    assert_eq!((output.status.code(), text(&output.stdout)), (Some(6), String::new()));
}
