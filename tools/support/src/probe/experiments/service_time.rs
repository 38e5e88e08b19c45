//! Times at which the firmware reads images: the data-path service, and outputs around a Sync0 pulse (manual
//! 15.6.1, 16.1).

use std::ops::RangeInclusive;
use std::time::Duration;

use ecan_host::{Delivery, ImageTimes, Plan};
use ecan_protocol::device::AlState;

use crate::probe::outcome::{Outcome, Result, Verdict, unavailable};
use crate::probe::run::{MissedImages, Probe, ServiceTime};
use crate::probe::session::{Session, Setup};

/// Tries per distance.
const TRIES: u64 = 32;
/// Step of the phase between tries, in ns: not a divisor of a likely period.
const PHASE_STEP_NS: u64 = 67_000;
/// Largest spread of a constant delay, in us.
const CONSTANT_US: u32 = 20;
/// Delay of the assumption and its tolerance, in us.
const ASSUMED_US: u32 = 30;
const TOLERANCE_US: u32 = 10;
/// Distances in a row at which all images were taken.
const ENOUGH: u32 = 8;
/// Part of the tries that a host which is not in real time may spoil: one of 50.
const OUTLIER_PART: usize = 50;
/// Neighbours on each side for a share of taken images.
const NEAR: usize = 8;
/// A service whose shortest wait is below this, in us, does not follow the writes.
const FREE_US: u32 = 10;

impl ServiceTime {
    /// From the distance of each try, with its result. `outliers` tries may be wrong.
    fn of(mut tries: Vec<(u32, bool)>, outliers: usize, resolution_us: u32) -> Option<Self> {
        tries.sort_unstable();
        let least_us = tries.first()?.0;
        let not_taken = |attempt: &&(u32, bool)| !attempt.1;
        let first_taken_us = tries.iter().filter(|attempt| attempt.1).nth(outliers)?.0;
        let below = tries
            .iter()
            .map(|attempt| attempt.0)
            .filter(|distance_us| *distance_us < first_taken_us);
        let is_ever_missed = tries.iter().filter(not_taken).count() > outliers;
        let never_us = below.max().filter(|_| is_ever_missed).unwrap_or(0);
        let last_missed_us =
            tries.iter().rev().filter(not_taken).nth(outliers).map_or(0, |attempt| attempt.0);
        let always_us = tries
            .iter()
            .map(|attempt| attempt.0)
            .find(|distance_us| *distance_us > last_missed_us)?;
        let mut mean = 0.0;
        let mut previous_us = 0;
        for (at, (distance_us, _)) in tries.iter().enumerate() {
            let near = &tries[at.saturating_sub(NEAR)..tries.len().min(at + NEAR)];
            let missed = near.iter().filter(not_taken).count() as f64 / near.len() as f64;
            mean += f64::from(distance_us - previous_us) * missed;
            previous_us = *distance_us;
        }
        Some(Self {
            least_us,
            never_us,
            last_missed_us,
            always_us,
            mean_us: mean as u32,
            resolution_us,
        })
    }

    pub(crate) fn is_constant(self) -> bool {
        self.always_us - self.never_us.min(self.always_us)
            <= CONSTANT_US.max(self.least_us) + self.resolution_us
    }

    /// Shortest wait of an even distribution, between these values: the longest one is not more exact.
    fn shortest_us(self) -> RangeInclusive<u32> {
        let from = |longest_us| (2 * self.mean_us).saturating_sub(longest_us);
        from(self.always_us)..=from(self.last_missed_us)
    }

    fn is_free(self) -> bool {
        !self.is_constant() && *self.shortest_us().start() < FREE_US + self.resolution_us
    }

    fn text(self) -> String {
        let Self { least_us, never_us, always_us, resolution_us, .. } = self;
        let mut text = match never_us {
            0 => format!(
                "a second image was always taken {always_us} us after the first one; the shortest distance was \
                 {least_us} us"
            ),
            _ => format!(
                "a second image was never taken {never_us} us after the first one, and always after {always_us} us"
            ),
        };
        if resolution_us > 0 {
            text += &format!(", with {resolution_us} us for a send");
        }
        text
    }
}

