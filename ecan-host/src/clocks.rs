//! Distributed clocks in the cycle: which clock leads, and how far they are apart.

use ecrt_sys::Errno;

use crate::config::{ClockSource, DcSync};
use crate::exchange::CycleError;
use crate::master::Master;

/// Differences of the clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClockStatus {
    /// Delay of the host relative to the reference clock in the last cycle with a reading, in
    /// nanoseconds, within half a Sync0 period; the host's own waiting and working time since
    /// the point of its grid is taken off. None before the first reading.
    pub phase_error_ns: Option<i32>,
    /// The phase errors have become small: below 0.2 % of the cycle in the mean.
    pub is_locked: bool,
    /// Rate of the host's clock relative to the reference clock, in parts per billion. Known
    /// while the host follows; otherwise 0.
    pub rate_ppb: i32,
    /// Upper estimate of the differences between the slaves' clocks as last measured, in
    /// nanoseconds. None before the first measurement.
    pub synchrony_ns: Option<u32>,
    /// Cycles since the first reading in which the reference clock could not be read: the frame did
    /// not come back, or what it brought is no time that follows the one before.
    pub missed_readings: u64,
}

/// The frame of the cycle before, as the clocks need it.
#[derive(Debug, Clone, Copy)]
struct Sent {
    /// Application time of its cycle.
    time_ns: u64,
    /// Point of the grid of its cycle.
    point_ns: u64,
    /// When it left, after the point of the grid.
    late_ns: u64,
    carries_monitor: bool,
}

#[derive(Debug, Clone, Copy)]
struct Reading {
    /// Lower half of its time.
    time: u32,
    /// When the frame left, on the host's clock.
    sent_ns: u64,
}

impl Reading {
    /// Returns whether it can be the time of a clock that showed `before`. When the reference slave is gone
    /// the library repeats the last value.
    fn follows(&self, before: Self, cycle_ns: u32) -> bool {
        let passed = self.sent_ns.saturating_sub(before.sent_ns);
        let counted = self.time.wrapping_sub(before.time);
        let error = (counted.wrapping_sub(passed as u32) as i32).unsigned_abs();
        u64::from(error) <= u64::from(cycle_ns / 4) + passed / 1_000
    }
}

#[derive(Debug)]
pub(crate) struct DistributedClocks {
    dc: DcSync,
    cycle_ns: u32,
    /// Application time of the running cycle: steps by whole cycles, as the reference clock does.
    time_ns: Option<u64>,
    /// Point of the grid of the running cycle, on the host's clock.
    point_ns: u64,
    correction_ns: i64,
    sent: Option<Sent>,
    /// The last reading, whether it was of use or not.
    read: Option<Reading>,
    cycles: u32,
    /// Slaves that answered in the last cycle.
    answering: usize,
    pll: PhaseLockedLoop,
    status: ClockStatus,
}

impl DistributedClocks {
    pub(crate) fn new(dc: DcSync, cycle_ns: u32) -> Self {
        Self {
            dc,
            cycle_ns,
            time_ns: None,
            point_ns: 0,
            correction_ns: 0,
            sent: None,
            read: None,
            cycles: 0,
            answering: 0,
            pll: PhaseLockedLoop::new(cycle_ns),
            status: ClockStatus::default(),
        }
    }

    pub(crate) fn status(&self) -> ClockStatus {
        ClockStatus { is_locked: self.pll.is_locked(), ..self.status }
    }

    pub(crate) fn start_cycle(&mut self, point_ns: u64) {
        let cycle = u64::from(self.cycle_ns).max(1);
        self.time_ns = Some(match (self.time_ns, self.dc.source) {
            (None, _) | (_, ClockSource::Host) => point_ns,
            // Shifted deadlines: the number of cycles counts, not their length.
            (Some(time), ClockSource::Reference) => {
                let from = self.point_ns.saturating_add_signed(self.correction_ns);
                let passed = point_ns.saturating_sub(from);
                time + (passed + cycle / 2) / cycle * cycle
            }
        });
        (self.point_ns, self.correction_ns) = (point_ns, 0);
    }

