//! Distributed clock of a slave with its Sync0 pulses, the outputs that arrive around them, and the times of the
//! services that they trigger.
//!
//! Distributed clock of a slave: a drifting oscillator with the corrections of the master.
//!
//! Outputs that arrive around a Sync0 pulse are missed by the firmware (manual 15.6.1, 16.1).
//!
//! The manual states the effect of outputs that are not there before Sync0, missing working counters
//! or the loss of OP, but no times; all values here are assumptions. The model: an image that is
//! complete within the window stays unread in SM2. The next write is therefore rejected, and the
//! service after it reads the image. So every second write is missing in the working counter while
//! all images arrive within the window.

use ecan_protocol::device::AlStatusCode;

use super::config::{GatewayModelConfig, Sync0, Sync0Window};

/// Share of a difference that one correction removes at once.
const STEP_SHARE: i64 = 4;
/// Share of a difference that one correction adds to the rate, per interval.
const RATE_SHARE: i64 = 64;
/// Largest step of one correction.
const MAX_STEP_NS: i64 = 2_000;
/// Largest correction of the rate, in parts per billion: 500 ppm.
const MAX_RATE_PPB: i64 = 500_000;
/// Longest interval between corrections from which the rate is estimated.
const LONGEST_INTERVAL_NS: u64 = 1_000_000_000;
/// A shorter interval counts as this one: the jitter of the master would look like a rate.
const SHORTEST_INTERVAL_NS: u64 = 500_000;

const BILLION: i128 = 1_000_000_000;

/// System time as a linear function of simulated time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LinearClock {
    simulated_ns: u64,
    system_ns: u64,
    /// Rate of system time above that of simulated time, in parts per billion.
    rate_ppb: i64,
}

impl LinearClock {
    pub(super) fn system(self, now: u64) -> u64 {
        let passed = i128::from(now) - i128::from(self.simulated_ns);
        let time =
            i128::from(self.system_ns) + passed + passed * i128::from(self.rate_ppb) / BILLION;
        u64::try_from(time).unwrap_or(0)
    }

    /// The simulated time of a system time, rounded up.
    pub(super) fn simulated(self, system: u64) -> u64 {
        let passed = i128::from(system) - i128::from(self.system_ns);
        let rate = BILLION + i128::from(self.rate_ppb);
        let time = i128::from(self.simulated_ns) + (passed * BILLION + rate - 1).div_euclid(rate);
        u64::try_from(time).unwrap_or(0)
    }
}

/// Clock of a slave. Until the master writes its time, system time is simulated time with the drift
/// of the oscillator.
#[derive(Clone, Copy, Debug)]
pub(super) struct DcClock {
    drift_ppb: i64,
    pub(super) line: LinearClock,
    is_written: bool,
    corrected_ns: Option<u64>,
    /// Difference found by the last correction, received time minus own (0x092C).
    pub(super) difference_ns: i64,
}

impl DcClock {
    pub(super) fn new(drift_ppb: i32) -> Self {
        let drift_ppb = i64::from(drift_ppb);
        let line = LinearClock { rate_ppb: drift_ppb, ..LinearClock::default() };
        Self { drift_ppb, line, is_written: false, corrected_ns: None, difference_ns: 0 }
    }

    /// System time, once the master has written it.
    pub(super) fn written_time(&self, now: u64) -> Option<u64> {
        self.is_written.then(|| self.line.system(now))
    }

    /// Sets system time, as a write of the offset (0x0920) does.
    pub(super) fn write(&mut self, system_ns: u64, now: u64) {
        self.line.system_ns = system_ns;
        self.line.simulated_ns = now;
        self.is_written = true;
        self.corrected_ns = None;
    }

