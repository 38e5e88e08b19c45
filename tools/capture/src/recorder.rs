//! Writing beside the cycle: a file that is slow does not hold it up.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::MAX_PDO_BYTES;

use crate::capture::{Capture, Traffic};
use crate::error_frame::ErrorFrame;
use crate::image::ImageOrigin;

/// Packets that may wait to be written.
const QUEUE: usize = 1 << 15;
/// Images that may wait: a second of both directions at a cycle of 1 ms.
const IMAGES: usize = 2048;

/// For so long a file may stand still when there is a hurry.
const PATIENCE: Duration = Duration::from_secs(1);
/// Between two looks at what is waited for.
const LOOK: Duration = Duration::from_millis(1);

/// What waits to be written.
#[derive(Debug)]
enum Packet {
    Frame { port: usize, traffic: Traffic, frame: CanFrame },
    Error { port: usize, error: ErrorFrame },
    Image { origin: ImageOrigin, image: Vec<u8> },
}

/// What became of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recording {
    /// Packets in the file.
    pub written: u64,
    /// Packets for which there was no room, because the file is too slow.
    pub dropped: u64,
}

/// A [`Capture`] with a thread that writes it.
///
/// To hand something over takes neither memory nor a system call, but for waking the thread that
/// writes. Where there is no room it is dropped and counted, or waited for if the recorder
/// is [patient](Self::set_patient).
///
/// A recorder that goes out of scope waits until everything is written, as
/// [`finish`](Self::finish) does, but cannot tell what became of it.
#[derive(Debug)]
pub struct Recorder {
    queue: Option<SyncSender<(u64, Packet)>>,
    /// Buffers for images, back from the thread.
    free: Receiver<Vec<u8>>,
    /// A buffer whose image had no room in the queue.
    spare: Option<Vec<u8>>,
    /// None when it has been waited for.
    thread: Option<JoinHandle<io::Result<u64>>>,
    is_patient: bool,
    /// Set when nothing shall be waited for any longer.
    hurry: Arc<AtomicBool>,
    dropped: u64,
}

impl Recorder {
    /// Starts the thread on a capture; the images are of up to `image_bytes` (128 * N, or 0 where
    /// none will come). Takes all the memory that it needs.
    ///
    /// # Errors
    /// There is no thread to be had.
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

    /// A flag that ends the waiting, of a patient recorder for room and of
    /// [`finish`](Self::finish) for the file: whoever sets it when the user wants to stop is not
    /// held up by a file that stands still.
    pub fn set_hurry(&mut self, hurry: Arc<AtomicBool>) {
        self.hurry = hurry;
    }

    /// Waits for room instead of dropping, or not: for simulated time, never in a cycle of real time.
    pub fn set_patient(&mut self, is_patient: bool) {
        self.is_patient = is_patient;
    }

    /// A CAN frame, see [`Capture::frame`]. Real-time safe unless patient.
    pub fn frame(&mut self, time_ns: u64, port: usize, traffic: Traffic, frame: &CanFrame) {
        self.put(time_ns, Packet::Frame { port, traffic, frame: *frame });
    }

    /// An error frame, see [`Capture::error`]. Real-time safe unless patient.
    pub fn error(&mut self, time_ns: u64, port: usize, error: ErrorFrame) {
        self.put(time_ns, Packet::Error { port, error });
    }

    /// A process image, see [`Capture::image`]. Real-time safe unless patient. An image longer than
    /// was said at the start is dropped.
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

    /// Whether it can write no more; [`finish`](Self::finish) tells why.
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits until everything is written, no longer than a second once it is in a
    /// [hurry](Self::set_hurry).
    ///
    /// # Errors
    /// Why it could not be; [`io::ErrorKind::TimedOut`] where the file stands still.
    pub fn finish(mut self) -> io::Result<Recording> {
        if !self.has_ended() {
            let words = "it stands still, packets are missing";
            return Err(io::Error::new(io::ErrorKind::TimedOut, words));
        }
        match self.join() {
            None => Ok(Recording { written: 0, dropped: self.dropped }),
            Some(Ok(written)) => Ok(Recording { written: written?, dropped: self.dropped }),
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }

    /// Lets the thread come to its end, and waits for that; leaves it to itself where it takes too long
    /// for a hurry.
    fn has_ended(&mut self) -> bool {
        self.queue = None;
        let mut deadline = None;
        while !self.is_over() {
            if self.is_in_hurry() {
                let deadline = *deadline.get_or_insert_with(|| Instant::now() + PATIENCE);
                if Instant::now() >= deadline {
                    self.thread = None;
                    return false;
                }
            }
            std::thread::sleep(LOOK);
        }
        true
    }

    /// What the thread has come to; none where that was taken already.
    fn join(&mut self) -> Option<std::thread::Result<io::Result<u64>>> {
        self.thread.take().map(JoinHandle::join)
    }

    fn is_in_hurry(&self) -> bool {
        self.hurry.load(Ordering::Relaxed)
    }

    /// Waits a little, if it is worth it.
    fn has_waited(&self) -> bool {
        let waits = self.is_patient && !self.is_in_hurry();
        if waits {
            std::thread::sleep(LOOK);
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
                Ok(()) => return,
                // Nobody there: the thread's error tells.
                Err(TrySendError::Disconnected(_)) => return,
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
        // Nobody is left to be told.
        if self.has_ended() {
            let _ = self.join();
        }
    }
}

/// Writes what comes, and writes it out whenever nothing more waits.
fn write_all<W: Write>(
    mut capture: Capture<W>,
    packets: &Receiver<(u64, Packet)>,
    give_back: &SyncSender<Vec<u8>>,
) -> io::Result<u64> {
    let mut written = 0;
    while let Ok(first) = packets.recv() {
        for (time_ns, packet) in std::iter::once(first).chain(packets.try_iter()) {
            match packet {
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
