//! `ecan node` on simulated drives, with a cycle of its own.

use serde_json::Value;

use crate::serve::serve_bus;
use crate::support::{Scenario, assert_has, ecan, ends, fails, good, json_of};

const DRIVES: [&str; 2] = ["--ecrt", "sim:drives"];

fn drives(arguments: &[&str]) -> String {
    good(&[&DRIVES[..], arguments].concat())
}

fn json(arguments: &[&str]) -> Value {
    json_of(&drives(&[&["--json"], arguments].concat()))
}

fn drives_fail(status: i32, arguments: &[&str]) -> String {
    fails(status, &[&DRIVES[..], arguments].concat())
}

/// A drive on channel 0, with further keys, and tables after it.
fn one_drive(node_id: u8, keys: &str, tables: &str) -> Scenario {
    Scenario::new(&format!(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = {node_id}\n{keys}{tables}"
    ))
}

#[test]
fn scan_finds_the_nodes_of_all_channels() {
    let report = json(&["node", "scan"]);
    let nodes: Vec<_> = report["nodes"].as_array().unwrap().iter().collect();
    let addresses: Vec<_> =
        nodes.iter().map(|found| (found["channel"].as_u64(), found["node"].as_u64())).collect();
    let expected: Vec<_> =
        (0..4).flat_map(|channel| (1..=4).map(move |node| (Some(channel), Some(node)))).collect();
    assert_eq!(addresses, expected);
    let last = nodes[15];
    assert_eq!(last["serial"], 34_008, "{last}");
    assert_eq!((&last["vendor_id"], &last["product_code"]), (&0x5349_4D00.into(), &402.into()));
    assert_eq!(last["name"], "ECAN simulated servo drive");
    let text = drives(&["node", "scan", "--channel", "1", "--nodes", "2-3"]);
    assert_eq!(text.lines().filter(|line| line.starts_with("0      can1")).count(), 2, "{text}");
    assert!(text.contains("slave 0 can1: 2 node(s) at 500 kbit/s"), "{text}");
}

#[test]
fn scan_through_a_service_waits_for_a_gateway_that_starts() {
    let mut served = serve_bus("sim:drives", &["--bitrate", "1M"]);
    served.program.wait_for_error("slave 0: ready");
    let via = ["--via", served.path.as_str()];
    good(&[&via[..], &["sim", "power", "0", "cycle"]].concat());
    let text = good(&[&via[..], &["node", "scan"]].concat());
    for channel in 0..4 {
        let line = format!("slave 0 can{channel}: 4 node(s) at 1000 kbit/s");
        assert!(text.contains(&line), "{text}");
    }
    served.end();
}