/// Two images and their distance.
#[derive(Clone, Copy, Debug)]
struct Try {
    distance_us: u32,
    is_taken: bool,
    /// Time of the second exchange, in ns: long if the host was interrupted.
    took_ns: u64,
}

/// Sends two images; the gateway takes the second one if it has read SM2 before.
fn send_two(session: &mut Session, phase_ns: u64, distance_ns: u64) -> Result<Try> {
    session.cycles(1)?;
    session.adapter.wait_next_cycle();
    let clock = session.adapter.ecrt().clock().clone();
    clock.sleep_until_ns(clock.now_ns() + phase_ns);
    let first_ns = session.exchange(|_, _| (), |_| ())?.sent_ns;
    session.expect_no_response();
    clock.sleep_until_ns(session.adapter.cycle_start().deadline_ns + first_ns + distance_ns);
    let start = clock.now_ns();
    let second_ns = session.exchange(|_, _| (), |_| ())?.sent_ns;
    let took_ns = clock.now_ns() - start;
    let is_taken = session.cycle(|_, _| ())?.outputs == Delivery::Confirmed;
    session.take();
    let distance_us = u32::try_from((second_ns - first_ns) / 1_000).unwrap_or(u32::MAX);
    Ok(Try { distance_us, is_taken, took_ns })
}

/// Usual time of an exchange, in ns.
fn usual_ns(tries: &[Try]) -> u64 {
    let mut took: Vec<_> = tries.iter().map(|attempt| attempt.took_ns).collect();
    took.sort_unstable();
    took.get(took.len() / 2).copied().unwrap_or(0)
}

/// Distance and result of the tries in which the host was not interrupted.
fn undisturbed(tries: &[Try], usual_ns: u64) -> Vec<(u32, bool)> {
    let undisturbed = tries.iter().filter(|attempt| attempt.took_ns <= 2 * usual_ns + 20_000);
    undisturbed.map(|attempt| (attempt.distance_us, attempt.is_taken)).collect()
}

fn distances_us() -> impl Iterator<Item = u32> {
    (10..100).step_by(10).chain((100..300).step_by(20)).chain((300..=1200).step_by(50))
}

fn measure_service(probe: &mut Probe) -> Result<ServiceTime> {
    if let Some(time) = probe.service {
        return Ok(time);
    }
    let setup = Setup { cycle: Duration::from_millis(5), ..Setup::plain() };
    let session = probe.session(&setup)?;
    let (mut tries, mut nth, mut always) = (Vec::new(), 0, 0);
    for distance_us in distances_us() {
        let before = tries.len();
        for _ in 0..TRIES {
            nth += 1;
            let phase_ns = nth * PHASE_STEP_NS % 1_000_000;
            tries.push(send_two(session, phase_ns, u64::from(distance_us) * 1_000)?);
        }
        let all = tries[before..].iter().all(|attempt| attempt.is_taken);
        always = if all { always + 1 } else { 0 };
        if always == ENOUGH {
            break;
        }
    }
    let usual_ns = usual_ns(&tries);
    let tries = undisturbed(&tries, usual_ns);
    // In stepped time every distance is exact.
    let is_exact = tries.iter().all(|attempt| attempt.0 % 10 == 0);
    let outliers = if is_exact { 0 } else { tries.len() / OUTLIER_PART };
    let Some(time) = ServiceTime::of(tries, outliers, (usual_ns / 1_000) as u32) else {
        return unavailable("a second image is not taken even after 1.2 ms");
    };
    probe.profile.service_us = Some(time.always_us);
    probe.service = Some(time);
    Ok(time)
}

pub(in crate::probe) fn service_period(probe: &mut Probe) -> Result<Outcome> {
    let time = measure_service(probe)?;
    Ok(match time.is_free() {
        false => Outcome::holds(time.text()),
        true => Outcome::differs(format!("{}, as with a loop of that period", time.text()))
            .like(time.always_us),
    })
}

