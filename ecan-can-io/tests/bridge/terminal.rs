//! Programs on the pseudo-terminal, one after the other.

use std::fs::File;
use std::io::{ErrorKind, Read, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::time::{Duration, Instant};

use ecan_can_io::bridge::SerialBridge;
use ecan_protocol::can::{CanFrame, CanId};
use rustix::fs::OFlags;

const TIMEOUT: Duration = Duration::from_secs(60);

struct Port(File);

impl Port {
    fn open(bridge: &SerialBridge) -> Self {
        // A port that never answers must not block the test.
        let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed();
        let mut options = File::options();
        Self(options.read(true).write(true).custom_flags(flags).open(bridge.path()).unwrap())
    }

    fn say(&mut self, text: &str) {
        self.0.write_all(text.as_bytes()).unwrap();
    }

    fn expect(&mut self, text: &str) {
        let mut received = Vec::new();
        let begun = Instant::now();
        while received.len() < text.len() {
            let mut byte = [0];
            match self.0.read(&mut byte) {
                Ok(count) => received.extend(&byte[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::yield_now(),
                Err(error) => panic!("{error}"),
            }
            assert!(begun.elapsed() < TIMEOUT, "only {:?}", String::from_utf8_lossy(&received));
        }
        assert_eq!(String::from_utf8_lossy(&received), text);
    }
}

fn wait_for(what: &str, done: impl Fn() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < TIMEOUT, "{what}");
        std::thread::yield_now();
    }
}

#[test]
fn next_program_gets_fresh_session() {
    let bridge = SerialBridge::open(4096).unwrap();
    let clients = bridge.clients();
    assert!(!clients.is_any_connected());
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[0; 8]).unwrap();
    for round in 1..=3 {
        let mut port = Port::open(&bridge);
        port.say("V\rO\r");
        port.expect("V1010\r\r");
        // It does not read: the terminal fills, then the queue.
        let dropped = || clients.statistics().dropped_to_clients;
        let before = dropped();
        wait_for("the queue is full", || {
            clients.deliver(&frame, 0, None);
            dropped() > before
        });
        // As a program that is killed.
        drop(port);
        wait_for("its end is seen", || !clients.is_any_connected());
        assert_eq!(clients.statistics().connections, round);
    }
    // Closed as a new adapter, and commands work.
    let mut port = Port::open(&bridge);
    port.say("t1230\rV\r");
    port.expect("\x07V1010\r");
    port.say("O\r");
    port.expect("\r");
    clients.deliver(&frame, 0, None);
    port.expect("t12380000000000000000\r");
}

/// Output that a program wrote before it ended is processed.
#[test]
fn last_output_of_program_is_processed() {
    let bridge = SerialBridge::open(16).unwrap();
    let mut port = Port::open(&bridge);
    port.say("O\rt1230\rt1240\r");
    drop(port);
    let mut frames = Vec::new();
    let begun = Instant::now();
    while frames.len() < 2 {
        frames.extend(bridge.clients().next_for_bus().map(|next| next.frame.id().raw()));
        assert!(begun.elapsed() < TIMEOUT, "{frames:X?}");
    }
    assert_eq!(frames, [0x123, 0x124]);
}

#[test]
fn dropped_terminal_does_not_wait_for_program() {
    let bridge = SerialBridge::open(16).unwrap();
    let mut port = Port::open(&bridge);
    port.say("V\r");
    port.expect("V1010\r");
    drop(bridge);
    // A hangup, as when an adapter is unplugged.
    assert!(port.0.write_all(b"V\r").is_err());
}
