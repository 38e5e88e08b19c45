//! Metrics as a scraper reads them.

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use ecan_mcan_port::SlaveStatistics;
use ecan_service::client::Subscription;
use ecan_service::server::{MetricsAddress, MetricsConfig, Service, ServiceConfig, ServiceError};
use serde_json::json;

use crate::server::common::{Fixture, PATIENCE, exists, frame, next, wait_for};

const GET: &str = "GET /metrics HTTP/1.1\r\nHost: test\r\n\r\n";

fn at(address: &str) -> MetricsConfig {
    MetricsConfig::new(address.parse().unwrap())
}

fn served() -> Fixture {
    Fixture::start(|config| config.metrics = Some(at("127.0.0.1:0")))
}

fn address(fixture: &Fixture) -> SocketAddr {
    let address = fixture.execute(|_, service: &Service| service.metrics_address().cloned());
    let Some(MetricsAddress::Tcp(address)) = address else { panic!("{address:?}") };
    address
}

/// Status line and body of a response.
fn response(mut stream: impl std::io::Read + std::io::Write, request: &str) -> (String, String) {
    stream.write_all(request.as_bytes()).unwrap();
    let mut response = String::new();
    stream.read_to_string(&mut response).unwrap();
    let (head, body) = response.split_once("\r\n\r\n").unwrap();
    let length = head.lines().find_map(|line| line.strip_prefix("Content-Length: ")).unwrap();
    assert!(body.is_empty() || body.len() == length.parse::<usize>().unwrap(), "{head}");
    (head.lines().next().unwrap().to_owned(), body.to_owned())
}

fn request(fixture: &Fixture, request: &str) -> (String, String) {
    let stream = TcpStream::connect(address(fixture)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    response(stream, request)
}

/// Values by name with labels.
fn scrape(fixture: &Fixture) -> BTreeMap<String, f64> {
    let (status, body) = request(fixture, GET);
    assert_eq!(status, "HTTP/1.1 200 OK", "{body}");
    let lines = body.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let (name, value) = line.rsplit_once(' ').unwrap();
            (name.to_owned(), value.parse().unwrap())
        })
        .collect()
}

#[test]
fn metrics_are_those_of_port_and_service() {
    let fixture = served();
    let client = fixture.client();
    client.subscribe(&Subscription::default()).unwrap();
    for number in 0..5 {
        client.send(0, 0, &frame(0x120 + number, &[1, 2])).unwrap();
    }
    // The frames and their echoes.
    for _ in 0..10 {
        next(&client);
    }
    wait_for("the counters", || {
        scrape(&fixture)["ecan_channel_results_ok_total{slave=\"0\",channel=\"0\"}"] >= 5.0
    });
    let values = scrape(&fixture);
    let SlaveStatistics { sessions, channels, .. } = fixture.statistics();
    let of_channel = |name: &str| values[&format!("{name}{{slave=\"0\",channel=\"0\"}}")];
    assert_eq!(
        of_channel("ecan_channel_frames_accepted_total"),
        channels[0].frames_accepted as f64
    );
    assert_eq!(
        of_channel("ecan_channel_frames_received_total"),
        channels[0].frames_received as f64
    );
    assert_eq!((channels[0].frames_accepted, channels[0].frames_received), (5, 5));
    assert_eq!(values["ecan_slave_sessions_total{slave=\"0\"}"], sessions as f64);
    assert_eq!(values["ecan_slave_ready{slave=\"0\"}"], 1.0);
    assert_eq!(values["ecan_slave_session_state{slave=\"0\",state=\"ready\"}"], 1.0);
    assert_eq!(values["ecan_slave_session_state{slave=\"0\",state=\"failed\"}"], 0.0);
    assert_eq!(values["ecan_channel_state{slave=\"0\",channel=\"1\",state=\"run\"}"], 1.0);
    assert!(!values.keys().any(|name| name.contains("channel=\"2\"")), "not enabled");
    assert_eq!(values["ecan_cycle_period_seconds"], 0.001);
    assert_eq!(values["ecan_bus_slaves_responding"], 1.0);
    // The master reads the AL states in intervals of its own.
    wait_for("the AL state", || scrape(&fixture)["ecan_bus_al_state{state=\"op\"}"] == 1.0);
    // The fixture and this test.
    assert!(values["ecan_service_clients"] >= 1.0);
    let working_counter = values["ecan_slave_wkc_expected{slave=\"0\"}"];
    assert_eq!(working_counter, 3.0);
    let samples = values["ecan_cycle_run_time_seconds_count"];
    assert_eq!(values["ecan_cycle_run_time_seconds_bucket{le=\"+Inf\"}"], samples);
    assert!(samples > 0.0 && values["ecan_cycle_run_time_seconds_sum"] > 0.0);
    let before = values["ecan_cycles_total"];
    assert!(scrape(&fixture)["ecan_cycles_total"] > before);
}

