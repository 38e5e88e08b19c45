//! A simulated ECAN-Lite gateway: firmware model, CAN buses, nodes, and a simulated libethercat in front
#![deny(missing_docs)]

// Firmware
mod gateway;

pub use gateway::{
    Gateway, GatewayFault, GatewaySettings, ReceiveLosses, SmSettings, Sync0, TransmitLosses, Truth,
};

// CAN side
mod bus;
mod node;

pub use bus::{
    BusError, BusEvent, BusFault, BusStatistics, CanBus, ErrorState, FrameTiming,
    INTERMISSION_BITS, StationConfig, StationId, StationMode, StationStatistics, WireFrame,
    arbitration_key, bits_ns,
};
pub use node::{
    EchoNode, FaultyNode, FaultySettings, Node, NodeOutput, ReplayError, ReplayNode, ReplayRecord,
    SilentNode,
};

// World and ecrt front
mod backend;
mod clock;
mod ecrt;
mod fault;
mod scenario;
mod simulation;
mod world;

pub use backend::{
    Backend, BackendError, ECRT_VARIABLE, EcrtSetting, ScenarioChoice, SimOptions, open,
    open_scenario,
};
pub use clock::SimClock;
pub use fault::{Fault, LibraryCall, LostWay, ScriptedFault, When};
pub use scenario::{
    BUILTIN_SCENARIOS, ClockKind, EcrtVersion, FaultyBehaviour, GatewaySpec, NodeKind, NodeSpec,
    Scenario, ScenarioError, Topology, echo,
};
pub use simulation::Simulation;
pub use world::World;
