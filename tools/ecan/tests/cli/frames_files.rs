//! Files of the commands that carry frames: kept, replaced, and standard input and output.

use std::process::{Command, Stdio};

use crate::support::{Scenario, assert_has, fails};
use ecan_test_support::Killed;

const ECHO: &str = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";
const LOG: &str = "(1.000000) can0 123#01\n(1.001000) can0 124#02\n(1.002000) can0 125#03\n";

#[test]
fn existing_file_survives_failures() {
    let bus = Scenario::new(ECHO);
    let (kept, drive) = (bus.write("kept", "precious"), bus.write("drive.log", LOG));
    let nobody = ["--ecrt", "/nonexistent.so"];
    let commands: [&[&str]; 5] = [
        &["dump", "-l", &kept, "--force"],
        &["dump", "--capture", &kept, "--force"],
        &["replay", &drive, "--record", &kept, "--force"],
        &["send", "123#", "--capture", &kept, "--force"],
        &["gen", "-n", "1", "--capture", &kept, "--force"],
    ];
    for command in commands {
        fails(3, &[&nobody[..], command].concat());
        assert_eq!(bus.read("kept"), "precious", "{command:?}");
        bus.fails(4, &[command, &["--slave", "3"]].concat());
        assert_eq!(bus.read("kept"), "precious", "{command:?}");
        bus.fails(2, &[command, &["--bitrate", "333"]].concat());
        assert_eq!(bus.read("kept"), "precious", "{command:?}");
        // Without --force not even a run that could succeed touches it.
        let without: Vec<_> =
            command.iter().copied().filter(|argument| *argument != "--force").collect();
        let message = bus.fails(6, &without);
        let words = format!("ecan: cannot write {kept}: file exists; use --force to overwrite it");
        assert_eq!(message, words, "{command:?}");
        assert_eq!(bus.read("kept"), "precious", "{command:?}");
    }
    bus.good(&["replay", &drive, "--record", &kept, "--force"]);
    assert_eq!(bus.read("kept").lines().count(), 3);
}

#[test]
fn capture_of_failed_start_is_removed() {
    let fault = "[[fault]]\nat_ms = 0\nkind = \"sdo_abort\"\ngateway = 0\nindex = 0x8001\n\
                 subindex = 1\ncode = 0x06090030\ntimes = 100\n";
    let bus = Scenario::new(&format!("{ECHO}{fault}"));
    let capture = bus.path("a.pcapng");
    bus.fails(5, &["gen", "-n", "1", "--capture", &capture]);
    assert!(!std::path::Path::new(&capture).exists());
}

/// Runs it with standard input.
fn fed(arguments: &[&str], input: &str) -> (Option<i32>, String, String) {
    use std::io::Write as _;
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = Killed::spawn(&mut command);
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.output();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn dash_is_stdin_and_stdout() {
    let bus = Scenario::new(ECHO);
    let setting = bus.setting();
    let replay = ["--ecrt", &setting, "replay", "-", "--record", "-"];
    let (status, log, errors) = fed(&replay, LOG);
    assert_eq!(status, Some(0), "{errors}");
    let frames: Vec<_> = log.lines().filter_map(|line| line.split(' ').nth(2)).collect();
    assert_eq!(frames, ["123#01", "124#02", "125#03"]);
    // The summary keeps out of the log.
    assert!(errors.contains("3 frames sent, 0 lost, 3 received"), "{errors}");
    let (status, _, errors) = fed(&replay, "(1.000000) can0 1#\n");
    assert_eq!(status, Some(6));
    assert!(errors.contains("-, line 1, column"), "{errors}");

    let playing = Scenario::replaying(&[(0, "123#01"), (5, "124#02")], "");
    let shown = playing.good(&["dump", "-n", "2", "-L"]);
    assert_eq!(playing.good(&["dump", "-n", "2", "-l", "-"]), shown);
    assert_has(&playing.fails(2, &["dump", "-l", "-", "--screen"]), "--screen");

    for command in [&["send", "123#"][..], &["gen", "-n", "1"]] {
        let output = bus.run(&[command, &["--capture", "-"]].concat());
        assert_eq!(output.status.code(), Some(0));
        assert_eq!(output.stdout[..4], [0x0A, 0x0D, 0x0D, 0x0A]);
        let printed = |bytes: &[u8]| String::from_utf8_lossy(bytes).contains(" sent");
        assert!(printed(&output.stderr) && !printed(&output.stdout), "{command:?}");
    }
    assert_has(&bus.fails(2, &["gen", "-n", "1", "-v", "--capture", "-"]), "--verbose");
    assert!(!std::path::Path::new("-").exists());
}

/// Another user may have placed a link at the name of a file.
#[test]
fn no_command_writes_through_a_link() {
    let bus = Scenario::new(ECHO);
    let (kept, drive) = (bus.write("kept", "precious"), bus.write("drive.log", LOG));
    let link = format!("{kept}.link");
    std::os::unix::fs::symlink(&kept, &link).unwrap();
    let pages = format!("{kept}.pages");
    std::fs::create_dir(&pages).unwrap();
    std::os::unix::fs::symlink(&kept, format!("{pages}/ecan.1")).unwrap();
    let commands: [&[&str]; 7] = [
        &["dump", "-T", "100", "-l", &link, "--force"],
        &["dump", "-T", "100", "--capture", &link, "--force"],
        &["replay", &drive, "--record", &link, "--force"],
        &["send", "123#", "--capture", &link, "--force"],
        &["gen", "-n", "1", "--capture", &link, "--force"],
        &["diag", "--record", &link],
        &["man", &pages],
    ];
    for command in commands {
        let output = bus.run(command);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{command:?}: {errors}");
        assert!(errors.contains("the path is a symbolic link"), "{command:?}: {errors}");
        assert_eq!(bus.read("kept"), "precious", "{command:?}");
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink(), "{command:?}");
    }
}
