//! SIGINT and SIGTERM as a flag for the cycle.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use std::{io, thread};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Later signals within this time belong to the first: `timeout` and shells signal a process and
/// its group.
const ONE_REQUEST: Duration = Duration::from_millis(200);
/// Exit status after the second signal, as in shells for SIGINT.
const ENDED_BY_SIGNAL: i32 = 130;

/// The signal handlers cannot be installed.
#[derive(Debug, thiserror::Error)]
#[error("cannot install handlers for SIGINT and SIGTERM: {0}")]
pub struct InterruptError(#[from] io::Error);

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
        Self::install_with(None, || ())
    }

    /// As [`install`](Self::install), for a program that SIGHUP does not end: the thread of the signals
    /// calls `on_hang_up`.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_with_hang_up(
        on_hang_up: impl FnMut() + Send + 'static,
    ) -> Result<Self, InterruptError> {
        Self::install_with(Some(Box::new(on_hang_up)), || ())
    }

    /// As [`install_with_hang_up`](Self::install_with_hang_up); the thread of the signals calls `before_exit` when
    /// the second signal exits the process, for example to restore a terminal.
    ///
    /// # Errors
    /// As [`install`](Self::install).
    pub fn install_with_exit(
        on_hang_up: impl FnMut() + Send + 'static,
        before_exit: impl FnMut() + Send + 'static,
    ) -> Result<Self, InterruptError> {
        Self::install_with(Some(Box::new(on_hang_up)), before_exit)
    }

    fn install_with(
        mut on_hang_up: Option<Box<dyn FnMut() + Send>>,
        mut before_exit: impl FnMut() + Send + 'static,
    ) -> Result<Self, InterruptError> {
        let interrupt = Self::default();
        let flag = interrupt.clone();
        let mut first: Option<Instant> = None;
        on_signals(move |signal| {
            if let (SIGHUP, Some(on_hang_up)) = (signal, &mut on_hang_up) {
                return on_hang_up();
            }
            let since = first.get_or_insert_with(Instant::now).elapsed();
            if flag.is_set() && since >= ONE_REQUEST {
                before_exit();
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
        Self::install_patient_with(move || crate::print_error_line!("{message}"))
    }

    fn install_patient_with(on_signal: impl Fn() + Send + 'static) -> Result<Self, InterruptError> {
        let interrupt = Self::default();
        let flag = interrupt.0.clone();
        on_signals(move |_| {
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

/// Calls `handle` on a thread for each signal.
fn on_signals(mut handle: impl FnMut(i32) + Send + 'static) -> io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    let run = move || signals.forever().for_each(&mut handle);
    thread::Builder::new().name("signals".into()).spawn(run).map(drop)
}
