//! The Adapter: everything between an application and an EtherCAT bus with ECAN-Lite gateways on
//! it, short of CAN itself.
//!
//! [`Adapter::open`] takes a loaded master library and a plain [`AdapterConfig`], checks it as a
//! whole, finds the gateways, maps their PDO chunks into one domain each, registers the startup
//! SDOs and leaves a bus that only waits for [`Adapter::activate`]. In the cycle
//! [`Adapter::receive`] and [`Adapter::send`] exchange the PDO images (manual 15.5).
//!
//! [`Plan`] computes the load of a configuration on the wire in advance.
//!
//! Nothing here starts a thread or sleeps in the data path: the application owns the cycle.
//! [`RealTimeConfig`] and [`CycleStatistics`] help it to keep it (manual 13.9).
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![deny(unsafe_code)] // allowed in the module `master` only

mod adapter;
mod bus;
mod clocks;
mod config;
mod config_check;
mod cycle_timing;
mod error;
mod exchange;
mod master;
mod observer;
mod plan;
mod real_time;
mod sdo_text;
mod startup;

pub use adapter::Adapter;
pub use adapter::bring_up::StartupRounds;
pub use adapter::cycle_clock::CycleWait;
pub use adapter::operation::{OpProgress, OpWait};
pub use adapter::requests::Requests;
pub use adapter::slave::Slave;
pub use bus::{
    CanController, Diagnostics, IdentificationError, Maintenance, MaintenanceError,
    RegisterServiceError, SlaveAccess, SlaveKind, SlaveQuery, denies_object, run_in_parallel,
    slave_kinds, spawn_scoped,
};
pub use clocks::ClockStatus;
pub use config::{
    AdapterConfig, ClockSource, DcSync, Faults, Identity, MAX_SLAVES, MAX_STARTUP_STEPS,
    SlaveConfig, StartupEntry, StartupStep,
};
pub use config_check::ConfigFault;
pub use cycle_timing::{
    CycleStart, CycleStatistics, CycleTimer, CycleTiming, Distribution, MAX_SPIN_NS, OverrunPolicy,
};
pub use ecan_protocol::sequence::Expectation;
pub use ecrt_sys::{
    Clock, ECRT_VARIABLE, Ecrt, EcrtSetting, EnvironmentError, Errno, LoadError, MonotonicClock,
    Origin,
};
pub use error::{Error, NotOperational, SdoDirection, SlaveReport};
pub use exchange::{
    BYTE_NS, CycleError, DATAGRAM_OVERHEAD_BYTES, Datagram, DatagramUse, Delivery, DomainLayout,
    DomainReport, EthernetFrame, FRAME_OVERHEAD_BYTES, LogicalCommand, MAX_DATAGRAM_BYTES,
    MAX_PLAIN_MULTIPLIER, Phase,
};
pub use master::{
    AssignedPdo, DomainId, DomainState, LinkState, Master, MasterInfo, MasterRequests, MasterState,
    NodeOwner, OpenError, OpenFailure, PdoEntry, PortInfo, PortKind, RegRequestId, RequestState,
    SdoError, SdoRequestId, SlaveConfigId, SlaveConfigState, SlaveInfo, SyncDirection,
    WatchdogMode, WcState, leave_real_time,
};
pub use observer::{
    CommandTicket, NoSuchAxis, Observer, ObserverError, Publisher, QuickStop, QuickStops, Section,
    SectionWriter, Snapshot, WordGroup, WordGroups,
};
pub use plan::{
    ImageTimes, MailboxBandwidth, OutputArrivals, Plan, PlanError, PlanWarning, SlavePlan,
};
pub use real_time::{
    MAX_STACK_PREFAULT_BYTES, Need, Privilege, PrivilegeError, PrivilegeOutcome, RealTimeConfig,
    RealTimeError, RealTimeFault, RealTimeReport,
};
pub use sdo_text::{contradicted_assumption, value_text};
pub use startup::StartupPlan;
