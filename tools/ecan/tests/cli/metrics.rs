//! Metrics of `ecan serve`, read by programs of others: `promtool`, Prometheus and its Python client.

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::serve::{Served, serve};
use crate::support::python::{python_with, skip};
use crate::support::{fails, json_of};
use ecan_test_support::Killed;

const PATIENCE: Duration = Duration::from_secs(300);
const DASHBOARD: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/grafana/ecan-lite.json");

/// A service whose gateway is ready, and the address of its metrics.
fn served() -> (Served, String) {
    let mut served = serve(&["--metrics", "127.0.0.1:0"]);
    served.program.wait_for_error("slave 0: ready");
    let errors = served.program.errors();
    let address = errors.lines().find_map(|line| line.split("http://").nth(1)).unwrap();
    let address = address.strip_suffix("/metrics").unwrap().to_owned();
    (served, address)
}

/// Body of the response to a GET.
fn get(address: &str, path: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).ok()?;
    let mut response = String::new();
    stream.read_to_string(&mut response).ok()?;
    Some(response.split_once("\r\n\r\n")?.1.to_owned())
}

fn has(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok();
    if !found {
        skip(&format!("no {program}; Debian package prometheus"));
    }
    found
}

/// Queries of the panels, each for all values of the variables.
fn queries() -> Vec<String> {
    let dashboard = json_of(&fs::read_to_string(DASHBOARD).unwrap());
    let panels = dashboard["panels"].as_array().unwrap().iter();
    let targets = panels.filter_map(|panel| panel["targets"].as_array()).flatten();
    targets
        .map(|target| target["expr"].as_str().unwrap())
        .map(|query| query.replace("$instance", ".*").replace("$__rate_interval", "5s"))
        .collect()
}

#[test]
fn promtool_accepts_metrics_and_queries() {
    if !has("promtool") {
        return;
    }
    let (served, address) = served();
    let mut command = Command::new("promtool");
    command.args(["check", "metrics"]).stdin(Stdio::piped());
    let mut check = Killed::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    let text = get(&address, "/metrics").unwrap();
    check.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    let output = check.output();
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && messages.is_empty(), "{messages}");
    // As rules, the queries are parsed.
    let rules = queries().iter().enumerate().fold(
        String::from("groups:\n- name: dashboard\n  rules:\n"),
        |text, (number, query)| {
            let query = serde_json::to_string(query).unwrap();
            format!("{text}  - record: query:{number}\n    expr: {query}\n")
        },
    );
    let path = served.path_of("rules.yml");
    fs::write(&path, rules).unwrap();
    let output = Command::new("promtool").args(["check", "rules", &path]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    served.end();
}

/// A Prometheus that scrapes one address every second.
struct Prometheus {
    _process: Killed,
    address: String,
}

impl Prometheus {
    fn start(directory: &Path, target: &str) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let address = format!("127.0.0.1:{port}");
        let config = directory.join("prometheus.yml");
        let text = format!(
            "scrape_configs:\n- job_name: ecan\n  scrape_interval: 1s\n  static_configs:\n  - targets: \
             [\"{target}\"]\n"
        );
        fs::write(&config, text).unwrap();
        let mut command = Command::new("prometheus");
        command
            .arg(format!("--config.file={}", config.display()))
            .arg(format!("--storage.tsdb.path={}", directory.join("data").display()))
            .arg(format!("--web.listen-address={address}"))
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Self { _process: Killed::spawn(&mut command), address }
    }

    /// Results of a query so far.
    fn query(&self, query: &str) -> Vec<Value> {
        let encoded: String = query.bytes().map(|byte| format!("%{byte:02X}")).collect();
        let answer = get(&self.address, &format!("/api/v1/query?query={encoded}"));
        // Large answers are chunked: from the first to the last brace.
        let answer = answer.unwrap_or_default();
        let json = answer.find('{').zip(answer.rfind('}')).and_then(|(a, b)| answer.get(a..=b));
        let answer: Value =
            json.and_then(|json| serde_json::from_str(json).ok()).unwrap_or_default();
        assert_ne!(answer["status"], "error", "{query}: {answer}");
        answer["data"]["result"].as_array().cloned().unwrap_or_default()
    }

    fn wait_for(&self, query: &str) -> Vec<Value> {
        let end = Instant::now() + PATIENCE;
        loop {
            let result = self.query(query);
            if !result.is_empty() {
                return result;
            }
            assert!(Instant::now() < end, "no result of {query}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

#[test]
fn prometheus_scrapes_and_answers_the_dashboard() {
    if !has("prometheus") {
        return;
    }
    let (served, address) = served();
    let prometheus = Prometheus::start(served.directory.path(), &address);
    let growing = prometheus.wait_for("rate(ecan_cycles_total[5s]) > 0");
    assert_eq!(growing[0]["metric"]["instance"], address.as_str());
    let ready = prometheus.wait_for("ecan_slave_ready == 1");
    assert_eq!(ready[0]["metric"]["slave"], "0");
    // Those about axes and clients have no result here.
    let answered = queries().iter().filter(|query| !prometheus.query(query).is_empty()).count();
    assert!(answered > 10, "{answered}");
    served.end();
}

#[test]
fn python_client_parses_the_metrics() {
    let Some(python) = python_with(&["prometheus_client"], "package prometheus_client") else {
        return;
    };
    let (served, address) = served();
    let path = served.path_of("metrics.txt");
    fs::write(&path, get(&address, "/metrics").unwrap()).unwrap();
    let script = "\
import sys
from prometheus_client.parser import text_string_to_metric_families
families = {it.name: it for it in text_string_to_metric_families(open(sys.argv[1]).read())}
assert all(it.documentation and it.type != 'unknown' for it in families.values())
ready = families['ecan_slave_ready'].samples
print(len(families), ready[0].labels, float(ready[0].value), families['ecan_cycle_run_time_seconds'].type)
";
    let output = Command::new(python).args(["-c", script, &path]).output().unwrap();
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (count, rest) = printed.split_once(' ').unwrap();
    assert!(count.parse::<usize>().unwrap() > 40, "{printed}");
    assert_eq!(rest.trim(), "{'slave': '0'} 1.0 histogram");
    served.end();
}

#[test]
fn metrics_for_other_hosts_and_wrong_addresses_are_rejected() {
    let start = |options: &[&str]| {
        fails(
            2,
            &[&["--ecrt", "sim", "serve", "--idle", "--socket", "/tmp/ecan-none"], options]
                .concat(),
        )
    };
    let error = start(&["--metrics", "0.0.0.0:0"]);
    assert!(error.contains("0.0.0.0:0 is not a loopback address; allowed: 127.0.0.1"), "{error}");
    let error = start(&["--metrics", "localhost:9464"]);
    assert!(error.contains("metrics address \"localhost:9464\" is not valid; allowed"), "{error}");
    let served = serve(&["--idle", "--metrics", "0.0.0.0:0", "--metrics-remote"]);
    served.end();
}
