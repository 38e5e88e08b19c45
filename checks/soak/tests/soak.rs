//! The program as users run it.
#![allow(missing_docs)]

use std::fs;
use std::process::{Command, Output};

fn soak(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ecan-soak")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn seeds_have_no_finding() {
    let output = soak(&["--seed", "100", "--seeds", "20", "--cycles", "500"]);
    let out = text(&output.stdout);
    assert!(output.status.success(), "{out}");
    assert!(out.contains("20 seeds, 0 with a finding"), "{out}");
}

#[test]
fn plan_of_a_seed_repeats_it() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("plan.toml");
    let plan = soak(&["--seed", "3", "--cycles", "300", "--plan"]);
    fs::write(&file, &plan.stdout).unwrap();
    let cycles = |output: Output| {
        let out = text(&output.stdout);
        assert!(output.status.success(), "{out}");
        let word =
            out.split(' ').zip(out.split(' ').skip(1)).find(|(_, next)| next.contains("cycles"));
        word.unwrap().0.to_owned()
    };
    let replayed = cycles(soak(&["--replay", file.to_str().unwrap()]));
    assert_eq!(cycles(soak(&["--seed", "3", "--cycles", "300"])), replayed);
}

#[test]
fn finding_is_reported_with_its_rule() {
    let star = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/star.toml");
    let output = soak(&["--replay", star]);
    let out = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{out}");
    assert!(out.starts_with("seed 1: Receive, cycle"), "{out}");
}

#[test]
fn faulty_plan_is_one_readable_message() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("faulty.toml");
    fs::write(&file, "seed = 1\ncycles = \"many\"\n").unwrap();
    for (path, message) in
        [(file.to_str().unwrap(), "invalid type"), ("/nonexistent", "cannot read /nonexistent")]
    {
        let output = soak(&["--replay", path]);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.starts_with("ecan-soak: ") && error.contains(message), "{error}");
    }
}
