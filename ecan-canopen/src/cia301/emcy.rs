//! Emergency messages (CiA 301, 7.2.7), the error history 0x1003, and the texts of the error codes of CiA 402.

use core::fmt;

/// The error register, 0x1001.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ErrorRegister(pub u8);

impl ErrorRegister {
    /// Any error.
    pub const GENERIC: Self = Self(1 << 0);
    /// Current.
    pub const CURRENT: Self = Self(1 << 1);
    /// Voltage.
    pub const VOLTAGE: Self = Self(1 << 2);
    /// Temperature.
    pub const TEMPERATURE: Self = Self(1 << 3);
    /// Communication.
    pub const COMMUNICATION: Self = Self(1 << 4);
    /// Of the device profile.
    pub const PROFILE: Self = Self(1 << 5);
    /// Of the manufacturer.
    pub const MANUFACTURER: Self = Self(1 << 7);

    /// Returns whether all bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl fmt::Display for ErrorRegister {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: [(ErrorRegister, &str); 7] = [
            (ErrorRegister::GENERIC, "generic"),
            (ErrorRegister::CURRENT, "current"),
            (ErrorRegister::VOLTAGE, "voltage"),
            (ErrorRegister::TEMPERATURE, "temperature"),
            (ErrorRegister::COMMUNICATION, "communication"),
            (ErrorRegister::PROFILE, "device profile"),
            (ErrorRegister::MANUFACTURER, "manufacturer"),
        ];
        if self.0 == 0 {
            return f.write_str("no error");
        }
        let mut first = true;
        for (bit, name) in NAMES {
            if self.contains(bit) {
                if !first {
                    f.write_str(", ")?;
                }
                f.write_str(name)?;
                first = false;
            }
        }
        if first { write!(f, "0x{:02X}", self.0) } else { Ok(()) }
    }
}

ecan_protocol::text_enum! {
    /// Class of an error code: its upper half.
    pub enum EmcyClass;
    /// 0x00xx: reset, no error.
    NoError = "error reset";
    /// 0x10xx.
    Generic = "generic error";
    /// 0x20xx to 0x23xx.
    Current = "current";
    /// 0x30xx to 0x33xx.
    Voltage = "voltage";
    /// 0x40xx to 0x42xx.
    Temperature = "temperature";
    /// 0x50xx.
    Hardware = "device hardware";
    /// 0x60xx to 0x63xx.
    Software = "device software";
    /// 0x70xx.
    AdditionalModules = "additional modules";
    /// 0x80xx to 0x82xx.
    Monitoring = "monitoring";
    /// 0x90xx.
    External = "external error";
    /// 0xF0xx.
    AdditionalFunctions = "additional functions";
    /// 0xFFxx.
    DeviceSpecific = "device specific";
    /// Anything else.
    Unknown = "unknown class";
}

impl EmcyClass {
    /// The class of a code.
    pub const fn of(code: u16) -> Self {
        match code >> 8 {
            0x00 => Self::NoError,
            0x10..=0x1F => Self::Generic,
            0x20..=0x2F => Self::Current,
            0x30..=0x3F => Self::Voltage,
            0x40..=0x4F => Self::Temperature,
            0x50..=0x5F => Self::Hardware,
            0x60..=0x6F => Self::Software,
            0x70..=0x7F => Self::AdditionalModules,
            0x80..=0x8F => Self::Monitoring,
            0x90..=0x9F => Self::External,
            0xFF => Self::DeviceSpecific,
            0xF0..=0xFE => Self::AdditionalFunctions,
            _ => Self::Unknown,
        }
    }
}

