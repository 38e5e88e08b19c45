//! What every command that looks at a bus says where it finds no master, no slave, or too many.

use std::process::Command;

use crate::support::terminal::Pty;
use crate::support::timed_reader::TimedReader;
use crate::support::{
    FakeLibrary, Scenario, assert_has, ends, fails, first_silent, json_of, setting, two_gateways,
};

/// Commands that are about one gateway.
fn commands_of_one(files: &Scenario) -> Vec<Vec<String>> {
    let log = files.write("a.log", "(0.000000) can0 123#00\n");
    let commands = [
        "info",
        "caps",
        "sdo read 0x8010:3",
        "sdo write 0x8010:3 3",
        "config save",
        "config load",
        "config factory",
        "diag",
        "reg read ECR --channel 0",
        "filter list --channel 0",
        "pins",
        "probe",
        "reboot",
        "dump",
        "send 123#00",
        "gen",
        &format!("replay {log}"),
        "bridge --slcan 127.0.0.1:0",
        "node info --node 1",
        "node sdo read --node 1 0x1000",
        "node nmt stop --node 1",
        "node pdo --node 1",
        "node emcy --node 1",
        "axis status --node 1",
        "axis stop --node 1",
        "axis move --node 1 --unit step --to 1 --max-velocity 9 --range 0..9 --yes --unattended",
    ];
    commands.map(words).to_vec()
}

/// Commands that take all gateways unless one is chosen.
fn commands_of_all(files: &Scenario) -> Vec<Vec<String>> {
    let config = files.write("cell.toml", &crate::support::good(&["config", "example"]));
    let commands = [
        "scan",
        &format!("config apply {config}"),
        &format!("config diff {config}"),
        "monitor --once",
        "selftest",
        "node scan",
    ];
    commands.map(words).to_vec()
}

fn words(command: &str) -> Vec<String> {
    command.split(' ').map(str::to_owned).collect()
}

