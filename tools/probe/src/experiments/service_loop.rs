//! Time of the data-path service.

use std::time::Duration;

use ecan_host::Delivery;

use crate::experiment::{Experiment, Stage};
use crate::interruption::Result;
use crate::outcome::Outcome;
use crate::probe::Probe;
use crate::session::Session;
use crate::setup::Setup;

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
const TRIES: u64 = 16;
/// Step of the phase between tries, in ns: not a divisor of a likely period.
const PHASE_STEP_NS: u64 = 67_000;
/// Largest spread of a constant delay, in us.
const CONSTANT_US: u32 = 20;
/// Delay of the assumption and its tolerance, in us.
const ASSUMED_US: u32 = 30;
const TOLERANCE_US: u32 = 10;
/// Shortest wait of a loop that does not follow the writes, in us.
const FREE_US: u32 = 15;

/// Time from an SM2 write until SM2 can be written again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServiceTime {
    /// Largest distance, in us, at which no second write was accepted, and smallest at which all were.
    never_us: u32,
    always_us: u32,
    mean_us: u32,
}

impl ServiceTime {
    fn is_constant(self) -> bool {
        self.always_us - self.never_us <= CONSTANT_US
    }

    /// Shortest wait of an even distribution.
    fn shortest_us(self) -> u32 {
        (2 * self.mean_us).saturating_sub(self.always_us)
    }

    fn is_free(self) -> bool {
        !self.is_constant() && self.shortest_us() < FREE_US
    }

    fn text(self) -> String {
        let Self { never_us, always_us, .. } = self;
        format!(
            "a second image was never taken {never_us} us after the first one, and always after {always_us} us"
        )
    }
}

/// Sends two images at a distance; returns whether the gateway took the second one.
fn is_taken(session: &mut Session, phase_ns: u64, distance_ns: u64) -> Result<bool> {
    session.cycles(1)?;
    session.adapter.wait_next_cycle();
    let clock = session.adapter.ecrt().clock().clone();
    clock.sleep_until_ns(clock.now_ns() + phase_ns);
    let start = clock.now_ns();
    session.exchange(|_, _| (), |_| ())?;
    session.expect_no_response();
    clock.sleep_until_ns(start + distance_ns);
    session.exchange(|_, _| (), |_| ())?;
    let taken = session.cycle(|_, _| ())?.outputs == Delivery::Confirmed;
    session.take();
    Ok(taken)
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
    let (mut never_us, mut always_us, mut mean, mut previous_us) = (0, None, 0, 0);
    let mut nth = 0;
    for distance_us in distances_us() {
        let mut taken = 0;
        for _ in 0..TRIES {
            nth += 1;
            let phase_ns = nth * PHASE_STEP_NS % 1_000_000;
            taken += u64::from(is_taken(session, phase_ns, u64::from(distance_us) * 1_000)?);
        }
        mean += u64::from(distance_us - previous_us) * (TRIES - taken);
        previous_us = distance_us;
        if taken == 0 {
            never_us = distance_us;
        }
        if taken < TRIES {
            always_us = None;
        } else if distance_us - *always_us.get_or_insert(distance_us) >= 100 {
            break;
        }
    }
    let Some(always_us) = always_us else {
        return crate::interruption::unavailable("a second image is not taken even after 1.2 ms");
    };
    let mean_us = u32::try_from(mean / TRIES).unwrap_or(u32::MAX);
    let time = ServiceTime { never_us, always_us, mean_us };
    probe.profile.service_us = Some(always_us);
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
    let shortest = if time.is_constant() { time.always_us } else { time.shortest_us() };
    let is_met = shortest.abs_diff(ASSUMED_US) <= TOLERANCE_US;
    Ok(Outcome::decided(is_met, time.text()).like(shortest))
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
