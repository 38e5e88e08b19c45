//! Life of the axes
//!
//! ```c
//! igh_cia402_context_init(&motors, &mcan, axes, 2);
//! igh_cia402_send_nmt_all(&motors, IGH_CANOPEN_NMT_START);
//! igh_cia402_configure_csp_all_timeout(&motors, 10000);
//! igh_cia402_request_actual_position_all_timeout(&motors, 2000);
//! igh_cia402_enable_all_timeout(&motors, 5000);
//! ...                                              the cycle
//! if (igh_cia402_shutdown_timeout(&motors, 5000) != ECAN_OK) puts(ecan_last_error());
//! igh_cia402_context_deinit(&motors);
//! ```

use std::ffi::{OsStr, c_char};
use std::os::unix::ffi::OsStrExt as _;
use std::time::Duration;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutPointer, pointers};
use ecan_c_export::export;
use ecan_cia402::{Cia402, Cia402Config, axis_faults};
use ecan_mcan_port::Port;

use super::axis::igh_cia402_axis_t;
use super::axis_table::AxisTable;
use super::settings::igh_cia402_settings_t;
use crate::bus::Bus;
use crate::canopen::lookup;
use crate::entry::Context;
use crate::errors::OrCode as _;
use crate::handle::{self, Entered, Kind};
use crate::mcan_port::context::igh_mcan_port_t;

/// CiA 402 axes on the gateways of a Port. Belongs to the thread of the cycle; do not move or copy
/// it. Ends with its igh_mcan_port_t at the latest.
#[repr(C)]
#[derive(Debug)]
pub struct igh_cia402_context_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

impl Context for igh_cia402_context_t {
    type Object = Bus;
    const KIND: Kind = Kind::Cia402;
    type Layer<'a> = (&'a mut Cia402, &'a mut Port);

    fn is_current(bus: &Entered<Bus>) -> bool {
        bus.names_axes()
    }

    fn layer(call: Call, bus: &mut Entered<Bus>) -> Result<Self::Layer<'_>, ecan_result_t> {
        bus.need_axes(call)
    }
}

pub(crate) fn need_axis(call: Call, cia402: &Cia402, axis: usize) -> Result<(), ecan_result_t> {
    let count = cia402.axis_count();
    if axis < count {
        return Ok(());
    }
    let text = format_args!("there is no axis {axis}, the table has {count}");
    Err(call.fail(ecan_result_t::ECAN_ERR_AXIS, text))
}

/// Opens axes on a Port, with default settings. Nothing is sent; SYNC and the host's heartbeat
/// start with the first cycle.
///
/// @param context     Any content; the manual's fragments leave it uninitialised.
/// @param port        The Port. Must not move while the axes are used.
/// @param axes        The axis table. Is copied.
/// @param axis_count  Its length.
///
/// @usage   not rt, the cycle's thread, after igh_mcan_port_init
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault of the table; ECAN_ERR_SLAVE,
///          ECAN_ERR_CHANNEL for a slave or channel that the Port does not have;
///          ECAN_ERR_NOT_INITIALISED for a Port, or an axis that is not filled; ECAN_ERR_ORDER for
///          a context that is initialised already, or a Port that has axes.
#[export(call, bus bus, of port)]
pub fn igh_cia402_context_init(
    context: *mut igh_cia402_context_t,
    port: *mut igh_mcan_port_t,
    axes: *const igh_cia402_axis_t,
    axis_count: usize,
) {
    pointers!(call, out(context), items(axes, axis_count));
    prepare(call, bus, &context)?;
    let settings = Cia402Config::default();
    init(call, bus, &context, settings, |port, settings| of_table(call, port, axes, settings))
}

/// As igh_cia402_context_init(), with settings of the application.
///
/// @param settings  Is copied.
///
/// @usage   not rt, the cycle's thread, after igh_mcan_port_init
/// @return  As igh_cia402_context_init().
#[must_use]
#[export(call, bus bus, of port)]
pub fn igh_cia402_context_init_ex(
    context: *mut igh_cia402_context_t,
    port: *mut igh_mcan_port_t,
    axes: *const igh_cia402_axis_t,
    axis_count: usize,
    settings: *const igh_cia402_settings_t,
) {
    pointers!(call, out(context), items(axes, axis_count), read(settings));
    prepare(call, bus, &context)?;
    let settings = settings.checked(call)?;
    init(call, bus, &context, settings, |port, settings| of_table(call, port, axes, settings))
}

