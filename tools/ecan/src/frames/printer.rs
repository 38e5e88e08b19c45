//! Writing beside the cycle: an output that is slow, or stands still, does not hold it up.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use ecan_command_line::log_file::LogFileError;

use crate::failure::Failure;
use crate::frames::format::{Heard, LogLines, Screen, ScreenLines};
use crate::output::Output;

/// Frames that may wait to be written: some seconds of four full channels.
const QUEUE: usize = 1 << 17;

/// The thread that writes.
#[derive(Debug)]
pub struct Printer {
    queue: Option<SyncSender<Heard>>,
    thread: JoinHandle<Result<(), Failure>>,
    dropped: u64,
}

impl Printer {
    /// Starts it; creates the log.
    pub fn start(screen: Screen, is_shown: bool, log: Option<&Path>) -> Result<Self, Failure> {
        let log = log.map(|path| Log::create(path, screen)).transpose()?;
        let lines = is_shown.then(|| ScreenLines::new(screen));
        let (queue, heard) = sync_channel(QUEUE);
        let thread = std::thread::Builder::new()
            .name("printer".to_owned())
            .spawn(move || print_all(&heard, lines, log))
            .map_err(Failure::of_thread)?;
        Ok(Self { queue: Some(queue), thread, dropped: 0 })
    }

    /// Hands a frame over. In real time one for which there is no room is dropped; simulated time
    /// can wait.
    pub fn put(&mut self, heard: Heard, is_real_time: bool) {
        let Some(queue) = &self.queue else { return };
        if !is_real_time {
            // Nobody there: the thread's error tells.
            let _ = queue.send(heard);
        } else if let Err(TrySendError::Full(_)) = queue.try_send(heard) {
            self.dropped += 1;
        }
    }

    /// Whether it can write no more.
    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until everything is written; says what was dropped.
    pub fn finish(mut self, output: &Output) -> Result<(), Failure> {
        self.queue = None;
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

/// A log that is being written.
struct Log {
    file: BufWriter<File>,
    path: PathBuf,
    lines: LogLines,
}

impl Log {
    fn create(path: &Path, screen: Screen) -> Result<Self, Failure> {
        let path = path.to_owned();
        match File::create(&path) {
            Ok(file) => Ok(Self { file: BufWriter::new(file), path, lines: LogLines::new(screen) }),
            Err(error) => Err(LogFileError::Write { path, error }.into()),
        }
    }

    fn write(&mut self, heard: &Heard) -> Result<(), Failure> {
        let line = self.lines.line(heard);
        writeln!(self.file, "{line}").map_err(|error| self.fault(error))
    }

    fn flush(&mut self) -> Result<(), Failure> {
        self.file.flush().map_err(|error| self.fault(error))
    }

    fn fault(&self, error: std::io::Error) -> Failure {
        LogFileError::Write { path: self.path.clone(), error }.into()
    }
}

/// Writes what comes, and writes it out whenever nothing more waits.
fn print_all(
    heard: &Receiver<Heard>,
    mut screen: Option<ScreenLines>,
    mut log: Option<Log>,
) -> Result<(), Failure> {
    let mut stream = BufWriter::new(std::io::stdout());
    while let Ok(first) = heard.recv() {
        for heard in std::iter::once(first).chain(heard.try_iter()) {
            if let Some(screen) = &mut screen {
                writeln!(stream, "{}", screen.line(&heard))?;
            }
            if let Some(log) = &mut log {
                log.write(&heard)?;
            }
        }
        stream.flush()?;
        if let Some(log) = &mut log {
            log.flush()?;
        }
    }
    Ok(())
}
