//! Frames between two wired channels: node modes, sample points, delay of the transceivers.
//!
//! The error counters of both channels show the sample point.
//!
//! A frame with bit rate switch fails if the nominal sample point of its receiver is later than that of its sender
//! by more than the rest of a data bit after the data sample point: the receiver then samples the first data bit in
//! place of the BRS bit. If both channels send, and have the same data sample point, the sample points of one
//! channel without errors therefore lie symmetrically around that of the other. The first channel has manual bit
//! timings; if their values were no physical ones (H10), no frame would pass.

use ecan_protocol::can::{BitTiming, CanFrame, CanId};
use ecan_protocol::config::{
    BitTimingMode, DataPathConfig, McanChannelConfig, NodeMode, SamplePointWindow,
};
use ecan_protocol::image::Timestamp;

use super::channel_config::{like_choice, percent};
use super::loopback::frame;
use crate::probe::outcome::{Outcome, Result, unavailable};
use crate::probe::run::Probe;
use crate::probe::session::{ChannelSetup, Session, Setup};

fn wired(probe: &Probe, first_mode: NodeMode) -> Result<(Setup, u8, u8)> {
    let Some((first, second)) = probe.options.wired else {
        return unavailable("no wired channels are given (--wired)");
    };
    let channel = |channel, node_mode| ChannelSetup {
        channel,
        can: McanChannelConfig { node_mode, ..McanChannelConfig::classic(500_000) },
        data_path: DataPathConfig::default(),
    };
    let channels = vec![channel(first, first_mode), channel(second, NodeMode::Normal)];
    Ok((Setup { channels, ..Setup::plain() }, first, second))
}

/// Sends a frame on the first channel; returns whether each channel received it.
fn exchange_frame(probe: &mut Probe, mode: NodeMode) -> Result<[bool; 2]> {
    let (setup, first, second) = wired(probe, mode)?;
    let frame = frame(0x321)?;
    let session = probe.session(&setup)?;
    session.cycles(5)?;
    session.take();
    session.cycle(|writer, image| {
        let _ = writer.push(image, first, 0, frame.as_ref(), Timestamp::None);
    })?;
    session.cycles(10)?;
    let inputs = session.take();
    let received: Vec<_> = inputs.iter().flat_map(|input| &input.frames).collect();
    Ok([first, second].map(|channel| {
        received
            .iter()
            .any(|frame_back| frame_back.channel == channel && frame_back.frame.id() == frame.id())
    }))
}

pub(in crate::probe) fn external_loopback(probe: &mut Probe) -> Result<Outcome> {
    let normal = exchange_frame(probe, NodeMode::Normal)?;
    if normal != [false, true] {
        let text = "a frame in node mode 0 did not reach the other channel: check the wiring";
        return Ok(Outcome::undecided(text));
    }
    let looped = exchange_frame(probe, NodeMode::ExternalLoopback)?;
    let text = |is_received: bool| if is_received { "received it" } else { "did not receive it" };
    let detail = format!(
        "frame in node mode 3: the sender {}, the other channel {}",
        text(looped[0]),
        text(looped[1])
    );
    Ok(Outcome::decided(looped == [true, true], detail))
}

const NOMINAL: u32 = 500_000;
const DATA: u32 = 2_000_000;
/// Data sample point of both channels in 0.1 %: a quarter of 500 ns follows it.
const DATA_POINT: u16 = 750;
/// Quanta of a nominal bit at 80 MHz, and the sample points that are tried, in quanta.
const QUANTA: u32 = 160;
const POINTS: std::ops::RangeInclusive<u32> = 108..=152;
/// Frames from each channel for one sample point.
const FRAMES: u32 = 16;
/// Deviation of the result in 0.1 %.
const ACCURACY: u32 = 6;
const MIDDLE: u32 = 812;

fn permille(quanta: u32) -> u32 {
    quanta * 1000 / QUANTA
}

fn nominal_timing(quanta: u32) -> BitTiming {
    BitTiming { brp: 1, tseg1: quanta as u16 - 1, tseg2: (QUANTA - quanta) as u16, sjw: 8 }
}

