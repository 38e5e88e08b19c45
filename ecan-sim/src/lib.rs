//! A simulated ECAN-Lite gateway: firmware model, CAN buses, nodes, and a simulated libethercat in front
#![deny(missing_docs)]

// Firmware
mod gateway;

pub use gateway::{
    FirmwarePackage, FirmwarePackageError, FirmwareProgress, FirmwareUpdateError, Gateway,
    GatewayCounters, GatewayFault, GatewayModelConfig, ReceiveLosses, SmSettings, Sync0,
    TransmitLosses,
};

mod mailbox;

// CAN side
mod bus;
mod drive;
mod node;

pub use bus::{
    BusError, BusEvent, BusFault, BusStatistics, CanBus, ErrorState, FrameTiming,
    INTERMISSION_BITS, StationConfig, StationId, StationMode, StationStatistics, WireFrame,
    arbitration_key, bits_ns,
};
pub use drive::{
    Drive, DriveConfig, DriveQuirks, EdsError, EdsProblem, MotorConfig, SdoDirection, SdoEffect,
    SdoRule, TargetHistory, TargetKind, TargetRecord, TargetSums,
};
pub use node::{
    BridgeFactory, BridgeProtocol, BridgeSpec, EchoNode, FaultyConfig, FaultyNode, Node,
    NodeOutput, ReplayError, ReplayNode, ReplayRecord, SilentNode,
};

// World, and the ecrt and EtherCAT fronts
mod backend;
mod backend_error;
mod clock;
mod earliest;
mod ecrt;
mod esc;
mod fault;
mod random;
mod runner;
mod scenario;
mod simulation;
mod wake_up;
mod world;

/// The functions of the simulated libethercat as C calls them, for a library that exports them
/// under their names `ecrt_...`. Rust programs take the table that [`open`] gives.
///
/// They are the functions of 1.6, which report a status: 0, or a negative error number; a null
/// pointer comes with the thread's error number. A panic never leaves one of them: it ends as
/// `EIO`.
///
/// # Safety
///
/// The handles that the functions take are the numbers that [`request_master`], [`open_master`]
/// and the others gave; they are looked up and never followed, so a wrong one is `EINVAL`. Every
/// other pointer is null or points to what libethercat's interface says: a place for the result, a
/// text that ends with a zero, as many bytes as the size beside it.
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
pub use clock::SimClock;
pub use ecrt_sys::{ECRT_VARIABLE, EcrtSetting};
pub use esc::{ETHERCAT_ETHERTYPE, Wire, WireStatistics};
pub use fault::{DriveFault, Fault, LibraryCall, LossDirection, ScriptedFault, When};
pub use runner::{RealTimeRunner, RunnerError};
pub use scenario::{
    BUILTIN_SCENARIOS, ClockKind, DriveSpec, EcrtVersion, FaultyBehaviour, GatewaySpec, NodeKind,
    NodeSpec, Scenario, ScenarioError, Topology, drives, echo, jitter,
};
pub use simulation::{AttachedNode, Simulation, UnknownBus};
pub use wake_up::WakeUpDelay;
pub use world::{BusFrame, World};