    /// The master sends the reference time (0x0910).
    pub(super) fn correct(&mut self, system_ns: u64, now: u64) {
        let own = self.line.system(now);
        // limited by the register
        let limit = i128::from(i32::MAX);
        let apart = i128::from(system_ns) - i128::from(own);
        let difference = apart.clamp(-limit, limit) as i64;
        self.difference_ns = difference;
        let step = (difference / STEP_SHARE).clamp(-MAX_STEP_NS, MAX_STEP_NS);
        let interval = self.corrected_ns.replace(now).map(|before| now.saturating_sub(before));
        let rate = self.line.rate_ppb - self.drift_ppb;
        // A large difference does not show the rate. If it stays, the rate is wrong.
        let is_near = difference.abs() < MAX_STEP_NS * STEP_SHARE;
        let change = match interval.filter(|ns| *ns < LONGEST_INTERVAL_NS) {
            Some(interval) if is_near => {
                let interval = interval.max(SHORTEST_INTERVAL_NS) as i64;
                difference * BILLION as i64 / (RATE_SHARE * interval)
            }
            Some(_) => -rate / RATE_SHARE,
            None => 0,
        };
        let rate = (rate + change).clamp(-MAX_RATE_PPB, MAX_RATE_PPB);
        self.line.rate_ppb = self.drift_ppb + rate;
        self.line.system_ns = own.saturating_add_signed(step);
        self.line.simulated_ns = now;
    }

    /// Restarts the control loop, with the rate of the oscillator.
    pub(super) fn restart_control(&mut self, now: u64) {
        self.line.system_ns = self.line.system(now);
        self.line.simulated_ns = now;
        self.line.rate_ppb = self.drift_ppb;
        (self.corrected_ns, self.difference_ns) = (None, 0);
    }

    pub(super) fn jump(&mut self, by_ns: i64, now: u64) {
        self.line.system_ns = self.line.system(now).saturating_add_signed(by_ns);
        self.line.simulated_ns = now;
    }
}

#[derive(Clone, Debug)]
pub(super) struct DistributedClock {
    pub(super) clock: DcClock,
    pub(super) sync0: Option<Sync0>,
    pub(super) pulses: Option<PulseTrain>,
    /// Sync1 is active, too (0x0981 bit 2).
    pub(super) has_sync1: bool,
}

impl DistributedClock {
    pub(super) fn new(drift_ppb: i32) -> Self {
        Self { clock: DcClock::new(drift_ppb), sync0: None, pulses: None, has_sync1: false }
    }

    pub(super) fn set_sync0(&mut self, sync0: Option<Sync0>, now: u64) {
        self.sync0 = sync0;
        self.pulses = sync0.map(|sync0| PulseTrain::new(sync0, self.clock.line, now));
    }

    /// Changes the clock; the pulses follow it.
    pub(super) fn change(&mut self, now: u64, change: impl FnOnce(&mut DcClock)) {
        change(&mut self.clock);
        let line = self.clock.line;
        if let Some(pulses) = &mut self.pulses {
            pulses.set_line(line, now);
        }
    }
}

/// Sync0 pulses (manual 8.4), equidistant in the slave's system time; results are simulated time.
#[derive(Clone, Copy, Debug)]
pub(super) struct PulseTrain {
    /// In system time; `None` if the start had passed when Sync0 was set: no pulse ever comes.
    first_system_ns: Option<u64>,
    cycle_ns: u64,
    line: LinearClock,
}

impl PulseTrain {
    pub(super) fn new(sync0: Sync0, line: LinearClock, now: u64) -> Self {
        let first = sync0.start_ns.saturating_add_signed(i64::from(sync0.shift_ns));
        Self {
            first_system_ns: (first >= line.system(now)).then_some(first),
            cycle_ns: u64::from(sync0.cycle_ns).max(1),
            line,
        }
    }

    /// The slave's clock was corrected or set. If it jumps over the first pulse, none ever comes.
    pub(super) fn set_line(&mut self, line: LinearClock, now: u64) {
        let has_begun = self.pulses_until(now) > 0;
        self.line = line;
        let is_jumped_over =
            !has_begun && self.first_system_ns.is_some_and(|first| first < line.system(now));
        if is_jumped_over {
            self.first_system_ns = None;
        }
    }

    pub(super) fn first_ns(self) -> u64 {
        self.first_system_ns.map_or(u64::MAX, |first| self.line.simulated(first))
    }

    pub(super) fn cycle_ns(self) -> u64 {
        self.cycle_ns
    }