pub(in crate::probe) fn service_delay(probe: &mut Probe) -> Result<Outcome> {
    let time = measure_service(probe)?;
    if time.is_free() {
        return Ok(Outcome::undecided(format!(
            "the service does not follow the write: {}",
            time.text()
        )));
    }
    let constant = time.always_us..=time.always_us;
    let shortest = if time.is_constant() { constant } else { time.shortest_us() };
    // A host that cannot send two images so fast does not contradict.
    let is_below_host =
        time.never_us == 0 && time.least_us + TOLERANCE_US + time.resolution_us > ASSUMED_US;
    let tolerance_us = TOLERANCE_US + time.resolution_us;
    let is_near = shortest.start().saturating_sub(tolerance_us) <= ASSUMED_US
        && ASSUMED_US <= shortest.end() + tolerance_us;
    Ok(Outcome::decided(is_below_host || is_near, time.text()).like(*shortest.start()))
}

pub(in crate::probe) fn service_jitter(probe: &mut Probe) -> Result<Outcome> {
    let time = measure_service(probe)?;
    if time.is_free() {
        return Ok(Outcome::undecided(format!(
            "the service does not follow the write: {}",
            time.text()
        )));
    }
    let spread = time.always_us - time.never_us;
    Ok(Outcome::decided(time.is_constant(), time.text()).like(spread))
}

const CYCLE_NS: u64 = 4_000_000;
const SHIFT_NS: u64 = 3_000_000;
/// Distances of an image from the pulse that are tried, in us: from before the pulse to after it.
const FIRST_US: i64 = 300;
const LAST_US: i64 = -150;
const STEP_US: usize = 10;
/// Assumed window around the pulse, in us, and the deviation by the delays of the host.
const BEFORE_US: i64 = 50;
const AFTER_US: i64 = 20;
const WINDOW_TOLERANCE_US: i64 = 30;
/// Deviation of sends from which the host is too slow to contradict, in us.
const SLOW_US: i64 = 20;
/// Cycles with outputs within the window.
const LOSS_CYCLES: u32 = 40;
const SYNC_ERROR: u16 = 0x1A;
const FATAL_SYNC: u16 = 0x2C;

fn sync0_setup() -> Setup {
    let sync0_shift = Some(Duration::from_nanos(SHIFT_NS));
    Setup { cycle: Duration::from_nanos(CYCLE_NS), sync0_shift, ..Setup::plain() }
}

/// Waits until this time before the pulse of the next cycle, in us, and sends an image. Returns the time that it
/// was sent before the pulse, and the duration of the exchange, in us.
fn send_before(session: &mut Session, before_us: i64) -> Result<(i64, i64)> {
    session.adapter.wait_next_cycle();
    let pulse_ns = session.adapter.cycle_start().deadline_ns + SHIFT_NS;
    let clock = session.adapter.ecrt().clock().clone();
    clock.sleep_until_ns(pulse_ns.saturating_add_signed(-before_us * 1_000));
    let start_ns = clock.now_ns();
    let sent_ns = session.exchange(|_, _| (), |_| ())?.sent_ns;
    let took_ns = clock.now_ns() - start_ns;
    Ok(((SHIFT_NS as i64 - sent_ns as i64) / 1_000, (took_ns / 1_000) as i64))
}

impl MissedImages {
    /// A difference that the delays of the host may have caused decides nothing.
    fn unless_host_is_slow(self, outcome: Outcome) -> Outcome {
        let Self { resolution_us, .. } = self;
        if outcome.verdict == Verdict::Differs && resolution_us > SLOW_US {
            let detail = outcome.detail;
            return Outcome::undecided(format!(
                "{detail}; sends of the host deviate by {resolution_us} us: use the real-time options"
            ));
        }
        outcome
    }
}