fn with<'a>(command: &'a [String], options: &[&'a str]) -> Vec<&'a str> {
    command.iter().map(String::as_str).chain(options.iter().copied()).collect()
}

#[test]
fn missing_master_returns_status_3() {
    let files = Scenario::new("");
    for command in commands_of_one(&files).into_iter().chain(commands_of_all(&files)) {
        let message = fails(3, &with(&command, &["--ecrt", "/nowhere/libethercat.so"]));
        assert!(
            message.contains("/nowhere/libethercat.so was not found"),
            "{command:?}: {message}"
        );
        let message = fails(3, &with(&command, &["--ecrt", "sim", "--master", "4"]));
        assert!(message.contains("the simulation has no master 4"), "{command:?}: {message}");
    }
}

#[test]
fn missing_permission_returns_status_3() {
    // Its master 102 answers with EACCES.
    let Some(library) = FakeLibrary::build() else { return };
    let library = library.path();
    let files = Scenario::new("");
    for command in commands_of_one(&files).into_iter().chain(commands_of_all(&files)) {
        let message = fails(3, &with(&command, &["--ecrt", &library, "--master", "102"]));
        let expected = "/dev/EtherCAT102 may not be opened by this user";
        assert!(message.contains(expected), "{command:?}: {message}");
        assert!(message.contains("udev rule"), "{command:?}: {message}");
    }
}

#[test]
fn several_gateways_need_a_selection() {
    let bus = two_gateways();
    let files = Scenario::new("");
    for command in commands_of_one(&files) {
        let message = fails(4, &with(&command, &["--ecrt", &setting(&bus)]));
        let expected = "several gateways; select one with --slave: 0, 1";
        assert!(message.contains(expected), "{command:?}: {message}");
    }
}

#[test]
fn unidentified_slave_needs_a_selection() {
    let bus = first_silent();
    let files = Scenario::new("");
    for command in commands_of_one(&files).into_iter().chain([words("monitor --once")]) {
        let message = fails(4, &with(&command, &["--ecrt", &setting(&bus)]));
        let expected = "slave 0 cannot be identified: SDO upload 0xF000:09";
        assert!(message.contains(expected), "{command:?}: {message}");
        let ways = message.trim_end_matches(", or all with --all");
        assert!(ways.ends_with("; select one with --slave: 0, 1"), "{message}");
    }
    let message = fails(4, &["--ecrt", &setting(&bus), "info", "--slave", "serial=4294967297"]);
    assert!(message.contains("; but slave 0 cannot be identified"), "{message}");
}

#[test]
fn missing_slave_is_reported() {
    let files = Scenario::new("");
    for command in commands_of_one(&files).into_iter().chain(commands_of_all(&files)) {
        let cases = [
            ("9", "slave 9 does not exist; allowed: 0"),
            ("alias=3", "no slave has the alias 3"),
            ("serial=5", "no gateway has the serial number 5"),
        ];
        for (slave, expected) in cases {
            let message = fails(4, &with(&command, &["--ecrt", "sim", "--slave", slave]));
            assert!(message.contains(expected), "{command:?} --slave {slave}: {message}");
        }
    }
}

#[test]
fn denied_real_time_returns_status_7() {
    for command in ["dump -n 1", "send 123#00", "selftest", "monitor --once"] {
        let options = ["--ecrt", "sim", "--cpu", "1023", "--rt-required"];
        let message = fails(7, &with(&words(command), &options));
        assert!(message.contains("CPU 1023: not granted"), "{command}: {message}");
    }
}

#[test]
fn failure_is_json_on_stdout_with_json() {
    let empty = crate::support::scenario("");
    let empty = setting(&empty);
    let cases: [(i32, &[&str], &str); 8] = [
        (2, &["scans"], "unrecognized subcommand 'scans'"),
        (2, &["dump", "--bitrate", "5x"], "expected a bit rate in bit/s"),
        (2, &["sdo", "read", "nonsense"], "unknown object \"nonsense\""),
        (
            3,
            &["scan", "--ecrt", "/nowhere/libethercat.so"],
            "/nowhere/libethercat.so was not found",
        ),
        (4, &["info", "--ecrt", &empty], "no slave responds on the bus"),
        (5, &["sdo", "read", "0x5000:1", "--ecrt", "sim"], "0x06020000 object does not exist"),
        (6, &["config", "apply", "/no/such.toml"], "cannot read /no/such.toml"),
        (7, &["dump", "-n", "1", "--cpu", "1023", "--rt-required", "--ecrt", "sim"], "CPU 1023"),
    ];
    for (status, arguments, expected) in cases {
        let output = crate::support::ecan(&[arguments, &["--json"]].concat());
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {errors}");
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text.lines().count(), 1, "{arguments:?}: {text}");
        let json = json_of(&text);
        assert_eq!(json["status"], status, "{json}");
        assert!(json["error"].as_str().unwrap().contains(expected), "{json}");
        assert!(!json["error"].as_str().unwrap().contains("Usage"), "{json}");
        assert!(json["causes"].is_array(), "{json}");
        assert!(errors.contains(expected), "{errors}");
    }
    // A document that was printed reports the failure itself.
    let text = ends(1, &["plan", "--pdo-n", "12", "--json"]);
    let json = json_of(&text);
    assert!(json["error"].is_null() && json["faults"].is_array(), "{json}");
    // Data on standard output has no line that is not its own.
    assert_eq!(ends(6, &["--json", "--ecrt", "sim:/no.toml", "dump", "--record", "-"]), "");
    let help = crate::support::good(&["--help", "--json"]);
    assert!(help.starts_with("Bring-up"), "{help}");
}

