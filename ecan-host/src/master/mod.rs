//! Safe handles of a libethercat: the master and everything that is created from it.
//!
//! The only module of this crate with `unsafe` code: the calls of the C interface, and the
//! scheduling of the cycle's thread.
#![allow(unsafe_code)]

mod bus;
mod configuration;
mod handle;
mod open_error;
mod raw;
mod requests;
mod scheduling;

pub use bus::{
    AssignedPdo, LinkState, MasterInfo, MasterState, PdoEntry, PortInfo, PortKind, SdoError,
    SlaveInfo,
};
pub use configuration::{SlaveConfigState, SyncDirection, WatchdogMode};
pub use handle::{DomainState, Master, WcState};
pub use open_error::{NodeOwner, OpenError, OpenFailure};
pub(crate) use raw::ImageId;
pub use raw::{DomainId, RegRequestId, SdoRequestId, SlaveConfigId};
pub use requests::{MasterRequests, RequestState};
pub use scheduling::leave_real_time;
pub(crate) use scheduling::set_fifo_priority;
