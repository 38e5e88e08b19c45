//! SDO transfers with any CANopen node
//!
//! For tools, and for the startup of devices. Each call runs the cycle, with axes on the Port at their last
//! targets; it drops other received frames. With axes, the node must be in their network, as drive, as
//! node of its file, or by igh_canopen_add_node().

use std::ffi::c_void;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_canopen::{Network, NetworkConfig, NodeAddress, NodeConfig, NodeHandle, SdoConfig};
use ecan_cia402::Cia402;
use ecan_mcan_port::Port;

use super::sdo::put_value;
use crate::bus::Bus;
use crate::canopen::lookup;
use crate::errors::OrCode as _;
use crate::handle::Entered;
use crate::mcan_port::context::igh_mcan_port_t;
use crate::mcan_port::state::find_channel;
use crate::milliseconds::duration;

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
        let address = NodeAddress { slave, channel, node: lookup::node_id(call, node_id)? };
        if bus.axes_mut().is_some() {
            let (cia402, port) = bus.need_axes(call)?;
            let (_, handle) = lookup::find(call, cia402, address)?;
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
            network.upload_blocking(port, node, object, timeout).or_code(call)
        }
        Peer::WithAxes(cia402, port, node) => {
            cia402.upload_node_timeout(port, node, object, timeout).or_code(call)
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
            network.download_blocking(port, node, object, data, timeout).or_code(call)
        }
        Peer::WithAxes(cia402, port, node) => {
            cia402.download_node_timeout(port, node, object, data, timeout).or_code(call)
        }
    }
}
