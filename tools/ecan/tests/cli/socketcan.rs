//! `ecan bridge --socketcan`: a CAN interface of Linux, where the kernel has them.

use std::io::Write as _;
use std::process::Command;

use crate::support::timed_reader::LIMIT;
use crate::support::{Running, fails};
use socketcan::id::FdFlags;
use socketcan::{
    CanAnyFrame, CanDataFrame, CanFdFrame, CanFdSocket, CanRemoteFrame, EmbeddedFrame as _,
    ExtendedId, Socket as _, StandardId,
};

/// The interface of the test, in a network namespace of its own.
const INTERFACE: &str = "vcan0";

/// Set where the test runs in it: never on the interfaces of the machine.
const NAMESPACE: &str = "ECAN_TEST_NETWORK_NAMESPACE";

/// Programs in a new network namespace, in which this user may make interfaces.
const UNSHARE: [&str; 2] = ["--map-root-user", "--net"];

#[test]
fn missing_interface_is_reported_with_remedy() {
    let message = fails(7, &["--ecrt", "sim", "bridge", "--socketcan", "nosuch0"]);
    // Having been asked, a kernel that has CAN has loaded it.
    let protocols = std::fs::read_to_string("/proc/net/protocols").unwrap();
    let expected = match protocols.lines().any(|line| line.starts_with("CAN_RAW")) {
        true => "ecan: cannot create the CAN interface nosuch0: ",
        false => "ecan: this kernel has no SocketCAN (",
    };
    assert!(message.starts_with(expected), "{message}");
    let remedy = "modprobe vcan; ip link add dev nosuch0 mtu 72 type vcan; ip link set nosuch0 up";
    assert!(message.contains(remedy), "{message}");
    assert_eq!(message.lines().count(), 1);
}

#[test]
fn invalid_interface_names_are_rejected() {
    for name in ["", "a/b", "sixteen_and_more", "a b"] {
        let message = fails(2, &["--ecrt", "sim", "bridge", "--socketcan", name]);
        assert!(message.contains("expected the name of a network interface"), "{message}");
    }
}

/// Returns whether a virtual CAN interface can be made here; says why where it cannot.
fn has_vcan() -> bool {
    let link = ["ip", "link", "add", "dev", INTERFACE, "type", "vcan"];
    let made = Command::new("unshare").args(UNSHARE).args(link).output();
    let reason = match made {
        Ok(output) if output.status.success() => return true,
        Ok(output) => String::from_utf8_lossy(&output.stderr).trim().to_owned(),
        Err(error) => format!("unshare: {error}"),
    };
    // Past the harness, which would keep it to itself.
    let _ = writeln!(std::io::stderr(), "skipped: no virtual CAN interface can be made ({reason})");
    false
}

#[test]
fn interface_and_channel_exchange_frames() {
    if !has_vcan() {
        return;
    }
    let output = Command::new("unshare")
        .args(UNSHARE)
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", "socketcan::in_a_network_namespace", "--ignored", "--nocapture"])
        .env(NAMESPACE, "")
        .output()
        .unwrap();
    let texts =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(output.status.success() && texts[0].contains("1 passed"), "{}", texts.concat());
}

fn ip(arguments: &[&str]) {
    assert!(Command::new("ip").args(arguments).status().unwrap().success(), "{arguments:?}");
}

#[test]
#[ignore = "run by the test above in a network namespace of its own"]
fn in_a_network_namespace() {
    if std::env::var_os(NAMESPACE).is_none() {
        return;
    }
    ip(&["link", "add", "dev", INTERFACE, "mtu", "72", "type", "vcan"]);
    let bridge = ["--ecrt", "sim", "bridge", "--socketcan"];
    let message = fails(7, &[&bridge[..], &[INTERFACE]].concat());
    assert!(message.contains(&format!("the CAN interface {INTERFACE} is down: ip link set")));
    let message = fails(7, &[&bridge[..], &["lo"]].concat());
    assert!(message.starts_with("ecan: lo is not a CAN interface"), "{message}");
    ip(&["link", "set", INTERFACE, "up"]);

    let options = [INTERFACE, "--channel", "1", "--data-bitrate", "2000000"];
    let mut bridge = Running::start(&[&bridge[..], &options].concat());
    assert_eq!(bridge.line(), format!("socketcan bridge at {INTERFACE} on can1"));
    let peer = CanFdSocket::open(INTERFACE).unwrap();
    peer.set_read_timeout(LIMIT).unwrap();
    let standard = StandardId::new(0x123).unwrap();
    let extended = ExtendedId::new(0x1234_5678).unwrap();
    let frames: [CanAnyFrame; 5] = [
        CanDataFrame::new(standard, &[0xDE, 0xAD]).unwrap().into(),
        CanDataFrame::new(extended, &[1, 2, 3, 4, 5, 6, 7, 8]).unwrap().into(),
        CanRemoteFrame::new_remote(extended, 2).unwrap().into(),
        CanFdFrame::with_flags(standard, &[0x11; 12], FdFlags::BRS).unwrap().into(),
        CanFdFrame::with_flags(extended, &[0xAA; 64], FdFlags::empty()).unwrap().into(),
    ];
    // The node on the channel echoes each frame once; a frame of the bridge that came back to it
    // would go round for ever.
    for _ in 0..3 {
        for frame in &frames {
            peer.write_frame(frame).unwrap();
            assert_eq!(format!("{:?}", peer.read_frame().unwrap()), format!("{frame:?}"));
        }
    }
    let errors = bridge.end();
    assert!(!errors.contains('#'), "{errors}");
}