#[test]
fn short_help_folds_the_options_of_every_command() {
    for command in [&[][..], &["dump"], &["config", "apply"], &["node", "sdo", "read"]] {
        let short = crate::support::good(&[command, &["-h"]].concat());
        let full = crate::support::good(&[command, &["--help"]].concat());
        assert!(full.contains("--ecrt <LIBRARY>") && full.contains("--log <FILTER>"), "{full}");
        let line = "see --help (--ecrt, --via, --master, --slave, --json, --color, --log)";
        assert!(short.contains(line) && !short.contains("<LIBRARY>"), "{short}");
        assert!(short.lines().count() < full.lines().count() - 7, "{short}");
        // Options and examples of the command stay.
        for word in ["Usage: ecan", "Options:", "-h, --help"] {
            assert!(short.contains(word), "{short}");
        }
    }
    assert!(crate::support::good(&["dump", "-h"]).contains("ecan dump --bitrate 1M"));
    assert!(!crate::support::good(&["-h"]).contains("Exit status:\n"));
}

#[test]
fn dash_is_standard_input() {
    let run = |status: i32, input: &str, arguments: &[&str]| {
        let files = Scenario::new("");
        let input = std::fs::File::open(files.write("input", input)).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        let output = command.args(arguments).env_remove("ECAN_ECRT").stdin(input).output().unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {errors}");
        String::from_utf8(output.stdout).unwrap() + &errors
    };
    let config = crate::support::good(&["config", "example"]);
    let shown = run(0, &config, &["config", "check", "-"]);
    assert!(shown.starts_with("gateway 0: position 0\n"), "{shown}");
    assert_has(&run(1, "n = 8", &["config", "check", "-"]), "-:1:1: unknown key `n`");
    let shown = run(0, &config, &["plan", "--config", "-"]);
    assert!(shown.starts_with("plan for 1 gateway(s)"), "{shown}");
    let shown = run(0, &config, &["--ecrt", "sim", "config", "apply", "-"]);
    assert!(shown.starts_with("slave 0: configured as gateway 0 of -\n"), "{shown}");
    let send = ["--ecrt", "sim", "send", "--config", "-", "--channel", "0", "123#"];
    assert_eq!(run(0, &config, &send).lines().next(), Some("can0 123# sent"));
    let log = "(0.000000) can0 123#00\n(0.001000) can0 124#00\n";
    assert_has(&run(0, log, &["--ecrt", "sim", "replay", "-"]), "2 frames sent");
    let shown = run(0, "[[gateway]]\nalias = 7\n", &["--ecrt", "sim:-", "scan"]);
    assert!(shown.contains("\n0    7      PREOP"), "{shown}");
    let eds = include_str!("../../../../examples/network/gripper.eds");
    let list =
        ["--ecrt", "sim:drives", "node", "sdo", "list", "--node", "1", "--names", "--eds", "-"];
    assert!(run(0, eds, &list).contains("Grip force"));
    let network =
        [&["--ecrt", "sim:drives", "axis", "status", "--config", "-"][..], &["--axis", "0"]];
    let axis = "[[gateway]]\nn = 3\n[gateway.can0]\nbitrate = 500_000\n[[axis]]\ngateway = 0\n\
                channel = 0\nnode = 1\n";
    assert!(run(0, axis, &network.concat()).contains("switch on disabled"));
}

