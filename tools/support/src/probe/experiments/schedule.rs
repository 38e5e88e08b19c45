//! Scheduled frames.

use std::collections::BTreeSet;
use std::time::Duration;

use ecan_host::Delivery;
use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{DataPathConfig, McanChannelConfig};
use ecan_protocol::image::{
    EncapsulationProfile, ImageWriter, OptionFlags, ResultCode, Schedule, Timestamp,
};

use super::loopback::{frame, setup};
use crate::probe::outcome::{Outcome, Result};
use crate::probe::run::{Probe, Sample};
use crate::probe::session::{Inputs, Setup};

const CYCLE_NS: u64 = 4_000_000;
const SHIFT_NS: u64 = 3_000_000;

fn with_sync0(probe: &Probe) -> Result<Setup> {
    let can = McanChannelConfig::classic(1_000_000);
    let mut setup = setup(probe, can, DataPathConfig::for_traffic(8, 8))?;
    setup.cycle = Duration::from_nanos(CYCLE_NS);
    setup.sync0_shift = Some(Duration::from_nanos(SHIFT_NS));
    setup.tx.options = OptionFlags::TX_RESULT;
    setup.tx.profile = EncapsulationProfile::CompactTimestamped;
    Ok(setup)
}

/// Sends scheduled frames at several times around a pulse.
fn sample(probe: &mut Probe) -> Result<Vec<Sample>> {
    if let Some(samples) = &probe.samples {
        return Ok(samples.clone());
    }
    let setup = with_sync0(probe)?;
    let session = probe.session(&setup)?;
    let clock = session.adapter.ecrt().clock().clone();
    let mut samples = Vec::new();
    let before_us = [400, 250, 190, 150, 120, 90, 80, 70, 60, 50, 40, 30, 25, 20, 15, 10, 5, 1];
    for (nth, before_us) in (0_u16..).zip(before_us) {
        let frame = frame(0x600 + nth)?;
        let schedule = Schedule { tag: nth, offset_ns: 0 };
        session.cycles(2)?;
        session.take();
        session.adapter.wait_next_cycle();
        let pulse_ns = session.adapter.cycle_start().deadline_ns + SHIFT_NS;
        clock.sleep_until_ns(pulse_ns - before_us * 1_000);
        let sent_ns = session
            .exchange(
                |writer, image| _ = writer.push_scheduled(image, 0, 0, frame.as_ref(), schedule),
                |_| (),
            )?
            .sent_ns;
        // None if the host was late.
        let before_us = SHIFT_NS.checked_sub(sent_ns).map(|ns| ns / 1_000);
        let sequence = session.sequence();
        session.cycles(5)?;
        let inputs = session.take();
        // Of the image after it.
        let is_missed = inputs.get(2).is_some_and(|input| input.outputs != Delivery::Confirmed);
        let is_sent =
            inputs.iter().flat_map(|input| &input.frames).any(|back| back.frame.id() == frame.id());
        let results = inputs.iter().flat_map(|input| &input.results);
        let codes = results
            .filter(|result| result.sequence == sequence)
            .map(|result| result.code.raw())
            .collect();
        samples.extend(before_us.map(|before_us| Sample { before_us, is_missed, is_sent, codes }));
    }
    probe.samples = Some(samples.clone());
    Ok(samples)
}

/// Largest time from the arrival of an image to the pulse of its scheduled frames that the plan assumes, and
/// from the send to the arrival, in us.
const FIRMWARE_US: u64 = 50;
const WIRE_US: u64 = 30;

pub(in crate::probe) fn firmware_time(probe: &mut Probe) -> Result<Outcome> {
    let mut samples = sample(probe)?;
    samples.retain(|sample| !sample.is_missed);
    if samples.iter().all(|sample| !sample.is_sent) {
        return Ok(Outcome::differs("no scheduled frame left"));
    }
    let late = samples.iter().filter(|sample| !sample.is_sent).map(|sample| sample.before_us).max();
    let detail = match late {
        Some(late) => format!("frames of images sent up to {late} us before a pulse were dropped"),
        None => "no frame was dropped, also those of images sent 1 us before a pulse".to_owned(),
    };
    Ok(Outcome::decided(late.is_none_or(|before_us| before_us <= FIRMWARE_US + WIRE_US), detail))
}

/// Deviation of the phases by the delays of the host, in us.
const PHASE_TOLERANCE_US: u64 = 400;

