//! Frames in the internal loopback: transmit queue and results, received frames.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{
    CacheDepth, CriticalFrames, DataPathConfig, McanChannelConfig, NodeMode, RxBudget, RxOverflow,
    SamplePointWindow,
};
use ecan_protocol::image::{
    ChannelState, ChannelStatus, EncapsulationProfile, ImageWriter, OptionFlags, Timestamp,
    TxResult,
};

use crate::probe::outcome::{Outcome, Result, unavailable};
use crate::probe::run::Probe;
use crate::probe::session::{ChannelSetup, Inputs, Session, Setup};

/// Channel 0 in the internal loopback, whose number the registers have shown before.
pub(super) fn setup(
    probe: &Probe,
    can: McanChannelConfig,
    data_path: DataPathConfig,
) -> Result<Setup> {
    let Some(node_mode) = probe.profile.internal_loopback.and_then(NodeMode::from_raw) else {
        return unavailable(
            "the node mode of the internal loopback is not known: no frames are sent",
        );
    };
    // Inside the controller the sample point has no effect: any that the firmware finds.
    let window = SamplePointWindow::DEFAULT;
    let can = McanChannelConfig {
        node_mode,
        nominal_sample_point: window,
        data_sample_point: window,
        ..can
    };
    Ok(Setup { channels: vec![ChannelSetup { channel: 0, can, data_path }], ..Setup::plain() })
}

/// Frame of 8 bytes with a standard CAN ID.
pub(super) fn frame(id: u16) -> Result<CanFrame> {
    let frame = CanId::standard(id).ok().and_then(|id| CanFrame::classic(id, &[0x55; 8]).ok());
    frame.map_or_else(|| unavailable("no such frame"), Ok)
}

/// Adds frames of channel 0 to an image; returns how many fit.
pub(super) fn push(writer: &mut ImageWriter, image: &mut [u8], frames: &[CanFrame]) -> usize {
    let mut added = 0;
    for frame in frames {
        if writer.push(image, 0, 0, frame.as_ref(), Timestamp::None).is_err() {
            break;
        }
        added += 1;
    }
    added
}

/// Frames with CAN IDs from `first` on.
pub(super) fn frames(first: u16, count: u16) -> Result<Vec<CanFrame>> {
    (first..first + count).map(frame).collect()
}

/// Bit rate at which a frame takes several cycles.
const SLOW: u32 = 20_000;
/// Frames of the transmit FIFO in the Message RAM, and of the ring (0xF000:29).
const FIFO: usize = 32;
const RING: usize = 64;
const SENT_PER_CYCLE: usize = 4;

fn slow(probe: &Probe) -> Result<Setup> {
    let data_path = DataPathConfig { tx_budget_max: 8, ..DataPathConfig::default() };
    setup(probe, McanChannelConfig::classic(SLOW), data_path)
}

pub(in crate::probe) fn tx_pending(probe: &mut Probe) -> Result<Outcome> {
    let setup = slow(probe)?;
    let frame = frames(0x100, 1)?;
    let session = probe.session(&setup)?;
    session.cycles(5)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, &frame))?;
    session.cycles(4)?;
    // An image is received two cycles after its service. The service that passes the frame on is that of
    // cycle 2; it is sent during the next two.
    let statuses: Vec<_> = session
        .take()
        .iter()
        .filter_map(|inputs| Some(inputs.header?.channel_status[0].tx_pending()))
        .collect();
    let while_sent = statuses.get(3..5).unwrap_or_default();
    let detail = format!("tx_pending during one transmission: {while_sent:?}");
    Ok(match while_sent {
        [1, 1] => Outcome::holds(detail),
        [0, 0] => Outcome::differs(detail).like("without_running"),
        _ => Outcome::undecided(detail),
    })
}

