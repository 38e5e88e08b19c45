//! LSS master of one channel, and the selection of a slave.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{
    Lss, LssAddress, LssCommand, LssConfig, LssFailure, LssFault, LssMaster, LssResult, NodeId,
    object,
};
use ecan_tool_support::command_line::options::milliseconds;
use serde::Serialize;

use crate::commands::node::node_client::{NodeClient, decode_unsigned, start};
use crate::commands::node::node_link::NodeLink;
use crate::commands::node::node_target::NodeTarget;
use crate::context::{Context, Failure, Result};
use crate::frames::{FrameOptions, parse_channel};
use crate::value::parse_unsigned;

/// Options of every LSS command.
#[derive(Clone, Debug, Args)]
pub struct LssOptions {
    /// CAN channel, 0 to 3
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = parse_channel)]
    pub channel: u8,
    /// Time for a response
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = milliseconds::<u64>(1..=60_000))]
    timeout: u64,
    #[command(flatten)]
    pub options: FrameOptions,
}

/// LSS address in JSON.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct JsonAddress {
    vendor_id: u32,
    product_code: u32,
    revision: u32,
    serial: u32,
}

impl From<LssAddress> for JsonAddress {
    fn from(address: LssAddress) -> Self {
        let LssAddress { vendor, product, revision, serial } = address;
        Self { vendor_id: vendor, product_code: product, revision, serial }
    }
}

/// Time for the response of a second slave.
const LATE_NS: u64 = 50_000_000;
/// Waiting time of a request of a fastscan through a service.
const SERVICE_SCAN_MS: u64 = 50;
const SDO_TIMEOUT: Duration = Duration::from_millis(500);

/// `vendor-ID 0x53494D00, product code 0x192, revision number 0x10000, serial number 0x1`
impl fmt::Display for JsonAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { vendor_id, product_code, revision, serial } = *self;
        LssAddress { vendor: vendor_id, product: product_code, revision, serial }.fmt(f)
    }
}

/// LSS master of a channel of one gateway.
#[derive(Debug)]
pub struct LssClient {
    /// Of the node-ID that is used for SDO requests.
    pub node: NodeClient,
    master: LssMaster,
    channel: u8,
}

impl LssClient {
    /// Starts the gateway; `scan_ms` is the waiting time of a request of a fastscan.
    pub fn start(arguments: &LssOptions, scan_ms: Option<u64>, context: &Context) -> Result<Self> {
        let link = start(&arguments.options, arguments.channel, true, context)?;
        let default = LssConfig::default();
        let is_service = crate::context::open(context.global, context.global.master())?.is_some();
        let scan_ms = scan_ms.or(is_service.then_some(SERVICE_SCAN_MS));
        let config = LssConfig {
            timeout: Duration::from_millis(arguments.timeout),
            scan_time: scan_ms.map_or(default.scan_time, Duration::from_millis),
            ..default
        };
        let channel = arguments.channel;
        let target = NodeTarget { channel, node: NodeId::MIN };
        let node = NodeClient::new(link, target, SDO_TIMEOUT);
        Ok(Self { node, master: LssMaster::new(config), channel })
    }

    /// Does the work of a command, then ends the capture of the frames, also after an error.
    pub fn run<T>(mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let result = work(&mut self);
        let finished = self.node.link.service.finish();
        result.and_then(|value| finished.map(|()| value))
    }

    fn link(&mut self) -> &mut NodeLink {
        &mut self.node.link
    }

    /// Position of the gateway.
    pub fn slave(&self) -> usize {
        self.node.link.service.position(0)
    }

    /// Executes a command.
    ///
    /// # Errors
    /// Also those of the slave, with what to do.
    pub fn command(&mut self, command: LssCommand) -> Result<LssResult> {
        match self.try_command(command)? {
            Ok(result) => Ok(result),
            Err(fault) => Err(self.failure(command, fault)),
        }
    }

    /// Executes a command.
    ///
    /// # Errors
    /// The gateway is lost, no node acknowledges, or the user stops.
    pub fn try_command(
        &mut self,
        command: LssCommand,
    ) -> Result<std::result::Result<LssResult, LssFault>> {
        // Never busy: each command is completed.
        let _ = self.master.start(command);
        loop {
            match self.master.state() {
                Lss::Busy => {
                    self.node.link.cycle_lss(self.channel, &mut self.master)?;
                    let place = (0, self.channel);
                    if self.link().is_stalled(place) {
                        return Err(self.node.link.stall_failure(place));
                    }
                }
                Lss::Done(result) => return Ok(Ok(result)),
                Lss::Failed(fault) => return Ok(Err(fault)),
                Lss::Idle => return Ok(Err(LssFault::Cancelled)),
            }
        }
    }

