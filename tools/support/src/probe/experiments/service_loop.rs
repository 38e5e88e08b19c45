//! Time of the data-path service.

use std::ops::RangeInclusive;
use std::time::Duration;

use ecan_host::Delivery;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::{Result, unavailable};
use crate::probe::measured::ServiceTime;
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::session::Session;
use crate::probe::setup::Setup;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["S6"],
        key: "service_period_us",
        stage: Stage::Op,
        assumption: "a service follows each SM2 write, it does not run freely",
        run: period,
    },
    Experiment {
        rows: &["S6"],
        key: "service_delay_us",
        stage: Stage::Op,
        assumption: "the service reads SM2 30 us after the write",
        run: delay,
    },
    Experiment {
        rows: &["S6"],
        key: "service_jitter_us",
        stage: Stage::Op,
        assumption: "the delay of the service is constant",
        run: jitter,
    },
];

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
        let not_taken = |it: &&(u32, bool)| !it.1;
        let first_taken_us = tries.iter().filter(|it| it.1).nth(outliers)?.0;
        let below = tries.iter().map(|it| it.0).filter(|it| *it < first_taken_us);
        let is_ever_missed = tries.iter().filter(not_taken).count() > outliers;
        let never_us = below.max().filter(|_| is_ever_missed).unwrap_or(0);
        let last_missed_us =
            tries.iter().rev().filter(not_taken).nth(outliers).map_or(0, |it| it.0);
        let always_us = tries.iter().map(|it| it.0).find(|it| *it > last_missed_us)?;
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
    let mut took: Vec<_> = tries.iter().map(|it| it.took_ns).collect();
    took.sort_unstable();
    took.get(took.len() / 2).copied().unwrap_or(0)
}

/// Distance and result of the tries in which the host was not interrupted.
fn undisturbed(tries: &[Try], usual_ns: u64) -> Vec<(u32, bool)> {
    let undisturbed = tries.iter().filter(|it| it.took_ns <= 2 * usual_ns + 20_000);
    undisturbed.map(|it| (it.distance_us, it.is_taken)).collect()
}

fn distances_us() -> impl Iterator<Item = u32> {
    (10..100).step_by(10).chain((100..300).step_by(20)).chain((300..=1200).step_by(50))
}

fn measure(probe: &mut Probe) -> Result<ServiceTime> {
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
        let all = tries[before..].iter().all(|it| it.is_taken);
        always = if all { always + 1 } else { 0 };
        if always == ENOUGH {
            break;
        }
    }
    let usual_ns = usual_ns(&tries);
    let tries = undisturbed(&tries, usual_ns);
    // In stepped time every distance is exact.
    let is_exact = tries.iter().all(|it| it.0 % 10 == 0);
    let outliers = if is_exact { 0 } else { tries.len() / OUTLIER_PART };
    let Some(time) = ServiceTime::of(tries, outliers, (usual_ns / 1_000) as u32) else {
        return unavailable("a second image is not taken even after 1.2 ms");
    };
    probe.profile.service_us = Some(time.always_us);
    probe.service = Some(time);
    Ok(time)
}

fn period(probe: &mut Probe) -> Result<Outcome> {
    let time = measure(probe)?;
    Ok(match time.is_free() {
        false => Outcome::holds(time.text()),
        true => Outcome::differs(format!("{}, as with a loop of that period", time.text()))
            .like(time.always_us),
    })
}

fn delay(probe: &mut Probe) -> Result<Outcome> {
    let time = measure(probe)?;
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

fn jitter(probe: &mut Probe) -> Result<Outcome> {
    let time = measure(probe)?;
    if time.is_free() {
        return Ok(Outcome::undecided(format!(
            "the service does not follow the write: {}",
            time.text()
        )));
    }
    let spread = time.always_us - time.never_us;
    Ok(Outcome::decided(time.is_constant(), time.text()).like(spread))
}
