//! `scan`, `info`, `caps` and `sdo`, used and misused.

use crate::support::{
    all_fail, ends, fails, first_silent, good, json_of, scenario, setting, simulated, two_gateways,
};

#[test]
fn slaves_are_listed() {
    let expected = "\
POS  ALIAS  STATE  NAME       FIRMWARE  HARDWARE  SERIAL      IDENTITY
0    -      PREOP  ECAN-Lite  2.2.1     1         4294967297  0x00004543 0x4C495445 0x00020002
";
    assert_eq!(simulated(&["scan"]), expected);
    let json = json_of(&simulated(&["scan", "--json"]));
    assert_eq!(json[0]["serial"], 4_294_967_297_u64);
    assert_eq!(json[0]["is_gateway"], true);
}

#[test]
fn unidentified_slave_is_listed_with_reason() {
    let bus = first_silent();
    let listed = good(&["--ecrt", &setting(&bus), "scan"]);
    let line = "\nslave 0 cannot be identified: SDO upload 0xF000:09";
    assert!(listed.contains(line), "{listed}");
    let json = json_of(&good(&["--ecrt", &setting(&bus), "scan", "--json"]));
    assert_eq!((&json[0]["is_gateway"], &json[1]["is_gateway"]), (&().into(), &true.into()));
    assert!(json[0]["unknown"].as_str().unwrap().contains("0xF000:09"), "{json}");
    // One that answers that it has no such object is another device.
    let missing = [9, 17].map(|subindex| {
        format!(
            "[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\nindex = 0xF000\n\
             subindex = {subindex}\ncode = 0x06020000\ntimes = 9\n"
        )
    });
    let other = scenario(&format!("[[gateway]]\n[[gateway]]\n{}", missing.concat()));
    assert!(good(&["--ecrt", &setting(&other), "info"]).starts_with("slave     1, "));
}

#[test]
fn info_shows_a_gateway() {
    let info = simulated(&["info"]);
    assert!(info.starts_with("slave     0, PREOP\nname      ECAN-Lite\n"), "{info}");
    assert!(info.contains("CAN3      500 / 5000 kbit/s FD  disabled"), "{info}");
    let capabilities = simulated(&["caps"]);
    assert!(capabilities.contains(":13  Max PDO bytes                 3072 bytes (0xC00)\n"));
    assert!(capabilities.contains("FoE firmware update, configuration persistence, access levels"));
}

#[test]
fn info_shows_all_gateways() {
    let two = two_gateways();
    let run = |more: &[&str]| good(&[&["--ecrt", &setting(&two), "info", "--all"], more].concat());
    let told = run(&[]);
    let (first, second) = told.split_once("\n\n").unwrap();
    assert!(first.starts_with("slave     0, PREOP\n"), "{told}");
    assert!(second.starts_with("slave     1, alias 7, PREOP\n"), "{told}");
    let json = json_of(&run(&["--json"]));
    assert_eq!((&json[0]["position"], &json[1]["alias"]), (&0.into(), &7.into()));
    // One that cannot be asked does not hide the other.
    let silent = first_silent();
    let told = ends(4, &["--ecrt", &setting(&silent), "info", "--all"]);
    assert!(told.starts_with("slave     1, alias 7"), "{told}");
    for both in [&["info", "--all", "--slave", "1"][..], &["--slave", "1", "info", "--all"]] {
        let message = fails(2, &[&["--ecrt", &setting(&two)][..], both].concat());
        assert!(message.ends_with("exclude each other"), "{message}");
    }
}

#[test]
fn missing_version_is_not_empty() {
    let bus = scenario(
        "[[gateway]]\n[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\n\
         index = 0x100A\nsubindex = 0\ncode = 0x06020000\ntimes = 9\n",
    );
    let setting = setting(&bus);
    let run = |command: &[&str]| good(&[&["--ecrt", &setting][..], command].concat());
    let json =
        |command: &[&str]| -> serde_json::Value { json_of(&run(&[command, &["--json"]].concat())) };
    assert!(json(&["scan"])[0]["firmware"].is_null());
    assert!(json(&["info"])["firmware"].is_null());
    assert!(json(&["reboot", "--wait"])["firmware"].is_null());
    let words = " ms, firmware version (0x100A) not read\n";
    assert!(run(&["reboot", "--wait"]).ends_with(words));
    assert!(run(&["firmware", "version"]).contains("\n0    PREOP  2.2.1     4294967297\n"));
    let tested = run(&["selftest", "--frames", "1", "--channels", "0"]);
    let line = tested.lines().find(|line| line.contains("good    firmware")).unwrap();
    assert!(line.ends_with(" 2.2.1"), "{line}");
    assert!(!line.contains('('), "{line}");
}