#[test]
fn numbers_in_json_are_numbers() {
    /// Strings that are numbers, with their keys. Versions are texts.
    fn numbers(key: &str, value: &serde_json::Value, found: &mut Vec<String>) {
        match value {
            serde_json::Value::String(text) => {
                let digits = text.strip_prefix("0x").unwrap_or(text);
                let is_number = text.parse::<f64>().is_ok()
                    || text.starts_with("0x") && u64::from_str_radix(digits, 16).is_ok();
                let is_text = ["firmware", "hardware", "data", "numbers", "text"].contains(&key);
                if is_number && !is_text {
                    found.push(format!("{key}: {text}"));
                }
            }
            serde_json::Value::Array(items) => {
                items.iter().for_each(|item| numbers(key, item, found))
            }
            serde_json::Value::Object(map) => {
                map.iter().for_each(|(key, value)| numbers(key, value, found));
            }
            _ => {}
        }
    }
    let files = Scenario::new("");
    let config = files.write("cell.toml", &crate::support::good(&["config", "example"]));
    let commands = [
        "sim scan",
        "sim info",
        "sim caps",
        "sim sdo read 0x8001:19",
        "sim sdo list 0xF000",
        "sim diag",
        "sim reg read ECR --channel 0",
        "sim filter list --channel 0",
        "sim pins",
        "sim firmware version",
        "sim send 123#00",
        "sim gen -n 3 -g 1",
        "sim monitor --once",
        &format!("sim config diff {config}"),
        &format!("sim config check {config}"),
        &format!("sim config apply {config}"),
        "sim plan --slaves 2",
        "sim:drives node scan --nodes 1",
        "sim:drives node sdo read --node 1 0x1018:1",
        "sim:drives node pdo --node 1",
        "sim:drives node emcy --node 1",
        "sim:drives axis status --node 1",
    ];
    for command in commands {
        let output = crate::support::ecan(&with(&words(&format!("--json --ecrt {command}")), &[]));
        let json: serde_json::Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{command}: {error}"));
        let mut found = Vec::new();
        numbers("", &json, &mut found);
        assert!(found.is_empty(), "{command}: {found:?}");
    }
}

#[test]
fn log_option_and_variable_write_events_to_stderr() {
    let run = |arguments: &[&str], variable: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        command.env_remove("ECAN_ECRT").env("RUST_LOG", variable);
        let output = command.args(["--ecrt", "sim", "scan"]).args(arguments).output().unwrap();
        assert!(output.status.success() && !output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(run(&["--log", "debug"], "").contains("bus opened"));
    assert!(run(&[], "ecan=debug").contains("bus opened"));
    assert!(!run(&[], "").contains("bus opened"));
    assert!(!run(&["--log", "off"], "debug").contains("bus opened"));
    assert!(fails(2, &["scan", "--log", "ecan=loud"]).contains("expected a level"));
}

#[test]
fn denied_signal_handlers_return_status_7() {
    // The system rejects the thread that waits for them.
    let traced = |command: &[&str]| {
        Command::new("strace")
            .args(["-o", "/dev/null", "-e", "trace=clone,clone3"])
            .args(["-e", "inject=clone,clone3:error=EAGAIN"])
            .args(command)
            .env_remove("ECAN_ECRT")
            .output()
    };
    if !traced(&["true"]).is_ok_and(|output| output.status.success()) {
        return println!("skipped: there is no strace that may trace");
    }
    let files = Scenario::new("");
    let log = files.write("a.log", "(0.000000) can0 123#00\n");
    let replay = format!("replay {log}");
    for command in [
        "dump",
        "send 123#00",
        "gen",
        &replay,
        "monitor --once",
        "selftest",
        "bridge --slcan [::1]:0",
    ] {
        let command = words(command);
        let program = [env!("CARGO_BIN_EXE_ecan"), "--ecrt", "sim"];
        let ended = traced(&[&program[..], &with(&command, &[])].concat()).unwrap();
        let errors = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(7), "{command:?}: {errors}");
        assert!(
            errors.contains("ecan: cannot install handlers for SIGINT and SIGTERM: "),
            "{errors}"
        );
    }
}

#[test]
fn closed_output_keeps_exit_status() {
    let bus = first_silent();
    let silent = setting(&bus);
    let cases: [(i32, &[&str]); 5] = [
        (1, &["plan", "--pdo-n", "12"]),
        (1, &["--ecrt", &silent, "doctor"]),
        (1, &["--ecrt", &silent, "diag", "--slave", "0"]),
        (0, &["--ecrt", "sim", "scan"]),
        (0, &["--ecrt", "sim", "info", "--json"]),
    ];
    for (status, arguments) in cases {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        let ended = command.args(arguments).env_remove("ECAN_ECRT").stdout(writer).output();
        let ended = ended.unwrap();
        let errors = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(status), "{arguments:?}: {errors}");
    }
}

