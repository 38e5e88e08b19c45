//! Context of axes: life and common settings.

use std::ffi::{OsStr, c_char};
use std::os::unix::ffi::OsStrExt as _;
use std::time::Duration;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutPointer, mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{
    BlockTransferConfig, HostHeartbeat, NetworkConfig, NodeAddress, NodeConfig, NodeDescription,
    NodeHandle, NodeId, SdoConfig, SyncConfig,
};
use ecan_cia402::{AxisRef, Cia402, Cia402Config, Takeover, axis_faults};
use ecan_mcan_port::Port;

use super::axis::igh_cia402_axis_t;
use super::axis_table::AxisTable;
use crate::bus::Bus;
use crate::callback::{duration, milliseconds};
use crate::errors::OrCode as _;
use crate::handle;
use crate::handle::{Context, Entered, Kind};
use crate::mcan_port::context::igh_mcan_port_t;

// Section: Life of the axes
//
// igh_cia402_context_init(&motors, &mcan, axes, 2);
// igh_cia402_send_nmt_all(&motors, IGH_CANOPEN_NMT_START);
// igh_cia402_configure_csp_all_timeout(&motors, 10000);
// igh_cia402_request_actual_position_all_timeout(&motors, 2000);
// igh_cia402_enable_all_timeout(&motors, 5000);
// ...                                              the cycle
// if (igh_cia402_shutdown_timeout(&motors, 5000) != ECAN_OK) puts(ecan_last_error());
// igh_cia402_context_deinit(&motors);

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

pub(crate) fn need_axis(
    call: Call,
    cia402: &Cia402,
    axis: usize,
) -> Result<AxisRef<'_>, ecan_result_t> {
    cia402.axis(axis).ok_or_else(|| {
        let text = format_args!("there is no axis {axis}, the table has {}", cia402.axis_count());
        call.fail(ecan_result_t::ECAN_ERR_AXIS, text)
    })
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
            add_described_node(call, port, &mut cia402, description, node_config)?;
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

/// The handle of a node.
pub(crate) fn need_node(
    call: Call,
    cia402: &Cia402,
    node: usize,
) -> Result<NodeHandle, ecan_result_t> {
    let mut handles = cia402.network().handles();
    let count = handles.len();
    handles.nth(node).ok_or_else(|| {
        let text = format_args!("there is no node {node}, the network has {count}");
        call.fail(ecan_result_t::ECAN_ERR_NODE, text)
    })
}

/// A node-ID of C.
pub(crate) fn parse_node_id(call: Call, id: u8) -> Result<NodeId, ecan_result_t> {
    NodeId::from_raw(id).ok_or_else(|| {
        call.argument("node_id", format_args!("{id} is out of range; allowed: 1 to 127"))
    })
}

/// Adds a node without a boot-up.
pub(crate) fn add_node(
    call: Call,
    port: &Port,
    cia402: &mut Cia402,
    address: NodeAddress,
    config: NodeConfig,
) -> Result<NodeHandle, ecan_result_t> {
    port.channel(address.slave, address.channel).or_code(call)?;
    let config = NodeConfig { heartbeat_timeout: Duration::ZERO, ..config };
    cia402.network_mut().add_node(address, config).or_code(call)
}

/// Adds a node of a file, which boots.
pub(crate) fn add_described_node(
    call: Call,
    port: &Port,
    cia402: &mut Cia402,
    node: &NodeDescription,
    config: NodeConfig,
) -> Result<(), ecan_result_t> {
    let boot = node.boot_config().map_err(|error| {
        call.fail(ecan_result_t::ECAN_ERR_CONFIG, format_args!("{}: {error}", node.title()))
    })?;
    let handle = add_node(call, port, cia402, node.address, config)?;
    cia402.network_mut().boot(handle, boot);
    Ok(())
}

/// The index and the handle of the node at an address.
pub(crate) fn find_node(
    call: Call,
    cia402: &Cia402,
    address: NodeAddress,
) -> Result<(usize, NodeHandle), ecan_result_t> {
    let network = cia402.network();
    let found = network.find(address).and_then(|found| {
        let index = network.handles().position(|handle| handle == found)?;
        Some((index, found))
    });
    found.ok_or_else(|| {
        let text = format_args!(
            "{address} is not in the network of the axes; call igh_canopen_add_node first"
        );
        call.fail(ecan_result_t::ECAN_ERR_NODE, text)
    })
}

// Section: Settings of all axes together

/// Marks filled settings.
const SEAL: u64 = 0x6563_616e_5f63_3432;

