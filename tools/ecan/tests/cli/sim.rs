//! Tests of `ecan sim`.

use serde_json::Value;

use crate::serve::{Served, serve_bus};
use crate::support::{FakeLibrary, assert_has, fails, good, json_of, scenario, setting, wait_for};

const CELL: &str = "\
name = \"cell\"
[[gateway]]
[[gateway]]
[[node]]
kind = \"drive\"
bus = \"0.2\"
name = \"shoulder\"
node_id = 5
[[fault]]
kind = \"bus_off\"
gateway = 1
channel = 0
after_ready_ms = 3600000
";

fn serve_cell(options: &[&str]) -> Served {
    let file = scenario(CELL);
    serve_bus(&setting(&file), options)
}

impl Served {
    fn sim(&self, arguments: &[&str]) -> String {
        good(&[&["--via", &self.path, "sim"], arguments].concat())
    }

    fn sim_json(&self, arguments: &[&str]) -> Value {
        let text = good(&[&["--via", &self.path, "--json", "sim"], arguments].concat());
        json_of(&text)
    }

    fn sim_fails(&self, status: i32, arguments: &[&str]) -> String {
        fails(status, &[&["--via", &self.path, "sim"], arguments].concat())
    }

    /// State of a gateway, when it fits.
    fn wait_for(&self, gateway: usize, fits: impl Fn(&Value) -> bool) {
        wait_for("the state", || fits(&self.sim_json(&["status"])["gateways"][gateway]));
    }
}

#[test]
fn supply_is_switched_while_the_machine_lives() {
    let mut served = serve_cell(&["--bitrate", "500000"]);
    served.program.wait_for_error("slave 1: ready");
    let status = served.sim_json(&["status"]);
    assert_eq!((&status["scenario"], &status["seed"]), (&"cell".into(), &1.into()));
    assert_eq!(status["gateways"][1]["position"], 1);
    assert_eq!(status["nodes"][0]["name"], "shoulder");
    assert_eq!(status["nodes"][0]["kind"], "drive");

    let ready_ns = status["ready_ns"].as_u64().unwrap();
    assert!(status["op_ns"].as_u64().unwrap() < ready_ns);
    let bus_off_ns = served.sim_json(&["faults"])["pending"][0]["time_ns"].as_u64().unwrap();
    assert_eq!(bus_off_ns, ready_ns + 3_600_000_000_000);

    let text = served.sim(&["power", "0", "off"]);
    assert!(text.ends_with(" s: fault: gateway 0 without supply\n"), "{text}");
    served.program.wait_for_error(text.trim_end());
    served.program.wait_for_error("slave 0: lost");
    let text = served.sim(&["status"]);
    let row = |start: &str| text.lines().find(|line| line.starts_with(start)).unwrap();
    assert!(text.starts_with("scenario cell, seed 1: "), "{text}");
    assert_eq!(row("0 "), "0        0    off     closed  no       -");
    assert_eq!(row("shoulder"), "shoulder  drive  0.2");
    let text = "no effect: gateway 1 supplied again\n";
    assert_eq!(served.sim(&["power", "on", "--gateway", "1"]), text);
    // States what the command requires anyway.
    let stated = ["--ecrt", "sim", "--via", &served.path, "sim", "power", "1", "on"];
    assert_eq!(good(&stated), text);

    let text = served.sim(&["power", "0", "on"]);
    assert!(text.ends_with(" s: fault: gateway 0 supplied again\n"), "{text}");
    served.program.wait_for_error("slave 0: ready");
    served.wait_for(0, |gateway| gateway["al_state"] == "OP" && gateway["is_powered"] == true);
    let text = served.sim(&["power", "0", "cycle", "--off", "200ms", "--wait"]);
    assert!(text.ends_with("gateway 0 without supply for 200 ms\n"), "{text}");
    assert_eq!(served.sim_json(&["status"])["gateways"][0]["is_running"], true);
    served.program.wait_for_error("slave 0: lost");
    served.program.wait_for_error("slave 0: ready");
    served.end();
}

