//! `ecan node lss`: slaves without node-ID, on a bus that lives as long as a service, and alone.

use crate::serve::{Served, serve_bus};
use crate::support::{Scenario, assert_has, ends};

/// Drives with these node-IDs and serial numbers; those of `unconfigured` have no node-ID.
fn slaves(unconfigured: &[u32], configured: &[(u8, u32)]) -> Scenario {
    let drive = |node: u8, serial: u32, keys: &str| {
        format!(
            "[[node]]\nkind = \"drive\"\nname = \"s{serial}\"\nbus = \"0.0\"\nnode_id = {node}\n\
             serial = {serial}\n{keys}"
        )
    };
    let without = unconfigured
        .iter()
        .zip(100..)
        .map(|(serial, node)| drive(node, *serial, "quirks = { without_node_id = true }\n"));
    let with = configured.iter().map(|(node, serial)| drive(*node, *serial, ""));
    Scenario::new(&without.chain(with).collect::<String>())
}

fn serve(scenario: &Scenario) -> Served {
    let mut served = serve_bus(&scenario.setting(), &[]);
    served.program.wait_for_error("slave 0: ready");
    served
}

fn address(serial: u32) -> String {
    format!("0x53494D00:0x192:0x10000:{serial}")
}

#[test]
fn slaves_without_node_id_are_found_and_get_one() {
    let scenario = slaves(&[77, 12, 900], &[(5, 3)]);
    let scan = scenario.good(&["node", "lss", "scan"]);
    let found: Vec<_> = scan.lines().filter_map(|line| line.split_whitespace().nth(3)).collect();
    assert_eq!(found[..4], ["SERIAL", "12", "77", "900"], "the lowest address first: {scan}");
    assert!(scan.ends_with("slave 0 can0: 3 slave(s) without node-ID\n"), "{scan}");
    assert!(scan.contains(&address(900)), "{scan}");

    let served = serve(&scenario);
    let set = |id: &str, serial: u32| {
        let address = address(serial);
        served.node(&["lss", "set-id", id, "--address", &address, "--yes", "--store"])
    };
    assert!(set("7", 12).ends_with("serial number 0xC: node-ID 7, stored, booted\n"));
    assert!(served.node(&["info", "7"]).contains("serial 12\n"));
    assert!(set("8", 900).ends_with("node-ID 8, stored, booted\n"));
    let scan = ["lss", "scan", "--vendor", "0x53494D00", "--product", "402"];
    assert!(served.node(&scan).ends_with(": 1 slave(s) without node-ID\n"));
    let address = address(77);
    let message = served.node_fails(5, &["lss", "set-id", "7", "--address", &address, "--yes"]);
    assert!(message.contains("node-ID 7 is in use on can0; choose another one"), "{message}");
    assert!(set("9", 77).contains("node-ID 9"));
    let via = ["--via", served.path.as_str(), "node", "lss"];
    let none = ends(1, &[&via[..], &scan[1..]].concat());
    assert_eq!(none, "slave 0 can0: 0 slave(s) without node-ID\n");
    served.end();
}

#[test]
fn node_id_of_a_node_is_changed_after_a_reset() {
    let scenario = slaves(&[], &[(5, 3), (6, 4)]);
    let served = serve(&scenario);
    let set = served.node(&["lss", "set-id", "20", "--node", "6", "--yes"]);
    assert!(set.ends_with("serial number 0x4: node-ID 20\n"), "{set}");
    assert!(served.node(&["info", "6"]).contains("serial 4\n"), "until the reset");
    // It boots with the new node-ID.
    let via = ["--via", served.path.as_str(), "node"];
    let reset = ["nmt", "reset-comm", "--node", "6", "--yes", "--timeout", "300"];
    ends(1, &[&via[..], &reset].concat());
    assert!(served.node(&["info", "20"]).contains("serial 4\n"));
    served.end();
}

