//! Recording on a thread of its own, so that a slow file does not delay the cycle.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::MAX_PDO_BYTES;

use super::{Capture, ErrorFrame, ImageOrigin, Traffic};

const QUEUE: usize = 1 << 15;
/// Maximum number of queued images: one second of both directions at a cycle of 1 ms.
const IMAGES: usize = 2048;

/// Limit of a stalled file in a hurry, in polls: about a second. A pause of the machine is one poll.
const MAX_HURRIED_POLLS: u32 = 1000;
const POLL_INTERVAL: Duration = Duration::from_millis(1);

#[derive(Debug)]
enum Packet {
    Frame {
        port: usize,
        traffic: Traffic,
        frame: CanFrame,
    },
    Error {
        port: usize,
        error: ErrorFrame,
    },
    Image {
        origin: ImageOrigin,
        image: Vec<u8>,
    },
    /// Images before the next packet, in which frames may have been.
    LostImages(u64),
}

/// Result of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recording {
    /// Number of packets in the file.
    pub written: u64,
    /// Number of packets dropped because the file was too slow.
    pub dropped: u64,
}

/// A [`Capture`] with a thread that writes it.
///
/// Recording does not allocate and makes no system call except to wake the thread. If the queue is
/// full, a packet is dropped and counted, or waited for if the recorder is
/// [patient](Self::set_patient).
///
/// Dropping a recorder waits as [`finish`](Self::finish) does, without a result.
#[derive(Debug)]
pub struct Recorder {
    queue: Option<SyncSender<(u64, Packet)>>,
    /// Free image buffers, returned by the thread.
    free: Receiver<Vec<u8>>,
    /// Buffer of an image that did not fit into the queue.
    spare: Option<Vec<u8>>,
    /// `None` after it was joined.
    thread: Option<JoinHandle<io::Result<u64>>>,
    is_patient: bool,
    /// Set to stop waiting.
    hurry: Arc<AtomicBool>,
    dropped: u64,
}

