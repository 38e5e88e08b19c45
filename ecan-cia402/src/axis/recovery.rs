//! Recovery of one axis: from a hold, a stop, a fault or a lost configuration back to its targets.

/// A recovery in progress. It issues the commands that an application would, each when the one before
/// is complete.
///
/// | the axis | step |
/// | --- | --- |
/// | is being stopped, configured, reset or enabled | wait |
/// | is not configured | configure; not more than twice |
/// | has a fault | reset; a fault after that ends the recovery |
/// | holds, has stopped, or has no command | enable; not more than three times, and not after a timeout |
/// | is halted | resume |
/// | follows targets | the recovery is complete |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Recovery {
    pub(crate) configured: u8,
    pub(crate) enabled: u8,
    pub(crate) is_reset: bool,
}
