//! `config`, used and misused.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::terminal::with_answer;
use crate::support::{
    all_fail, assert_has, ecan, ends, fails, first_silent, good, json_of, scenario, setting,
    simulated, two_gateways,
};
use tempfile::TempDir;

/// A directory with a file of this content.
fn file(content: &str) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cell.toml");
    std::fs::write(&path, content).unwrap();
    (directory, path)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

const SMALL: &str = "\
cycle_us = 1000
[[gateway]]
n = 8
[gateway.can0]
bitrate = 500_000
data_bitrate = 5_000_000
sample_point = 80
[gateway.can2]
bitrate = 125_000
";

const TEN_FAULTS: &str = "\
cycle_us = 50
allow_large_pdos = 1
[dc]
shift_us = 2000
sourc = 'host'
[[gateway]]
n = 0
[gateway.tx_pdo]
budget = 'fair'
[gateway.can0]
bitrate = 333
sample_point = [90, 80]
[gateway.can1]
bitrate = 500_000
node_mode = 'loud'
ram = { tx_fifo_size = 32, tx_dedicated_count = 1 }
[[gateway.can1.standard_filter]]
match = 'range'
action = 'fifo0'
id1 = 0x800
id2 = 0x7FF
";

#[test]
fn example_file_passes_check() {
    let (_directory, path) = file(&good(&["config", "example"]));
    let expected = "\
gateway 0: position 0
  RxPDO  N = 8: 1024 bytes, frame area 1000 bytes, profile 0, options none
  TxPDO  N = 8: 1024 bytes, frame area 1000 bytes, profile 0, options none
  CAN0   CAN FD, delay compensation on
         nominal  1000000 bit/s, error 0 ppm, sample point 87.5 %; vendor's public driver: BRP 1 TSEG1 69 TSEG2 10 SJW 10
         data     5000000 bit/s, error 0 ppm, sample point 87.5 %; vendor's public driver: BRP 1 TSEG1 13 TSEG2 2 SJW 2
         Message RAM 8192 of 8192 bytes, filters: 2 standard, 1 extended
  CAN1   classic CAN
         nominal  500000 bit/s, error 0 ppm, sample point 87.5 %; vendor's public driver: BRP 1 TSEG1 139 TSEG2 20 SJW 20
         Message RAM 3456 of 8192 bytes, filters: 0 standard, 0 extended
EtherCAT: 2048 bytes of process data, 2 frame(s), 176.0 us of 1000 us (17.6 %)
Sync0: 500 us after the start of its period
";
    assert_eq!(good(&["config", "check", text(&path)]), expected);
    let json = json_of(&good(&["config", "check", text(&path), "--json"]));
    assert_eq!(json["gateways"][0]["channels"][0]["data"]["sample_point_percent"][1], 87.5);
    assert_eq!(json["gateways"][0]["channels"][0]["message_ram_bytes"], 8192);
    assert_eq!(json["gateways"][0]["images"][1]["profile_word"], 7 | 3 << 5);
    assert_eq!(json["faults"], serde_json::json!([]));
}