struct Wires {
    first: u8,
    second: u8,
    frame: CanFrame,
}

impl Wires {
    /// Sends frames with a sample point of the first channel; returns whether an error or a loss occurred, `None`
    /// if the channel does not take the sample point.
    fn is_disturbed(&self, session: &mut Session, quanta: u32) -> Result<Option<bool>> {
        let Self { first, second, frame } = self;
        let timing = nominal_timing(quanta);
        for (subindex, value) in [(26, timing.tseg1), (27, timing.tseg2)] {
            session.write(0x8001 + u16::from(*first), subindex, value.into())?;
        }
        // The apply also clears the error counters.
        for channel in [*first, *second] {
            let apply = McanChannelConfig::apply_write(channel);
            session.write(apply.index, apply.subindex, apply.value)?;
            if session.read(apply.index, 2)? != 0 {
                return Ok(None);
            }
        }
        self.take_errors(session)?;
        session.take();
        for channel in [*first, *second] {
            for _ in 0..FRAMES {
                session.cycle(|writer, image| {
                    let _ = writer.push(image, channel, 0, frame.as_ref(), Timestamp::None);
                })?;
            }
            session.cycles(4)?;
        }
        let received: usize = session.take().iter().map(|inputs| inputs.frames.len()).sum();
        let errors = self.take_errors(session)?;
        Ok(Some(errors || received != 2 * FRAMES as usize))
    }

    /// Returns whether ECR of a channel shows errors since its last read (0x9000:01).
    fn take_errors(&self, session: &mut Session) -> Result<bool> {
        let mut errors = 0;
        for channel in [self.first, self.second] {
            errors |= session.read(0x9000 + u16::from(channel), 1)?;
        }
        Ok(errors != 0)
    }
}

pub(in crate::probe) fn sample_point_by_errors(probe: &mut Probe) -> Result<Outcome> {
    let Some((first, second)) = probe.options.wired else {
        return unavailable("no wired channels are given (--wired)");
    };
    let data = SamplePointWindow { min: DATA_POINT, max: DATA_POINT };
    let rates = McanChannelConfig {
        nominal_sample_point: SamplePointWindow::DEFAULT,
        data_sample_point: data,
        ..McanChannelConfig::fd(NOMINAL, DATA)
    };
    let manual = McanChannelConfig {
        bit_timing_mode: BitTimingMode::Manual,
        manual_nominal: nominal_timing(QUANTA * MIDDLE / 1000),
        manual_data: BitTiming { brp: 1, tseg1: 29, tseg2: 10, sjw: 10 },
        ..rates
    };
    let channel =
        |channel, can| ChannelSetup { channel, can, data_path: DataPathConfig::default() };
    let setup =
        Setup { channels: vec![channel(first, manual), channel(second, rates)], ..Setup::plain() };
    let frame = CanId::standard(0x321).ok();
    let frame = frame.and_then(|id| CanFrame::fd(id, &[0x5A; 16], true, false).ok());
    let Some(frame) = frame else { return unavailable("no such frame") };
    let wires = Wires { first, second, frame };
    let session = probe.session(&setup)?;
    let mut tried = Vec::new();
    for quanta in POINTS {
        if let Some(is_disturbed) = wires.is_disturbed(session, quanta)? {
            tried.push((quanta, is_disturbed));
        }
    }
    Ok(match good_range(&tried) {
        Ok((low, high)) => {
            let found = (permille(low) + permille(high)) / 2;
            probe.profile.wired_sample_point_permille = Some(found);
            decide(found, low, high)
        }
        Err(reason) => Outcome::undecided(reason),
    })
}

/// First and last quanta without errors, if errors are on both sides of them.
fn good_range(tried: &[(u32, bool)]) -> Result<(u32, u32), &'static str> {
    let mut good =
        tried.iter().filter(|(_, is_disturbed)| !is_disturbed).map(|(quanta, _)| *quanta);
    let Some(low) = good.next() else {
        return Err(match tried {
            [] => "the channel takes no other sample point in OP",
            _ => {
                "frames fail at each sample point: check the wiring, and that no other node is on the bus"
            }
        });
    };
    let high = good.next_back().unwrap_or(low);
    let is_bad = |quanta: u32| tried.contains(&(quanta, true));
    match (is_bad(low - 1), is_bad(high + 1)) {
        (true, true) => Ok((low, high)),
        (false, false) => Err("no sample point between 67.5 and 95 % causes errors"),
        _ => Err("errors occur only on one side of the sample points that the channel takes"),
    }
}

