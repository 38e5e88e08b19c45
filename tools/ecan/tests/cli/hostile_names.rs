//! Names of devices, programs and files with control characters: none reaches the terminal, and JSON
//! keeps the name.

use std::io::{Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::Output;

use serde_json::{Value, json};

use crate::support::application::Application;
use crate::support::{Scenario, ecan};

/// Clears the screen, sets a colour by C1, reverses the text, rings, and forges a line.
const HOSTILE: &str = "a\x1b[2Jb\u{9b}31mc\u{202e}d\x07\x1b]0;x\x07\rslave 9: forged";
/// As [`HOSTILE`], with a line break.
const TWO_LINES: &str = "a\x1b[2Jb\u{9b}31mc\u{202e}d\x07\rx\nslave 9: forged";

/// Asserts that the output has no control character but line breaks, and no forged line.
fn assert_clean(what: &str, bytes: &[u8]) {
    let text = std::str::from_utf8(bytes).unwrap();
    let is_unsafe = |c: char| {
        (c.is_control() && c != '\n')
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    assert!(!text.contains(is_unsafe), "{what}: {text:?}");
    assert!(!text.lines().any(|line| line.starts_with("slave 9")), "{what}: {text}");
}

/// Runs the program; both streams must be clean, and at least one must have the escaped name.
fn run_clean(arguments: &[&str]) -> Output {
    let output = ecan(arguments);
    let what = format!("{arguments:?}");
    assert_clean(&what, &output.stdout);
    assert_clean(&what, &output.stderr);
    let both = [&output.stdout[..], &output.stderr].concat();
    let both = String::from_utf8(both).unwrap();
    assert!(["\\x1b[2J", "\\u001b[2J"].iter().any(|name| both.contains(name)), "{what}: {both}");
    output
}

fn drives() -> Scenario {
    Scenario::new("[[node]]\nkind = \"drive\"\nbus = \"0.0\"\nnode_id = 1\n")
}

#[test]
fn names_of_arguments_and_files_are_escaped() {
    let files = Scenario::new("");
    let two_lines = files.path(TWO_LINES);
    run_clean(&["--master", TWO_LINES, "scan"]);
    run_clean(&[HOSTILE]);
    run_clean(&["--json", HOSTILE]);
    run_clean(&["--via", &two_lines, "scan"]);
    run_clean(&["--ecrt", &format!("sim:{two_lines}"), "scan"]);
    run_clean(&["--ecrt", &format!("sim:{HOSTILE}"), "scan"]);
    run_clean(&["--ecrt", "sim", "replay", &two_lines]);
    run_clean(&["config", "check", &two_lines]);
    run_clean(&["--ecrt", "sim", "dump", "--dbc", &two_lines]);
    run_clean(&["--log", "trace", "--ecrt", &format!("sim:{two_lines}"), "scan"]);
}

#[test]
fn keys_and_names_of_configuration_and_scenario_are_escaped() {
    let quoted = serde_json::to_string(TWO_LINES).unwrap().replace('\u{9b}', "\\u009b");
    let files = Scenario::new("");
    let key = files.write("key.toml", &format!("{quoted} = 1\n"));
    run_clean(&["config", "check", &key]);
    run_clean(&["--ecrt", &format!("sim:{key}"), "scan"]);
    let named = files.write("named.toml", &format!("name = {quoted}\n[[gateway]]\n"));
    run_clean(&["--ecrt", &format!("sim:{named}"), "scan"]);
    let node = format!("[[gateway]]\n[[node]]\nkind = {quoted}\nbus = \"0.0\"\n");
    let node = files.write("node.toml", &node);
    run_clean(&["--ecrt", &format!("sim:{node}"), "scan"]);
}

#[test]
fn names_of_device_and_database_files_are_escaped() {
    let bus = Scenario::replaying(&[(0, "123#E8030100")], "");
    let dbc = format!(
        "BO_ 291 Engine: 4 ECU\n SG_ Speed : 0|16@1+ (0.1,0) [0|6553.5] \"{TWO_LINES}\" Tool\n"
    );
    let dbc = bus.write("cell.dbc", &dbc);
    let dump = ["--ecrt", &bus.setting(), "dump", "-n", "1", "--dbc", &dbc];
    run_or_reject(&dump);

    let bus = drives();
    let name = HOSTILE.replace(['\r', '\n'], " ");
    let eds = format!(
        "[FileInfo]\nFileName=demo.eds\n[DeviceInfo]\nVendorName={name}\n\
         [MandatoryObjects]\nSupportedObjects=1\n1=0x1000\n[1000]\nParameterName={name}\n\
         ObjectType=0x7\nDataType=0x7\nAccessType=ro\n"
    );
    let eds = bus.write("demo.eds", &eds);
    run_clean(&["--ecrt", &bus.setting(), "node", "sdo", "list", "--node", "1", "--eds", &eds]);
}

/// As [`run_clean`], for a file whose reader may replace the name.
fn run_or_reject(arguments: &[&str]) {
    let output = ecan(arguments);
    assert_clean(&format!("{arguments:?}"), &output.stdout);
    assert_clean(&format!("{arguments:?}"), &output.stderr);
}

#[test]
fn text_of_a_device_is_escaped_and_unchanged_in_json() {
    let service = HostileService::start();
    run_clean(&["--via", &service.path(), "scan"]);
    run_clean(&["--via", &service.path(), "info"]);
    let scan = run_clean(&["--json", "--via", &service.path(), "scan"]);
    let scan: Value = serde_json::from_slice(&scan.stdout).unwrap();
    assert_eq!(scan[0]["name"], TWO_LINES, "lossless");
    // With colours, only those of the program are printed.
    let colored = ecan(&["--color", "always", "--via", &service.path(), "scan"]);
    let text = String::from_utf8(colored.stdout).unwrap();
    let parts = text.split('\x1b').skip(1);
    let is_own =
        |part: &str| ["[33m", "[31m", "[2m", "[32m", "[0m"].iter().any(|own| part.starts_with(own));
    assert!(parts.clone().count() > 0 && parts.clone().all(is_own), "{text:?}");
}

#[test]
fn name_of_a_client_is_escaped_in_the_lists_of_clients() {
    let application = Application::start(|_| ());
    let path = application.path();
    let mut client = UnixStream::connect(&path).unwrap();
    let hello = json!({"jsonrpc": "2.0", "id": 1, "method": "hello",
        "params": {"version": 1, "client": HOSTILE}});
    client.write_all(&frame_of(&hello)).unwrap();
    // The service has the client after its response.
    client.read_exact(&mut [0; 8]).unwrap();
    run_or_reject(&["--via", &path, "monitor", "--once"]);
    run_or_reject(&["--via", &path, "--json", "monitor", "--once"]);
}

/// A service whose program and slave have hostile names; it answers until it is dropped.
struct HostileService {
    directory: tempfile::TempDir,
}

impl HostileService {
    fn start() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let listener = UnixListener::bind(directory.path().join("s")).unwrap();
        // The thread ends with the test program; it owns nothing but its sockets.
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                std::thread::spawn(move || while answer(&stream).is_some() {});
            }
        });
        Self { directory }
    }

    fn path(&self) -> String {
        self.directory.path().join("s").display().to_string()
    }
}

