//! LSS: node-IDs and bit rates (CiA 305)
//!
//! Each channel of the network has one LSS master. igh_canopen_lss() executes a command and waits;
//! igh_canopen_lss_start() begins one, and the cycle continues it. The services that configure or read a
//! slave need it in the configuration state, and no other slave with it.
//!
//! ```c
//! igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_FASTSCAN);          a slave without node-ID
//! igh_canopen_lss(&mcan, 0, 0, &lss, &found, 30000);
//! igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_CONFIGURE_NODE_ID);
//! lss.node_id = 5;
//! igh_canopen_lss(&mcan, 0, 0, &lss, NULL, 1000);
//! igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_SWITCH_GLOBAL);     it boots as node 5
//! igh_canopen_lss(&mcan, 0, 0, &lss, NULL, 1000);
//! ```

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{
    FastscanFilter, Lss, LssAddress, LssAddressRange, LssBitRate, LssCommand, LssConfig, LssResult,
    Network, NetworkConfig, NodeId,
};

use crate::callback::duration;
use crate::cia402::context::igh_cia402_context_t;
use crate::errors;
use crate::errors::OrCode as _;
use crate::mcan_port::context::igh_mcan_port_t;

/// Service of an LSS command.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_canopen_lss_service_t {
    /// Switches all slaves to the configuration state, or with `configuration` 0 to the waiting
    /// state. No slave responds. A slave that got a node-ID boots when it returns to the waiting
    /// state.
    IGH_CANOPEN_LSS_SWITCH_GLOBAL = 1,
    /// Switches the slave with this address to the configuration state.
    IGH_CANOPEN_LSS_SWITCH_SELECTIVE = 2,
    /// Configures the node-ID; 255 removes it. A slave that has one uses the new one after the NMT
    /// command Reset communication.
    IGH_CANOPEN_LSS_CONFIGURE_NODE_ID = 3,
    /// Configures the bit rate, which IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE activates.
    IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE = 4,
    /// Activates the configured bit rates of all slaves in the configuration state after delay_ms.
    /// They are silent for the same time again, and the command ends after both. The channel of
    /// the gateway needs the new bit rate then.
    IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE = 5,
    /// Stores node-ID and bit rate in the slave.
    IGH_CANOPEN_LSS_STORE = 6,
    /// Reads the address.
    IGH_CANOPEN_LSS_INQUIRE_ADDRESS = 7,
    /// Reads the node-ID.
    IGH_CANOPEN_LSS_INQUIRE_NODE_ID = 8,
    /// Searches slaves with this vendor-ID and product code, and numbers from those of the address
    /// to revision_max and serial_max.
    IGH_CANOPEN_LSS_IDENTIFY = 9,
    /// Searches slaves without node-ID.
    IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED = 10,
    /// Searches the lowest address among the slaves without node-ID, and switches that slave to
    /// the configuration state. `known` names the parts of the address that are known.
    IGH_CANOPEN_LSS_FASTSCAN = 11,
}

/// Parts of an address that a fastscan need not search, in igh_canopen_lss_command_t.known.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_canopen_lss_known_t {
    /// Vendor-ID.
    IGH_CANOPEN_LSS_KNOWN_VENDOR_ID = 1,
    /// Product code.
    IGH_CANOPEN_LSS_KNOWN_PRODUCT_CODE = 2,
    /// Revision number.
    IGH_CANOPEN_LSS_KNOWN_REVISION_NUMBER = 4,
    /// Serial number.
    IGH_CANOPEN_LSS_KNOWN_SERIAL_NUMBER = 8,
}

mirror! {
    /// LSS address of a slave: its identity object 0x1018.
    #[derive(Default, PartialEq, Eq)]
    pub struct igh_canopen_lss_address_t from rust: LssAddress {
        /// Vendor-ID, 0x1018:01.
        vendor_id: u32 = rust.vendor,
        /// Product code, 0x1018:02.
        product_code: u32 = rust.product,
        /// Revision number, 0x1018:03.
        revision_number: u32 = rust.revision,
        /// Serial number, 0x1018:04.
        serial_number: u32 = rust.serial,
    }
}