#[test]
fn check_reports_every_fault_with_location() {
    let (_directory, path) = file(TEN_FAULTS);
    let output = ecan(&["config", "check", text(&path)]);
    assert_eq!(output.status.code(), Some(1));
    let listed = String::from_utf8(output.stdout).unwrap();
    let head = format!("{}:", path.display());
    let places: Vec<_> = listed.lines().map(|line| line.strip_prefix(&head).expect(line)).collect();
    let expected = [
        "1:12: cycle of 50 us is out of range",
        "2:20: `allow_large_pdos` must be true or false, not an integer",
        "5:1: unknown key `sourc`; did you mean `source`?",
        "7:5: `n` = 0 is out of range; allowed: 1 to 24",
        "9:10: `budget` = \"fair\" is invalid; allowed: \"balanced\"",
        "11:11: slave 0, channel 0: nominal bit timing: 333 bit/s cannot be divided from a clock",
        "12:16: slave 0, channel 0: nominal bit timing: sample point window 90 %..80 %",
        "15:13: `node_mode` = \"loud\" is invalid",
        "16:49: slave 0, channel 1: 32 FIFO and 1 dedicated transmit elements",
        "20:7: `id1` = 2048 is out of range; allowed: 0 to 2047",
    ];
    assert_eq!(places.len(), expected.len(), "{listed}");
    for (place, expected) in places.iter().zip(expected) {
        assert!(place.starts_with(expected), "{place}\n{expected}");
    }
    let output = ecan(&["config", "check", text(&path), "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["faults"][9]["line"], 20);
    // Other commands do not use such a file.
    let message = fails(6, &["--ecrt", "sim", "config", "apply", text(&path)]);
    assert!(message.starts_with("ecan: cannot use "), "{message}");
    assert_eq!(message.matches("line ").count(), 10, "{message}");
}

#[test]
fn apply_writes_file_by_parts() {
    let (_directory, path) = file(SMALL);
    let expected = format!(
        "slave 0: configured as gateway 0 of {}
  abilities              0 written,  7 read back
  diagnostic tests off   0 written,  5 read back
  PDO assignment        20 written,  0 read back
  PDO profiles          12 written,  8 read back
  CAN0                  43 written,  1 read back
  filters of CAN0        2 written,  0 read back
  data path of CAN0     18 written,  1 read back
  CAN2                  37 written,  1 read back
  filters of CAN2        2 written,  0 read back
  data path of CAN2     18 written,  1 read back
",
        path.display()
    );
    assert_eq!(simulated(&["config", "apply", text(&path)]), expected);
    let steps = simulated(&["config", "apply", text(&path), "--steps"]);
    assert!(
        steps.contains("    0x8003:19 MCAN Channel Config 2 / Nominal bitrate = 125000\n"),
        "{steps}"
    );
    assert!(
        steps.contains("    0x8010:12 (TxPDO Profile Control, Active profile word) reads 167\n")
    );
}

const THREE: &str = "\
[[gateway]]
n = 3
can0 = { bitrate = 250_000 }
[[gateway]]
position = 1
n = 2
can1 = { bitrate = 125_000 }
[[gateway]]
position = 2
n = 2
can1 = { bitrate = 125_000 }
";

/// Three gateways, of which the second rejects the nominal bit rate of channel 1 with this code.
fn second_of_three_rejects(code: u32) -> tempfile::NamedTempFile {
    scenario(&format!(
        "[[gateway]]\n[[gateway]]\n[[gateway]]\n[[fault]]\nat_ms = 0\nkind = \"sdo_abort\"\n\
         gateway = 1\nindex = 0x8002\nsubindex = 19\ncode = {code}\ntimes = 9\n"
    ))
}

#[test]
fn apply_reports_written_parts_on_failure() {
    let (_directory, path) = file(THREE);
    let path = text(&path);
    let bus = second_of_three_rejects(0x06090030);
    let bus = setting(&bus);
    let told = ends(5, &["--ecrt", &bus, "config", "apply", path, "--steps"]);
    let places: Vec<_> = told.lines().filter(|line| line.starts_with("slave ")).collect();
    let expected = [
        format!("slave 0: configured as gateway 0 of {path}"),
        format!("slave 1: partially configured as gateway 1 of {path}"),
        format!("slave 2: skipped, not configured as gateway 2 of {path}"),
    ];
    assert_eq!(places, expected, "{told}");
    let (first, rest) = told.split_once("slave 1: ").unwrap();
    assert!(first.contains("    0x8001:19 MCAN Channel Config 0 / Nominal bitrate = 250000\n"));
    assert!(rest.contains("  PDO profiles "), "{rest}");
    let reason = rest.lines().find(|line| line.starts_with("  SDO download 0x8002:19")).unwrap();
    assert!(reason.contains("0x06090030"), "{reason}");
    let json = json_of(&ends(5, &["--ecrt", &bus, "config", "apply", path, "--json"]));
    let complete = [0, 1, 2].map(|at| json[at]["is_complete"].as_bool().unwrap());
    assert_eq!(complete, [true, false, false]);
    assert_eq!([0, 1, 2].map(|at| json[at]["position"].as_u64().unwrap()), [0, 1, 2]);
    assert!(json[1]["error"].as_str().unwrap().contains("0x06090030"), "{json}");
    assert!(json[1]["steps"].as_array().unwrap().len() > 20);
    assert_eq!(json[2]["steps"], serde_json::json!([]));
}

#[test]
fn diff_reports_compared_gateways_on_failure() {
    let (_directory, path) = file(THREE);
    let path = text(&path);
    let bus = second_of_three_rejects(0x08000000);
    let bus = setting(&bus);
    let told = ends(5, &["--ecrt", &bus, "config", "diff", path]);
    assert!(told.contains("Nominal bitrate): the file has 250000, the device 500000\n"), "{told}");
    let not: Vec<_> = told.lines().filter(|line| line.contains(": not compared: ")).collect();
    assert!(not[0].starts_with("slave 1: not compared: SDO upload 0x8002:19"), "{told}");
    assert_eq!(not[1..], ["slave 2: not compared: skipped"]);
    let json = json_of(&ends(5, &["--ecrt", &bus, "config", "diff", path, "--json"]));
    assert!(json[0]["differences"].is_array() && json[1]["differences"].is_null());
    assert!(json[1]["error"].is_string() && json[2]["error"].is_null());
}

#[test]
fn missing_entry_of_one_gateway_is_listed_by_diff_and_rejected_by_apply() {
    let (_directory, path) = file(THREE);
    let path = text(&path);
    let bus = second_of_three_rejects(0x06090011);
    let bus = setting(&bus);
    let printed = ends(1, &["--ecrt", &bus, "config", "diff", path]);
    let lacks: Vec<_> =
        printed.lines().filter(|line| line.contains("the device lacks it")).collect();
    let [lacks] = lacks[..] else { panic!("{printed}") };
    assert!(
        lacks.starts_with("slave 1: 0x8002:19 (MCAN Channel Config 1, Nominal bitrate)"),
        "{printed}"
    );
    assert!(printed.lines().any(|line| line.starts_with("slave 2: ")), "{printed}");
    let printed = ends(5, &["--ecrt", &bus, "config", "apply", path]);
    assert!(
        printed.contains(&format!("slave 1: not configured as gateway 1 of {path}\n")),
        "{printed}"
    );
    let reason = "  slave 1: the firmware lacks 0x8002:19 (MCAN Channel Config 1, Nominal bitrate) \
                  (assumption H42); nothing was written; ";
    assert!(printed.contains(reason), "{printed}");
    for slave in [0, 2] {
        let skipped =
            format!("slave {slave}: skipped, not configured as gateway {slave} of {path}\n");
        assert!(printed.contains(&skipped), "{printed}");
    }
    let json = json_of(&ends(5, &["--ecrt", &bus, "config", "apply", path, "--json"]));
    for at in [0, 1, 2] {
        assert_eq!(json[at]["steps"], serde_json::json!([]), "{json}");
        assert_eq!(json[at]["parts"], serde_json::json!([]), "{json}");
    }
}

#[test]
fn optional_object_that_the_firmware_lacks_is_left_out_by_apply() {
    let (_directory, path) = file(SMALL);
    let path = text(&path);
    let bus = scenario("[[gateway]]\n[gateway.variant]\nmissing_entries = [\"0x8021\"]\n");
    let bus = setting(&bus);
    let printed = ends(1, &["--ecrt", &bus, "config", "apply", path]);
    assert!(
        printed.starts_with(&format!("slave 0: configured as gateway 0 of {path}\n")),
        "{printed}"
    );
    let not = "  not written: 0x8021:05 (MCAN Data Path Control 0, ";
    assert!(
        printed.contains(not) && printed.contains("the firmware lacks it (assumption H42)"),
        "{printed}"
    );
    assert!(printed.contains("  CAN2 "), "{printed}");
    let printed = ends(1, &["--ecrt", &bus, "config", "diff", path]);
    assert!(printed.contains("the device lacks it (assumption H42: older firmware)"), "{printed}");
}

#[test]
fn diff_lists_entries_with_status_1() {
    let (_directory, path) = file(SMALL);
    let output = ecan(&["--ecrt", "sim", "config", "diff", text(&path)]);
    assert_eq!(output.status.code(), Some(1));
    let listed = String::from_utf8(output.stdout).unwrap();
    let first = "slave 0: 0x8010:04 (TxPDO Profile Control, Channel mask): the file has 5, the \
                 device 15\n";
    assert!(listed.starts_with(first), "{listed}");
    assert!(
        listed.contains("RX cache depth): the file has 0 (32 frames), the device 2 (16 frames)")
    );
    assert!(!listed.contains("0x1C12"), "{listed}");
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(
        errors.contains("that the master writes at each start differ too (shown with --active")
    );
    let json = json_of(&ends(1, &["--ecrt", "sim", "config", "diff", text(&path), "--json"]));
    assert_eq!((&json[0]["position"], &json[0]["gateway"]), (&0.into(), &0.into()));
    let output = ecan(&["--ecrt", "sim", "config", "diff", "--active", text(&path)]);
    assert_has(&String::from_utf8(output.stdout).unwrap(), "Active profile word");
    // A file that says what a new device has anyway differs in nothing.
    let device = "[[gateway]]\nn = 8\n[gateway.can0]\nbitrate = 500_000\ndata_bitrate = 5_000_000\n\
                  sample_point = [75, 87.5]\ndata_sample_point = [75, 87.5]\n\
                  data_path = { rx_drain_max = 2, tx_budget_max = 4, rx_cache_depth = 16 }\n";
    let channels = ["can1", "can2", "can3"];
    let rest = device.split_once("[gateway.can0]").unwrap().1;
    let all = channels.iter().map(|channel| format!("[gateway.{channel}]{rest}"));
    let (_directory, path) = file(&(device.to_owned() + &all.collect::<String>()));
    assert_eq!(simulated(&["config", "diff", text(&path)]), "");
}

#[test]
fn flash_is_saved_loaded_and_reset() {
    let saved = simulated(&["config", "save"]);
    assert!(saved.starts_with("slave 0: configuration saved in the Flash (CRC32 active 0x"));
    let factory = simulated(&["config", "factory", "--yes"]);
    assert!(factory.ends_with(", stored 0x00000000)\n"), "{factory}");
    let message = fails(5, &["--ecrt", "sim", "config", "load"]);
    assert!(message.contains("status 4 (image invalid: nothing is stored"), "{message}");
    let json = json_of(&simulated(&["config", "save", "--json"]));
    assert_eq!(json["active_crc"], json["stored_crc"]);
    // A Flash that fails.
    let (_directory, path) =
        file("[[gateway]]\n[[fault]]\nat_ms = 0\nkind = \"flash_failure\"\ngateway = 0\n");
    let setting = format!("sim:{}", path.display());
    assert_has(&fails(5, &["--ecrt", &setting, "config", "save"]), "status 5 (Flash error");
}

#[test]
fn factory_reset_needs_confirmation() {
    let message = fails(2, &["--ecrt", "sim", "config", "factory"]);
    let expected = "ecan: cannot ask for confirmation of the loss of the configuration; use --yes";
    assert_eq!(message, expected);
    let asked = |typed| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        command.args(["--ecrt", "sim", "config", "factory"]).env_remove("ECAN_ECRT");
        with_answer(&mut command, typed)
    };
    let question = "Restore the factory configuration of slave 0 and erase the saved one? [y/N]";
    for typed in ["n\n", "\n"] {
        let (status, shown) = asked(typed);
        assert!(shown.contains(question), "{shown}");
        assert!(shown.contains("not restored: not confirmed"), "{shown}");
        assert_eq!(status, 2);
    }
    assert_eq!(asked("y\n").0, 0);
}

#[test]
fn export_works_offline() {
    let (_directory, path) = file(SMALL);
    let csv = good(&["config", "export", text(&path)]);
    assert!(csv.starts_with("action,index,subindex,type,value,comment\n"), "{csv}");
    assert!(
        csv.contains("\nwrite,0x8003,19,uint32,125000,\"MCAN Channel Config, Nominal bitrate\"\n")
    );
    let list = |format| good(&["config", "export", text(&path), "--format", format]);
    assert!(list("twincat").contains("<Index>32771</Index>"));
    assert!(list("codesys").contains(";16#8003:16#13;Nominal bitrate;125000;32;TRUE;FALSE;0;"));
    assert!(
        list("ethercat").contains("\ntransfer download -p 0 --type uint32 0x8003 19 125000  #")
    );
    let json = json_of(&good(&["config", "export", text(&path), "--json"]));
    assert_eq!(json[12]["index"], 0x1C12);
    assert_eq!(json[12]["bytes"], serde_json::json!([0]));
    let json = json.as_array().unwrap();
    let checks = json.iter().filter(|step| step["is_write"] == false).count();
    assert_eq!(checks, 24, "profiles, capabilities, two channels");
    for (format, text) in [
        ("twincat", "<!-- check 0x"),
        ("codesys", " check 0x"),
        ("ethercat", "\ncheck \"$(transfer upload "),
        ("steps", "\nafter "),
    ] {
        assert_eq!(list(format).matches(text).count(), checks, "{format}");
    }
    // Manual 5.1.1, 5.4.1, 5.4.5, 15.7.
    for text in [
        "SM2 has start 0x1100, 3072 bytes, control byte 0x66; SM3 has start 0x1D00, 3072 bytes",
        "for SM2 (0x1C12) the first 8, 0x1600 to 0x1607; for SM3 (0x1C13) the first 8, 0x1A00 to 0x1A07",
        "SM2 1024 bytes; SM3 1024 bytes",
        "inputs ARRAY[0..1023] OF BYTE, at offset 16 * u the 16 bytes of the entry 0x6000 + 0x10 * u, u = 0 to 63",
        "distributed clocks: off",
    ] {
        for format in ["steps", "twincat", "ethercat"] {
            assert!(list(format).contains(text), "{format}: {text}");
        }
    }
}

#[test]
fn exported_steps_name_the_distributed_clocks() {
    let (_directory, path) = file(&format!("{SMALL}[dc]\nshift_us = 450\n"));
    let steps = good(&["config", "export", text(&path), "--format", "steps"]);
    let expected = "Sync0 with AssignActivate 0x0300, cycle 1000 us, shift 450 us";
    assert!(steps.contains(expected), "{steps}");
}

#[test]
fn one_of_several_gateways_is_selected() {
    let two = "[[gateway]]\nn = 3\ncan0 = { bitrate = 250_000 }\n[[gateway]]\nalias = 7\nn = 2\n\
               can1 = { bitrate = 125_000 }\n";
    let (_directory, path) = file(two);
    let scenario = two_gateways();
    let setting = format!("sim:{}", scenario.path().display());
    let applied = good(&["--ecrt", &setting, "config", "apply", text(&path)]);
    assert!(
        applied.contains("slave 0: configured as gateway 0")
            && applied.contains("slave 1: configured as gateway 1")
    );
    let applied = good(&["--ecrt", &setting, "--slave", "alias=7", "config", "apply", text(&path)]);
    assert!(applied.starts_with("slave 1: configured as gateway 1"), "{applied}");
    let message = fails(4, &["--ecrt", &setting, "config", "save"]);
    assert!(message.contains("several gateways; select one with --slave"), "{message}");
    good(&["--ecrt", &setting, "--slave", "1", "config", "save"]);
    let message = fails(4, &["--ecrt", "sim:1", "config", "apply", text(&path)]);
    assert!(message.contains("gateway 1 of the file: no slave has the alias 7"), "{message}");
    // The slave at position 1 is the one with the alias 7.
    let both = two.replace("n = 3", "n = 3\nposition = 1");
    let (_directory, both) = file(&both);
    let message = fails(4, &["--ecrt", &setting, "config", "apply", text(&both)]);
    assert!(message.contains("gateways 0 and 1 of the file are the same slave 1"), "{message}");
    let message = fails(2, &["config", "export", text(&path)]);
    assert!(message.contains("2 gateways; select one with --gateway"), "{message}");
    let list = good(&["config", "export", "--gateway", "1", "--format", "ethercat", text(&path)]);
    assert!(list.contains("download -a 7 -p 0 --type uint8 0x1c12 0 2  #"), "{list}");
    let (_directory, one) = file(SMALL);
    let message = fails(4, &["--ecrt", &setting, "--slave", "1", "config", "diff", text(&one)]);
    assert!(message.contains("slave 1 is not a gateway of the file"), "{message}");
}

#[test]
fn master_option_overrides_file() {
    let text_of_file = "master = 3\ncycle_us = 1000\n[[gateway]]\nn = 3\n\
                        can0 = { bitrate = 250_000 }\n";
    let (_directory, path) = file(text_of_file);
    let path = text(&path);
    let commands = [
        &["config", "apply", path][..],
        &["send", "123#00", "--channel", "0", "--config", path],
        &["monitor", "--once", "--config", path],
        &["selftest", "--frames", "1", "--channels", "0", "--config", path],
    ];
    for command in commands {
        let message = fails(3, &[&["--ecrt", "sim"][..], command].concat());
        assert!(message.contains("the simulation has no master 3"), "{command:?}: {message}");
        good(&[&["--ecrt", "sim", "--master", "0"][..], command].concat());
    }
    let list = |master: &[&str]| {
        good(&[master, &["config", "export", "--format", "ethercat", path]].concat())
    };
    assert!(list(&[]).contains("transfer download -m 3 -p 0 "));
    assert!(list(&["--master", "0"]).contains("transfer download -p 0 "));
    assert!(list(&["--master", "12"]).contains("transfer download -m 12 -p 0 "));
}

#[test]
fn flash_commands_select_file_or_all() {
    let three = "[[gateway]]\n[[gateway]]\nalias = 7\n[[gateway]]\n";
    let bus = scenario(three);
    let bus = setting(&bus);
    let (_directory, path) = file(
        "cycle_us = 1000\n[[gateway]]\nn = 3\ncan0 = { bitrate = 250_000 }\n[[gateway]]\n\
         alias = 7\nn = 2\ncan1 = { bitrate = 125_000 }\n",
    );
    let path = text(&path);
    let places = |told: &str| -> Vec<_> {
        told.lines()
            .filter_map(|line| line.split_once(':'))
            .map(|parts| parts.0.to_owned())
            .collect()
    };
    let run = |arguments: &[&str]| good(&[&["--ecrt", &bus, "config"][..], arguments].concat());
    assert_eq!(places(&run(&["save", path])), ["slave 0", "slave 1"]);
    assert_eq!(places(&run(&["save", path, "--slave", "alias=7"])), ["slave 1"]);
    assert_eq!(places(&run(&["save", "--all"])), ["slave 0", "slave 1", "slave 2"]);
    assert_eq!(places(&run(&["factory", "--yes", path])), ["slave 0", "slave 1"]);
    let message = fails(2, &["--ecrt", &bus, "config", "factory", "--all"]);
    assert!(message.contains("cannot ask for confirmation of"), "{message}");
    let list = json_of(&run(&["save", "--all", "--json"]));
    assert_eq!(list[2]["position"], 2);
    assert_eq!(list[2]["active_crc"], list[2]["stored_crc"]);
    let message = fails(4, &["--ecrt", &bus, "config", "save"]);
    assert!(message.ends_with("select one with --slave: 0, 1, 2, or all with --all"), "{message}");
    for (wrong, words) in [
        (&["save", "--all", path][..], "cannot be used with"),
        (&["load", "--all", "--slave", "1"], "exclude each other"),
    ] {
        let message = fails(2, &[&["--ecrt", &bus, "config"][..], wrong].concat());
        assert!(message.contains(words), "{wrong:?}: {message}");
    }

    // The second one fails.
    let failing =
        scenario(&format!("{three}[[fault]]\nat_ms = 0\nkind = \"flash_failure\"\ngateway = 1\n"));
    let failing = setting(&failing);
    let told = ends(5, &["--ecrt", &failing, "config", "save", "--all"]);
    let lines: Vec<_> = told.lines().collect();
    assert!(lines[0].starts_with("slave 0: configuration saved"), "{told}");
    assert!(lines[1].starts_with("slave 1: ") && lines[1].contains("status 5 (Flash error"));
    assert_eq!(lines[2], "slave 2: skipped");
    let silent = first_silent();
    let message = fails(4, &["--ecrt", &setting(&silent), "config", "save", "--all"]);
    assert!(
        message.contains("slave 0 cannot be identified")
            && message.ends_with("; no gateway was changed")
    );
}

#[test]
fn invalid_use_has_message_and_status() {
    let (directory, path) = file(SMALL);
    let missing = directory.path().join("none.toml");
    let (missing, path) = (text(&missing), text(&path));
    all_fail(&[
        (2, &["config"], "Usage"),
        (2, &["config", "check"], "<FILE>"),
        (2, &["config", "export", path, "--format", "eni"], "possible values: csv, twincat"),
        (2, &["config", "export", path, "--gateway", "1"], "gateway 1 does not exist"),
        (
            2,
            &["config", "export", path, "--slave", "0"],
            "use --gateway to select a gateway of the file",
        ),
        (2, &["config", "export", path, "--format", "csv", "--json"], "exclude each other"),
        (
            2,
            &["config", "check", path, "--slave", "0"],
            "--slave is not used by this command: the whole file",
        ),
        (6, &["config", "check", missing], "cannot read "),
        (6, &["config", "check", text(directory.path())], "cannot read "),
    ]);
    // The device rejects a write in the middle.
    let (_directory, scenario) = file(
        "[[gateway]]\n[[fault]]\nat_ms = 0\nkind = \"sdo_abort\"\ngateway = 0\nindex = 0x8001\n\
         subindex = 20\ncode = 0x06090030\ntimes = 9\n",
    );
    let setting = format!("sim:{}", scenario.display());
    let message = fails(5, &["--ecrt", &setting, "config", "apply", path]);
    assert!(message.contains("0x8001:20") && message.contains("0x06090030"), "{message}");
}

#[test]
fn marginal_configuration_is_a_warning() {
    let gateway = "[[gateway]]\nn = 11\ncan0 = { bitrate = 500_000 }\n";
    let (_directory, path) = file(&format!("cycle_us = 570\n{gateway}{gateway}"));
    assert_has(&good(&["config", "check", text(&path)]), "\nwarning: the frames of a cycle take 4");
    // CAN FD in the layout of classic CAN.
    let fd = "cycle_us = 1000\n[[gateway]]\nn = 8\n[gateway.can0]\nbitrate = 500_000\n\
              data_bitrate = 2_000_000\nram = { layout = \"classic\" }\n";
    let (_directory, path_of_fd) = file(fd);
    let checked = good(&["config", "check", text(&path_of_fd)]);
    let warning = "\nwarning: slave 0, channel 0: the transmit elements hold 8 bytes of a frame";
    assert!(checked.contains(warning), "{checked}");
    let (_directory, path) = file(&format!("cycle_us = 400\n{gateway}{gateway}"));
    let output = ecan(&["config", "check", text(&path)]);
    assert_eq!(output.status.code(), Some(1));
    let listed = String::from_utf8(output.stdout).unwrap();
    assert!(listed.contains("cell.toml:1:12: the frames of a cycle take"), "{listed}");
}
