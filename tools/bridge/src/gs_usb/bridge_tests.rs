//! The device on a socket pair; the test is the kernel.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use ecan_protocol::can::{CanFrame, CanId};

use crate::bus_event::BusEvent;
use crate::clients::ClientFrame;
use crate::gs_usb::UsbCanBridge;
use crate::rates::BusRates;

/// Timeout of a failing test.
const LIMIT: Duration = Duration::from_secs(60);

struct Kernel(UnixStream);

impl Kernel {
    fn request(&mut self, kind: u32, number: u32, words: [u32; 4], setup: [u8; 8], data: &[u8]) {
        let [direction, endpoint, first, length] = words;
        let header = [kind, number, 1, direction, endpoint, first, length, 0, 0, 0];
        let mut bytes: Vec<_> = header.iter().flat_map(|word| word.to_be_bytes()).collect();
        bytes.extend(setup);
        bytes.extend(data);
        self.0.write_all(&bytes).unwrap();
    }

    fn control(&mut self, number: u32, setup: [u8; 8], data: &[u8]) {
        let is_in = u32::from(setup[0] >> 7);
        let length = u32::from(u16::from_le_bytes([setup[6], setup[7]]));
        self.request(1, number, [is_in, 0, 0, length], setup, data);
    }

    fn frame(&mut self, number: u32, data: &[u8]) {
        self.request(1, number, [0, 2, 0, data.len() as u32], [0; 8], data);
    }

    fn wait_for_frame(&mut self, number: u32) {
        self.request(1, number, [1, 1, 0, 80], [0; 8], &[]);
    }

    /// Kind, number, status and data.
    fn response(&mut self) -> (u32, u32, i32, Vec<u8>) {
        let mut header = [0; 48];
        self.0.read_exact(&mut header).unwrap();
        let word = |at: usize| u32::from_be_bytes(header[at..at + 4].try_into().unwrap());
        let is_in = word(4) >= 1000;
        let mut data = vec![0; if is_in { word(24) as usize } else { 0 }];
        self.0.read_exact(&mut data).unwrap();
        (word(0), word(4), word(20).cast_signed(), data)
    }
}

/// A device whose interface is up. Transfers from the device have numbers from 1000.
fn device() -> (UsbCanBridge, Kernel) {
    let (ours, kernel) = UnixStream::pair().unwrap();
    kernel.set_read_timeout(Some(LIMIT)).unwrap();
    let rates = BusRates::fd(500_000, 2_000_000);
    let bridge = UsbCanBridge::over(ours, "can0", "serial".to_owned(), 64, rates).unwrap();
    let mut kernel = Kernel(kernel);
    kernel.control(1, [0x41, 2, 0, 0, 0, 0, 8, 0], &[1, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(kernel.response(), (3, 1, 0, Vec::new()));
    (bridge, kernel)
}

fn next(bridge: &UsbCanBridge) -> ClientFrame {
    let start = Instant::now();
    loop {
        if let Some(next) = bridge.clients().next_for_bus() {
            return next;
        }
        assert!(start.elapsed() < LIMIT);
        std::thread::yield_now();
    }
}

/// A frame of the driver: number of the echo, CAN ID 0x123, two bytes.
fn host_frame(echo: u8) -> Vec<u8> {
    let mut bytes = vec![echo, 0, 0, 0, 0x23, 1, 0, 0, 2, 0, 0, 0, 0xAA, 0xBB];
    bytes.resize(76, 0);
    bytes
}

#[test]
fn transmit_result_decides_about_echo() {
    let (bridge, mut kernel) = device();
    kernel.wait_for_frame(1000);
    kernel.wait_for_frame(1001);
    for number in 2..5 {
        kernel.frame(number, &host_frame(number as u8));
    }
    let sent: Vec<_> = (0..3).map(|_| next(&bridge)).collect();
    let id = CanId::standard(0x123).unwrap();
    assert_eq!(sent[0].frame, CanFrame::classic(id, &[0xAA, 0xBB]).unwrap());
    bridge.clients().confirm(&sent[0], 7_000);
    bridge.clients().fail(&sent[1], 0);
    bridge.clients().confirm(&sent[2], 8_000);
    assert_eq!(kernel.response(), (3, 2, 0, Vec::new()));
    let (_, number, status, echo) = kernel.response();
    assert_eq!(
        (number, status, &echo[..4], &echo[20..]),
        (1000, 0, &[2, 0, 0, 0][..], &[7, 0, 0, 0][..])
    );
    // No echo of the second frame, whose transfer fails.
    assert_eq!(kernel.response(), (3, 3, -32, Vec::new()));
    assert_eq!(kernel.response(), (3, 4, 0, Vec::new()));
    assert_eq!(kernel.response().3[..4], [4, 0, 0, 0]);
    let counted = bridge.clients().statistics();
    assert_eq!((counted.sent, counted.failed), (2, 1));
}

#[test]
fn frames_of_bus_wait_for_driver() {
    let (bridge, mut kernel) = device();
    let id = CanId::extended(5).unwrap();
    bridge.clients().deliver(&CanFrame::classic(id, &[1]).unwrap(), 9_000, None);
    bridge.clients().report(BusEvent::BusOff, None, 9_000);
    kernel.wait_for_frame(1000);
    let (_, number, _, frame) = kernel.response();
    assert_eq!((number, &frame[..9]), (1000, &[255, 255, 255, 255, 5, 0, 0, 0x80, 1][..]));
    // A cancelled transfer gets no frame.
    kernel.request(2, 9, [0, 0, 1001, 0], [0; 8], &[]);
    assert_eq!(kernel.response(), (4, 9, 0, Vec::new()));
    kernel.wait_for_frame(1002);
    assert_eq!(kernel.response().3[4..8], [0x40, 0, 0, 0x20]);
    kernel.wait_for_frame(1003);
    kernel.request(2, 10, [0, 0, 1003, 0], [0; 8], &[]);
    assert_eq!(kernel.response(), (4, 10, -104, Vec::new()));
    drop(bridge);
}

#[test]
fn closed_channel_fails_frames() {
    let (bridge, mut kernel) = device();
    kernel.frame(2, &host_frame(0));
    next(&bridge);
    kernel.frame(3, &host_frame(1));
    // The frame waits in the queue, or is rejected.
    bridge.clients().set_accepting(false, 0);
    assert_eq!(kernel.response(), (3, 3, -32, Vec::new()));
    kernel.frame(4, &host_frame(2));
    assert_eq!(kernel.response(), (3, 4, -32, Vec::new()));
    kernel.frame(5, &[0; 8]);
    assert_eq!(kernel.response(), (3, 5, -32, Vec::new()));
    drop(kernel);
    let start = Instant::now();
    while bridge.end().is_none() {
        assert!(start.elapsed() < LIMIT);
        std::thread::yield_now();
    }
}
