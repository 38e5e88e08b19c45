//! The recorder writes what a capture would, gives buffers back, counts what it drops.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};

use ecan_can_io::capture::{Capture, ErrorFrame, ImageOrigin, Recorder, Recording, Traffic};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;

const ORIGIN: ImageOrigin = ImageOrigin { slave: 0, direction: Direction::TxPdo, profile: PROFILE };
const PROFILE: PdoProfile = PdoProfile {
    multiplier: 1,
    channel_mask: 0x0F,
    profile: ecan_protocol::image::EncapsulationProfile::Compact,
    budget: ecan_protocol::image::BudgetPolicy::Balanced,
    options: ecan_protocol::image::OptionFlags::NONE,
};

/// A file that can be looked at when its writer is gone.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file that stands still behind its beginning until it is let go.
struct Gated {
    free_bytes: usize,
    is_stuck: Sender<()>,
    go: Receiver<()>,
}

impl Write for Gated {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.free_bytes < bytes.len() {
            let _ = self.is_stuck.send(());
            let _ = self.go.recv();
            self.free_bytes = usize::MAX;
        }
        self.free_bytes -= bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Debug)]
struct Full;

impl Write for Full {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(io::ErrorKind::StorageFull.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn frame() -> CanFrame {
    CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2]).unwrap()
}

#[test]
fn recorder_writes_more_images_than_buffers() {
    let images = 5000;
    let error = ErrorFrame::new(0x40, [0; 8]);
    let mut capture = Capture::new(Vec::new(), "test").unwrap();
    let file = Shared::default();
    let mut recorder = Recorder::start(Capture::new(file.clone(), "test").unwrap(), 128).unwrap();
    recorder.set_patient(true);
    for time_ns in 0..images {
        let image = [time_ns as u8; 128];
        capture.frame(time_ns, 1, Traffic::Sent, &frame()).unwrap();
        capture.error(time_ns, 1, &error).unwrap();
        capture.image(time_ns, &ORIGIN, &image).unwrap();
        recorder.frame(time_ns, 1, Traffic::Sent, &frame());
        recorder.error(time_ns, 1, error);
        recorder.image(time_ns, ORIGIN, &image);
    }
    let recording = recorder.finish().unwrap();
    assert_eq!(recording, Recording { written: 3 * images, dropped: 0 });
    assert!(*file.0.lock().unwrap() == capture.finish().unwrap());
}

#[test]
fn dropped_recorder_has_written_everything() {
    let mut capture = Capture::new(Vec::new(), "test").unwrap();
    let file = Shared::default();
    let mut recorder = Recorder::start(Capture::new(file.clone(), "test").unwrap(), 0).unwrap();
    for time_ns in 0..1000 {
        capture.frame(time_ns, 0, Traffic::Received, &frame()).unwrap();
        recorder.frame(time_ns, 0, Traffic::Received, &frame());
    }
    drop(recorder);
    assert!(*file.0.lock().unwrap() == capture.finish().unwrap());
}

#[test]
fn stalled_file_drops_and_counts() {
    let (is_stuck, stuck) = channel();
    let (let_go, go) = channel();
    let mut probe = Shared::default();
    Capture::new(&mut probe, "test").unwrap();
    let free_bytes = probe.0.lock().unwrap().len();
    let file = Gated { free_bytes, is_stuck, go };
    let mut recorder = Recorder::start(Capture::new(file, "test").unwrap(), 128).unwrap();
    let offered = 100_000;
    for time_ns in 0..offered / 2 {
        recorder.frame(time_ns, 0, Traffic::Received, &frame());
        recorder.image(time_ns, ORIGIN, &[0; 128]);
    }
    stuck.recv().unwrap();
    assert!(!recorder.is_over());
    let_go.send(()).unwrap();
    let Recording { written, dropped } = recorder.finish().unwrap();
    assert_eq!(written + dropped, offered);
    assert!(dropped > 0 && written > 2048, "{written} {dropped}");
}

#[test]
fn stalled_file_does_not_block_a_hurry() {
    let (is_stuck, stuck) = channel();
    let (let_go, go) = channel::<()>();
    let mut probe = Shared::default();
    Capture::new(&mut probe, "test").unwrap();
    let free_bytes = probe.0.lock().unwrap().len();
    let file = Gated { free_bytes, is_stuck, go };
    let mut recorder = Recorder::start(Capture::new(file, "test").unwrap(), 128).unwrap();
    let hurry = Arc::new(AtomicBool::new(false));
    recorder.set_hurry(hurry.clone());
    recorder.set_patient(true);
    recorder.frame(0, 0, Traffic::Received, &frame());
    stuck.recv().unwrap();
    hurry.store(true, Ordering::Relaxed);
    // More than there is room for.
    for time_ns in 0..100_000 {
        recorder.frame(time_ns, 0, Traffic::Received, &frame());
        recorder.image(time_ns, ORIGIN, &[0; 128]);
    }
    assert_eq!(recorder.finish().unwrap_err().kind(), io::ErrorKind::TimedOut);
    drop(let_go);
}

#[test]
fn oversized_image_is_dropped() {
    let capture = Capture::new(Shared::default(), "test").unwrap();
    let mut recorder = Recorder::start(capture, 128).unwrap();
    recorder.image(0, ORIGIN, &[0; 256]);
    recorder.image(0, ORIGIN, &[0; 128]);
    assert_eq!(recorder.finish().unwrap(), Recording { written: 1, dropped: 1 });
    let capture = Capture::new(Shared::default(), "test").unwrap();
    let mut recorder = Recorder::start(capture, 0).unwrap();
    recorder.image(0, ORIGIN, &[0; 128]);
    assert_eq!(recorder.finish().unwrap(), Recording { written: 0, dropped: 1 });
}

#[test]
fn write_error_is_returned() {
    let error = Capture::new(Full, "test").unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    let file = io::BufWriter::with_capacity(1 << 16, Full);
    let mut recorder = Recorder::start(Capture::new(file, "test").unwrap(), 128).unwrap();
    recorder.set_patient(true);
    // More than the queue holds, and more than the buffers: nobody waits for a thread that is gone.
    for time_ns in 0..50_000 {
        recorder.frame(time_ns, 0, Traffic::Received, &frame());
        recorder.image(time_ns, ORIGIN, &[0; 128]);
    }
    assert_eq!(recorder.finish().unwrap_err().kind(), io::ErrorKind::StorageFull);
}
