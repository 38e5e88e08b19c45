//! A simulated ECAN-Lite gateway: firmware model, CAN buses, nodes, and two front ends: a simulated
//! libethercat, and slave controllers for Ethernet frames.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

// Firmware
mod gateway;

pub use gateway::{
    FirmwarePackage, FirmwarePackageError, FirmwareProgress, FirmwareUpdateError, Gateway,
    GatewayCounters, GatewayModelConfig, ReceiveLosses, Sync0, Sync0Window, SyncManagerConfig,
    TransmitLosses, variant,
};

mod io_slave;

pub use io_slave::IoSlave;

mod mailbox;

// CAN side
mod bus;
mod drive;
mod node;

pub use bus::{
    BusError, BusEvent, BusFault, BusStatistics, CanBus, DelayCompensation, DetectedError,
    ErrorState, FrameTiming, INTERMISSION_BITS, PhysicalLayer, StationConfig, StationId,
    StationMode, StationStatistics, WireFrame, arbitration_key, bits_ns,
};
pub use drive::{
    CommandSource, Drive, DriveAxis, DriveConfig, DriveQuirks, DriveTrace, MotionSample,
    MotorConfig, SdoDirection, SdoEffect, SdoRule, TargetHistory, TargetKind, TargetRecord,
    TargetSums, TraceCause, TraceEvent, TraceRecord,
};
pub use node::{
    BridgeFactory, BridgeProtocol, BridgeSpec, EchoNode, FaultyConfig, FaultyNode, Node,
    NodeOutput, ReplayNode, ReplayRecord, SilentNode,
};

// World and front ends
mod backend;
mod backend_error;
#[cfg(feature = "bridge")]
pub mod bridge;
mod ecrt;
mod esc;
mod event_queue;
mod fault;
mod random;
mod scenario;
mod sii;
mod simulation;
mod world;

/// The functions of the simulated libethercat with C calling convention, for a library that exports
/// them as `ecrt_...`. Rust programs use the table of [`open`].
///
/// They are the functions of 1.6. A status is 0 or a negative error number; a null pointer sets the
/// thread's error number. A panic ends as `EIO`.
///
/// # Safety
///
/// Handles are numbers returned by [`request_master`], [`open_master`] and others; they are looked
/// up and never dereferenced, so a wrong one is `EINVAL`. Every other pointer is null or valid as
/// libethercat's interface defines: a place for the result, a zero-terminated text, or as many
/// bytes as the size argument.
///
/// [`request_master`]: libethercat::request_master
/// [`open_master`]: libethercat::open_master
pub mod libethercat {
    pub use crate::ecrt::functions::*;
}

pub use backend::{
    Backend, ScenarioChoice, SimOptions, load_scenario, open, open_scenario, simulate,
};
pub use backend_error::BackendError;
pub use ecrt_sys::{ECRT_VARIABLE, EcrtSetting};
pub use esc::{ETHERCAT_ETHERTYPE, Wire, WireStatistics};
pub use fault::{
    DrawnValue, DriveFault, Fault, FaultDescription, FaultDraw, FaultEffect, FaultError, FaultKey,
    FaultKind, FaultRecord, FaultValue, GatewayFault, LibraryCall, LossDirection, ScriptedFault,
    When,
};
pub use random::WakeUpDelay;
pub use scenario::{
    BUILTIN_SCENARIOS, ClockKind, ConfiguredDrive, DriveSpec, EcrtVersion, GatewaySpec,
    IoBehaviour, IoSpec, MasterBehaviour, NodeKind, NodeSpec, Scenario, ScenarioError, Topology,
    drives, echo, jitter,
};
pub use simulation::{AttachedNode, RealTimeRunner, RunnerError, SimClock, Simulation, UnknownBus};
pub use world::{BusFrame, World};
