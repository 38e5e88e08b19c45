//! TIME, guarding, store and restore
//!
//! The calls with a timeout run the cycle, with the axes at their last targets. On a master of another owner
//! write the objects with igh_canopen_sdo_start_download(): 0x100C and 0x100D for guarding, 0x1010 with "save",
//! 0x1011 with "load".

use std::time::Duration;

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_canopen::{GuardingConfig, ParameterGroup, Step, TimeConfig, TimeReference, object};

use super::lookup::need_node;
use crate::bus::Bus;
use crate::cia402::context::igh_cia402_context_t;
use crate::errors::OrCode as _;
use crate::handle::Entered;
use crate::milliseconds::duration;

/// Group of parameters in igh_canopen_store_parameters() and igh_canopen_restore_parameters(): subindex of
/// 0x1010 and 0x1011. Subindices from 4 to 127 are the manufacturer's.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_canopen_parameters_t {
    /// All parameters.
    IGH_CANOPEN_PARAMETERS_ALL = 1,
    /// Communication parameters, 0x1000 to 0x1FFF.
    IGH_CANOPEN_PARAMETERS_COMMUNICATION = 2,
    /// Application parameters, 0x6000 to 0x9FFF.
    IGH_CANOPEN_PARAMETERS_APPLICATION = 3,
}

fn group(call: Call, number: u8) -> Result<ParameterGroup, ecan_result_t> {
    Ok(match number {
        1 => ParameterGroup::All,
        2 => ParameterGroup::Communication,
        3 => ParameterGroup::Application,
        4..=127 => ParameterGroup::Manufacturer(number),
        _ => {
            let text = format_args!("{number} is out of range; allowed: 1 to 127");
            return Err(call.argument("group", text));
        }
    })
}

/// Executes steps on a node.
fn execute(
    call: Call,
    bus: &mut Entered<Bus>,
    node: usize,
    steps: impl IntoIterator<Item = Step>,
    timeout: Duration,
) -> Result<(), ecan_result_t> {
    bus.run_to_end(call)?;
    let (cia402, port) = bus.need_axes(call)?;
    let handle = need_node(call, cia402, node)?;
    cia402.execute_timeout(port, handle, steps, timeout).or_code(call)?;
    Ok(())
}

/// Starts, changes or stops the production of TIME on every channel that has a node. Nodes that consume
/// it have bit 31 in 0x1012. The bus clock continues the time: call it again to follow adjustments of the
/// system clock.
///
/// @param period_ms  Time between two messages, in milliseconds; 0 stops.
/// @param unix_ns    Present Unix time in nanoseconds, from 1984 to 2163; 0 for that of the system
///                   clock.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT for a time out of range.
#[export(call, layer(cia402, port))]
pub fn igh_canopen_set_time(context: *mut igh_cia402_context_t, period_ms: u32, unix_ns: u64) {
    let bus_ns = port.adapter().clock().now_ns();
    let reference = match unix_ns {
        0 => TimeReference::from_system_clock(bus_ns),
        unix_ns => TimeReference { unix_ns, bus_ns },
    };
    let period = duration(period_ms);
    let config = (period_ms != 0).then_some(TimeConfig { period, reference });
    cia402.network_mut().set_time(config).or_code(call)
}

/// Guards a node in place of its heartbeat: writes 0x1017 = 0, 0x100C and 0x100D, and requests its NMT
/// state from then on. The node detects by the requests that the host runs. With both values 0 it ends
/// guarding in node and host. igh_canopen_get_node_state() reports the result.
///
/// @param guard_time_ms     Time between two requests in milliseconds, 1 to 65535; 0 to end.
/// @param life_time_factor  Host and node react after this multiple of the guard time, 1 to 255; 0 to end.
/// @param timeout_ms        Timeout for the writes, in milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_CANOPEN or ECAN_ERR_SDO if the node rejects an object; ECAN_ERR_TIMEOUT,
///          ECAN_ERR_ARGUMENT, ECAN_ERR_NODE; ECAN_ERR_ORDER if the bus is not active;
///          ECAN_ERR_ATTACHED on a master of another owner.
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_set_guarding(
    context: *mut igh_cia402_context_t,
    node: usize,
    guard_time_ms: u16,
    life_time_factor: u8,
    timeout_ms: u32,
) {
    let timeout = duration(timeout_ms);
    if (guard_time_ms, life_time_factor) == (0, 0) {
        let steps = [
            Step::write(object::LIFE_TIME_FACTOR, 0, 0_u8).named("life time factor"),
            Step::write(object::GUARD_TIME, 0, 0_u16).named("guard time"),
        ];
        execute(call, bus, node, steps, timeout)?;
        let (cia402, _) = bus.need_axes(call)?;
        let handle = need_node(call, cia402, node)?;
        return cia402.network_mut().set_guarding(handle, None).or_code(call);
    }
    for (name, value) in
        [("guard_time_ms", guard_time_ms), ("life_time_factor", life_time_factor.into())]
    {
        if value == 0 {
            let text = format_args!("is 0; must be at least 1, or both 0 to end guarding");
            return Err(call.argument(name, text));
        }
    }
    let guarding = GuardingConfig { guard_time: duration(guard_time_ms.into()), life_time_factor };
    execute(call, bus, node, guarding.steps(), timeout)?;
    let (cia402, _) = bus.need_axes(call)?;
    let handle = need_node(call, cia402, node)?;
    cia402.network_mut().set_guarding(handle, Some(guarding)).or_code(call)
}

/// Stores the present parameters of a node in its memory (0x1010), if it can do that on command.
///
/// @param group       An igh_canopen_parameters_t, or a subindex of the manufacturer, 4 to 127.
/// @param timeout_ms  Milliseconds. A node may need seconds to write its memory.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_CANOPEN or ECAN_ERR_SDO if the node cannot or does not store;
///          otherwise as igh_canopen_set_guarding().
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_store_parameters(
    context: *mut igh_cia402_context_t,
    node: usize,
    group: u8,
    timeout_ms: u32,
) {
    let steps = self::group(call, group)?.store_steps();
    execute(call, bus, node, steps, duration(timeout_ms))
}

/// Restores the default parameters of a node (0x1011), if it can do that on command. They become valid
/// with its next reset: igh_canopen_send_nmt(), or igh_canopen_boot_again() for a node that boots.
///
/// @param group       An igh_canopen_parameters_t, or a subindex of the manufacturer, 4 to 127.
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_canopen_store_parameters().
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_restore_parameters(
    context: *mut igh_cia402_context_t,
    node: usize,
    group: u8,
    timeout_ms: u32,
) {
    let steps = self::group(call, group)?.restore_steps();
    execute(call, bus, node, steps, duration(timeout_ms))
}
