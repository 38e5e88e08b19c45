//! Verification of a drive's configuration after a connection loss.

use super::script::Script;
use crate::guard::input::GuardInput;

pub(crate) const RETRY_NS: u64 = 500_000_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Reachability {
    pub(crate) gateway: bool,
    pub(crate) heartbeat: bool,
    /// The node is in Operational, as far as the host can tell.
    pub(crate) operational: bool,
}

impl Reachability {
    pub(crate) fn of(input: &GuardInput) -> Self {
        Self {
            gateway: input.path.is_ready,
            heartbeat: !input.drive.heartbeat_lost,
            operational: !input.drive.not_operational,
        }
    }

    /// Returns whether a part of the connection is lost since `before`; a part that remains lost
    /// does not count, so that a verification can complete.
    pub(crate) fn is_lost_since(self, before: Self) -> bool {
        before.gateway && !self.gateway
            || before.heartbeat && !self.heartbeat
            || before.operational && !self.operational
    }
}

/// Verification that a drive still has its configuration: during a connection loss it may have
/// restarted unnoticed, and then its process data have another meaning.
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Verification {
    /// The connection was never lost, or the configuration is verified.
    #[default]
    Complete,
    /// The drive is to be asked, from this time on.
    Due {
        from_ns: u64,
    },
    Running(Script),
}
