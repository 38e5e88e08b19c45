//! The program on the simulator, in stepped time.

use std::process::Command;

#[test]
fn program_succeeds_on_the_simulator() {
    let mut program = Command::new(env!("CARGO_BIN_EXE_starter"));
    let output = program.env("ECAN_ECRT", "sim:scenario.toml").output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.starts_with("SIMULATED"), "{errors}");
    assert!(!output.stdout.is_empty(), "no frame and no progress");
}
