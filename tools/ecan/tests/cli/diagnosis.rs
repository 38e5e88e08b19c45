//! `diag`: on a device, in files, misused.

use std::path::Path;
use std::process::Command;

use crate::support::terminal::with_answer;
use crate::support::{
    all_fail, ecan, ends, fails, good, json_of, scenario, setting, simulated, write_program,
};

/// The bundle of the simulated gateway, with values changed: object and value.
fn bundle(directory: &Path, changes: &[(&str, u32)]) -> String {
    let path = directory.join("bundle.json").display().to_string();
    simulated(&["diag", "--record", &path]);
    let mut bundle: serde_json::Value = json_of(&std::fs::read_to_string(&path).unwrap());
    for (object, value) in changes {
        let values = &mut bundle["gateways"][0]["snapshot"]["values"];
        assert!(values[object].is_u64(), "{object} was read");
        values[object] = (*value).into();
    }
    std::fs::write(&path, bundle.to_string()).unwrap();
    path
}

#[test]
fn idle_gateway_has_no_finding() {
    let report = simulated(&["diag"]);
    let expected = "\
slave 0, PREOP, ECAN-Lite, firmware 2.2.1, serial 4294967297
AL status code: not read
diagnostic flags: none

       BYTES       ASSIGNED   STATUS  LAST ERROR  ERRORS  OVERFLOWS
TxPDO  not active  24 chunks  0 OK    0 OK        0       0
RxPDO  not active  24 chunks  0 OK    0 OK        0       0

CAN0  disabled, 0 received and 0 to send pending
CAN1  disabled";
    assert!(report.starts_with(expected), "{report}");
    assert!(report.ends_with("\nno findings\n"), "{report}");
    assert!(report.contains("\ncycle performance (0x9011): no profile is active\n"), "{report}");
}

#[test]
fn findings_list_causes_by_likelihood() {
    let directory = tempfile::tempdir().unwrap();
    // CAN1 is bus-off: transmit errors 248, PSR with bus-off and an acknowledge error.
    let changes =
        [("0x9001:01", 0xF8), ("0x9001:02", 0x07EB), ("0x9001:09", 0x3B), ("0x8010:02", 5)];
    let path = bundle(directory.path(), &changes);
    let report = ends(1, &["diag", "--from", &path]);
    let expected = "
CAN1  bus-off, CAN FD, warning, bus-off, 0 received and 0 to send pending
  ECR        248 transmit errors, 0 receive errors
  PSR        idle, bus-off, last error: acknowledge error
";
    assert!(report.contains(expected), "{report}");
    let brief = ends(1, &["diag", "--brief", "--from", &path]);
    let expected = "\
slave 0, PREOP, ECAN-Lite, firmware 2.2.1, serial 4294967297
AL status code: not read
diagnostic flags: none
fault [profile-mapping-reload] TxPDO: profile not applied: 0x8010:02 is 5 (master mapping reload required: PDO assignment and size multiplier differ)
  causes 1. 0x1C12/0x1C13 assign another number of chunks than N = 8
         2. the profile was applied before the assignment was written
         3. the mapping in the master project was changed but not reloaded
  next   select the first N chunks in the master, load its mapping, then apply
  manual 5.4.6
fault [bus-off] CAN1: the channel is bus-off and does not send or receive
  causes 1. CAN_H and CAN_L are short-circuited or swapped
         2. termination is missing
         3. bit rate or sample point differs from the other nodes; this channel: 500 kbit/s, sample point 75.0 to 87.5 %, data phase 5000 kbit/s, 75.0 to 87.5 %
         4. another node uses another bit rate, or sends CAN FD frames to classic nodes
  next   repair the bus wiring first: 60 ohms between CAN_H and CAN_L; recovery is automatic after 128 sequences of 11 recessive bits
  manual 16.3
warning [sample-point-range] CAN1: the firmware chooses the sample point of CAN FD: nominal 75.0 to 87.5 %, data 75.0 to 87.5 %
  causes 1. the range of the defaults was kept; the timing may not match that of the peers
  next   write the sample point of the peers as both bounds (0x8002:21 to 0x8002:24) and apply the channel
  manual 5.4.3, 16.3
";
    assert_eq!(brief, expected);
}

