//! LSS: node-IDs and bit rates (CiA 305)

use ecan_c_boundary::pointers;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_canopen::{Lss, LssConfig, LssResult, Network, NetworkConfig};

use super::lss_terms::{
    igh_canopen_lss_address_t, igh_canopen_lss_command_t, igh_canopen_lss_result_t,
    igh_canopen_lss_service_t, igh_canopen_lss_state_t,
};
use crate::cia402::context::igh_cia402_context_t;
use crate::errors::{self, OrCode as _};
use crate::mcan_port::context::igh_mcan_port_t;
use crate::milliseconds::duration;

/// Fills a command: to the waiting state, no node-ID, all revision and serial numbers.
///
/// @param command  Is overwritten.
/// @param service  An igh_canopen_lss_service_t.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT for a number that is not a service.
#[export(call)]
pub fn igh_canopen_lss_init(command: *mut igh_canopen_lss_command_t, service: u8) {
    pointers!(call, out(command));
    if igh_canopen_lss_service_t::parse(service).is_none() {
        let text = format_args!("{service} is invalid; allowed: igh_canopen_lss_service_t");
        return Err(call.argument("service", text));
    }
    command.set(igh_canopen_lss_command_t {
        address: igh_canopen_lss_address_t::default(),
        revision_max: u32::MAX,
        serial_max: u32::MAX,
        bit_rate: 0,
        delay_ms: 0,
        service,
        node_id: igh_canopen_lss_command_t::NO_NODE_ID,
        configuration: 0,
        known: 0,
        reserved: [0; 30],
    });
}

/// Executes an LSS command and waits. Runs the cycle, with axes on the Port at their last targets;
/// without axes it drops other received frames.
///
/// @param slave       Slave index of the gateway.
/// @param channel     Channel of the gateway, 0 to 3, enabled.
/// @param command     Filled by igh_canopen_lss_init().
/// @param result      Gets the result; may be NULL.
/// @param timeout_ms  Total time in milliseconds. A fastscan takes four seconds with the default
///                    waiting times.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_TIMEOUT if no slave responded; ECAN_ERR_CANOPEN if the slave rejected
///          the command, with the reason in ecan_last_error(); ECAN_ERR_ORDER if another command is
///          running on the channel, or the bus is not active; ECAN_ERR_ARGUMENT, ECAN_ERR_SLAVE,
///          ECAN_ERR_CHANNEL, ECAN_ERR_NOT_READY, ECAN_ERR_MASTER; ECAN_ERR_ATTACHED on a master of
///          another owner, use igh_canopen_lss_start() there.
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_lss(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    command: *const igh_canopen_lss_command_t,
    result: *mut igh_canopen_lss_result_t,
    timeout_ms: u32,
) {
    pointers!(call, read(command), optional_out(result));
    let command = command.to_rust(call)?;
    bus.run_to_end(call)?;
    let (at, timeout) = ((slave, channel), duration(timeout_ms));
    bus.need_port(call)?.channel(slave, channel).or_code(call)?;
    let ended = if bus.axes_mut().is_some() {
        let (cia402, port) = bus.need_axes(call)?;
        cia402.network_mut().add_channel(slave, channel).or_code(call)?;
        cia402.lss_timeout(port, at, command, timeout).or_code(call)?
    } else {
        let mut network = Network::new(NetworkConfig::default());
        network.add_channel(slave, channel).or_code(call)?;
        network.blocking(bus.need_port(call)?, timeout).lss(at, command).or_code(call)?
    };
    if let Some(result) = result {
        result.set(ended.into());
    }
}

/// Adds a channel without nodes to the network, for igh_canopen_lss_start(). It gets neither SYNC nor
/// the host's heartbeat.
///
/// @param slave    Slave index of the gateway.
/// @param channel  Channel of the gateway, 0 to 3, enabled.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, also for a channel that the network has; ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
#[export(call, layer(cia402, port))]
pub fn igh_canopen_add_channel(context: *mut igh_cia402_context_t, slave: usize, channel: u8) {
    port.channel(slave, channel).or_code(call)?;
    cia402.network_mut().add_channel(slave, channel).or_code(call)
}