#[test]
fn empty_bus_is_reported() {
    let empty = crate::support::scenario("");
    let files = Scenario::new("");
    for command in commands_of_one(&files) {
        let message = fails(4, &with(&command, &["--ecrt", &setting(&empty)]));
        assert!(message.contains("no slave responds on the bus"), "{command:?}: {message}");
    }
    let message = fails(4, &["--ecrt", &setting(&empty), "scan"]);
    assert!(message.contains(&ecan_host::Error::NoSlaves.to_string()), "{message}");
    assert_eq!(ends(4, &["--ecrt", &setting(&empty), "scan", "--json"]), "[]\n");
}

#[test]
fn missing_or_wrong_scenario_returns_status_6() {
    let wrong = crate::support::scenario("[[gateway]]\nseriel = 7\n");
    let log = "[[node]]\nkind = \"replay\"\nbus = \"0.0\"\nfile = \"none.log\"\n";
    let no_log = Scenario::new(log);
    let cases = [
        ("sim:/no/such.toml".to_owned(), "cannot read /no/such.toml: No such file"),
        (setting(&wrong), "unknown field `seriel`"),
        (no_log.setting(), "none.log: No such file"),
        (
            "sim:ecco".to_owned(),
            "unknown scenario \"ecco\" (did you mean echo?); allowed: echo, drives, jitter",
        ),
    ];
    let files = Scenario::new("");
    let doctor = [words("doctor")];
    for (scenario, expected) in &cases {
        assert_has(&fails(6, &["--ecrt", scenario, "scan"]), expected);
    }
    let commands = commands_of_one(&files).into_iter().chain(commands_of_all(&files)).chain(doctor);
    for command in commands {
        fails(6, &with(&command, &["--ecrt", "sim:/no/such.toml"]));
    }
}

/// Commands with a configuration file; `FILE` stands for it.
const COMMANDS_WITH_FILE: [&str; 21] = [
    "config apply FILE",
    "config diff FILE",
    "config save FILE",
    "config export FILE --format csv",
    "plan --config FILE",
    "dump -n 1 --config FILE",
    "send 123#00 --config FILE",
    "gen -n 1 --config FILE",
    "monitor --once --config FILE",
    "bridge --slcan 127.0.0.1:0 --config FILE",
    "serve --config FILE",
    "selftest --config FILE",
    "node scan --config FILE",
    "node info --node gripper --config FILE",
    "node sdo read --node gripper --config FILE 0x1000",
    "node nmt stop --node gripper --config FILE",
    "node pdo --node gripper --config FILE",
    "node emcy --node gripper --config FILE",
    "node params save out.dcf --node gripper --config FILE",
    "axis status --config FILE --axis 0",
    "axis stop --config FILE --axis 0",
];

#[test]
fn missing_or_wrong_configuration_returns_status_6() {
    let files = Scenario::new("");
    let wrong = files.write("wrong.toml", "[[gateway]]\nn = 30\n");
    for command in COMMANDS_WITH_FILE {
        for (file, expected) in [
            ("/no/such.toml", "cannot read /no/such.toml: No such file"),
            (wrong.as_str(), "`n` = 30 is out of range; allowed: 1 to 24"),
        ] {
            let command = words(&command.replace("FILE", file));
            let message = fails(6, &with(&command, &["--ecrt", "sim"]));
            assert!(message.contains(expected), "{command:?}: {message}");
        }
    }
    // For the check of a file its faults are the result.
    fails(6, &["config", "check", "/no/such.toml"]);
    fails(1, &["config", "check", &wrong]);
}

