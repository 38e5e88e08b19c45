//! Binding of the IgH EtherCAT master library `libethercat`, loaded at run time.
//!
//! [`Ecrt`] is a loaded library: a table of functions ([`Functions`]) and a [`Clock`]. It comes
//! from a shared object ([`Ecrt::load`]), version 1.5, 1.6 or later, or from a simulated libethercat that
//! fills the same table ([`Ecrt::simulated`]). Neither replaces the other automatically.
//!
//! This crate has no safe handles: `Master` of the crate `ecan-host` owns the pointers that the
//! functions return. The library has no locks; one thread uses a master at a time.
//!
//! # Features
//!
//! `regenerate` generates the types with bindgen (needs libclang): from `ecrt.h` in the directory
//! that the environment variable `ECRT_INCLUDE_DIR` names, otherwise from the crate's own
//! `ecrt-abi.h`. The tests then check that header's layout.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[cfg(not(feature = "regenerate"))]
#[allow(missing_docs, non_camel_case_types, clippy::all)]
#[allow(clippy::undocumented_unsafe_blocks)]
#[rustfmt::skip]
mod bindings;

#[cfg(feature = "regenerate")]
#[allow(missing_docs, non_camel_case_types, non_snake_case, clippy::all)]
#[allow(clippy::undocumented_unsafe_blocks)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

mod clock;
mod ecrt;
mod errno;
mod functions;
mod library;
mod load_error;
mod setting;

pub use bindings::{
    EC_AL_STATE_INIT, EC_AL_STATE_OP, EC_AL_STATE_PREOP, EC_AL_STATE_SAFEOP, EC_DIR_INPUT,
    EC_DIR_INVALID, EC_DIR_OUTPUT, EC_MAX_PORTS, EC_MAX_STRING_LENGTH, EC_MAX_SYNC_MANAGERS,
    EC_PORT_EBUS, EC_PORT_MII, EC_PORT_NOT_CONFIGURED, EC_PORT_NOT_IMPLEMENTED, EC_REQUEST_BUSY,
    EC_REQUEST_ERROR, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, EC_WC_COMPLETE, EC_WC_INCOMPLETE,
    EC_WC_ZERO, EC_WD_DEFAULT, EC_WD_DISABLE, EC_WD_ENABLE, ec_al_state_t, ec_direction_t,
    ec_domain_state_t, ec_domain_t, ec_master_info_t, ec_master_link_state_t,
    ec_master_scan_progress_t, ec_master_state_t, ec_master_t, ec_pdo_entry_info_t,
    ec_pdo_entry_reg_t, ec_pdo_info_t, ec_reg_request_t, ec_request_state_t, ec_sdo_request_t,
    ec_slave_config_state_t, ec_slave_config_t, ec_slave_info_t, ec_slave_port_desc_t,
    ec_slave_port_link_t, ec_sync_info_t, ec_watchdog_mode_t, ec_wc_state_t,
};
pub use clock::{Clock, MonotonicClock};
pub use ecrt::{Ecrt, Origin};
pub use errno::Errno;
pub use functions::{Functions, Status};
pub use library::{DEFAULT_LIBRARY, OpenMaster, symbols};
pub use load_error::{ECRT_VARIABLE, LoadError, RELEASES};
pub use setting::{EcrtSetting, EnvironmentError};
