use crate::world::World;

pub(super) const AL_ERROR: u8 = 0x10;

pub(crate) fn al_status(world: &World, slot: usize) -> u8 {
    world.gateway(slot).map_or(0, |gateway| {
        gateway.al_state().raw() | if gateway.al_error() { AL_ERROR } else { 0 }
    })
}
