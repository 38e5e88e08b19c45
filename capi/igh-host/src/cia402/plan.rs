//! Preflight plan of axes

use std::ffi::c_char;

use ecan_c_boundary::pointers;
use ecan_c_export::export;
use ecan_cia402::{Cia402Config, axis_traffic};

use super::axis::igh_cia402_axis_t;
use super::axis_table::AxisTable;
use crate::adapter::config::ecan_igh_config_t;
use crate::encoded::EncodedCall as _;
use crate::mcan_port::config::igh_mcan_port_config_t;
use crate::mcan_port::plan::plan;

/// Plans configurations for the process data of axes: targets, TPDOs and SYNC. As
/// igh_mcan_port_plan().
///
/// @param motion_div  Cycles from target to target; 0 counts as 1.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_plan(); ECAN_ERR_NOT_INITIALISED also for an axis that is not filled,
///          ECAN_ERR_CONFIG also for a value out of range.
#[must_use]
#[export(call)]
pub fn igh_cia402_plan(
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
    axes: *const igh_cia402_axis_t,
    axis_count: usize,
    motion_div: u32,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    pointers!(call, encoded(igh_config), encoded(config), items(axes, axis_count));
    let axes = AxisTable::read(call, axes)?.into_axes(call, |_| Vec::new())?;
    let settings = Cia402Config { motion_div: motion_div.max(1), ..Cia402Config::default() };
    plan(call, &igh_config, &config, &axis_traffic(&axes, &settings), text)
}