pub(in crate::probe) fn phase_readback(probe: &mut Probe) -> Result<Outcome> {
    let setup = with_sync0(probe)?;
    let session = probe.session(&setup)?;
    session.cycles(5)?;
    session.write(0x9011, 14, 1)?;
    session.cycles(10)?;
    let clock_hz = u64::from(session.read(0x8000, 4)?);
    let [least, most] = [session.read(0x9011, 4)? as i32, session.read(0x9011, 5)? as i32];
    if clock_hz == 0 {
        return Ok(Outcome::undecided("0x8000:04 is 0: CPU cycles cannot be converted"));
    }
    let us = |cycles: i32| i64::from(cycles) * 1_000_000 / clock_hz as i64;
    let expected = ((CYCLE_NS - SHIFT_NS) / 1_000) as i64;
    let detail = format!(
        "images follow a pulse after {expected} us and the host's delay: 0x9011:04 and :05 are {} and {} us",
        us(least),
        us(most)
    );
    // A late host makes the largest distance longer.
    if us(least).abs_diff(expected) <= PHASE_TOLERANCE_US {
        return Ok(Outcome::holds(detail));
    }
    let is_ns = i64::from(least / 1_000).abs_diff(expected) <= PHASE_TOLERANCE_US;
    let outcome = Outcome::differs(format!("{detail}; the values are {least} and {most}"));
    Ok(if is_ns { outcome.like("ns") } else { outcome })
}

/// First codes, each once.
fn codes_of(samples: &[Sample], is_sent: bool) -> Vec<u8> {
    let of_kind = samples.iter().filter(|sample| sample.is_sent == is_sent);
    let mut codes: Vec<_> = of_kind.filter_map(|sample| sample.codes.first().copied()).collect();
    codes.sort_unstable();
    codes.dedup();
    codes
}

/// SCHED_LATE_DROP of 0xB000:06.
const LATE_DROP: u32 = 1 << 6;

pub(in crate::probe) fn late_result(probe: &mut Probe) -> Result<Outcome> {
    let samples = sample(probe)?;
    let setup = with_sync0(probe)?;
    let has_late = probe.session(&setup)?.read(0xB000, 6)? & LATE_DROP != 0;
    let late = samples.iter().filter(|sample| !sample.is_sent).count();
    let (queued, dropped) = (codes_of(&samples, true), codes_of(&samples, false));
    let detail = format!(
        "results of {} frames that left: {queued:?}; of {late} frames that did not: {dropped:?}",
        samples.len() - late
    );
    Ok(match (&queued[..], &dropped[..]) {
        _ if late == 0 || !has_late => {
            Outcome::undecided(format!("no frame was dropped as late; {detail}"))
        }
        ([1] | [], []) => Outcome::holds(detail),
        ([1] | [], [1]) => Outcome::differs(detail).like("queued"),
        ([1] | [], [2]) => Outcome::differs(detail).like("bus_busy"),
        _ => Outcome::differs(detail),
    })
}

pub(in crate::probe) fn result_count(probe: &mut Probe) -> Result<Outcome> {
    let samples = sample(probe)?;
    let counts: Vec<_> =
        samples.iter().filter(|sample| sample.is_sent).map(|sample| sample.codes.len()).collect();
    let (Some(least), Some(most)) = (counts.iter().min(), counts.iter().max()) else {
        return Ok(Outcome::undecided("no scheduled frame left"));
    };
    let detail = format!("{} frames left, with {least} to {most} results each", counts.len());
    Ok(match (least, most) {
        (1, 1) => Outcome::holds(detail),
        (2, 2) => Outcome::differs(detail).like("two"),
        (0, 0) => Outcome::undecided(detail),
        _ => Outcome::differs(detail),
    })
}

/// Largest spread of constant times, in us.
const CONSTANT_US: i64 = 4;

fn spread(times: &[i64]) -> i64 {
    times.iter().max().zip(times.iter().min()).map_or(0, |(most, least)| most - least)
}

/// Time from the image to the next pulse, and offset of the frame, which is sent 0.5, 4.5 or 8.5 ms after the
/// image, with the pulse before, after it or the second one.
const PULSE_BEFORE_NS: u64 = 1_000_000;
const PULSE_OFFSET_NS: u32 = 3_500_000;

/// Compares the cycle in which a scheduled frame comes back with that of an ordinary frame.
pub(in crate::probe) fn pulse(probe: &mut Probe) -> Result<Outcome> {
    let setup = with_sync0(probe)?;
    let session = probe.session(&setup)?;
    let [ordinary, scheduled] = [frame(0x125)?, frame(0x126)?];
    let clock = session.adapter.ecrt().clock().clone();
    session.cycles(5)?;
    session.take();
    session.adapter.wait_next_cycle();
    let pulse_ns = session.adapter.cycle_start().deadline_ns + SHIFT_NS;
    clock.sleep_until_ns(pulse_ns - PULSE_BEFORE_NS);
    let fill = |writer: &mut ImageWriter, image: &mut [u8]| {
        let schedule = Schedule { tag: 0, offset_ns: PULSE_OFFSET_NS };
        let _ = writer.push(image, 0, 0, ordinary.as_ref(), Timestamp::None);
        let _ = writer.push_scheduled(image, 0, 0, scheduled.as_ref(), schedule);
    };
    session.exchange(fill, |_| ())?;
    session.cycles(10)?;
    let inputs = session.take();
    let cycle_of = |frame: &CanFrame| {
        inputs
            .iter()
            .position(|input| input.frames.iter().any(|back| back.frame.id() == frame.id()))
    };
    let Some(of_ordinary) = cycle_of(&ordinary) else {
        return Ok(Outcome::undecided("an ordinary frame did not come back"));
    };
    let Some(of_scheduled) = cycle_of(&scheduled) else {
        return Ok(Outcome::undecided("the scheduled frame did not leave"));
    };
    let periods = of_scheduled.saturating_sub(of_ordinary);
    let detail = format!(
        "a frame scheduled 3.5 ms after a pulse, in an image 1 ms before one, came back {periods} cycles of 4 ms \
         after an ordinary one"
    );
    Ok(match periods {
        0 => Outcome::differs(detail).like("previous"),
        1 => Outcome::holds(detail),
        2 => Outcome::differs(detail).like("second"),
        _ => Outcome::differs(detail),
    })
}

