//! Frames between two wired channels.

use ecan_protocol::config::{DataPathConfig, McanChannelConfig, NodeMode};
use ecan_protocol::image::Timestamp;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::{Result, unavailable};
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::setup::{ChannelSetup, Setup};
use crate::probe::stage::Stage;

use super::loopback::frame;

pub(super) const EXPERIMENTS: &[Experiment] = &[Experiment {
    rows: &["H9"],
    key: "",
    stage: Stage::Wired,
    assumption: "node mode 0 takes part in the bus, 3 is external loopback",
    run: external_loopback,
}];

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
fn exchange(probe: &mut Probe, mode: NodeMode) -> Result<[bool; 2]> {
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
    let received: Vec<_> = inputs.iter().flat_map(|it| &it.frames).collect();
    Ok([first, second].map(|channel| {
        received.iter().any(|it| it.channel == channel && it.frame.id() == frame.id())
    }))
}

fn external_loopback(probe: &mut Probe) -> Result<Outcome> {
    let normal = exchange(probe, NodeMode::Normal)?;
    if normal != [false, true] {
        let text = "a frame in node mode 0 did not reach the other channel: check the wiring";
        return Ok(Outcome::undecided(text));
    }
    let looped = exchange(probe, NodeMode::ExternalLoopback)?;
    let text = |is_received: bool| if is_received { "received it" } else { "did not receive it" };
    let detail = format!(
        "frame in node mode 3: the sender {}, the other channel {}",
        text(looped[0]),
        text(looped[1])
    );
    Ok(Outcome::decided(looped == [true, true], detail))
}
