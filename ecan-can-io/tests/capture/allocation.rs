//! Nothing is allocated for a packet: not where it is handed over, not where it is written.

use ecan_can_io::capture::{Capture, ErrorFrame, ImageOrigin, Recorder, Traffic};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_test_support::allocations;

fn parts() -> (CanFrame, ErrorFrame, ImageOrigin, [u8; 1024]) {
    let frame = CanFrame::fd(CanId::standard(0x123).unwrap(), &[1; 64], true, false).unwrap();
    let profile = PdoProfile::default();
    let origin = ImageOrigin { slave: 0, direction: Direction::TxPdo, profile };
    (frame, ErrorFrame::new(0x40, [0; 8]), origin, [0; 1024])
}

#[test]
fn recording_does_not_allocate() {
    let (frame, error, origin, image) = parts();
    let capture = Capture::new(std::io::sink(), "test").unwrap();
    let mut recorder = Recorder::start(capture, image.len()).unwrap();
    let before = allocations();
    // More than there is room for: dropping does not allocate either.
    for time_ns in 0..50_000 {
        recorder.frame(time_ns, 0, Traffic::Received, &frame);
        recorder.error(time_ns, 0, error);
        recorder.image(time_ns, origin, &image);
    }
    assert_eq!(allocations(), before);
    recorder.finish().unwrap();
}

#[test]
fn writing_allocates_only_for_new_interfaces() {
    let (frame, error, origin, image) = parts();
    let mut capture = Capture::new(std::io::sink(), "test").unwrap();
    let mut round = |time_ns| {
        capture.frame(time_ns, 0, Traffic::Received, &frame).unwrap();
        capture.error(time_ns, 0, &error).unwrap();
        capture.image(time_ns, &origin, &image).unwrap();
    };
    let before = allocations();
    round(0);
    let after_first = allocations();
    assert!(after_first > before);
    (1..1000).for_each(round);
    assert_eq!(allocations(), after_first);
}
