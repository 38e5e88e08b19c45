//! The network interface of the master: link and interrupt coalescing.

use std::process::Command;
use std::time::Duration;

use crate::program::{self, RunError};

use super::{Check, Root, master};

const LIMIT: Duration = Duration::from_secs(5);

const CONFIGURATIONS: [&str; 5] = [
    "etc/ethercat.conf",
    "etc/sysconfig/ethercat",
    "etc/default/ethercat",
    "usr/local/etc/ethercat.conf",
    "opt/etherlab/etc/ethercat.conf",
];
/// Address that stands for any interface.
const ANY: &str = "ff:ff:ff:ff:ff:ff";
const INTERFACES: &str = "sys/class/net";

enum Interface {
    /// Interface of the network stack.
    Shown(String),
    /// Interface of a native driver, not visible in the network stack.
    Native(String),
    Unknown(Check),
}

/// Value in a shell-like configuration file.
fn setting(root: &Root, name: &str) -> Option<String> {
    let text = CONFIGURATIONS.iter().find_map(|path| root.text(path))?;
    let line =
        text.lines().rev().find_map(|line| line.trim().strip_prefix(name)?.strip_prefix('='))?;
    Some(line.trim().trim_matches(['"', '\'']).to_owned()).filter(|value| !value.is_empty())
}

/// Address in the parameter of the loaded module.
fn parameter(root: &Root, master: u32) -> Option<String> {
    let devices = root.first_line("sys/module/ec_master/parameters/main_devices")?;
    let device = devices.split(',').nth(usize::try_from(master).ok()?)?.trim().to_owned();
    Some(device).filter(|device| !device.is_empty() && device != "(null)")
}

/// Address of the master's interface and where it is set: the running master first, because a
/// configuration file takes effect with the next start only.
fn address(root: &Root, master: u32) -> Option<(String, String)> {
    let reported = root.main_device().map(|it| (it.to_owned(), "of the running master".to_owned()));
    let parameter = || {
        let source = "of the module parameter main_devices".to_owned();
        parameter(root, master).map(|address| (address, source))
    };
    let name = format!("MASTER{master}_DEVICE");
    let configured = || setting(root, &name).map(|address| (address, format!("of {name}")));
    reported.or_else(parameter).or_else(configured)
}

fn find(root: &Root, master: u32) -> Interface {
    let Some((address, source)) = address(root, master) else {
        return Interface::Unknown(Check::warning(
            format!("the master's configuration sets no interface (MASTER{master}_DEVICE)"),
            "set MASTER0_DEVICE to the address of the interface in /etc/ethercat.conf and restart the master",
        ));
    };
    if address.eq_ignore_ascii_case(ANY) {
        return Interface::Unknown(Check::skipped(format!(
            "the address {ANY} {source} selects the first interface found"
        )));
    }
    let is_it = |interface: &String| {
        interface.eq_ignore_ascii_case(&address)
            || root
                .first_line(format!("{INTERFACES}/{interface}/address"))
                .is_some_and(|own| own.eq_ignore_ascii_case(&address))
    };
    match root.names(INTERFACES).into_iter().find(is_it) {
        Some(interface) => Interface::Shown(interface),
        None if master::has_native_driver(root) => Interface::Native(address),
        None => Interface::Unknown(Check::bad(
            format!("no interface has the address {address} {source}"),
            "compare it with `ip link`; a replaced card has another address",
        )),
    }
}

pub(super) fn link(root: &Root, master: u32) -> Check {
    let interface = match find(root, master) {
        Interface::Shown(interface) => interface,
        Interface::Native(address) => {
            return Check::good(format!("{address}, native driver of the master"));
        }
        Interface::Unknown(check) => return check,
    };
    let of = |file: &str| root.first_line(format!("{INTERFACES}/{interface}/{file}"));
    let driver = root.link_name(format!("{INTERFACES}/{interface}/device/driver"));
    let driver = driver.map_or_else(String::new, |driver| format!(", driver {driver}"));
    let speed = of("speed").unwrap_or_default();
    if of("carrier").as_deref() != Some("1") {
        let remedy = format!(
            "ip link set {interface} up; check the cable and the supply of the first slave"
        );
        return Check::bad(format!("{interface}{driver}: no link"), &remedy);
    }
    if !matches!(speed.as_str(), "100" | "" | "-1") {
        return Check::warning(
            format!("{interface}{driver}: link at {speed} Mbit/s; EtherCAT needs 100"),
            "connect the first slave directly, without a switch",
        );
    }
    Check::good(format!("{interface}{driver}, link up"))
}

pub(super) fn coalescing(root: &Root, master: u32) -> Check {
    let interface = match find(root, master) {
        Interface::Shown(interface) => interface,
        Interface::Native(_) => return Check::skipped("the native driver polls"),
        Interface::Unknown(_) => return Check::skipped("interface unknown"),
    };
    let Some(ethtool) = root.ethtool() else {
        return Check::skipped("ethtool not found");
    };
    match program::run(Command::new(ethtool).args(["-c", &interface]), LIMIT) {
        Ok(ran) if ran.status.success() => {
            check_coalescing(&interface, &String::from_utf8_lossy(&ran.stdout))
        }
        Err(error @ RunError::TimedOut(_)) => Check::skipped(format!("ethtool: {error}")),
        _ => Check::skipped(format!("not reported by the driver of {interface}")),
    }
}

/// Evaluates the output of `ethtool -c`.
fn check_coalescing(interface: &str, text: &str) -> Check {
    let value = |key: &str| {
        let line =
            text.lines().find_map(|line| line.trim().strip_prefix(key)?.strip_prefix(':'))?;
        line.trim().parse::<u32>().ok()
    };
    let is_adaptive = text
        .lines()
        .filter_map(|line| line.trim().strip_prefix("Adaptive RX:"))
        .any(|line| line.trim_start().starts_with("on"));
    let (rx, tx) = (value("rx-usecs").unwrap_or(0), value("tx-usecs").unwrap_or(0));
    let found = format!("{interface}: rx-usecs {rx}, tx-usecs {tx}");
    if !is_adaptive && rx <= 1 && tx <= 1 {
        return Check::good(found);
    }
    let adaptive = if is_adaptive { ", adaptive" } else { "" };
    let remedy = format!("ethtool -C {interface} adaptive-rx off rx-usecs 0 tx-usecs 0");
    Check::warning(format!("{found}{adaptive}: frames are delayed"), &remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ethtool_output_is_parsed() {
        let check = |text| check_coalescing("enp4s0", text);
        let off = "Coalesce parameters for enp4s0:\nAdaptive RX: off  TX: off\nrx-usecs: 0\n\
                   rx-frames: n/a\ntx-usecs:\t0\n";
        assert_eq!(check(off).found, "enp4s0: rx-usecs 0, tx-usecs 0");
        assert!(!check(off).has_problem());
        let on = check("Adaptive RX: on  TX: off\nrx-usecs: 3\n");
        assert_eq!(on.found, "enp4s0: rx-usecs 3, tx-usecs 0, adaptive: frames are delayed");
        assert!(on.remedy.contains("-C enp4s0 adaptive-rx off"));
    }
}