pub(in crate::probe) fn release_jitter(probe: &mut Probe) -> Result<Outcome> {
    if probe.service.is_some_and(|service| !service.is_constant()) {
        let reason = "timestamps count from a service, whose time varies here";
        return Ok(Outcome::undecided(reason));
    }
    if probe.has_other_delta16 {
        return Ok(Outcome::undecided("timestamps do not count microseconds here"));
    }
    let setup = with_sync0(probe)?;
    let session = probe.session(&setup)?;
    let frame = frame(0x123)?;
    session.cycles(20)?;
    session.take();
    for _ in 0..60 {
        let schedule = Schedule { tag: 0, offset_ns: 100_000 };
        session.cycle(|writer, image| {
            let _ = writer.push_scheduled(image, 0, 0, frame.as_ref(), schedule);
        })?;
    }
    session.cycles(3)?;
    let inputs = session.take();
    let sent_us: Vec<_> = inputs.iter().map(|input| input.sent_ns as i64 / 1_000).collect();
    // Timestamps count from a service, which follows a send. Its number of cycles before the reception is
    // that with which they agree best.
    let times = |back: usize| -> Vec<i64> {
        let stamp = |(at, inputs): (usize, &Inputs)| match inputs.frames.first()?.timestamp {
            Timestamp::Delta16(value) => {
                Some(i64::from(value) + sent_us.get(at.checked_sub(back)?)?)
            }
            _ => None,
        };
        inputs.iter().enumerate().filter_map(stamp).collect()
    };
    let best = [2, 3].map(times).into_iter().min_by_key(|times| spread(times)).unwrap_or_default();
    if best.len() < 40 {
        return Ok(Outcome::undecided(format!("{} of 60 frames came back", best.len())));
    }
    let (spread, of_host) = (spread(&best), spread(&sent_us));
    let detail = format!(
        "the times of {} frames spread over {spread} us, those of the host's sends over {of_host} us",
        best.len()
    );
    Ok(match spread {
        0..=CONSTANT_US => Outcome::holds(detail),
        _ if of_host > CONSTANT_US => {
            Outcome::undecided(format!("{detail}: use the real-time options"))
        }
        _ => Outcome::differs(detail).like(spread),
    })
}

const ASSUMED_DEPTH: usize = 64;
/// Full images before one pulse, and their distance.
const DEPTH_IMAGES: u64 = 5;
const DEPTH_DISTANCE_NS: u64 = 500_000;

pub(in crate::probe) fn depth(probe: &mut Probe) -> Result<Outcome> {
    let mut setup = with_sync0(probe)?;
    (setup.rx.multiplier, setup.tx.multiplier) = (11, 11);
    let session = probe.session(&setup)?;
    let frame = frame(0x124)?;
    let clock = session.adapter.ecrt().clock().clone();
    session.cycles(5)?;
    session.take();
    let mut added = 0_usize;
    let mut sequences = BTreeSet::new();
    session.adapter.wait_next_cycle();
    // All before one pulse.
    for image in 0..DEPTH_IMAGES {
        let start_ns = session.adapter.cycle_start().deadline_ns;
        clock.sleep_until_ns(start_ns + image * DEPTH_DISTANCE_NS);
        let fill = |writer: &mut ImageWriter, image: &mut [u8]| {
            let schedule = Schedule { tag: 0, offset_ns: 500_000 };
            while writer.push_scheduled(image, 0, 0, frame.as_ref(), schedule).is_ok() {
                added += 1;
            }
        };
        session.exchange(fill, |_| ())?;
        sequences.insert(session.sequence());
    }
    session.cycles(8)?;
    let inputs = session.take();
    let results = inputs.iter().flat_map(|input| &input.results);
    // The first result of each frame: whether it was accepted.
    let mut known = BTreeSet::new();
    let first = results.filter(|result| {
        sequences.contains(&result.sequence) && known.insert((result.sequence, result.frame_index))
    });
    let rejected = first.filter(|result| result.code == ResultCode::TxFifoFull).count();
    probe.end_session()?;
    if rejected == 0 {
        return Ok(Outcome::undecided(format!("{added} frames before a pulse were all accepted")));
    }
    let depth = added - rejected;
    probe.profile.schedule_depth = u32::try_from(depth).ok();
    let detail = format!("of {added} scheduled frames {depth} were accepted");
    Ok(Outcome::decided(depth == ASSUMED_DEPTH, detail).like(depth))
}