    /// The first pulse strictly after `now`.
    pub(super) fn next_after(self, now: u64) -> u64 {
        self.next_system_after(now).map_or(u64::MAX, |next| self.line.simulated(next))
    }

    /// The same in system time; `None` if no pulse comes.
    pub(super) fn next_system_after(self, now: u64) -> Option<u64> {
        let passed = self.pulses_until(now).checked_mul(self.cycle_ns)?;
        self.first_system_ns?.checked_add(passed)
    }

    fn since_first(self, now: u64) -> Option<u64> {
        self.line.system(now).checked_sub(self.first_system_ns?)
    }

    /// Number of pulses from the first one up to and including `now`.
    pub(super) fn pulses_until(self, now: u64) -> u64 {
        self.since_first(now).map_or(0, |ns| (ns / self.cycle_ns).saturating_add(1))
    }

    /// Distance from the last pulse at or before `now`; 0 before the first one.
    pub(super) fn phase(self, now: u64) -> u64 {
        self.since_first(now).map_or(0, |ns| ns % self.cycle_ns)
    }
}

/// Writes to SM2 against the pulses.
#[derive(Clone, Debug)]
pub(super) struct OutputTiming {
    window: Sync0Window,
    /// SM2 holds an image that the firmware has missed.
    pub(super) is_image_missed: bool,
    missed_in_a_row: u32,
}

impl OutputTiming {
    pub(super) fn new(window: Sync0Window) -> Self {
        Self { window, is_image_missed: false, missed_in_a_row: 0 }
    }

    pub(super) fn restart(&mut self) {
        *self = Self::new(self.window);
    }

    /// Returns true if outputs that are complete at this time are missed.
    fn is_missed(&self, pulses: Option<PulseTrain>, arrival: u64) -> bool {
        let Some(pulses) = pulses.filter(|_| !self.window.is_off()) else { return false };
        let has_begun = pulses.pulses_until(arrival) > 0;
        let ahead = pulses.next_after(arrival).saturating_sub(arrival);
        (has_begun && pulses.phase(arrival) < u64::from(self.window.after_ns))
            || ahead <= u64::from(self.window.before_ns)
    }

    /// A write to SM2 in OP that is complete at `arrival`. Returns true if it is missed.
    pub(super) fn outputs_written(&mut self, pulses: Option<PulseTrain>, arrival: u64) -> bool {
        self.is_image_missed = self.is_missed(pulses, arrival);
        self.count(self.is_image_missed);
        self.is_image_missed
    }

    /// A write to SM2 in OP that was rejected because the buffer is full. Returns true if the buffer
    /// holds a missed image: the firmware reads it in the next service.
    pub(super) fn write_rejected(&mut self, pulses: Option<PulseTrain>, arrival: u64) -> bool {
        if self.is_missed(pulses, arrival) {
            self.count(true);
        }
        std::mem::take(&mut self.is_image_missed)
    }

    fn count(&mut self, is_missed: bool) {
        self.missed_in_a_row = if is_missed { self.missed_in_a_row.saturating_add(1) } else { 0 };
    }

