//! A veth pair in a separate network namespace.

use std::process::Command;

use nix::sched::{CloneFlags, unshare};

/// Interface of the master.
pub const MASTER: &str = "veth0";
/// Interface of the gateways.
pub const GATEWAYS: &str = "veth1";

/// Moves the calling thread, and all threads and programs that it starts from now on, into a new
/// network with only a veth pair and the loopback interface, all up. Returns false if that is not
/// possible; the reason is printed.
pub fn enter() -> bool {
    if let Err(errno) = unshare(CloneFlags::CLONE_NEWNET) {
        println!("skipped: no network namespace of its own: {errno}");
        return false;
    }
    // Only the test sends then; a system without IPv6 is silent anyway.
    let _ = std::fs::write("/proc/sys/net/ipv6/conf/default/disable_ipv6", "1");
    let commands = [
        &["link", "add", MASTER, "type", "veth", "peer", "name", GATEWAYS][..],
        &["link", "set", MASTER, "up"],
        &["link", "set", GATEWAYS, "up"],
        // Bridges listen there.
        &["link", "set", "lo", "up"],
    ];
    for arguments in commands {
        match Command::new("ip").args(arguments).output() {
            Ok(output) if output.status.success() => {}
            Ok(output) => {
                let message = String::from_utf8_lossy(&output.stderr);
                println!("skipped: ip {}: {}", arguments.join(" "), message.trim());
                return false;
            }
            Err(error) => {
                println!("skipped: ip (of iproute2) cannot be run: {error}");
                return false;
            }
        }
    }
    true
}

pub fn ip(arguments: &[&str]) {
    assert!(Command::new("ip").args(arguments).status().unwrap().success(), "ip {arguments:?}");
}
