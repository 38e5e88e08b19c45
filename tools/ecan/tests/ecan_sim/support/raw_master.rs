//! A hand-written master: one datagram per frame, over a packet socket.

use std::num::NonZeroU32;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{LinkAddr, MsgFlags, bind, recv, send};
use rustix::net::{AddressFamily, Protocol, SocketFlags, SocketType, socket_with};

use super::program::DEADLINE;

pub const APRD: u8 = 1;
pub const APWR: u8 = 2;
pub const FPRD: u8 = 4;
pub const FPWR: u8 = 5;
pub const BRD: u8 = 7;

const MAILBOX_BYTES: usize = 128;
const MAILBOX_OUT: u16 = 0x1000;
const MAILBOX_IN: u16 = 0x1080;
/// After Ethernet and EtherCAT header.
const DATAGRAM: usize = 16;

pub struct RawMaster {
    socket: OwnedFd,
    index: u8,
    counter: u8,
}

impl RawMaster {
    pub fn open(interface: &str) -> Self {
        let entries = getifaddrs().unwrap();
        let link = |entry: nix::ifaddrs::InterfaceAddress| -> Option<LinkAddr> {
            (entry.interface_name == interface).then_some(entry.address?.as_link_addr().copied())?
        };
        let address = entries.into_iter().find_map(link).unwrap();
        let protocol = NonZeroU32::new(0x88A4_u16.to_be().into()).map(Protocol::from_raw);
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        let socket = socket_with(AddressFamily::PACKET, SocketType::RAW, flags, protocol).unwrap();
        bind(socket.as_raw_fd(), &address).unwrap();
        Self { socket, index: 0, counter: 0 }
    }

    pub fn send(&self, frame: &[u8]) {
        assert_eq!(send(self.socket.as_raw_fd(), frame, MsgFlags::empty()), Ok(frame.len()));
    }

    /// The next frame that returns before the deadline.
    pub fn receive(&self) -> Vec<u8> {
        self.receive_within(DEADLINE).expect("no frame returned")
    }

    fn receive_within(&self, time: Duration) -> Option<Vec<u8>> {
        let mut frame = vec![0; 2048];
        let start = Instant::now();
        loop {
            match recv(self.socket.as_raw_fd(), &mut frame, MsgFlags::empty()) {
                Ok(bytes) => {
                    frame.truncate(bytes);
                    return Some(frame);
                }
                Err(Errno::EAGAIN | Errno::EINTR) => {}
                Err(errno) => panic!("cannot receive: {errno}"),
            }
            let left = time.saturating_sub(start.elapsed());
            if left.is_zero() {
                return None;
            }
            let mut descriptors = [PollFd::new(self.socket.as_fd(), PollFlags::POLLIN)];
            let _ = poll(&mut descriptors, PollTimeout::try_from(left).unwrap());
        }
    }

    /// Sends frames until one returns: an interface that comes up drops them until the system has
    /// detected its link.
    pub fn wait_for_link(&self) {
        let start = Instant::now();
        loop {
            self.send(&frame(BRD, 0, 0, 0, &[0]));
            if self.receive_within(Duration::from_millis(20)).is_some() {
                return;
            }
            assert!(start.elapsed() < DEADLINE, "no frame returned");
        }
    }

    /// Sends a datagram and receives it again: its data and its working counter.
    pub fn exchange(
        &mut self,
        command: u8,
        slave: u16,
        offset: u16,
        data: &[u8],
    ) -> (Vec<u8>, u16) {
        self.index = self.index.wrapping_add(1);
        self.send(&frame(command, self.index, slave, offset, data));
        loop {
            let back = self.receive();
            if back[DATAGRAM + 1] == self.index {
                let end = DATAGRAM + 10 + data.len();
                let counter = u16::from_le_bytes([back[end], back[end + 1]]);
                return (back[DATAGRAM + 10..end].to_vec(), counter);
            }
        }
    }

