//! Reads with a time limit from children, terminals and connections. A timeout fails with the text
//! received so far.

use std::io::Read;
use std::os::fd::AsFd;
use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// Default time limit, far above the duration of a successful test on a busy machine.
pub const LIMIT: Duration = Duration::from_secs(300);

/// Poll interval for the exit of a program.
const LOOK: Duration = Duration::from_millis(10);

/// Result of a wait.
enum Piece {
    Came,
    Nothing,
    End,
}

/// Source that can be polled and read.
trait Source: Read + AsFd {}

impl<T: Read + AsFd> Source for T {}

/// Reader with a time limit.
pub struct TimedReader {
    source: Box<dyn Source>,
    limit: Duration,
    /// All received bytes.
    text: Vec<u8>,
    /// Number of consumed bytes.
    taken: usize,
}

impl TimedReader {
    pub fn new(source: impl Read + AsFd + 'static) -> Self {
        Self::with_limit(source, LIMIT)
    }

    pub fn with_limit(source: impl Read + AsFd + 'static, limit: Duration) -> Self {
        Self { source: Box::new(source), limit, text: Vec::new(), taken: 0 }
    }

    /// All received text.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.text).into_owned()
    }

    /// Waits until the received text contains `words`.
    pub fn wait_for(&mut self, words: &str) {
        let has = |text: &[u8]| text.windows(words.len()).any(|bytes| bytes == words.as_bytes());
        self.wait_until(&format!("{words:?}"), |text, _| has(text).then_some(()));
    }

    /// Reads a number of bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        let what = format!("{count} bytes");
        let end = self.wait_until(&what, |text, taken| {
            (text.len() >= taken + count).then_some(taken + count)
        });
        self.take_to(end)
    }

    /// Reads up to and including this byte, or to the end.
    pub fn through(&mut self, last: u8) -> Vec<u8> {
        self.through_one_of(&[last])
    }

    /// Reads up to and including the first of these bytes, or to the end.
    pub fn through_one_of(&mut self, last: &[u8]) -> Vec<u8> {
        let found =
            self.look(&String::from_utf8_lossy(last).escape_debug().to_string(), |text, taken| {
                let place = text[taken..].iter().position(|byte| last.contains(byte));
                place.map(|place| taken + place + 1)
            });
        self.take_to(found.unwrap_or(self.text.len()))
    }

    /// Reads to the end.
    pub fn rest(&mut self) -> String {
        self.look("the end", |_, _| None::<()>);
        String::from_utf8_lossy(&self.take_to(self.text.len())).into_owned()
    }

    fn take_to(&mut self, end: usize) -> Vec<u8> {
        let taken = std::mem::replace(&mut self.taken, end);
        self.text[taken..end].to_vec()
    }

    /// Waits until `find` returns a result for the text and the number of consumed bytes.
    fn wait_until<T>(&mut self, what: &str, find: impl Fn(&[u8], usize) -> Option<T>) -> T {
        let found = self.look(what, find);
        found.unwrap_or_else(|| panic!("the end came before {what}, behind: {}", self.text()))
    }

    /// As `wait_until`; `None` at the end.
    fn look<T>(&mut self, what: &str, find: impl Fn(&[u8], usize) -> Option<T>) -> Option<T> {
        let end = Instant::now() + self.limit;
        loop {
            if let Some(found) = find(&self.text, self.taken) {
                return Some(found);
            }
            match self.read_for(end.saturating_duration_since(Instant::now())) {
                Piece::Came => {}
                Piece::End => return None,
                Piece::Nothing => self.fail(what),
            }
        }
    }

    /// Waits for the exit of a program and reads its output, so that it is not blocked.
    pub fn end_of(&mut self, child: &mut Child) -> ExitStatus {
        let end = Instant::now() + self.limit;
        loop {
            if let Some(status) = child.try_wait().unwrap() {
                return status;
            }
            if Instant::now() > end {
                self.fail("the end of the program");
            }
            self.read_for(LOOK);
        }
    }

    /// Reads what arrives within a time.
    pub fn read_during(&mut self, time: Duration) {
        let end = Instant::now() + time;
        let left = || end.saturating_duration_since(Instant::now());
        while !left().is_zero() && matches!(self.read_for(left()), Piece::Came) {}
    }

    fn fail(&self, what: &str) -> ! {
        panic!("{what} did not come in {:?}; this came: {}", self.limit, self.text())
    }

    /// Waits for the next bytes, at most for `limit`.
    fn read_for(&mut self, limit: Duration) -> Piece {
        match is_readable(&self.source, limit) {
            Ok(true) => {}
            Ok(false) => return Piece::Nothing,
            Err(Errno::INTR) => return Piece::Came,
            Err(error) => panic!("{error}"),
        }
        let mut buffer = [0; 4096];
        // A terminal without a program returns an error.
        let Ok(length @ 1..) = self.source.read(&mut buffer) else { return Piece::End };
        self.text.extend_from_slice(&buffer[..length]);
        Piece::Came
    }
}

/// Waits until a descriptor is readable, at most for `limit`; `false` if it is not.
pub fn is_readable(descriptor: impl AsFd, limit: Duration) -> Result<bool, Errno> {
    let limit = Timespec { tv_sec: limit.as_secs() as i64, tv_nsec: limit.subsec_nanos().into() };
    Ok(poll(&mut [PollFd::new(&descriptor, PollFlags::IN)], Some(&limit))? > 0)
}