#[test]
fn impossible_values_are_explained() {
    let directory = tempfile::tempdir().unwrap();
    let changes = [
        ("0x8010:09", 23),
        ("0x8010:10", u32::MAX),
        ("0x1C13:00", u32::MAX),
        ("0x8000:13", u32::MAX),
        ("0x9000:01", 128),
        ("0x9000:02", 0x077B),
        ("0x9000:09", 0x001A),
        ("0x8002:02", 4),
        ("0x8002:62", 200),
    ];
    let path = bundle(directory.path(), &changes);
    let report = ends(1, &["diag", "--brief", "--from", &path]);
    for words in [
        "[frame-area] TxPDO: 23 active bytes are smaller than the header of 24\n",
        "[assignment-differs] TxPDO: 0x1C13 assigns 4294967295 chunks",
        "the pins are rotated by 4294967295: this channel uses pin group 3\n",
        "causes 1. RX FIFO0 size (subindex 62) = 200 is out of range; allowed: 0 to 64\n",
        "apply it (0x8002:01 = 1) and read 0x8002:02 again\n",
    ] {
        assert!(report.contains(words), "{words}: {report}");
    }
}

#[test]
fn json_has_registers_findings_and_values() {
    let directory = tempfile::tempdir().unwrap();
    let path = bundle(directory.path(), &[("0x9000:01", 0x0000_2005), ("0x8011:16", 3)]);
    let report = json_of(&ends(1, &["diag", "--json", "--from", &path]));
    assert_eq!(report["channels"][0]["error_counters"]["transmit"], 5);
    assert_eq!(report["channels"][0]["error_counters"]["receive"], 0x20);
    assert_eq!(report["channels"][0]["protocol"]["last_error"], "no_change");
    assert_eq!(report["findings"][0]["id"], "pdo-overflow");
    assert_eq!(report["findings"][0]["location"], "rx_pdo");
    assert!(report["gateway"]["snapshot"]["values"].as_object().unwrap().len() > 500);
    let bundle = json_of(&std::fs::read_to_string(&path).unwrap());
    assert_eq!(bundle["format"], "ecan-diagnosis");
    assert_eq!(bundle["host"]["is_simulated"], true);
    assert_eq!(bundle["master"]["slaves"][0]["product_code"], 0x4C49_5445);
    assert_eq!(bundle["host"]["checks"][0]["name"], "kernel module");
}

#[test]
fn ethercat_tool_reads_al_status_code_and_sync_managers() {
    let directory = tempfile::tempdir().unwrap();
    let tool = directory.path().join("ethercat");
    let log = directory.path().join("log");
    let text = format!("#!/bin/sh\necho \"$@\" >> {}\necho '0x001b 27'\n", log.display());
    write_program(&tool, &text);
    let tool = tool.display().to_string();
    let report = ends(1, &["--ecrt", "sim", "diag", "--brief", "--ethercat", &tool]);
    assert!(
        report.contains("AL status code: 0x001B sync manager watchdog: outputs did not arrive"),
        "{report}"
    );
    assert!(report.contains("fault [al-watchdog] EtherCAT: the gateway is in PREOP with"));
    let layout =
        "fault [sync-manager-layout] RxPDO: SM2 has start 0x001B and control byte 0x1B instead of";
    assert!(report.contains(layout), "{report}");
    let calls: String = [0x0134]
        .into_iter()
        .chain((0x0810..0x0820).step_by(2))
        .map(|at| format!("reg_read --master 0 --position 0 --type uint16 0x{at:04x}\n"))
        .collect();
    assert_eq!(std::fs::read_to_string(log).unwrap(), calls);
    // One that does not end is ended and told, and the rest is read all the same.
    write_program(tool.as_ref(), "#!/bin/sh\nexec sleep 1000\n");
    let output = crate::support::ecan(&["--ecrt", "sim", "diag", "--brief", "--ethercat", &tool]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success());
    let words = "not read: ethercat reg_read did not exit within 5 s and was killed";
    assert!(errors.contains(words), "{errors}");
    // One that fails likewise.
    write_program(tool.as_ref(), "#!/bin/sh\necho 'Failed to open /dev/EtherCAT0' >&2\nexit 1\n");
    let output = crate::support::ecan(&["--ecrt", "sim", "diag", "--brief", "--ethercat", &tool]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success());
    let words = "AL status code not read: ethercat reg_read: Failed to open /dev/EtherCAT0";
    assert!(errors.contains(words), "{errors}");
}

