//! The gateway on which settings were measured.

use ecan_protocol::device::Capabilities;

/// Identity of a gateway on which `ecan probe` measured settings; `None` for a number that it does not
/// report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MeasuredOn {
    /// Serial number (0xF000:07, :08).
    pub serial: Option<u64>,
    /// Major and minor firmware version (0xF000:05, :06).
    pub firmware: Option<(u32, u32)>,
}

impl MeasuredOn {
    /// Text of what differs from a gateway with these capabilities; `None` if nothing does. Numbers that
    /// one of them does not report are equal.
    #[must_use]
    pub fn difference(&self, gateway: &Capabilities) -> Option<String> {
        let is_other = |measured: u64, found: u64| measured != 0 && found != 0 && measured != found;
        let Capabilities { serial_number, firmware_major, firmware_minor, .. } = *gateway;
        let found = (u32::from(firmware_major), u32::from(firmware_minor));
        let other_firmware = self.firmware.filter(|it| *it != found && found != (0, 0));
        let other_serial = self.serial.filter(|it| is_other(*it, serial_number));
        match (other_firmware, other_serial) {
            (Some((major, minor)), _) => {
                Some(format!("firmware {major}.{minor}; this one has {}.{}", found.0, found.1))
            }
            (None, Some(serial)) => {
                Some(format!("serial number {serial}; this one has {serial_number}"))
            }
            (None, None) => None,
        }
    }
}