/// An LSS command. igh_canopen_lss_init() fills it; change fields after it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_canopen_lss_command_t {
    /// Address of the slave; for IDENTIFY with the lowest revision and serial number, for FASTSCAN the
    /// parts in `known`.
    pub address: igh_canopen_lss_address_t,
    /// Highest revision number of IDENTIFY. Default 0xFFFFFFFF.
    pub revision_max: u32,
    /// Highest serial number of IDENTIFY. Default 0xFFFFFFFF.
    pub serial_max: u32,
    /// Bit rate of CONFIGURE_BIT_RATE in bit/s: 1000000, 800000, 500000, 250000, 125000, 50000, 20000
    /// or 10000; 0 for automatic detection.
    pub bit_rate: u32,
    /// Delay of ACTIVATE_BIT_RATE in milliseconds.
    pub delay_ms: u16,
    /// An igh_canopen_lss_service_t.
    pub service: u8,
    /// Node-ID of CONFIGURE_NODE_ID, 1 to 127; 255 for none. Default 255.
    pub node_id: u8,
    /// 1: SWITCH_GLOBAL switches to the configuration state. Default 0.
    pub configuration: u8,
    /// Sum of igh_canopen_lss_known_t. Default 0.
    pub known: u8,
    /// Must be 0; for fields of later versions.
    pub reserved: [u8; 30],
}

mirror! {
    /// State of the LSS master of a channel.
    pub enum igh_canopen_lss_state_t from Lss {
        /// No command was started yet.
        IGH_CANOPEN_LSS_IDLE = 0 => Lss::Idle,
        /// A command is running.
        IGH_CANOPEN_LSS_RUNNING = 1 => Lss::Busy,
        /// The last command is done.
        IGH_CANOPEN_LSS_DONE = 2 => Lss::Done(_),
        /// The last command failed.
        IGH_CANOPEN_LSS_FAILED = 3 => Lss::Failed(_),
    }
}

mirror! {
    /// Kind of the result of an LSS command.
    pub enum igh_canopen_lss_outcome_t from Option<LssResult> {
        /// There is none.
        IGH_CANOPEN_LSS_OUTCOME_NONE = 0 => None,
        /// The command was sent, or the slave confirmed it.
        IGH_CANOPEN_LSS_OUTCOME_DONE = 1 => Some(LssResult::Done),
        /// `address` is that of the slave: INQUIRE_ADDRESS, FASTSCAN.
        IGH_CANOPEN_LSS_OUTCOME_ADDRESS = 2 => Some(LssResult::Address(_)),
        /// `node_id` is that of the slave: INQUIRE_NODE_ID.
        IGH_CANOPEN_LSS_OUTCOME_NODE_ID = 3 => Some(LssResult::NodeId(_)),
        /// At least one slave responded to a search.
        IGH_CANOPEN_LSS_OUTCOME_FOUND = 4 => Some(LssResult::Found),
        /// No slave responded to a search.
        IGH_CANOPEN_LSS_OUTCOME_NOT_FOUND = 5 => Some(LssResult::NotFound),
    }
}

/// Result of an LSS command.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct igh_canopen_lss_result_t {
    /// Address, if `outcome` is IGH_CANOPEN_LSS_OUTCOME_ADDRESS.
    pub address: igh_canopen_lss_address_t,
    /// An igh_canopen_lss_outcome_t.
    pub outcome: u8,
    /// Node-ID, if `outcome` is IGH_CANOPEN_LSS_OUTCOME_NODE_ID; 255 if the slave has none.
    pub node_id: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 14],
}

impl From<LssResult> for igh_canopen_lss_result_t {
    fn from(result: LssResult) -> Self {
        let outcome = igh_canopen_lss_outcome_t::from(Some(result)) as u8;
        let mut this = Self { outcome, ..Self::default() };
        match result {
            LssResult::Address(address) => this.address = address.into(),
            LssResult::NodeId(node) => {
                this.node_id = node.map_or(igh_canopen_lss_command_t::NO_NODE_ID, NodeId::get);
            }
            LssResult::Done | LssResult::Found | LssResult::NotFound => {}
        }
        this
    }
}

impl igh_canopen_lss_address_t {
    fn to_rust(self) -> LssAddress {
        LssAddress {
            vendor: self.vendor_id,
            product: self.product_code,
            revision: self.revision_number,
            serial: self.serial_number,
        }
    }
}

impl igh_canopen_lss_service_t {
    /// The service with a number that C passes.
    pub(super) fn parse(number: u8) -> Option<Self> {
        use igh_canopen_lss_service_t::*;
        let all = [
            IGH_CANOPEN_LSS_SWITCH_GLOBAL,
            IGH_CANOPEN_LSS_SWITCH_SELECTIVE,
            IGH_CANOPEN_LSS_CONFIGURE_NODE_ID,
            IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE,
            IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE,
            IGH_CANOPEN_LSS_STORE,
            IGH_CANOPEN_LSS_INQUIRE_ADDRESS,
            IGH_CANOPEN_LSS_INQUIRE_NODE_ID,
            IGH_CANOPEN_LSS_IDENTIFY,
            IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED,
            IGH_CANOPEN_LSS_FASTSCAN,
        ];
        all.into_iter().find(|service| *service as u8 == number)
    }
}

