//! Objects that the RPDOs of an axis can carry beyond controlword and target.

use ecan_canopen::{MappingEntry, OperatingMode, object};

ecan_protocol::text_enum! {
    /// Object that the RPDOs of an axis carry, beyond controlword and target, see
    /// [`AxisConfig::outputs`](crate::AxisConfig::outputs).
    pub enum OutputObject: u8;
    /// Velocity offset 0x60B1, I32, in units of the drive's velocity: feed-forward in CSP.
    VelocityOffset = 0, "velocity offset 0x60B1";
    /// Torque offset 0x60B2, I16, in thousandths of the rated torque: feed-forward in CSP and CSV.
    TorqueOffset = 1, "torque offset 0x60B2";
    /// Touch probe function 0x60B8, U16.
    ProbeFunction = 2, "touch probe function 0x60B8";
    /// Digital outputs 0x60FE:01, U32. The configuration writes the mask 0x60FE:02.
    DigitalOutputs = 3, "digital outputs 0x60FE:01";
    /// Mode of operation 0x6060, I8: the mode of the axis. It is in the RPDO of the controlword.
    Mode = 4, "mode of operation 0x6060";
}

impl OutputObject {
    /// Entry of a PDO mapping, of the first axis of a node.
    pub fn entry(self) -> MappingEntry {
        match self {
            Self::VelocityOffset => MappingEntry::new(object::VELOCITY_OFFSET, 0, 32),
            Self::TorqueOffset => MappingEntry::new(object::TORQUE_OFFSET, 0, 16),
            Self::ProbeFunction => MappingEntry::new(object::PROBE_FUNCTION, 0, 16),
            Self::DigitalOutputs => MappingEntry::new(object::DIGITAL_OUTPUTS, 1, 32),
            Self::Mode => MappingEntry::new(object::MODE_OF_OPERATION, 0, 8),
        }
    }

    /// Returns whether a drive uses the object in a mode.
    pub fn serves(self, mode: OperatingMode) -> bool {
        match self {
            Self::VelocityOffset => mode == OperatingMode::CyclicPosition,
            Self::TorqueOffset => {
                matches!(mode, OperatingMode::CyclicPosition | OperatingMode::CyclicVelocity)
            }
            Self::ProbeFunction | Self::DigitalOutputs | Self::Mode => true,
        }
    }

    /// Returns whether the object is a feed-forward.
    pub fn is_feed_forward(self) -> bool {
        matches!(self, Self::VelocityOffset | Self::TorqueOffset)
    }
}

/// Values of the RPDOs after the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutputValues {
    /// Velocity offset 0x60B1.
    pub velocity_offset: i32,
    /// Torque offset 0x60B2.
    pub torque_offset: i16,
    /// Touch probe function 0x60B8.
    pub probe_function: u16,
    /// Digital outputs 0x60FE:01.
    pub digital_outputs: u32,
}

impl OutputValues {
    /// Bytes of an object, little-endian; the first ones count.
    pub(crate) fn bytes(&self, object: OutputObject) -> [u8; 4] {
        match object {
            OutputObject::VelocityOffset => self.velocity_offset.to_le_bytes(),
            OutputObject::TorqueOffset => i32::from(self.torque_offset).to_le_bytes(),
            OutputObject::ProbeFunction => u32::from(self.probe_function).to_le_bytes(),
            OutputObject::DigitalOutputs => self.digital_outputs.to_le_bytes(),
            // In the first RPDO, by the mode of the axis.
            OutputObject::Mode => [0; 4],
        }
    }
}
