//! The program as a user runs it.
#![allow(dead_code, missing_docs)]

use std::process::{Command, Output};

/// A simulated master, one gateway with echo nodes.
pub const SIM: &str = "sim";

pub fn ecan(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ecan"))
        .args(arguments)
        .env_remove("ECAN_ECRT")
        .output()
        .unwrap()
}

/// Standard output of a run that ends well.
pub fn good(arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// As [`good`], on a simulated bus.
pub fn simulated(arguments: &[&str]) -> String {
    good(&[&["--ecrt", SIM][..], arguments].concat())
}

/// The message of a run that ends with this status: one line, behind the banner of a simulation.
pub fn fails(status: i32, arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {errors}");
    assert!(!errors.contains("panicked"), "{errors}");
    errors.lines().filter(|line| !line.starts_with("SIMULATED")).collect::<Vec<_>>().join("\n")
}

/// A scenario file with two gateways, the second with the alias 7.
pub fn two_gateways() -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    std::fs::write(file.path(), "[[gateway]]\n[[gateway]]\nalias = 7\n").unwrap();
    file
}
