//! Times of the services of the data path.

use super::config::GatewayModelConfig;

#[derive(Clone, Debug)]
pub(super) struct ServiceTimer {
    delay_ns: u64,
    jitter_ns: u64,
    idle_ns: u64,
    /// The services run by `idle_ns` in OP, too.
    pub(super) is_free_running: bool,
    random: u64,
    /// Due time of the service for the last SM2 write.
    due: Option<u64>,
    idle_due: u64,
    /// Arrival of the last complete SM2 write.
    pub(super) outputs_at: u64,
    /// Time of the last service.
    pub(super) last: u64,
    /// Fault: no service runs before this time.
    pub(super) stalled_until: u64,
}

impl ServiceTimer {
    pub(super) fn new(config: &GatewayModelConfig, seed: u64) -> Self {
        let period_ns = config.variant.service_period_us.ns();
        Self {
            delay_ns: config.service_delay_ns,
            jitter_ns: config.service_jitter_ns,
            idle_ns: period_ns.unwrap_or(config.idle_service_ns).max(1),
            is_free_running: period_ns.is_some(),
            random: seed ^ 0x9E37_79B9_7F4A_7C15,
            due: None,
            idle_due: 0,
            outputs_at: 0,
            last: 0,
            stalled_until: 0,
        }
    }

    /// Outputs were written now; they count as arrived at `arrival`.
    pub(super) fn outputs_written(&mut self, now: u64, arrival: u64) {
        self.outputs_at = arrival;
        self.retry(now);
    }

    /// Serves the outputs that SM2 holds, as after a write.
    pub(super) fn retry(&mut self, now: u64) {
        if !self.is_free_running {
            let jitter = self.draw(self.jitter_ns);
            self.due = Some(now + self.delay_ns + jitter);
        }
    }

    pub(super) fn due(&self) -> Option<u64> {
        self.due.map(|due| due.max(self.stalled_until))
    }

    /// Cancels the service for the last SM2 write, or marks it as started.
    pub(super) fn cancel(&mut self) {
        self.due = None;
    }

    pub(super) fn idle_due(&self) -> u64 {
        self.idle_due.max(self.stalled_until)
    }

    pub(super) fn restart_idle(&mut self, now: u64) {
        let jitter = if self.is_free_running { self.draw(self.jitter_ns) } else { 0 };
        self.idle_due = now + self.idle_ns + jitter;
    }

    /// A pseudo-random number below `bound` (xorshift), 0 for a bound of 0.
    fn draw(&mut self, bound: u64) -> u64 {
        if bound == 0 {
            return 0;
        }
        let mut x = self.random.max(1);
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        self.random = x;
        x % bound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timer(service_jitter_ns: u64, seed: u64) -> ServiceTimer {
        let config = GatewayModelConfig { service_jitter_ns, ..GatewayModelConfig::default() };
        ServiceTimer::new(&config, seed)
    }

    #[test]
    fn service_follows_the_write_after_delay() {
        let mut timer = timer(0, 1);
        assert_eq!(timer.due(), None);
        timer.outputs_written(1_000, 1_000);
        assert_eq!((timer.outputs_at, timer.due()), (1_000, Some(31_000)));
        timer.cancel();
        assert_eq!(timer.due(), None);
    }

    #[test]
    fn jitter_is_bounded_and_reproducible() {
        let draw = |seed| {
            let mut timer = timer(500, seed);
            let times = (0..50).map(|_| {
                timer.outputs_written(0, 0);
                timer.due().unwrap()
            });
            times.collect::<Vec<_>>()
        };
        let times = draw(7);
        assert!(times.iter().all(|due| (30_000..30_500).contains(due)));
        assert!(times.iter().any(|due| *due != times[0]));
        assert_eq!(times, draw(7));
        assert_ne!(times, draw(8));
    }

    #[test]
    fn stall_delays_both_kinds_of_service() {
        let mut timer = timer(0, 1);
        timer.restart_idle(0);
        timer.outputs_written(0, 0);
        timer.stalled_until = 9_000_000;
        assert_eq!((timer.due(), timer.idle_due()), (Some(9_000_000), 9_000_000));
    }
}
