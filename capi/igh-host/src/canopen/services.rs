//! Services for nodes: SDO transfers in the cycle, TIME, guarding, store and restore, multiplexed PDOs.

use std::ffi::c_void;
use std::time::Duration;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{
    GuardingConfig, Mpdo, MpdoAddress, NodeId, ParameterGroup, Step, TimeConfig, TimeReference,
    object,
};

use crate::bus::Bus;
use crate::callback::duration;
use crate::cia402::context::{igh_cia402_context_t, need_node};
use crate::cia402::sdo::{igh_cia402_sdo_state_t, poll, started};
use crate::errors::OrCode as _;
use crate::handle::Entered;

// Section: TIME, guarding, store and restore
//
// The calls with a timeout run the cycle, with the axes at their last targets. On a master of another owner
// write the objects with igh_canopen_sdo_start_download(): 0x100C and 0x100D for guarding, 0x1010 with "save",
// 0x1011 with "load".

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
    cia402.blocking(port, timeout).execute(handle, steps).or_code(call)?;
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

// Section: SDO transfers with nodes in the cycle
//
// For every node of the network. A node has one SDO server: while it boots, or its axis is configured,
// changes its mode or is homing, a transfer of the application waits. igh_canopen_sdo_upload() and
// igh_canopen_sdo_download() also wait for the end.

/// Starts reading an object of a node; igh_canopen_sdo_poll() gets the result in later cycles.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE while another transfer with the node is in progress;
///          ECAN_ERR_NODE.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_canopen_sdo_start_upload(
    context: *mut igh_cia402_context_t,
    node: usize,
    index: u16,
    subindex: u8,
) {
    let handle = need_node(call, cia402, node)?;
    started(call, cia402.network_mut().start_upload(handle, index, subindex))
}

/// Starts writing an object of a node, as igh_canopen_sdo_start_upload().
///
/// @param data  The value, little endian, with as many bytes as the object has. Is copied.
/// @param size  Its bytes.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_canopen_sdo_start_upload(); ECAN_ERR_CANOPEN for a value that is longer than
///          igh_cia402_settings_t.sdo_buffer_bytes.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_canopen_sdo_start_download(
    context: *mut igh_cia402_context_t,
    node: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    let handle = need_node(call, cia402, node)?;
    started(call, cia402.network_mut().start_download(handle, index, subindex, data))
}

/// Gets the state of the last transfer with a node, as igh_cia402_sdo_poll().
///
/// @param state   Gets an igh_cia402_sdo_state_t.
/// @param data    Gets the value of a finished upload, little endian; may be NULL with size 0.
/// @param size    Bytes of the buffer.
/// @param length  Gets the bytes of the value, even if it does not fit; 0 while there is none.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, also for a failed transfer, whose reason is in ecan_last_error() and
///          ecan_last_abort_code(); ECAN_ERR_BUFFER, ECAN_ERR_NODE.
#[export(call, layer(cia402, _))]
pub fn igh_canopen_sdo_poll(
    context: *mut igh_cia402_context_t,
    node: usize,
    state: *mut u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) {
    pointers!(call, out(state), byte_room(data, size), out(length));
    length.set(0);
    state.set(igh_cia402_sdo_state_t::IGH_CIA402_SDO_IDLE as u8);
    let handle = need_node(call, cia402, node)?;
    poll(call, cia402.network(), handle, &state, &mut data, &length)
}

// Section: Multiplexed PDOs (CiA 301, 7.2.2.4)
//
// One object per frame, addressed in the frame. Send the bytes by igh_mcan_port_send_can() with the COB-ID
// of the RPDO, and read those of igh_cia402_process_rx_ex() or igh_mcan_port_receive().

/// Bytes of an MPDO.
pub const IGH_CANOPEN_MPDO_BYTES: usize = 8;

mirror! {
    /// A multiplexed PDO.
    #[derive(PartialEq, Eq)]
    pub struct igh_canopen_mpdo_t from rust: Mpdo {
        /// Index of the object.
        index: u16,
        /// Subindex of the object.
        subindex: u8,
        /// 1: source address mode, an object of the producer `node_id`. 0: destination address mode,
        /// an object of the consumer.
        is_source: u8 = matches!(rust.address, MpdoAddress::Source(_)).into(),
        /// Node-ID, 1 to 127; 0 in destination address mode for all consumers.
        node_id: u8 = match rust.address {
            MpdoAddress::Source(node) | MpdoAddress::Destination(Some(node)) => node.get(),
            MpdoAddress::Destination(None) => 0,
        },
        /// Must be 0; for fields of later versions.
        reserved: [u8; 7] = [0; 7],
        /// Value, little endian; bytes beyond the length of the object have no meaning.
        data: [u8; 4],
    }
}