impl igh_canopen_lss_command_t {
    pub(super) const NO_NODE_ID: u8 = 255;

    pub(super) fn to_rust(self, call: Call) -> Result<LssCommand, ecan_result_t> {
        call.reserved("command", &self.reserved)?;
        use igh_canopen_lss_service_t::*;
        let service = igh_canopen_lss_service_t::parse(self.service).ok_or_else(|| {
            let text = format_args!("{} is invalid; call igh_canopen_lss_init first", self.service);
            call.argument("service", text)
        })?;
        Ok(match service {
            IGH_CANOPEN_LSS_SWITCH_GLOBAL => {
                LssCommand::SwitchGlobal { configuration: self.configuration != 0 }
            }
            IGH_CANOPEN_LSS_SWITCH_SELECTIVE => LssCommand::SwitchSelective(self.address.to_rust()),
            IGH_CANOPEN_LSS_CONFIGURE_NODE_ID => {
                LssCommand::ConfigureNodeId(self.checked_node_id(call)?)
            }
            IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE => {
                LssCommand::ConfigureBitRate(self.checked_bit_rate(call)?)
            }
            IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE => {
                LssCommand::ActivateBitRate { delay_ms: self.delay_ms }
            }
            IGH_CANOPEN_LSS_STORE => LssCommand::Store,
            IGH_CANOPEN_LSS_INQUIRE_ADDRESS => LssCommand::InquireAddress,
            IGH_CANOPEN_LSS_INQUIRE_NODE_ID => LssCommand::InquireNodeId,
            IGH_CANOPEN_LSS_IDENTIFY => LssCommand::Identify(LssAddressRange {
                vendor: self.address.vendor_id,
                product: self.address.product_code,
                revision: (self.address.revision_number, self.revision_max),
                serial: (self.address.serial_number, self.serial_max),
            }),
            IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED => LssCommand::IdentifyNonConfigured,
            IGH_CANOPEN_LSS_FASTSCAN => LssCommand::Fastscan(self.filter(call)?),
        })
    }

    fn checked_node_id(&self, call: Call) -> Result<Option<NodeId>, ecan_result_t> {
        if self.node_id == Self::NO_NODE_ID {
            return Ok(None);
        }
        NodeId::from_raw(self.node_id).map(Some).ok_or_else(|| {
            let text = format_args!("{} is out of range; allowed: 1 to 127, or 255", self.node_id);
            call.argument("node_id", text)
        })
    }

    fn checked_bit_rate(&self, call: Call) -> Result<LssBitRate, ecan_result_t> {
        if self.bit_rate == 0 {
            return Ok(LssBitRate::Automatic);
        }
        LssBitRate::from_bit_per_s(self.bit_rate).ok_or_else(|| {
            let text = format_args!(
                "{} bit/s is not in the table of CiA 305; allowed: 1000000, 800000, 500000, 250000, \
                 125000, 50000, 20000, 10000, or 0",
                self.bit_rate
            );
            call.argument("bit_rate", text)
        })
    }

    fn filter(&self, call: Call) -> Result<FastscanFilter, ecan_result_t> {
        use igh_canopen_lss_known_t::*;
        const ALL: u8 = IGH_CANOPEN_LSS_KNOWN_VENDOR_ID as u8
            | IGH_CANOPEN_LSS_KNOWN_PRODUCT_CODE as u8
            | IGH_CANOPEN_LSS_KNOWN_REVISION_NUMBER as u8
            | IGH_CANOPEN_LSS_KNOWN_SERIAL_NUMBER as u8;
        if self.known & !ALL != 0 {
            let text = format_args!("{} is out of range; allowed: 0 to {ALL}", self.known);
            return Err(call.argument("known", text));
        }
        let known = |part: igh_canopen_lss_known_t, value: u32| {
            (self.known & part as u8 != 0).then_some(value)
        };
        Ok(FastscanFilter {
            vendor: known(IGH_CANOPEN_LSS_KNOWN_VENDOR_ID, self.address.vendor_id),
            product: known(IGH_CANOPEN_LSS_KNOWN_PRODUCT_CODE, self.address.product_code),
            revision: known(IGH_CANOPEN_LSS_KNOWN_REVISION_NUMBER, self.address.revision_number),
            serial: known(IGH_CANOPEN_LSS_KNOWN_SERIAL_NUMBER, self.address.serial_number),
        })
    }
}

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
        cia402.blocking(port, timeout).lss(at, command).or_code(call)?
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

#[cfg(test)]
mod tests {
    use ecan_c_boundary::call;

    use super::{igh_canopen_lss_init, *};