    /// Reads the clocks when the frame of the cycle before is back: `answering` slaves took part in
    /// it. Gives the correction of the next deadline.
    ///
    /// The library writes to stderr when it reads the time of a lost frame, so it is
    /// not called when there is a sign of that.
    pub(crate) fn receive(
        &mut self,
        master: &mut Master,
        answering: usize,
    ) -> Result<i64, CycleError> {
        let is_back =
            answering > 0 && answering >= std::mem::replace(&mut self.answering, answering);
        let Some(sent) = self.sent.take() else { return Ok(self.coast()) };
        if !is_back {
            return Ok(self.miss());
        }
        if sent.carries_monitor {
            let synchrony = master.sync_monitor_process();
            self.status.synchrony_ns = synchrony.ok().or(self.status.synchrony_ns);
        }
        let time = match master.reference_clock_time() {
            Ok(time) => time,
            // Not written yet, or gone with a scan that has just begun.
            Err(Errno::EAGAIN | Errno::ENXIO | Errno::EIO) => return Ok(self.miss()),
            Err(errno) => {
                return Err(CycleError::library("ecrt_master_reference_clock_time")(errno));
            }
        };
        let reading = Reading { time, sent_ns: sent.point_ns.wrapping_add(sent.late_ns) };
        let before = self.read.replace(reading);
        if !before.is_some_and(|before| reading.follows(before, self.cycle_ns)) {
            return Ok(self.miss());
        }
        let expected = sent.time_ns.wrapping_add(sent.late_ns) as u32;
        let error = centred(i64::from(time.wrapping_sub(expected) as i32), self.dc.cycle_ns());
        self.status.phase_error_ns = i32::try_from(error).ok();
        if self.dc.source == ClockSource::Host {
            self.pll.update(error);
            return Ok(0);
        }
        // Whole cycles are made up for by counting, so that no deadline moves by more than half of
        // one where Sync0 comes every few cycles.
        let within = centred(error, self.cycle_ns);
        self.time_ns = self.time_ns.map(|time| time.wrapping_add_signed(error - within));
        self.correction_ns = self.pll.update(within);
        self.status.rate_ppb = self.pll.rate_ppb();
        Ok(self.correction_ns)
    }

    fn miss(&mut self) -> i64 {
        // Until the slaves answer for the first time there is nothing to miss.
        self.status.missed_readings += u64::from(self.status.phase_error_ns.is_some());
        self.coast()
    }

    fn coast(&mut self) -> i64 {
        self.correction_ns = match self.dc.source {
            ClockSource::Host => 0,
            ClockSource::Reference => self.pll.coast(),
        };
        self.correction_ns
    }

    /// Queues what keeps the clocks together, last before the send.
    pub(crate) fn send(&mut self, master: &mut Master, now_ns: u64) -> Result<(), CycleError> {
        let Some(time_ns) = self.time_ns else { return Ok(()) };
        let late_ns = now_ns.saturating_sub(self.point_ns);
        let sent = master.application_time(time_ns);
        sent.map_err(CycleError::library("ecrt_master_application_time"))?;
        if self.dc.source == ClockSource::Host {
            // With the time of leaving, delays of the cycle do not reach the clocks.
            let led = lead(master, time_ns, time_ns.wrapping_add(late_ns));
            let failed = CycleError::library("ecrt_master_sync_reference_clock");
            has_clock(led).map_err(failed)?;
        }
        let failed = CycleError::library("ecrt_master_sync_slave_clocks");
        if !has_clock(master.sync_slave_clocks()).map_err(failed)? {
            return Ok(());
        }
        self.cycles = self.cycles.wrapping_add(1);
        let every = self.dc.monitor_every;
        let carries_monitor = every > 0 && self.cycles.is_multiple_of(every);
        if carries_monitor {
            let failed = CycleError::library("ecrt_master_sync_monitor_queue");
            master.sync_monitor_queue().map_err(failed)?;
        }
        self.sent = Some(Sent { time_ns, point_ns: self.point_ns, late_ns, carries_monitor });
        Ok(())
    }

    /// Between two cycles, while slaves start: the master calculates the offsets of their clocks from
    /// the last application time, and they follow the faster, the more often they are led. The cycle
    /// that follows has no reading.
    pub(crate) fn send_between_cycles(
        &mut self,
        master: &mut Master,
        now_ns: u64,
    ) -> Result<(), Errno> {
        let Some(time_ns) = self.time_ns else { return Ok(()) };
        self.sent = None;
        let leaves_ns = time_ns.wrapping_add(now_ns.saturating_sub(self.point_ns));
        master.application_time(leaves_ns)?;
        if self.dc.source == ClockSource::Host {
            has_clock(lead(master, leaves_ns, leaves_ns))?;
        }
        has_clock(master.sync_slave_clocks()).map(|_| ())
    }
}

