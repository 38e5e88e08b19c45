//! Detection of a closed terminal: window or connection closed.

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;

/// Set when the terminal is closed. A program may not get SIGHUP then, and reading from such a
/// terminal does not block.
#[derive(Clone, Debug, Default)]
pub struct HangUp(Arc<AtomicBool>);

impl HangUp {
    /// Watches standard output, and standard input if it is a terminal, on a detached thread.
    pub fn watch() -> std::io::Result<Self> {
        let hang_up = Self::default();
        let flag = hang_up.0.clone();
        std::thread::Builder::new().name("hang-up".to_owned()).spawn(move || {
            wait();
            flag.store(true, Ordering::Relaxed);
        })?;
        Ok(hang_up)
    }

    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Returns when one of the terminals is closed or cannot be polled.
#[allow(clippy::disallowed_methods)] // Nothing is printed.
fn wait() {
    let (input, output) = (std::io::stdin(), std::io::stdout());
    // A hang-up is always reported; no other events are requested.
    let mut ends = vec![PollFd::new(&output, PollFlags::empty())];
    if input.is_terminal() {
        ends.push(PollFd::new(&input, PollFlags::empty()));
    }
    while poll(&mut ends, None) == Err(Errno::INTR) {}
}
