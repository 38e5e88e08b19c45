//! Commands of the LSS master and their results.

use std::fmt;

use crate::{
    FastscanFilter, LssAddress, LssAddressRange, LssBitRate, LssPart, LssRequest, NodeId, RangePart,
};

/// Command of the LSS master. The services that configure or read a slave need it in the configuration state,
/// and no other slave with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LssCommand {
    /// Switches all slaves to the configuration state or the waiting state. No slave responds. A slave without
    /// node-ID that got one boots when it returns to the waiting state.
    SwitchGlobal {
        /// True for the configuration state.
        configuration: bool,
    },
    /// Switches the slave with this address to the configuration state.
    SwitchSelective(LssAddress),
    /// Configures the node-ID; `None` removes it. A slave that has one uses the new one after the NMT command
    /// "reset communication".
    ConfigureNodeId(Option<NodeId>),
    /// Configures the bit rate, which [`ActivateBitRate`](Self::ActivateBitRate) activates.
    ConfigureBitRate(LssBitRate),
    /// Activates the configured bit rates of all slaves in the configuration state. The slaves do not respond:
    /// they switch after the delay and are silent for the same time again. The command ends after both; the
    /// gateway's channel needs the new bit rate then.
    ActivateBitRate {
        /// Delay in milliseconds.
        delay_ms: u16,
    },
    /// Stores node-ID and bit rate in the slave.
    Store,
    /// Reads the address.
    InquireAddress,
    /// Reads the node-ID.
    InquireNodeId,
    /// Searches slaves in a range of addresses.
    Identify(LssAddressRange),
    /// Searches slaves without node-ID.
    IdentifyNonConfigured,
    /// Searches the lowest address among the slaves without node-ID, and switches that slave to the configuration
    /// state.
    Fastscan(FastscanFilter),
}

/// Result of an [`LssCommand`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LssResult {
    /// The command was sent, or the slave confirmed it.
    Done,
    /// Address, of [`LssCommand::InquireAddress`] and [`LssCommand::Fastscan`].
    Address(LssAddress),
    /// Node-ID, of [`LssCommand::InquireNodeId`]; `None` if the slave has none.
    NodeId(Option<NodeId>),
    /// At least one slave responded to a search.
    Found,
    /// No slave responded to a search.
    NotFound,
}

const ADDRESS: [LssPart; 4] =
    [LssPart::Vendor, LssPart::Product, LssPart::Revision, LssPart::Serial];

impl LssCommand {
    /// Number of frames; a fastscan counts as one.
    pub(super) const fn frames(&self) -> usize {
        match self {
            Self::SwitchSelective(_) | Self::InquireAddress => ADDRESS.len(),
            Self::Identify(_) => RangePart::ALL.len(),
            _ => 1,
        }
    }

    /// Frame number `nth` of the command; `None` of a fastscan and after the last one.
    pub(super) fn request(&self, nth: usize) -> Option<LssRequest> {
        let part = || ADDRESS.get(nth).copied();
        Some(match *self {
            Self::SwitchGlobal { configuration } => LssRequest::SwitchGlobal { configuration },
            Self::SwitchSelective(address) => {
                let part = part()?;
                LssRequest::SwitchSelective { part, value: address.part(part) }
            }
            Self::ConfigureNodeId(node) => LssRequest::node_id(node),
            Self::ConfigureBitRate(bit_rate) => LssRequest::bit_rate(bit_rate),
            Self::ActivateBitRate { delay_ms } => LssRequest::ActivateBitTiming { delay_ms },
            Self::Store => LssRequest::Store,
            Self::InquireAddress => LssRequest::Inquire(part()?),
            Self::InquireNodeId => LssRequest::InquireNodeId,
            Self::Identify(range) => {
                let part = *RangePart::ALL.get(nth)?;
                LssRequest::IdentifyRemote { part, value: range_value(&range, part) }
            }
            Self::IdentifyNonConfigured => LssRequest::IdentifyNonConfigured,
            Self::Fastscan(_) => return None,
        })
    }
}

const fn range_value(range: &LssAddressRange, part: RangePart) -> u32 {
    match part {
        RangePart::Vendor => range.vendor,
        RangePart::Product => range.product,
        RangePart::RevisionLow => range.revision.0,
        RangePart::RevisionHigh => range.revision.1,
        RangePart::SerialLow => range.serial.0,
        RangePart::SerialHigh => range.serial.1,
    }
}

/// `configure node-ID 5`
impl fmt::Display for LssCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SwitchGlobal { configuration: true } => {
                f.write_str("switch all slaves to the configuration state")
            }
            Self::SwitchGlobal { configuration: false } => {
                f.write_str("switch all slaves to the waiting state")
            }
            Self::SwitchSelective(address) => write!(f, "select {address}"),
            Self::ConfigureNodeId(Some(node)) => write!(f, "configure node-ID {node}"),
            Self::ConfigureNodeId(None) => f.write_str("remove the node-ID"),
            Self::ConfigureBitRate(bit_rate) => write!(f, "configure bit rate {bit_rate}"),
            Self::ActivateBitRate { delay_ms } => {
                write!(f, "activate the bit rate after {delay_ms} ms")
            }
            Self::Store => f.write_str("store the configuration"),
            Self::InquireAddress => f.write_str("read the address"),
            Self::InquireNodeId => f.write_str("read the node-ID"),
            Self::Identify(range) => write!(
                f,
                "identify vendor-ID 0x{:X}, product code 0x{:X}",
                range.vendor, range.product
            ),
            Self::IdentifyNonConfigured => f.write_str("identify slaves without node-ID"),
            Self::Fastscan(_) => f.write_str("fastscan"),
        }
    }
}
