//! `ecan node` with Python's package `canopen`, on the bus of a simulated gateway by the simulator's
//! slcan bridge: its `LocalNode` as a node, and its network with its own DCF tools.

use std::io::Write as _;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::serve::{Served, serve_bus};
use crate::support::python::python_with;
use crate::support::{Scenario, assert_has, ecan, ends, fails, good};
use ecan_test_support::{Killed, Lines};

fn script(python: &str, name: &str, port: u16, node: u8) -> Command {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ecan-canopen/tests/python");
    let mut command = Command::new(python);
    command
        .arg("-B")
        .arg(Path::new(directory).join(name))
        .args(["--port", &port.to_string(), "--node", &node.to_string()])
        .stdin(Stdio::piped());
    command
}

/// Starts the node's program, which ends with its standard input.
fn start_peer(command: &mut Command) -> Killed {
    Killed::spawn(command.stdout(Stdio::piped()))
}

struct Bus {
    /// Ends before its bus.
    peer: Killed,
    lines: Lines,
    served: Served,
    _scenario: Scenario,
}

/// A bus with an slcan bridge, and these nodes.
fn bridged(nodes: &str) -> (Scenario, Served, u16) {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let bridge = format!("[[node]]\nkind = \"bridge\"\nbus = \"0.0\"\nport = {port}\n");
    let scenario = Scenario::new(&(bridge + nodes));
    let mut served = serve_bus(&scenario.setting(), &[]);
    served.program.wait_for_error("slave 0: ready");
    (scenario, served, port)
}

impl Bus {
    /// Starts service and node 5, and waits until the node answers.
    fn start(python: &str, name: &str, arguments: &[&str]) -> Self {
        let (scenario, served, port) = bridged("");
        let mut peer = start_peer(script(python, name, port, 5).args(arguments));
        let lines = peer.lines();
        let bus = Self { peer, lines, _scenario: scenario, served };
        // Each try waits for two seconds.
        let answers = |_: &u32| {
            let read = ["sdo", "read", "--node", "5", "--timeout", "1000", "0x1000"];
            ecan(&bus.arguments(&read)).status.success()
        };
        assert!((0..30).any(|number| answers(&number)), "the node does not answer");
        bus
    }

