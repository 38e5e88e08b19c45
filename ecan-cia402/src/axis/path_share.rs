//! Part of an axis in a stop of all axes on their path.

use super::ramp::Profile;

/// Binary places of the profile that the axes have in common: its rate at the call is 2^44 units.
pub(crate) const ONE_BITS: u32 = 44;

/// Part of an axis in a stop on the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PathShare {
    /// Rate of the axis at the call, in units.
    pub(crate) rate: i128,
    /// Rate of the common profile in this cycle; `None` if no axis moves in it.
    pub(crate) step: Option<Profile>,
}

impl PathShare {
    /// The profile of the axis at one of the common profile.
    pub(crate) fn of(&self, common: Profile) -> Profile {
        let share = |common: i128| (self.rate * common) >> ONE_BITS;
        Profile { rate: share(common.rate), change: share(common.change) }
    }
}
