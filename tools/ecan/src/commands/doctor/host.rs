//! Checks of the host: network interface of the master (link, interrupt coalescing), and real-time properties
//! (kernel, limits, CPUs, clock; manual 13.9, 15.6).

use std::process::Command;
use std::time::Duration;

use super::{Check, Root, gateways};
use crate::program;
use crate::program::RunError;

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
    let reported =
        root.main_device().map(|device| (device.to_owned(), "of the running master".to_owned()));
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
        None if gateways::has_native_driver(root) => Interface::Native(address),
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

/// Priority of a cycle thread, below the kernel's own threads.
const PRIORITY: u64 = 80;
/// Memory of a program with locked memory, in bytes.
const LOCKED_BYTES: u64 = 256 << 20;
/// Acceptable exit latency of sleep states, in microseconds.
const WAKE_UP_US: u64 = 50;
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

const CPUS: &str = "sys/devices/system/cpu";

/// Debian's package of a real-time kernel, and the kernel's parameters that prevent long sleep states.
const REMEDIES: (&str, &str) = if cfg!(target_arch = "aarch64") {
    ("linux-image-rt-arm64", "cpuidle.off=1")
} else {
    ("linux-image-rt-amd64", "intel_idle.max_cstate=1 processor.max_cstate=1")
};

pub(super) fn kernel(root: &Root) -> Check {
    let version = root.first_line("proc/version").unwrap_or_default();
    let release = version.split_whitespace().nth(2).unwrap_or("unknown release").to_owned();
    let is_real_time = root.first_line("sys/kernel/realtime").as_deref() == Some("1")
        || version.contains("PREEMPT_RT");
    if is_real_time {
        return Check::good(format!("{release}, PREEMPT_RT"));
    }
    Check::warning(
        format!("{release} is not a PREEMPT_RT kernel: cycles may be late by milliseconds"),
        &format!(
            "install a kernel with PREEMPT_RT ({}, or Ubuntu's real-time kernel); on this one use a cycle \
             of 2 ms or longer and a real-time priority (--rt-priority): without it, gateways with N from \
             6 have incomplete working counters when another program interrupts the cycle",
            REMEDIES.0
        ),
    )
}

/// Soft limit in /proc/self/limits; the inner `None` is unlimited.
fn limit(root: &Root, name: &str) -> Option<Option<u64>> {
    let text = root.text("proc/self/limits")?;
    let value = text.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?;
    if value == "unlimited" { Some(None) } else { Some(Some(value.parse().ok()?)) }
}