    /// Error of a command, with what to do.
    pub fn failure(&mut self, command: LssCommand, fault: LssFault) -> Failure {
        let (slave, channel) = (self.slave(), self.channel);
        let failure = LssFailure { slave, channel, command, fault };
        let is_silent = matches!(fault, LssFault::TimedOut { .. } | LssFault::NotSelected { .. });
        let remedy = match is_silent && !self.link().check_alive((0, channel)) {
            true => {
                "; no node acknowledges frames of this channel: check bit rate, wiring and \
                 termination"
            }
            false => "",
        };
        Failure::Rejected(format!("{failure}{remedy}"))
    }

    /// Responses that fitted no command, after waiting for late ones: more than one slave responds.
    ///
    /// # Errors
    /// The gateway is lost, or the user stops.
    pub fn late_strays(&mut self) -> Result<u64> {
        let end_ns = self.link().service.response_ns() + LATE_NS;
        while self.node.link.cycle_lss(self.channel, &mut self.master)? < end_ns {}
        Ok(self.master.strays())
    }

    /// Rejects a channel on which no node acknowledges frames.
    ///
    /// # Errors
    /// No node of the channel has sent or acknowledged a frame.
    pub fn check_alive(&mut self) -> Result {
        let place = (0, self.channel);
        match self.link().check_alive(place) {
            true => Ok(()),
            false => Err(self.node.link.stall_failure(place)),
        }
    }

    /// Switches all slaves to the waiting state.
    pub fn release(&mut self) -> Result {
        self.command(LssCommand::SwitchGlobal { configuration: false }).map(drop)
    }
}

/// `VENDOR:PRODUCT:REVISION:SERIAL`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddressArgument(pub LssAddress);

impl FromStr for AddressArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let number =
            |text: &str| parse_unsigned(text).and_then(|number| u32::try_from(number).ok());
        let parts: Option<Vec<u32>> = text.split(':').map(number).collect();
        match parts.as_deref() {
            Some(&[vendor, product, revision, serial]) => {
                Ok(Self(LssAddress { vendor, product, revision, serial }))
            }
            _ => Err("expected vendor-ID, product code, revision and serial number, \
                      VENDOR:PRODUCT:REVISION:SERIAL"
                .to_owned()),
        }
    }
}

/// Options that select one slave.
#[derive(Clone, Copy, Debug, Args)]
#[group(id = "lss_slave", required = true, multiple = false)]
pub struct SlaveSelection {
    /// LSS address, VENDOR:PRODUCT:REVISION:SERIAL
    #[arg(long, value_name = "ADDRESS")]
    address: Option<AddressArgument>,
    /// Node-ID of the slave; its LSS address is read from 0x1018
    #[arg(long, value_name = "ID", value_parser = parse_node)]
    node: Option<NodeId>,
    /// The only LSS slave of the channel
    #[arg(long)]
    only: bool,
}

pub fn parse_node(text: &str) -> Result<NodeId, String> {
    let node = parse_unsigned(text)
        .and_then(|number| u8::try_from(number).ok())
        .and_then(NodeId::from_raw);
    node.ok_or_else(|| "expected a node-ID, 1 to 127".to_owned())
}

impl SlaveSelection {
    /// Node-ID of the selection.
    pub fn node(&self) -> Option<NodeId> {
        self.node
    }

    /// Switches the slave, and no other, to the configuration state.
    ///
    /// # Errors
    /// The slave does not respond.
    pub fn select(&self, client: &mut LssClient) -> Result {
        client.release()?;
        let address = match (self.address, self.node) {
            (Some(AddressArgument(address)), _) => address,
            (None, Some(node)) => read_address(client, node)?,
            (None, None) => {
                client.command(LssCommand::SwitchGlobal { configuration: true })?;
                return Ok(());
            }
        };
        client.command(LssCommand::SwitchSelective(address)).map(drop)
    }
}

/// LSS address of a node by its identity object.
fn read_address(client: &mut LssClient, node: NodeId) -> Result<LssAddress> {
    let channel = client.node.target().channel;
    client.node.set_target(NodeTarget { channel, node });
    let mut part = |subindex| -> Result<u32> {
        let data = client.node.upload(object::IDENTITY, subindex)?;
        Ok(decode_unsigned(&data) as u32)
    };
    Ok(LssAddress { vendor: part(1)?, product: part(2)?, revision: part(3)?, serial: part(4)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn address_has_four_numbers() {
        let address =
            LssAddress { vendor: 0x5349_4D00, product: 402, revision: 0x1_0000, serial: 7 };
        assert_eq!("0x53494D00:402:0x10000:7".parse(), Ok(AddressArgument(address)));
        for wrong in ["", "1:2:3", "1:2:3:4:5", "1:2:3:x", "0x100000000:2:3:4"] {
            assert!(wrong.parse::<AddressArgument>().is_err(), "{wrong}");
        }
    }
}
