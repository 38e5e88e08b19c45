//! Description of one node of a network.

use std::fmt;
use std::sync::Arc;

use ecan_protocol::can::CanId;
use ecan_protocol::config::McanChannelConfig;
use thiserror::Error;

use crate::device_file::{DeviceFile, Download, DownloadError, DownloadScope};
use crate::network::boot::{BootConfig, ConfigurationDate, Parameter, ParameterSet, Subject};
use crate::network::config::{HostHeartbeat, NodeAddress, Step, SyncConfig};
use crate::network::pdo_mapping::{PdoDirection, PdoMapping, PdoMappingError};
use crate::{MappingEntry, NodeId, object};

/// Fault of a description that prevents a boot-up.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DescriptionError {
    /// An invalid PDO.
    #[error(transparent)]
    Pdo(#[from] PdoMappingError),
    /// A value of the device file that does not fit its type.
    #[error(transparent)]
    Value(#[from] DownloadError),
}

/// Description of one node: plain data.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeDescription {
    /// Name for messages; may be empty.
    pub name: String,
    /// Its address.
    pub address: NodeAddress,
    /// Its device file. The values of a DCF are written to the node.
    pub device: Option<Arc<DeviceFile>>,
    /// Its boot-up; the parameters in it are ignored.
    pub boot: BootConfig,
    /// Values to write in addition to those of a DCF, or instead of them.
    pub overrides: Vec<Parameter>,
    /// PDOs to map. They replace those of a DCF.
    pub pdos: Vec<PdoMapping>,
    /// PDOs to disable.
    pub disabled_pdos: Vec<(PdoDirection, u16)>,
    /// Steps that configure it in place of the boot-up, for example those of its axes.
    pub setup: Option<Vec<Step>>,
}

impl NodeDescription {
    /// A node without a device file and PDOs.
    pub fn new(address: NodeAddress) -> Self {
        Self {
            name: String::new(),
            address,
            device: None,
            boot: BootConfig::default(),
            overrides: Vec::new(),
            pdos: Vec::new(),
            disabled_pdos: Vec::new(),
            setup: None,
        }
    }

    /// Name for messages: `gripper` or `node 5`.
    pub fn title(&self) -> String {
        if self.name.is_empty() { format!("node {}", self.address.node) } else { self.name.clone() }
    }

    /// Values that the node gets: those of its DCF that differ from the defaults, without the PDOs
    /// that are described, then the overrides. Values of a DCF that an override replaces are left out.
    ///
    /// # Errors
    /// [`DownloadError`] of a device file that was changed by hand.
    pub fn parameters(&self) -> Result<Vec<Parameter>, DownloadError> {
        let mut parameters: Vec<Parameter> = Vec::new();
        if let Some(device) = self.device.as_deref().filter(|device| device.is_dcf()) {
            let downloads = device.downloads(self.address.node, DownloadScope::Changed)?;
            let is_replaced = |index, subindex| {
                self.overrides
                    .iter()
                    .any(|value| (value.index, value.subindex) == (index, subindex))
            };
            for download in downloads {
                let Download { index, subindex, data } = download;
                let is_handled = index == object::CONFIGURATION_DATE
                    || self.describes_pdo_object(index)
                    || is_replaced(index, subindex);
                if let Some(entry) = device.entry(index, subindex).filter(|_| !is_handled) {
                    // An earlier write of the same object only prepares this one.
                    let key = (index, subindex);
                    let same = |parameter: &&mut Parameter| parameter.key() == key;
                    parameters
                        .iter_mut()
                        .filter(same)
                        .for_each(|parameter| parameter.is_verified = false);
                    parameters.push(Parameter {
                        name: device.label(entry).into(),
                        is_verified: entry.access.is_readable(),
                        ..Parameter::new(key, data)
                    });
                }
            }
        }
        parameters.extend(self.overrides.iter().cloned());
        Ok(parameters)
    }

    /// Configuration date of the boot-up, or of the DCF (0x1020).
    fn date(&self) -> Option<ConfigurationDate> {
        let by_file = || {
            let device = self.device.as_deref()?;
            let number = |subindex| {
                let entry = device.entry(object::CONFIGURATION_DATE, subindex)?;
                let value = entry.parameter_value(self.address.node)?.to_integer()?;
                u32::try_from(value).ok()
            };
            let date = ConfigurationDate { days: number(1)?, milliseconds: number(2)? };
            // 0 states that there is no date.
            (date.days != 0).then_some(date)
        };
        self.boot.parameters.date.or_else(by_file)
    }

    /// Boot-up with the values and PDOs of the description.
    ///
    /// # Errors
    /// [`DescriptionError`]; [`NetworkDescription::check`](super::NetworkDescription::check) reports
    /// all faults.
    pub fn boot_config(&self) -> Result<BootConfig, DescriptionError> {
        let saves = self.boot.parameters.saves;
        let set = ParameterSet { parameters: self.parameters()?, date: self.date(), saves };
        let mut steps = self.boot.steps.clone();
        steps.extend(self.pdo_steps()?);
        Ok(BootConfig { parameters: Arc::new(set), steps, ..self.boot.clone() })
    }

    fn pdo_steps(&self) -> Result<Vec<Step>, PdoMappingError> {
        let mut steps = Vec::new();
        for (direction, number) in &self.disabled_pdos {
            steps.extend(PdoMapping::disabling_steps(*direction, *number)?);
        }
        for pdo in &self.pdos {
            steps.extend(pdo.steps()?);
        }
        Ok(steps)
    }

    /// Returns whether an object belongs to a PDO that is described.
    fn describes_pdo_object(&self, index: u16) -> bool {
        let of = |base: u16| index.wrapping_sub(base) < 0x200;
        let (direction, base) = match index {
            _ if of(0x1400) => (PdoDirection::Receive, 0x1400),
            _ if of(0x1600) => (PdoDirection::Receive, 0x1600),
            _ if of(0x1800) => (PdoDirection::Transmit, 0x1800),
            _ if of(0x1A00) => (PdoDirection::Transmit, 0x1A00),
            _ => return false,
        };
        let number = index - base + 1;
        self.pdos.iter().any(|pdo| (pdo.direction, pdo.number) == (direction, number))
            || self.disabled_pdos.contains(&(direction, number))
    }
}

/// A channel of a network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelDescription {
    /// Slave index.
    pub slave: usize,
    /// Channel, 0..3.
    pub channel: u8,
    /// Its bit rates.
    pub can: McanChannelConfig,
}

/// Description of a network: plain data.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkDescription {
    /// The nodes.
    pub nodes: Vec<NodeDescription>,
    /// The enabled channels.
    pub channels: Vec<ChannelDescription>,
    /// Heartbeat of the host.
    pub host_heartbeat: Option<HostHeartbeat>,
    /// SYNC of the host.
    pub sync: Option<SyncConfig>,
    /// Cycle time in nanoseconds.
    pub cycle_ns: u32,
}

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
    /// The device has another value than the configured one, and does not let it change.
    #[error(
        "{subject} is 0x{found:X} and cannot be written, by its device file (`AccessType`); 0x{expected:X} is \
         configured"
    )]
    Fixed {
        /// The object.
        subject: Subject,
        /// Value of the device.
        found: u64,
        /// Configured value.
        expected: u64,
    },
    /// A step of the configuration cannot succeed.
    #[error("{purpose}: {fault}")]
    Step {
        /// Purpose of the step.
        purpose: &'static str,
        /// What the device file states.
        fault: Box<NetworkFaultKind>,
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