fn has_capability(root: &Root, bit: u32) -> bool {
    let status = root.text("proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let mask = line.and_then(|line| u64::from_str_radix(line.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> bit & 1 == 1)
}

pub(super) fn priority_limit(root: &Root) -> Check {
    if has_capability(root, CAP_SYS_NICE) {
        return Check::good("permitted (CAP_SYS_NICE)");
    }
    match limit(root, "Max realtime priority") {
        None => Check::skipped("limits not readable"),
        Some(None) => Check::good("RLIMIT_RTPRIO is unlimited"),
        Some(Some(limit)) if limit >= PRIORITY => Check::good(format!("RLIMIT_RTPRIO is {limit}")),
        Some(Some(limit)) => Check::warning(
            format!("RLIMIT_RTPRIO is {limit}; a cycle thread needs {PRIORITY}"),
            "run setup_host.sh apply for a group; or LimitRTPRIO=90 of a systemd service, \
             or setcap cap_sys_nice+ep PROGRAM",
        ),
    }
}

pub(super) fn memory_limit(root: &Root) -> Check {
    if has_capability(root, CAP_IPC_LOCK) {
        return Check::good("permitted (CAP_IPC_LOCK)");
    }
    match limit(root, "Max locked memory") {
        None => Check::skipped("limits not readable"),
        Some(None) => Check::good("RLIMIT_MEMLOCK is unlimited"),
        Some(Some(bytes)) if bytes >= LOCKED_BYTES => {
            Check::good(format!("RLIMIT_MEMLOCK is {} MiB", bytes >> 20))
        }
        Some(Some(bytes)) => Check::warning(
            format!("RLIMIT_MEMLOCK is {} KiB: memory may be paged out in a cycle", bytes >> 10),
            "run setup_host.sh apply for a group; or LimitMEMLOCK=infinity of a systemd \
             service, or setcap cap_ipc_lock+ep PROGRAM",
        ),
    }
}

pub(super) fn isolated_cpus(root: &Root) -> Check {
    let list = |file: &str| {
        root.first_line(format!("{CPUS}/{file}"))
            .filter(|list| !list.is_empty() && list != "(null)")
    };
    let online = list("online").unwrap_or_else(|| "unknown".to_owned());
    match list("isolated") {
        Some(cpus) => {
            let ticks =
                list("nohz_full").map_or_else(String::new, |cpus| format!(", nohz_full {cpus}"));
            Check::good(format!("{cpus} of {online}{ticks}"))
        }
        None if online == "0" => Check::skipped("only one CPU"),
        None => Check::warning(
            format!("none of {online}: other programs run on the CPU of the cycle"),
            "isolcpus=N nohz_full=N rcu_nocbs=N on the kernel's command line, and bind the cycle \
             thread to N",
        ),
    }
}

pub(super) fn clock_source(root: &Root) -> Check {
    let directory = "sys/devices/system/clocksource/clocksource0";
    let Some(source) = root.first_line(format!("{directory}/current_clocksource")) else {
        return Check::skipped("not reported by the kernel");
    };
    if !matches!(source.as_str(), "hpet" | "acpi_pm" | "jiffies" | "refined-jiffies" | "pit") {
        return Check::good(source);
    }
    let available = root.first_line(format!("{directory}/available_clocksource"));
    let remedy = match available {
        Some(list) if list.split_whitespace().any(|source| source == "tsc") => {
            "clocksource=tsc on the kernel's command line"
        }
        _ => "the kernel marked the TSC unstable; check the power settings of the BIOS",
    };
    Check::warning(format!("{source} is slow to read"), remedy)
}

pub(super) fn power_governor(root: &Root) -> Check {
    let governor = |cpu: &String| {
        let is_cpu = cpu.strip_prefix("cpu")?.bytes().all(|byte| byte.is_ascii_digit());
        let governor = root.first_line(format!("{CPUS}/{cpu}/cpufreq/scaling_governor"))?;
        is_cpu.then(|| (cpu.clone(), governor))
    };
    let governors: Vec<_> = root.names(CPUS).iter().filter_map(governor).collect();
    if governors.is_empty() {
        return Check::skipped("no frequency scaling");
    }
    match governors.iter().find(|(_, governor)| governor != "performance") {
        None => Check::good(format!("performance on {} CPUs", governors.len())),
        Some((cpu, governor)) => Check::warning(
            format!("{governor} on {cpu}: the CPU frequency changes during the cycle"),
            "cpupower frequency-set -g performance",
        ),
    }
}

pub(super) fn sleep_states(root: &Root) -> Check {
    let directory = format!("{CPUS}/cpu0/cpuidle");
    let number = |state: &str, file: &str| {
        root.first_line(format!("{directory}/{state}/{file}"))?.parse::<u64>().ok()
    };
    let enabled = |state: &String| number(state, "disable").unwrap_or(0) == 0;
    let longest = root
        .names(&directory)
        .iter()
        .filter(|state| enabled(state))
        .filter_map(|state| number(state, "latency"))
        .max();
    match longest {
        None => Check::skipped("not reported by the kernel"),
        Some(us) if us <= WAKE_UP_US => Check::good(format!("exit latency {us} us")),
        Some(us) if root.exists("dev/cpu_dma_latency") => {
            Check::good(format!("exit latency {us} us; programs can limit it"))
        }
        Some(us) => Check::warning(
            format!("exit latency {us} us, and /dev/cpu_dma_latency is missing"),
            &format!("{} on the kernel's command line", REMEDIES.1),
        ),
    }
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