fn decide(found: u32, low: u32, high: u32) -> Outcome {
    let detail = format!(
        "500 kbit/s and 2 Mbit/s, 75 to 87.5 %: sample point {} (+-0.6 %); frames pass from {} to {} of the other channel",
        percent(found),
        percent(permille(low)),
        percent(permille(high))
    );
    like_choice(Outcome::decided(found.abs_diff(MIDDLE) <= ACCURACY, detail), found)
}

/// Offset of the secondary sample point, in periods of 12.5 ns (0x8001:33).
const OFFSET: u8 = 30;
/// Period of the default clock in tenths of a nanosecond.
const PERIOD_TENTHS: u32 = 125;
const ASSUMED_NS: u32 = 150;

pub(in crate::probe) fn transceiver_delay(probe: &mut Probe) -> Result<Outcome> {
    let Some((first, second)) = probe.options.wired else {
        return unavailable("no wired channels are given (--wired)");
    };
    let can = McanChannelConfig {
        tdc_offset: OFFSET,
        ..McanChannelConfig::fd(500_000, 2_000_000).sample_point(800, 750)
    };
    let channel = |channel| ChannelSetup { channel, can, data_path: DataPathConfig::default() };
    let setup = Setup { channels: vec![channel(first), channel(second)], ..Setup::plain() };
    let frame = CanId::standard(0x321).ok();
    let frame = frame.and_then(|id| CanFrame::fd(id, &[0x5A; 8], true, false).ok());
    let Some(frame) = frame else { return unavailable("no such frame") };
    let session = probe.session(&setup)?;
    session.take();
    session.cycle(|writer, image| {
        let _ = writer.push(image, first, 0, frame.as_ref(), Timestamp::None);
    })?;
    session.cycles(10)?;
    let is_received = session.take().iter().any(|inputs| !inputs.frames.is_empty());
    let position = session.read(0x9000 + u16::from(first), 2)? >> 16 & 0x7F;
    if !is_received {
        return Ok(Outcome::undecided(
            "a frame with bit rate switch did not reach the other channel: check the wiring",
        ));
    }
    let Some(periods) = position.checked_sub(OFFSET.into()).filter(|periods| *periods > 0) else {
        let text = format!("PSR shows no measured delay (TDCV {position}, offset {OFFSET})");
        return Ok(Outcome::undecided(text));
    };
    let delay_ns = periods * PERIOD_TENTHS / 10;
    probe.profile.transceiver_ns = Some(delay_ns);
    let detail = format!("PSR.TDCV {position} with offset {OFFSET}: {delay_ns} ns");
    Ok(if delay_ns.abs_diff(ASSUMED_NS) * 10 <= PERIOD_TENTHS {
        Outcome::holds(detail)
    } else {
        Outcome::differs(detail).like(delay_ns)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_range_needs_errors_on_both_sides() {
        let tried = |good: std::ops::RangeInclusive<u32>| -> Vec<_> {
            POINTS.map(|quanta| (quanta, !good.contains(&quanta))).collect()
        };
        assert_eq!(good_range(&tried(120..=140)), Ok((120, 140)));
        assert_eq!(good_range(&tried(130..=130)), Ok((130, 130)));
        for (good, reason) in [
            (0..=0, "frames fail at each"),
            (100..=200, "no sample point"),
            (100..=140, "on one side"),
            (120..=152, "on one side"),
        ] {
            assert!(good_range(&tried(good)).unwrap_err().contains(reason));
        }
        assert!(good_range(&[]).unwrap_err().contains("takes no other"));
        // without a timing for smaller ones
        let partly: Vec<_> = tried(120..=140).split_off(20);
        assert!(good_range(&partly).unwrap_err().contains("on one side"));
    }
}