/// Upper limit of sdo_buffer_bytes.
const MOST_SDO_BYTES: u32 = 1 << 24;

mirror! {
    /// Common settings of the axes of a context. igh_cia402_default_settings() fills it; change
    /// fields after it. Plain data: it may be copied and needs no deinit.
    pub struct igh_cia402_settings_t from rust: Cia402Config {
        /// Not for the application: marks filled settings.
        seal: u64 = SEAL,
        /// Fewest cycles from target to target (--motion-div); 0 counts as 1. The target period is the
        /// least multiple of sync_every_cycles that is not below it. Default 1.
        motion_div: u32,
        /// Cycles from SYNC to SYNC; 0 counts as 1. Default 1.
        sync_every_cycles: u32 = rust.sync.every_cycles,
        /// Heartbeat of the host, in milliseconds; 0 sends none, and no drive detects a lost host.
        /// Default 50.
        host_heartbeat_ms: u32 = {
            rust.network.host_heartbeat.map_or(0, |host| milliseconds(host.period))
        },
        /// Node-ID of the host's heartbeat, which no drive may have. Default 127.
        host_node_id: u8 = rust.network.host_heartbeat.map_or(NodeId::MAX, |host| host.node).get(),
        /// SYNC with a counter from 1 to this value, 2 to 240, as in the drives' 0x1019; 0 sends
        /// SYNC without data. Default 0.
        sync_counter_overflow: u8 = rust.sync.counter_overflow.unwrap_or(0),
        /// Most SDO frames and NMT commands per cycle and channel. Default 2.
        service_frames_per_cycle: u8 = rust.network.service_frames_per_cycle,
        /// Number of pending frames of the channel in the gateway at which SDO frames wait, at most
        /// 7. Default 7.
        sdo_pending_limit: u8 = rust.network.sdo_pending_limit,
        /// Bytes of each RxPDO image that SDO frames leave free for frames that the application
        /// sends after the targets. Default 0.
        reserved_image_bytes: u32 = short(rust.network.reserved_image_bytes),
        /// Size of the NMT command queue of a channel. Default 32.
        nmt_queue: u32 = short(rust.network.nmt_queue),
        /// Timeout for the response to an SDO request, in milliseconds. Default 500.
        sdo_timeout_ms: u32 = milliseconds(rust.node.sdo.timeout),
        /// Longest value of an SDO transfer, in bytes. Default 1024.
        sdo_buffer_bytes: u32 = short(rust.node.sdo.buffer_bytes),
        /// Downloads with at least this number of bytes try block transfer; 0 never does. Default
        /// 64.
        sdo_block_from: u32 = rust.node.sdo.block.download_from.map_or(0, short),
        /// Number of retries of an SDO transfer without a response. Default 2.
        sdo_retries: u8 = rust.node.sdo.retries,
        /// 1: uploads request block transfer. Default 0.
        sdo_block_upload: u8 = rust.node.sdo.block.upload.into(),
        /// Segments per block of a block upload, 1 to 127. Default 16.
        sdo_block_segments: u8 = rust.node.sdo.block.segments,
        /// An igh_cia402_takeover_t: treatment of a drive that is enabled at the first contact.
        /// Default IGH_CIA402_TAKEOVER_STOP.
        takeover: u8 = igh_cia402_takeover_t::from(rust.takeover) as u8,
        /// Must be 0; for fields of later versions.
        reserved: [u64; 8] = [0; 8],
    }
}

mirror! {
    /// Treatment of a drive that is enabled at the first contact.
    pub enum igh_cia402_takeover_t from Takeover {
        /// The drive is quick-stopped, and disabled at rest.
        IGH_CIA402_TAKEOVER_STOP = 0 => Takeover::Stop,
        /// The drive remains enabled if it is at rest, has mode and process data of the configuration, and
        /// takes a target that keeps it at standstill; otherwise the drive is stopped.
        IGH_CIA402_TAKEOVER_ADOPT = 1 => Takeover::Adopt,
    }
}

impl igh_cia402_takeover_t {
    fn parse(number: u8) -> Option<Takeover> {
        [Takeover::Stop, Takeover::Adopt]
            .into_iter()
            .find(|takeover| Self::from(*takeover) as u8 == number)
    }
}