pub(in crate::probe) fn tx_pressure(probe: &mut Probe) -> Result<Outcome> {
    let setup = slow(probe)?;
    let session = probe.session(&setup)?;
    session.cycles(10)?;
    session.take();
    let all = frames(0x200, 120)?;
    let (mut sent, mut received) = (0, 0);
    let mut shown_at = None;
    while sent < FIFO + RING + 8 && shown_at.is_none() {
        let mut added = 0;
        // Not more than the device passes to the controller per service.
        let left = &all[sent..][..SENT_PER_CYCLE];
        let inputs = session.cycle(|writer, image| added = push(writer, image, left))?;
        received += inputs.frames.len();
        let is_shown = inputs.header.is_some_and(|header| header.channel_status[0].tx_pressure());
        shown_at = is_shown.then_some(sent - received);
        sent += added;
    }
    probe.end_session()?;
    Ok(match shown_at {
        Some(waiting) if waiting <= RING => {
            Outcome::holds(format!("tx_pressure showed with {waiting} waiting frames"))
        }
        Some(waiting) => {
            let detail = format!("tx_pressure showed not before {waiting} waiting frames");
            Outcome::differs(detail).like(100)
        }
        None => Outcome::differs(format!("tx_pressure did not show with {sent} frames")).like(100),
    })
}

fn with_results(probe: &Probe) -> Result<Setup> {
    let fast = McanChannelConfig::classic(1_000_000);
    let mut setup = setup(probe, fast, DataPathConfig::default())?;
    setup.tx.options = OptionFlags::TX_RESULT;
    setup.tx.multiplier = 3;
    setup.rx.multiplier = 3;
    Ok(setup)
}

pub(in crate::probe) fn channel_off(probe: &mut Probe) -> Result<Outcome> {
    let setup = with_results(probe)?;
    let frame = frame(0x123)?;
    let session = probe.session(&setup)?;
    let state = ChannelStatus::from_raw(session.read(0x9001, 9)? as u16).state();
    if state != ChannelState::Disabled {
        return Ok(Outcome::undecided(format!("channel 1 is in state {state}")));
    }
    session.cycles(3)?;
    session.take();
    session.cycle(|writer, image| {
        let _ = writer.push(image, 1, 0, frame.as_ref(), Timestamp::None);
    })?;
    session.cycles(8)?;
    let inputs = session.take();
    let codes: Vec<_> =
        inputs.iter().flat_map(|input| &input.results).map(|result| result.code.raw()).collect();
    session.clear_errors()?;
    Ok(match codes[..] {
        [] => Outcome::differs("the frame got no result").like("none"),
        _ => Outcome::decided(codes == [3], format!("result codes of the frame: {codes:?}")),
    })
}

pub(in crate::probe) fn apply_in_op(probe: &mut Probe) -> Result<Outcome> {
    let setup = with_results(probe)?;
    let session = probe.session(&setup)?;
    session.write(0x8001, 19, 250_000)?;
    session.write(0x8001, 1, 1)?;
    let status = session.read(0x8001, 2)?;
    probe.end_session()?;
    let detail = format!("apply status {status} for another bit rate in OP");
    let outcome = Outcome::decided(status == 0, detail);
    Ok(if status == 0 { outcome } else { outcome.like("rejected") })
}

pub(in crate::probe) fn tx_results(probe: &mut Probe) -> Result<Outcome> {
    let setup = with_results(probe)?;
    let sent = frames(0x300, 5)?;
    let session = probe.session(&setup)?;
    session.cycles(3)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, &sent))?;
    let sequence = session.sequence();
    session.cycles(8)?;
    let inputs = session.take();
    let received: usize = inputs.iter().map(|input| input.frames.len()).sum();
    let results: Vec<TxResult> = inputs.into_iter().flat_map(|input| input.results).collect();
    if received != sent.len() {
        return Ok(Outcome::undecided(format!("{received} of 5 frames came back")));
    }
    let is_of_image = results.iter().enumerate().all(|(nth, result)| {
        result.sequence == sequence && usize::from(result.frame_index) == nth && result.channel == 0
    });
    let detail = format!("5 frames were sent and {} results received", results.len());
    Ok(match results.len() {
        5 if is_of_image => Outcome::holds(detail),
        5 => Outcome::differs(format!("{detail}, with other sequences or indices")),
        0 => Outcome::differs(detail).like("failures_only"),
        _ => Outcome::differs(detail),
    })
}

const RATE: u32 = 1_000_000;
const DATA_RATE: u32 = 5_000_000;
/// PDO error "packet overrun".
const PACKET_OVERRUN: u32 = 3;
const LARGE_FRAMES: u16 = 18;
const HEARTBEAT: u16 = 0x701;
const SYNC_ID: u16 = 0x080;
/// Frames that the RX cache dropped, 0x9020:05.
const CACHE_DROPS: u8 = 5;

