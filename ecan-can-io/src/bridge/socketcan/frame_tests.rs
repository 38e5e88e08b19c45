//! Frame conversion in both directions, and the bytes of `linux/can.h`.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;

use ecan_protocol::can::{CanFrame, CanId, Dlc};
use proptest::prelude::*;
use socketcan::{CanAnyFrame, CanErrorFrame, CanFdSocket, Socket as _};

use super::{from_kernel, to_kernel};
use crate::bridge::test_frames::any_frame;

/// Converts to the kernel's frame and back from these bytes.
fn over_a_socket(frame: &CanAnyFrame) -> (Vec<u8>, CanAnyFrame) {
    let (ours, kernel) = UnixDatagram::pair().unwrap();
    let socket = CanFdSocket::from(OwnedFd::from(ours));
    socket.write_frame(frame).unwrap();
    let mut bytes = vec![0; 256];
    let length = kernel.recv(&mut bytes).unwrap();
    bytes.truncate(length);
    kernel.send(&bytes).unwrap();
    (bytes, socket.read_frame().unwrap())
}

#[test]
fn frame_bytes_match_kernel() {
    let standard = CanId::standard(0x123).unwrap();
    let extended = CanId::extended(0x1234_5678).unwrap();
    // Identifier with its flags in the host's order, length, flags, two reserved, data.
    let classic = |id: u32, length: u8, data: &[u8]| {
        let mut bytes = [&id.to_ne_bytes()[..], &[length, 0, 0, 0], data].concat();
        bytes.resize(16, 0);
        bytes
    };
    let fd = |id: u32, length: u8, flags: u8, data: &[u8]| {
        let mut bytes = [&id.to_ne_bytes()[..], &[length, flags, 0, 0], data].concat();
        bytes.resize(72, 0);
        bytes
    };
    let cases = [
        (CanFrame::classic(standard, &[0xDE, 0xAD]).unwrap(), classic(0x123, 2, &[0xDE, 0xAD])),
        (
            CanFrame::classic(extended, &[1, 2, 3, 4, 5, 6, 7, 8]).unwrap(),
            classic(0x9234_5678, 8, &[1, 2, 3, 4, 5, 6, 7, 8]),
        ),
        (
            CanFrame::remote(standard, Dlc::from_classic_len(4).unwrap()).unwrap(),
            classic(0x4000_0123, 4, &[]),
        ),
        (
            CanFrame::remote(extended, Dlc::from_classic_len(0).unwrap()).unwrap(),
            classic(0xD234_5678, 0, &[]),
        ),
        (
            CanFrame::fd(standard, &[0x11; 12], true, false).unwrap(),
            fd(0x123, 12, 0x05, &[0x11; 12]),
        ),
        (
            CanFrame::fd(extended, &[0xAA; 64], false, true).unwrap(),
            fd(0x9234_5678, 64, 0x06, &[0xAA; 64]),
        ),
        (CanFrame::fd(standard, &[], false, false).unwrap(), fd(0x123, 0, 0x04, &[])),
    ];
    for (frame, expected) in cases {
        let (bytes, back) = over_a_socket(&to_kernel(&frame).unwrap());
        assert_eq!(bytes, expected, "{frame:?}");
        assert_eq!(from_kernel(&back), Some(frame));
    }
}

#[test]
fn error_frame_is_not_forwarded() {
    let error = CanErrorFrame::new_error(0x40, &[0; 8]).unwrap();
    assert_eq!(from_kernel(&error.into()), None);
}

#[test]
fn length_without_dlc_is_padded() {
    let (ours, kernel) = UnixDatagram::pair().unwrap();
    let mut bytes = [0xFF; 72];
    bytes[..4].copy_from_slice(&1_u32.to_ne_bytes());
    bytes[4..8].copy_from_slice(&[9, 4, 0, 0]);
    kernel.send(&bytes).unwrap();
    let frame = CanFdSocket::from(OwnedFd::from(ours)).read_frame().unwrap();
    let mut data = [0; 12];
    data[..9].fill(0xFF);
    let id = CanId::standard(1).unwrap();
    assert_eq!(from_kernel(&frame), Some(CanFrame::fd(id, &data, false, false).unwrap()));
}

proptest! {
    #[test]
    fn every_frame_survives_round_trip(frame in any_frame(true)) {
        let (bytes, back) = over_a_socket(&to_kernel(&frame).unwrap());
        prop_assert_eq!(bytes.len(), if frame.is_fd() { 72 } else { 16 });
        prop_assert_eq!(from_kernel(&back), Some(frame));
    }

    #[test]
    fn any_kernel_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
        let (ours, kernel) = UnixDatagram::pair().unwrap();
        kernel.send(&bytes).unwrap();
        if let Ok(frame) = CanFdSocket::from(OwnedFd::from(ours)).read_frame() {
            // Longer input is cut: the kernel sends nothing longer to such a socket.
            prop_assert!(bytes.len() == 16 || bytes.len() >= 72);
            if let Some(frame) = from_kernel(&frame) {
                prop_assert_eq!(from_kernel(&to_kernel(&frame).unwrap()), Some(frame));
            }
        }
    }
}
