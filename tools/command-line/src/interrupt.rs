//! SIGINT and SIGTERM as a flag for the cycle.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Later signals within this time belong to the first: `timeout` and shells signal a process and
/// its group.
const ONE_REQUEST: Duration = Duration::from_millis(200);
/// Exit status after the second signal, as in shells for SIGINT.
const ENDED_BY_SIGNAL: i32 = 130;

/// The signal handlers cannot be installed.
#[derive(Debug, thiserror::Error)]
#[error("cannot install handlers for SIGINT and SIGTERM: {0}")]
pub struct InterruptError(String);

impl From<ctrlc::Error> for InterruptError {
    fn from(error: ctrlc::Error) -> Self {
        Self(match error {
            // The `Display` of `ctrlc` omits the reason.
            ctrlc::Error::System(error) => error.to_string(),
            other => other.to_string(),
        })
    }
}

/// Flag set by the user's request to stop.
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Installs handlers for SIGINT, SIGTERM and SIGHUP. A second signal exits the process at once,
    /// with status 130.
    ///
    /// # Errors
    /// The system rejects the handlers.
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

    /// As [`install`](Self::install), for work that must not be interrupted: later signals have no
    /// effect.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_patient() -> Result<Self, InterruptError> {
        Self::install_patient_with(|| ())
    }

    /// As [`install_patient`](Self::install_patient); the first signal prints `message` on standard
    /// error.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_with_message(message: &'static str) -> Result<Self, InterruptError> {
        Self::install_patient_with(move || drop(writeln!(std::io::stderr(), "{message}")))
    }

    fn install_patient_with(on_signal: impl Fn() + Send + 'static) -> Result<Self, InterruptError> {
        let interrupt = Self::default();
        let flag = interrupt.0.clone();
        ctrlc::set_handler(move || {
            if !flag.swap(true, Ordering::Relaxed) {
                on_signal();
            }
        })?;
        Ok(interrupt)
    }

    /// Sets the flag, as a signal does.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// The flag itself, for other threads.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }

    /// Returns whether to stop.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
