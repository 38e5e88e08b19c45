//! Faults: their types, their textual form, their schedule and the log of those that took effect.

mod description;
mod schedule;
mod text;

use serde::{Deserialize, Serialize};

use crate::gateway::GatewayFault;

pub use description::{FaultDescription, FaultError, FaultKey, FaultKind, FaultValue};
pub use schedule::FaultRecord;

pub(crate) use schedule::{CycleFaults, FaultSchedule};

/// Direction in which a frame is lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LossDirection {
    /// Before the first slave: no slave sees the frame.
    #[default]
    Outward,
    /// After the last slave: every slave has processed the frame, the master does not receive it.
    Return,
}

/// A call of libethercat that [`Fault::LibraryError`] makes fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LibraryCall {
    /// `ecrt_master_receive`: received frames remain for the next call.
    Receive,
    /// `ecrt_master_send`: queued datagrams remain queued.
    Send,
    /// `ecrt_domain_process`: the domain keeps its last working counter.
    DomainProcess,
    /// `ecrt_domain_queue`
    DomainQueue,
    /// `ecrt_domain_state`
    DomainState,
}

impl LibraryCall {
    /// All calls.
    pub const ALL: [Self; 5] =
        [Self::Receive, Self::Send, Self::DomainProcess, Self::DomainQueue, Self::DomainState];
}

/// A fault of the library, on the line, in a gateway, on a bus or in a node.
///
/// `gateway` is the index of a gateway in the order of the EtherCAT line, from 0; if it does not
/// exist, the fault has no effect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The frames of the next `cycles` sends with process data are lost, and those of other sends
    /// before the last one.
    LostFrame {
        /// Direction.
        direction: LossDirection,
        /// Number of sends with process data.
        cycles: u32,
    },
    /// The working counter of every process data datagram of the next `cycles` sends is changed by
    /// `offset`, but not below 0.
    WorkingCounterOffset {
        /// Difference.
        offset: i32,
        /// Number of sends.
        cycles: u32,
    },
    /// The gateway loses its supply for `off_ms` milliseconds, then boots.
    PowerCycle {
        /// Index.
        gateway: usize,
        /// Time without supply, ms.
        off_ms: u32,
    },
    /// The gateway loses its supply permanently.
    PowerOff {
        /// Index.
        gateway: usize,
    },
    /// The supply of the gateway returns at once. No effect if the gateway has it.
    PowerOn {
        /// Index.
        gateway: usize,
    },
    /// The cable before the gateway is open for `for_ms` milliseconds: the gateway and those
    /// downstream keep their supply, but receive no frames. If it is the first slave, the master's own
    /// link is down.
    LinkLoss {
        /// Index.
        gateway: usize,
        /// Duration, ms.
        for_ms: u32,
    },
    /// An I/O slave loses its supply for `off_ms` milliseconds.
    IoPowerCycle {
        /// Index in [`Scenario::ios`](crate::Scenario::ios).
        io: usize,
        /// Time without supply, ms.
        off_ms: u32,
    },
    /// A fault inside a gateway.
    Gateway {
        /// Index.
        gateway: usize,
        /// Fault.
        fault: GatewayFault,
    },
    /// The CAN controller of this channel becomes bus-off.
    BusOff {
        /// Index.
        gateway: usize,
        /// Channel, 0 to 3.
        channel: usize,
    },
    /// The next `frames` transmissions of the gateway's channel end in error frames.
    ErrorFrames {
        /// Index.
        gateway: usize,
        /// Channel, 0 to 3.
        channel: usize,
        /// Number of transmissions.
        frames: u32,
    },
    /// The node sends nothing for `for_ms` milliseconds, but still acknowledges.
    NodeSilent {
        /// Name of the node.
        node: String,
        /// Duration, ms.
        for_ms: u32,
    },
    /// The next `times` calls of this function fail without effect, as when a signal interrupts
    /// them (`EINTR`). In 1.5 they fail silently. If scheduled by cycle, it affects the calls after
    /// that cycle's send.
    LibraryError {
        /// Function.
        call: LibraryCall,
        /// Error number, positive.
        errno: i32,
        /// Number of calls.
        times: u32,
    },
    /// The master starts no SDO or register request of a configuration for `for_ms` milliseconds,
    /// as when process data leave no bandwidth for its mailbox traffic. Requests stay busy,
    /// regardless of their timeout.
    RequestsHeld {
        /// Duration, ms.
        for_ms: u32,
    },
    /// A fault in a drive. No effect if the node is not a drive.
    Drive {
        /// Name of the node.
        node: String,
        /// Fault.
        fault: DriveFault,
    },
}

/// A fault in a simulated drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriveFault {
    /// The drive detects a fault: emergency message, fault reaction (0x605E), state Fault.
    Error {
        /// CiA 402 error code, for example 0x2310.
        code: u16,
    },
    /// As [`Error`](Self::Error), of one axis of a drive with several.
    AxisError {
        /// Axis, from 0.
        axis: u8,
        /// CiA 402 error code.
        code: u16,
    },
    /// A temporary error: an emergency message without a change of state.
    Emcy {
        /// Error code.
        code: u16,
        /// Error register in the message.
        register: u8,
    },
    /// The drive loses its supply for `off_ms` milliseconds, then boots. Its motor coasts.
    PowerCycle {
        /// Time without supply, ms.
        off_ms: u32,
    },
    /// The drive's CAN controller is bus-off for `for_ms` milliseconds, then recovers. The drive
    /// reacts as to a loss of the host (0x6007, 0x1029).
    BusOff {
        /// Duration, ms.
        for_ms: u32,
    },
    /// An object gets a value, as the process of an I/O module changes an input. No effect if the
    /// object does not exist or is updated by the drive.
    Value {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Value; excess bits are cut off.
        value: i64,
    },
    /// The motor is blocked for `for_ms` milliseconds.
    Blocked {
        /// Duration, ms.
        for_ms: u32,
    },
}

/// Time of a scheduled fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// At the n-th send with process data since the start of the simulation, from 1.
    Cycle(u64),
    /// Nanoseconds after the start of the simulation.
    At(u64),
    /// Nanoseconds after the first send with process data at which all gateways are in OP.
    AfterOp(u64),
    /// Nanoseconds after a Port reports all its gateways ready for the first time
    /// ([`Clock::gateways_ready`](ecrt_sys::Clock::gateways_ready)).
    AfterReady(u64),
}

/// A fault and its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScriptedFault {
    /// Time.
    pub when: When,
    /// Fault.
    pub fault: Fault,
}

/// Effect of a fault on command, see [`Simulation::execute`](crate::Simulation::execute).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaultEffect {
    /// The fault took effect.
    Injected(FaultRecord),
    /// Its time has not come.
    Scheduled(ScriptedFault),
    /// Nothing has changed, for example because the gateway has its supply already.
    Nothing(Fault),
}
