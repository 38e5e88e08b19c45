//! Nodes of the network of a context.

use std::time::Duration;

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
use ecan_canopen::{NodeAddress, NodeConfig, NodeDescription, NodeHandle, NodeId};
use ecan_cia402::Cia402;
use ecan_mcan_port::Port;

use crate::errors::OrCode as _;

/// The handle of a node.
pub(super) fn need_node(
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
pub(crate) fn node_id(call: Call, id: u8) -> Result<NodeId, ecan_result_t> {
    NodeId::new(id).ok_or_else(|| {
        call.argument("node_id", format_args!("{id} is out of range; allowed: 1 to 127"))
    })
}

/// Adds a node without a boot-up.
pub(super) fn add(
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
pub(crate) fn add_described(
    call: Call,
    port: &Port,
    cia402: &mut Cia402,
    node: &NodeDescription,
    config: NodeConfig,
) -> Result<(), ecan_result_t> {
    let boot = node.boot_config().map_err(|error| {
        call.fail(ecan_result_t::ECAN_ERR_CONFIG, format_args!("{}: {error}", node.title()))
    })?;
    let handle = add(call, port, cia402, node.address, config)?;
    cia402.network_mut().boot(handle, boot);
    Ok(())
}

/// The index and the handle of the node at an address.
pub(crate) fn find(
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
