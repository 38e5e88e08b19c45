//! Wrong use gives one helpful message and a status other than 0.

use super::support::network::{self, GATEWAYS, MASTER};
use super::support::program::{command, fails, run, text};

#[test]
fn invalid_options_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let wrong = directory.path().join("wrong.toml");
    std::fs::write(&wrong, "[[gateway]]\nseriel = 7\n").unwrap();
    let empty = directory.path().join("empty.toml");
    std::fs::write(&empty, "").unwrap();
    let wire = ["wire", "--interface", "none"];
    let firmware = ["firmware", "--out", "/no/such/new.bin"];
    let cases: [(i32, &[&str], &str); 24] = [
        (2, &[&wire[..], &["--spin", "--rt-priority", "5"]].concat(), "cannot be used with"),
        (2, &[&wire[..], &["--spin", "--spin-us", "5"]].concat(), "cannot be used with"),
        (2, &[&wire[..], &["--spin-us", "1001"]].concat(), "0..=1000"),
        (2, &[], "Usage"),
        (2, &["wires"], "unrecognized subcommand 'wires'"),
        (2, &["wire"], "--interface"),
        (2, &["wire", "--interface"], "--interface"),
        (2, &[&wire[..], &["--no-such-flag"]].concat(), "--no-such-flag"),
        (2, &[&wire[..], &["--gateways", "0"]].concat(), "1..=64"),
        (2, &[&wire[..], &["--gateways", "two"]].concat(), "--gateways"),
        (6, &[&wire[..], &["--scenario", "ecco"]].concat(), "allowed: echo, drives, jitter"),
        (6, &[&wire[..], &["--scenario", "/no/such.toml"]].concat(), "cannot read /no/such.toml"),
        (6, &[&wire[..], &["--scenario", wrong.to_str().unwrap()]].concat(), "seriel"),
        (6, &[&wire[..], &["--scenario", empty.to_str().unwrap()]].concat(), "has no gateway"),
        (2, &[&wire[..], &["--duration=-1"]].concat(), "expected a time"),
        (2, &[&wire[..], &["--duration", "5"]].concat(), "give its unit"),
        (2, &[&wire[..], &["--rt-priority", "100"]].concat(), "1..=99"),
        (2, &["firmware"], "--version"),
        (2, &[&firmware[..], &["--version", "1.2"]].concat(), "MAJOR.MINOR.BUILD"),
        (6, &[&firmware[..], &["--version", "1.2.3"]].concat(), "cannot write /no/such/new.bin"),
        (
            6,
            &[&firmware[..], &["--version", "1.2.3", "--application", "/no/app"]].concat(),
            "cannot read /no/app",
        ),
        (6, &["man", "/dev/null/man8"], "cannot write the manual pages to /dev/null/man8"),
        (2, &["completions", "dos"], "possible values: bash"),
        (3, &wire, "network interface \"none\" does not exist; there are: "),
    ];
    for (status, arguments, text) in cases {
        let output = run(arguments);
        let message = fails(&output);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {message}");
        assert!(message.contains(text), "{arguments:?}: {message}");
    }
}

#[test]
fn unsuitable_interface_is_rejected_with_reason() {
    if !network::enter() {
        return;
    }
    let rejected = |interface: &str| {
        let message = fails(&run(&["wire", "--interface", interface]));
        assert_eq!(message.trim().lines().count(), 1, "{message}");
        message
    };
    assert!(rejected("veth2").contains("there are: lo, veth0, veth1"));
    assert!(rejected("lo").contains("loopback"));
    network::ip(&["link", "set", GATEWAYS, "down"]);
    assert!(rejected(GATEWAYS).contains("`ip link set veth1 up`"));
    let output = run(&["wire", "--interface", MASTER, "--duration", "0.01s"]);
    assert!(output.status.success());
    assert!(text(&output.stdout).contains("veth0 has no link"), "{}", text(&output.stdout));
    network::ip(&["link", "set", GATEWAYS, "up"]);
    let dump = ["wire", "--interface", GATEWAYS, "--dump", "/no/such/can.log"];
    assert!(fails(&run(&dump)).contains("cannot write /no/such/can.log"));
    let cpu = ["wire", "--interface", GATEWAYS, "--cpu", "4095"];
    let output = run(&[&cpu[..], &["--duration", "0.01s"]].concat());
    assert!(text(&output.stdout).contains("CPU 4095: not granted"), "{}", text(&output.stdout));
    let output = run(&[&cpu[..], &["--rt-required"]].concat());
    let message = fails(&output);
    assert_eq!(output.status.code(), Some(7), "{message}");
    assert!(message.contains("CPU 4095: not granted"), "{message}");
}

#[test]
fn missing_raw_socket_privilege_is_explained() {
    use std::os::unix::process::CommandExt;

    if !network::enter() {
        return;
    }
    // Another user has no capabilities; the program must be accessible to it.
    let directory = tempfile::tempdir_in("/tmp").unwrap();
    let program = directory.path().join("ecan-sim");
    std::fs::copy(env!("CARGO_BIN_EXE_ecan-sim"), &program).unwrap();
    let everyone = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(directory.path(), everyone).unwrap();
    let mut command = std::process::Command::new(&program);
    command.args(["wire", "--interface", GATEWAYS]).uid(65_534).gid(65_534);
    match command.output() {
        Ok(output) => {
            let message = fails(&output);
            assert!(message.contains("CAP_NET_RAW"), "{message}");
            assert!(message.contains("root"), "{message}");
        }
        Err(error) => println!("skipped: cannot become another user: {error}"),
    }
}

#[test]
fn help_is_available() {
    let output = command(&["wire", "--help"]).output().unwrap();
    assert!(output.status.success());
    let help = text(&output.stdout);
    for option in
        ["--interface", "--gateways", "--scenario", "--dump", "--sii-pdos", "--duration", "--quiet"]
    {
        assert!(help.contains(option), "{option}: {help}");
    }
}

#[test]
fn built_package_is_accepted_by_gateway() {
    let directory = tempfile::tempdir().unwrap();
    let (application, out) = (directory.path().join("app"), directory.path().join("new.bin"));
    std::fs::write(&application, b"application").unwrap();
    let arguments = ["firmware", "--version", "2.3.1", "--device-type", "7", "--out"];
    let files = [out.to_str().unwrap(), "--application", application.to_str().unwrap()];
    let output = run(&[&arguments[..], &files].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("version 2.3.1, 43 bytes"), "{}", text(&output.stdout));
    let package = ecan_sim::FirmwarePackage::parse(&std::fs::read(&out).unwrap()).unwrap();
    assert_eq!((package.device_type, package.version), (7, 0x0203_0001));
    assert_eq!(package.payload, b"application");
}

#[test]
fn full_disk_is_an_error_and_a_closed_pipe_is_not() {
    for arguments in [&["variants"][..], &["variants", "--json"], &["completions", "bash"]] {
        let full = std::fs::File::create("/dev/full").unwrap();
        let output = command(arguments).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(6), "{arguments:?}");
        let message = fails(&output);
        assert!(message.contains("cannot write the output: No space left"), "{message}");

        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = command(arguments).stdout(writer).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    }
}