#[test]
fn error_counters_of_the_gateway_are_read_if_configured() {
    let fixture = Fixture::start(|config| {
        let object_interval = Some(Duration::from_millis(20));
        config.metrics = Some(MetricsConfig { object_interval, ..at("127.0.0.1:0") });
    });
    let has = |name: &str, value: f64| {
        let name = format!("{name}{{slave=\"0\",channel=\"0\"}}");
        wait_for(&name, || scrape(&fixture).get(&name) == Some(&value));
    };
    has("ecan_channel_device_transmit_errors", 0.0);
    has("ecan_channel_device_bus_off_total", 0.0);
    let fault = json!({ "kind": "bus_off", "gateway": 0, "channel": 0 });
    fixture.simulation.execute(&serde_json::from_value(fault).unwrap()).unwrap();
    has("ecan_channel_device_bus_off_total", 1.0);
    assert!(!request(&served(), GET).1.contains("ecan_channel_device"), "not by default");
}

#[test]
fn metrics_without_a_cycle_have_no_slaves() {
    let fixture = served();
    assert_eq!(scrape(&fixture)["ecan_cycle_active"], 1.0);
    fixture.execute(|_, service| service.detach());
    let values = scrape(&fixture);
    assert_eq!(values["ecan_cycle_active"], 0.0);
    assert!(!values.keys().any(|name| name.contains("slave=")), "{values:?}");
    fixture.execute(|port, service| service.attach(port));
    wait_for("the slave", || scrape(&fixture).contains_key("ecan_slave_ready{slave=\"0\"}"));
}

#[test]
fn other_requests_are_rejected_and_silent_clients_are_closed() {
    let fixture = served();
    let status = |text: &str| request(&fixture, text).0;
    assert_eq!(status("GET / HTTP/1.1\r\n\r\n"), "HTTP/1.1 404 Not Found");
    assert_eq!(status("DELETE /metrics HTTP/1.1\r\n\r\n"), "HTTP/1.1 405 Method Not Allowed");
    assert_eq!(status("what\r\n\r\n"), "HTTP/1.1 400 Bad Request");
    let long = format!("GET /metrics HTTP/1.1\r\nA: {}", "x".repeat(9000));
    assert_eq!(status(&long), "HTTP/1.1 431 Request Header Fields Too Large");
    assert_eq!(request(&fixture, &GET.replace("GET", "HEAD")).1, "");
    let mut silent = TcpStream::connect(address(&fixture)).unwrap();
    silent.write_all(b"GET /metr").unwrap();
    let start = Instant::now();
    assert!(scrape(&fixture).contains_key("ecan_cycles_total"), "after the time of the silent one");
    assert!(start.elapsed() < PATIENCE);
    silent.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(silent.read(&mut [0]).unwrap(), 0, "closed");
}

#[test]
fn unix_socket_serves_metrics_and_is_removed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("metrics.sock");
    let metrics = at(&format!("unix:{}", path.display()));
    let mut fixture = Fixture::start(|config| config.metrics = Some(metrics));
    let (status, body) = response(UnixStream::connect(&path).unwrap(), GET);
    assert_eq!(status, "HTTP/1.1 200 OK");
    assert!(body.contains("\necan_cycle_active 1\n"), "{body}");
    fixture.stop();
    assert!(!exists(&path));
}

#[test]
fn address_for_other_hosts_needs_permission() {
    let directory = tempfile::tempdir().unwrap();
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &ecan_sim::SimOptions::default());
    let ecrt = backend.unwrap().ecrt;
    let start = |metrics: MetricsConfig| {
        let config = ServiceConfig::new(directory.path().join("a.sock")).with_metrics(metrics);
        Service::of_bus(&ecrt, 0, config)
    };
    let error = start(at("0.0.0.0:0")).unwrap_err();
    assert!(matches!(error, ServiceError::RemoteMetrics(_)), "{error}");
    assert!(error.to_string().contains("is not a loopback address; allowed"), "{error}");
    let first = start(MetricsConfig { allows_remote: true, ..at("0.0.0.0:0") }).unwrap();
    let Some(MetricsAddress::Tcp(used)) = first.metrics_address() else { panic!("no address") };
    let config = ServiceConfig::new(directory.path().join("b.sock"));
    let metrics = MetricsConfig { allows_remote: true, ..at(&used.to_string()) };
    let error = Service::of_bus(&ecrt, 0, config.with_metrics(metrics)).unwrap_err();
    assert!(matches!(error, ServiceError::MetricsAddress { .. }), "{error}");
}
