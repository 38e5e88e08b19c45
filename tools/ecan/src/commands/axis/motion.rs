//! Motion of the target of an axis in CSP.

use ecan_cia402::{Decision, WaitReason};

use crate::context::Result;

use super::position_profile::{PositionProfile, ProfileLimits};
use super::session::{AXIS, AxisSession, CycleEnd};

/// Target periods without a target after which the motion starts again from rest.
const PAUSE: u32 = 4;

/// A profile whose targets are sent: it advances only with the targets that the guard accepts.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    profile: PositionProfile,
    /// Periods without a target in a row.
    missed: u32,
}

impl Motion {
    /// A motion at rest at the target of the axis, which is running.
    pub fn begin(session: &AxisSession) -> Result<Self> {
        let target = session.cia402().target(AXIS).map(f64::from);
        let position = target.map_or_else(|| session.actual(), Ok)?;
        Ok(Self { profile: PositionProfile::at_rest(position), missed: 0 })
    }

    pub fn profile(&self) -> &PositionProfile {
        &self.profile
    }

    /// Runs a cycle with the next target toward a goal.
    pub fn toward(
        &mut self,
        session: &mut AxisSession,
        goal: f64,
        limits: ProfileLimits,
    ) -> Result<CycleEnd> {
        let next = self.profile.toward(goal, limits, session.target_period_s());
        self.cycle(session, next)
    }

    /// Runs a cycle with a target.
    pub fn cycle(&mut self, session: &mut AxisSession, next: PositionProfile) -> Result<CycleEnd> {
        let end = session.cycle(Some(next.position().round() as i32))?;
        match end.decision {
            Decision::Target(_) => {
                self.profile = next;
                self.missed = 0;
            }
            Decision::Wait(WaitReason::NotDue) => {}
            _ => {
                self.missed += 1;
                if self.missed > PAUSE {
                    // Without targets the drive is at rest.
                    self.profile = self.profile.interrupted();
                }
            }
        }
        Ok(end)
    }
}
