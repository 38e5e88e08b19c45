//! `ecan config apply` through a running `ecan serve`.

use std::path::Path;

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::{
    BUS_ERROR, BUSY, Client, ClientError, Event, FrameEvent, GatewaysChanged, INVALID_PARAMS,
    RpcError, Subscription,
};
use serde_json::{Value, json};

use super::serve::{Served, serve};
use super::support::timed_reader::LIMIT;
use super::support::{Running, assert_has, fails, good, json_of, setting, two_gateways};

// A watchdog that a busy machine does not miss.
const ONE: &str = "\
watchdog_us = 2_000_000
[[gateway]]
n = 3
can0 = { bitrate = 500_000 }
";
const OTHER: &str = "\
watchdog_us = 2_000_000
[[gateway]]
n = 5
can0 = { bitrate = 250_000 }
can1 = { bitrate = 125_000 }
";

/// A service with this configuration, ready.
fn served(text: &str) -> Served {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("cell.toml");
    std::fs::write(&file, text).unwrap();
    let mut served = serve(&["--config", file.to_str().unwrap()]);
    served.program.wait_for_error("slave 0: ready");
    served
}

impl Served {
    fn file(&self, text: &str) -> String {
        let path = self.directory.path().join("new.toml");
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }

    fn good(&self, arguments: &[&str]) -> String {
        good(&[&["--via", &self.path], arguments].concat())
    }

    fn fails(&self, status: i32, arguments: &[&str]) -> String {
        fails(status, &[&["--via", &self.path], arguments].concat())
    }
}

fn request(client: &Client, text: &str) -> Result<Value, Box<RpcError>> {
    let params = json!({ "name": "new.toml", "text": text });
    client.call("reconfigure", params).map_err(|error| match error {
        ClientError::Rpc(error) => error,
        other => panic!("{other}"),
    })
}

fn next_gateways(client: &Client) -> GatewaysChanged {
    loop {
        let event = client.poll(LIMIT).unwrap().expect("a notification in time");
        if let Event::Gateways(changed) = event {
            return changed;
        }
    }
}

fn active_n(client: &Client) -> Value {
    client.config().unwrap().adapter["slaves"][0]["rx_multiplier"].clone()
}

