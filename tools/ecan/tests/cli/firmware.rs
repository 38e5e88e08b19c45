//! `ecan firmware` with a stand-in for IgH's tool in front of simulated gateways, and on the
//! simulator.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::fake_ethercat::{Behaviour, FakeEthercat};
use crate::support::terminal::with_answer;
use crate::support::{assert_has, ecan, fails, good, json_of};
use ecan_sim::{Fault, FirmwarePackage, GatewayFault};
use ecan_test_support::Killed;
use serde_json::Value;
use tempfile::{NamedTempFile, TempDir};

/// 3.0.7 in the numbers of 0xF000.
const NEW: u32 = 0x0300_0007;

fn file(bytes: &[u8]) -> NamedTempFile {
    let file = tempfile::Builder::new().suffix(".bin").tempfile().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    file
}

fn package(version: u32) -> NamedTempFile {
    file(&FirmwarePackage::new(0, version, vec![0x5A; 20_000]).to_bytes())
}

/// Exit status, output and messages of `ecan firmware` with the tool.
fn firmware(tool: &Path, arguments: &[&str]) -> (i32, String, String) {
    let tool = tool.to_str().unwrap();
    let output = ecan(&[&["firmware", "--ethercat", tool][..], arguments].concat());
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, errors) = (text(output.stdout), text(output.stderr));
    assert!(!errors.contains("panicked"), "{errors}");
    (output.status.code().unwrap(), out, errors)
}

/// An update without questions.
fn update(tool: &FakeEthercat, file: &Path, more: &[&str]) -> (i32, String, String) {
    let arguments = [&["update", file.to_str().unwrap(), "--yes"][..], more].concat();
    firmware(&tool.program, &arguments)
}

fn running(tool: &FakeEthercat, gateway: usize) -> u32 {
    let master = tool.master();
    let file = master.line.wire.world().gateway(gateway).unwrap().running_firmware();
    FirmwarePackage::parse(file).unwrap().version
}

#[test]
fn version_is_read_with_ethercat_tool() {
    let tool = FakeEthercat::new(2, Behaviour::Good);
    let (status, out, _) = firmware(&tool.program, &["version", "--all"]);
    let expected = "\
POS  STATE  FIRMWARE  SERIAL
0    PREOP  2.2.1     4294967297
1    PREOP  2.2.1     4294967298
";
    assert_eq!((status, out.as_str()), (0, expected));
    let (status, out, _) =
        firmware(&tool.program, &["version", "--slave", "serial=4294967298", "--json"]);
    let json = json_of(&out);
    assert_eq!((status, &json[0]["position"]), (0, &Value::from(1)));
    assert_eq!((&json[0]["version"], &json[0]["build"]), (&0x0202.into(), &1.into()));
    assert_eq!((&json[0]["firmware"], &json[0]["numbers"]), (&"2.2.1".into(), &"2.2.1".into()));
    let (status, _, errors) = firmware(&tool.program, &["version"]);
    assert_eq!(status, 4);
    assert!(errors.contains("several gateways; select one with --slave: 0, 1, or all with --all"));
}

#[test]
fn unreadable_version_has_reason() {
    let product_code = crate::fake_ethercat::PRODUCT_CODE;
    let silent = FakeEthercat::new(3, Behaviour::Silent { position: 1, product_code });
    let (status, out, errors) = firmware(&silent.program, &["version", "--all"]);
    assert_eq!(status, 5, "{errors}");
    let expected = "\
POS  STATE  FIRMWARE  SERIAL
0    PREOP  2.2.1     4294967297
1    PREOP  -         not read: cannot be identified: ethercat \
upload: Failed to upload SDO: Input/output error
2    PREOP  2.2.1     4294967299
";
    assert_eq!(out, expected);
    assert!(errors.contains("1 of 3 gateways were not read; see above"), "{errors}");
    // One that rejects an object.
    let bus = crate::support::scenario(
        "[[gateway]]\n[[gateway]]\n[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\n\
         index = 0xF000\nsubindex = 7\ncode = 0x08000022\ntimes = 9\n",
    );
    let setting = crate::support::setting(&bus);
    let command = ["--ecrt", &setting, "firmware", "version", "--all", "--json"];
    let json = json_of(&crate::support::ends(5, &command));
    assert!(json[0]["error"].as_str().unwrap().contains("0x08000022"), "{json}");
    assert_eq!((&json[0]["firmware"], &json[1]["firmware"]), (&Value::Null, &"2.2.1".into()));
    assert!(json[1]["error"].is_null(), "{json}");
}

