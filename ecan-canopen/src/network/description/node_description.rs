//! Description of one node of a network.

use std::sync::Arc;

use thiserror::Error;

use crate::device_file::{DeviceFile, Download, DownloadError, DownloadScope};
use crate::network::address::NodeAddress;
use crate::network::boot::{BootConfig, ConfigurationDate, Parameter, ParameterSet};
use crate::network::node_action::Step;
use crate::network::pdo_mapping::{PdoDirection, PdoMapping, PdoMappingError};
use crate::object;

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
                self.overrides.iter().any(|it| (it.index, it.subindex) == (index, subindex))
            };
            for download in downloads {
                let Download { index, subindex, data } = download;
                let is_handled = index == object::CONFIGURATION_DATE
                    || self.describes_pdo_object(index)
                    || is_replaced(index, subindex);
                if let Some(entry) = device.entry(index, subindex).filter(|_| !is_handled) {
                    // An earlier write of the same object only prepares this one.
                    let key = (index, subindex);
                    let same = |it: &&mut Parameter| it.key() == key;
                    parameters.iter_mut().filter(same).for_each(|it| it.is_verified = false);
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