impl igh_canopen_mpdo_t {
    fn to_rust(self, call: Call) -> Result<Mpdo, ecan_result_t> {
        call.reserved("mpdo", &self.reserved)?;
        let node = NodeId::from_raw(self.node_id);
        let address = match (self.is_source, node) {
            (0, None) if self.node_id == 0 => MpdoAddress::Destination(None),
            (0, Some(node)) => MpdoAddress::Destination(Some(node)),
            (1, Some(node)) => MpdoAddress::Source(node),
            (0 | 1, None) => {
                let text = format_args!(
                    "{} is out of range; allowed: 1 to 127, or 0 with is_source 0",
                    self.node_id
                );
                return Err(call.argument("node_id", text));
            }
            (value, _) => {
                let text = format_args!("{value} is out of range; allowed: 0, 1");
                return Err(call.argument("is_source", text));
            }
        };
        Ok(Mpdo { address, index: self.index, subindex: self.subindex, data: self.data })
    }
}

/// Encodes an MPDO.
///
/// @param mpdo  The MPDO.
/// @param data  Gets IGH_CANOPEN_MPDO_BYTES bytes, the data of the CAN frame.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT for a node-ID out of range.
#[export(call)]
pub fn igh_canopen_mpdo_encode(mpdo: *const igh_canopen_mpdo_t, data: *mut u8) {
    pointers!(call, read(mpdo));
    let data: *mut [u8; IGH_CANOPEN_MPDO_BYTES] = data.cast();
    pointers!(call, out(data));
    data.set(mpdo.to_rust(call)?.to_bytes());
}

/// Decodes an MPDO.
///
/// @param mpdo    Gets the MPDO.
/// @param data    Data of a CAN frame.
/// @param length  Its bytes.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_FRAME for data that are not an MPDO.
#[export(call)]
pub fn igh_canopen_mpdo_decode(mpdo: *mut igh_canopen_mpdo_t, data: *const u8, length: usize) {
    pointers!(call, out(mpdo), items(data, length));
    let found = Mpdo::parse(data)
        .map_err(|error| call.fail(ecan_result_t::ECAN_ERR_FRAME, format_args!("{error}")))?;
    mpdo.set(found.into());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The result of a conversion, and nothing after an error.
    fn converted<T>(convert: impl FnOnce(Call) -> Result<T, ecan_result_t>) -> Option<T> {
        let mut value = None;
        ecan_c_boundary::call("test", |call| {
            value = Some(convert(call)?);
            Ok(())
        });
        value
    }

    #[test]
    fn groups_from_4_on_are_the_manufacturers() {
        let of = |number| converted(|call| group(call, number));
        assert_eq!([1, 3].map(of), [Some(ParameterGroup::All), Some(ParameterGroup::Application)]);
        let manufacturer = |number| Some(ParameterGroup::Manufacturer(number));
        assert_eq!([4, 127].map(of), [4, 127].map(manufacturer));
        assert_eq!([0, 128].map(of), [None, None]);
    }

    #[test]
    fn mpdo_without_node_is_for_all_consumers() {
        let consumers = Mpdo {
            index: 0x2000,
            subindex: 1,
            address: MpdoAddress::Destination(None),
            data: [1, 2, 3, 4],
        };
        let of = |node_id, is_source| {
            let mpdo = igh_canopen_mpdo_t { node_id, is_source, ..consumers.into() };
            converted(|call| mpdo.to_rust(call)).map(|mpdo| mpdo.address)
        };
        assert_eq!(of(0, 0), Some(MpdoAddress::Destination(None)));
        assert_eq!(of(5, 0), Some(MpdoAddress::Destination(NodeId::from_raw(5))));
        assert_eq!(of(5, 1), NodeId::from_raw(5).map(MpdoAddress::Source));
        assert_eq!([of(0, 1), of(128, 0), of(5, 2)], [None; 3]);
    }
}