    fn command(service: igh_canopen_lss_service_t) -> igh_canopen_lss_command_t {
        let mut command = std::mem::MaybeUninit::uninit();
        // SAFETY: the pointer is valid for writing.
        assert_eq!(unsafe { igh_canopen_lss_init(command.as_mut_ptr(), service as u8) }, 0);
        // SAFETY: filled by the call above.
        unsafe { command.assume_init() }
    }

    fn to_rust(command: igh_canopen_lss_command_t) -> Result<LssCommand, i32> {
        let mut rust = None;
        let code = call("to_rust", |call| {
            rust = Some(command.to_rust(call)?);
            Ok(())
        });
        rust.ok_or(code)
    }

    #[test]
    fn every_service_becomes_its_command() {
        use igh_canopen_lss_service_t::*;
        let address = LssAddress { vendor: 0x100, product: 2, revision: 3, serial: 0x8000_0001 };
        let with_address = |service| {
            let mut command = command(service);
            command.address = address.into();
            to_rust(command)
        };
        let range = LssAddressRange {
            vendor: 0x100,
            product: 2,
            revision: (3, u32::MAX),
            serial: (0x8000_0001, u32::MAX),
        };
        for (service, expected) in [
            (IGH_CANOPEN_LSS_SWITCH_GLOBAL, LssCommand::SwitchGlobal { configuration: false }),
            (IGH_CANOPEN_LSS_SWITCH_SELECTIVE, LssCommand::SwitchSelective(address)),
            (IGH_CANOPEN_LSS_CONFIGURE_NODE_ID, LssCommand::ConfigureNodeId(None)),
            (
                IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE,
                LssCommand::ConfigureBitRate(LssBitRate::Automatic),
            ),
            (IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE, LssCommand::ActivateBitRate { delay_ms: 0 }),
            (IGH_CANOPEN_LSS_STORE, LssCommand::Store),
            (IGH_CANOPEN_LSS_INQUIRE_ADDRESS, LssCommand::InquireAddress),
            (IGH_CANOPEN_LSS_INQUIRE_NODE_ID, LssCommand::InquireNodeId),
            (IGH_CANOPEN_LSS_IDENTIFY, LssCommand::Identify(range)),
            (IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED, LssCommand::IdentifyNonConfigured),
            (IGH_CANOPEN_LSS_FASTSCAN, LssCommand::Fastscan(FastscanFilter::default())),
        ] {
            assert_eq!(with_address(service), Ok(expected));
        }
        let mut scan = command(IGH_CANOPEN_LSS_FASTSCAN);
        (scan.address, scan.known) = (address.into(), 1 | 8);
        let filter = FastscanFilter {
            vendor: Some(0x100),
            serial: Some(0x8000_0001),
            ..FastscanFilter::default()
        };
        assert_eq!(to_rust(scan), Ok(LssCommand::Fastscan(filter)));
        let mut global = command(IGH_CANOPEN_LSS_SWITCH_GLOBAL);
        global.configuration = 1;
        assert_eq!(to_rust(global), Ok(LssCommand::SwitchGlobal { configuration: true }));
    }

    #[test]
    fn invalid_commands_are_rejected() {
        use igh_canopen_lss_service_t::*;
        let rejected = Err(ecan_result_t::ECAN_ERR_ARGUMENT.code());
        let mut node_id = command(IGH_CANOPEN_LSS_CONFIGURE_NODE_ID);
        for id in [0, 128, 254] {
            node_id.node_id = id;
            assert_eq!(to_rust(node_id), rejected);
        }
        let mut bit_rate = command(IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE);
        for value in [1, 100_000, u32::MAX] {
            bit_rate.bit_rate = value;
            assert_eq!(to_rust(bit_rate), rejected);
        }
        bit_rate.bit_rate = 250_000;
        let expected = LssCommand::ConfigureBitRate(LssBitRate::Rate250k);
        assert_eq!(to_rust(bit_rate), Ok(expected));
        let mut scan = command(IGH_CANOPEN_LSS_FASTSCAN);
        scan.known = 16;
        assert_eq!(to_rust(scan), rejected);
        (scan.known, scan.service) = (0, 0);
        assert_eq!(to_rust(scan), rejected);
    }

    #[test]
    fn results_have_their_values() {
        let found = igh_canopen_lss_result_t::from(LssResult::Address(LssAddress {
            serial: 7,
            ..LssAddress::default()
        }));
        let address = igh_canopen_lss_outcome_t::IGH_CANOPEN_LSS_OUTCOME_ADDRESS as u8;
        assert_eq!((found.outcome, found.address.serial_number), (address, 7));
        let none = igh_canopen_lss_result_t::from(LssResult::NodeId(None));
        assert_eq!(none.node_id, 255);
        let five = igh_canopen_lss_result_t::from(LssResult::NodeId(NodeId::from_raw(5)));
        assert_eq!(five.node_id, 5);
    }
}
