//! Slave that is no gateway: a digital I/O.

use serde::Deserialize;

/// Inputs of an I/O slave.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum IoBehaviour {
    /// The outputs; further input bytes are 0.
    #[default]
    Loopback,
    /// The number of reads by the master, little endian.
    Counter,
    /// These bytes; further input bytes are 0.
    Fixed(Vec<u8>),
}

/// Names of the behaviours in scenario files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum IoBehaviourName {
    #[default]
    Loopback,
    Counter,
    Fixed,
}

/// A digital I/O on the EtherCAT line, of another vendor: it has no mailbox and no distributed clock.
///
/// Its outputs are PDO 0x1600 in SM0, with the entries 0x7000:01 and so on of 8 bits; its inputs are PDO
/// 0x1A00 in SM1, with the entries 0x6000:01 and so on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoSpec {
    /// Position on the line, from 0. The gateways have the other positions, in their order.
    pub position: usize,
    /// Name in the SII.
    pub name: String,
    /// Station alias; 0 is none.
    pub alias: u16,
    /// Vendor ID.
    pub vendor_id: u32,
    /// Product code.
    pub product_code: u32,
    /// Revision number.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
    /// Time from power-on until it responds, ms.
    pub boot_ms: u32,
    /// Number of output bytes.
    pub outputs: u8,
    /// Number of input bytes.
    pub inputs: u8,
    /// Values of the inputs.
    pub behaviour: IoBehaviour,
}

impl IoSpec {
    /// Largest number of bytes of one direction.
    pub const MAX_BYTES: u8 = 64;

    /// A digital I/O with two bytes in each direction, looped back.
    pub fn at(position: usize) -> Self {
        Self {
            position,
            name: "Digital I/O".to_owned(),
            alias: 0,
            vendor_id: 0x0000_0D10,
            product_code: 0x0000_1010,
            revision: 1,
            serial: 1,
            boot_ms: 50,
            outputs: 2,
            inputs: 2,
            behaviour: IoBehaviour::Loopback,
        }
    }
}
