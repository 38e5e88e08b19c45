//! Programs as child processes, each in a process group of its own, ended by its id.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use ecan_tool_support::command_line::interrupt::Interrupt;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde::Serialize;

use crate::stop::Stop;

/// Period in which the interrupt and the end of a child are looked at.
const POLL: Duration = Duration::from_millis(20);
/// Time to end after SIGTERM, before SIGKILL.
const GRACE: Duration = Duration::from_secs(10);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    Output,
    Error,
}

#[derive(Debug, Clone)]
pub struct Line {
    pub at: Duration,
    pub stream: Stream,
    pub text: String,
}

/// A running program.
#[derive(Debug)]
pub struct Running {
    pub command: String,
    child: Child,
    start: Instant,
    incoming: Receiver<Line>,
    pub lines: Vec<Line>,
    interrupt: Interrupt,
}

/// A program that has ended.
#[derive(Debug, Clone)]
pub struct Finished {
    pub command: String,
    pub status: ExitStatus,
    pub seconds: f64,
    pub lines: Vec<Line>,
}

/// Entry of the report.
#[derive(Debug, Clone, Serialize)]
pub struct CommandRecord {
    pub command: String,
    pub exit: Option<i32>,
    pub signal: Option<i32>,
    pub seconds: f64,
}

fn forward(
    stream: impl std::io::Read + Send + 'static,
    kind: Stream,
    start: Instant,
    to: Sender<Line>,
) {
    std::thread::spawn(move || {
        let mut reader = BufReader::new(stream);
        let mut bytes = Vec::new();
        while matches!(reader.read_until(b'\n', &mut bytes), Ok(count) if count > 0) {
            let text = String::from_utf8_lossy(&bytes).trim_end_matches('\n').to_owned();
            bytes.clear();
            if to.send(Line { at: start.elapsed(), stream: kind, text }).is_err() {
                break;
            }
        }
    });
}

/// The command as a user would type it.
pub fn command_text(command: &Command) -> String {
    let mut text = String::new();
    for (name, value) in command.get_envs() {
        if let Some(value) = value {
            let _ = write!(text, "{}={} ", name.to_string_lossy(), value.to_string_lossy());
        }
    }
    text.push_str(&command.get_program().to_string_lossy());
    for argument in command.get_args() {
        let argument = argument.to_string_lossy();
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=#,+@".contains(c);
        if !argument.is_empty() && argument.chars().all(is_plain) {
            let _ = write!(text, " {argument}");
        } else {
            let _ = write!(text, " '{argument}'");
        }
    }
    text
}

impl Running {
    pub fn start(mut command: Command, interrupt: &Interrupt) -> Result<Self, Stop> {
        let text = command_text(&command);
        let start = Instant::now();
        // Ctrl-C reaches only this program, which ends its children in order.
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
        let mut child = command
            .spawn()
            .map_err(|error| Stop::Failed(format!("cannot start {text}: {error}")))?;
        let (sender, incoming) = channel();
        if let Some(stream) = child.stdout.take() {
            forward(stream, Stream::Output, start, sender.clone());
        }
        if let Some(stream) = child.stderr.take() {
            forward(stream, Stream::Error, start, sender);
        }
        let interrupt = interrupt.clone();
        Ok(Self { command: text, child, start, incoming, lines: Vec::new(), interrupt })
    }

    /// Waits for a line that contains the text; returns the time since the start.
    ///
    /// # Errors
    /// The program ends without it, the time is over, or the user interrupts.
    pub fn wait_for(&mut self, text: &str, limit: Duration) -> Result<Duration, Stop> {
        self.wait_for_next(text, 0, limit)
    }

