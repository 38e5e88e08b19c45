//! `ecan node` through `ecan serve`: the nodes live as long as the service.

use crate::serve::{Served, serve_bus};
use crate::support::{assert_has, fails, good, json_of};

fn serve_drives() -> Served {
    let mut served = serve_bus("sim:drives", &[]);
    served.program.wait_for_error("slave 0: ready");
    served
}

impl Served {
    pub fn node(&self, arguments: &[&str]) -> String {
        good(&[&["--via", self.path.as_str(), "node"], arguments].concat())
    }

    pub fn node_fails(&self, status: i32, arguments: &[&str]) -> String {
        fails(status, &[&["--via", self.path.as_str(), "node"], arguments].concat())
    }
}

#[test]
fn states_are_confirmed_by_heartbeats_and_kept() {
    let served = serve_drives();
    served.node(&["sdo", "write", "--node", "2", "0x1017", "50"]);
    let nmt = |command: &str| served.node(&["nmt", command, "--node", "2", "--yes"]);
    assert_eq!(nmt("stop"), "node 2 on can0: stopped, by its heartbeat\n");
    // A stopped node answers no SDO request.
    assert_has(&served.node_fails(5, &["info", "--node", "2"]), "not in the state stopped");
    assert_eq!(nmt("preop"), "node 2 on can0: pre-operational, by its heartbeat\n");
    assert!(served.node(&["info", "--node", "2"]).contains("NMT state       pre-operational\n"));
    assert!(nmt("start").starts_with("node 2 on can0: operational, by its "));
    assert!(served.node(&["info", "--node", "2"]).contains("NMT state       operational\n"));
    let scan = served.node(&["scan", "--channel", "0", "--nodes", "1-4"]);
    assert!(scan.contains("0      can0     2     operational"), "{scan}");
    assert!(scan.contains("0      can0     1     -"), "the others send no heartbeat: {scan}");
    let all = served.node(&["nmt", "preop", "--all", "--timeout", "400"]);
    assert_eq!(all, "node 2 on can0: pre-operational, by its heartbeat\n");
    served.end();
}

#[test]
fn live_pdo_shows_the_change_of_another_command() {
    let served = serve_drives();
    let watch = ["node", "pdo", "--node", "1.1", "--watch", "-n", "2", "-T", "60000", "--json"];
    let mut watching = served.run(&watch);
    // The watch begins after the mapping was read: each line has a change of the statusword.
    served.node(&["nmt", "start", "--node", "1.1", "--yes"]);
    for controlword in ["6", "0", "6", "0", "6", "7", "6", "0"].into_iter().cycle().take(400) {
        served.node(&["sdo", "write", "--node", "1.1", "--yes", "0x6040", controlword]);
        if watching.has_ended() {
            break;
        }
    }
    let lines = [watching.line(), watching.line()];
    for line in &lines {
        let live = json_of(line);
        assert_eq!(live["pdo"], "TPDO 1", "{line}");
        assert_eq!(live["values"][0]["name"], "statusword", "{line}");
    }
    assert_ne!(lines[0], lines[1]);
    watching.ends(0);
    served.end();
}

#[test]
fn watch_ends_with_the_user() {
    let served = serve_drives();
    let mut watching = served.run(&["node", "emcy", "--node", "1", "--watch"]);
    assert_eq!(watching.line(), "node 1 on can0, error register: no error");
    assert_eq!(watching.line(), "error history: empty");
    watching.end();
    served.end();
}

#[test]
fn search_for_bit_rates_needs_the_gateways_alone() {
    let served = serve_drives();
    let message = served.node_fails(2, &["scan", "--bitrates"]);
    assert!(message.contains("--bitrates needs the gateways alone, and ecan serve"), "{message}");
    served.end();
}

#[test]
fn read_only_service_rejects_requests_to_nodes() {
    let mut served = serve_bus("sim:drives", &["--read-only"]);
    served.program.wait_for_error("slave 0: ready");
    assert_has(&served.node_fails(3, &["info", "--node", "1"]), "read-only");
    served.end();
}
