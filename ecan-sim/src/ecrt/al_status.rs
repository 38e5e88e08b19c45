use ecan_protocol::device::AlStatusCode;

use crate::world::{Slot, World};

pub(super) const AL_ERROR: u8 = 0x10;

/// AL status of a slave: its state, and the error bit.
pub(crate) fn al_status(world: &World, slot: Slot) -> u8 {
    let (state, has_error) = match slot {
        Slot::Gateway(index) => {
            let Some(gateway) = world.gateway(index) else { return 0 };
            (gateway.al_state(), gateway.al_error())
        }
        Slot::Io(index) => {
            let Some(io) = world.io(index) else { return 0 };
            (io.al_state(), io.al_status_code() != AlStatusCode::OK.0)
        }
    };
    state.raw() | if has_error { AL_ERROR } else { 0 }
}
