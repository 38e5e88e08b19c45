//! Ctrl-C and SIGTERM as a flag that the cycle looks at.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set once the user asked the program to stop.
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Catches Ctrl-C, SIGTERM and SIGHUP from now on.
    ///
    /// # Errors
    /// The system's, when no handler can be set.
    pub fn install() -> Result<Self, ctrlc::Error> {
        let interrupt = Self::default();
        let flag = interrupt.0.clone();
        ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))?;
        Ok(interrupt)
    }

    /// As [`install`](Self::install), for work that is not stopped at once: the first time these
    /// words go to standard error, so that the user knows that he was heard.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_saying(words: &'static str) -> Result<Self, ctrlc::Error> {
        let interrupt = Self::default();
        let flag = interrupt.0.clone();
        ctrlc::set_handler(move || {
            if !flag.swap(true, Ordering::Relaxed) {
                // Nobody may be there to read it.
                let _ = writeln!(std::io::stderr(), "{words}");
            }
        })?;
        Ok(interrupt)
    }

    /// Whether to stop.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
