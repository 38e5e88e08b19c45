//! What a trial found.

use std::fmt;

/// A rule that was violated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// The gateways did not become ready at the start.
    Start,
    /// A frame on the bus, or its column in the account.
    Transmit,
    /// A frame that arrived, or one that is missing.
    Receive,
    /// A target of an axis.
    Target,
    /// A drive is enabled after a stop.
    Stop,
    /// An event of a client of the service, or a counter of the service.
    Service,
    /// The gateways or axes did not become ready again.
    Recovery,
    /// The version that a gateway runs, or the result of an update.
    Firmware,
    /// A call failed that must not.
    Call,
    /// The simulated master complains about what a real one would hang on.
    Master,
    Panic,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    pub rule: Rule,
    /// Cycle of the application.
    pub cycle: u64,
    pub text: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}, cycle {}: {}", self.rule, self.cycle, self.text)
    }
}

/// Result of a trial.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// The first violation, which ends a trial.
    pub finding: Option<Finding>,
    /// Cycles with process data, those of the startup included.
    pub cycles: u64,
    pub simulated_ns: u64,
    /// Frames that the Port accepted, and that the buses carried.
    pub accepted: u64,
    pub on_bus: u64,
    /// Frames that the application got.
    pub received: u64,
    /// Faults that took effect.
    pub faults: u64,
    pub gateways: u64,
    /// Time until all gateways were ready after the last event.
    pub recovery_ns: u64,
}
