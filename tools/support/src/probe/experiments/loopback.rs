//! Configuration of experiments in the internal loopback.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig, NodeMode, SamplePointWindow};
use ecan_protocol::image::{ImageWriter, Timestamp};

use crate::probe::interruption::{Result, unavailable};
use crate::probe::run::Probe;
use crate::probe::setup::{ChannelSetup, Setup};

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
