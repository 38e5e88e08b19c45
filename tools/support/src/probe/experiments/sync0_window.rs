//! Outputs around a Sync0 pulse (manual 15.6.1, 16.1).

use std::time::Duration;

use ecan_host::{Delivery, ImageTimes, Plan};
use ecan_protocol::device::AlState;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::measured::MissedImages;
use crate::probe::outcome::{Outcome, Verdict};
use crate::probe::run::Probe;
use crate::probe::session::Session;
use crate::probe::setup::Setup;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H44", "S55"],
        key: "sync0_window",
        stage: Stage::Op,
        assumption: "outputs that arrive from 50 us before to 20 us after a Sync0 pulse are missed",
        run: window,
    },
    Experiment {
        rows: &["H44", "S55"],
        key: "sync0_window",
        stage: Stage::Op,
        assumption: "OP ends with AL status 0x1A after ten missed outputs in a row",
        run: loss_of_op,
    },
];

const CYCLE_NS: u64 = 4_000_000;
const SHIFT_NS: u64 = 3_000_000;
/// Distances of an image from the pulse that are tried, in us: from before the pulse to after it.
const FIRST_US: i64 = 300;
const LAST_US: i64 = -150;
const STEP_US: usize = 10;
/// Assumed window around the pulse, in us, and the deviation by the delays of the host.
const BEFORE_US: i64 = 50;
const AFTER_US: i64 = 20;
const TOLERANCE_US: i64 = 30;
/// Deviation of sends from which the host is too slow to contradict, in us.
const SLOW_US: i64 = 20;
/// Cycles with outputs within the window.
const LOSS_CYCLES: u32 = 40;
const SYNC_ERROR: u16 = 0x1A;
const FATAL_SYNC: u16 = 0x2C;

fn setup() -> Setup {
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
fn measure(probe: &mut Probe) -> Result<MissedImages> {
    if let Some(missed) = probe.missed {
        return Ok(missed);
    }
    let session = probe.session(&setup())?;
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
    let plan = Plan::of(&setup().adapter(0, 0));
    let wire_ns = plan.slaves.first().map_or(0, |slave| slave.outputs_arrive_ns);
    ((wire_ns + u64::from(ImageTimes::default().transport_ns)) / 1_000) as i64
}

fn window(probe: &mut Probe) -> Result<Outcome> {
    let missed = measure(probe)?;
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
    let is_near = |found: i64, expected: i64| found.abs_diff(expected) <= TOLERANCE_US as u64;
    let is_met = is_near(first, way_us() + BEFORE_US) && is_near(last, way_us() - AFTER_US);
    Ok(missed.unless_host_is_slow(Outcome::decided(is_met, detail)))
}

fn loss_of_op(probe: &mut Probe) -> Result<Outcome> {
    let missed = measure(probe)?;
    let Some((first, last)) = missed.range_us else {
        return Ok(Outcome::undecided("no image is missed"));
    };
    let session = probe.session(&setup())?;
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
