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

/// A scenario file with this text.
pub fn scenario(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    std::fs::write(file.path(), text).unwrap();
    file
}

/// The setting of a scenario file.
pub fn setting(file: &tempfile::NamedTempFile) -> String {
    format!("sim:{}", file.path().display())
}

/// Standard output of a run that ends with this status.
pub fn ends(status: i32, arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// Writes a program that other programs are to run. Another process writes it: a descriptor of our
/// own could be inherited by a child of another test just then, and the file would be busy.
pub fn write_program(path: &std::path::Path, text: &str) {
    let status = Command::new("sh")
        .args(["-c", "printf '%s' \"$2\" > \"$1\" && chmod 755 \"$1\"", "sh"])
        .arg(path)
        .arg(text)
        .status()
        .unwrap();
    assert!(status.success());
}
