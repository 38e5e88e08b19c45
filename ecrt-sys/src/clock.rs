//! The clock that paces the cycle.

/// A clock that counts nanoseconds from an arbitrary start and never goes back.
///
/// Everything that waits waits on the clock of its [`Ecrt`](crate::Ecrt): a simulation that is
/// stepped moves its time while someone sleeps here.
pub trait Clock: Send + Sync {
    /// The time, ns. Real-time safe.
    fn now_ns(&self) -> u64;

    /// Sleeps until the clock shows `deadline_ns`; returns at once when it already does.
    fn sleep_until_ns(&self, deadline_ns: u64);

    /// Waits until the clock shows `deadline_ns`: sleeps, and for the last `spin_ns` before it looks
    /// at the clock, so that the delay of waking up is swallowed where it is no longer than that.
    ///
    /// A clock that does not run by itself sleeps to the end, unless it knows better.
    fn sleep_and_spin_until_ns(&self, deadline_ns: u64, spin_ns: u64) {
        // Looking at a clock that only moves in sleeps would never end.
        if spin_ns == 0 || !self.runs_by_itself() {
            return self.sleep_until_ns(deadline_ns);
        }
        self.sleep_until_ns(deadline_ns.saturating_sub(spin_ns));
        while self.now_ns() < deadline_ns {
            std::hint::spin_loop();
        }
    }

    /// Whether the time goes on while nobody sleeps here, so that the last stretch before a
    /// deadline can be waited for by looking at the clock. Real-time safe.
    ///
    /// A clock that says nothing is taken to stand still: on it such a wait would never end.
    fn runs_by_itself(&self) -> bool {
        false
    }

    /// The calling thread works beside the one that runs the cycle, until
    /// [`leave_beside`](Self::leave_beside).
    ///
    /// A clock that is moved by sleeping stands still while such a thread computes, and goes on while
    /// it waits in the library: what the thread does then takes the same time in every run. Others
    /// need not know. A clock around another one passes this on, and the end.
    fn enter_beside(&self) {}

    /// The calling thread ends its work beside the cycle.
    fn leave_beside(&self) {}
}

/// The system's `CLOCK_MONOTONIC`.
#[derive(Clone, Copy, Debug, Default)]
pub struct MonotonicClock;

const NS_PER_S: u64 = 1_000_000_000;

impl Clock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
        // SAFETY: `now` is valid for writing. CLOCK_MONOTONIC exists on every Linux, so the
        // call does not fail, and if it did `now` would stay initialised.
        unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now) };
        u64::try_from(now.tv_sec).unwrap_or(0) * NS_PER_S + u64::try_from(now.tv_nsec).unwrap_or(0)
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        let deadline = libc::timespec {
            tv_sec: libc::time_t::try_from(deadline_ns / NS_PER_S).unwrap_or(libc::time_t::MAX),
            tv_nsec: (deadline_ns % NS_PER_S) as libc::c_long,
        };
        loop {
            // SAFETY: `deadline` is valid for reading; with TIMER_ABSTIME the pointer for the
            // remaining time is not used and may be null.
            let result = unsafe {
                libc::clock_nanosleep(
                    libc::CLOCK_MONOTONIC,
                    libc::TIMER_ABSTIME,
                    &deadline,
                    std::ptr::null_mut(),
                )
            };
            if result != libc::EINTR {
                return;
            }
        }
    }

    fn runs_by_itself(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleeping_ends_at_or_after_the_deadline() {
        let clock = MonotonicClock;
        let deadline = clock.now_ns() + 1000;
        clock.sleep_until_ns(deadline);
        assert!(clock.now_ns() >= deadline);
        clock.sleep_until_ns(0);
    }
}