/// Sends a frame and waits for its transmit result and the echo of the node.
fn exchange(client: &Client, channel: u8) {
    client.subscribe(&Subscription::default()).unwrap();
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2]).unwrap();
    let own = client.send(0, channel, &frame).unwrap();
    let (mut is_sent, mut is_echoed) = (false, false);
    while !is_sent || !is_echoed {
        let event = client.poll(LIMIT).unwrap().expect("a frame in time");
        let Event::Frame(report) = event else { continue };
        assert_eq!(report.channel, channel);
        match report.event {
            FrameEvent::Received => is_echoed = true,
            FrameEvent::Transmitted => is_sent |= report.tag == own,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn apply_changes_n_and_bit_rate_for_all_clients() {
    let served = served(ONE);
    let clients = [served.client(), served.client()];
    let file = served.file(OTHER);
    let printed = served.good(&["config", "apply", &file]);
    let expected = format!(
        "slave 0: configured as gateway 0 of {file}\n  \
         gateway[0].rx_multiplier: 3 -> 5\n  \
         gateway[0].tx_multiplier: 3 -> 5\n  \
         gateway[0].can0.nominal_bitrate: 500000 -> 250000\n  \
         gateway[0].can1: none -> set\n"
    );
    assert_eq!(printed, expected);
    for client in &clients {
        let changed = next_gateways(client);
        let rates: Vec<_> =
            changed.gateways[0].channels.iter().map(|channel| channel.bitrate).collect();
        assert_eq!(rates, [250_000, 125_000]);
        assert_eq!(active_n(client), 5);
        exchange(client, 1);
    }
    assert_eq!(served.good(&["config", "diff", "--active", &file]), "");
    assert_has(&served.fails(5, &["config", "save"]), "keeps it in OP: end that program, or use");
    // As large as the file of many gateways.
    let file = served.file(&format!("# {}\n{OTHER}", "x".repeat(400_000)));
    let json = served.good(&["config", "apply", &file, "--json"]);
    let report = json_of(&json);
    assert_eq!(report["changes"], json!([]));
    assert_eq!(report["gateways"], json!([{ "position": 0, "gateway": 0 }]));
    served.end();
}

#[test]
fn apply_changes_the_set_of_gateways() {
    let bus = two_gateways();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("cell.toml");
    std::fs::write(&file, ONE).unwrap();
    let path = directory.path().join("bus.sock").display().to_string();
    let file = file.to_str().unwrap();
    let arguments = ["--ecrt", &setting(&bus), "serve", "--socket", &path, "--config", file];
    let mut program = Running::start(&arguments);
    program.wait_for_error("slave 0: ready");
    let served = Served { directory, path, program };
    let client = served.client();
    let second = "[[gateway]]\nalias = 7\nn = 2\ncan3 = { bitrate = 125_000 }\n";
    let printed = served.good(&["config", "apply", &served.file(&format!("{ONE}{second}"))]);
    assert!(printed.contains("slave 1: configured as gateway 1"), "{printed}");
    assert!(printed.contains("  gateway[1]: none -> set\n"), "{printed}");
    assert_eq!(next_gateways(&client).gateways.len(), 2);
    let only = format!("watchdog_us = 2_000_000\n{second}");
    let printed = served.good(&["config", "apply", &served.file(&only)]);
    assert!(printed.starts_with("slave 1: configured as gateway 0"), "{printed}");
    let gateways = next_gateways(&client).gateways;
    assert_eq!((gateways.len(), gateways[0].alias, gateways[0].channels[0].channel), (1, 7, 3));
    served.end();
}

#[test]
fn device_profile_is_sent_with_the_file() {
    let served = served(ONE);
    let profile = served.directory.path().join("gateway.profile");
    std::fs::write(profile, "serial = \"1\"\nschedule_depth = 17\n").unwrap();
    let file = served.file(&ONE.replace("n = 3", "n = 3\ndevice_profile = \"gateway.profile\""));
    let printed = served.good(&["config", "apply", &file]);
    assert!(printed.contains("gateway[0].schedule.depth: 64 -> 17\n"), "{printed}");
    assert!(printed.contains("warning: slave 0: its device profile was measured on"), "{printed}");
    let text = "[[gateway]]\nn = 3\ndevice_profile = \"/etc/hostname\"\n";
    let error = request(&served.client(), text).unwrap_err();
    assert!(error.message.contains("it was not passed"), "{error}");
}

#[test]
fn faulty_file_returns_every_fault_and_changes_nothing() {
    let served = served(ONE);
    let client = served.client();
    let error = request(&client, "cycle_us = 5\n[[gateway]]\nn = 99\n").unwrap_err();
    assert_eq!(error.code, INVALID_PARAMS);
    assert!(error.message.ends_with("nothing was changed"), "{error}");
    let lines: Vec<_> =
        error.data["faults"].as_array().unwrap().iter().map(|fault| &fault["line"]).collect();
    assert!(lines.contains(&&json!(1)) && lines.contains(&&json!(3)), "{error:?}");
    for (text, reason) in [
        ("[[gateway]]\nposition = 7\nn = 3\ncan0 = { bitrate = 500_000 }\n", "no slave at alias 0"),
        (&format!("master = 3\n{ONE}"), "this service holds master 0"),
        ("", "no slave is configured"),
    ] {
        let error = request(&client, text).unwrap_err();
        assert!(error.message.contains(reason), "{error}");
        assert_eq!(error.code, INVALID_PARAMS);
    }
    let error = client.call("reconfigure", json!({ "text": ONE, "file": "x" })).unwrap_err();
    assert!(error.to_string().contains("invalid parameters of reconfigure"), "{error}");
    let message = served.fails(2, &["config", "apply", &served.file(OTHER), "--steps"]);
    assert!(message.contains("--steps and --slave are not used here"), "{message}");
    assert_eq!(active_n(&client), 3);
    exchange(&client, 0);
    served.end();
}

#[test]
fn file_that_fails_on_the_gateway_is_replaced_by_the_former() {
    let mut served = served(ONE);
    let client = served.client();
    let fault = json!({ "kind": "sdo_abort", "gateway": 0, "index": 0x8002, "subindex": 19,
                        "code": 0x0609_0030, "times": 100 });
    client.call("sim.fault", fault).unwrap();
    let message = served.fails(5, &["config", "apply", &served.file(OTHER)]);
    assert!(message.contains("0x8002:19") && message.contains("0x06090030"), "{message}");
    assert!(message.ends_with("the former configuration is active again"), "{message}");
    served.program.wait_for_error("new.toml: failed: ");
    assert_eq!(active_n(&client), 3);
    exchange(&client, 0);
    let error = request(&client, OTHER).unwrap_err();
    assert_eq!(error.code, BUS_ERROR);
    assert_eq!(error.data, json!({ "kind": "reconfiguration", "is_restored": true }));
    served.end();
}

#[test]
fn file_replaces_one_whose_gateway_is_missing() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("cell.toml");
    std::fs::write(&file, ONE.replace("n = 3", "position = 7\nn = 3")).unwrap();
    let mut served = serve(&["--config", file.to_str().unwrap()]);
    served.program.wait_for_error("no slave at alias 0, position 7; the bus has 1 slaves; next");
    let printed = served.good(&["config", "apply", &served.file(OTHER)]);
    assert!(printed.starts_with("slave 0: configured"), "{printed}");
    exchange(&served.client(), 1);
    served.end();
}

#[test]
fn concurrent_requests_are_rejected_or_executed() {
    let served = served(ONE);
    let results = std::thread::scope(|scope| {
        let start = |text| {
            let client = served.client();
            scope.spawn(move || request(&client, text))
        };
        let threads = [ONE, OTHER, ONE, OTHER].map(start);
        threads.map(|thread| thread.join().unwrap())
    });
    assert!(results.iter().any(Result::is_ok), "{results:?}");
    for error in results.iter().filter_map(|result| result.as_ref().err()) {
        assert_eq!(error.code, BUSY, "{error}");
    }
    request(&served.client(), OTHER).unwrap();
    served.end();
}

#[test]
fn read_only_service_rejects_a_file() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("cell.toml");
    std::fs::write(&file, ONE).unwrap();
    let served = serve(&["--read-only", "--config", file.to_str().unwrap()]);
    assert_has(
        &served.fails(3, &["config", "apply", file.to_str().unwrap()]),
        "reconfigure is not permitted: the service is read-only",
    );
    served.end();
}

#[test]
fn dump_continues_unless_its_channels_change() {
    let served = served(ONE);
    let mut dump = Running::start(&["--via", &served.path, "dump"]);
    let file = served.file(&format!("{ONE}hold_limit = 20\n"));
    let client = served.client();
    // Until it has subscribed.
    let has_subscribed = |_: &_| {
        exchange(&client, 0);
        let stats = client.service_stats().unwrap();
        stats
            .clients
            .iter()
            .any(|client| client.pid != std::process::id() && client.frames_delivered > 0)
    };
    assert!((0..1000).any(|answer| has_subscribed(&answer)), "no frame for the dump");
    served.good(&["config", "apply", &file]);
    exchange(&client, 0);
    dump.wait_for_error("has configured the bus again, with the same channels");
    served.good(&["config", "apply", &served.file(OTHER)]);
    assert_has(&dump.ends(3), "with other channels; start again");
    assert!(Path::new(&served.path).exists());
    served.end();
}