    fn arguments<'a>(&'a self, rest: &[&'a str]) -> Vec<&'a str> {
        [&["--via", self.served.path.as_str(), "node"], rest].concat()
    }

    fn node(&self, rest: &[&str]) -> String {
        good(&self.arguments(rest))
    }
}

#[test]
fn node_of_the_canopen_package_is_found_read_and_commanded() {
    let Some(python) = python_with(&["canopen", "can", "serial"], "canopen") else { return };
    let bus = Bus::start(&python, "local_node.py", &[]);
    let scan = bus.node(&["scan", "--channel", "0", "--nodes", "4-6", "--timeout", "5000"]);
    let found =
        "0      can0     5     -      0x50595448  0x00000003  0x00000007  99      A node made in";
    assert!(scan.contains(found), "{scan}");
    assert!(scan.contains("slave 0 can0: 1 node(s) at 500 kbit/s"), "{scan}");

    // Longer than a frame; the package has no block download.
    let bytes: Vec<String> = (0..100).map(|nth| format!("{nth:02X}")).collect();
    let write = ["sdo", "write", "--node", "5", "--timeout", "5000", "--type"];
    let sdo_write = |rest: &[&str]| bus.node(&[&write[..], rest].concat());
    let printed = sdo_write(&["bytes", "0x2002", &bytes.join(" ")]);
    assert_eq!(printed, format!("0x2002:00 = {}\n", bytes.join(" ")));
    assert_eq!(sdo_write(&["i16", "0x2001", "-300"]), "0x2001:00 = -300\n");
    let read = bus.arguments(&["sdo", "read", "--node", "5", "--timeout", "5000", "0x2003"]);
    assert!(fails(5, &read).contains("aborted by the node: 0x06010001"));

    sdo_write(&["u16", "0x1017", "100"]);
    for (command, state) in
        [("stop", "stopped"), ("preop", "pre-operational"), ("start", "operational")]
    {
        let nmt = ["nmt", command, "--node", "5", "--yes", "--timeout", "20000"];
        let expected = format!("node 5 on can0: {state}, by its heartbeat\n");
        assert_eq!(bus.node(&nmt), expected);
    }

    let emcy = ["node", "emcy", "--node", "5", "--watch", "-n", "1", "-T", "60000"];
    let mut watching = bus.served.run(&emcy);
    assert_eq!(watching.line(), "node 5 on can0, error register: no error");
    assert_eq!(watching.line(), "no error history (0x1003)");
    sdo_write(&["u16", "0x2010", "0x2310"]);
    let line = watching.line();
    let expected = "0x2310 continuous over-current at the output; error register: device profile; 01 02 03 04 05";
    assert!(line.ends_with(expected), "{line}");
}

const NETWORK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network");

/// Lines of the node until one that is `end`.
fn lines_of(bus: &mut Bus, dcf: &str) -> Vec<String> {
    writeln!(bus.peer.stdin.as_mut().unwrap(), "{dcf}").unwrap();
    let mut lines = Vec::new();
    while lines.last().is_none_or(|line| line != "end") {
        lines.push(bus.lines.next().unwrap_or_else(|| panic!("the node ended: {lines:#?}")));
    }
    lines.pop();
    lines
}

/// Objects with the bytes of a DCF, by the package, and of its node.
fn values_of(lines: &[String]) -> Vec<(&str, &str, &str)> {
    let values = lines.iter().filter_map(|line| line.strip_prefix("value "));
    let parts = values.map(|line| line.split(' ').collect::<Vec<_>>());
    parts.map(|words| (words[0], words[1], words[2])).collect()
}

#[test]
fn parameters_of_a_canopen_node_are_restored_as_its_tools_read_them() {
    let Some(python) = python_with(&["canopen", "can", "serial"], "canopen") else { return };
    let eds = format!("{NETWORK}/gripper.eds");
    let mut bus = Bus::start(&python, "dcf_node.py", &["--eds", &eds]);
    let of_node = ["--node", "5", "--eds", &eds];
    let write = |bus: &Bus, object: &str, value: &str| {
        bus.node(&[&["sdo", "write", "--timeout", "5000"], &of_node[..], &[object, value]].concat())
    };
    write(&bus, "grip force", "120");
    write(&bus, "label", "left hand, with a text of several segments");
    let dcf = bus.served.path_of("left.dcf");
    let saved = bus.node(&[&["params", "save", &dcf], &of_node[..]].concat());
    let count = std::fs::read_to_string(&dcf).unwrap().matches("ParameterValue=").count();
    assert!(saved.ends_with(&format!("left.dcf: {count} values of node 5 on can0\n")), "{saved}");

    let lines = lines_of(&mut bus, &dcf);
    let values = values_of(&lines);
    assert_eq!(values.len(), count, "the package reads every value");
    assert!(values.iter().all(|(_, file, node)| file == node), "{values:#?}");
    assert!(values.contains(&("2000:00", "7800", "7800")), "{values:#?}");

    write(&bus, "grip force", "33");
    write(&bus, "label", "right");
    let changed = lines_of(&mut bus, &dcf);
    let differs = |entry: &&(&str, &str, &str)| entry.1 != entry.2;
    let differences: Vec<_> =
        values_of(&changed).into_iter().filter(|entry| differs(&entry)).collect();
    assert_eq!(differences.iter().map(|entry| entry.0).collect::<Vec<_>>(), ["2000:00", "2002:00"]);
    let capture = bus.served.path_of("restore.pcapng");
    let restore = ["params", "restore", &dcf, "--node", "5", "--yes", "--capture", &capture];
    assert_has(&bus.node(&restore), " values verified\n");
    let lines = lines_of(&mut bus, &dcf);
    assert!(values_of(&lines).iter().all(|(_, file, node)| file == node), "{lines:#?}");

    // Every SDO frame in the log of the package is in the capture, in the same order.
    let frames: Vec<_> = lines.iter().filter_map(|line| line.strip_prefix("frame ")).collect();
    assert!(frames.len() > 100, "{} frames", frames.len());
    let mut capture = &std::fs::read(&capture).unwrap()[..];
    for frame in frames {
        let record = socketcan(frame);
        let at = capture.windows(record.len()).position(|bytes| bytes == record);
        let at = at.unwrap_or_else(|| panic!("{frame} is not in the capture, or in another order"));
        capture = &capture[at + record.len()..];
    }
}

/// A frame `ID#DATA` as SocketCAN has it in a capture.
fn socketcan(frame: &str) -> Vec<u8> {
    let (id, data) = frame.split_once('#').unwrap();
    let mut bytes = u32::from_str_radix(id, 16).unwrap().to_be_bytes().to_vec();
    bytes.extend([(data.len() / 2) as u8, 0, 0, 0]);
    bytes.extend(
        (0..data.len()).step_by(2).map(|at| u8::from_str_radix(&data[at..at + 2], 16).unwrap()),
    );
    bytes
}

#[test]
fn canopen_network_configures_a_drive_from_a_saved_dcf() {
    let Some(python) = python_with(&["canopen", "can", "serial"], "canopen") else { return };
    let eds = format!("{NETWORK}/servo_drive.eds");
    let (_scenario, served, port) = bridged(&format!(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 3\neds = \"{eds}\"\n"
    ));
    let of_node = ["--node", "3", "--eds", &eds];
    let write = |object: &str, value: &str| {
        served.node(&[&["sdo", "write"], &of_node[..], &[object, value]].concat());
    };
    write("following error window", "12345");
    write("0x6083", "777000");
    let dcf = served.path_of("x.dcf");
    let saved = served.node(&[&["params", "save", &dcf], &of_node[..]].concat());
    assert!(saved.contains(" values of node 3 on can0\n"), "{saved}");
    write("following error window", "5");
    write("0x6083", "6");
    let diff = ["params", "diff", &dcf, "--node", "3"];
    served.node_fails(1, &diff);

    let output = script(&python, "dcf_master.py", port, 3).args(["--dcf", &dcf]).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("compared "), "{text}");
    let same = served.node(&diff);
    assert!(same.ends_with(" values compared, 0 different\n"), "{same}");
    served.end();
}