fn answer(mut stream: &UnixStream) -> Option<()> {
    let mut header = [0; 8];
    stream.read_exact(&mut header).ok()?;
    let mut payload = vec![0; u32::from_le_bytes(header[..4].try_into().unwrap()) as usize];
    stream.read_exact(&mut payload).ok()?;
    let request: Value = serde_json::from_slice(&payload).ok()?;
    let port = json!({"kind": "mii", "link_up": true, "loop_closed": false, "signal_detected": true,
        "receive_time_ns": 0, "next_slave": null, "delay_to_next_dc_ns": 0});
    let slave = json!({"position": 0, "vendor_id": 1, "product_code": 2, "revision_number": 3,
        "serial_number": 4, "alias": 0, "current_on_ebus_ma": 0, "al_state": 2, "error_flag": true,
        "sync_count": 4, "sdo_count": 0, "name": TWO_LINES, "ports": [port, port, port, port]});
    let result = match request["method"].as_str()? {
        "hello" => json!({"version": 1, "server": TWO_LINES, "server_version": TWO_LINES, "pid": 1,
            "master": 0, "is_simulated": true, "is_free_running": true, "access": "read",
            "access_reason": TWO_LINES, "cycle_ns": null, "window": 64, "gateways": []}),
        "bus.state" => json!({"slave_count": 1, "slaves_responding": 1, "al_states": 2,
            "link_up": true, "main_link_up": true, "scan_busy": false, "app_time_ns": 0}),
        "bus.slave" => slave,
        "bus.slaves" => json!([slave]),
        _ => Value::Null,
    };
    let response = match result {
        Value::Null => json!({"jsonrpc": "2.0", "id": request["id"],
            "error": {"code": -32603, "message": TWO_LINES}}),
        result => json!({"jsonrpc": "2.0", "id": request["id"], "result": result}),
    };
    stream.write_all(&frame_of(&response)).ok()
}

/// A JSON message with the header of the protocol.
fn frame_of(message: &Value) -> Vec<u8> {
    let payload = message.to_string().into_bytes();
    let mut frame = (payload.len() as u32).to_le_bytes().to_vec();
    frame.extend([1, 0, 0, 0]);
    frame.extend(payload);
    frame
}
