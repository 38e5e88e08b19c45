//! SI units of positions and velocities, 0x60A8 and 0x60A9 (CiA 402-2, 11; units of CiA 303-2).

/// A unit: prefix, numerator and denominator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiUnit(pub u32);

const RADIAN: u8 = 0x10;
const DEGREE: u8 = 0x41;
const REVOLUTION: u8 = 0xB4;
const INCREMENT: u8 = 0xB5;
const SECOND: u8 = 0x03;
const MINUTE: u8 = 0x47;

/// Unit of an angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AngleUnit {
    /// Increments of the encoder.
    Increment,
    /// This number of units is a revolution.
    PerRevolution(f64),
}

impl SiUnit {
    const fn byte(self, shift: u32) -> u8 {
        (self.0 >> shift) as u8
    }

    /// Exponent of the power of ten in front of the unit.
    pub const fn exponent(self) -> i8 {
        self.byte(24).cast_signed()
    }

    /// Units per angle of the numerator, the power of ten included; `None` for a unit of another kind,
    /// and for increments with a power of ten.
    pub fn angle(self) -> Option<AngleUnit> {
        let units = match self.byte(16) {
            INCREMENT if self.exponent() == 0 => return Some(AngleUnit::Increment),
            REVOLUTION => 1.0,
            DEGREE => 360.0,
            RADIAN => core::f64::consts::TAU,
            _ => return None,
        };
        Some(AngleUnit::PerRevolution(units / power_of_ten(self.exponent())))
    }

    /// Time of the denominator in seconds; `None` for a unit without a time.
    pub const fn seconds(self) -> Option<f64> {
        match self.byte(8) {
            SECOND => Some(1.0),
            MINUTE => Some(60.0),
            _ => None,
        }
    }
}

fn power_of_ten(exponent: i8) -> f64 {
    let power = (0..exponent.unsigned_abs()).fold(1.0, |power, _| power * 10.0);
    if exponent < 0 { 1.0 / power } else { power }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_the_standard_encodes_them() {
        assert_eq!(SiUnit(0x00B5_0000).angle(), Some(AngleUnit::Increment));
        assert_eq!(SiUnit(0xFD41_0000).angle(), Some(AngleUnit::PerRevolution(360_000.0)));
        // 1/min, and 0.1/min
        let rpm = SiUnit(0x00B4_4700);
        assert_eq!((rpm.angle(), rpm.seconds()), (Some(AngleUnit::PerRevolution(1.0)), Some(60.0)));
        assert_eq!(SiUnit(0xFFB4_4700).angle(), Some(AngleUnit::PerRevolution(10.0)));
        assert_eq!(SiUnit(0x00B5_0300).seconds(), Some(1.0));
        // Metres, and no unit.
        assert_eq!((SiUnit(0x0001_0000).angle(), SiUnit(0).seconds()), (None, None));
        assert_eq!(SiUnit(0x01B5_0000).angle(), None);
    }
}
