//! Received frames.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{
    CacheDepth, CriticalFrames, DataPathConfig, McanChannelConfig, RxBudget, RxOverflow,
};
use ecan_protocol::image::{EncapsulationProfile, Timestamp};

use crate::probe::experiment::Experiment;
use crate::probe::inputs::Inputs;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::session::Session;
use crate::probe::stage::Stage;

use super::loopback::{frame, frames, push, setup};

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H21"],
        key: "rx_pending",
        stage: Stage::Loopback,
        assumption: "rx_pending includes the frames of the same image",
        run: rx_pending,
    },
    Experiment {
        rows: &["S15"],
        key: "rx_drain",
        stage: Stage::Loopback,
        assumption: "the RX drain budget limits the frames from the controller into the cache",
        run: rx_drain,
    },
    Experiment {
        rows: &["H7"],
        key: "rx_budget",
        stage: Stage::Loopback,
        assumption: "one channel may fill an RxPDO image",
        run: one_channel,
    },
    Experiment {
        rows: &["S17"],
        key: "critical_frames",
        stage: Stage::Loopback,
        assumption: "heartbeats are critical frames, SYNC is not",
        run: critical_frames,
    },
    Experiment {
        rows: &["H18"],
        key: "",
        stage: Stage::Loopback,
        assumption: "frames of TxPDO profile 0 carry no timestamp",
        run: no_timestamps,
    },
    Experiment {
        rows: &["H14", "S14"],
        key: "delta16_unit",
        stage: Stage::Loopback,
        assumption: "delta16 timestamps count microseconds",
        run: timestamps,
    },
];

const RATE: u32 = 1_000_000;
const DATA_RATE: u32 = 5_000_000;
/// PDO error "packet overrun".
const PACKET_OVERRUN: u32 = 3;
const LARGE_FRAMES: u16 = 18;
const HEARTBEAT: u16 = 0x701;
const SYNC: u16 = 0x080;
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

fn rx_pending(probe: &mut Probe) -> Result<Outcome> {
    let setup = setup(probe, McanChannelConfig::classic(RATE), DataPathConfig::default())?;
    let frame = frames(0x111, 1)?;
    let session = probe.session(&setup)?;
    let inputs = send_and_collect(session, &frame, 4)?;
    let Some(header) = inputs.iter().find(|it| !it.frames.is_empty()).and_then(|it| it.header)
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

fn no_timestamps(probe: &mut Probe) -> Result<Outcome> {
    let setup = setup(probe, McanChannelConfig::classic(RATE), DataPathConfig::default())?;
    let frame = frames(0x112, 1)?;
    let session = probe.session(&setup)?;
    let inputs = send_and_collect(session, &frame, 4)?;
    let Some(received) = inputs.iter().flat_map(|it| &it.frames).next() else {
        return Ok(Outcome::undecided("the frame did not come back"));
    };
    let detail = format!("received with timestamp: {:?}", received.timestamp);
    Ok(Outcome::decided(received.timestamp == Timestamp::None, detail))
}

fn rx_drain(probe: &mut Probe) -> Result<Outcome> {
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
    let most = inputs.iter().map(|it| it.frames.len()).max().unwrap_or(0);
    let received: usize = inputs.iter().map(|it| it.frames.len()).sum();
    let detail = format!(
        "of 24 frames, with a cache of 8 and 2 per service, {received} came back, at most {most} per image"
    );
    Ok(match received {
        24 => Outcome::holds(detail),
        1.. if most <= 2 => Outcome::differs(detail).like("cache"),
        _ => Outcome::undecided(format!("{detail}: more than one service per cycle")),
    })
}

fn one_channel(probe: &mut Probe) -> Result<Outcome> {
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
    let received: usize = session.take().iter().map(|it| it.frames.len()).sum();
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
/// SYNC after them.
fn critical_frames(probe: &mut Probe) -> Result<Outcome> {
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
    sent.extend([frame(HEARTBEAT)?, frame(SYNC)?]);
    let session = probe.session(&setup)?;
    session.cycles(3)?;
    let before = session.read(0x9020, CACHE_DROPS)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, &sent))?;
    session.cycles(30)?;
    let inputs = session.take();
    let dropped = session.read(0x9020, CACHE_DROPS)?.wrapping_sub(before);
    let ids: Vec<_> =
        inputs.iter().flat_map(|it| &it.frames).map(|it| it.frame.id().raw()).collect();
    let [heartbeat, sync] = [HEARTBEAT, SYNC].map(|id| ids.contains(&id.into()));
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

fn timestamps(probe: &mut Probe) -> Result<Outcome> {
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
        .flat_map(|it| it.frames.iter().map(|frame| frame.timestamp).collect::<Vec<_>>())
        .collect();
    let values: Vec<_> = stamps
        .iter()
        .filter_map(|it| if let Timestamp::Delta16(value) = it { Some(*value) } else { None })
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
    let is_any =
        |range: std::ops::RangeInclusive<u16>| distances.iter().any(|it| range.contains(it));
    if is_any(100..=140) {
        return Ok(Outcome::holds(detail));
    }
    probe.has_other_delta16 = true;
    let outcome = Outcome::differs(detail);
    Ok(if is_any(2_400..=3_360) { outcome.like("ticks_24mhz") } else { outcome })
}