#[test]
fn missing_values_are_marked() {
    let silent = scenario(
        "[[gateway]]\n[[fault]]\nkind = \"mailbox_timeout\"\nat_ms = 0\ngateway = 0\n\
         for_ms = 60000\n",
    );
    let silent = setting(&silent);
    let report = ends(1, &["--ecrt", &silent, "diag"]);
    let expected = "\
slave 0, PREOP, ECAN-Lite, firmware not read, serial not read
AL status code: not read
diagnostic flags: not read

process data: not read

channels: not read

cycle performance (0x9011): not read

fault [mailbox-silent]";
    assert!(report.starts_with(expected), "{report}");
    let json = json_of(&ends(1, &["--ecrt", &silent, "diag", "--json"]));
    assert!(json["flags"].is_null() && json["gateway"]["firmware"].is_null(), "{json}");

    let rejected =
        [(0x100A, 0), (0x8011, 2), (0x8011, 15), (0x9000, 1), (0x9000, 13), (0x9022, 12)].map(
            |(index, subindex)| {
                format!(
                    "[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\nindex = {index}\n\
                 subindex = {subindex}\ncode = 0x06090011\ntimes = 9\n"
                )
            },
        );
    let rejected = scenario(&format!("[[gateway]]\n{}", rejected.concat()));
    let rejected = setting(&rejected);
    // A bundle contains the values of disabled channels too.
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("bundle.json").display().to_string();
    let report = good(&["--ecrt", &rejected, "diag", "--record", &file]);
    for words in [
        "slave 0, PREOP, ECAN-Lite, firmware not read, serial 4294967297\n",
        "RxPDO  not active  24 chunks  not read  0 OK        not read  0\n",
        "\n  ECR        not read\n",
        "\n  counters   received dropped not read, 0 TX backpressure, 0 bus-off\n",
        "; TX FIFO full 0 times, stale not read; ",
        "\nno findings; 5 entries were not read\n",
    ] {
        assert!(report.contains(words), "{words}: {report}");
    }
    let json = json_of(&good(&["--ecrt", &rejected, "diag", "--json", "--record", &file]));
    let channel = &json["channels"][0];
    assert!(channel["rx_dropped"].is_null() && channel["error_counters"].is_null(), "{channel}");
    assert_eq!(channel["tx_backpressure"], 0);
    assert!(json["directions"][1]["status_words"].is_null());
}

#[test]
fn gateways_are_read_in_parallel() {
    // In real time, each on a thread of its own.
    let bus = scenario("clock = \"real\"\n[[gateway]]\n[[gateway]]\n[[gateway]]\n");
    let json = json_of(&good(&["--ecrt", &setting(&bus), "diag", "--all", "--json"]));
    let serials = json.as_array().unwrap().iter().map(|report| &report["gateway"]["serial"]);
    let serials: Vec<_> = serials.map(|serial| serial.as_u64().unwrap()).collect();
    assert_eq!(serials, [4_294_967_297, 4_294_967_298, 4_294_967_299]);
}

#[test]
fn slow_reading_shows_progress_on_a_terminal() {
    // The mailbox responds only after the time in which nothing is shown.
    let bus = scenario(
        "clock = \"real\"\n[master]\nlike = \"igh\"\n[[gateway]]\n[[fault]]\n\
         kind = \"mailbox_timeout\"\ngateway = 0\nat_ms = 400\nfor_ms = 2500\n",
    );
    let mut diag = Command::new(env!("CARGO_BIN_EXE_ecan"));
    diag.args(["--ecrt", &setting(&bus), "diag", "--brief"]).env_remove("ECAN_ECRT");
    let (status, shown) = with_answer(&mut diag, "");
    assert_eq!(status, 0, "{shown}");
    assert!(shown.contains("\r\x1b[Kreading the gateways: "), "{shown:?}");
    assert!(shown.ends_with("\r\x1b[K"), "the line is removed: {shown:?}");
}