#[test]
fn channel_without_nodes_is_reported_and_ends_the_scan() {
    // A node at another bit rate does not acknowledge.
    let scenario = one_drive(5, "bitrate = 250000\n", "");
    let output = scenario.run(&["node", "scan", "--channel", "0,1"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    for channel in ["can0", "can1"] {
        let line = format!("slave 0 {channel}: no node acknowledges frames at 500 kbit/s; check");
        assert!(text.contains(&line), "{text}");
    }
    assert_has(&scenario.fails(5, &["node", "info", "--node", "5"]), "no node acknowledges");
}

#[test]
fn bit_rates_are_found_by_listening_and_by_a_request() {
    // Channel 1 is silent, channel 2 has traffic.
    let scenario = Scenario::new(
        "[[node]]\nkind = \"drive\"\nname = \"a\"\nbus = \"0.1\"\nnode_id = 7\nbitrate = 125000\n\
         [[node]]\nkind = \"replay\"\nbus = \"0.2\"\nfile = \"bus.log\"\nbitrate = 250000\n\
         [[node]]\nkind = \"silent\"\nbus = \"0.2\"\nbitrate = 250000\n",
    );
    let mut log = String::new();
    for ms in (0..20_000).step_by(100) {
        log.push_str(&format!("({}.{:03}000) can0 709#05\n", ms / 1000, ms % 1000));
    }
    scenario.write("bus.log", &log);
    let output = scenario.run(&["--json", "node", "scan", "--bitrates", "--channel", "0,1,2"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rates: Vec<_> =
        report["channels"].as_array().unwrap().iter().map(|channel| &channel["bitrate"]).collect();
    assert_eq!(rates, [&Value::Null, &125_000.into(), &250_000.into()]);
    let nodes = report["nodes"].as_array().unwrap();
    let found =
        |node: &Value| (node["node"].as_u64(), node["has_sdo"].as_bool(), node["state"].clone());
    assert_eq!(found(&nodes[0]), (Some(7), Some(true), Value::Null));
    assert_eq!(found(&nodes[1]), (Some(9), Some(false), "operational".into()), "by its heartbeat");
    let found = errors.find("slave 0 can2: 250000 bit/s").unwrap();
    assert!(found < errors.find("slave 0 can1: 125000 bit/s").unwrap(), "{errors}");
    let message = scenario.fails(2, &["node", "scan", "--bitrates", "--bitrate", "500000"]);
    assert!(message.contains("cannot be used with"), "{message}");
}

#[test]
fn info_describes_a_drive() {
    let text = drives(&["node", "info", "--node", "2.3"]);
    for line in [
        "node            3 on can2 of slave 0",
        "device type     servo drive (CiA 402), 0x00020192",
        "identity        vendor 0x53494D00, product 0x00000192, revision 0x00010000, serial 23008",
        "NMT state       not reported (no heartbeat)",
        "drive           switch on disabled (statusword 0x0240)",
        "mode            none; supported: PP, VL, PV, PT, HM, IP, CSP, CSV, CST",
        "RPDOs           1 of 4 valid: 1 (0x203, 16 bits)",
    ] {
        assert!(text.lines().any(|shown| shown == line), "{line}: {text}");
    }
    let info = json(&["node", "info", "--node", "3", "--channel", "2"]);
    assert_eq!((&info["channel"], &info["serial"]), (&2.into(), &23_008.into()));
    assert_eq!(info["drive"]["supported_modes"], "PP, VL, PV, PT, HM, IP, CSP, CSV, CST");
}

#[test]
fn node_that_does_not_exist_is_named_with_the_remedy() {
    let message = drives_fail(5, &["node", "info", "--node", "1.77"]);
    assert!(message.contains("from node 77 (slave 0, channel 1): no answer after 2"), "{message}");
    assert!(message.contains("`ecan node scan` lists the nodes"), "{message}");
    for (arguments, expected) in [
        (&["--node", "0"][..], "1 to 127"),
        (&["--node", "4.1"], "expected a channel, 0 to 3"),
        (&["--node", "1.2", "--channel", "2"], "name different channels"),
        (&[], "<NODE>"),
    ] {
        let message = drives_fail(2, &[&["node", "info"], arguments].concat());
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
}

#[test]
fn reset_is_confirmed_by_the_boot_up_message() {
    for (command, expected) in [
        ("reset", "node 1 on can0: pre-operational, by its boot-up message\n"),
        ("reset-comm", "node 1 on can0: pre-operational, by its boot-up message\n"),
        ("start", "node 1 on can0: operational, by its PDO\n"),
        ("stop", "node 1 on can0: stopped, by node guarding\n"),
    ] {
        assert_eq!(drives(&["node", "nmt", command, "--node", "1", "--yes"]), expected);
    }
    let all = json(&["node", "nmt", "reset", "--all", "--channel", "3", "--yes"]);
    let nodes: Vec<_> =
        all["nodes"].as_array().unwrap().iter().map(|found| &found["node"]).collect();
    assert_eq!(nodes, [&Value::from(1), &2.into(), &3.into(), &4.into()]);
    assert!(
        all["nodes"].as_array().unwrap().iter().all(|node| node["proof"] == "boot_up"),
        "{all}"
    );
}

#[test]
fn state_without_a_report_is_not_confirmed() {
    let drive = one_drive(1, "", "[node.quirks]\nmissing = [0x100C]\n");
    let stopped = drive.good(&["node", "nmt", "stop", "--node", "1"]);
    assert_eq!(stopped, "node 1 on can0: stopped, it no longer answers SDO requests\n");
    let message = drive.fails(1, &["node", "nmt", "preop", "--node", "1", "--timeout", "500"]);
    assert!(message.contains("did not confirm pre-operational; set a producer"), "{message}");
    // A request by node guarding would start the life guarding of this node.
    let guarded = one_drive(1, "eds = \"guarded.eds\"\n", "");
    let object = |index: &str, ty: u8, value: u32| {
        format!(
            "[{index}]\nParameterName=x{index}\nDataType={ty}\nAccessType=rw\nDefaultValue={value}\n"
        )
    };
    let objects = object("1000", 7, 0x191) + &object("100C", 6, 100) + &object("100D", 5, 3);
    guarded.write("guarded.eds", &objects);
    let message = guarded.fails(1, &["node", "nmt", "preop", "--node", "1", "--timeout", "500"]);
    assert!(message.contains("did not confirm pre-operational; set a producer"), "{message}");
    let message = drives_fail(1, &["node", "nmt", "preop", "--all", "--timeout", "500"]);
    assert!(message.contains("no node on can0 reported a state"), "{message}");
    let absent = ends(1, &[&DRIVES[..], &["node", "nmt", "stop", "--node", "77"]].concat());
    assert_eq!(absent, "node 77 on can0: state not reported\n", "a missing node is not stopped");
}

#[test]
fn dangerous_commands_need_a_confirmation() {
    for command in ["start", "reset", "reset-comm"] {
        let message = drives_fail(2, &["node", "nmt", command, "--node", "1"]);
        assert!(message.contains("cannot ask for confirmation") && message.contains("--yes"));
    }
    for object in ["0x6040", "modes of operation", "0x607A", "0x60FF", "0x6860:0"] {
        let arguments = ["node", "sdo", "write", "--node", "1", "--type", "u16", object, "1"];
        assert_has(&drives_fail(2, &arguments), "cannot ask for confirmation of writing 0x6");
    }
}

#[test]
fn pdos_are_shown_with_their_objects() {
    let text = drives(&["node", "pdo", "--node", "1"]);
    let line = |name: &str| text.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    assert!(line("RPDO 1").contains("0x201   yes    event (255)"), "{text}");
    assert!(line("TPDO 3").contains("0x381   no     every SYNC (1)"), "{text}");
    assert!(
        line("TPDO 3")
            .ends_with("48    0x6041:00 statusword (16), 0x6064:00 position actual value (32)")
    );
    let pdos = json(&["node", "pdo", "--node", "1"]);
    assert_eq!(pdos.as_array().unwrap().len(), 8);
    assert_eq!(pdos[2]["mapping"][1]["name"], "target position");
    let message = drives_fail(1, &["node", "pdo", "--node", "1", "--watch", "-T", "300"]);
    assert!(message.contains("a node sends PDOs in the state operational"), "{message}");
}

#[test]
fn errors_are_shown_live_and_in_the_history() {
    let fault = |ms: u32, kind: &str| {
        format!("[[fault]]\nafter_ready_ms = {ms}\nnode = \"x\"\nkind = {kind}\n")
    };
    let tables = fault(1_000, "\"drive_error\"\ncode = 0x2310")
        + &fault(2_000, "\"drive_emcy\"\ncode = 0x4310\nregister = 9");
    let scenario = one_drive(9, "", &tables);
    let watch = ["node", "emcy", "--node", "9", "--watch", "-n", "2", "-T", "5000"];
    let output = scenario.good(&watch);
    let lines: Vec<_> = output.lines().collect();
    assert_eq!(lines[..2], ["node 9 on can0, error register: no error", "error history: empty"]);
    let current = "0x2310 continuous over-current at the output; error register: generic, current";
    assert!(lines[2].contains(current), "{output}");
    let temperature =
        "0x4310 excess temperature of the drive; error register: generic, current, temperature";
    assert!(lines[3].contains(temperature), "{output}");
    // The error arrives while another command waits: then it is in the history.
    let early = one_drive(9, "", &fault(1, "\"drive_error\"\ncode = 0x2310"));
    let text = early.good(&["node", "emcy", "--node", "9", "--clear"]);
    assert!(text.contains("  1  0x2310 continuous over-current at the output"), "{text}");
    assert!(text.ends_with("error history cleared\n"), "{text}");
    let message = one_drive(9, "", "")
        .fails(1, &["node", "emcy", "--node", "9", "--watch", "-n", "1", "-T", "200"]);
    assert!(message.contains("0 of 1 emergency messages received"), "{message}");
}

#[test]
fn node_that_restarts_during_a_transfer_is_reported() {
    // The drive loses its supply before the answer of the first request.
    let fault =
        "[[fault]]\nafter_ready_ms = 3\nkind = \"drive_power_cycle\"\nnode = \"x\"\noff_ms = 100\n";
    let scenario = one_drive(5, "sdo_delay_us = 200000\n", fault);
    let output = scenario.run(&["node", "sdo", "read", "--node", "5", "0x1000"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(5), "{errors}");
    assert!(errors.contains("the node restarted"), "{errors}");
}

#[test]
fn help_of_every_subcommand_has_its_exit_status_and_options() {
    for command in ["scan", "info", "sdo", "nmt", "pdo", "emcy"] {
        let help = ecan(&["node", command, "--help"]);
        assert!(help.status.success(), "{command}");
    }
    let help = String::from_utf8(ecan(&["node", "--help"]).stdout).unwrap();
    assert!(help.contains("Examples:") && help.contains("--yes"), "{help}");
}