/// Sends frames in one image, and returns the inputs of this cycle and of some more.
fn send_and_collect(
    session: &mut Session,
    frames: &[CanFrame],
    cycles: u32,
) -> Result<Vec<Inputs>> {
    session.cycles(3)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, frames))?;
    session.cycles(cycles)?;
    Ok(session.take())
}

pub(in crate::probe) fn rx_pending(probe: &mut Probe) -> Result<Outcome> {
    let setup = setup(probe, McanChannelConfig::classic(RATE), DataPathConfig::default())?;
    let frame = frames(0x111, 1)?;
    let session = probe.session(&setup)?;
    let inputs = send_and_collect(session, &frame, 4)?;
    let Some(header) =
        inputs.iter().find(|input| !input.frames.is_empty()).and_then(|input| input.header)
    else {
        return Ok(Outcome::undecided("the frame did not come back"));
    };
    let pending = header.channel_status[0].rx_pending();
    let detail = format!("the image with the only received frame has rx_pending {pending}");
    Ok(match pending {
        1 => Outcome::holds(detail),
        0 => Outcome::differs(detail).like("without_own_image"),
        _ => Outcome::differs(detail),
    })
}

pub(in crate::probe) fn no_timestamps(probe: &mut Probe) -> Result<Outcome> {
    let setup = setup(probe, McanChannelConfig::classic(RATE), DataPathConfig::default())?;
    let frame = frames(0x112, 1)?;
    let session = probe.session(&setup)?;
    let inputs = send_and_collect(session, &frame, 4)?;
    let Some(received) = inputs.iter().flat_map(|input| &input.frames).next() else {
        return Ok(Outcome::undecided("the frame did not come back"));
    };
    let detail = format!("received with timestamp: {:?}", received.timestamp);
    Ok(Outcome::decided(received.timestamp == Timestamp::None, detail))
}

pub(in crate::probe) fn rx_drain(probe: &mut Probe) -> Result<Outcome> {
    let data_path = DataPathConfig {
        rx_cache_depth: CacheDepth::D8,
        rx_budget: RxBudget::Limited,
        rx_drain_min: 0,
        rx_drain_max: 2,
        rx_overflow: RxOverflow::DropNewest,
        tx_budget_max: 8,
        ..DataPathConfig::default()
    };
    let mut setup = setup(probe, McanChannelConfig::classic(RATE), data_path)?;
    (setup.rx.multiplier, setup.tx.multiplier) = (3, 3);
    let sent = frames(0x400, 24)?;
    let session = probe.session(&setup)?;
    let inputs = send_and_collect(session, &sent, 25)?;
    let most = inputs.iter().map(|input| input.frames.len()).max().unwrap_or(0);
    let received: usize = inputs.iter().map(|input| input.frames.len()).sum();
    let detail = format!(
        "of 24 frames, with a cache of 8 and 2 per service, {received} came back, at most {most} per image"
    );
    Ok(match received {
        24 => Outcome::holds(detail),
        1.. if most <= 2 => Outcome::differs(detail).like("cache"),
        _ => Outcome::undecided(format!("{detail}: more than one service per cycle")),
    })
}

pub(in crate::probe) fn one_channel(probe: &mut Probe) -> Result<Outcome> {
    let data_path = DataPathConfig::for_traffic(8, 8);
    let mut setup = setup(probe, McanChannelConfig::classic(RATE), data_path)?;
    (setup.rx.multiplier, setup.tx.multiplier) = (3, 3);
    let sent = frames(0x500, 30)?;
    let session = probe.session(&setup)?;
    session.cycles(3)?;
    session.clear_errors()?;
    session.take();
    let mut added = 0;
    session.cycle(|writer, image| added = push(writer, image, &sent))?;
    session.cycles(25)?;
    let received: usize = session.take().iter().map(|inputs| inputs.frames.len()).sum();
    let error = session.read(0x8011, 14)?;
    session.clear_errors()?;
    let detail = format!(
        "{added} frames of one channel in an image: {received} came back, PDO error {error}"
    );
    let outcome = Outcome::decided(received == added && error == 0, detail);
    let has_dropped = received > 0 && received < added && error == PACKET_OVERRUN;
    Ok(if has_dropped { outcome.like("applied") } else { outcome })
}