#[test]
fn objects_are_read_by_number_and_name() {
    let expected = "0x8010:03 (TxPDO Profile Control, PDO size multiplier) = 8 x 128 bytes\n";
    assert_eq!(simulated(&["sdo", "read", "0x8010:3"]), expected);
    let name = "txpdo profile control:pdo size multiplier";
    assert_eq!(simulated(&["sdo", "read", name]), expected);
    assert_eq!(
        simulated(&["sdo", "read", "0xB000:1"]),
        "0xB000:01 (Device Maintenance, Access mode request) = 0: run\n"
    );
    let written = "0xB000:01 (Device Maintenance, Access mode request) = 2: factory\n";
    assert_eq!(simulated(&["sdo", "write", "0xB000:1", "factory"]), written);
    assert_eq!(simulated(&["sdo", "write", "access mode request", "factory"]), written);
    // Written, and not accepted by the gateway.
    for (entry, value, printed) in [
        (
            "maintenance command",
            "1",
            "0xB000:04 (Device Maintenance, Maintenance command): 1 written, not accepted: 0xB000:05 \
             (Device Maintenance, Maintenance status) = 2 (denied)\n",
        ),
        (
            "0xA000:2",
            "1",
            "0xA000:02 (MCAN Register Service 0, Command): 1 written, not accepted: 0xA000:03 (MCAN \
             Register Service 0, Status) = 1 (offset invalid)\n",
        ),
    ] {
        assert_eq!(ends(5, &["--ecrt", "sim", "sdo", "write", entry, value]), printed);
    }
    let applied = "0x8021:02 (MCAN Data Path Control 0, Apply command): 1 written\n";
    assert!(simulated(&["sdo", "write", "0x8021:2", "1"]).starts_with(applied));
    let json = json_of(&simulated(&["sdo", "write", "0x8001:19", "250000", "--json"]));
    assert_eq!((&json["written"], &json["value"]), (&250_000.into(), &250_000.into()));
    let listed = simulated(&["sdo", "list", "maintenance"]);
    assert!(listed.starts_with("0xB000 Device Maintenance (manual 13.7)\n"), "{listed}");
    assert!(listed.contains(":05  Maintenance status             0                        OK\n"));
    assert!(listed.contains(":04  Maintenance command            write-only\n"), "{listed}");
    let listed = simulated(&["sdo", "list", "0xB000:4"]);
    assert!(listed.ends_with(":04  Maintenance command  write-only\n"), "{listed}");
    // No master is needed for names alone.
    assert!(good(&["sdo", "list"]).contains("0x8001  MCAN Channel Config"));
    assert!(good(&["sdo", "list", "0xB000", "--names"]).contains("1 engineering, 2 factory"));
}

#[test]
fn index_without_prefix_is_asked_for() {
    for command in [&["sdo", "read", "8010:3"][..], &["sdo", "list", "8010"]] {
        let message = fails(2, command);
        let expected = "8010 is read as the decimal number of 0x1F4A, which is no known object";
        assert!(message.contains(expected) && message.contains("write 0x8010"), "{message}");
    }
    let message = fails(2, &["--ecrt", "sim:drives", "node", "sdo", "read", "--node", "1", "6064"]);
    assert!(message.contains("for the hexadecimal index 0x6064 write 0x6064"), "{message}");
}