/// The meaning of an error code that CiA 301 or CiA 402 names.
pub const fn error_code_text(code: u16) -> Option<&'static str> {
    Some(match code {
        0x0000 => "no error",
        0x1000 => "generic error",
        0x2000 => "current",
        0x2100 => "current at the input of the device",
        0x2110 => "short circuit or earth leakage at the input",
        0x2200 => "current inside the device",
        0x2250 => "continuous over-current inside the device",
        0x2300 => "current at the output of the device",
        0x2310 => "continuous over-current at the output",
        0x2320 => "short circuit or earth leakage at the motor",
        0x2330 => "earth leakage at the motor",
        0x2350 => "load level fault (I2t, thermal state)",
        0x3000 => "voltage",
        0x3100 => "mains voltage",
        0x3110 => "mains over-voltage",
        0x3120 => "mains under-voltage",
        0x3130 => "phase failure",
        0x3200 => "voltage inside the device",
        0x3210 => "DC link over-voltage",
        0x3220 => "DC link under-voltage",
        0x3300 => "output voltage",
        0x4000 => "temperature",
        0x4100 => "ambient temperature",
        0x4200 => "temperature of the device",
        0x4210 => "excess temperature of the device",
        0x4310 => "excess temperature of the drive",
        0x5000 => "device hardware",
        0x5100 => "supply",
        0x5441 => "contactor 1",
        0x5530 => "EEPROM fault",
        0x6000 => "device software",
        0x6010 => "software reset by watchdog",
        0x6100 => "internal software",
        0x6200 => "user software",
        0x6300 => "data set",
        0x6310 => "loss of parameters",
        0x6320 => "parameter error",
        0x7000 => "additional modules",
        0x7121 => "motor blocked",
        0x7122 => "motor error or commutation malfunction",
        0x7300 => "sensor",
        0x7305 => "incremental sensor 1 fault",
        0x7310 => "speed sensor",
        0x7320 => "position sensor",
        0x7500 => "communication",
        0x8000 => "monitoring",
        0x8100 => "CAN communication",
        0x8110 => "CAN overrun, objects lost",
        0x8120 => "CAN in error passive mode",
        0x8130 => "life guard or heartbeat error",
        0x8140 => "recovered from bus-off",
        0x8150 => "CAN identifier collision",
        0x8200 => "protocol error",
        0x8210 => "PDO not processed, length error",
        0x8220 => "PDO length exceeded",
        0x8230 => "MPDO not processed, destination object not available",
        0x8240 => "SYNC data length unexpected",
        0x8250 => "RPDO timeout",
        0x8311 => "excess torque",
        0x8331 => "torque fault",
        0x8400 => "velocity speed controller",
        0x8480 => "excess velocity",
        0x8500 => "position controller",
        0x8600 => "positioning controller",
        0x8611 => "following error",
        0x8612 => "reference limit",
        0x8680 => "speed too low",
        0x8700 => "synchronisation controller",
        0x9000 => "external error",
        0xF000 => "additional functions",
        0xF001 => "deceleration",
        0xFF00 => "device specific",
        0xFF01 => "device specific error 1",
        _ => return None,
    })
}

/// `0x8611 following error (monitoring)`; the code of a whole class has no text besides.
fn write_code(f: &mut fmt::Formatter<'_>, code: u16) -> fmt::Result {
    let class = EmcyClass::of(code);
    let is_class = code != 0 && (code & 0x0FFF == 0 || code == 0xFF00);
    match error_code_text(code) {
        Some(text) if !is_class => write!(f, "0x{code:04X} {text} ({class})"),
        _ => write!(f, "0x{code:04X} {class}"),
    }
}

/// An emergency message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Emcy {
    /// Error code; 0 when an error has gone.
    pub code: u16,
    /// Error register.
    pub register: ErrorRegister,
    /// Bytes of the manufacturer.
    pub manufacturer: [u8; 5],
}

impl Emcy {
    /// Class of the code.
    pub const fn class(&self) -> EmcyClass {
        EmcyClass::of(self.code)
    }

    /// The data of the frame.
    pub const fn to_bytes(self) -> [u8; 8] {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.manufacturer;
        [low, high, self.register.0, a, b, c, d, e]
    }

    /// Reads the data of a frame; `None` unless it has 8 bytes.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[low, high, register, a, b, c, d, e] = data else { return None };
        Some(Self {
            code: u16::from_le_bytes([low, high]),
            register: ErrorRegister(register),
            manufacturer: [a, b, c, d, e],
        })
    }
}

impl fmt::Display for Emcy {
    /// `0x8611 following error (monitoring), error register: generic, device profile`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_code(f, self.code)?;
        write!(f, ", error register: {}", self.register)
    }
}

/// Entry of the error history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HistoryEntry {
    /// Error code, as in the emergency message.
    pub code: u16,
    /// Additional information of the manufacturer.
    pub additional: u16,
}

impl HistoryEntry {
    /// Reads the value of an entry.
    pub const fn from_raw(raw: u32) -> Self {
        Self { code: raw as u16, additional: (raw >> 16) as u16 }
    }

    /// The value of the entry.
    pub const fn raw(self) -> u32 {
        let [[low, high], [add_low, add_high]] =
            [self.code.to_le_bytes(), self.additional.to_le_bytes()];
        u32::from_le_bytes([low, high, add_low, add_high])
    }

    /// Class of the code.
    pub const fn class(&self) -> EmcyClass {
        EmcyClass::of(self.code)
    }
}

