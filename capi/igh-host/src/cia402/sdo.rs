//! SDO transfers with drives and with any CANopen node.

use std::ffi::c_void;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutArray, OutPointer, pointers};
use ecan_c_export::export;
use ecan_canopen::{
    Network, NetworkConfig, NodeAddress, NodeConfig, NodeHandle, Sdo, SdoConfig, SdoStartError,
    WaitError,
};
use ecan_cia402::{Cia402, CommandError};
use ecan_mcan_port::Port;

use super::context::{find_node, igh_cia402_context_t, need_axis, parse_node_id};
use crate::bus::Bus;
use crate::callback::duration;
use crate::errors;
use crate::errors::OrCode as _;
use crate::handle::Entered;
use crate::mcan_port::context::igh_mcan_port_t;
use crate::mcan_port::state::find_channel;

// Section: SDO transfers with the drives
//
// A drive has one SDO server: while its axis is configured, changes its mode or is homing, a
// transfer of the application waits.

/// State of the last SDO transfer with a drive.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_sdo_state_t {
    /// There was none.
    IGH_CIA402_SDO_IDLE = 0,
    /// In progress.
    IGH_CIA402_SDO_RUNNING = 1,
    /// Done.
    IGH_CIA402_SDO_DONE = 2,
    /// Failed.
    IGH_CIA402_SDO_FAILED = 3,
}

/// Stores a value and its length, even if it does not fit.
pub(crate) fn put_value(
    call: Call,
    value: &[u8],
    room: &mut OutArray<u8>,
    length: &OutPointer<usize>,
) -> Result<(), ecan_result_t> {
    let bytes = value.len();
    length.set(bytes);
    if room.push_bytes(value) {
        return Ok(());
    }
    let text = format_args!("the value has {bytes} bytes, more than the buffer");
    Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text))
}

/// Reads an object of a drive and waits. Runs the cycle, with the axes at their last targets.
///
/// @param data        Gets the value, little endian.
/// @param size        Bytes of the buffer.
/// @param length      Gets the bytes of the value, even if it does not fit.
/// @param timeout_ms  Total time in milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_SDO with ecan_last_abort_code(); ECAN_ERR_TIMEOUT, ECAN_ERR_BUFFER,
///          ECAN_ERR_CANOPEN, ECAN_ERR_AXIS, ECAN_ERR_MASTER; ECAN_ERR_ORDER if the bus is not
///          active; ECAN_ERR_ATTACHED on a master of another owner, use
///          igh_cia402_sdo_start_upload() there.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_sdo_upload(
    context: *mut igh_cia402_context_t,
    axis: usize,
    index: u16,
    subindex: u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
    timeout_ms: u32,
) {
    pointers!(call, byte_room(data, size), out(length));
    bus.run_to_end(call)?;
    let (cia402, port) = bus.need_axes(call)?;
    let node = cia402.axis(axis).ok_or(CommandError::NoSuchAxis { axis }).or_code(call)?.node();
    let mut waiting = cia402.blocking(port, duration(timeout_ms));
    let value = waiting.upload(node, (index, subindex)).or_code(call)?;
    put_value(call, &value, &mut data, &length)
}

/// Writes an object of a drive and waits; as igh_cia402_sdo_upload().
///
/// @param data        The value, little endian, with as many bytes as the object has.
/// @param size        Its bytes.
/// @param timeout_ms  Total time in milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_sdo_upload(); on a master of another owner use
///          igh_cia402_sdo_start_download().
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_sdo_download(
    context: *mut igh_cia402_context_t,
    axis: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
    timeout_ms: u32,
) {
    pointers!(call, bytes(data, size));
    bus.run_to_end(call)?;
    let (cia402, port) = bus.need_axes(call)?;
    let node = cia402.axis(axis).ok_or(CommandError::NoSuchAxis { axis }).or_code(call)?.node();
    let mut waiting = cia402.blocking(port, duration(timeout_ms));
    waiting.download(node, (index, subindex), data).or_code(call)
}

pub(crate) fn started(call: Call, started: Result<(), SdoStartError>) -> Result<(), ecan_result_t> {
    started.map_err(|error| match error {
        SdoStartError::Busy => {
            call.fail(ecan_result_t::ECAN_ERR_AXIS_STATE, format_args!("{error}"))
        }
        error => errors::note(call, &WaitError::Start(error)),
    })
}

/// Starts reading an object of a drive; igh_cia402_sdo_poll() gets the result in later cycles.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE while another transfer with the drive is in progress;
///          ECAN_ERR_AXIS.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_cia402_sdo_start_upload(
    context: *mut igh_cia402_context_t,
    axis: usize,
    index: u16,
    subindex: u8,
) {
    let node = need_axis(call, cia402, axis)?.node();
    started(call, cia402.network_mut().start_upload(node, index, subindex))
}

/// Starts writing an object of a drive, as igh_cia402_sdo_start_upload().
///
/// @param data  The value, little endian, with as many bytes as the object has. Is copied.
/// @param size  Its bytes.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_sdo_start_upload(); ECAN_ERR_CANOPEN for a value that is longer than
///          igh_cia402_settings_t.sdo_buffer_bytes.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_cia402_sdo_start_download(
    context: *mut igh_cia402_context_t,
    axis: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    let node = need_axis(call, cia402, axis)?.node();
    started(call, cia402.network_mut().start_download(node, index, subindex, data))
}

