//! How long the programs that carry plain CAN frames wait before they give up or go on.

/// No frame came for so long: none is under way any more, in nanoseconds.
pub const IDLE_TIMEOUT_NS: u64 = 200_000_000;
/// No frame was taken or came back for so long: none will be any more, in nanoseconds.
pub const STALL_TIMEOUT_NS: u64 = 10_000_000_000;
