//! The programs of README.md, which `ecan new` writes, as a user runs them: undisturbed, through outages, and
//! without a master.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Cargo builds the examples of a package next to its tests.
fn example(name: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().and_then(Path::parent).unwrap().join("examples").join(name)
}

fn run(name: &str, ecrt: &str) -> Output {
    let directory = tempfile::tempdir().unwrap();
    let machine = match name {
        "first_axis" => include_str!("../../examples/starter/axes/machine.toml"),
        _ => include_str!("../../examples/starter/frames/machine.toml"),
    };
    std::fs::write(directory.path().join("machine.toml"), machine).unwrap();
    let mut program = Command::new(example(name));
    program.current_dir(directory.path()).env("ECAN_ECRT", ecrt).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A scenario in stepped time with these faults.
fn scenario(directory: &Path, node: &str, faults: &[&str]) -> String {
    let faults: String = faults.iter().map(|fault| format!("[[fault]]\n{fault}\n")).collect();
    write_scenario(directory, &format!("[[node]]\nbus = \"0.0\"\n{node}\n{faults}"))
}

fn write_scenario(directory: &Path, content: &str) -> String {
    let path = directory.join("scenario.toml");
    std::fs::write(&path, format!("clock = \"stepped\"\n[[gateway]]\n{content}")).unwrap();
    format!("sim:{}", path.display())
}

const ECHO: &str = "kind = \"echo\"";
const LINK_LOSS: &str = "at_ms = 2000\nkind = \"link_loss\"\ngateway = 0\nfor_ms = 300";
const POWER_CYCLE: &str = "at_ms = 5000\nkind = \"power_cycle\"\ngateway = 0\noff_ms = 300";

/// Rust programs of README.md.
fn programs_of_readme() -> Vec<String> {
    let readme = include_str!("../../README.md");
    let blocks = readme.split("```rust,no_run\n").skip(1);
    blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect()
}

#[test]
fn readme_programs_are_the_tested_examples() {
    let examples =
        [include_str!("../examples/first_program.rs"), include_str!("../examples/first_axis.rs")];
    // Without the documentation of the file.
    let programs = examples.map(|example| example.split_once("\n\n").unwrap().1);
    assert_eq!(programs_of_readme(), programs);
}

#[test]
fn first_program_imports_one_crate() {
    let program = &programs_of_readme()[0];
    let uses: Vec<_> = program.lines().filter(|line| line.starts_with("use ")).collect();
    assert_eq!(uses, ["use ecan_lite::prelude::*;"]);
}

#[test]
fn first_program_sends_and_receives_every_frame() {
    let directory = tempfile::tempdir().unwrap();
    let output = run("first_program", &scenario(directory.path(), ECHO, &[]));
    let printed = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let received = printed.lines().filter(|line| line.contains("123")).count();
    // The last frames return after the last cycle.
    assert!((990..=1000).contains(&received), "{received} of 1000:\n{printed}");
}

#[test]
fn first_program_survives_link_loss_and_power_cycle() {
    let directory = tempfile::tempdir().unwrap();
    let setting = scenario(directory.path(), ECHO, &[LINK_LOSS, POWER_CYCLE]);
    let output = run("first_program", &setting);
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let told: Vec<_> = errors.lines().filter(|line| line.contains(" s  slave 0: ")).collect();
    assert!(told[0].contains("lost, waits for the network link of the master"), "{errors}");
    assert_eq!(told.iter().filter(|line| line.contains("ready after ")).count(), 2, "{errors}");
    let received = text(&output.stdout).lines().filter(|line| line.contains("123")).count();
    assert!((100..990).contains(&received), "{received}: the outages cost frames, not the program");
}

#[test]
fn first_program_without_another_node_fails_with_the_reason() {
    let directory = tempfile::tempdir().unwrap();
    let output = run("first_program", &write_scenario(directory.path(), ""));
    let errors = text(&output.stderr);
    assert!(!output.status.success(), "{errors}");
    for part in ["channel 0: run, warning: error passive", "check that another node is on"] {
        assert!(errors.contains(part), "{part}: {errors}");
    }
}

#[test]
fn first_axis_moves_and_stops() {
    let directory = tempfile::tempdir().unwrap();
    let drive = "kind = \"drive\"\nnode_id = 1\nname = \"shoulder\"";
    let output = run("first_axis", &scenario(directory.path(), drive, &[]));
    assert!(output.status.success(), "{}\n{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn plain_simulator_has_the_axis_of_the_program() {
    let output = run("first_axis", "sim");
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{}\n{errors}", text(&output.stdout));
    assert!(errors.starts_with("SIMULATED") && errors.contains("Scenario drives"), "{errors}");
}

#[test]
fn missing_library_is_one_readable_line() {
    for program in ["first_program", "first_axis"] {
        let output = run(program, "/no/such/libethercat.so");
        let message = text(&output.stderr);
        assert!(!output.status.success());
        assert!(message.contains("/no/such/libethercat.so was not found"), "{message}");
        assert_eq!(message.trim().lines().count(), 1, "{message}");
        assert!(!message.contains("Load("), "not in Debug form: {message}");
    }
}

#[test]
fn unknown_scenario_is_one_readable_line() {
    let output = run("first_program", "sim:none");
    let message = text(&output.stderr);
    assert!(!output.status.success());
    assert!(message.contains("none") && message.contains("echo"), "{message}");
    assert_eq!(message.trim().lines().count(), 1, "{message}");
}