/// Gets the state of the last started transfer with a drive. Call it in every cycle: the axis' own
/// transfers start when necessary and replace the value.
///
/// @param state   Gets an igh_cia402_sdo_state_t.
/// @param data    Gets the value of a finished upload, little endian; may be NULL with size 0.
/// @param size    Bytes of the buffer.
/// @param length  Gets the bytes of the value, even if it does not fit; 0 while there is none.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, also for a failed transfer, whose reason is in ecan_last_error() and
///          ecan_last_abort_code(); ECAN_ERR_BUFFER, ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_sdo_poll(
    context: *mut igh_cia402_context_t,
    axis: usize,
    state: *mut u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) {
    pointers!(call, out(state), byte_room(data, size), out(length));
    length.set(0);
    state.set(igh_cia402_sdo_state_t::IGH_CIA402_SDO_IDLE as u8);
    let node = need_axis(call, cia402, axis)?.node();
    poll(call, cia402.network(), node, &state, &mut data, &length)
}

/// Stores the state of the last transfer with a node, and its value.
pub(crate) fn poll(
    call: Call,
    network: &Network,
    node: NodeHandle,
    state: &OutPointer<u8>,
    data: &mut OutArray<u8>,
    length: &OutPointer<usize>,
) -> Result<(), ecan_result_t> {
    use igh_cia402_sdo_state_t::*;
    match network.sdo_state(node) {
        Sdo::Idle => state.set(IGH_CIA402_SDO_IDLE as u8),
        Sdo::Busy => state.set(IGH_CIA402_SDO_RUNNING as u8),
        Sdo::Failed(_) => {
            if let Some(failure) = network.sdo_failure(node) {
                errors::note(call, &WaitError::from(failure));
            }
            state.set(IGH_CIA402_SDO_FAILED as u8);
        }
        _ => {
            state.set(IGH_CIA402_SDO_DONE as u8);
            return put_value(call, network.sdo_data(node), data, length);
        }
    }
    Ok(())
}

// Section: SDO transfers with any CANopen node
//
// For tools, and for the startup of devices. Each call runs the cycle, with axes on the Port at their last
// targets; it drops other received frames. With axes, the node must be in their network, as drive, as
// node of its file, or by igh_canopen_add_node().

/// Limits of a transfer's buffer.
const LEAST_BUFFER: usize = 1024;
const MOST_BUFFER: usize = 1 << 24;

/// The node of a transfer.
enum Peer<'a> {
    /// In a network that lives as long as the call.
    Alone(&'a mut Port, Box<Network>, NodeHandle),
    /// In the network of the axes.
    WithAxes(&'a mut Cia402, &'a mut Port, NodeHandle),
}

impl<'a> Peer<'a> {
    fn new(
        call: Call,
        bus: &'a mut Entered<Bus>,
        (slave, channel, node_id): (usize, u8, u8),
        size: usize,
    ) -> Result<Self, ecan_result_t> {
        bus.run_to_end(call)?;
        find_channel(call, bus.need_port(call)?, slave, channel)?;
        let address = NodeAddress { slave, channel, node: parse_node_id(call, node_id)? };
        if bus.axes_mut().is_some() {
            let (cia402, port) = bus.need_axes(call)?;
            let (_, handle) = find_node(call, cia402, address)?;
            return Ok(Self::WithAxes(cia402, port, handle));
        }
        let buffer_bytes = size.clamp(LEAST_BUFFER, MOST_BUFFER);
        let sdo = SdoConfig { buffer_bytes, ..SdoConfig::default() };
        let mut network = Box::new(Network::new(NetworkConfig::default()));
        let config = NodeConfig { sdo, ..NodeConfig::default() };
        let handle = network.add_node(address, config).or_code(call)?;
        Ok(Self::Alone(bus.need_port(call)?, network, handle))
    }
}

/// Reads an object of a CANopen node and waits.
///
/// @param slave       Slave index of the gateway.
/// @param channel     Channel of the gateway, 0 to 3, enabled for classic CAN or CAN FD.
/// @param node_id     Node-ID, 1 to 127.
/// @param data        Gets the value, little endian.
/// @param size        Bytes of the buffer.
/// @param length      Gets the bytes of the value, even if it does not fit.
/// @param timeout_ms  Total time in milliseconds. A node that does not respond ends it after 1500.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the node aborted;
///          ECAN_ERR_TIMEOUT, ECAN_ERR_BUFFER, ECAN_ERR_CANOPEN, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL,
///          ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER; ECAN_ERR_ORDER if the bus is not active;
///          ECAN_ERR_NODE if there are axes on the Port and the node is not in their network;
///          ECAN_ERR_ATTACHED on a master of another owner.
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_sdo_upload(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    node_id: u8,
    index: u16,
    subindex: u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
    timeout_ms: u32,
) {
    pointers!(call, byte_room(data, size), out(length));
    let (object, timeout) = ((index, subindex), duration(timeout_ms));
    let value = match Peer::new(call, bus, (slave, channel, node_id), size)? {
        Peer::Alone(port, mut network, node) => {
            network.blocking(port, timeout).upload(node, object).or_code(call)
        }
        Peer::WithAxes(cia402, port, node) => {
            cia402.blocking(port, timeout).upload(node, object).or_code(call)
        }
    }?;
    put_value(call, &value, &mut data, &length)
}

/// Writes an object of a CANopen node and waits; as igh_canopen_sdo_upload().
///
/// @param data        The value, little endian, with as many bytes as the object has.
/// @param size        Its bytes.
/// @param timeout_ms  Total time in milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_canopen_sdo_upload().
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_sdo_download(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    node_id: u8,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
    timeout_ms: u32,
) {
    pointers!(call, bytes(data, size));
    let (object, timeout) = ((index, subindex), duration(timeout_ms));
    match Peer::new(call, bus, (slave, channel, node_id), size)? {
        Peer::Alone(port, mut network, node) => {
            network.blocking(port, timeout).download(node, object, data).or_code(call)
        }
        Peer::WithAxes(cia402, port, node) => {
            cia402.blocking(port, timeout).download(node, object, data).or_code(call)
        }
    }
}
