//! First contact with a drive: whether it is enabled or moves, and what is done about it.

use super::script::Script;

/// Longest time in which an enabled drive must show that it is at rest, to be adopted.
pub(crate) const ADOPT_NS: u64 = 200_000_000;

/// Treatment of a drive that is enabled when a [`Cia402`](crate::Cia402) begins to command it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Takeover {
    /// It is quick-stopped, and switched off at rest.
    #[default]
    Stop,
    /// It remains enabled if it is at rest, displays the configured mode, and has the process data of
    /// the configuration; then the axis counts as configured. Otherwise, and in the torque modes, it is
    /// stopped. If the drive watches the host's heartbeat, this must happen within its consumer time
    /// (0x1016).
    Adopt,
}

/// State of the first contact.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | `Waiting` | the gateway is ready | `Inspecting` |
/// | `Inspecting` | the drive is not enabled, did not answer, or restarted | `Done` |
/// | `Inspecting` | it is enabled | `Stopping` |
/// | `Inspecting` | it is enabled and at rest, and is to be adopted | `Adopting` |
/// | `Adopting` | its configuration is as expected | `Done` |
/// | `Adopting` | its configuration differs | `Stopping` |
/// | `Stopping` | it has stopped, or answers no more | `Done` |
/// | `Done` | a drive that never answered appears; its configuration differs | `Waiting` |
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum TakeoverState {
    #[default]
    Waiting,
    Inspecting {
        since_ns: u64,
    },
    Adopting(Script),
    Stopping,
    Done,
}
