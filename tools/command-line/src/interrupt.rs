//! Ctrl-C and SIGTERM as a flag that the cycle looks at.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Signals that come sooner after the first belong to it: `timeout` and shells send one to a process
/// and, once more, to its group.
const ONE_REQUEST: Duration = Duration::from_millis(200);
/// Exit status of a program that was ended by its second signal, as shells tell Ctrl-C.
const ENDED_BY_SIGNAL: i32 = 130;

/// The system does not let signals be caught.
#[derive(Debug, thiserror::Error)]
#[error("Ctrl-C and SIGTERM cannot be caught: {reason}")]
pub struct InterruptError {
    reason: String,
}

impl From<ctrlc::Error> for InterruptError {
    fn from(error: ctrlc::Error) -> Self {
        let reason = match error {
            // What `ctrlc` says of it leaves out the reason.
            ctrlc::Error::System(error) => error.to_string(),
            other => other.to_string(),
        };
        Self { reason }
    }
}

/// Set once the user asked the program to stop.
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Catches Ctrl-C, SIGTERM and SIGHUP from now on. Whoever sends another one does not want to
    /// wait: it ends the process at once, with exit status 130.
    ///
    /// # Errors
    /// The system's, when no handler can be set.
    pub fn install() -> Result<Self, InterruptError> {
        let interrupt = Self::default();
        let flag = interrupt.clone();
        let mut first: Option<Instant> = None;
        ctrlc::set_handler(move || {
            let since = first.get_or_insert_with(Instant::now).elapsed();
            if flag.is_set() && since >= ONE_REQUEST {
                std::process::exit(ENDED_BY_SIGNAL);
            }
            flag.request();
        })?;
        Ok(interrupt)
    }

    /// As [`install`](Self::install), for work that nothing ends in its middle: later signals change
    /// nothing.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_patient() -> Result<Self, InterruptError> {
        Self::install_patient_with(|| ())
    }

    /// As [`install_patient`](Self::install_patient), for work that takes its time: the first signal
    /// writes these words to standard error, so that the user knows that he was heard.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_saying(words: &'static str) -> Result<Self, InterruptError> {
        // Nobody may be there to read it.
        Self::install_patient_with(move || drop(writeln!(std::io::stderr(), "{words}")))
    }

    fn install_patient_with(say: impl Fn() + Send + 'static) -> Result<Self, InterruptError> {
        let interrupt = Self::default();
        let flag = interrupt.0.clone();
        ctrlc::set_handler(move || {
            if !flag.swap(true, Ordering::Relaxed) {
                say();
            }
        })?;
        Ok(interrupt)
    }

    /// Asks the program to stop, as a signal does.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// The flag itself, for those who wait.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }

    /// Whether to stop.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