#[test]
fn simulated_faults_are_found() {
    // Silent while it is read, and from the start, when it does not even show itself as a gateway.
    for at_ms in [10, 0] {
        let file = scenario(&format!(
            "[[gateway]]\n[[fault]]\nkind = \"mailbox_timeout\"\nat_ms = {at_ms}\ngateway = 0\n\
             for_ms = 60000\n"
        ));
        let report = ends(1, &["--ecrt", &setting(&file), "diag", "--brief"]);
        let words = "fault [mailbox-silent] EtherCAT: objects cannot be read: SDO upload 0x8010:";
        assert!(report.contains(words), "{report}");
    }
    let file = scenario(
        "[[gateway]]\n[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\nindex = 0x9011\n\
         subindex = 1\ncode = 0x06010000\n",
    );
    let directory = tempfile::tempdir().unwrap();
    let bundle = directory.path().join("bundle.json").display().to_string();
    let report = good(&["--ecrt", &setting(&file), "diag", "--record", &bundle]);
    assert!(report.contains("\nnot read\n  0x9011:01  0x06010000"), "{report}");
}

#[test]
fn clear_runs_after_reading() {
    let output = crate::support::ecan(&["--ecrt", "sim", "diag", "--clear", "--brief"]);
    assert!(output.status.success());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.ends_with("counters and flags cleared\n"), "{errors}");
    // The gateway has to take each of the commands.
    for (index, subindex) in [(0x8010, 8), (0x8011, 8), (0x9011, 14), (0xB000, 4)] {
        let file = scenario(&format!(
            "[[gateway]]\n[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\n\
             index = {index}\nsubindex = {subindex}\ncode = 0x08000022\ntimes = 9\n"
        ));
        let message = fails(5, &["--ecrt", &setting(&file), "diag", "--clear", "--brief"]);
        let name = format!("0x{index:04X}:{subindex:02}");
        assert!(message.contains(&name) && message.contains("0x08000022"), "{message}");
    }
}

#[test]
fn report_is_printed_if_record_or_clear_fails() {
    let nowhere = tempfile::tempdir().unwrap();
    let nowhere = nowhere.path().join("none/bundle.json").display().to_string();
    let rejecting = scenario(
        "[[gateway]]\n[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\nindex = 0x8010\n\
         subindex = 8\ncode = 0x08000022\ntimes = 9\n",
    );
    let rejecting = setting(&rejecting);
    let report = ends(5, &["--ecrt", &rejecting, "diag", "--clear", "--brief"]);
    assert!(report.starts_with("slave 0, PREOP,"), "{report}");
    // What is not kept is not cleared either: this gateway would reject that by status 5.
    let report =
        ends(6, &["--ecrt", &rejecting, "diag", "--clear", "--record", &nowhere, "--json"]);
    let report = json_of(&report);
    assert_eq!(report["position"], 0);
}

#[test]
fn all_gateways_are_diagnosed() {
    let two = crate::support::two_gateways();
    let report = good(&["--ecrt", &setting(&two), "diag", "--all", "--brief"]);
    let heads: Vec<_> = report.split("\n\n").map(|head| head.split_once(',').unwrap().0).collect();
    assert_eq!(heads, ["slave 0", "slave 1"]);
    let json = json_of(&good(&["--ecrt", &setting(&two), "diag", "--all", "--json"]));
    assert_eq!((json[1]["position"].as_u64(), json[2].is_null()), (Some(1), true));
    // One that cannot be asked has its finding, and is not cleared.
    let silent = crate::support::first_silent();
    let silent = setting(&silent);
    let report = ends(1, &["--ecrt", &silent, "diag", "--all", "--brief"]);
    assert!(report.contains("fault [mailbox-silent]") && report.ends_with("\nno findings\n"));
    let output = crate::support::ecan(&[
        "--ecrt", &silent, "diag", "--all", "--brief", "--clear", "--slave", "1",
    ]);
    assert_eq!(output.status.code(), Some(2));
    let output = crate::support::ecan(&["--ecrt", &silent, "diag", "--all", "--brief", "--clear"]);
    assert_eq!(output.status.code(), Some(5));
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("\nslave 1: counters and flags cleared\n"), "{errors}");
}

