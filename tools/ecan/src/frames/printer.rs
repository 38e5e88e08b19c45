//! Output on a thread of its own, so that a slow or stalled output does not delay the cycle.

use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::log_file::{LogFileError, Writer};
use ecan_tool_support::command_line::new_file::{Existing, is_standard_stream};
use ecan_tool_support::command_line::screen::{CleanWriter, Content, Stream};

use crate::context::{Failure, Result, note};
use crate::frames::format::{LogLines, Screen, ScreenLines, TimedFrame};

/// Maximum number of queued frames: some seconds of four full channels.
const QUEUE: usize = 1 << 17;
/// Limit of a stalled output when the user stops, in polls: about a second. A pause of the machine is
/// one poll.
const MAX_LOOKS: u32 = 100;
const LOOK: Duration = Duration::from_millis(10);

#[derive(Clone, Copy, Debug)]
pub struct Destination<'a> {
    pub is_shown: bool,
    /// Path of a log; `-` is standard output.
    pub log: Option<&'a Path>,
    pub existing: Existing,
}

#[derive(Debug)]
pub struct Printer {
    queue: Option<SyncSender<TimedFrame>>,
    thread: JoinHandle<Result>,
    /// Disconnected when the thread ends; carries no data.
    end: Receiver<()>,
    interrupt: Interrupt,
    log: Option<PathBuf>,
    dropped: u64,
}

impl Printer {
    pub fn start(
        screen: Screen,
        destination: Destination<'_>,
        interrupt: &Interrupt,
    ) -> Result<Self> {
        let Destination { is_shown, log, existing } = destination;
        let writer = log.map(|path| Writer::create_with(path, existing)).transpose()?;
        let log_lines = writer.map(|writer| (writer, LogLines::new(&screen)));
        let content = if screen.is_json { Content::Json } else { Content::Text };
        let lines = is_shown.then(|| ScreenLines::new(screen));
        let print = move |timed: &Receiver<TimedFrame>| print_all(timed, lines, content, log_lines);
        let printer = Self::start_with(QUEUE, interrupt, print)?;
        Ok(Self { log: log.map(Path::to_owned), ..printer })
    }

    fn start_with(
        capacity: usize,
        interrupt: &Interrupt,
        write: impl FnOnce(&Receiver<TimedFrame>) -> Result + Send + 'static,
    ) -> Result<Self> {
        let (queue, timed) = sync_channel(capacity);
        let (until_end, end) = sync_channel::<()>(0);
        let spawned = std::thread::Builder::new().name("printer".to_owned()).spawn(move || {
            let _until_end = until_end;
            write(&timed)
        });
        let thread = spawned.map_err(Failure::of_thread)?;
        let interrupt = interrupt.clone();
        Ok(Self { queue: Some(queue), thread, end, interrupt, log: None, dropped: 0 })
    }

    /// Queues a frame. If the queue is full, real time drops the frame; simulated time waits until
    /// the user stops.
    pub fn put(&mut self, mut timed: TimedFrame, is_real_time: bool) {
        let Some(queue) = &self.queue else { return };
        while let Err(error) = queue.try_send(timed) {
            match error {
                // The error of the thread is returned by `finish`.
                TrySendError::Disconnected(_) => return,
                TrySendError::Full(_) if is_real_time || self.interrupt.is_set() => {
                    self.dropped += 1;
                    return;
                }
                TrySendError::Full(back) => timed = back,
            }
            std::thread::sleep(LOOK);
        }
    }

    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until everything is written and reports dropped frames; at most a second after the
    /// user stops.
    pub fn finish(mut self) -> Result {
        self.queue = None;
        let mut looks = 0;
        while self.end.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
            if self.interrupt.is_set() {
                looks += 1;
                if looks > MAX_LOOKS {
                    return Err(stalled(self.log));
                }
            }
        }
        match self.thread.join() {
            Ok(outcome) => outcome?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        if self.dropped > 0 {
            let message = "frames dropped: the output is too slow";
            note(format_args!("# {} {message}", self.dropped));
        }
        Ok(())
    }
}

fn stalled(log: Option<PathBuf>) -> Failure {
    let error = std::io::Error::new(ErrorKind::TimedOut, "output is stalled; frames were dropped");
    match log.filter(|path| !is_standard_stream(path)) {
        Some(path) => LogFileError::Write(path, error).into(),
        None => Failure::Output(error),
    }
}

/// Writes frames and flushes whenever the queue is empty.
fn print_all(
    timed: &Receiver<TimedFrame>,
    mut screen: Option<ScreenLines>,
    content: Content,
    mut log: Option<(Writer, LogLines)>,
) -> Result {
    let mut stream = BufWriter::new(CleanWriter::with_content(Stream::Output, content));
    while let Ok(first) = timed.recv() {
        for timed in std::iter::once(first).chain(timed.try_iter()) {
            if let Some(screen) = &mut screen {
                writeln!(stream, "{}", screen.lines(&timed))?;
            }
            if let Some((log, lines)) = &mut log {
                log.write_line(lines.line(&timed)).map_err(of_log)?;
            }
        }
        stream.flush()?;
        if let Some((log, _)) = &mut log {
            log.flush().map_err(of_log)?;
        }
    }
    Ok(())
}

/// Errors of a log on standard output are treated as output errors.
fn of_log(error: LogFileError) -> Failure {
    match error {
        LogFileError::Write(path, error) if is_standard_stream(&path) => error.into(),
        error => error.into(),
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_protocol::image::Timestamp;

    use super::*;
    use crate::frames::link::BusFrame;

    fn timed_frame() -> TimedFrame {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        let frame =
            BusFrame { gateway: 0, channel: 0, frame, timestamp: Timestamp::None, is_sent: false };
        TimedFrame { time_ns: 0, frame }
    }

    #[test]
    fn stalled_output_does_not_block_stopping() {
        let interrupt = Interrupt::default();
        let (release, held) = sync_channel::<()>(0);
        let mut printer = Printer::start_with(1, &interrupt, move |_| {
            let _ = held.recv();
            Ok(())
        })
        .unwrap();
        printer.put(timed_frame(), false);
        interrupt.request();
        // The queue is full; simulated time would wait.
        printer.put(timed_frame(), false);
        assert_eq!(printer.dropped, 1);
        let failure = printer.finish().unwrap_err();
        let message = "cannot write the output: output is stalled; frames were dropped";
        assert_eq!((failure.to_string().as_str(), failure.status()), (message, 6));
        drop(release);
    }
}