#[test]
fn selected_slave_stays_in_the_configuration_state() {
    let scenario = slaves(&[77], &[(5, 3)]);
    let served = serve(&scenario);
    let select = |rest: &[&str]| served.node(&[&["lss", "select"], rest].concat());
    let of_77 = address(77);
    assert!(
        select(&["--address", &of_77])
            .ends_with("serial number 0x4D: no node-ID, configuration state\n")
    );
    let via = ["--via", served.path.as_str(), "node", "lss"];
    let other = ends(1, &[&via[..], &["identify", "--vendor", "1", "--product", "2"]].concat());
    assert_eq!(other, "slave 0 can0: no slave in the range responds\n");
    assert_eq!(
        served.node(&["lss", "release"]),
        "slave 0 can0: all slaves switched to the waiting state\n"
    );
    assert!(
        served
            .node(&["lss", "identify"])
            .ends_with("at least one slave without node-ID responds\n")
    );
    let range = ["lss", "identify", "--vendor", "0x53494D00", "--product", "402", "--serial"];
    let identify = |serials: &str| served.node(&[&range[..], &[serials]].concat());
    assert!(identify("70-80").ends_with("at least one slave in the range responds\n"));
    let selected = select(&["--node", "5"]);
    assert!(
        selected.ends_with("serial number 0x3: node-ID 5, configuration state\n"),
        "{selected}"
    );
    let message = served.node_fails(5, &["lss", "select", "--only"]);
    assert!(message.contains("LSS on can0: several slaves respond; select one"), "{message}");
    let message = served.node_fails(5, &["lss", "select", "--address", "1:2:3:4"]);
    let (_, waited) = message.split_once("no slave with this address responded after ").unwrap();
    let (waited_ms, _) = waited.split_once(" ms;").unwrap();
    assert!(waited_ms.parse::<u64>().unwrap() >= 500, "{message}");
    served.end();
}

#[test]
fn bit_rate_is_configured_and_activated() {
    let scenario = slaves(&[], &[(5, 3)]);
    let run = |arguments: &[&str]| scenario.good(&[&["node", "lss"], arguments].concat());
    let stored = run(&["set-bitrate", "250000", "--only", "--store", "--yes"]);
    assert!(stored.ends_with(": node-ID 5, 250000 bit/s, stored\n"), "{stored}");
    let active = run(&["set-bitrate", "125000", "--node", "5", "--activate", "100", "--yes"]);
    assert!(active.ends_with(": node-ID 5, 125000 bit/s\n"), "{active}");
    let message = scenario.fails(2, &["node", "lss", "set-bitrate", "123", "--only", "--yes"]);
    assert!(message.contains("allowed: 1000000, 800000, 500000"), "{message}");
    let served = serve(&scenario);
    let activate = ["lss", "set-bitrate", "125000", "--only", "--activate", "100", "--yes"];
    assert_has(&served.node_fails(2, &activate), "--activate needs the gateways alone: ecan serve");
    assert!(served.node(&["lss", "store", "--only"]).ends_with(": node-ID 5, stored\n"));
    served.end();
}

#[test]
fn configuration_needs_a_confirmation_and_a_slave() {
    let scenario = slaves(&[77], &[]);
    let message = scenario.fails(2, &["node", "lss", "set-id", "5", "--only"]);
    assert!(message.contains("cannot ask for confirmation of configuring node-ID 5"), "{message}");
    for (arguments, expected) in [
        (&["set-id", "5", "--yes"][..], "<--address <ADDRESS>|--node <ID>|--only>"),
        (&["set-id", "5", "--node", "1", "--only"], "cannot be used with"),
        (&["set-id", "128", "--only"], "expected a node-ID, 1 to 127, or none"),
        (&["select", "--address", "1:2"], "VENDOR:PRODUCT:REVISION:SERIAL"),
    ] {
        let message = scenario.fails(2, &[&["node", "lss"], arguments].concat());
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
    let empty = Scenario::new("");
    assert_has(&empty.fails(5, &["node", "lss", "scan"]), "no node acknowledges");
}
