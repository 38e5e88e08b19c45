//! `ecan monitor` through a service.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::AxisConfig;
use ecan_mcan_port::Cycle;
use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::Client;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::serve::{Served, serve_ready};
use crate::support::application::Application;
use crate::support::on_screen::OnScreen;
use crate::support::{Running, assert_has, ecan, ends, fails, good, json_of, wait_for};

/// Sends a frame every 5 cycles, whose second byte counts.
fn count() -> impl FnMut(&mut Cycle<'_>) + Send {
    let mut number = 0_u64;
    move |cycle| {
        number += 1;
        if number.is_multiple_of(5) {
            let data = [0xA0, (number / 5) as u8];
            let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &data).unwrap();
            let channel = cycle.channel(0, 1).unwrap();
            let _ = cycle.send(channel, &frame);
        }
    }
}

#[test]
fn views_are_printed_through_a_service() {
    let application = Application::start(count());
    let path = application.path();
    let monitor = |options: &[&str]| good(&[&["--via", &path, "monitor"], options].concat());
    let shown = monitor(&["--once"]);
    let lines: Vec<_> = shown.lines().collect();
    assert_eq!(lines[1].split_whitespace().collect::<Vec<_>>()[..3], ["0", "ready", "3/3"]);
    assert!(lines[5].starts_with("can0     run "), "{shown}");
    assert!(shown.contains("cycle 5000 us, sampled since the start of the service, no periods: "));
    assert!(!shown.contains("period "), "{shown}");
    assert!(shown.contains("\nclients of cell 1.0 (pid "), "{shown}");
    let client = lines.iter().find(|line| line.starts_with("ecan monitor")).unwrap();
    assert_eq!(client.split_whitespace().nth(3), Some("control"), "{client}");

    let snapshot = json_of(&monitor(&["--json", "--for", "2s"]));
    assert!(snapshot["program"].as_str().unwrap().starts_with("cell 1.0"));
    assert_eq!(snapshot["cycle"]["period"], Value::Null);
    assert_eq!(snapshot["cycle"]["run_time"]["p95_us"], Value::Null);
    assert!(snapshot["cycle"]["run_time"]["p50_us"].as_f64().unwrap() > 0.0);
    let channel = &snapshot["gateways"][0]["channels"][1];
    assert!(channel["received"].as_u64().unwrap() > 0, "{channel}");
    assert!(channel["load"].as_f64().unwrap() > 0.0, "{channel}");
    assert_eq!(channel["errors"]["bus_offs"], 0);

    let axes = monitor(&["--view", "axes", "--for", "0.1s"]);
    assert!(axes.starts_with("no axes: cell 1.0 (pid "), "{axes}");
}

#[test]
fn ids_have_directions_periods_and_changed_bytes() {
    let application = Application::start(count());
    let path = application.path();
    let arguments = ["--via", &path, "monitor", "--view", "ids", "--for", "1s"];
    let report = json_of(&good(&[&arguments[..], &["--json"]].concat()));
    assert_eq!((&report["frames_lost"], &report["not_listed"]), (&json!(0), &json!(0)));
    let rows = report["ids"].as_array().unwrap();
    let directions: Vec<_> = rows.iter().map(|row| row["direction"].as_str().unwrap()).collect();
    assert_eq!(directions, ["received", "sent"]);
    for row in rows {
        assert_eq!((&row["gateway"], &row["channel"]), (&json!(0), &json!(1)));
        assert_eq!(
            (&row["id"], &row["kind"], &row["dlc"]),
            (&json!(0x123), &json!("data"), &json!(2))
        );
        assert!(row["data"].as_str().unwrap().starts_with("A0"), "{row}");
        // Only the second byte counts; on a busy computer not within the last second.
        assert!([json!([1]), json!([])].contains(&row["changed"]), "{row}");
        assert!(row["count"].as_u64().unwrap() > 2, "{row}");
    }
    // Every 5 cycles; a busy computer may skip some.
    assert!(rows[1]["mean_period_ns"].as_u64().unwrap() >= 24_000_000, "{}", rows[1]);

    let text = good(&arguments);
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("CAN IDs, all channels: 2 rows by CAN ID"));
    let rows: Vec<Vec<_>> = lines.skip(1).map(|line| line.split_whitespace().collect()).collect();
    assert_eq!((rows.len(), &rows[1][..3]), (2, &["0.1", "tx", "123"][..]), "{text}");
    assert_eq!((rows[1][6], rows[1][8], rows[1][9]), ("2", "1", "A0"), "{text}");
    let text = good(&[&arguments[..], &["--channel", "0", "--sort", "count"]].concat());
    assert_eq!(text.lines().next(), Some("CAN IDs, channel 0: 0 rows by count"));
}