impl Recorder {
    /// Starts the thread for images of up to `image_bytes` (128 * N, or 0 without images).
    /// Allocates all memory.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start<W: Write + Send + 'static>(
        capture: Capture<W>,
        image_bytes: usize,
    ) -> io::Result<Self> {
        let (queue, packets) = sync_channel(QUEUE);
        let (give_back, free) = sync_channel(IMAGES);
        if image_bytes > 0 {
            for _ in 0..IMAGES {
                let _ = give_back.try_send(Vec::with_capacity(image_bytes.min(MAX_PDO_BYTES)));
            }
        }
        let thread = std::thread::Builder::new()
            .name("capture".to_owned())
            .spawn(move || write_all(capture, &packets, &give_back))?;
        let (queue, thread) = (Some(queue), Some(thread));
        let hurry = Arc::default();
        Ok(Self { queue, free, spare: None, thread, is_patient: false, hurry, dropped: 0 })
    }

    /// Sets a flag that stops waiting for queue space and limits [`finish`](Self::finish), so that
    /// a stalled file does not block a user who wants to stop.
    pub fn set_hurry(&mut self, hurry: Arc<AtomicBool>) {
        self.hurry = hurry;
    }

    /// Selects waiting (simulated time) or dropping (real time) if the queue is full.
    pub fn set_patient(&mut self, is_patient: bool) {
        self.is_patient = is_patient;
    }

    /// Records a CAN frame, see [`Capture::frame`]. Real-time safe unless patient.
    pub fn frame(&mut self, time_ns: u64, port: usize, traffic: Traffic, frame: &CanFrame) {
        self.put(time_ns, Packet::Frame { port, traffic, frame: *frame });
    }

    /// Records a gap before the next packet: images of a gateway that were lost or incomplete. Real-time safe unless
    /// patient.
    pub fn lost_images(&mut self, images: u64) {
        self.put(0, Packet::LostImages(images));
    }

    /// Records an error frame, see [`Capture::error`]. Real-time safe unless patient.
    pub fn error(&mut self, time_ns: u64, port: usize, error: ErrorFrame) {
        self.put(time_ns, Packet::Error { port, error });
    }

    /// Records a PDO image, see [`Capture::image`]. Real-time safe unless patient. Drops an image
    /// longer than `image_bytes`.
    pub fn image(&mut self, time_ns: u64, origin: ImageOrigin, image: &[u8]) {
        let buffer = match self.spare.take() {
            None => self.free_buffer(),
            spare => spare,
        };
        match buffer {
            Some(mut buffer) if buffer.capacity() >= image.len() => {
                buffer.clear();
                buffer.extend_from_slice(image);
                self.put(time_ns, Packet::Image { origin, image: buffer });
            }
            unused => {
                self.spare = unused;
                self.dropped += 1;
            }
        }
    }

    /// Returns whether the thread has ended; [`finish`](Self::finish) returns the reason.
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits until everything is written, at most one second in a [hurry](Self::set_hurry).
    ///
    /// # Errors
    /// Error of the file; [`io::ErrorKind::TimedOut`] if it is stalled.
    pub fn finish(mut self) -> io::Result<Recording> {
        if !self.has_ended() {
            let text = "output is stalled; packets were dropped";
            return Err(io::Error::new(io::ErrorKind::TimedOut, text));
        }
        match self.join() {
            None => Ok(Recording { written: 0, dropped: self.dropped }),
            Some(Ok(written)) => Ok(Recording { written: written?, dropped: self.dropped }),
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }

    /// Ends the thread and waits for it; detaches it at the limit in a hurry.
    fn has_ended(&mut self) -> bool {
        self.queue = None;
        let mut polls = 0;
        while !self.is_over() {
            if self.is_in_hurry() {
                polls += 1;
                if polls > MAX_HURRIED_POLLS {
                    self.thread = None;
                    return false;
                }
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        true
    }

    /// Result of the thread; `None` if it was taken before.
    fn join(&mut self) -> Option<std::thread::Result<io::Result<u64>>> {
        self.thread.take().map(JoinHandle::join)
    }

    fn is_in_hurry(&self) -> bool {
        self.hurry.load(Ordering::Relaxed)
    }

    /// Waits for a short time if patient.
    fn has_waited(&self) -> bool {
        let waits = self.is_patient && !self.is_in_hurry();
        if waits {
            std::thread::sleep(POLL_INTERVAL);
        }
        waits
    }

    fn free_buffer(&self) -> Option<Vec<u8>> {
        loop {
            match self.free.try_recv() {
                Err(TryRecvError::Empty) if self.has_waited() => {}
                buffer => return buffer.ok(),
            }
        }
    }

    fn put(&mut self, time_ns: u64, packet: Packet) {
        let Some(queue) = &self.queue else { return };
        let mut waiting = (time_ns, packet);
        loop {
            match queue.try_send(waiting) {
                // The error of the thread is returned by `finish`.
                Ok(()) | Err(TrySendError::Disconnected(_)) => return,
                Err(TrySendError::Full(back)) => waiting = back,
            }
            if !self.has_waited() {
                break;
            }
        }
        self.dropped += 1;
        if let (_, Packet::Image { image, .. }) = waiting {
            self.spare = Some(image);
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // The result cannot be reported.
        if self.has_ended() {
            let _ = self.join();
        }
    }
}

/// Writes packets and flushes whenever the queue is empty.
fn write_all<W: Write>(
    mut capture: Capture<W>,
    packets: &Receiver<(u64, Packet)>,
    give_back: &SyncSender<Vec<u8>>,
) -> io::Result<u64> {
    let mut written = 0;
    while let Ok(first) = packets.recv() {
        for (time_ns, packet) in std::iter::once(first).chain(packets.try_iter()) {
            match packet {
                Packet::LostImages(images) => {
                    capture.gap(&lost_images(images));
                    continue;
                }
                Packet::Frame { port, traffic, frame } => {
                    capture.frame(time_ns, port, traffic, &frame)?;
                }
                Packet::Error { port, error } => capture.error(time_ns, port, &error)?,
                Packet::Image { origin, image } => {
                    capture.image(time_ns, &origin, &image)?;
                    let _ = give_back.try_send(image);
                }
            }
            written += 1;
        }
        capture.flush()?;
    }
    capture.finish()?;
    Ok(written)
}

/// Text of a gap in captures, logs and on screens.
pub fn lost_images(images: u64) -> String {
    let plural = if images == 1 { "" } else { "s" };
    format!("{images} image{plural} of the gateway lost or incomplete, frames may be missing")
}