    /// AL status code if too many writes in a row were missed.
    pub(super) fn error(&self) -> Option<AlStatusCode> {
        let Sync0Window { missed_limit, al_status, .. } = self.window;
        (missed_limit > 0 && self.missed_in_a_row >= missed_limit).then_some(al_status)
    }
}

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
    use super::{LinearClock, *};
    use crate::gateway::config::Sync0;

    /// Largest difference to simulated time in the last `look` of `count` corrections.
    fn worst(clock: &mut DcClock, count: u64, look: u64) -> i64 {
        let mut worst = 0;
        for number in 1..=count {
            let now = number * 1_000_000;
            clock.correct(now, now);
            if number > count - look {
                worst = worst.max(clock.difference_ns.abs());
            }
        }
        worst
    }

    #[test]
    fn uncorrected_clock_drifts() {
        let mut clock = DcClock::new(50_000);
        clock.write(7_000, 1_000);
        assert_eq!(clock.written_time(1_000_001_000), Some(1_000_057_000));
        let line = clock.line;
        for now in [1_000, 1_001, 12_345_678, 5_000_000_123] {
            let there = line.simulated(line.system(now));
            assert!(there.abs_diff(now) <= 1, "{now} became {there}");
        }
    }

    #[test]
    fn corrections_remove_drift_and_offset() {
        for drift_ppb in [-50_000, 0, 50_000] {
            let mut clock = DcClock::new(drift_ppb);
            clock.write(300_000, 0);
            assert!(worst(&mut clock, 1_000, 100) < 20, "drift {drift_ppb}");
        }
    }

    /// The largest rate takes away what the largest step corrects in a cycle of 4 ms.
    #[test]
    fn wrong_rate_is_forgotten() {
        let mut clock = DcClock::new(60_000);
        let cycle_ns = 4_000_000;
        clock.line.rate_ppb += MAX_RATE_PPB;
        clock.jump(60_000, 0);
        for number in 1..=1_000 {
            clock.correct(number * cycle_ns, number * cycle_ns);
        }
        assert!(clock.difference_ns.abs() < 20, "{} ns", clock.difference_ns);
    }

    #[test]
    fn jump_is_pulled_back_slowly() {
        let mut clock = DcClock::new(0);
        clock.write(0, 0);
        clock.jump(100_000, 0);
        clock.correct(1_000_000, 1_000_000);
        assert_eq!(clock.written_time(1_000_000), Some(1_100_000 - MAX_STEP_NS as u64));
        assert!(worst(&mut clock, 2_000, 100) < 20);
    }

    #[test]
    fn pulses_follow_a_changed_clock() {
        let mut clock = DistributedClock::new(0);
        clock.set_sync0(Some(Sync0 { start_ns: 1_000, cycle_ns: 1_000, shift_ns: 0 }), 0);
        assert_eq!(clock.pulses.map(|pulses| pulses.next_after(2_500)), Some(3_000));
        clock.change(2_500, |clock| clock.jump(100, 2_500));
        assert_eq!(clock.pulses.map(|pulses| pulses.next_after(2_500)), Some(2_900));
    }

    /// Pulses at 1, 2, 3 ms and so on.
    fn pulses() -> Option<PulseTrain> {
        let sync0 = Sync0 { start_ns: 1_000_000, cycle_ns: 1_000_000, shift_ns: 0 };
        Some(PulseTrain::new(sync0, LinearClock::default(), 0))
    }

    #[test]
    fn window_lies_around_each_pulse() {
        let mut timing = OutputTiming::new(Sync0Window::default());
        let mut missed = |at| timing.outputs_written(pulses(), at);
        for pulse in [1_000_000, 7_000_000] {
            let at = |distance: i64| u64::saturating_add_signed(pulse, distance);
            assert!(!missed(at(-50_001)));
            assert!(missed(at(-50_000)) && missed(at(0)) && missed(at(19_999)));
            assert!(!missed(at(20_000)) && !missed(at(500_000)));
        }
        assert!(!missed(0) && !missed(900_000), "before the first pulse");
    }

    #[test]
    fn window_that_is_off_misses_nothing() {
        let mut timing = OutputTiming::new(Sync0Window::OFF);
        assert!(!timing.outputs_written(pulses(), 1_000_000));
        let mut timing = OutputTiming::new(Sync0Window::default());
        assert!(!timing.outputs_written(None, 1_000_000), "no pulses");
    }

    #[test]
    fn row_of_missed_writes_ends_with_a_write_in_time() {
        let window = Sync0Window { missed_limit: 3, ..Sync0Window::default() };
        let mut timing = OutputTiming::new(window);
        assert!(timing.outputs_written(pulses(), 1_000_000));
        assert!(timing.write_rejected(pulses(), 2_000_000), "holds the missed image");
        assert!(!timing.outputs_written(pulses(), 2_500_000));
        assert_eq!(timing.error(), None);
        for cycle in 3..5 {
            timing.outputs_written(pulses(), cycle * 1_000_000);
        }
        assert_eq!(timing.error(), None);
        timing.write_rejected(pulses(), 5_000_000);
        assert_eq!(timing.error(), Some(AlStatusCode::SYNC_ERROR));
        timing.restart();
        assert_eq!(timing.error(), None);
    }

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