#[test]
fn doctor_writes_a_bundle_and_names_it_last() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (file, config, nowhere) =
        (path("bundle.json"), path("cell.toml"), path("none/bundle.json"));
    std::fs::write(&config, "[[gateway]]\n").unwrap();
    for (ecrt, failure) in [(&["--ecrt", "sim"][..], None), (&[], Some("libethercat.so.1"))] {
        let plain = ecan(&[ecrt, &["doctor"]].concat());
        let record =
            |file| ecan(&[ecrt, &["doctor", "--record", file, "--config", &config]].concat());
        let output = record(&file);
        assert_eq!(output.status, plain.status);
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(message.ends_with(&format!("written to {file}\n")), "{message}");
        let bundle = json_of(&std::fs::read_to_string(&file).unwrap());
        let told = bundle["failure"].as_str();
        assert_eq!(told.is_some(), failure.is_some(), "{told:?}");
        assert!(told.unwrap_or_default().contains(failure.unwrap_or_default()), "{told:?}");
        let host = &bundle["host"];
        assert_eq!(host["configuration"], "[[gateway]]\n");
        let checks = host["checks"].as_array().unwrap();
        assert!(checks.iter().any(|check| check["name"] == "library"), "{checks:?}");
        assert_eq!(bundle["master"].is_null(), failure.is_some());

        let output = record(&nowhere);
        assert_eq!((output.status.code(), output.stdout), (Some(6), plain.stdout));
        let message = String::from_utf8(output.stderr).unwrap();
        let errors = message.lines().filter(|line| line.starts_with("ecan: "));
        assert_eq!(errors.count(), 1, "{message}");
        assert!(message.contains(&format!("ecan: cannot write {nowhere}: ")), "{message}");
    }
    all_fail(&[
        (2, &["doctor", "--root", "/", "--record", &file], "cannot be used with"),
        (2, &["doctor", "--config", &config], "--record"),
    ]);
}

#[test]
fn bundle_is_written_when_things_fail() {
    let directory = tempfile::tempdir().unwrap();
    let two_gateways = crate::support::two_gateways();
    let power_off =
        scenario("[[gateway]]\n[[fault]]\nkind = \"power_off\"\ngateway = 0\nat_ms = 0\n");
    let (two, off) = (setting(&two_gateways), setting(&power_off));
    let file = directory.path().join("bundle.json");
    let path = file.to_str().unwrap();
    let written = |status: i32, ecrt: &[&str]| {
        let arguments = [ecrt, &["diag", "--record", path]].concat();
        let message = if status == 0 { good(&arguments) } else { fails(status, &arguments) };
        let bundle = json_of(&std::fs::read_to_string(path).unwrap());
        std::fs::remove_file(path).unwrap();
        (message, bundle)
    };
    for (status, ecrt, cause) in [
        (3, &[][..], "libethercat.so.1"),
        (3, &["--via", "/run/no.sock"], "/run/no.sock"),
        (4, &["--ecrt", &off], "slave 0"),
        (4, &["--ecrt", &two, "--slave", "7"], "slave 7"),
    ] {
        let (message, bundle) = written(status, ecrt);
        assert!(message.trim_end().ends_with(&format!("written to {path}")), "{message}");
        let failure = bundle["failure"].as_str().unwrap();
        assert!(failure.contains(cause), "{cause}: {failure}");
        assert!(bundle["host"]["checks"].is_array(), "{bundle}");
    }
    let (_, bundle) = written(0, &["--ecrt", &two]);
    assert_eq!(bundle["gateways"].as_array().unwrap().len(), 2);
    assert!(bundle["failure"].is_null());
}

#[test]
fn invalid_use_has_message_and_status() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = directory.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let missing = directory.path().join("none").display().to_string();
    let nowhere = directory.path().join("none/bundle.json").display().to_string();
    let damaged = file("damaged.json", "{\"format\":");
    let foreign = file("foreign.json", "{\"format\": \"other\"}");
    let newer = file("newer.json", "{\"format\": \"ecan-diagnosis\", \"version\": 9}");
    let partial = file("partial.json", "{\"format\": \"ecan-diagnosis\", \"version\": 2}");
    all_fail(&[
        (6, &["diag", "--from", &missing], "cannot read"),
        (6, &["diag", "--from", &damaged], "invalid JSON"),
        (6, &["diag", "--from", &foreign], "not a bundle of `ecan diag --record`"),
        (6, &["diag", "--from", &newer], "version 9 is not supported; supported: 2"),
        (6, &["diag", "--from", &partial], "missing field"),
        (6, &["--ecrt", "sim", "diag", "--record", &nowhere], "cannot write"),
        (2, &["diag", "--from", &missing, "--clear"], "cannot be used with"),
        (2, &["diag", "--from", &missing, "--slave", "1"], "--slave is not used by this command"),
        (2, &["--slave", "1", "diag", "--from", &missing], "--slave is not used by this command"),
        (3, &["diag"], "libethercat.so.1"),
    ]);
}
