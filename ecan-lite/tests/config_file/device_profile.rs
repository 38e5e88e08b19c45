//! Device profiles of `ecan probe`, included by a configuration.

use std::path::Path;
use std::time::Duration;

use ecan_lite::config::{ConfigFileError, DeviceProfile, load, load_profiles, parse};
use ecan_mcan_port::MeasuredOn;

const MEASURED: DeviceProfile = DeviceProfile {
    serial: Some(u64::MAX),
    firmware: Some((2, 7)),
    service_us: Some(40),
    mailbox_us: Some(50_000),
    restart_ms: Some(30_000),
    schedule_depth: Some(16),
    sync0_window_us: Some((90, 20)),
    internal_loopback: Some(2),
    sample_point_permille: Some(812),
    wired_sample_point_permille: Some(800),
    transceiver_ns: Some(162),
};

const CELL: &str = "\
cycle_us = 1000
[dc]
[[gateway]]
n = 3
device_profile = \"sub/gateway.toml\"
can0 = { bitrate = 500_000 }
";

/// A directory with a configuration that includes a profile.
fn directory(cell: &str, profile: &str) -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    std::fs::create_dir(directory.path().join("sub")).unwrap();
    std::fs::write(directory.path().join("cell.toml"), cell).unwrap();
    std::fs::write(directory.path().join("sub/gateway.toml"), profile).unwrap();
    directory
}

fn cell(directory: &tempfile::TempDir) -> std::path::PathBuf {
    directory.path().join("cell.toml")
}