#[test]
fn update_writes_package_and_reads_version() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Good), package(NEW));
    let (status, out, errors) = update(&tool, package.path(), &["--expect-version", "3.0.7"]);
    assert_eq!(status, 0, "{errors}");
    assert_eq!(out, "POS  BEFORE  AFTER  RESULT\n0    2.2.1   3.0.7  updated\n");
    assert!(
        errors
            .contains("package for simulated gateways (from ecan-sim); a real gateway rejects it")
    );
    assert_eq!(running(&tool, 0), NEW);
    let path = package.path().to_str().unwrap();
    let expected = ["foe_write", "--master", "0", "--position", "0", "--output-file"];
    assert_eq!(tool.writes(), [[&expected[..], &["ecan_lite_app", path, "0"]].concat()]);
}

/// Each transfer adds a response to the mailbox and fetches an older one.
#[test]
fn file_is_written_after_the_responses_of_a_dictionary_fetch() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Good), package(NEW));
    tool.master().dictionary_responses = 5;
    let (status, out, errors) = update(&tool, package.path(), &[]);
    assert_eq!(status, 0, "{out}{errors}");
    assert_eq!((running(&tool, 0), tool.writes().len()), (NEW, 2));
}

#[test]
fn position_is_never_passed_as_password() {
    let package = package(NEW);
    let old = FakeEthercat::new(1, Behaviour::Of15);
    assert_eq!(update(&old, package.path(), &[]).0, 0);
    assert_eq!(old.writes()[0].last().unwrap(), package.path().to_str().unwrap());
    let other = FakeEthercat::new(1, Behaviour::TakesPositionForPassword);
    let (status, _, errors) = update(&other, package.path(), &[]);
    assert_eq!(status, 3);
    assert!(errors.contains("no option --position"), "{errors}");
    assert_eq!(other.writes(), [[""; 0]; 0]);
}

#[test]
fn rejected_package_keeps_old_version() {
    let for_another = FirmwarePackage::new(9, NEW, vec![1; 5000]).to_bytes();
    let mut damaged = FirmwarePackage::new(0, NEW, vec![1; 5000]).to_bytes();
    damaged[4000] ^= 1;
    let mut bare = vec![0; 5000];
    bare[..4].copy_from_slice(&[0x97, 0x01, 0, 0]);
    let cases = [(for_another, ""), (damaged, "payload CRC32"), (bare, "bare")];
    for (bytes, warning) in cases {
        let (tool, file) = (FakeEthercat::new(1, Behaviour::Good), file(&bytes));
        let (status, out, errors) = update(&tool, file.path(), &[]);
        assert_eq!(status, 5, "{out}{errors}");
        assert!(errors.contains(warning), "{errors}");
        assert!(out.contains("0    2.2.1   2.2.1  the gateway rejects the file: it is not a pack"));
        assert!(errors.contains("the gateway does not run the new firmware"), "{errors}");
        assert_eq!(running(&tool, 0), 0x0202_0001);
    }
}

#[test]
fn file_of_any_format_is_sent_to_the_gateway() {
    let text = |first: u8| (0..5000u32).map(|at| first.wrapping_add(at as u8)).collect::<Vec<_>>();
    // Also a first byte that a bare application could have: a real package may begin alike.
    for first in [0x00, b'E', 0x6F, 0x97, b'P'] {
        let (tool, file) = (FakeEthercat::new(1, Behaviour::Good), file(&text(first)));
        let (status, out, errors) = update(&tool, file.path(), &[]);
        assert_eq!((status, tool.writes().len()), (5, 1), "{first:#x}: {out}{errors}");
        assert!(out.contains("the gateway rejects the file"), "{out}");
        let is_suspicious = matches!(first, 0x6F | 0x97);
        let unknown = "format not recognised; the gateway checks the package";
        assert_eq!(errors.contains(unknown), !is_suspicious, "{first:#x}: {errors}");
    }
}

