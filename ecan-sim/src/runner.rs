//! Keeps simulated time going where no master does.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::scenario::ClockKind;
use crate::simulation::Simulation;

/// Longest time for which the world stands still.
const STEP: Duration = Duration::from_millis(1);

/// Why a simulation cannot be kept going by a thread.
#[derive(Debug, thiserror::Error)]
pub enum RunnerError {
    /// Stepped time is moved by the program itself.
    #[error("the simulation runs in stepped time, which only the program's own cycle moves")]
    SteppedClock,
    /// No thread for it.
    #[error("no thread to keep the simulation going: {0}")]
    Thread(#[from] io::Error),
}

/// Keeps a simulation on the real clock going until it is dropped; see
/// [`Simulation::keep_running`].
#[derive(Debug)]
pub struct RealTimeRunner {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RealTimeRunner {
    pub(crate) fn start(simulation: Simulation) -> Result<Self, RunnerError> {
        if simulation.clock_kind() == ClockKind::Stepped {
            return Err(RunnerError::SteppedClock);
        }
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let run = move || {
            while !stopped.load(Ordering::Acquire) {
                // Looking at the world brings it up to the present.
                simulation.with_world(|_| ());
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
