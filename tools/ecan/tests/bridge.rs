//! `ecan bridge` as other programs see it.
#![allow(missing_docs)]

mod support;

use std::io::Write as _;

use support::client::Client;
use support::deadline::Deadlined;
use support::{Running, fails};

/// Waits for a frame as socketcand writes it, without its time.
fn expect_frame(client: &mut Client, id: &str, data: &str) {
    let text = client.hear_through('>');
    let words: Vec<_> = text.split(' ').collect();
    assert_eq!((words[1], words[2], words[4]), ("frame", id, data), "{text}");
}

/// The address in a line as "slcan bridge at 127.0.0.1:1234 on can1".
fn address(line: &str, protocol: &str, channel: &str) -> String {
    let words: Vec<_> = line.split(' ').collect();
    assert_eq!((words[0], words[5]), (protocol, channel), "{line}");
    assert!(words[3].starts_with("127.0.0.1:"), "{line}");
    words[3].to_owned()
}

#[test]
fn clients_of_both_protocols_meet_on_the_channel() {
    let mut bridge =
        Running::start(&["--ecrt", "sim", "bridge", "--channel", "1", "--slcan", "--socketcand"]);
    let slcan = address(&bridge.line(), "slcan", "can1");
    let socketcand = address(&bridge.line(), "socketcand", "can1");
    let mut slcan = Client::connect(&slcan);
    slcan.say("S6\rO\r");
    slcan.expect("\r\r");
    let mut socketcand = Client::connect(&socketcand);
    socketcand.expect("< hi >");
    socketcand.say("< open can1 >");
    socketcand.expect("< ok >");
    socketcand.say("< rawmode >");
    socketcand.expect("< ok >");

    // The sender hears the node's echo, the others its frame too.
    slcan.say("t1232AABB\r");
    slcan.expect("z\rt1232AABB\r");
    expect_frame(&mut socketcand, "123", "AABB");
    expect_frame(&mut socketcand, "123", "AABB");
    socketcand.say("< send 00000045 1 7F >");
    expect_frame(&mut socketcand, "00000045", "7F");
    slcan.expect("T0000004517F\rT0000004517F\r");

    bridge.terminate();
    let (status, errors) = bridge.wait();
    assert_eq!(status, Some(0), "{errors}");
    assert!(!errors.contains('#'), "{errors}");
}

#[test]
fn can_fd_goes_over_slcan_and_bit_rates_are_those_of_the_channel() {
    let mut bridge =
        Running::start(&["--ecrt", "sim", "bridge", "--data-bitrate", "2000000", "--json"]);
    let mut text = String::new();
    while !text.ends_with(']') {
        let line = bridge.line();
        assert_ne!(line, "", "{text}");
        text.push_str(&line);
    }
    let places: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&places[0]["protocol"], &places[0]["channel"]), (&"slcan".into(), &0.into()));
    let address = places[0]["address"].as_str().unwrap();
    let mut client = Client::connect(address);
    client.say("S6\rY2\rO\r");
    client.expect("\r\r\r");
    client.say("b1239112233445566778899AABBCC\r");
    client.expect("z\rb1239112233445566778899AABBCC\r");
    // Who names another bit rate is refused.
    let mut other = Client::connect(address);
    other.say("S8\rO\rt1230\r");
    other.expect("\r\r\x07");
    // What did not go through is told at the end.
    bridge.terminate();
    let (status, errors) = bridge.wait();
    assert_eq!(status, Some(0), "{errors}");
    let told =
        format!("# slcan bridge at {address}: 1 frames for the bus were refused: the channel");
    assert_eq!(errors.matches(&told).count(), 1, "{errors}");
    assert_eq!(errors.matches('#').count(), 1, "{errors}");
}

#[test]
fn a_terminal_is_a_serial_adapter() {
    let directory = tempfile::tempdir().unwrap();
    let link = directory.path().join("can0");
    let path = link.display().to_string();
    let mut bridge = Running::start(&["--ecrt", "sim", "bridge", "--pty", &path]);
    assert_eq!(bridge.line(), format!("slcan bridge at {path} on can0"));
    // One program after the other, each finding the terminal as a serial port.
    for id in ["123", "124"] {
        let mut port = std::fs::File::options().read(true).write(true).open(&link).unwrap();
        port.write_all(format!("C\rS6\rO\rt{id}2AABB\r").as_bytes()).unwrap();
        let expected = format!("\r\r\rz\rt{id}2AABB\r");
        let answer = Deadlined::new(port.try_clone().unwrap()).bytes(expected.len());
        assert_eq!(String::from_utf8_lossy(&answer), expected);
    }
    bridge.terminate();
    assert_eq!(bridge.wait().0, Some(0));
    assert!(std::fs::symlink_metadata(&link).is_err(), "the link goes with the bridge");
}

#[test]
fn misuse_is_named_and_told_by_the_status() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let cases: [(i32, &[&str], &str); 5] = [
        (2, &["bridge", "--slcan", "localhost"], "expected a port, an IP address"),
        (2, &["bridge", "--channel", "all"], "expected a channel, 0 to 3"),
        (2, &["bridge", "--max-clients", "0"], "0 is not in 1..=1000"),
        (6, &["--ecrt", "sim", "bridge", "--pty", "/dev/null"], "cannot make the link /dev/null"),
        (6, &["--ecrt", "sim", "bridge", "--slcan", &port], "cannot listen on 127.0.0.1:"),
    ];
    for (status, arguments, words) in cases {
        let message = fails(status, arguments);
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
}
