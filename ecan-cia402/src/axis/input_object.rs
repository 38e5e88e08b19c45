//! Objects that the TPDOs of an axis can carry beyond statusword and actual position.

use ecan_canopen::{MappingEntry, object};

ecan_protocol::text_enum! {
    /// Object that the TPDOs of an axis carry, beyond statusword and actual position, see
    /// [`AxisConfig::inputs`](crate::AxisConfig::inputs).
    pub enum InputObject: u8;
    /// Actual velocity 0x606C, I32, in units of the drive's velocity.
    Velocity = 0, "actual velocity 0x606C";
    /// Actual torque 0x6077, I16, in thousandths of the rated torque.
    Torque = 1, "actual torque 0x6077";
    /// Error code 0x603F, U16.
    ErrorCode = 2, "error code 0x603F";
    /// Digital inputs 0x60FD, U32.
    DigitalInputs = 3, "digital inputs 0x60FD";
    /// Mode display 0x6061, I8.
    ModeDisplay = 4, "mode display 0x6061";
    /// Following error 0x60F4 by the drive, I32, in steps.
    FollowingError = 5, "following error 0x60F4";
    /// Touch probe status 0x60B9, U16.
    ProbeStatus = 6, "touch probe status 0x60B9";
    /// Position at the positive edge of touch probe 1, 0x60BA, I32, in steps.
    Probe1Positive = 7, "touch probe 1 position 0x60BA";
    /// Position at the negative edge of touch probe 1, 0x60BB, I32, in steps.
    Probe1Negative = 8, "touch probe 1 position 0x60BB";
    /// Position at the positive edge of touch probe 2, 0x60BC, I32, in steps.
    Probe2Positive = 9, "touch probe 2 position 0x60BC";
    /// Position at the negative edge of touch probe 2, 0x60BD, I32, in steps.
    Probe2Negative = 10, "touch probe 2 position 0x60BD";
    /// Actual velocity of the velocity mode, 0x6044, I16.
    VlVelocity = 11, "actual velocity 0x6044";
}

/// Number of the objects.
const COUNT: usize = 12;

impl InputObject {
    /// Entry of a PDO mapping, of the first axis of a node.
    pub fn entry(self) -> MappingEntry {
        let (index, bits) = match self {
            Self::Velocity => (object::VELOCITY_ACTUAL, 32),
            Self::Torque => (object::TORQUE_ACTUAL, 16),
            Self::ErrorCode => (object::ERROR_CODE, 16),
            Self::DigitalInputs => (object::DIGITAL_INPUTS, 32),
            Self::ModeDisplay => (object::MODE_DISPLAY, 8),
            Self::FollowingError => (object::FOLLOWING_ERROR, 32),
            Self::ProbeStatus => (object::PROBE_STATUS, 16),
            Self::Probe1Positive => (object::PROBE_1_POSITIVE, 32),
            Self::Probe1Negative => (object::PROBE_1_NEGATIVE, 32),
            Self::Probe2Positive => (object::PROBE_2_POSITIVE, 32),
            Self::Probe2Negative => (object::PROBE_2_NEGATIVE, 32),
            Self::VlVelocity => (object::VL_VELOCITY_ACTUAL, 16),
        };
        MappingEntry::new(index, 0, bits)
    }

    /// The value of these bits, with the sign of the object's type.
    fn value(self, raw: u32) -> i32 {
        match self {
            Self::Torque | Self::VlVelocity => (raw as u16).cast_signed().into(),
            Self::ErrorCode | Self::ProbeStatus => (raw as u16).into(),
            Self::ModeDisplay => (raw as u8).cast_signed().into(),
            _ => raw.cast_signed(),
        }
    }
}

/// Values of the last TPDOs of a drive. A value is `None` if its object is not in
/// [`AxisConfig::inputs`](crate::AxisConfig::inputs), or if no TPDO with it has arrived since the
/// configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AxisInputs {
    values: [i32; COUNT],
    /// A bit per object.
    present: u16,
}

impl AxisInputs {
    pub(crate) fn set(&mut self, object: InputObject, raw: u32) {
        let nth = usize::from(object.raw());
        if let Some(value) = self.values.get_mut(nth) {
            *value = object.value(raw);
            self.present |= 1 << nth;
        }
    }

    /// Value of an object; an unsigned one of 32 bits has the bits of the number. Real-time safe.
    pub fn get(&self, object: InputObject) -> Option<i32> {
        let nth = usize::from(object.raw());
        self.values.get(nth).copied().filter(|_| self.present & 1 << nth != 0)
    }

    /// Actual velocity 0x606C, in units of the drive's velocity.
    pub fn velocity(&self) -> Option<i32> {
        self.get(InputObject::Velocity)
    }

    /// Actual torque 0x6077, in thousandths of the rated torque.
    pub fn torque(&self) -> Option<i32> {
        self.get(InputObject::Torque)
    }

    /// Error code 0x603F.
    pub fn error_code(&self) -> Option<u16> {
        self.get(InputObject::ErrorCode).map(|value| value as u16)
    }

    /// Digital inputs 0x60FD.
    pub fn digital_inputs(&self) -> Option<u32> {
        self.get(InputObject::DigitalInputs).map(i32::cast_unsigned)
    }

    /// Mode display 0x6061, as the drive reports it.
    pub fn mode_display(&self) -> Option<i8> {
        self.get(InputObject::ModeDisplay).map(|value| value as i8)
    }

    /// Following error 0x60F4 by the drive, in steps.
    pub fn following_error(&self) -> Option<i32> {
        self.get(InputObject::FollowingError)
    }

    /// Touch probe status 0x60B9.
    pub fn probe_status(&self) -> Option<u16> {
        self.get(InputObject::ProbeStatus).map(|value| value as u16)
    }

    /// Values and presence as words of a snapshot.
    pub(crate) fn parts(&self) -> (&[i32; COUNT], u16) {
        (&self.values, self.present)
    }

    pub(crate) fn of_parts(values: [i32; COUNT], present: u16) -> Self {
        Self { values, present }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_sign_of_their_type() {
        assert_eq!(InputObject::ALL.len(), COUNT);
        let mut inputs = AxisInputs::default();
        assert!(InputObject::ALL.iter().all(|object| inputs.get(*object).is_none()));
        for &object in InputObject::ALL {
            inputs.set(object, 0xFFFF_FFFE);
        }
        assert_eq!((inputs.velocity(), inputs.torque()), (Some(-2), Some(-2)));
        assert_eq!((inputs.error_code(), inputs.probe_status()), (Some(0xFFFE), Some(0xFFFE)));
        assert_eq!(inputs.digital_inputs(), Some(0xFFFF_FFFE));
        assert_eq!(inputs.mode_display(), Some(-2));
        assert_eq!(inputs.get(InputObject::VlVelocity), Some(-2));
        let (values, present) = inputs.parts();
        assert_eq!(AxisInputs::of_parts(*values, present), inputs);
    }
}