#[test]
fn unreadable_values_do_not_hide_others() {
    let fault = |(index, subindex): (u16, u8)| {
        format!(
            "[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\nindex = {index}\n\
             subindex = {subindex}\ncode = 0x06090011\ntimes = 9\n"
        )
    };
    let rejected = [(0x8010, 15), (0x9002, 9), (0xB000, 5), (0xF000, 30), (0x100A, 0)];
    let bus = scenario(&format!("[[gateway]]\n{}", rejected.map(fault).concat()));
    let setting = setting(&bus);
    let run = |command: &[&str]| good(&[&["--ecrt", &setting][..], command].concat());
    let reason = "not read: 0x06090011 subindex does not exist";
    let info = run(&["info"]);
    for name in ["TxPDO     ", "CAN2      ", "firmware  "] {
        assert!(info.contains(&format!("\n{name}{reason}\n")), "{info}");
    }
    assert!(info.contains("\nRxPDO     no profile applied\n"), "{info}");
    assert!(info.contains("\nCAN3      500 / 5000 kbit/s FD  disabled"), "{info}");
    let info = json_of(&run(&["info", "--json"]));
    assert!(info["tx_pdo"].is_null() && info["rx_pdo"].is_object(), "{info}");
    assert!(info["errors"]["tx_pdo"].as_str().unwrap().starts_with("0x06090011"), "{info}");
    assert!(info["channels"][2]["error"].is_string() && info["channels"][3]["error"].is_null());
    assert_eq!(info["channels"][3]["nominal_bitrate"], 500_000);
    let listed = run(&["sdo", "list", "0xB000"]);
    assert!(
        listed.contains(&format!(":05  Maintenance status             {reason}\n")),
        "{listed}"
    );
    assert!(listed.contains(":01  Access mode request            0"), "{listed}");
    let caps = run(&["caps"]);
    assert!(caps.contains("  not reported; assumed: 0 us\n"), "{caps}");
    let caps_json = json_of(&run(&["caps", "--json"]));
    let last = caps_json.as_array().unwrap().last().unwrap();
    assert_eq!((&last["subindex"], &last["assumed"]), (&30.into(), &0.into()), "{last}");
    assert!(last["value"].is_null() && last["error"].is_string(), "{last}");
    assert!(caps.contains(":13  Max PDO bytes"), "{caps}");
    // Where nothing can be read there is nothing to show.
    let message = fails(5, &["--ecrt", &setting, "sdo", "list", "0xB000:5"]);
    assert!(message.contains("0x06090011 subindex does not exist"), "{message}");
    let bus = first_silent();
    let silent = crate::support::setting(&bus);
    for command in [&["info"][..], &["caps"], &["sdo", "list", "0xB000"]] {
        let message = fails(5, &[&["--ecrt", &silent, "--slave", "0"], command].concat());
        assert!(message.contains("Input/output error"), "{message}");
    }
}

#[test]
fn json_has_numbers_meanings_and_position() {
    let json = |command: &[&str]| -> serde_json::Value {
        json_of(&simulated(&[command, &["--json"]].concat()))
    };
    let size = json(&["sdo", "read", "0x8010:9"]);
    assert_eq!((&size["value"], &size["position"]), (&0.into(), &0.into()));
    let mode = json(&["sdo", "read", "0xB000:1"]);
    assert_eq!((&mode["value"], &mode["meaning"]), (&0.into(), &"run".into()));
    assert_eq!(json(&["sdo", "read", "0x100A"])["value"], "2.2.1");
    let chunk = json(&["sdo", "read", "0x7000:1"]);
    assert_eq!(chunk["bytes"].as_array().unwrap().len(), 16, "{chunk}");
    assert!(chunk["value"].is_null(), "{chunk}");
    let listed = json(&["sdo", "list", "0x8010:3"]);
    assert_eq!(listed.as_array().unwrap().len(), 1, "{listed}");
    assert_eq!((&listed[0]["subindex"], &listed[0]["value"]), (&3.into(), &8.into()));
    let names = json(&["sdo", "list", "0x8010:3", "--names"]);
    assert_eq!((names.as_array().unwrap().len(), &names[0]["type"]), (1, &"U8".into()));
    assert_eq!(json(&["sdo", "list", "0x1008", "--names"])[0]["type"], "STRING");
    assert_eq!(json(&["scan"])[0]["has_error_flag"], false);
    let at = |value: &serde_json::Value| value["position"].as_u64();
    for command in ["pins", "reg read ECR --channel 0", "filter list --channel 0", "info"] {
        let words: Vec<_> = command.split(' ').collect();
        assert_eq!(at(&json(&words)), Some(0), "{command}");
    }
    for command in ["scan", "caps", "firmware version"] {
        let words: Vec<_> = command.split(' ').collect();
        assert_eq!(at(&json(&words)[0]), Some(0), "{command}");
    }
    let message = fails(2, &["--ecrt", "sim", "sdo", "list", "0x8010:99"]);
    assert!(message.contains("has no entry :99 in the table"), "{message}");
}

#[test]
fn one_of_several_gateways_is_selected() {
    let file = two_gateways();
    let setting = format!("sim:{}", file.path().display());
    for choice in ["1", "alias=7", "serial=4294967298"] {
        let info = good(&["--ecrt", &setting, "info", "--slave", choice]);
        assert!(info.starts_with("slave     1, alias 7, PREOP\n"), "{info}");
    }
    let message = fails(4, &["--ecrt", &setting, "info", "--slave", "2"]);
    assert!(message.contains("slave 2 does not exist; allowed: 0 to 1"), "{message}");
}

