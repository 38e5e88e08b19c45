//! Tests of `ecan doctor` on file trees with /proc, /sys, /dev and /etc.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::support::{all_fail, ecan, write_program};

#[path = "../../../../examples/tests/program/master_faults.rs"]
mod master_faults;

const ECRT_SYS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ecrt-sys");

/// Files of a good host.
const GOOD: [(&str, &str); 20] = [
    ("sys/module/ec_sys/refcnt", "0\n"),
    ("sys/module/ec_master/version", "1.6.2 1.6.2\n"),
    ("sys/module/ec_generic/refcnt", "0\n"),
    ("dev/EtherCAT0", ""),
    ("dev/cpu_dma_latency", ""),
    (
        "etc/ethercat.conf",
        "# master\nMASTER0_DEVICE=\"00:1B:21:00:00:01\"\nDEVICE_MODULES=\"generic\"\n",
    ),
    ("sys/class/net/lo/address", "00:00:00:00:00:00\n"),
    ("sys/class/net/enp4s0/address", "00:1b:21:00:00:01\n"),
    ("sys/class/net/enp4s0/carrier", "1\n"),
    ("sys/class/net/enp4s0/speed", "100\n"),
    ("proc/version", "Linux version 6.8.1-1015-realtime (builder) #16-Ubuntu SMP PREEMPT_RT\n"),
    ("sys/kernel/realtime", "1\n"),
    ("proc/self/status", "Name:\tecan\nCapEff:\t0000000000000000\n"),
    (
        "proc/self/limits",
        "Limit                     Soft Limit           Hard Limit           Units     \n\
         Max locked memory         unlimited            unlimited            bytes     \n\
         Max realtime priority     90                   90                   \n",
    ),
    ("sys/devices/system/cpu/online", "0-3\n"),
    ("sys/devices/system/cpu/isolated", "3\n"),
    ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
    ("sys/devices/system/clocksource/clocksource0/available_clocksource", "tsc hpet acpi_pm\n"),
    ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n"),
    ("sys/devices/system/cpu/cpu0/cpuidle/state1/latency", "2\n"),
];

const ETHTOOL_GOOD: &str = "#!/bin/sh\necho 'Adaptive RX: off  TX: off'\necho 'rx-usecs: 0'\n";
const ETHTOOL_BAD: &str = "#!/bin/sh\necho 'Adaptive RX: off  TX: off'\necho \"$2 $1\" >&2\n\
                           echo 'rx-usecs: 3'\n";

fn put(root: &Path, name: &str, text: &str) {
    let path = root.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

fn host() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    for (name, text) in GOOD {
        put(root, name, text);
    }
    for directory in ["sys/bus/pci/drivers/igb", "sys/class/net/enp4s0/device"] {
        std::fs::create_dir_all(root.join(directory)).unwrap();
    }
    let driver = root.join("sys/class/net/enp4s0/device/driver");
    symlink("../../../../bus/pci/drivers/igb", driver).unwrap();
    write_program(&root.join("ethtool"), ETHTOOL_GOOD);
    directory
}

