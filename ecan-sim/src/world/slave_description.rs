//! Description of a slave for the master: its SII.

use super::line::Slot;
use crate::gateway::DEVICE_NAME;
use crate::gateway::variant::SdoInformation;
use crate::scenario::{GatewaySpec, IoSpec};
use crate::world::World;

/// Sync managers of a gateway: two mailboxes, outputs, inputs.
const GATEWAY_SYNC_MANAGERS: u8 = 4;
/// Sync managers of an I/O: outputs, inputs.
const IO_SYNC_MANAGERS: u8 = 2;

/// Contents of the SII that the master uses.
#[derive(Clone, Debug)]
pub(crate) struct SlaveDescription {
    pub(crate) name: String,
    pub(crate) alias: u16,
    pub(crate) vendor_id: u32,
    pub(crate) product_code: u32,
    pub(crate) revision: u32,
    pub(crate) serial: u32,
    pub(crate) sync_managers: u8,
    /// The master may write 0x1C12 and 0x1C13.
    pub(crate) pdo_assign: bool,
    /// The master may write the mapping objects.
    pub(crate) pdo_configuration: bool,
    /// The SII lists all PDOs.
    pub(crate) sii_pdos: bool,
    /// It has a mailbox with CoE.
    pub(crate) has_coe: bool,
    /// SDO information of CoE.
    pub(crate) has_information: bool,
    /// Distributed clocks.
    pub(crate) has_clock: bool,
}

impl SlaveDescription {
    pub(crate) fn of_gateway(spec: &GatewaySpec) -> Self {
        let config = &spec.config;
        Self {
            name: DEVICE_NAME.to_owned(),
            alias: spec.alias,
            vendor_id: config.vendor_id,
            product_code: config.product_code,
            revision: config.revision,
            serial: config.serial as u32,
            sync_managers: GATEWAY_SYNC_MANAGERS,
            pdo_assign: spec.pdo_assign,
            pdo_configuration: spec.pdo_configuration,
            sii_pdos: spec.sii_pdos,
            has_coe: true,
            has_information: config.variant.sdo_information == SdoInformation::Supported,
            has_clock: true,
        }
    }

    fn of_io(spec: &IoSpec) -> Self {
        Self {
            name: spec.name.clone(),
            alias: spec.alias,
            vendor_id: spec.vendor_id,
            product_code: spec.product_code,
            revision: spec.revision,
            serial: spec.serial,
            sync_managers: IO_SYNC_MANAGERS,
            pdo_assign: false,
            pdo_configuration: false,
            sii_pdos: true,
            has_coe: false,
            has_information: false,
            has_clock: false,
        }
    }
}

impl World {
    /// The SII of a slave.
    pub(crate) fn describe(&self, slot: Slot) -> Option<SlaveDescription> {
        match slot {
            Slot::Gateway(index) => {
                self.slots.get(index).map(|slot| SlaveDescription::of_gateway(&slot.spec))
            }
            Slot::Io(index) => self.io(index).map(|io| SlaveDescription::of_io(io.spec())),
        }
    }
}
