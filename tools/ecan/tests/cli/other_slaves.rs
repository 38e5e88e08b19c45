//! Slaves of other vendors between the gateways.

use crate::support::{ecan, fails, good, scenario, setting};

const BUS: &str = r#"
clock = "stepped"
[[gateway]]
serial = 77
[[io]]
position = 0
name = "EL1859"
[[node]]
kind = "echo"
bus = "0.0"
"#;

#[test]
fn io_is_listed_as_another_slave() {
    let file = scenario(BUS);
    let text = good(&["--ecrt", &setting(&file), "scan"]);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[1].starts_with("0    -      PREOP  EL1859     -         -         - "), "{text}");
    assert!(
        lines[2].starts_with("1    -      PREOP  ECAN-Lite  2.2.1     1         77 "),
        "{text}"
    );
}

#[test]
fn only_gateway_is_selected_beside_an_io() {
    let file = scenario(BUS);
    let text = good(&["--ecrt", &setting(&file), "info"]);
    assert!(text.starts_with("slave     1, PREOP\nname      ECAN-Lite\n"), "{text}");
    good(&["--ecrt", &setting(&file), "send", "123#1122"]);
    let error = fails(5, &["--ecrt", &setting(&file), "--slave", "0", "info"]);
    assert!(error.contains("from slave 0 failed: Protocol not supported"), "{error}");
}

#[test]
fn doctor_checks_the_gateway_beside_an_io() {
    let file = scenario(BUS);
    // its exit status depends on the machine
    let output = ecan(&["--ecrt", &setting(&file), "doctor"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("2 slaves, 1 ECAN-Lite"), "{text}");
    assert!(text.contains("slave 1: SM2 and SM3 match manual 15.7"), "{text}");
}
