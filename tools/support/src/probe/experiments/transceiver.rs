//! Delay of a CAN transceiver, as the controller measures it for its delay compensation.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig};
use ecan_protocol::image::Timestamp;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::{Result, unavailable};
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::setup::{ChannelSetup, Setup};
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[Experiment {
    rows: &["S58"],
    key: "transceiver_ns",
    stage: Stage::Wired,
    assumption: "the CAN transceivers need 150 ns from transmit to receive pin",
    run: transceiver_delay,
}];

/// Offset of the secondary sample point, in periods of 12.5 ns (0x8001:33).
const OFFSET: u8 = 30;
/// Period of the default clock in tenths of a nanosecond.
const PERIOD_TENTHS: u32 = 125;
const ASSUMED_NS: u32 = 150;

fn transceiver_delay(probe: &mut Probe) -> Result<Outcome> {
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
