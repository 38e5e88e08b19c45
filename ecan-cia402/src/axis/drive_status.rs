//! Latest status that a drive reported by TPDO.

use ecan_canopen::{DriveState, Statusword};

use super::pdo_layout::Feedback;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct DriveStatus {
    /// Newest TPDO of this cycle.
    pub(crate) arrived: Option<Feedback>,
    /// Last statusword, however old.
    pub(crate) statusword: Option<Statusword>,
    /// Last valid state, however old.
    pub(crate) state: Option<DriveState>,
}

impl DriveStatus {
    pub(crate) fn update(&mut self) {
        if let Some(feedback) = self.arrived {
            self.statusword = Some(feedback.statusword);
            self.state = feedback.statusword.state();
        }
    }

    /// Forgets what the drive reported under another configuration.
    pub(crate) fn forget(&mut self) {
        self.statusword = None;
        self.state = None;
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

    pub(crate) fn is_off(&self) -> bool {
        matches!(self.state, Some(DriveState::SwitchOnDisabled | DriveState::Fault))
    }
}