fn short(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

impl igh_cia402_settings_t {
    pub(crate) fn checked(&self, call: Call) -> Result<Cia402Config, ecan_result_t> {
        if self.seal != SEAL {
            let text = format_args!(
                "`settings` is not filled: call igh_cia402_default_settings on it first"
            );
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        call.reserved("settings", &self.reserved)?;
        let fault = |name: &str, value: u32| {
            let text = format_args!("invalid value {value} for `{name}`");
            call.fail(ecan_result_t::ECAN_ERR_CONFIG, text)
        };
        let host_heartbeat = match self.host_heartbeat_ms {
            0 => None,
            period_ms => {
                let id = self.host_node_id;
                let node = NodeId::from_raw(id).ok_or_else(|| fault("host_node_id", id.into()))?;
                Some(HostHeartbeat { node, period: duration(period_ms) })
            }
        };
        if self.sdo_buffer_bytes > MOST_SDO_BYTES {
            return Err(fault("sdo_buffer_bytes", self.sdo_buffer_bytes));
        }
        if self.nmt_queue > u32::from(u16::MAX) {
            return Err(fault("nmt_queue", self.nmt_queue));
        }
        if !(1..=127).contains(&self.sdo_block_segments) {
            return Err(fault("sdo_block_segments", self.sdo_block_segments.into()));
        }
        let block = BlockTransferConfig {
            download_from: (self.sdo_block_from != 0).then_some(self.sdo_block_from as usize),
            upload: self.sdo_block_upload != 0,
            segments: self.sdo_block_segments,
        };
        Ok(Cia402Config {
            network: NetworkConfig {
                service_frames_per_cycle: self.service_frames_per_cycle,
                sdo_pending_limit: self.sdo_pending_limit,
                reserved_image_bytes: self.reserved_image_bytes as usize,
                nmt_queue: self.nmt_queue as usize,
                host_heartbeat,
            },
            node: NodeConfig {
                sdo: SdoConfig {
                    timeout: duration(self.sdo_timeout_ms),
                    retries: self.sdo_retries,
                    buffer_bytes: self.sdo_buffer_bytes as usize,
                    block,
                    ..SdoConfig::default()
                },
                ..NodeConfig::default()
            },
            sync: SyncConfig {
                every_cycles: self.sync_every_cycles,
                counter_overflow: (self.sync_counter_overflow != 0)
                    .then_some(self.sync_counter_overflow),
                schedule: None,
            },
            motion_div: self.motion_div,
            takeover: igh_cia402_takeover_t::parse(self.takeover)
                .ok_or_else(|| fault("takeover", self.takeover.into()))?,
        })
    }
}

/// Fills settings: targets and SYNC in every cycle, a heartbeat of the host every 50 ms.
///
/// @param settings  Is overwritten.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn igh_cia402_default_settings(settings: *mut igh_cia402_settings_t) {
    pointers!(call, out(settings));
    settings.set(Cia402Config::default().into());
}

#[cfg(test)]
mod tests {
    use std::ffi::c_int;

    use ecan_c_boundary::call;

    use super::*;

    fn to_rust(settings: &igh_cia402_settings_t) -> Result<Cia402Config, c_int> {
        let mut rust = None;
        let code = call("to_rust", |call| {
            rust = Some(settings.checked(call)?);
            Ok(())
        });
        rust.ok_or(code)
    }

    #[test]
    fn defaults_of_c_are_those_of_rust() {
        assert_eq!(to_rust(&Cia402Config::default().into()), Ok(Cia402Config::default()));
    }

    #[test]
    fn other_values_round_trip() {
        let mut settings = Cia402Config { motion_div: 3, ..Cia402Config::default() };
        settings.network.host_heartbeat = None;
        settings.sync.counter_overflow = Some(10);
        settings.sync.every_cycles = 2;
        settings.node.sdo.timeout = Duration::from_millis(123);
        settings.node.sdo.retries = 7;
        settings.node.sdo.buffer_bytes = 321;
        settings.node.sdo.block =
            BlockTransferConfig { download_from: None, upload: true, segments: 9 };
        assert_eq!(to_rust(&settings.clone().into()), Ok(settings));
    }

    #[test]
    fn invalid_settings_return_errors() {
        let config = Err(ecan_result_t::ECAN_ERR_CONFIG.code());
        let mut settings: igh_cia402_settings_t = Cia402Config::default().into();
        settings.host_node_id = 0;
        assert_eq!(to_rust(&settings), config);
        settings.host_heartbeat_ms = 0;
        assert!(to_rust(&settings).is_ok(), "no heartbeat needs no node-ID");
        settings.sdo_block_segments = 0;
        assert_eq!(to_rust(&settings), config);
        settings.seal = 1;
        assert_eq!(to_rust(&settings), Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code()));
    }
}
