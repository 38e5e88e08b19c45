//! Configuration
//!
//! Plain data: it may be copied and needs no deinit. igh_mcan_port_apply_config() passes it to the
//! Adapter's configuration, whose startup SDOs it then determines.

use ecan_c_boundary::pointers;
use ecan_c_export::export;
use ecan_mcan_port::{MAX_FILTERS, PortConfig, PortError};

use crate::adapter::config::ecan_igh_config_t;
use crate::encoded::{Encoded, EncodedCall as _};
use crate::errors::OrCode as _;
use crate::port_config::{configured, extended};

/// Most filters of a configuration, of all channels together.
pub const IGH_MCAN_MAX_FILTERS: usize = 512;

const _: () = assert!(IGH_MCAN_MAX_FILTERS == MAX_FILTERS);

/// Configuration of the gateways. About 40 kilobytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_port_config_t {
    /// Not for the application.
    pub opaque: [u64; 5120],
}

/// Has all gateways that a configuration may have.
impl Encoded for igh_mcan_port_config_t {
    type Value = PortConfig;
    const SEAL: u64 = 0x6d63_616e_5f63_6667;
    const INIT: &'static str = "igh_mcan_port_default_config";
}

/// Fills a configuration: no channel enabled, encapsulation 0, no options, pacing on.
///
/// @param config  Is overwritten.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn igh_mcan_port_default_config(config: *mut igh_mcan_port_config_t) {
    pointers!(call, out(config));
    call.encode(&config, &extended(&PortConfig::default()))
}

/// Applies a configuration to the Adapter's: ecan_igh_init() then registers PDO profiles, channel
/// masks, bit rates, filters and budgets as startup SDOs (manual 15.5.2, step 4). Is copied; call
/// it again after a change. Only the gateways of the first slave_count slaves count.
///
/// Without this call the gateways keep their last configuration; a Port then verifies that it is
/// the Port's configuration.
///
/// @usage   not rt, any thread, before ecan_igh_init
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error().
#[export(call, config adapter)]
pub fn igh_mcan_port_apply_config(
    igh_config: *mut ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) {
    pointers!(call, encoded(config));
    let checked = configured(&config, adapter.slave_count).check(&adapter.configured());
    checked.map_err(PortError::from).or_code(call)?;
    adapter.port = Some(*config);
}

/// Checks a configuration as a whole against that of the Adapter. igh_mcan_port_apply_config() and
/// igh_mcan_port_init() do it, too.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_apply_config().
#[must_use]
#[export(call)]
pub fn igh_mcan_port_check_config(
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) {
    pointers!(call, encoded(igh_config), encoded(config));
    let checked = configured(&config, igh_config.slave_count).check(&igh_config.configured());
    checked.map_err(PortError::from).or_code(call)
}
