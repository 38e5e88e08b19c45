use std::sync::Arc;

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
