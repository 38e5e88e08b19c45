//! The clock of a simulation, and the thread that runs a simulation on the real clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use std::{io, thread};

use ecrt_sys::Clock;

use crate::ecrt::Shared;
use crate::scenario::ClockKind;

/// Clock of a simulated world: the system's monotonic clock, or the stepped clock, which advances
/// while a thread sleeps on it.
#[derive(Clone)]
pub struct SimClock {
    pub(crate) shared: Arc<Shared>,
}

impl Clock for SimClock {
    fn now_ns(&self) -> u64 {
        self.shared.now_ns()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.shared.sleep_as_application(deadline_ns, 0);
    }

    /// In stepped time the spin is simulated: it hides an equal part of the scenario's
    /// [`WakeUpDelay`](crate::WakeUpDelay).
    fn sleep_and_spin_until_ns(&self, deadline_ns: u64, spin_ns: u64) {
        self.shared.sleep_as_application(deadline_ns, spin_ns);
    }

    fn is_free_running(&self) -> bool {
        self.shared.kind == ClockKind::Real
    }

    fn gateways_ready(&self) {
        self.shared.with(|state| state.world.begin_ready());
    }
}

const STEP: Duration = Duration::from_millis(1);

/// Reason why a simulation cannot run on a thread.
#[derive(Debug, thiserror::Error)]
pub enum RunnerError {
    /// Stepped time is advanced by the program itself.
    #[error("the simulation runs in stepped time, which only the cycle of the program advances")]
    SteppedClock,
    /// The thread cannot be started.
    #[error("cannot start the thread of the simulation: {0}")]
    Thread(#[from] io::Error),
}

/// Keeps a simulation on the real clock running until it is dropped; see
/// [`Simulation::keep_running`](crate::Simulation::keep_running).
#[derive(Debug)]
pub struct RealTimeRunner {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RealTimeRunner {
    pub(crate) fn start(shared: Arc<Shared>) -> Result<Self, RunnerError> {
        if shared.kind == ClockKind::Stepped {
            return Err(RunnerError::SteppedClock);
        }
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let run = move || {
            while !stopped.load(Ordering::Acquire) {
                // Access advances the world to the present.
                shared.with(|_| ());
                thread::park_timeout(STEP);
            }
        };
        let thread = thread::Builder::new().name("simulation".to_owned()).spawn(run)?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for RealTimeRunner {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}
