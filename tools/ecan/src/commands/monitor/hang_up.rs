//! Noticing that the terminal has gone away: its window was closed, its connection broke.

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;

/// Set once the terminal has gone away. A program need not get SIGHUP then, and reading from such a
/// terminal does not wait any more.
#[derive(Clone, Debug, Default)]
pub struct HangUp(Arc<AtomicBool>);

impl HangUp {
    /// Watches standard output, and standard input where it is a terminal, on a thread that nobody
    /// waits for.
    ///
    /// # Errors
    /// The system's, when there can be no more threads.
    pub fn watch() -> std::io::Result<Self> {
        let hang_up = Self::default();
        let flag = hang_up.0.clone();
        std::thread::Builder::new().name("hang-up".to_owned()).spawn(move || {
            wait();
            flag.store(true, Ordering::Relaxed);
        })?;
        Ok(hang_up)
    }

    /// Whether the terminal has gone away.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Returns when one of the terminals is gone, or cannot be watched.
fn wait() {
    let (input, output) = (std::io::stdin(), std::io::stdout());
    // The end of a terminal is told without being asked for; nothing else is wanted.
    let mut ends = vec![PollFd::new(&output, PollFlags::empty())];
    if input.is_terminal() {
        ends.push(PollFd::new(&input, PollFlags::empty()));
    }
    while poll(&mut ends, None) == Err(Errno::INTR) {}
}
