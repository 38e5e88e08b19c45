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
mod deadline;
mod error;
mod master;
mod observer;
mod phase;
mod plan;
mod real_time;
mod startup;

pub use adapter::{
    Adapter, CycleWait, Delivery, DomainReport, OpProgress, OpWait, StartupRounds, run_in_parallel,
};
pub use bus::{
    CanController, Diagnostics, IdentificationError, Maintenance, MaintenanceError,
    RegisterServiceError, SlaveAccess, SlaveKind, SlaveQuery, denies_object, slave_kinds,
};
pub use clocks::ClockStatus;
pub use config::{
    AdapterConfig, ClockSource, ConfigFault, DcSync, Faults, Identity, MAX_SLAVES,
    MAX_STARTUP_STEPS, SlaveConfig, StartupEntry,
};
pub use error::{
    CycleError, Error, NotOperational, SdoDirection, SlaveReport, contradicted_assumption,
    value_text,
};
pub use master::{
    AssignedPdo, DomainId, DomainState, LinkState, Master, MasterInfo, MasterState, NodeOwner,
    OpenError, OpenFailure, PdoEntry, PortInfo, PortKind, RegRequestId, RequestState, SdoError,
    SdoRequestId, SlaveConfigId, SlaveConfigState, SlaveInfo, SyncDirection, WatchdogMode, WcState,
    leave_real_time,
};
pub use observer::{
    CommandTicket, NoSuchAxis, Observer, ObserverError, QuickStop, QuickStops, Section,
    SectionWriter, Snapshot, WordGroup, WordGroups,
};
pub use phase::Phase;
pub use plan::{
    BYTE_NS, DATAGRAM_OVERHEAD_BYTES, Datagram, DatagramUse, DomainLayout, EthernetFrame,
    FRAME_OVERHEAD_BYTES, ImageTimes, LogicalCommand, MAX_DATAGRAM_BYTES, MAX_PLAIN_MULTIPLIER,
    MailboxBandwidth, OutputArrivals, Plan, PlanError, PlanWarning, SlavePlan,
};
pub use real_time::{
    CycleStart, CycleStatistics, CycleTimer, CycleTiming, Distribution, MAX_SPIN_NS,
    MAX_STACK_PREFAULT_BYTES, Need, OverrunPolicy, Privilege, PrivilegeError, PrivilegeOutcome,
    RealTimeConfig, RealTimeError, RealTimeFault, RealTimeReport,
};
pub use startup::{StartupPlan, StartupStep};

pub use ecan_protocol::sequence::Expectation;
pub use ecrt_sys::{
    Clock, ECRT_VARIABLE, Ecrt, EcrtSetting, EnvironmentError, Errno, LoadError, MonotonicClock,
    Origin,
};
