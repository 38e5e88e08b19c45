//! The device type of a node, 0x1000 (CiA 301, 7.5.2.1; CiA 402-2, 6).

use std::fmt;

/// Value of 0x1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceType(pub u32);

impl DeviceType {
    /// Number of the device profile, for example 402; 0 without one.
    pub fn profile(self) -> u16 {
        self.0 as u16
    }

    pub fn is_drive(self) -> bool {
        self.profile() == 402
    }
}

/// Names of device profiles.
const PROFILES: [(u16, &str); 12] = [
    (401, "I/O module"),
    (402, "drive"),
    (404, "measuring device or controller"),
    (405, "programmable controller"),
    (406, "encoder"),
    (408, "proportional valve"),
    (410, "inclinometer"),
    (412, "medical device"),
    (413, "truck gateway"),
    (417, "lift control"),
    (418, "battery module"),
    (419, "battery charger"),
];

/// Kinds of drives: bits 16 to 23.
const DRIVES: [(u8, &str); 4] = [
    (0x01, "frequency converter"),
    (0x02, "servo drive"),
    (0x04, "stepper motor drive"),
    (0x08, "drive with several axes"),
];

impl fmt::Display for DeviceType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let profile = self.profile();
        if profile == 0 {
            return f.write_str("no device profile");
        }
        let name = PROFILES.iter().find(|it| it.0 == profile).map(|it| it.1);
        match name {
            Some("drive") => {
                let kind = (self.0 >> 16) as u8;
                let kind = DRIVES.iter().find(|it| it.0 == kind).map_or("drive", |it| it.1);
                write!(f, "{kind} (CiA {profile})")
            }
            Some(name) => write!(f, "{name} (CiA {profile})"),
            None => write!(f, "device profile CiA {profile}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_have_names() {
        assert_eq!(DeviceType(0x0002_0192).to_string(), "servo drive (CiA 402)");
        assert_eq!(DeviceType(0x0004_0192).to_string(), "stepper motor drive (CiA 402)");
        assert_eq!(DeviceType(0x000F_0191).to_string(), "I/O module (CiA 401)");
        assert_eq!(DeviceType(0x0000_01F4).to_string(), "device profile CiA 500");
        assert_eq!(DeviceType(0).to_string(), "no device profile");
        assert!(DeviceType(0x0192).is_drive() && !DeviceType(0x0191).is_drive());
    }
}