#[test]
fn rejection_reason_comes_from_gateway() {
    let (tool, file) = (FakeEthercat::new(1, Behaviour::Of15), file(&[0x55; 5000]));
    let (status, out, _) = update(&tool, file.path(), &["--json"]);
    let json = json_of(&out);
    assert_eq!((status, &json[0]["rejection"]["cause"]), (5, &Value::from("verify")));
    assert_has(json[0]["text"].as_str().unwrap(), "FOE_ACK_ERROR; status 0xB000:11 = 0x8010");
}

#[test]
fn flash_failure_is_reported() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Good), package(NEW));
    let fault = GatewayFault::FlashFailure { times: 1 };
    tool.master().line.wire.world_mut().inject(Fault::Gateway { gateway: 0, fault });
    let (status, out, _) = update(&tool, package.path(), &[]);
    assert_eq!(status, 5);
    assert!(out.contains("flash of the gateway cannot be erased or written"), "{out}");
}

#[test]
fn interrupted_update_keeps_old_version() {
    let behaviour = Behaviour::SupplyFails { packets: 50, off_ms: 1_000 };
    let (tool, package) = (FakeEthercat::new(1, behaviour), package(NEW));
    let (status, out, _) = update(&tool, package.path(), &["--timeout", "1s", "--json"]);
    assert_eq!(status, 5, "{out}");
    let json = json_of(&out);
    assert_eq!(json[0]["result"], "rejected");
    assert_eq!(json[0]["rejection"]["cause"], "interrupted");
    assert_eq!(json[0]["is_good"], false);
    tool.master().line.pass(5_000 * crate::fake_ethercat::wire_support::MS);
    let (status, out, errors) = firmware(&tool.program, &["version"]);
    assert_eq!(status, 0, "{errors}");
    assert!(out.contains("2.2.1"), "{out}");
    // And the next one succeeds.
    tool.master().behaviour = Behaviour::Good;
    assert_eq!(update(&tool, package.path(), &[]).0, 0);
    assert_eq!(running(&tool, 0), NEW);
}

#[test]
fn new_version_counts_without_the_last_answer() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::AnswerLost), package(NEW));
    let (status, out, errors) = update(&tool, package.path(), &[]);
    assert_eq!(status, 0, "{out}{errors}");
    assert!(out.contains("0    2.2.1   3.0.7  updated\n"), "{out}");
    assert_eq!(running(&tool, 0), NEW);
}

#[test]
fn unexpected_version_fails() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Good), package(NEW));
    let (status, out, _) = update(&tool, package.path(), &["--expect-version", "3.1.0"]);
    assert_eq!(status, 1);
    assert!(out.contains("3.0.7  wrong version, expected 3.1.0"), "{out}");
}

#[test]
fn unchanged_version_fails() {
    let package = package(0x0202_0001);
    let same = FakeEthercat::new(1, Behaviour::Good);
    let (status, out, _) = update(&same, package.path(), &["--timeout", "4s"]);
    assert_eq!(status, 1);
    assert!(out.contains("2.2.1  version unchanged: the file contains the same"), "{out}");
}

#[test]
fn expected_same_version_succeeds() {
    let (same, package) = (FakeEthercat::new(1, Behaviour::Good), package(0x0202_0001));
    let more = ["--timeout", "4s", "--expect-version", "2.2.1"];
    let (status, out, _) = update(&same, package.path(), &more);
    assert_eq!(status, 0, "{out}");
    assert!(out.contains("reinstalled"), "{out}");
}

#[test]
fn missing_restart_fails() {
    let package = package(0x0202_0001);
    let liar = FakeEthercat::new(1, Behaviour::Lies);
    for expected in [&[][..], &["--expect-version", "2.2.1"]] {
        let more = [&["--timeout", "1s"], expected].concat();
        let (status, out, _) = update(&liar, package.path(), &more);
        assert_eq!(status, 1);
        assert!(out.contains("no restart observed"), "{out}");
    }
}

