//! Transmit queue and results.

use ecan_protocol::config::{DataPathConfig, McanChannelConfig};
use ecan_protocol::image::{ChannelState, ChannelStatus, OptionFlags, Timestamp, TxResult};

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::setup::Setup;
use crate::probe::stage::Stage;

use super::loopback::{frame, frames, push, setup};

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H22"],
        key: "tx_pending",
        stage: Stage::Loopback,
        assumption: "tx_pending includes the frame in transmission",
        run: tx_pending,
    },
    Experiment {
        rows: &["H6", "S26"],
        key: "tx_pressure_percent",
        stage: Stage::Loopback,
        assumption: "tx_pressure shows before the transmit queue is full",
        run: tx_pressure,
    },
    Experiment {
        rows: &["H17", "S11"],
        key: "tx_results",
        stage: Stage::Loopback,
        assumption: "each frame gets a TX_RESULT with the sequence of its image and its index",
        run: tx_results,
    },
    Experiment {
        rows: &["S10"],
        key: "unsendable_result",
        stage: Stage::Loopback,
        assumption: "a frame of a channel that is off gets TX_RESULT 3",
        run: channel_off,
    },
    Experiment {
        rows: &["H38"],
        key: "channel_apply_in_op",
        stage: Stage::Loopback,
        assumption: "a channel takes a new configuration in OP",
        run: apply_in_op,
    },
];

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

fn tx_pending(probe: &mut Probe) -> Result<Outcome> {
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
        .filter_map(|it| Some(it.header?.channel_status[0].tx_pending()))
        .collect();
    let while_sent = statuses.get(3..5).unwrap_or_default();
    let detail = format!("tx_pending during one transmission: {while_sent:?}");
    Ok(match while_sent {
        [1, 1] => Outcome::holds(detail),
        [0, 0] => Outcome::differs(detail).like("without_running"),
        _ => Outcome::undecided(detail),
    })
}

fn tx_pressure(probe: &mut Probe) -> Result<Outcome> {
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
        let is_shown = inputs.header.is_some_and(|it| it.channel_status[0].tx_pressure());
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

fn channel_off(probe: &mut Probe) -> Result<Outcome> {
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
    let codes: Vec<_> = inputs.iter().flat_map(|it| &it.results).map(|it| it.code.raw()).collect();
    session.clear_errors()?;
    Ok(match codes[..] {
        [] => Outcome::differs("the frame got no result").like("none"),
        _ => Outcome::decided(codes == [3], format!("result codes of the frame: {codes:?}")),
    })
}

fn apply_in_op(probe: &mut Probe) -> Result<Outcome> {
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

fn tx_results(probe: &mut Probe) -> Result<Outcome> {
    let setup = with_results(probe)?;
    let sent = frames(0x300, 5)?;
    let session = probe.session(&setup)?;
    session.cycles(3)?;
    session.take();
    session.cycle(|writer, image| _ = push(writer, image, &sent))?;
    let sequence = session.sequence();
    session.cycles(8)?;
    let inputs = session.take();
    let received: usize = inputs.iter().map(|it| it.frames.len()).sum();
    let results: Vec<TxResult> = inputs.into_iter().flat_map(|it| it.results).collect();
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