/// Leads the reference clock to the time at which the frame leaves.
fn lead(master: &mut Master, time_ns: u64, leaves_ns: u64) -> Result<(), Errno> {
    match master.sync_reference_clock_to(leaves_ns) {
        Err(Errno::ENOSYS) => lead_by_application_time(master, time_ns, leaves_ns),
        led => led,
    }
}

/// As `sync_reference_clock_to`, which 1.5.2 does not have: there the application time is sent.
fn lead_by_application_time(
    master: &mut Master,
    time_ns: u64,
    leaves_ns: u64,
) -> Result<(), Errno> {
    master.application_time(leaves_ns)?;
    let led = master.sync_reference_clock();
    master.application_time(time_ns)?;
    led
}

/// The nearest way round a period.
fn centred(error_ns: i64, period_ns: u32) -> i64 {
    let period = i64::from(period_ns).max(1);
    let error = error_ns.rem_euclid(period);
    if error * 2 >= period { error - period } else { error }
}

/// Returns whether there is a reference clock; while the bus is scanned there is none.
fn has_clock(result: Result<(), Errno>) -> Result<bool, Errno> {
    match result {
        Ok(()) => Ok(true),
        Err(Errno::ENXIO) => Ok(false),
        Err(errno) => Err(errno),
    }
}

/// Share of the phase error that the next cycle takes away.
const PROPORTIONAL: f64 = 1.0 / 16.0;
/// Share of it that every later cycle takes away too: the rate that the loop learns. A quarter of
/// the proportional share squared damps it critically.
const INTEGRAL: f64 = PROPORTIONAL * PROPORTIONAL / 4.0;
/// Longest correction of a cycle for its phase, as a share of the cycle. Larger errors are worked
/// off at this pace, so that no cycle becomes much shorter than the others.
const MAX_SHIFT: f64 = 0.01;
/// Largest difference of two oscillators that is believed: 1000 ppm.
const MAX_RATE: f64 = 0.001;
/// Mean size of the phase error below which the loop is locked, as a share of the cycle, and how
/// many errors that mean follows.
const LOCKED: f64 = 0.002;
const MEAN_OVER: f64 = 32.0;

/// A proportional and integral loop over the phase error of each cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PhaseLockedLoop {
    cycle_ns: f64,
    /// Correction of every cycle for the difference of the rates.
    rate_ns: f64,
    /// Part of a nanosecond that no correction has carried yet.
    rest_ns: f64,
    /// Mean size of the phase error; none before the first.
    mean_ns: Option<f64>,
    /// The next phase error is of a cycle before the first correction took effect.
    is_stale: bool,
}

impl PhaseLockedLoop {
    pub(crate) fn new(cycle_ns: u32) -> Self {
        let cycle_ns = f64::from(cycle_ns);
        Self { cycle_ns, rate_ns: 0.0, rest_ns: 0.0, mean_ns: None, is_stale: false }
    }

    /// Takes the phase error of a cycle, positive where the host is late, and gives what is to be
    /// added to the next deadline, in nanoseconds. The first error is taken away at once: no slave
    /// is in OP yet.
    pub(crate) fn update(&mut self, error_ns: i64) -> i64 {
        let error = error_ns as f64;
        let Some(mean) = self.mean_ns else {
            self.mean_ns = Some(self.cycle_ns);
            self.is_stale = true;
            return -error_ns;
        };
        if std::mem::take(&mut self.is_stale) {
            return self.coast();
        }
        self.mean_ns = Some(mean + (error.abs() - mean) / MEAN_OVER);
        let limit = self.cycle_ns * MAX_SHIFT;
        let unlimited = -error * PROPORTIONAL;
        let shift = unlimited.clamp(-limit, limit);
        // An error that is corrected at the limit contains no information about the rate.
        if shift == unlimited {
            let limit = self.cycle_ns * MAX_RATE;
            self.rate_ns = (self.rate_ns - error * INTEGRAL).clamp(-limit, limit);
        }
        self.correct_by(shift + self.rate_ns)
    }

    /// Correction without a phase error: the rates still differ.
    pub(crate) fn coast(&mut self) -> i64 {
        self.correct_by(self.rate_ns)
    }

    fn correct_by(&mut self, ns: f64) -> i64 {
        let whole = (ns + self.rest_ns).round();
        self.rest_ns += ns - whole;
        whole as i64
    }

    pub(crate) fn is_locked(&self) -> bool {
        self.mean_ns.is_some_and(|mean| mean < self.cycle_ns * LOCKED)
    }