#[test]
fn unresponsive_gateway_is_reported() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::NeverBack), package(NEW));
    let (status, out, _) = update(&tool, package.path(), &["--timeout", "1s"]);
    assert_eq!(status, 5);
    assert!(out.contains("written, but the gateway does not respond"), "{out}");
    assert!(out.contains("Slave 0 does not exist"), "{out}");
    let tool = FakeEthercat::new(1, Behaviour::NeverBack);
    let (_, out, _) = update(&tool, package.path(), &["--timeout", "1s", "--json"]);
    let json = json_of(&out);
    assert_eq!(json[0]["result"], "not_back");
}

#[test]
fn several_gateways_are_updated_in_turn() {
    let (tool, package) = (FakeEthercat::new(3, Behaviour::Good), package(NEW));
    let fault = GatewayFault::FlashFailure { times: 1 };
    tool.master().line.wire.world_mut().inject(Fault::Gateway { gateway: 1, fault });
    let (status, out, errors) = update(&tool, package.path(), &["--all"]);
    assert_eq!(status, 5, "{out}");
    assert!(
        out.contains("0    2.2.1   3.0.7  updated\n1    2.2.1   2.2.1  the flash of the gateway")
    );
    assert!(out.contains("\n2    2.2.1   3.0.7  updated\n2 of 3 gateways run the new firmware\n"));
    assert!(errors.contains("1 of 3 gateways do not run the new firmware"), "{errors}");
    assert!(
        errors.contains("slave 0: 2.2.1 -> 3.0.7, updated\nslave 1: 2.2.1, the flash"),
        "{errors}"
    );
    assert_eq!([0, 1, 2].map(|slave| running(&tool, slave)), [NEW, 0x0202_0001, NEW]);
    let (status, out, _) = update(&tool, package.path(), &["--slave", "1"]);
    assert_eq!((status, tool.writes().len()), (0, 4), "{out}");
    assert_eq!(running(&tool, 1), NEW);
}

#[test]
fn harmful_file_stops_after_one_gateway() {
    let package = package(NEW);
    let tool = FakeEthercat::new(2, Behaviour::NeverBack);
    let (status, out, _) = update(&tool, package.path(), &["--all", "--timeout", "1s"]);
    assert_eq!((status, tool.writes().len()), (5, 1), "{out}");
    assert!(out.contains(
        "1    -       -      nothing written: slave 0 did not respond after the restart\n"
    ));
    let tool = FakeEthercat::new(2, Behaviour::Good);
    let more = ["--all", "--expect-version", "3.1.0"];
    let (status, out, _) = update(&tool, package.path(), &more);
    assert_eq!((status, tool.writes().len()), (5, 1), "{out}");
    assert!(out.contains("nothing written: slave 0 runs a wrong version"), "{out}");
    assert_eq!(running(&tool, 1), 0x0202_0001);
}

#[test]
fn other_devices_are_not_updated() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Foreign), package(NEW));
    let (status, out, _) = update(&tool, package.path(), &["--slave", "0"]);
    assert_eq!((status, tool.writes().len()), (5, 0), "{out}");
    assert!(out.contains("not identified as an ECAN-Lite"), "{out}");
    let (status, _, errors) = update(&tool, package.path(), &[]);
    assert_eq!((status, tool.writes().len()), (4, 0));
    assert!(errors.contains("none of the 1 slaves is identified as an ECAN-Lite"), "{errors}");
}