/// Wrong command lines, and the hint of each.
const HINTS: &[(&str, &str)] = &[
    // A slave, node, axis or channel without its option.
    ("info 1", "the slave is an option: `ecan info --slave 1`"),
    ("config save 0", "the slave is an option: `ecan config save --slave 0`"),
    ("sdo read 5 0x1018:1", "the slave is an option: `ecan sdo read 0x1018:1 --slave 5`"),
    ("scan 1", "the master is an option: `ecan scan --master 1`"),
    ("node sdo read 5 0x1018:1", "the node is an option: `ecan node sdo read 0x1018:1 --node 5`"),
    (
        "node sdo write 5 0x1017 200",
        "the node is an option: `ecan node sdo write 0x1017 200 --node 5`",
    ),
    ("node nmt 5 start", "the node is an option: `ecan node nmt start --node 5`"),
    ("node 5 info", "the node is an option: `ecan node info --node 5`"),
    ("node 5", "a command is missing: `ecan node info --node 5`"),
    ("axis status 1", "the node is an option: `ecan axis status --node 1`"),
    ("axis move 1 --to 5", "the node is an option: '--node 1'"),
    ("axis stop elbow", "the axis is an option: `ecan axis stop --axis elbow --config FILE`"),
    ("node scan 2", "the channel is an option: `ecan node scan --channel 2`"),
    ("reg read 0 ECR", "the channel is an option: `ecan reg read ECR --channel 0`"),
    ("sim power cycle 1", "the gateway is an option: `ecan sim power cycle --gateway 1`"),
    // An option that is missing, or belongs to another command.
    ("node sdo read 0x1018:1", "for example: `ecan node sdo read 0x1018:1 --node 1`"),
    ("reg read ECR", "for example: `ecan reg read ECR --channel 0`"),
    ("info --node 1", "a node has a command of its own: `ecan node info --node 1`"),
    ("pins --rotation 1", "this argument has no name: `ecan pins 1`"),
    ("info --slave all", "all gateways are an option: `ecan info --all`"),
    ("plan x.toml", "this is an option: `ecan plan --config x.toml`"),
    ("config export x.toml csv", "this is an option: `ecan config export x.toml --format csv`"),
    ("filter add 0 0x123", "the channel is an option: `ecan filter add --channel 0 --id 0x123`"),
    ("info --salve 0", "a similar option exists: `ecan info --slave 0`"),
    // Frames and filters.
    ("dump 0", "the channel is an option: `ecan dump --channel 0`"),
    ("dump can0 can1", "the channel is an option: `ecan dump --channel can0,can1`"),
    ("dump can0,123:7FF", "the channel is an option: `ecan dump --channel can0 123:7FF`"),
    ("dump 123", "a filter has a mask: `ecan dump 123:7FF`"),
    ("send 0 123#11", "the channel is an option: `ecan send 123#11 --channel 0`"),
    ("send 0x123#11", "a frame is ID#DATA in hexadecimal: `ecan send 123#11`"),
    ("send 123 11 22", "a frame is ID#DATA in hexadecimal: `ecan send 123#1122`"),
    ("send 12345#11", "a frame is ID#DATA in hexadecimal: `ecan send 00012345#11`"),
    ("send --id 123 --data 11", "this argument has no name: `ecan send 123#11`"),
    // Objects.
    (
        "sdo read --slave 0 0x1018 1",
        "a subindex follows a colon: `ecan sdo read --slave 0 0x1018:1`",
    ),
    ("sdo read 1018 1", "a subindex follows a colon: `ecan sdo read 0x1018:1`"),
    ("sdo read 0x1018.1", "a subindex follows a colon: `ecan sdo read 0x1018:1`"),
    ("sdo read 1018:1", "a hexadecimal number begins with 0x: `ecan sdo read 0x1018:1`"),
    ("sdo write 0x8010 3 3", "a subindex follows a colon: `ecan sdo write 0x8010:3 3`"),
    ("sdo write 0x8010:3=3", "a value follows a space: `ecan sdo write 0x8010:3 3`"),
    ("sdo write 0x8010:3 = 3", "a value follows a space: `ecan sdo write 0x8010:3 3`"),
    ("sdo 0x1018:1", "a command is missing: `ecan sdo read 0x1018:1`"),
    // Other tools.
    ("slaves", "the command has another name here: `ecan scan`"),
    ("-p 0 info", "the slave is an option: `ecan --slave 0 info`"),
    ("upload -p 0 0x1018 1", "`ecan sdo read --slave 0 0x1018:1`"),
    ("cansend can0 123#11", "the command has another name here: `ecan send --channel can0 123#11`"),
    // The simulator.
    ("--sim scan", "the simulator is an option: `ecan --ecrt sim scan`"),
    ("sim scan", "the simulator is an option: `ecan --ecrt sim scan`"),
    ("sim:drives scan", "the library is an option: `ecan --ecrt sim:drives scan`"),
    ("--ecrt sim --slave 0", "a command is missing: `ecan --ecrt sim --slave 0 info`"),
];