/// Starts an LSS command on a channel that has a node, or was added. igh_canopen_lss_poll() reports its
/// end in later cycles.
///
/// @param slave    Slave index of the gateway.
/// @param channel  Channel of the gateway.
/// @param command  Filled by igh_canopen_lss_init(). Is copied.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ORDER if another command is running on the channel; ECAN_ERR_CHANNEL
///          for a channel that the network does not have; ECAN_ERR_ARGUMENT.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_canopen_lss_start(
    context: *mut igh_cia402_context_t,
    slave: usize,
    channel: u8,
    command: *const igh_canopen_lss_command_t,
) {
    pointers!(call, read(command));
    let command = command.to_rust(call)?;
    cia402.network_mut().start_lss(slave, channel, command).or_code(call)
}

/// Gets the state of the LSS master of a channel.
///
/// @param state   Gets an igh_canopen_lss_state_t.
/// @param result  Gets the result of a command that is done, else zeros; may be NULL.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, also for a failed command, whose reason is in ecan_last_error() with the code in
///          ecan_last_error_code().
#[export(call, layer(cia402, _))]
pub fn igh_canopen_lss_poll(
    context: *mut igh_cia402_context_t,
    slave: usize,
    channel: u8,
    state: *mut u8,
    result: *mut igh_canopen_lss_result_t,
) {
    pointers!(call, out(state), optional_out(result));
    let found = cia402.network().lss_state(slave, channel);
    state.set(igh_canopen_lss_state_t::from(found) as u8);
    if let Some(result) = result {
        let done: Option<LssResult> = if let Lss::Done(done) = found { Some(done) } else { None };
        result.set(done.map_or_else(igh_canopen_lss_result_t::default, Into::into));
    }
    if let Some(failure) = cia402.network().lss_failure(slave, channel) {
        errors::note(call, &failure);
    }
}

/// Cancels the LSS command of a channel, if any. The state of the slaves is then unknown.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK.
#[export(_, layer(cia402, _))]
pub fn igh_canopen_lss_cancel(context: *mut igh_cia402_context_t, slave: usize, channel: u8) {
    cia402.network_mut().cancel_lss(slave, channel);
}

/// Sets the waiting times of the LSS master of a channel of the network, for igh_canopen_lss_start(),
/// and for igh_canopen_lss() with axes.
///
/// @param timeout_ms        Timeout for a response, and the waiting time of a search, in
///                          milliseconds. Default 500.
/// @param store_timeout_ms  Timeout for storing. Default 5000.
/// @param scan_ms           Waiting time of each request of a fastscan, within which all slaves must
///                          respond. Default 25.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_CHANNEL for a channel that the network does not have; ECAN_ERR_ARGUMENT
///          for a time of 0.
#[export(call, layer(cia402, _))]
pub fn igh_canopen_lss_set_times(
    context: *mut igh_cia402_context_t,
    slave: usize,
    channel: u8,
    timeout_ms: u32,
    store_timeout_ms: u32,
    scan_ms: u32,
) {
    let times =
        [("timeout_ms", timeout_ms), ("store_timeout_ms", store_timeout_ms), ("scan_ms", scan_ms)];
    for (name, ms) in times {
        if ms == 0 {
            return Err(call.argument(name, format_args!("is 0; must be at least 1")));
        }
    }
    if !cia402.network().has_channel(slave, channel) {
        let text = format_args!(
            "slave {slave} channel {channel} is not in the network; call igh_canopen_add_channel first"
        );
        return Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text));
    }
    let config = LssConfig {
        timeout: duration(timeout_ms),
        store_timeout: duration(store_timeout_ms),
        scan_time: duration(scan_ms),
    };
    cia402.network_mut().set_lss_config(slave, channel, config);
}
