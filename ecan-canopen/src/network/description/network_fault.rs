//! Faults of the description of a network.

use std::fmt;

use ecan_protocol::can::CanId;
use thiserror::Error;

use crate::network::address::NodeAddress;
use crate::network::boot::Subject;
use crate::network::pdo_mapping::{PdoDirection, PdoMappingError};
use crate::{MappingEntry, NodeId};

/// A PDO in a message: `RPDO 2`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PdoName {
    /// Direction.
    pub direction: PdoDirection,
    /// PDO number, from 1.
    pub number: u16,
}

impl fmt::Display for PdoName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = match self.direction {
            PdoDirection::Receive => "RPDO",
            PdoDirection::Transmit => "TPDO",
        };
        write!(f, "{direction} {}", self.number)
    }
}

/// A fault of the description of a network, with the nodes that it concerns.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkFault {
    /// Indices in [`NetworkDescription::nodes`](super::NetworkDescription::nodes); empty for a
    /// fault of a channel.
    pub nodes: Vec<usize>,
    /// The fault.
    pub kind: NetworkFaultKind,
}

impl fmt::Display for NetworkFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)
    }
}

/// Kind of a [`NetworkFault`].
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum NetworkFaultKind {
    /// Two nodes have the same address.
    #[error("{address} is described twice; each node-ID may occur once on a channel")]
    Duplicate {
        /// The address.
        address: NodeAddress,
    },
    /// A node has the node-ID of the host's heartbeat.
    #[error("node-ID {node} is that of the host's heartbeat; choose another one")]
    HostNode {
        /// The node-ID.
        node: NodeId,
    },
    /// The channel of a node is not described.
    #[error("{address}: the channel is not enabled; configure its bit rate")]
    Channel {
        /// The address.
        address: NodeAddress,
    },
    /// The device does not support the bit rate of its channel.
    #[error("the device does not support {} kbit/s, by its device file", bitrate / 1000)]
    BitRate {
        /// Bit rate of the channel in bit/s.
        bitrate: u32,
    },
    /// The PDO is invalid, without regard to others.
    #[error("{pdo}: {error}")]
    Pdo {
        /// The PDO.
        pdo: PdoName,
        /// Cause.
        error: PdoMappingError,
    },
    /// A PDO is described twice.
    #[error("{pdo} is described twice")]
    DuplicatePdo {
        /// The PDO.
        pdo: PdoName,
    },
    /// The device does not have the PDO.
    #[error("{pdo}: the device file has no object 0x{index:04X}; use another PDO number")]
    NoPdo {
        /// The PDO.
        pdo: PdoName,
        /// Index of its communication parameters.
        index: u16,
    },
    /// The device does not have a mapped object.
    #[error("{pdo}: the device file has no object 0x{:04X}:{:02X}", entry.index, entry.subindex)]
    NoObject {
        /// The PDO.
        pdo: PdoName,
        /// Mapping entry.
        entry: MappingEntry,
    },
    /// The device does not allow an object in this PDO.
    #[error("{pdo}: {subject} cannot be mapped, by its device file (`PDOMapping`, `AccessType`)")]
    NotMappable {
        /// The PDO.
        pdo: PdoName,
        /// The object.
        subject: Subject,
    },
    /// The length of a mapping entry is not that of its object.
    #[error("{pdo}: {subject} has {expected} bits, {found} are mapped")]
    EntryLength {
        /// The PDO.
        pdo: PdoName,
        /// The object.
        subject: Subject,
        /// Bits of the object.
        expected: u8,
        /// Bits of the entry.
        found: u8,
    },
    /// The COB-ID is reserved (CiA 301, 7.3.5).
    #[error("{pdo}: COB-ID 0x{:03X} is reserved; use another one", id.raw())]
    Reserved {
        /// The PDO.
        pdo: PdoName,
        /// The COB-ID.
        id: CanId,
    },
    /// Two producers send the same COB-ID on a channel.
    #[error("COB-ID 0x{:03X} is sent by {first} and by {second}; each may have one sender", id.raw())]
    Collision {
        /// The COB-ID.
        id: CanId,
        /// First sender.
        first: String,
        /// Second sender.
        second: String,
    },
    /// The device does not have an object that is written.
    #[error("{subject}: the device file has no such object")]
    NoParameter {
        /// The object.
        subject: Subject,
    },
    /// A read-only object is written.
    #[error("{subject} cannot be written, by its device file (`AccessType`)")]
    ReadOnly {
        /// The object.
        subject: Subject,
    },
    /// A value has not the length of its object.
    #[error("{subject} has {expected} bytes, the value has {found}")]
    ValueLength {
        /// The object.
        subject: Subject,
        /// Bytes of the object.
        expected: usize,
        /// Bytes of the value.
        found: usize,
    },
    /// A value is outside the limits of its object.
    #[error("{subject} = {value} is out of range; allowed: {low} to {high}")]
    Limit {
        /// The object.
        subject: Subject,
        /// The value.
        value: String,
        /// Lower limit.
        low: String,
        /// Upper limit.
        high: String,
    },
    /// The frames of the network do not fit the bus.
    #[error(
        "slave {slave} channel {channel}: the network needs {:.0} % of the bus; reduce the rates or \
         raise the bit rate",
        share * 100.0
    )]
    Load {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
        /// Share of the bus, at most stuff bits; 1 is all of it.
        share: f64,
    },
}
