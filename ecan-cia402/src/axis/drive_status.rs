//! Latest status that a drive reported, by TPDO or SDO.

use ecan_canopen::{DriveState, Statusword};

use super::pdo_layout::Feedback;
use super::rest::RestDetector;
use crate::guard::position_range::PositionRange;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct DriveStatus {
    /// Newest TPDO of this cycle.
    pub(crate) arrived: Option<Feedback>,
    /// Last statusword, however old.
    pub(crate) statusword: Option<Statusword>,
    /// Last valid state, however old.
    pub(crate) state: Option<DriveState>,
    /// Time of the last statusword, from any source; `None` if the drive never reported one.
    pub(crate) heard_ns: Option<u64>,
    pub(crate) rest: RestDetector,
}

impl DriveStatus {
    /// Takes the TPDO of this cycle. `standstill` is the noise of an axis at rest.
    pub(crate) fn update(&mut self, range: PositionRange, standstill: u32, now_ns: u64) {
        if let Some(feedback) = self.arrived {
            self.statusword_received(feedback.statusword, now_ns);
            self.rest.observe(feedback.position, range, standstill, now_ns);
        }
    }

    pub(crate) fn statusword_received(&mut self, statusword: Statusword, now_ns: u64) {
        self.statusword = Some(statusword);
        self.state = statusword.state();
        self.heard_ns = Some(now_ns);
    }

    /// Forgets what the drive reported under another configuration; it remains known that it
    /// reported.
    pub(crate) fn forget(&mut self) {
        self.statusword = None;
        self.state = None;
    }

    pub(crate) fn is_fresh(&self, now_ns: u64, longest_ns: u64) -> bool {
        self.heard_ns.is_some_and(|heard| now_ns.saturating_sub(heard) <= longest_ns)
    }

    /// Returns whether positions not older than that show the axis at rest.
    pub(crate) fn is_at_rest(&self, now_ns: u64, longest_ns: u64) -> bool {
        self.rest.is_at_rest(now_ns, longest_ns)
    }

    pub(crate) fn has(&self, bits: u16) -> bool {
        self.statusword.is_some_and(|status| status.has(bits))
    }

    pub(crate) fn is_enabled(&self) -> bool {
        self.state == Some(DriveState::OperationEnabled)
    }

    pub(crate) fn is_in_fault(&self) -> bool {
        self.state == Some(DriveState::Fault)
    }

    /// Returns whether the drive needs no command to be off. One that is switched on may have received the
    /// command to enable, and wait for its brake.
    pub(crate) fn is_off_or_unknown(&self) -> bool {
        self.is_off() || matches!(self.state, None | Some(DriveState::NotReadyToSwitchOn))
    }

    pub(crate) fn is_off(&self) -> bool {
        matches!(self.state, Some(DriveState::SwitchOnDisabled | DriveState::Fault))
    }
}

/// Returns whether the motor of a drive in this state has current.
pub(crate) fn is_energised(state: DriveState) -> bool {
    matches!(
        state,
        DriveState::OperationEnabled
            | DriveState::QuickStopActive
            | DriveState::FaultReactionActive
    )
}
