//! A C program with plain `ecrt_*` calls on the simulated library.

use std::ffi::OsStr;
use std::process::Command;

use crate::toolchain::{output_text, plain_master, simulated_library, start};

#[test]
fn ethercrab_reaches_op_and_exchanges_a_frame() {
    if !crate::toolchain::is_there() {
        return;
    }
    let library = simulated_library();
    let program = plain_master(&library);
    let output = start(&program, &library, &[]);
    let words = output_text(&output);
    assert!(output.status.success(), "{words}");
    assert!(words.contains("libethercat 1.6\n") && words.contains("OP after"), "{words}");
    assert!(words.contains("the frame is back after"), "{words}");

    let mut with_clocks = Command::new(&program);
    with_clocks.arg("--dc").env_remove("ECAN_ECRT").env("LD_LIBRARY_PATH", library.path());
    let output = with_clocks.output().expect("the program starts");
    assert!(output.status.success(), "{}", output_text(&output));
}

#[test]
fn run_reports_once_that_it_is_simulated() {
    if !crate::toolchain::is_there() {
        return;
    }
    let library = simulated_library();
    let program = plain_master(&library);
    let file = library.path().join("cell.toml");
    std::fs::write(&file, "seed = 77\n[[gateway]]\n[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n")
        .expect("room for the scenario");
    let mut setting = std::ffi::OsString::from("sim:");
    setting.push(&file);
    let settings = [
        // the path of a library selects no scenario
        (OsStr::new("libethercat.so.1"), "Scenario echo: "),
        (OsStr::new("sim"), "Scenario echo: "),
        (&setting, "seed 77"),
    ];
    for (setting, expected) in settings {
        let output = start(&program, &library, &[("ECAN_ECRT", setting)]);
        let words = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}", output_text(&output));
        assert_eq!(words.lines().count(), 1, "{words}");
        assert!(words.contains("SIMULATED: ") && words.contains(expected), "{words}");
    }
}

#[test]
fn wrong_setting_is_reported_and_gives_no_master() {
    if !crate::toolchain::is_there() {
        return;
    }
    let library = simulated_library();
    let program = plain_master(&library);
    let settings = [
        ("sim:ecco", "unknown scenario \"ecco\"", "Invalid argument"),
        ("sim:nowhere.toml", "cannot read nowhere.toml", "No such file or directory"),
    ];
    for (setting, why, errno) in settings {
        let output = start(&program, &library, &[("ECAN_ECRT", OsStr::new(setting))]);
        let words = output_text(&output);
        assert_eq!(output.status.code(), Some(1), "{words}");
        assert!(words.contains(why), "{words}");
        assert!(words.contains(&format!("ecrt_request_master: {errno}")), "{words}");
        assert!(!words.contains("SIMULATED: "), "{words}");
    }
}