/// Fills the cache with frames of 64 bytes, of which one fits into each image, and sends a heartbeat and a
/// SYNC_ID after them.
pub(in crate::probe) fn critical_frames(probe: &mut Probe) -> Result<Outcome> {
    let data_path = DataPathConfig {
        rx_cache_depth: CacheDepth::D8,
        rx_budget: RxBudget::Limited,
        rx_drain_min: 8,
        rx_drain_max: 8,
        rx_overflow: RxOverflow::PreserveCritical,
        critical_frames: CriticalFrames::CanopenSafety,
        tx_budget_max: 8,
        ..DataPathConfig::default()
    };
    let mut setup = setup(probe, McanChannelConfig::fd(RATE, DATA_RATE), data_path)?;
    (setup.rx.multiplier, setup.tx.multiplier) = (11, 1);
    let mut sent = Vec::new();
    for id in (0..LARGE_FRAMES).map(|nth| 0x200 + nth) {
        let id = CanId::standard(id).ok();
        sent.extend(id.and_then(|id| CanFrame::fd(id, &[0x55; 64], true, false).ok()));
    }
    sent.extend([frame(HEARTBEAT)?, frame(SYNC_ID)?]);
    let session = probe.session(&setup)?;
    session.cycles(3)?;
    let before = session.read(0x9020, CACHE_DROPS)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, &sent))?;
    session.cycles(30)?;
    let inputs = session.take();
    let dropped = session.read(0x9020, CACHE_DROPS)?.wrapping_sub(before);
    let ids: Vec<_> =
        inputs.iter().flat_map(|input| &input.frames).map(|frame| frame.frame.id().raw()).collect();
    let [heartbeat, sync] = [HEARTBEAT, SYNC_ID].map(|id| ids.contains(&id.into()));
    let text = |is_received: bool| if is_received { "received" } else { "dropped" };
    let detail = format!(
        "{dropped} frames were dropped in a full cache, heartbeat {}, SYNC {} (\"CANopen safety\")",
        text(heartbeat),
        text(sync)
    );
    Ok(match (dropped, heartbeat, sync) {
        (0, ..) => Outcome::undecided("the cache did not become full"),
        (_, true, false) => Outcome::holds(detail),
        (_, true, true) => Outcome::differs(detail).like("with_sync"),
        _ => Outcome::differs(detail),
    })
}

pub(in crate::probe) fn timestamps(probe: &mut Probe) -> Result<Outcome> {
    let data_path = DataPathConfig::for_traffic(8, 8);
    let mut setup = setup(probe, McanChannelConfig::classic(RATE), data_path)?;
    (setup.rx.multiplier, setup.tx.multiplier) = (3, 3);
    setup.tx.profile = EncapsulationProfile::CompactTimestamped;
    let sent = frames(0x155, 4)?;
    let session = probe.session(&setup)?;
    session.cycles(3)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, &sent))?;
    session.cycles(5)?;
    let stamps: Vec<_> = session
        .take()
        .iter()
        .flat_map(|inputs| inputs.frames.iter().map(|frame| frame.timestamp).collect::<Vec<_>>())
        .collect();
    let values: Vec<_> = stamps
        .iter()
        .filter_map(|stamp| if let Timestamp::Delta16(value) = stamp { Some(*value) } else { None })
        .collect();
    let distances: Vec<_> = values.windows(2).map(|pair| pair[1].wrapping_sub(pair[0])).collect();
    let detail = format!(
        "4 frames of about 115 us each at 1 Mbit/s: timestamps {values:?} (encapsulation profile 1)"
    );
    if values.len() < 2 {
        return Ok(Outcome::undecided(format!(
            "{} timestamps of 4 frames were received",
            values.len()
        )));
    }
    let is_any = |range: std::ops::RangeInclusive<u16>| {
        distances.iter().any(|distance| range.contains(distance))
    };
    if is_any(100..=140) {
        return Ok(Outcome::holds(detail));
    }
    probe.has_other_delta16 = true;
    let outcome = Outcome::differs(detail);
    Ok(if is_any(2_400..=3_360) { outcome.like("ticks_24mhz") } else { outcome })
}
