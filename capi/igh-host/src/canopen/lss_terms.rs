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
use ecan_c_boundary::{Call, mirror};
use ecan_canopen::{
    FastscanFilter, Lss, LssAddress, LssAddressRange, LssBitRate, LssCommand, LssResult, NodeId,
};

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
        NodeId::new(self.node_id).map(Some).ok_or_else(|| {
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

#[cfg(test)]
mod tests {
    use ecan_c_boundary::call;

    use super::super::lss::igh_canopen_lss_init;
    use super::*;

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
        let five = igh_canopen_lss_result_t::from(LssResult::NodeId(NodeId::new(5)));
        assert_eq!(five.node_id, 5);
    }
}