/// Standard output; axes may have stopped on a busy computer, which is a finding.
fn with_any_health(arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(matches!(output.status.code(), Some(0 | 1)), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn axes_are_printed_with_their_state() {
    let address = |id| NodeAddress { slave: 0, channel: 0, node: NodeId::new(id).unwrap() };
    let axes = [1, 2].map(|id| AxisConfig::new(address(id)));
    let application = Application::start_axes(axes.to_vec());
    let path = application.path();
    let arguments = ["--via", &path, "monitor", "--view", "axes", "--for", "0.3s"];
    let text = with_any_health(&arguments);
    let rows: Vec<_> = text.lines().collect();
    assert_eq!(rows.len(), 3, "{text}");
    assert!(rows[0].starts_with("bus  node  phase"), "{text}");
    for (row, (node, position)) in rows[1..].iter().zip([("1", "1007"), ("2", "2007")]) {
        assert_eq!(row.split_whitespace().take(2).collect::<Vec<_>>(), ["0.0", node], "{text}");
        assert!(row.contains("  CSP   ") && row.contains(position), "{text}");
    }
    let report = json_of(&with_any_health(&[&arguments[..], &["--json"]].concat()));
    let axis = &report["axes"][1];
    assert_eq!((&axis["gateway"], &axis["node_id"]), (&json!(0), &json!(2)));
    assert_eq!((&axis["actual"], &axis["mode"]), (&json!(2007), &json!("CSP")));
    assert_eq!(report["without_axes"], Value::Null);

    let mut monitor = OnScreen::start((80, 24), &["--via", &path, "monitor", "--view", "axes"]);
    monitor.wait_for("Axes: 2");
    monitor.press(b"\x1b[B");
    monitor.wait_for("gateway 0 can0 node 2, for");
    monitor.wait_for("(statusword 0x");
    monitor.wait_for("actual 2007 steps");
    monitor.quit();
}

#[test]
fn without_service_the_axes_view_has_the_reason() {
    let shown = good(&["--ecrt", "sim", "monitor", "--view", "axes", "--for", "0.1s"]);
    assert_eq!(
        shown,
        "no axes: this command runs the cycle itself and configures no drives; use --via with the \
         service of the application that moves the axes\n"
    );
}

/// The monitor of a ready gateway.
fn monitor(daemon: &Served) -> OnScreen {
    let mut monitor = OnScreen::start((80, 24), &["--via", &daemon.path, "monitor"]);
    monitor.wait_for("ready      2/2");
    monitor
}

#[test]
fn ended_service_is_waited_for() {
    let mut daemon = serve_ready();
    let mut monitor = monitor(&daemon);
    assert!(monitor.is_raw() && monitor.screen().contains("via ecan serve"));
    daemon.program.end();
    monitor.wait_for("NO SERVICE");
    let mut next = Running::start(&["--ecrt", "sim", "serve", "--socket", &daemon.path]);
    next.wait_for_error("slave 0: ready");
    monitor.wait_until("service", |terminal| !terminal.screen().contains("NO SERVICE"));
    monitor.wait_for("the service is there again");
    monitor.wait_for("ready      2/2");
    next.end();
    monitor.wait_for("NO SERVICE");
    monitor.quit();
}

#[test]
fn stopped_service_is_shown_until_it_continues() {
    let daemon = serve_ready();
    let mut monitor = monitor(&daemon);
    daemon.program.signal(Signal::STOP);
    monitor.wait_for("NO RESPONSE");
    daemon.program.signal(Signal::CONT);
    monitor.wait_until("answers", |terminal| !terminal.screen().contains("NO RESPONSE"));
    daemon.program.signal(Signal::STOP);
    monitor.wait_for("NO RESPONSE");
    monitor.quit();
    daemon.program.signal(Signal::CONT);
}

#[test]
fn lost_gateway_is_shown_through_a_service() {
    let daemon = serve_ready();
    let mut monitor = monitor(&daemon);
    let client = daemon.client();
    client.call("sim.fault", json!({ "kind": "power_off", "gateway": 0 })).unwrap();
    monitor.wait_for("LOST");
    monitor.wait_for("gateway 0: lost");
    let arguments = ["--via", &daemon.path, "monitor", "--for", "0.2s"];
    assert!(ends(1, &arguments).contains("LOST"));
    client.call("sim.fault", json!({ "kind": "power_on", "gateway": 0 })).unwrap();
    monitor.wait_for("gateway 0: ready after");
    monitor.quit();
}

#[test]
fn service_configured_again_is_followed() {
    let application = Application::start(count());
    let path = application.path();
    let mut monitor = OnScreen::start((80, 24), &["--via", &path, "monitor"]);
    monitor.wait_for("ready      3/3");
    application.execute(|_, service| service.detach());
    monitor.wait_for("NO CYCLE");
    application.execute(|port, service| service.attach(port));
    monitor.wait_until("cycle", |terminal| !terminal.screen().contains("NO CYCLE"));
    monitor.wait_for("configured the bus again");
    monitor.press(b"2");
    monitor.wait_for("0.1  tx  123");
    monitor.quit();
}

/// Frames in the rows of the CAN IDs, and those that the title counts as lost.
fn accounted(screen: &str) -> u64 {
    let is_row = |line: &&str| line.starts_with("│0.");
    let count = |line: &str| line.split_whitespace().nth(3)?.parse::<u64>().ok();
    let listed: u64 = screen.lines().filter(is_row).filter_map(count).sum();
    let title = screen.lines().next().unwrap_or_default();
    let words = title.split(" frames lost here").next().unwrap_or_default();
    let lost = words.split_whitespace().last().and_then(|word| word.parse::<u64>().ok());
    listed + lost.unwrap_or(0)
}

#[test]
fn slow_terminal_loses_counted_frames() {
    let frame = CanFrame::classic(CanId::standard(0x7FF).unwrap(), &[0; 8]).unwrap();
    let is_sending = Arc::new(AtomicBool::new(true));
    let is_active = is_sending.clone();
    let application = Application::start(move |cycle| {
        for channel in 0..4 {
            let channel = cycle.channel(0, channel).unwrap();
            for _ in 0..if is_active.load(Ordering::Relaxed) { 20 } else { 0 } {
                let _ = cycle.send(channel, &frame);
            }
        }
    });
    let path = application.path();
    let mut monitor = OnScreen::start((100, 40), &["--via", &path, "monitor", "--view", "ids"]);
    monitor.wait_for("0.3  tx  7FF");
    // Not read from here on.
    monitor.fill();
    let client = Client::connect(Path::new(&path), "test").unwrap();
    let selected = || {
        let stats = client.service_stats().unwrap();
        let monitor = stats.clients.iter().find(|client| client.name == "ecan monitor").unwrap();
        monitor.frames_delivered + monitor.frames_lost
    };
    // More than its memory holds.
    let begin = selected();
    wait_for("the frames", || selected() >= begin + 60_000);
    is_sending.store(false, Ordering::Relaxed);
    let cycle = || client.state().unwrap().cycle.cycle;
    let end = cycle() + 200;
    wait_for("the cycles", || cycle() >= end);
    // Drawn again, over what filled the terminal.
    monitor.resize((100, 30));
    monitor.wait_for("frames lost here");
    monitor.wait_until("every frame", |monitor| accounted(&monitor.screen()) == selected());
    monitor.quit();
}

#[test]
fn ids_beyond_the_screen_are_reached_by_keys() {
    let mut number = 0;
    let application = Application::start(move |cycle| {
        number = (number + 1) % 60;
        let frame = CanFrame::classic(CanId::standard(0x100 + number).unwrap(), &[]).unwrap();
        let channel = cycle.channel(0, 2).unwrap();
        let _ = cycle.send(channel, &frame);
    });
    let mut monitor =
        OnScreen::start((80, 24), &["--via", &application.path(), "monitor", "--view", "ids"]);
    // On a busy computer some have a row for a late transmit result, too.
    let has_all = |screen: &str| {
        let title = screen.split_once("all channels: ").map_or("", |(_, title)| title);
        let rows = title.split(' ').next().and_then(|word| word.parse::<u32>().ok());
        rows.is_some_and(|rows| rows >= 120) && title.contains("rows by CAN ID")
    };
    monitor.wait_until("all CAN IDs", |terminal| has_all(&terminal.screen()));
    assert!(!monitor.screen().contains("tx  13B"));
    monitor.press(b"\x1b[F");
    monitor.wait_for("0.2  tx  13B");
    monitor.wait_for(" 13B, classic, 0 bytes");
    monitor.press(b"s");
    monitor.wait_for("rows by count");
    monitor.press(b"\x1b[C");
    monitor.wait_for("CAN IDs, channel 0: 0 rows");
    monitor.quit();
}

#[test]
fn invalid_use_of_a_service_has_message_and_status() {
    let application = Application::start(|_| {});
    let path = application.path();
    let cases: [(i32, &[&str], &str); 5] = [
        (2, &["--bitrate", "250000"], "1000000 bit/s"),
        (2, &["--listen-only"], "acknowledges frames"),
        (6, &["--config", "/none.toml"], "/none.toml"),
        (2, &["--view", "all"], "overview, ids, axes"),
        (2, &["--sort", "name"], "id, count, period, age"),
    ];
    for (status, options, words) in cases {
        let message = fails(status, &[&["--via", &path, "monitor", "--once"], options].concat());
        assert!(message.contains(words), "{options:?}: {message}");
    }
    application.execute(|_, service| service.detach());
    let client = Client::connect(Path::new(&path), "test").unwrap();
    wait_for("the end of the cycle", || client.state().is_err());
    assert_has(&fails(3, &["--via", &path, "monitor"]), "the service has no cycle");
}