    pub fn read(&mut self, command: u8, slave: u16, offset: u16, bytes: usize) -> (Vec<u8>, u16) {
        self.exchange(command, slave, offset, &vec![0; bytes])
    }

    pub fn write(&mut self, station: u16, offset: u16, data: &[u8]) {
        let (_, counter) = self.exchange(FPWR, station, offset, data);
        assert_eq!(counter, 1, "{station:#06x} {offset:#06x}");
    }

    /// Repeats a read until the data match.
    pub fn read_until(
        &mut self,
        (command, slave, offset, bytes): (u8, u16, u16, usize),
        is_wanted: impl Fn(&[u8], u16) -> bool,
    ) -> Vec<u8> {
        let start = Instant::now();
        loop {
            let (data, counter) = self.read(command, slave, offset, bytes);
            if is_wanted(&data, counter) {
                return data;
            }
            assert!(start.elapsed() < DEADLINE, "{slave:#06x} {offset:#06x}: {data:?} {counter}");
        }
    }

    /// Requests a state and waits for it.
    pub fn go_to(&mut self, station: u16, state: u8) {
        self.write(station, 0x0120, &[state, 0]);
        self.read_until((FPRD, station, 0x0130, 2), |data, counter| {
            (data[0], counter) == (state, 1)
        });
    }

    /// Sets addresses 0x1001 and following, mailboxes, PREOP.
    pub fn bring_to_preop(&mut self, position: u16) -> u16 {
        let station = 0x1001 + position;
        let (_, counter) =
            self.exchange(APWR, 0_u16.wrapping_sub(position), 0x0010, &station.to_le_bytes());
        assert_eq!(counter, 1);
        self.write(station, 0x0800, &[0x00, 0x10, 0x80, 0, 0x26, 0, 1, 0]);
        self.write(station, 0x0808, &[0x80, 0x10, 0x80, 0, 0x22, 0, 1, 0]);
        self.go_to(station, 2);
        station
    }

    /// Uploads an object of up to 4 bytes (SDO, expedited).
    pub fn upload(&mut self, station: u16, index: u16, subindex: u8) -> Vec<u8> {
        self.counter = self.counter % 7 + 1;
        let mut mail = [0; MAILBOX_BYTES];
        let [low, high] = index.to_le_bytes();
        // Ten bytes: SDO request (2 in the upper bits of the CoE header), upload.
        mail[..6].copy_from_slice(&[10, 0, 0, 0, 0, 0x03 | self.counter << 4]);
        mail[6..12].copy_from_slice(&[0, 0x20, 0x40, low, high, subindex]);
        self.write(station, MAILBOX_OUT, &mail);
        let is_full = |data: &[u8], _| data[0] & 0x08 != 0;
        self.read_until((FPRD, station, 0x080D, 1), is_full);
        let (answer, counter) = self.read(FPRD, station, MAILBOX_IN, MAILBOX_BYTES);
        assert_eq!(counter, 1);
        assert_eq!(answer[5] & 0x0F, 3, "CoE: {answer:?}");
        assert_eq!(answer[7] >> 4, 3, "SDO response: {answer:?}");
        assert_eq!(answer[9..12], [low, high, subindex], "{answer:?}");
        assert_eq!(answer[8] & 0xE3, 0x43, "upload, expedited, with its size: {answer:?}");
        let bytes = 4 - usize::from(answer[8] >> 2 & 3);
        answer[12..12 + bytes].to_vec()
    }
}

/// A frame with one datagram.
pub fn frame(command: u8, index: u8, slave: u16, offset: u16, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xFF; 6];
    frame.extend([0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x88, 0xA4]);
    frame.extend(((12 + data.len() as u16) | 1 << 12).to_le_bytes());
    frame.extend([command, index]);
    for word in [slave, offset, data.len() as u16, 0] {
        frame.extend(word.to_le_bytes());
    }
    frame.extend(data);
    frame.extend([0, 0]);
    frame
}
