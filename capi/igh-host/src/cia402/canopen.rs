//! SDO transfers with any CANopen node
//!
//! For programs without axes: tools, startup of other devices. Each call runs the cycle and drops
//! other received frames.

use std::ffi::c_void;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_canopen::{
    Network, NetworkConfig, NodeAddress, NodeConfig, NodeHandle, NodeId, SdoConfig,
};
use ecan_mcan_port::Port;

use super::sdo::put_value;
use crate::bus::Bus;
use crate::errors::OrCode as _;
use crate::handle::Entered;
use crate::mcan_port::context::igh_mcan_port_t;
use crate::mcan_port::state::find_channel;
use crate::milliseconds::duration;

/// Limits of a transfer's buffer.
const LEAST_BUFFER: usize = 1024;
const MOST_BUFFER: usize = 1 << 24;

fn network(
    call: Call,
    bus: &mut Entered<Bus>,
    (slave, channel, node_id): (usize, u8, u8),
    size: usize,
) -> Result<(&mut Port, Network, NodeHandle), ecan_result_t> {
    bus.run_to_end(call)?;
    if bus.axes_mut().is_some() {
        let text = format_args!(
            "there are axes on this Port: transfer with igh_cia402_sdo_upload or _download"
        );
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    let port = bus.need_port(call)?;
    find_channel(call, port, slave, channel)?;
    let node = NodeId::new(node_id).ok_or_else(|| {
        call.argument("node_id", format_args!("{node_id} is out of range; allowed: 1 to 127"))
    })?;
    let buffer_bytes = size.clamp(LEAST_BUFFER, MOST_BUFFER);
    let sdo = SdoConfig { buffer_bytes, ..SdoConfig::default() };
    let mut network = Network::new(NetworkConfig::default());
    let added = network.add_node(
        NodeAddress { slave, channel, node },
        NodeConfig { sdo, ..NodeConfig::default() },
    );
    match added {
        Ok(handle) => Ok((port, network, handle)),
        Err(error) => Err(call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, format_args!("{error}"))),
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
///          ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER; ECAN_ERR_ORDER if the bus is not active, or there
///          are axes on the Port: use igh_cia402_sdo_upload() then; ECAN_ERR_ATTACHED on a master
///          of another owner.
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
    let (port, mut network, node) = network(call, bus, (slave, channel, node_id), size)?;
    let value = network
        .upload_blocking(port, node, (index, subindex), duration(timeout_ms))
        .or_code(call)?;
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
    let (port, mut network, node) = network(call, bus, (slave, channel, node_id), size)?;
    network
        .download_blocking(port, node, (index, subindex), data, duration(timeout_ms))
        .or_code(call)
}
