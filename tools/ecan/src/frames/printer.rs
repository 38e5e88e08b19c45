//! Writing beside the cycle: an output that is slow, or stands still, does not hold it up.

use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::log_file::{LogFileError, Writer};
use ecan_command_line::new_file::{Existing, is_standard_stream};

use crate::failure::Failure;
use crate::frames::format::{LogLines, Screen, ScreenLines, TimedFrame};
use crate::output::Output;

/// Frames that may wait to be written: some seconds of four full channels.
const QUEUE: usize = 1 << 17;
/// For so long an output may stand still once the user wants to stop.
const PATIENCE: Duration = Duration::from_secs(1);
/// Between two looks at the interrupt while something is waited for.
const LOOK: Duration = Duration::from_millis(10);

/// Where to.
#[derive(Clone, Copy, Debug)]
pub struct Destination<'a> {
    /// On the screen.
    pub is_shown: bool,
    /// Into a log; `-` is standard output.
    pub log: Option<&'a Path>,
    /// What becomes of a log that is there.
    pub existing: Existing,
}

/// The thread that writes.
#[derive(Debug)]
pub struct Printer {
    queue: Option<SyncSender<TimedFrame>>,
    thread: JoinHandle<Result<(), Failure>>,
    /// Nothing comes from it; it is cut when the thread is at its end.
    end: Receiver<()>,
    interrupt: Interrupt,
    log: Option<PathBuf>,
    dropped: u64,
}

impl Printer {
    /// Starts it; creates the log.
    pub fn start(
        screen: Screen,
        destination: Destination<'_>,
        interrupt: &Interrupt,
    ) -> Result<Self, Failure> {
        let Destination { is_shown, log, existing } = destination;
        let writer = log.map(|path| Writer::create_with(path, existing)).transpose()?;
        let lines = is_shown.then(|| ScreenLines::new(screen));
        let log_lines = writer.map(|writer| (writer, LogLines::new(screen)));
        let print = move |heard: &Receiver<TimedFrame>| print_all(heard, lines, log_lines);
        let printer = Self::start_with(QUEUE, interrupt, print)?;
        Ok(Self { log: log.map(Path::to_owned), ..printer })
    }

    fn start_with(
        capacity: usize,
        interrupt: &Interrupt,
        write: impl FnOnce(&Receiver<TimedFrame>) -> Result<(), Failure> + Send + 'static,
    ) -> Result<Self, Failure> {
        let (queue, heard) = sync_channel(capacity);
        let (until_end, end) = sync_channel::<()>(0);
        let spawned = std::thread::Builder::new().name("printer".to_owned()).spawn(move || {
            let _until_end = until_end;
            write(&heard)
        });
        let thread = spawned.map_err(Failure::of_thread)?;
        let interrupt = interrupt.clone();
        Ok(Self { queue: Some(queue), thread, end, interrupt, log: None, dropped: 0 })
    }

    /// Hands a frame over. In real time one for which there is no room is dropped; simulated time
    /// can wait, until the user wants to stop.
    pub fn put(&mut self, mut heard: TimedFrame, is_real_time: bool) {
        let Some(queue) = &self.queue else { return };
        while let Err(error) = queue.try_send(heard) {
            match error {
                // The thread's error tells.
                TrySendError::Disconnected(_) => return,
                TrySendError::Full(_) if is_real_time || self.interrupt.is_set() => {
                    self.dropped += 1;
                    return;
                }
                TrySendError::Full(back) => heard = back,
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Whether it can write no more.
    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until everything is written; says what was dropped. When the user wants to stop it waits
    /// no longer than a second.
    pub fn finish(mut self, output: &Output) -> Result<(), Failure> {
        self.queue = None;
        let mut deadline = None;
        while self.end.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
            if self.interrupt.is_set() {
                let deadline = *deadline.get_or_insert_with(|| Instant::now() + PATIENCE);
                if Instant::now() >= deadline {
                    return Err(stands_still(self.log));
                }
            }
        }
        match self.thread.join() {
            Ok(outcome) => outcome?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        if self.dropped > 0 {
            let words = "frames were not written: the output is too slow";
            output.note(format_args!("# {} {words}", self.dropped));
        }
        Ok(())
    }
}

/// That nobody takes what is written.
fn stands_still(log: Option<PathBuf>) -> Failure {
    let error = std::io::Error::new(ErrorKind::TimedOut, "it stands still, frames are missing");
    match log.filter(|path| !is_standard_stream(path)) {
        Some(path) => LogFileError::Write { path, error }.into(),
        None => Failure::Output(error),
    }
}

/// Writes what comes, and writes it out whenever nothing more waits.
fn print_all(
    heard: &Receiver<TimedFrame>,
    mut screen: Option<ScreenLines>,
    mut log: Option<(Writer, LogLines)>,
) -> Result<(), Failure> {
    let mut stream = BufWriter::new(std::io::stdout());
    while let Ok(first) = heard.recv() {
        for heard in std::iter::once(first).chain(heard.try_iter()) {
            if let Some(screen) = &mut screen {
                writeln!(stream, "{}", screen.line(&heard))?;
            }
            if let Some((log, lines)) = &mut log {
                log.write_line(lines.line(&heard)).map_err(of_log)?;
            }
        }
        stream.flush()?;
        if let Some((log, _)) = &mut log {
            log.flush().map_err(of_log)?;
        }
    }
    Ok(())
}

/// A log that goes to standard output is as good as the screen.
fn of_log(error: LogFileError) -> Failure {
    match error {
        LogFileError::Write { path, error } if is_standard_stream(&path) => error.into(),
        error => error.into(),
    }
}

#[cfg(test)]
mod tests {
    use ecan_mcan_port::{ReceiveSource, ReceivedFrame};
    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_protocol::image::Timestamp;

    use super::*;
    use crate::global::Color;

    fn heard() -> TimedFrame {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        let (timestamp, source) = (Timestamp::None, ReceiveSource::default());
        let received = ReceivedFrame { slave: 0, channel: 0, frame, timestamp, source };
        TimedFrame { time_ns: 0, received }
    }

    #[test]
    fn an_output_that_stands_still_holds_nobody_who_wants_to_stop() {
        let interrupt = Interrupt::default();
        let (release, held) = sync_channel::<()>(0);
        let mut printer = Printer::start_with(1, &interrupt, move |_| {
            let _ = held.recv();
            Ok(())
        })
        .unwrap();
        printer.put(heard(), false);
        interrupt.request();
        // There is no room, and simulated time would wait for it.
        printer.put(heard(), false);
        assert_eq!(printer.dropped, 1);
        let failure = printer.finish(&Output::new(false, Color::Never)).unwrap_err();
        let words = "cannot write the output: it stands still, frames are missing";
        assert_eq!((failure.to_string().as_str(), failure.status()), (words, 6));
        drop(release);
    }
}