#[test]
fn lss_slave_of_durand_gets_a_node_id() {
    let Some(python) = python_with(&["durand", "can", "serial"], "durand") else { return };
    let (_scenario, served, port) = bridged("");
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ecan-canopen/tests/python");
    let mut command = Command::new(&python);
    command.arg("-B").arg(Path::new(directory).join("responder_node.py"));
    command.args(["--port", &port.to_string(), "--serial", "3"]).stdin(Stdio::piped());
    let mut peer = start_peer(&mut command);
    let mut lines = peer.lines();
    let mut line_with = |part: &str| {
        let line = lines.find(|line| line.contains(part));
        line.unwrap_or_else(|| panic!("the slave ended before {part}"))
    };
    line_with("ready");
    let known = ["lss", "scan", "--vendor", "0x44555241", "--product", "5", "--scan-time", "150"];
    // While it is selected it takes part in the scan, against CiA 305.
    let scan = ends(1, &[&["--via", served.path.as_str(), "node"], &known[..]].concat());
    let address = "0x44555241:0x5:0x80000001:3";
    assert!(scan.contains(address) && scan.ends_with("1 slave(s) without node-ID\n"), "{scan}");
    let set = ["lss", "set-id", "9", "--address", address, "--store", "--yes", "--timeout", "3000"];
    let printed = served.node(&set);
    assert!(printed.ends_with(": node-ID 9, stored, booted\n"), "{printed}");
    // Requests in its log: configure node-ID, store.
    assert!(line_with("lss 11").starts_with("lss 1109000000000000 "));
    assert!(line_with("store").ends_with(" 9"));
    let read = ["sdo", "read", "--node", "9", "--timeout", "5000", "0x1018:4"];
    let serial = served.node(&read);
    assert!(serial.ends_with(" = 3\n"), "{serial}");
    // Before its bus.
    drop(peer);
    served.end();
}