#[test]
fn unidentified_slave_is_always_reported() {
    let (package, product_code) = (package(NEW), crate::fake_ethercat::PRODUCT_CODE);
    let tool = FakeEthercat::new(2, Behaviour::Silent { position: 0, product_code });
    let (status, out, errors) = update(&tool, package.path(), &[]);
    assert_eq!((status, tool.writes().len()), (4, 0), "{out}");
    let text = "slave 0 cannot be identified: ethercat upload: Failed to";
    assert!(errors.contains(text), "{errors}");
    assert!(errors.contains("select one with --slave: 0, 1, or all with --all"), "{errors}");
    let (status, out, errors) = update(&tool, package.path(), &["--all"]);
    assert_eq!((status, tool.writes().len()), (1, 1), "{out}{errors}");
    let line = "\n0    -       -      nothing written: cannot be identified:";
    assert!(out.contains(line), "{out}");
    assert!(out.contains("\n1    2.2.1   3.0.7  updated\n1 of 2 gateways run the new"), "{out}");
    // The identity in the SII tells that it is another device.
    let tool = FakeEthercat::new(2, Behaviour::Silent { position: 0, product_code: 5 });
    let (status, out, _) = update(&tool, package.path(), &[]);
    assert_eq!((status, tool.writes().len()), (0, 1), "{out}");
    assert_eq!(running(&tool, 1), NEW);
    // And on the simulator.
    let bus = crate::support::first_silent();
    let path = package.path().to_str().unwrap();
    let simulated = ["--ecrt", &crate::support::setting(&bus), "firmware", "update", path, "--yes"];
    assert!(fails(4, &simulated).contains("slave 0 cannot be identified"));
    let out = crate::support::ends(1, &[&simulated[..], &["--all"]].concat());
    assert!(out.contains("\n1    2.2.1   3.0.7  updated\n"), "{out}");
}

#[test]
fn interrupt_stops_after_current_gateway() {
    let (tool, package) = (FakeEthercat::new(3, Behaviour::Good), package(NEW));
    // Held, so that the program does not begin before the tool knows it.
    let mut master = tool.master();
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command
        .args(["firmware", "update", "--all", "--yes"])
        .arg(package.path())
        .arg("--ethercat")
        .arg(&tool.program)
        .env_remove("ECAN_ECRT")
        .process_group(0)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let child = Killed::spawn(&mut command);
    master.interrupts = Some(child.id());
    drop(master);
    let ended = child.output();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, errors) = (text(ended.stdout), text(ended.stderr));
    assert_eq!(ended.status.code(), Some(1), "{out}{errors}");
    let expected = "\
POS  BEFORE  AFTER  RESULT
0    2.2.1   3.0.7  updated
1    -       -      nothing written: interrupted before the update
2    -       -      nothing written: interrupted before the update
1 of 3 gateways run the new firmware
";
    assert_eq!(out, expected, "{errors}");
    assert_eq!(tool.writes().len(), 1);
    assert_eq!([0, 1, 2].map(|slave| running(&tool, slave)), [NEW, 0x0202_0001, 0x0202_0001]);
    let said = "interrupted: stopping after the current gateway\n\
                slave 0: 2.2.1 -> 3.0.7, updated\n\
                slave 1: nothing written: interrupted before the update\n";
    assert!(errors.contains(said), "{errors}");
}

/// As [`firmware`], with a terminal for input and messages, at which this is typed.
fn at_a_terminal(tool: &FakeEthercat, file: &Path, typed: &str) -> (i32, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(["firmware", "update"]).arg(file).arg("--ethercat").arg(&tool.program);
    with_answer(command.env_remove("ECAN_ECRT"), typed)
}

#[test]
fn update_asks_and_shows_progress_on_terminal() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Good), package(NEW));
    for typed in ["n\n", "\n"] {
        let (status, shown) = at_a_terminal(&tool, package.path(), typed);
        assert_eq!((status, tool.writes().len()), (2, 0), "{shown}");
        assert!(shown.contains(" (20032 bytes) to slave 0 (PREOP)?"), "{shown}");
        assert!(shown.contains("nothing written: not confirmed"), "{shown}");
    }
    let (status, shown) = at_a_terminal(&tool, package.path(), "y\n");
    assert_eq!((status, tool.writes().len()), (0, 1), "{shown}");
    assert!(shown.contains("slave 0: writing 19.56 KiB"), "{shown}");
    assert!(shown.contains("slave 0: written, waiting for the restart"), "{shown}");
}

