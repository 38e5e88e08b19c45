//! The Adapter: everything between an application and an EtherCAT bus with ECAN-Lite gateways on
//! it, short of CAN itself.
//!
//! [`Adapter::open`] takes a loaded master library and a plain [`AdapterConfig`], checks it as a
//! whole, finds the gateways, maps their PDO chunks into one domain each, sends the startup SDOs
//! and leaves a bus that only waits for [`Adapter::activate`]. In the cycle [`Adapter::receive`]
//! and [`Adapter::send`] exchange the process images (manual 15.5).
//!
//! [`Plan`] tells beforehand what a configuration costs on the wire.
//!
//! Nothing here starts a thread or sleeps in the data path: the application owns the cycle.
//! [`RealTimeConfig`] and [`CycleStatistics`] help it to keep it (manual 13.9).
#![deny(missing_docs)]
#![deny(unsafe_code)] // allowed in the module `master` only

mod adapter;
mod al_status;
mod clocks;
mod config;
mod cycle;
mod cycle_grid;
mod deadline;
mod diagnose;
mod diagnostics;
mod domain_layout;
mod error;
mod identification;
mod maintenance;
mod mapping;
mod master;
mod operation;
mod operation_report;
mod plan;
mod process_image;
mod real_time;
mod recognition;
mod requests;
mod startup;
mod stop;

pub use adapter::{Adapter, Phase};
pub use clocks::ClockStatus;
pub use config::{
    AdapterConfig, ClockSource, ConfigFault, DcSync, Faults, Identity, MAX_SLAVES,
    MAX_STARTUP_STEPS, SlaveConfig, StartupEntry,
};
pub use cycle::{CycleError, Delivery, DomainReport};
pub use diagnose::run_in_parallel;
pub use diagnostics::Diagnostics;
pub use domain_layout::{DomainLayout, LogicalCommand, MAX_DATAGRAM_BYTES, MAX_PLAIN_MULTIPLIER};
pub use ecan_protocol::sequence::Expectation;
pub use error::{Error, SdoDirection, value_words};
pub use maintenance::{Maintenance, MaintenanceError};
pub use master::{
    DomainId, DomainState, LinkState, Master, MasterInfo, MasterState, NodeOwner, OpenError,
    OpenFailure, PdoEntryInfo, PdoInfo, PortInfo, PortKind, RegRequestId, RequestState,
    ScanProgress, SdoError, SdoRequestId, SlaveConfigId, SlaveConfigState, SlaveInfo,
    SyncDirection, SyncManagerInfo, WatchdogMode, WcState,
};
pub use operation::{OpProgress, OpWait};
pub use operation_report::{NotOperational, SlaveReport};
pub use plan::{
    BYTE_NS, DATAGRAM_OVERHEAD_BYTES, Datagram, DatagramUse, EthernetFrame, FRAME_OVERHEAD_BYTES,
    MailboxBandwidth, Plan, PlanError, PlanWarning, SlavePlan,
};
pub use real_time::{
    CycleStart, CycleStatistics, CycleTimer, CycleTiming, Distribution, MAX_SPIN_NS,
    MAX_STACK_PREFAULT_BYTES, Need, OverrunPolicy, Privilege, PrivilegeError, PrivilegeOutcome,
    RealTimeConfig, RealTimeError, RealTimeFault, RealTimeReport,
};
pub use recognition::{IdentificationError, SlaveKind, SlaveQuery, denies_object, slave_kinds};
pub use requests::RequestId;
pub use startup::{StartupPlan, StartupStep};

pub use ecrt_sys::{
    Clock, ECRT_VARIABLE, Ecrt, EcrtSetting, EnvironmentError, Errno, LoadError, MonotonicClock,
    Origin,
};