    /// Rate of the host's clock relative to the other, in parts per billion.
    pub(crate) fn rate_ppb(&self) -> i32 {
        (self.rate_ns / self.cycle_ns * 1e9).round() as i32
    }
}

#[cfg(test)]
mod tests {
    use super::{PhaseLockedLoop, *};

    #[test]
    fn reading_follows_over_the_wrap_of_the_system_time() {
        let before = Reading { time: u32::MAX - 400_000, sent_ns: 5_000_000_000 };
        let after = |passed: u64, counted: u32| {
            let sent_ns = before.sent_ns + passed;
            Reading { time: before.time.wrapping_add(counted), sent_ns }.follows(before, 1_000_000)
        };
        assert!(after(1_000_000, 1_000_000), "599,999 after the wrap");
        assert!(after(1_000_000, 1_000_050));
        assert!(!after(1_000_000, 0), "the library repeats the last value");
        assert!(!after(1_000_000, 1_300_000));
        // The oscillators may differ by 1000 ppm of an outage.
        assert!(after(2_000_000_000, 2_002_200_000));
        assert!(!after(2_000_000_000, 2_002_300_000));
        // An outage that is longer than the range of the time.
        let range = 1 << 32;
        assert!(after(range + 1_000_000, 1_000_000));
        assert!(!after(range + 1_000_000, 600_000_000));
    }

    const CYCLE_NS: u32 = 1_000_000;

    /// Phase errors of a host whose clock is `fast_ppm` fast and whose first cycle is `start_ns`
    /// late. A correction acts on the cycle after the next, as in the field.
    fn errors(
        start_ns: f64,
        fast_ppm: f64,
        cycles: usize,
        lost: std::ops::Range<usize>,
    ) -> Vec<f64> {
        let mut pll = PhaseLockedLoop::new(CYCLE_NS);
        pll.update(0);
        pll.update(0);
        let (mut phase, mut pending) = (start_ns, 0);
        let mut errors = Vec::new();
        for cycle in 0..cycles {
            errors.push(phase);
            let correction =
                if lost.contains(&cycle) { pll.coast() } else { pll.update(phase.round() as i64) };
            // A fast clock reaches its deadline early.
            phase += f64::from(std::mem::replace(&mut pending, correction as i32));
            phase -= f64::from(CYCLE_NS) * fast_ppm / 1e6;
        }
        errors
    }

    #[test]
    fn loop_settles_from_any_phase_and_drift() {
        for start_ns in [-499_000.0, -20_000.0, 0.0, 3_000.0, 499_000.0] {
            for fast_ppm in [-200.0, -50.0, 0.0, 50.0, 200.0] {
                let errors = errors(start_ns, fast_ppm, 1_500, 0..0);
                let worst = errors[1_000..].iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
                assert!(worst <= 1.0, "{start_ns} ns, {fast_ppm} ppm: {worst} ns");
            }
        }
    }

    #[test]
    fn loop_is_damped() {
        let errors = errors(5_000.0, 0.0, 500, 0..0);
        let past = errors.iter().fold(0.0_f64, |past, error| past.min(*error));
        assert!((-1_000.0..-100.0).contains(&past), "{past} ns beyond the phase");
    }

    #[test]
    fn loop_measures_the_rate_and_reports_the_lock() {
        let mut pll = PhaseLockedLoop::new(CYCLE_NS);
        assert!(!pll.is_locked());
        let mut phase = 100_000;
        for _ in 0..1_500 {
            phase += pll.update(phase) - 50;
        }
        assert!(pll.is_locked());
        assert!(pll.rate_ppb().abs_diff(50_000) < 1_000, "{}", pll.rate_ppb());
        pll.update(400_000);
        assert!(!pll.is_locked());
    }

    #[test]
    fn loop_holds_the_rate_during_lost_frames() {
        let errors = errors(100_000.0, 50.0, 2_000, 1_000..1_100);
        let worst = errors[1_000..].iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
        assert!(worst < 50.0, "{worst} ns after a hundred cycles without a reading");
    }

    #[test]
    fn only_the_first_shift_exceeds_a_hundredth_of_the_cycle() {
        let mut pll = PhaseLockedLoop::new(CYCLE_NS);
        assert_eq!(pll.update(300_000), -300_000);
        assert_eq!(pll.update(300_000), 0, "still of a cycle from before");
        assert_eq!(pll.update(500_000), -10_000);
        assert_eq!(pll.update(-500_000), 10_000);
    }
}