#[test]
fn ambiguous_alias_or_serial_is_rejected() {
    let bus = scenario(
        "[[gateway]]\nalias = 5\nserial = 9\n[[gateway]]\nserial = 9\n[[gateway]]\nalias = 5\n",
    );
    let setting = setting(&bus);
    let on = |choice| fails(4, &["--ecrt", &setting, "info", "--slave", choice]);
    let expected = "ecan: slaves 0, 2 have the same alias 5; select one by its position";
    assert_eq!(on("alias=5"), expected);
    let expected = "ecan: slaves 0, 1 have the same serial number 9; select one by its position";
    assert_eq!(on("serial=9"), expected);
    let wrong = |choice| fails(2, &["--ecrt", &setting, "info", "--slave", choice]);
    assert!(wrong("alias=0").contains("alias 0 means no alias"));
    assert!(wrong("serial=0").contains("serial number 0 means no serial number"));
}

#[test]
fn invalid_use_has_message_and_status() {
    all_fail(&[
        (2, &[], "Usage"),
        (2, &["sdo", "read", "0x8010:nonsense"], "has no entry"),
        (2, &["sdo", "write", "0xB000:1", "off"], "allowed: a number or run, engineering, factory"),
        (2, &["sdo", "write", "0x5000:1", "1"], "--type"),
        (2, &["--slave", "first", "info"], "expected a position"),
        (2, &["--ecrt", "sim", "sdo", "list", "0x5000"], "see `ecan sdo list`"),
        (3, &["scan"], "without hardware select the simulated master: option --ecrt sim"),
        (5, &["--ecrt", "sim", "sdo", "write", "0xF000:2", "1"], "read-only"),
    ]);
    let message = fails(6, &["man", "/dev/null/man1"]);
    assert!(message.contains("cannot write the manual pages to /dev/null/man1"), "{message}");
    let directory = tempfile::tempdir().unwrap();
    let pages = directory.path().join("new/man1");
    good(&["man", pages.to_str().unwrap()]);
    assert!(pages.join("ecan.1").exists());
}

/// Calls the completion of bash as a tabulator at the end of a line does.
const COMPLETE_IN_BASH: &str = r#"
source "$1"
COMP_LINE=$2 COMP_POINT=${#2}
IFS=' ' read -ra COMP_WORDS <<< "${2//:/ : }"
[[ "$2" == *[\ :] ]] && COMP_WORDS+=("")
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
function=$(complete -p ecan | sed 's/.*-F \([^ ]*\).*/\1/')
"$function" ecan "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\n' "${COMPREPLY[@]}"
"#;

#[test]
fn tabulator_completes_the_settings_of_ecrt_in_bash() {
    let directory = tempfile::tempdir().unwrap();
    for file in ["ecan.bash", "cell.toml", "libethercat.so.1"] {
        std::fs::write(directory.path().join(file), "").unwrap();
    }
    std::fs::write(directory.path().join("ecan.bash"), good(&["completions", "bash"])).unwrap();
    let complete = |line: &str| {
        let mut shell = std::process::Command::new("bash");
        shell.args(["-c", COMPLETE_IN_BASH, "bash", "ecan.bash", line]);
        let output = shell.current_dir(directory.path()).output().unwrap();
        assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let all = complete("ecan --ecrt ");
    for expected in ["sim", "sim:echo", "sim:drives", "libethercat.so.1"] {
        assert!(all.iter().any(|word| word == expected), "{expected}: {all:?}");
    }
    assert_eq!(complete("ecan --ecrt lib"), ["libethercat.so.1"]);
    // The shell keeps what is before the colon.
    assert_eq!(complete("ecan --ecrt sim:dr"), ["drives"]);
    assert_eq!(complete("ecan --json --ecrt sim:c"), ["cell.toml"]);
    assert_eq!(complete("ecan sc"), ["scan"]);
    assert!(complete("ecan --ecrt sim node sdo ").iter().any(|word| word == "read"));
    assert!(good(&["completions", "zsh"]).contains("compadd -- sim sim:echo sim:drives"));
    let fish = "complete -c ecan -l ecrt -r -a \"sim sim:echo sim:drives";
    assert!(good(&["completions", "fish"]).contains(fish));
}
