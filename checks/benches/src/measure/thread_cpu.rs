//! Processor time of a thread.

use nix::time::{ClockId, clock_gettime};

/// Processor time of the calling thread so far, ns.
///
/// # Panics
/// The system has no such clock; Linux has it.
#[must_use]
pub fn thread_cpu_ns() -> u64 {
    let time = clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).expect("a clock of Linux");
    time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;
    use std::time::{Duration, Instant};

    use super::thread_cpu_ns;

    #[test]
    fn computing_counts_and_sleeping_does_not() {
        let start_ns = thread_cpu_ns();
        std::thread::sleep(Duration::from_millis(50));
        let slept_ns = thread_cpu_ns() - start_ns;
        let start = Instant::now();
        let mut rounds = 0_u64;
        while thread_cpu_ns() - start_ns < 20_000_000 {
            rounds = black_box(rounds + 1);
            assert!(start.elapsed() < Duration::from_secs(60), "{rounds} rounds");
        }
        assert!(slept_ns < 20_000_000, "{slept_ns} ns");
    }
}