/// Opens the axes and the CANopen nodes of a configuration file, `[[axis]]`, `[[node]]` and `[[bus]]`,
/// on a Port: that of igh_mcan_port_load_config(), or another one with the same gateways and channels.
/// Each node without an axis boots from the first cycle on, as igh_canopen.h describes; axes are
/// configured by igh_cia402_configure_csp_all_timeout().
///
/// @param context   Any content.
/// @param port      The Port. Must not move while the axes are used.
/// @param path      Path of the file, relative to the working directory. Its device files are relative to
///                  the file.
/// @param settings  Is copied; NULL for those of the table `[network]`. TIME is always that of the file.
///
/// @usage   not rt, the cycle's thread, after igh_mcan_port_init
/// @return  As igh_cia402_context_init(); ECAN_ERR_FILE if the file cannot be read; ECAN_ERR_CONFIG
///          with every fault of the file by line and column, or if a node has the node-ID of the
///          host's heartbeat.
#[must_use]
#[export(call, bus bus, of port)]
pub fn igh_cia402_context_init_file(
    context: *mut igh_cia402_context_t,
    port: *mut igh_mcan_port_t,
    path: *const c_char,
    settings: *const igh_cia402_settings_t,
) {
    pointers!(call, out(context), c_str(path), optional(settings));
    prepare(call, bus, &context)?;
    let path = OsStr::from_bytes(path.to_bytes());
    let network = ecan_lite::config::load_network_settings(path).or_code(call)?;
    let settings = match settings {
        Some(settings) => settings.checked(call)?,
        None => network.cia402.clone(),
    };
    init(call, bus, &context, settings, |port, settings| {
        let axes = ecan_lite::config::load_axes(path).or_code(call)?;
        let nodes = ecan_lite::config::load_nodes(path).or_code(call)?;
        let node_config = settings.node;
        let mut cia402 = Cia402::new(port, axes, settings).or_code(call)?;
        let time = network.time(port.adapter().clock().now_ns());
        cia402.network_mut().set_time(time).or_code(call)?;
        for description in &nodes {
            lookup::add_described(call, port, &mut cia402, description, node_config)?;
        }
        Ok(cia402)
    })
}

fn of_table(
    call: Call,
    port: &Port,
    axes: &[igh_cia402_axis_t],
    settings: Cia402Config,
) -> Result<Cia402, ecan_result_t> {
    let table = AxisTable::read(call, axes)?;
    let table = table.into_axes(call, |axes| axis_faults(port, axes, &settings))?;
    Cia402::new(port, table, settings).or_code(call)
}

/// Rejects a Port that has axes, and clears the context for new ones.
fn prepare(
    call: Call,
    bus: &mut Entered<Bus>,
    context: &OutPointer<igh_cia402_context_t>,
) -> Result<(), ecan_result_t> {
    // Living axes may well be those of this context, which stay.
    // SAFETY: `out` was promised that the pointer is valid.
    unsafe { bus.need_no_axes(call, context.as_ptr().cast())? };
    // SAFETY: as above.
    unsafe { handle::clear(context.as_ptr().cast()) };
    Ok(())
}

/// Adds axes to a context that was prepared.
fn init(
    call: Call,
    bus: &mut Entered<Bus>,
    context: &OutPointer<igh_cia402_context_t>,
    settings: Cia402Config,
    make: impl FnOnce(&Port, Cia402Config) -> Result<Cia402, ecan_result_t>,
) -> Result<(), ecan_result_t> {
    let serial = bus.add_cia402(call, settings.node, |port| make(port, settings))?;
    // SAFETY: `out` was promised that the pointer is valid.
    unsafe { bus.add_axes_context(context.as_ptr().cast(), serial) };
    Ok(())
}

/// Closes the axes; the Port continues. Axes that may move are stopped before, as by
/// igh_cia402_stop_all_timeout() with the time of igh_cia402_set_stop_time_ms(). Drives that are off are not
/// released from their watch over the host: that is part of igh_cia402_shutdown_timeout().
///
/// @usage   not rt, the cycle's thread, any time
/// @return  ECAN_OK, also for axes that are closed already or were never opened.
///          Also for a copy of it, which ends nothing. ECAN_ERR_AXES names the axes that may still
///          move, as a line on standard error does; they are closed nevertheless.
#[export(call, end mut bus)]
pub fn igh_cia402_context_deinit(context: *mut igh_cia402_context_t) {
    let stopped = bus.stop_axes();
    bus.remove_cia402();
    stopped.or_code(call)
}

/// Sets the time for which igh_cia402_context_deinit(), igh_mcan_port_deinit() and ecan_igh_deinit() wait
/// until axes that may move have stopped.
///
/// @param stop_time_ms  Milliseconds; the default is 10000. 0 leaves the axes as they are, for a program
///                      whose successor adopts them.
///
/// @usage   not rt, the cycle's thread, after init
#[export(_, layer(cia402, _))]
pub fn igh_cia402_set_stop_time_ms(context: *mut igh_cia402_context_t, stop_time_ms: u32) {
    cia402.set_stop_time(Duration::from_millis(stop_time_ms.into()));
}

/// Returns the number of axes.
///
/// @usage   rt, the cycle's thread, after init
/// @return  The number; 0 if there is no context.
#[export(_, layer(cia402, _), or 0)]
pub fn igh_cia402_axis_count(context: *mut igh_cia402_context_t) -> usize {
    Ok(cia402.axis_count())
}