/// The firmware missed an image if it stays in SM2, so that the next one is rejected.
fn measure_missed(probe: &mut Probe) -> Result<MissedImages> {
    if let Some(missed) = probe.missed {
        return Ok(missed);
    }
    let session = probe.session(&sync0_setup())?;
    let (mut missed, mut deviations) = (Vec::new(), Vec::new());
    for before_us in (LAST_US..=FIRST_US).rev().step_by(STEP_US) {
        session.cycles(2)?;
        let (sent_us, took_us) = send_before(session, before_us)?;
        session.cycles(1)?;
        if session.cycle(|_, _| ())?.outputs == Delivery::Missed {
            missed.push(sent_us);
        }
        session.take();
        deviations.push((before_us - sent_us).abs() + took_us);
    }
    deviations.sort_unstable();
    let range_us = missed.iter().copied().max().zip(missed.iter().copied().min());
    let resolution_us = deviations.get(deviations.len() / 2).copied().unwrap_or(0);
    let missed = MissedImages { range_us, resolution_us };
    probe.missed = Some(missed);
    if resolution_us <= SLOW_US {
        let whole = |us: i64| u32::try_from(us.max(0)).unwrap_or(0);
        let window = |(first, last)| (whole(first - way_us()), whole(way_us() - last));
        probe.profile.sync0_window_us = Some(range_us.map_or((0, 0), window));
    }
    Ok(missed)
}

/// Time from the send to the arrival, in us.
fn way_us() -> i64 {
    let plan = Plan::of(&sync0_setup().adapter(0, 0));
    let wire_ns = plan.slaves.first().map_or(0, |slave| slave.outputs_arrive_ns);
    ((wire_ns + u64::from(ImageTimes::default().transport_ns)) / 1_000) as i64
}

pub(in crate::probe) fn sync0_window(probe: &mut Probe) -> Result<Outcome> {
    let missed = measure_missed(probe)?;
    let Some((first, last)) = missed.range_us else {
        let detail = format!(
            "no image was missed that was sent from {FIRST_US} us before to {} us after a pulse",
            -LAST_US
        );
        let outcome = Outcome::differs(detail).like("{ before_us = 0, after_us = 0 }");
        return Ok(missed.unless_host_is_slow(outcome));
    };
    let detail = format!(
        "images that were sent {first} to {last} us before a pulse were missed; they arrive some {} us later",
        way_us()
    );
    let is_near =
        |found: i64, expected: i64| found.abs_diff(expected) <= WINDOW_TOLERANCE_US as u64;
    let is_met = is_near(first, way_us() + BEFORE_US) && is_near(last, way_us() - AFTER_US);
    Ok(missed.unless_host_is_slow(Outcome::decided(is_met, detail)))
}

pub(in crate::probe) fn loss_of_op(probe: &mut Probe) -> Result<Outcome> {
    let missed = measure_missed(probe)?;
    let Some((first, last)) = missed.range_us else {
        return Ok(Outcome::undecided("no image is missed"));
    };
    let session = probe.session(&sync0_setup())?;
    let mut lost = None;
    for cycle in 1..=LOSS_CYCLES {
        send_before(session, i64::midpoint(first, last))?;
        let code = session.poll_al_status()?;
        if code != 0 {
            lost = Some((code, cycle));
            break;
        }
    }
    let state = session.al_status()?.0;
    // The master may have brought it back.
    let is_op = session.take_missed() == 0 && state == Some(AlState::Op);
    probe.end_session()?;
    let outcome = match lost {
        Some((code, cycle)) => {
            let detail =
                format!("AL status 0x{code:02X} was read {cycle} cycles after the first one");
            match code {
                SYNC_ERROR => Outcome::holds(detail),
                FATAL_SYNC => Outcome::differs(detail).like("{ al_status = 0x2C }"),
                _ => Outcome::differs(detail),
            }
        }
        None if is_op => Outcome::differs(format!("OP was kept for {LOSS_CYCLES} cycles"))
            .like("{ missed_limit = 0 }"),
        None => Outcome::undecided("OP was lost, but the AL status code was not read in time"),
    };
    Ok(missed.unless_host_is_slow(outcome))
}