/// Exit status and output of `doctor` on a tree.
fn doctor(host: &Path, options: &[&str]) -> (Option<i32>, String) {
    let ethtool = host.join("ethtool");
    let paths = [host, &ethtool].map(|path| path.to_str().unwrap());
    let output = ecan(&[&["doctor", "--root", paths[0], "--ethtool", paths[1]], options].concat());
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

#[test]
fn good_host_has_no_problems() {
    let host = host();
    let (status, report) = doctor(host.path(), &[]);
    let expected = "\
good     kernel module       ec_master 1.6.2 1.6.2
good     network driver      ec_generic (generic: frames pass the network stack; a native driver has less jitter)
good     device node         /dev/EtherCAT0 can be opened
good     interface           enp4s0, driver igb, link up
good     coalescing          enp4s0: rx-usecs 0, tx-usecs 0
good     real-time kernel    6.8.1-1015-realtime, PREEMPT_RT
good     real-time priority  RLIMIT_RTPRIO is 90
good     locked memory       RLIMIT_MEMLOCK is unlimited
good     isolated CPUs       3 of 0-3
good     clock source        tsc
good     power governor      performance on 1 CPUs
good     sleep states        exit latency 2 us
";
    assert_eq!((status, report.as_str()), (Some(0), expected));
}

/// Change of the good host.
enum Change {
    Put(&'static [(&'static str, &'static str)]),
    Remove(&'static [&'static str]),
    Ethtool(&'static str),
}

#[test]
fn each_problem_has_a_remedy() {
    use Change::{Ethtool, Put, Remove};
    // With the name of the check, what it has found, and the remedy.
    let cases: [(Change, &str); 16] = [
        (Remove(&["sys/module/ec_master"]), "kernel module | is not loaded | systemctl enable"),
        (
            Remove(&["sys/module/ec_generic"]),
            "network driver | no network driver of | DEVICE_MODULES",
        ),
        (Remove(&["dev/EtherCAT0"]), "device node | does not exist | load the module"),
        (Remove(&["etc/ethercat.conf"]), "interface | sets no interface | /etc/ethercat.conf"),
        (
            Put(&[("sys/class/net/enp4s0/address", "00:1b:21:00:00:02\n")]),
            "interface | no interface has the address 00:1B:21:00:00:01 | ip link",
        ),
        (Put(&[("sys/class/net/enp4s0/carrier", "0\n")]), "interface | no link | cable"),
        (
            Put(&[("sys/class/net/enp4s0/speed", "1000\n")]),
            "interface | 1000 Mbit/s | without a switch",
        ),
        (Ethtool(ETHTOOL_BAD), "coalescing | rx-usecs 3 | -C enp4s0 adaptive-rx off rx-usecs 0"),
        (
            Put(&[
                ("sys/kernel/realtime", "0\n"),
                ("proc/version", "Linux version 6.8.0-45-generic SMP PREEMPT_DYNAMIC\n"),
            ]),
            "real-time kernel | 6.8.0-45-generic is not a PREEMPT_RT kernel | linux-image-rt",
        ),
        (
            Put(&[(
                "proc/self/limits",
                "Max locked memory         unlimited  unlimited  bytes\n\
                 Max realtime priority     0  0\n",
            )]),
            "real-time priority | RLIMIT_RTPRIO is 0 | setup_host.sh apply",
        ),
        (
            Put(&[(
                "proc/self/limits",
                "Max locked memory         8388608  8388608  bytes\n\
                 Max realtime priority     99  99\n",
            )]),
            "locked memory | RLIMIT_MEMLOCK is 8192 KiB | LimitMEMLOCK=infinity",
        ),
        (
            Put(&[("sys/devices/system/cpu/isolated", "\n")]),
            "isolated CPUs | none of 0-3 | isolcpus=N",
        ),
        (
            Put(&[("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n")]),
            "clock source | hpet is slow | clocksource=tsc",
        ),
        (
            Put(&[("sys/devices/system/cpu/cpu2/cpufreq/scaling_governor", "powersave\n")]),
            "power governor | powersave on cpu2 | cpupower",
        ),
        (
            Remove(&["dev/cpu_dma_latency", "sys/devices/system/cpu/cpu0/cpuidle/state1/latency"]),
            "",
        ),
        (Remove(&["proc/self/limits"]), ""),
    ];
    for (change, expected) in cases {
        let host = host();
        match change {
            Put(files) => files.iter().for_each(|(file, text)| put(host.path(), file, text)),
            Ethtool(text) => write_program(&host.path().join("ethtool"), text),
            Remove(files) => {
                for file in files {
                    let path = host.path().join(file);
                    if path.is_dir() {
                        std::fs::remove_dir_all(path).unwrap();
                    } else {
                        std::fs::remove_file(path).unwrap();
                    }
                }
            }
        }
        let (status, text) = doctor(host.path(), &[]);
        // Missing information is skipped, without a problem.
        if expected.is_empty() {
            assert_eq!(status, Some(0), "{text}");
            assert!(text.contains("skipped "), "{text}");
            continue;
        }
        let [name, found, remedy] = expected.split(" | ").collect::<Vec<_>>()[..] else {
            panic!("{expected}")
        };
        assert!(text.contains("\n  remedy: "), "{text}");
        let (status, json) = doctor(host.path(), &["--json"]);
        assert_eq!(status, Some(1), "{json}");
        let checks: Vec<serde_json::Value> = serde_json::from_str(&json).unwrap();
        let has_problem = |check: &&serde_json::Value| {
            matches!(check["verdict"].as_str(), Some("bad" | "warning"))
        };
        let problems: Vec<_> = checks.iter().filter(has_problem).collect();
        assert_eq!(problems.len(), 1, "{name}: {problems:?}");
        assert_eq!(problems[0]["name"], name);
        assert!(problems[0]["found"].as_str().unwrap().contains(found), "{problems:?}");
        assert!(problems[0]["remedy"].as_str().unwrap().contains(remedy), "{problems:?}");
    }
}

#[test]
fn missing_module_names_its_cause() {
    let release = ("proc/sys/kernel/osrelease", "6.1.0-1-amd64\n");
    let modules = "lib/modules/6.1.0-1-amd64/modules.dep";
    let installed = (modules, "ethercat/master/ec_master.ko.xz:\n");
    let signed = "the kernel loads signed modules only";
    let cases: [(&[(&str, &str)], &str); 5] = [
        (
            &[release, (modules, "kernel/net/can/can.ko:\n")],
            "not installed for the kernel 6.1.0-1-amd64",
        ),
        (&[release, installed], "ec_master is not loaded\n"),
        (&[("sys/kernel/security/lockdown", "none [integrity] confidentiality\n")], signed),
        (
            &[("sys/kernel/security/lockdown", "[none] integrity confidentiality\n")],
            "ec_master is not loaded\n",
        ),
        (&[release, installed, ("sys/module/module/parameters/sig_enforce", "Y\n")], signed),
    ];
    for (files, found) in cases {
        let host = host();
        std::fs::remove_dir_all(host.path().join("sys/module/ec_master")).unwrap();
        files.iter().for_each(|(file, text)| put(host.path(), file, text));
        let (status, text) = doctor(host.path(), &[]);
        assert_eq!(status, Some(1), "{text}");
        assert!(text.contains(found), "{files:?}: {text}");
    }
}

#[test]
fn capabilities_and_native_driver_are_accepted() {
    let host = host();
    put(
        host.path(),
        "proc/self/limits",
        "Max locked memory  0  0  bytes\nMax realtime priority  0  0\n",
    );
    // CAP_IPC_LOCK and CAP_SYS_NICE.
    put(host.path(), "proc/self/status", "CapEff:\t0000000000804000\n");
    put(host.path(), "sys/module/ec_igb/refcnt", "1\n");
    std::fs::remove_dir_all(host.path().join("sys/class/net/enp4s0")).unwrap();
    let (status, report) = doctor(host.path(), &[]);
    assert_eq!(status, Some(0), "{report}");
    for line in [
        "good     real-time priority  permitted (CAP_SYS_NICE)",
        "good     locked memory       permitted (CAP_IPC_LOCK)",
        "good     network driver      ec_generic, ec_igb (native)",
        "good     interface           00:1B:21:00:00:01, native driver of the master",
        "skipped  coalescing          the native driver polls",
    ] {
        assert!(report.contains(line), "{report}");
    }
}

#[test]
fn long_sleep_states_without_limit_are_a_problem() {
    let host = host();
    put(host.path(), "sys/devices/system/cpu/cpu0/cpuidle/state2/latency", "200\n");
    let (status, report) = doctor(host.path(), &[]);
    assert_eq!(status, Some(0), "{report}");
    assert!(report.contains("exit latency 200 us; programs can limit it"), "{report}");
    std::fs::remove_file(host.path().join("dev/cpu_dma_latency")).unwrap();
    let (status, report) = doctor(host.path(), &[]);
    assert_eq!(status, Some(1), "{report}");
    let parameter =
        if cfg!(target_arch = "aarch64") { "cpuidle.off=1" } else { "intel_idle.max_cstate=1" };
    assert!(report.contains(&format!("remedy: {parameter}")), "{report}");
    // A disabled state is ignored.
    put(host.path(), "sys/devices/system/cpu/cpu0/cpuidle/state2/disable", "1\n");
    assert_eq!(doctor(host.path(), &[]).0, Some(0));
}

#[test]
fn master_index_selects_node_and_interface() {
    let host = host();
    let (status, report) = doctor(host.path(), &["--master", "1"]);
    assert_eq!(status, Some(1));
    assert!(report.contains("/dev/EtherCAT1 does not exist"), "{report}");
    assert!(report.contains("(MASTER1_DEVICE)"), "{report}");
}

#[test]
fn interface_of_the_loaded_module_counts() {
    // Started without a configuration file, for example by insmod.
    let host = host();
    let parameter = "sys/module/ec_master/parameters/main_devices";
    std::fs::remove_file(host.path().join("etc/ethercat.conf")).unwrap();
    put(host.path(), parameter, "00:1B:21:00:00:01\n");
    let (status, report) = doctor(host.path(), &[]);
    assert_eq!(status, Some(0), "{report}");
    assert!(
        report.contains("good     interface           enp4s0, driver igb, link up"),
        "{report}"
    );
    let (_, report) = doctor(host.path(), &["--master", "1"]);
    assert!(report.contains("sets no interface (MASTER1_DEVICE)"), "{report}");
    // A configuration that was changed since takes no effect.
    put(host.path(), "etc/ethercat.conf", "MASTER0_DEVICE=\"00:1B:21:00:00:07\"\n");
    assert_eq!(doctor(host.path(), &[]).0, Some(0));
    put(host.path(), parameter, "00:1b:21:00:00:05,ff:ff:ff:ff:ff:ff\n");
    let (status, report) = doctor(host.path(), &[]);
    assert_eq!(status, Some(1), "{report}");
    let words =
        "no interface has the address 00:1b:21:00:00:05 of the module parameter main_devices";
    assert!(report.contains(words), "{report}");
}

#[test]
fn library_and_bus_are_checked() {
    let output = ecan(&["--ecrt", "sim", "doctor"]);
    let report = String::from_utf8(output.stdout).unwrap();
    for line in [
        "good     library             simulated EtherCAT master (scenario echo), version 1.6\n",
        "skipped  device node         not needed with a simulated master\n",
        "good     bus                 1 slave, 1 ECAN-Lite\n",
        "good     process data        slave 0: N = 8 requested, a standard master supports 11\n",
        "good     SII layout          slave 0: SM2 and SM3 match manual 15.7, as of the master's last scan\n",
    ] {
        assert!(report.contains(line), "{report}");
    }
    let bus = crate::support::scenario(
        "[[gateway]]\n[[gateway]]\nsii_sm2.start = 0x1180\nsii_sm3 = { size = 1024, control = 0x20 }",
    );
    let report = crate::support::ends(1, &["--ecrt", &crate::support::setting(&bus), "doctor"]);
    for line in [
        "good     SII layout          slave 0: SM2 and SM3 match",
        "bad      SII layout          slave 1: SM2 has start 0x1180, 3072 bytes, control byte 0x66 instead of \
         start 0x1100, 3072 bytes, control byte 0x66, SM3 has start 0x1D00, 1024 bytes, control byte 0x20",
        "remedy: ecan_sii_sm_layout.sh check --position 1, then fix, then power-cycle",
    ] {
        assert!(report.contains(line), "{line}: {report}");
    }
    let bus = crate::support::first_silent();
    let report = crate::support::ends(1, &["--ecrt", &crate::support::setting(&bus), "doctor"]);
    let line = "bad      bus                 2 slaves, 1 ECAN-Lite; slave 0 cannot be identified";
    assert!(report.contains(line), "{report}");
    let output = ecan(&["--ecrt", "/none/libethercat.so.1", "doctor"]);
    assert_eq!(output.status.code(), Some(1));
    let report = String::from_utf8(output.stdout).unwrap();
    assert!(report.contains("bad      library             "), "{report}");
    assert!(report.contains("remedy: install the IgH EtherCAT master's library"), "{report}");
    assert!(report.contains("skipped  bus "), "{report}");
}

#[test]
fn invalid_use_has_message_and_status() {
    all_fail(&[
        (6, &["doctor", "--root", "/none"], "cannot read /none: not a directory"),
        (2, &["doctor", "now"], "unexpected argument"),
        (2, &["--ecrt", "sim", "--slave", "0", "doctor"], "use `ecan diag` for a gateway"),
    ]);
}

/// `simple_loop` has the same test, with the same faults and texts.
#[test]
fn faults_of_the_master_are_named_as_by_simple_loop() {
    master_faults::check_reports(Path::new(ECRT_SYS), || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        command.arg("scan");
        command
    });
}

#[test]
fn rejected_kernel_module_is_reported_with_both_versions() {
    let Some(fake) = master_faults::FakeMaster::build(Path::new(ECRT_SYS)) else { return };
    let library = fake.library().display().to_string();
    let output = Command::new(env!("CARGO_BIN_EXE_ecan"))
        .args(["--ecrt", &library, "--master", "104", "doctor"])
        .env("LD_PRELOAD", fake.device())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let report = String::from_utf8(output.stdout).unwrap();
    let versions = report.lines().find(|line| line.contains("versions  ")).unwrap();
    for part in [
        "bad  ",
        "/dev/EtherCAT104 opens, but the library (version 1.6) rejects the kernel module (",
        ", ioctl interface 39)",
        "install both from one version and reload the module",
    ] {
        assert!(versions.contains(part), "{report}");
    }
    assert!(
        report.contains("remedy: install both from one version, and reload the module"),
        "{report}"
    );
}