fn faults(directory: &tempfile::TempDir) -> Vec<(usize, usize, String)> {
    match load(cell(directory)) {
        Err(ConfigFileError::Faults { faults, .. }) => {
            faults.0.into_iter().map(|fault| (fault.line, fault.column, fault.reason)).collect()
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn profile_is_read_as_it_was_written() {
    assert_eq!(DeviceProfile::parse(MEASURED.to_toml().as_bytes()).unwrap(), MEASURED);
    let none = DeviceProfile::default();
    assert_eq!(none.to_toml(), "");
    assert_eq!(DeviceProfile::parse(b"# Measured by ecan probe\n").unwrap(), none);
}

#[test]
fn measured_values_become_settings() {
    let directory = directory(CELL, &MEASURED.to_toml());
    let config = load(cell(&directory)).unwrap();
    let gateway = &config.port.gateways[0];
    // The longer one of service and Sync0 window.
    assert_eq!((gateway.schedule.processing_ns, gateway.schedule.depth), (90_000, 16));
    assert_eq!(config.adapter.preop_timeout, Duration::from_secs(60));
    let measured = MeasuredOn { serial: MEASURED.serial, firmware: MEASURED.firmware };
    assert_eq!(gateway.measured_on, Some(measured));
    // The planned shift follows the longer time of the firmware: half of 40 us later.
    let plain = parse(CELL.replace("device_profile", "# ").as_bytes()).unwrap();
    let shift = |config: &ecan_mcan_port::Config| config.adapter.dc.unwrap().shift;
    assert_eq!(shift(&config) - shift(&plain), Duration::from_micros(20));
}

#[test]
fn keys_of_the_configuration_override_the_profile() {
    let own = format!(
        "preop_timeout_ms = 5000\n{CELL}[gateway.schedule]\nprocessing_us = 70\ndepth = 32\n"
    );
    let directory = directory(&own, &MEASURED.to_toml());
    let config = load(cell(&directory)).unwrap();
    let schedule = config.port.gateways[0].schedule;
    assert_eq!((schedule.processing_ns, schedule.depth), (70_000, 32));
    assert_eq!(config.adapter.preop_timeout, Duration::from_secs(5));
    let effects: Vec<_> = load_profiles(cell(&directory)).unwrap()[0]
        .effects
        .iter()
        .map(ToString::to_string)
        .collect();
    let expected = [
        "serial = \"18446744073709551615\": a warning at start if the gateway has another",
        "firmware = [2, 7]: a warning at start if the gateway has another",
        "service_us = 40: overridden by schedule.processing_us = 70",
        "mailbox_us = 50000: sets nothing: measured at each start",
        "restart_ms = 30000: overridden by preop_timeout_ms = 5000",
        "schedule_depth = 16: overridden by schedule.depth = 32",
        "sync0_window_us = [90, 20]: overridden by schedule.processing_us = 70",
        "internal_loopback = 2: checked against node_mode",
        "sample_point_permille = 812: sets nothing: one sample point is requested",
        "wired_sample_point_permille = 800: sets nothing: one sample point is requested",
        "transceiver_ns = 162: sets nothing",
    ];
    assert_eq!(effects, expected);
}

#[test]
fn one_measurement_does_not_shorten_the_assumed_time() {
    for (profile, processing_ns) in [
        ("service_us = 40\n", 50_000),
        ("service_us = 300\n", 300_000),
        ("sync0_window_us = [0, 0]\n", 50_000),
        ("service_us = 5\nsync0_window_us = [0, 0]\n", 50_000),
        ("service_us = 40\nsync0_window_us = [20, 0]\n", 40_000),
        ("mailbox_us = 200\n", 50_000),
    ] {
        let directory = directory(CELL, profile);
        let config = load(cell(&directory)).unwrap();
        assert_eq!(config.port.gateways[0].schedule.processing_ns, processing_ns, "{profile}");
    }
}

#[test]
fn shorter_time_through_the_host_leaves_the_measured_sum() {
    let text = format!("{CELL}[gateway.schedule]\ntransport_us = 10\n");
    let directory = directory(&text, "service_us = 40\nsync0_window_us = [90, 0]\n");
    let schedule = load(cell(&directory)).unwrap().port.gateways[0].schedule;
    assert_eq!((schedule.transport_ns, schedule.processing_ns), (10_000, 110_000));
}

#[test]
fn faults_of_the_profile_have_file_key_and_allowed_values() {
    let wrong = "service_us = 2_000_000\nsync0_window_us = [1]\nserial = \"-1\"\nservce_us = 1\n";
    let directory = directory(CELL, wrong);
    let path = directory.path().join("sub/gateway.toml");
    let found = faults(&directory);
    let expected = [
        "line 1, column 14: `service_us` = 2000000 is out of range; allowed: 0 to 1000000",
        "line 2, column 19: `sync0_window_us` must be two integers from 0 to 1000000: [a, b]",
        "line 3, column 10: `serial` = \"-1\" is invalid; allowed: an unsigned number of 64 bits in \
         quotation marks",
        "line 4, column 1: unknown key `servce_us`; did you mean `service_us`?",
    ];
    let expected = expected.map(|reason| format!("`device_profile` {}: {reason}", path.display()));
    assert!(found.iter().all(|(line, column, _)| (*line, *column) == (5, 18)), "{found:?}");
    assert_eq!(found.into_iter().map(|fault| fault.2).collect::<Vec<_>>(), expected);

    std::fs::remove_file(&path).unwrap();
    let [(5, 18, reason)] = &faults(&directory)[..] else { panic!() };
    let read = format!("`device_profile`: cannot read {}: ", path.display());
    assert!(reason.starts_with(&read), "{reason}");
    let text = parse(CELL.as_bytes()).unwrap_err().to_string();
    assert!(text.contains("load the configuration from a file"), "{text}");
}

#[test]
fn node_mode_with_another_number_is_rejected() {
    let listening = CELL.replace("500_000", "500_000, node_mode = \"listen\"");
    assert!(load(cell(&directory(&listening, "internal_loopback = 2\n"))).is_ok());
    let other = directory(&listening, "internal_loopback = 1\n");
    let [(6, 8, reason)] = &faults(&other)[..] else { panic!("{:?}", faults(&other)) };
    assert!(
        reason.contains("`node_mode` of `can0` has another number on this gateway"),
        "{reason}"
    );
    assert!(
        reason.ends_with("listen-only is not available with this number; remove the channel"),
        "{reason}"
    );
    let looping = CELL.replace("500_000", "500_000, node_mode = \"internal_loopback\"");
    let other = directory(&looping, "internal_loopback = 1\n");
    let [(6, 8, reason)] = &faults(&other)[..] else { panic!("{:?}", faults(&other)) };
    assert!(reason.ends_with("use \"normal\""), "{reason}");
    assert!(load(cell(&directory(CELL, "internal_loopback = 1\n"))).is_ok());
}

#[test]
fn profile_path_is_relative_to_the_configuration() {
    let directory = directory(CELL, "schedule_depth = 8\n");
    let profile = &load_profiles(cell(&directory)).unwrap()[0];
    assert_eq!(profile.path, directory.path().join(Path::new("sub/gateway.toml")));
    assert_eq!((profile.gateway, profile.profile.schedule_depth), (0, Some(8)));
}
