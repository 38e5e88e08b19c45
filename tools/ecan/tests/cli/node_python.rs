//! `ecan node` with a node that no one here wrote: a `LocalNode` of Python's package `canopen`, on the
//! bus of a simulated gateway by the simulator's slcan bridge.

use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::serve::{Served, serve_bus};
use crate::support::python::python_with;
use crate::support::{Scenario, ecan, fails, good};

/// The node's program; it ends with its standard input.
struct Peer(Child);

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start_peer(python: &str, port: u16) -> Peer {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ecan-canopen/tests/python");
    let child = Command::new(python)
        .arg("-B")
        .arg(Path::new(directory).join("local_node.py"))
        .args(["--port", &port.to_string(), "--node", "5"])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn();
    Peer(child.unwrap())
}

struct Bus {
    /// Ends before its bus.
    _peer: Peer,
    served: Served,
    _scenario: Scenario,
}

impl Bus {
    /// Starts service and node, and waits until the node answers.
    fn start(python: &str) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let tables = format!("[[node]]\nkind = \"bridge\"\nbus = \"0.0\"\nport = {port}\n");
        let scenario = Scenario::new(&tables);
        let mut served = serve_bus(&scenario.setting(), &[]);
        served.program.wait_for_error("slave 0: ready");
        let bus = Self { _peer: start_peer(python, port), _scenario: scenario, served };
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
    let bus = Bus::start(&python);
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