#[test]
fn wrong_command_line_is_rejected_with_the_one_that_was_meant() {
    for (line, hint) in HINTS {
        assert_has(&fails(2, &with(&words(line), &[])), hint);
    }
    let json = json_of(&ends(2, &["--json", "info", "1"]));
    let expected =
        "unexpected argument '1' found; the slave is an option: `ecan --json info --slave 1`";
    assert_eq!(json["error"], expected);
    // A value in the wrong unit or order.
    crate::support::all_fail(&[
        (2, &["dump", "--bitrate", "500"], "at least 1000, with k or M for thousands"),
        (2, &["sdo", "write", "3", "0x8010:3"], "0x0003:00: the object is not in the table"),
    ]);
    // What fits nothing has no hint.
    let message = fails(2, &["info", "nonsense"]);
    assert!(!message.contains("tip:"), "{message}");
}

#[test]
fn long_message_is_broken_on_a_terminal_only() {
    let missing = ["--ecrt", "/nowhere/libethercat.so", "scan"];
    let whole = fails(3, &missing);
    assert_eq!(whole.lines().count(), 1, "{whole}");
    let terminal = Pty::open((60, 24));
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    let status = command.args(missing).stderr(terminal.stdio()).status().unwrap();
    assert_eq!(status.code(), Some(3));
    let mut shown = TimedReader::new(terminal.master.try_clone().unwrap());
    shown.wait_for("ECAN_ECRT=sim\r\n");
    let shown = shown.text().replace('\r', "");
    assert!(shown.lines().all(|line| line.len() <= 60), "{shown}");
    assert_eq!(shown.trim_end().replace("\n  ", " "), whole);
}

#[test]
fn plain_simulator_has_what_the_file_configures() {
    let files = Scenario::new("");
    let gateway = "[[gateway]]\nposition = N\ncan1 = { bitrate = 1000000 }\n";
    let gateways: String = ["0", "1", "2"].map(|at| gateway.replace('N', at)).concat();
    let axis = "[[axis]]\ngateway = 2\nchannel = 1\nnode = 9\n";
    let file = files.write("three.toml", &format!("cycle_us = 2000\n{gateways}{axis}"));
    let read = ["--ecrt", "sim", "--slave", "2", "node", "info", "--node", "1.9"];
    let output = crate::support::ecan(&[&read[..], &["--config", &file]].concat());
    let [printed, errors] =
        [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(output.status.success() && printed.contains("402"), "{printed}{errors}");
    assert!(errors.contains("Scenario drives: 3 gateways"), "{errors}");
    let listed = json_of(&crate::support::good(&["--json", "--ecrt", "sim:2", "scan"]));
    let gateways = listed.as_array().unwrap();
    assert!(gateways.len() == 2 && gateways.iter().all(|slave| slave["is_simulated"] == true));
}