    /// As [`wait_for`](Self::wait_for), in the lines from this index of `lines` on.
    pub fn wait_for_next(
        &mut self,
        text: &str,
        from: usize,
        limit: Duration,
    ) -> Result<Duration, Stop> {
        let mut seen = from;
        let begin = Instant::now();
        loop {
            while let Some(line) = self.lines.get(seen) {
                if line.text.contains(text) {
                    return Ok(line.at);
                }
                seen += 1;
            }
            if self.interrupt.is_set() {
                return Err(Stop::Interrupted);
            }
            if begin.elapsed() >= limit {
                return Err(self.failed(&format!("no \"{text}\" within {} s", limit.as_secs())));
            }
            match self.incoming.recv_timeout(POLL) {
                Ok(line) => self.lines.push(line),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(self.failed(&format!("ended without \"{text}\"")));
                }
            }
        }
    }

    /// A failure of the program, with its last lines.
    fn failed(&self, event: &str) -> Stop {
        Stop::Failed(format!("{}: {event}{}", self.command, tail(&self.lines)))
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    pub fn signal(&self, signal: Signal) {
        if let Ok(pid) = i32::try_from(self.child.id()) {
            // It fails only if the process has ended, which `finish` reports.
            let _ = kill(Pid::from_raw(pid), signal);
        }
    }

    /// Takes the lines that have arrived. Returns false when both streams are closed.
    pub fn collect(&mut self) -> bool {
        loop {
            match self.incoming.try_recv() {
                Ok(line) => self.lines.push(line),
                Err(error) => return error != std::sync::mpsc::TryRecvError::Disconnected,
            }
        }
    }

    /// Returns whether the program still runs.
    pub fn is_running(&mut self) -> bool {
        self.collect();
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Waits for the end of the program.
    ///
    /// # Errors
    /// The time is over or the user interrupts; the program is ended then.
    pub fn finish(mut self, limit: Duration) -> Result<Finished, Stop> {
        let begin = Instant::now();
        while self.is_running() {
            if self.interrupt.is_set() {
                self.end();
                return Err(Stop::Interrupted);
            }
            if begin.elapsed() >= limit {
                self.end();
                return Err(self.failed(&format!("not finished within {} s", limit.as_secs())));
            }
            std::thread::sleep(POLL);
        }
        self.finished()
    }

    /// Sends the signal and waits for the end.
    pub fn stop(self, signal: Signal, limit: Duration) -> Result<Finished, Stop> {
        self.signal(signal);
        self.finish(limit)
    }

    fn finished(mut self) -> Result<Finished, Stop> {
        let status = self.child.wait().map_err(|error| Stop::failed(error.to_string()))?;
        let seconds = self.start.elapsed().as_secs_f64();
        // A grandchild that keeps a stream open does not hold up the list.
        let begin = Instant::now();
        while self.collect() && begin.elapsed() < Duration::from_secs(1) {
            std::thread::sleep(POLL / 10);
        }
        let (command, lines) = (std::mem::take(&mut self.command), std::mem::take(&mut self.lines));
        Ok(Finished { command, status, seconds, lines })
    }

    /// Ends it with SIGTERM, after a time with SIGKILL.
    fn end(&mut self) {
        self.signal(Signal::SIGCONT);
        self.signal(Signal::SIGTERM);
        let begin = Instant::now();
        while self.is_running() && begin.elapsed() < GRACE {
            std::thread::sleep(POLL);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.collect();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if self.is_running() {
            self.end();
        }
    }
}

/// The last lines, indented, for a message.
pub fn tail(lines: &[Line]) -> String {
    const LINES: usize = 12;
    let mut text = String::new();
    for line in &lines[lines.len().saturating_sub(LINES)..] {
        let _ = write!(text, "\n    {}", line.text);
    }
    text
}

impl Finished {
    pub fn code(&self) -> Option<i32> {
        self.status.code()
    }

    fn stream(&self, stream: Stream) -> String {
        let lines = self.lines.iter().filter(|line| line.stream == stream);
        lines.fold(String::new(), |text, line| text + &line.text + "\n")
    }

    pub fn output(&self) -> String {
        self.stream(Stream::Output)
    }

    pub fn errors(&self) -> String {
        self.stream(Stream::Error)
    }

    pub fn record(&self) -> CommandRecord {
        CommandRecord {
            command: self.command.clone(),
            exit: self.status.code(),
            signal: self.status.signal(),
            seconds: self.seconds,
        }
    }

    /// Description of the end, with the last lines.
    pub fn end_text(&self) -> String {
        let end = match (self.status.code(), self.status.signal()) {
            (Some(code), _) => format!("exit status {code}"),
            (None, Some(signal)) => format!("ended by signal {signal}"),
            (None, None) => "no exit status".to_owned(),
        };
        format!("{}: {end}{}", self.command, tail(&self.lines))
    }

    /// # Errors
    /// The exit status is another one.
    pub fn expect(self, code: i32) -> Result<Self, Stop> {
        self.expect_one_of(&[code])
    }

    /// # Errors
    /// The exit status is none of these.
    pub fn expect_one_of(self, codes: &[i32]) -> Result<Self, Stop> {
        if self.code().is_some_and(|code| codes.contains(&code)) {
            return Ok(self);
        }
        let expected: Vec<_> = codes.iter().map(i32::to_string).collect();
        Err(Stop::Failed(format!("{}; expected {}", self.end_text(), expected.join(" or "))))
    }

    /// # Errors
    /// The output, standard error included, does not contain the text.
    pub fn expect_text(self, text: &str) -> Result<Self, Stop> {
        if self.lines.iter().any(|line| line.text.contains(text)) {
            return Ok(self);
        }
        Err(Stop::Failed(format!("no \"{text}\": {}", self.end_text())))
    }

    /// The standard output as JSON.
    ///
    /// # Errors
    /// It is not JSON.
    pub fn json(&self) -> Result<serde_json::Value, Stop> {
        serde_json::from_str(&self.output())
            .map_err(|error| Stop::Failed(format!("no JSON ({error}): {}", self.end_text())))
    }

    /// Time of the first line that contains the text, in s.
    pub fn time_of(&self, text: &str) -> Option<f64> {
        let line = self.lines.iter().find(|line| line.text.contains(text))?;
        Some(line.at.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Running {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        Running::start(command, &Interrupt::default()).unwrap()
    }

    const LIMIT: Duration = Duration::from_secs(60);

    #[test]
    fn streams_and_status_are_recorded() {
        let finished = shell("echo one; echo two >&2; exit 3").finish(LIMIT).unwrap();
        assert_eq!((finished.output(), finished.errors()), ("one\n".into(), "two\n".into()));
        assert_eq!(finished.code(), Some(3));
        let message = finished.expect(0).unwrap_err().to_string();
        assert!(message.contains("exit status 3") && message.contains("two"), "{message}");
    }

    #[test]
    fn child_without_end_is_ended() {
        let mut running = shell("echo ready; exec sleep 1000");
        running.wait_for("ready", LIMIT).unwrap();
        let pid = Pid::from_raw(running.child.id().try_into().unwrap());
        running.interrupt.request();
        assert!(matches!(running.finish(LIMIT), Err(Stop::Interrupted)));
        assert_eq!(kill(pid, None), Err(nix::errno::Errno::ESRCH));
    }

    #[test]
    fn missing_line_is_a_failure() {
        let message = shell("echo other").wait_for("ready", LIMIT).unwrap_err().to_string();
        assert!(message.contains("ended without \"ready\""), "{message}");
    }

    #[test]
    fn endless_output_without_the_line_is_a_failure() {
        let message = shell("yes").wait_for("ready", Duration::ZERO).unwrap_err().to_string();
        assert!(message.contains("no \"ready\" within 0 s"), "{message}");
    }
}
