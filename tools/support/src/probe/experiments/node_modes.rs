//! Numbers of the node modes.

use ecan_protocol::config::{McanChannelConfig, SamplePointWindow};
use ecan_protocol::device::ControllerMode;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::registers::{self, ENDN};
use crate::probe::run::Probe;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H29", "S19"],
        key: "",
        stage: Stage::PreOp,
        assumption: "the CAN controller has the registers of the M_CAN core",
        run: core,
    },
    Experiment {
        rows: &["H9"],
        key: "node_modes",
        stage: Stage::PreOp,
        assumption: "node mode 1 is listen-only, 2 internal loopback, 3 external loopback",
        run: node_modes,
    },
];

/// ENDN of every M_CAN core.
const ENDIANNESS: u32 = 0x8765_4321;

fn core(probe: &mut Probe) -> Result<Outcome> {
    let value = registers::read(probe.sdo(), 0, ENDN)?;
    let detail =
        format!("register ENDN is 0x{value:08X}, that of the M_CAN core 0x{ENDIANNESS:08X}");
    Ok(Outcome::decided(value == ENDIANNESS, detail))
}

/// Applies a node mode to channel 0 and reads the mode of its controller. No frame is sent.
fn mode_of(probe: &Probe, number: u8) -> Result<ControllerMode> {
    let sdo = probe.sdo();
    let config = McanChannelConfig {
        nominal_sample_point: SamplePointWindow::DEFAULT,
        ..McanChannelConfig::classic(500_000)
    };
    for write in config.needed_writes(0) {
        let value = if write.subindex == 8 { number.into() } else { write.value };
        sdo.write(write.index, write.subindex, value)?;
    }
    sdo.write_all([McanChannelConfig::apply_write(0)])?;
    match sdo.read(0x8001, 2)? {
        0 => registers::mode(sdo, 0),
        status => crate::probe::interruption::unavailable(format!(
            "node mode {number}: apply status {status}"
        )),
    }
}

/// Tries mode 1 first: listen-only or internal loopback, neither of which drives the bus. Mode 2 only if
/// mode 1 is listen-only, so that it is not the external loopback of the other known numbering.
fn node_modes(probe: &mut Probe) -> Result<Outcome> {
    let first = mode_of(probe, 1)?;
    let mut detail = format!("node mode 1 sets the controller to {}", first.text());
    match first {
        ControllerMode::Listen => {
            let second = mode_of(probe, 2)?;
            detail += &format!(", 2 to {}", second.text());
            let is_loopback = second == ControllerMode::InternalLoopback;
            if is_loopback {
                probe.profile.internal_loopback = Some(2);
            }
            Ok(Outcome::decided(is_loopback, detail))
        }
        ControllerMode::InternalLoopback => {
            probe.profile.internal_loopback = Some(1);
            Ok(Outcome::differs(detail).like("loopback_first"))
        }
        _ => Ok(Outcome::differs(detail)),
    }
}
