//! The clock of the cycle.

/// A clock that counts nanoseconds from an arbitrary start and never goes back.
///
/// All waiting of the SDK uses the clock of its [`Ecrt`](crate::Ecrt): a stepped simulation moves
/// its time while a thread sleeps here.
pub trait Clock: Send + Sync {
    /// The time, ns. Real-time safe.
    fn now_ns(&self) -> u64;

    /// Sleeps until the clock shows `deadline_ns`; returns at once if it already does.
    fn sleep_until_ns(&self, deadline_ns: u64);

    /// Waits until the clock shows `deadline_ns`: sleeps, and polls the clock for the last
    /// `spin_ns`, so that a wake-up delay up to that length has no effect.
    ///
    /// A clock that is not free-running sleeps to the end, unless it implements this differently.
    fn sleep_and_spin_until_ns(&self, deadline_ns: u64, spin_ns: u64) {
        // Polling a clock that only moves in sleeps would never end.
        if spin_ns == 0 || !self.is_free_running() {
            return self.sleep_until_ns(deadline_ns);
        }
        self.sleep_until_ns(deadline_ns.saturating_sub(spin_ns));
        while self.now_ns() < deadline_ns {
            std::hint::spin_loop();
        }
    }

    /// Returns whether time passes while no thread sleeps here, so that polling the clock reaches a
    /// deadline. Real-time safe. The default is `false`, with which no wait can hang.
    fn is_free_running(&self) -> bool {
        false
    }

    /// Called when all gateways of the program are ready for the first time, on the thread of the
    /// cycle. A simulation counts times of its scenario from it; the default does nothing.
    fn gateways_ready(&self) {}
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
            // Of the type `time_t`, whose name is deprecated for musl; 2^64 ns are fewer than 2^35 s.
            tv_sec: (deadline_ns / NS_PER_S) as _,
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

    fn is_free_running(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleep_ends_at_or_after_the_deadline() {
        let clock = MonotonicClock;
        let deadline = clock.now_ns() + 1000;
        clock.sleep_until_ns(deadline);
        assert!(clock.now_ns() >= deadline);
        clock.sleep_until_ns(0);
    }
}