/// `0x8611 following error (monitoring), additional 0x0001`
impl fmt::Display for HistoryEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_code(f, self.code)?;
        if self.additional != 0 {
            write!(f, ", additional 0x{:04X}", self.additional)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    #[test]
    fn bytes_and_words() {
        let emcy =
            Emcy { code: 0x8611, register: ErrorRegister(0x21), manufacturer: [1, 2, 3, 4, 5] };
        assert_eq!(emcy.to_bytes(), [0x11, 0x86, 0x21, 1, 2, 3, 4, 5]);
        assert_eq!(Emcy::parse(&emcy.to_bytes()), Some(emcy));
        assert_eq!(
            emcy.to_string(),
            "0x8611 following error (monitoring), error register: generic, device profile"
        );
        assert_eq!(Emcy { code: 0, ..emcy }.class(), EmcyClass::NoError);
        for (code, text) in [
            (0x0000, "0x0000 no error (error reset)"),
            (0x5000, "0x5000 device hardware"),
            (0x6200, "0x6200 user software (device software)"),
            (0x8100, "0x8100 CAN communication (monitoring)"),
            (0xFF00, "0xFF00 device specific"),
            (0xFF42, "0xFF42 device specific"),
        ] {
            assert_eq!(HistoryEntry { code, additional: 0 }.to_string(), text);
        }
        assert_eq!(Emcy::parse(&[0; 7]), None);
    }

    /// Codes that CiA 301 and CiA 402-2 name.
    const NAMED: [u16; 73] = [
        0x0000, 0x1000, 0x2000, 0x2100, 0x2110, 0x2200, 0x2250, 0x2300, 0x2310, 0x2320, 0x2330,
        0x2350, 0x3000, 0x3100, 0x3110, 0x3120, 0x3130, 0x3200, 0x3210, 0x3220, 0x3300, 0x4000,
        0x4100, 0x4200, 0x4210, 0x4310, 0x5000, 0x5100, 0x5441, 0x5530, 0x6000, 0x6010, 0x6100,
        0x6200, 0x6300, 0x6310, 0x6320, 0x7000, 0x7121, 0x7122, 0x7300, 0x7305, 0x7310, 0x7320,
        0x7500, 0x8000, 0x8100, 0x8110, 0x8120, 0x8130, 0x8140, 0x8150, 0x8200, 0x8210, 0x8220,
        0x8230, 0x8240, 0x8250, 0x8311, 0x8331, 0x8400, 0x8480, 0x8500, 0x8600, 0x8611, 0x8612,
        0x8680, 0x8700, 0x9000, 0xF000, 0xF001, 0xFF00, 0xFF01,
    ];

    #[test]
    fn named_codes_have_texts_of_their_own() {
        let texts = NAMED.map(|code| error_code_text(code).unwrap());
        for (nth, text) in texts.iter().enumerate() {
            assert!(!text.is_empty() && !texts[..nth].contains(text), "{text}");
        }
        let named = (0..=u16::MAX).filter(|code| error_code_text(*code).is_some());
        assert_eq!(named.count(), NAMED.len());
    }

    #[test]
    fn class_is_that_of_the_high_byte() {
        use EmcyClass as Class;
        for (first, last, class) in [
            (0x00, 0x00, Class::NoError),
            (0x01, 0x0F, Class::Unknown),
            (0x10, 0x1F, Class::Generic),
            (0x20, 0x2F, Class::Current),
            (0x30, 0x3F, Class::Voltage),
            (0x40, 0x4F, Class::Temperature),
            (0x50, 0x5F, Class::Hardware),
            (0x60, 0x6F, Class::Software),
            (0x70, 0x7F, Class::AdditionalModules),
            (0x80, 0x8F, Class::Monitoring),
            (0x90, 0x9F, Class::External),
            (0xA0, 0xEF, Class::Unknown),
            (0xF0, 0xFE, Class::AdditionalFunctions),
            (0xFF, 0xFF, Class::DeviceSpecific),
        ] {
            for code in [first << 8, first << 8 | 0xFF, last << 8, last << 8 | 0xFF] {
                assert_eq!(EmcyClass::of(code), class, "0x{code:04X}");
            }
        }
    }

    #[test]
    fn entry_has_code_and_additional_information() {
        let entry = HistoryEntry::from_raw(0x0001_8611);
        assert_eq!(entry, HistoryEntry { code: 0x8611, additional: 1 });
        assert_eq!(entry.raw(), 0x0001_8611);
        assert_eq!(entry.to_string(), "0x8611 following error (monitoring), additional 0x0001");
        assert_eq!(HistoryEntry::from_raw(0xFF42).to_string(), "0xFF42 device specific");
    }
}