#[test]
fn messages_of_the_real_tool_are_explained() {
    let package = package(NEW);
    let cases = [
        (
            Behaviour::Fails("Failed to open master device /dev/EtherCAT0: Permission denied"),
            3,
            "run with sudo",
        ),
        (
            Behaviour::Fails(
                "Failed to open master device /dev/EtherCAT0: No such file or directory",
            ),
            3,
            "check that the master's module is loaded",
        ),
        (
            Behaviour::Fails("ioctl() version magic is differing: /dev/EtherCAT0: 31, tool: 33"),
            3,
            "different versions",
        ),
        (
            Behaviour::WriteFails("Failed to open master device /dev/EtherCAT0: Permission denied"),
            3,
            "run with sudo",
        ),
        (
            Behaviour::WriteFails("FoE write aborted with error code 0x0000800a: No rights."),
            5,
            "rejects the password",
        ),
        (Behaviour::WriteFails("Failed to write via FoE: FOE_TIMEOUT_ERROR"), 5, "interrupted"),
        (Behaviour::WriteFails("Failed to write via FoE: FOE_MBOX_PROT_ERROR"), 5, "PREOP"),
        (Behaviour::WriteFails("something that nobody has seen"), 5, "nobody has seen"),
        (Behaviour::Babbles, 5, "\"Good morning!\", which is not output of IgH's tool"),
    ];
    for (behaviour, expected, text) in cases {
        let tool = FakeEthercat::new(1, behaviour.clone());
        let (status, out, errors) = update(&tool, package.path(), &["--timeout", "1s"]);
        assert_eq!(status, expected, "{behaviour:?}: {errors}");
        assert!((out + &errors).contains(text), "{behaviour:?}: {errors}");
    }
}

#[test]
fn invalid_use_is_reported_before_writing() {
    let (tool, package) = (FakeEthercat::new(1, Behaviour::Good), package(NEW));
    let path = package.path().to_str().unwrap();
    let program = tool.program.to_str().unwrap();
    let (empty, short, directory) = (file(b""), file(b"abc"), TempDir::new().unwrap());
    let of = |file: &NamedTempFile| file.path().to_str().unwrap().to_owned();
    let cases: [(i32, &[&str], &str); 9] = [
        (2, &["update", path], "use --yes"),
        (2, &["update", path, "--yes", "--all", "--slave", "0"], "exclude each other"),
        (4, &["update", path, "--yes", "--slave", "7"], "slave 7 does not exist; allowed: 0"),
        (4, &["update", path, "--yes", "--slave", "alias=9"], "no slave has the alias 9"),
        (6, &["update", "/nonexistent.bin", "--yes"], "cannot read /nonexistent.bin: No such file"),
        (6, &["update", &of(&empty), "--yes"], "file is empty"),
        (6, &["update", &of(&short), "--yes"], "3 bytes are too small"),
        (6, &["update", directory.path().to_str().unwrap(), "--yes"], "directory"),
        (2, &["update"], "required arguments"),
    ];
    for (status, arguments, text) in cases {
        let (found, _, errors) = firmware(&tool.program, arguments);
        assert_eq!(found, status, "{arguments:?}: {errors}");
        assert!(errors.contains(text), "{arguments:?}: {errors}");
    }
    assert_eq!(tool.writes(), [[""; 0]; 0]);
    let missing = ["firmware", "version", "--ethercat", "/nonexistent/ethercat"];
    assert!(fails(3, &missing).contains("cannot start /nonexistent/ethercat: No such file"));
    let both = ["--ecrt", "sim", "firmware", "version", "--ethercat", program];
    assert!(fails(2, &both).contains("cannot be used with a simulated master"));
}

#[test]
fn simulated_update_needs_no_tool() {
    let package = package(NEW);
    let path = package.path().to_str().unwrap();
    let scenario = crate::support::two_gateways();
    let setting = format!("sim:{}", scenario.path().display());
    let out = good(&["--ecrt", &setting, "firmware", "update", path, "--all", "--yes"]);
    let expected = "\
POS  BEFORE  AFTER  RESULT
0    2.2.1   3.0.7  updated
1    2.2.1   3.0.7  updated
2 of 2 gateways run the new firmware
";
    assert_eq!(out, expected);
    let wrong = file(&vec![0x55; 4000]);
    let wrong = wrong.path().to_str().unwrap();
    let message = fails(5, &["--ecrt", "sim", "firmware", "update", wrong, "--yes"]);
    assert!(message.contains("looks like a single repeated byte"), "{message}");
}
