//! What a step needs.

/// Condition without which a step does not apply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A bus that outlives a program: a real master.
    LastingBus,
    /// Simulated gateways on the other end of the master's cable.
    Wire,
    /// Simulated gateways, on the wire or in the library.
    Simulated,
    /// A node on each channel that returns every frame.
    EchoNodes,
    /// Permission to write and erase the Flash of a gateway.
    WriteFlash,
    /// IgH's tool.
    EthercatTool,
    /// The rights of root.
    Root,
    /// At least this number of gateways.
    Gateways(u16),
    /// A program of the SDK, or a C program built from it.
    Program(&'static str),
    /// A program of the system.
    System(&'static str),
    /// Not in the short list.
    Full,
}