#[test]
fn faults_are_listed_with_their_times() {
    let served = serve_cell(&["--idle"]);
    let pending = "pending 3600.000 s after ready: gateway 1 channel 0: bus-off\n";
    assert_eq!(served.sim(&["faults"]), pending);
    let injected = served.sim_json(&["fault", "al-error", "--gateway", "0", "--code", "0x1B"]);
    assert_eq!(injected["state"], "injected");
    assert_eq!(injected["fault"], "gateway 0: AL error 0x001B");

    let scheduled = ["fault", "link-loss", "--gateway", "1", "--for", "0.3s", "--after", "1min"];
    let scheduled = served.sim_json(&scheduled);
    assert_eq!(scheduled["state"], "pending");
    let after = scheduled["time_ns"].as_u64().unwrap() - injected["time_ns"].as_u64().unwrap();
    assert!(after >= 60_000_000_000, "{after}");
    let mut faults = served.sim_json(&["faults"]);
    // Stated once for the whole document.
    let is_simulated = faults["is_simulated"].clone();
    for list in ["injected", "pending"] {
        faults[list][0]["is_simulated"] = is_simulated.clone();
    }
    assert_eq!(faults["injected"], serde_json::json!([injected]));
    assert_eq!(faults["pending"][0], scheduled);
    assert_eq!(faults["pending"][1]["after_ready_ns"], 3_600_000_000_000_u64);

    served.sim(&["fault", "link-loss", "--gateway", "1", "--for", "20ms", "--after", "1ms"]);
    let injected = || served.sim_json(&["faults"])["injected"].as_array().unwrap().len();
    wait_for("the second fault", || injected() == 2);
    served.end();
}

#[test]
fn wrong_faults_are_rejected() {
    let served = serve_cell(&["--idle", "--read-only"]);
    assert!(served.sim(&["status"]).contains("all gateways in OP not yet, ready not yet"));
    assert_has(&served.sim_fails(3, &["power", "0", "off"]), "sim.fault is not permitted");
    served.end();

    let served = serve_cell(&["--idle"]);
    for (arguments, words) in [
        (&["power", "2", "off"][..], "gateway 2 does not exist; there are 2"),
        (&["power", "off", "--gateway", "2"], "gateway 2 does not exist; there are 2"),
        (&["power", "off"], "`power_off` needs `gateway`; there are 2"),
        (&["power", "0", "on", "--off", "1s"], "--off belongs to `cycle`"),
        (&["power", "0", "off", "--wait"], "--wait belongs to `on` and `cycle`"),
        (&["fault", "power-off"], "`power_off` needs `gateway`; there are 2"),
        (
            &["fault", "drive-error", "--node", "elbow", "--code", "1"],
            "node \"elbow\" does not exist; there are: shoulder",
        ),
        (&["fault", "bus-off", "--gateway", "0", "--channel", "300"], "channel 300"),
        (
            &["fault", "sdo-abort", "--gateway", "0", "--index", "0x12345", "--code", "1"],
            "expected u16",
        ),
        (&["--slave", "0", "status"], "--slave is not used"),
    ] {
        let message = served.sim_fails(2, arguments);
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
    served.end();
}

#[test]
fn real_bus_is_never_changed() {
    let Some(library) = FakeLibrary::build() else { return };
    let served = serve_bus(&library.path(), &["--idle"]);
    for arguments in [&["status"][..], &["power", "0", "off"]] {
        assert_has(&served.sim_fails(3, arguments), "holds a real bus");
    }
    served.end();
}

#[test]
fn missing_machine_is_reported() {
    for arguments in [&["--via", "direct"][..], &["--ecrt", "sim"]] {
        let message = fails(3, &[arguments, &["sim", "status"]].concat());
        assert!(message.contains("start `ecan --ecrt sim serve`"), "{message}");
    }
}
