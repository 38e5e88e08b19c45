//! Selection of an LSS slave.

use std::str::FromStr;

use clap::Args;
use ecan_canopen::{LssAddress, LssCommand, NodeId, object};

use crate::commands::node::node_client::unsigned;
use crate::commands::node::node_target::NodeTarget;
use crate::context::Result;
use crate::value::parse_unsigned;

use super::lss_client::LssClient;

/// `VENDOR:PRODUCT:REVISION:SERIAL`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddressArgument(pub LssAddress);

impl FromStr for AddressArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let number = |text: &str| parse_unsigned(text).and_then(|it| u32::try_from(it).ok());
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
    let node = parse_unsigned(text).and_then(|it| u8::try_from(it).ok()).and_then(NodeId::new);
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
        Ok(unsigned(&data) as u32)
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
