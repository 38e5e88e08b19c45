//! Sections of a device file: their names, and those with fixed entries with reader and writer from one
//! declaration (CiA 306-1, 6.6 and 8.3).

use alloc::collections::BTreeSet;
use alloc::string::String;

use super::data_type::DataType;
use super::data_value::ValueError;
use super::deviation::{FileProblem, Report};
use super::ini::{Line, Output, Section, numbered};
use super::value_text;
use crate::NodeId;

/// Field of a section.
pub(super) trait Field: Sized {
    /// Takes the entry from the section. An invalid one is reported and put back.
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self;

    fn put(&self, key: &str, out: &mut Output);
}

/// Reads a number within limits; an invalid one is reported.
pub(super) fn bounded(
    entry: &Line,
    data_type: DataType,
    (low, high): (i128, i128),
    reading: &'static str,
    report: &mut Report,
) -> Option<i128> {
    let text = entry.value.clone();
    let error = match value_text::number(&entry.value) {
        Some(number) if (low..=high).contains(&number) => return Some(number),
        Some(_) => ValueError::OutOfRange { text, data_type, low, high },
        None => ValueError::NotANumber { text },
    };
    let key = entry.key.clone();
    report.warn(entry.line, FileProblem::IgnoredValue { key, error, reading });
    None
}

fn take_number(
    section: &mut Section,
    key: &str,
    data_type: DataType,
    limits: (i128, i128),
    report: &mut Report,
) -> Option<i128> {
    let entry = section.take(key)?;
    let number = bounded(&entry, data_type, limits, "ignored", report);
    if number.is_none() {
        section.put_back(entry);
    }
    number
}

impl Field for String {
    fn take(section: &mut Section, key: &str, _report: &mut Report) -> Self {
        section.take(key).map(|entry| entry.value).unwrap_or_default()
    }

    fn put(&self, key: &str, out: &mut Output) {
        out.text(key, self);
    }
}

macro_rules! number_fields {
    ($($number:ident: $data_type:ident,)*) => {$(
        impl Field for Option<$number> {
            fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
                let limits = ($number::MIN.into(), $number::MAX.into());
                let number = take_number(section, key, DataType::$data_type, limits, report)?;
                $number::try_from(number).ok()
            }

            fn put(&self, key: &str, out: &mut Output) {
                if let Some(number) = self {
                    out.entry(key, number);
                }
            }
        }
    )*};
}

number_fields! {
    u8: Unsigned8,
    u16: Unsigned16,
    u32: Unsigned32,
}

impl Field for Option<bool> {
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
        let limits = (i128::MIN, i128::MAX);
        Some(take_number(section, key, DataType::Boolean, limits, report)? != 0)
    }

    fn put(&self, key: &str, out: &mut Output) {
        if let Some(value) = self {
            out.entry(key, u8::from(*value));
        }
    }
}

impl Field for Option<NodeId> {
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
        let limits = (NodeId::MIN.get().into(), NodeId::MAX.get().into());
        let number = take_number(section, key, DataType::Unsigned8, limits, report)?;
        u8::try_from(number).ok().and_then(NodeId::from_raw)
    }

    fn put(&self, key: &str, out: &mut Output) {
        if let Some(node) = self {
            out.entry(key, node);
        }
    }
}

/// Bit rates of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BitRates {
    /// Supported bit rates in kbit/s.
    pub kbit_per_s: BTreeSet<u16>,
}

impl BitRates {
    /// Bit rates of CiA 306-1 in kbit/s.
    pub const STANDARD: [u16; 8] = [10, 20, 50, 125, 250, 500, 800, 1000];

    /// Returns whether the device supports a bit rate, in bit/s.
    #[must_use]
    pub fn contains(&self, bit_rate: u32) -> bool {
        self.kbit_per_s.iter().any(|kbit| u32::from(*kbit) * 1000 == bit_rate)
    }
}

impl Field for BitRates {
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
        let mut rates = Self::default();
        for (rate, entry) in section.take_numbered(key) {
            if entry.value.is_empty() {
                continue;
            }
            let limits = (i128::MIN, i128::MAX);
            let flag = bounded(&entry, DataType::Boolean, limits, "not supported", report);
            if flag.is_some_and(|flag| flag != 0) {
                rates.kbit_per_s.insert(rate);
            }
        }
        rates
    }

    fn put(&self, key: &str, out: &mut Output) {
        let all = Self::STANDARD.iter().chain(&self.kbit_per_s).collect::<BTreeSet<_>>();
        for rate in all {
            let flag = u8::from(self.kbit_per_s.contains(rate));
            out.entry(&alloc::format!("{key}{rate}"), flag);
        }
    }
}

/// Declares the struct of a section: fields with their keys.
macro_rules! section_struct {
    (
        $(#[$attribute:meta])*
        $name:ident {
            $($(#[$field_attribute:meta])* $field:ident: $type:ty = $key:literal,)*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Debug, Default, PartialEq, Eq)]
        pub struct $name {
            $($(#[$field_attribute])* pub $field: $type,)*
            /// Entries that CiA 306-1 does not define, or whose value is invalid.
            pub extra: alloc::vec::Vec<(alloc::string::String, alloc::string::String)>,
        }

        impl $name {
            pub(super) fn read(
                mut section: Section,
                report: &mut Report,
            ) -> Self {
                $(let $field = Field::take(&mut section, $key, report);)*
                Self { $($field,)* extra: section.into_rest() }
            }

            pub(super) fn write(&self, out: &mut Output) {
                $(Field::put(&self.$field, $key, out);)*
                out.entries(&self.extra);
            }
        }
    };
}

section_struct! {
    /// The section `[FileInfo]`.
    FileInfo {
        /// Name of the file.
        file_name: String = "FileName",
        /// Version of the file.
        file_version: String = "FileVersion",
        /// Revision of the file.
        file_revision: String = "FileRevision",
        /// Version of CiA 306, for example `4.0`.
        eds_version: String = "EDSVersion",
        /// Description of the file.
        description: String = "Description",
        /// Time of creation, for example `09:45AM`.
        creation_time: String = "CreationTime",
        /// Date of creation as month-day-year, for example `12-31-2024`.
        creation_date: String = "CreationDate",
        /// Author.
        created_by: String = "CreatedBy",
        /// Time of the last change.
        modification_time: String = "ModificationTime",
        /// Date of the last change.
        modification_date: String = "ModificationDate",
        /// Author of the last change.
        modified_by: String = "ModifiedBy",
        /// Name of the EDS from which a DCF was made.
        last_eds: String = "LastEDS",
    }
}

section_struct! {
    /// The section `[DeviceInfo]`.
    DeviceInfo {
        /// Name of the vendor.
        vendor_name: String = "VendorName",
        /// Vendor-ID (0x1018:01).
        vendor_number: Option<u32> = "VendorNumber",
        /// Name of the product.
        product_name: String = "ProductName",
        /// Product code (0x1018:02).
        product_number: Option<u32> = "ProductNumber",
        /// Revision number (0x1018:03).
        revision_number: Option<u32> = "RevisionNumber",
        /// Order code.
        order_code: String = "OrderCode",
        /// Supported bit rates.
        bit_rates: BitRates = "BaudRate_",
        /// True if the device is a simple boot-up master.
        simple_boot_up_master: Option<bool> = "SimpleBootUpMaster",
        /// True if the device is a simple boot-up slave.
        simple_boot_up_slave: Option<bool> = "SimpleBootUpSlave",
        /// Granularity of the PDO mapping in bits; 0 if the mapping is fixed.
        granularity: Option<u8> = "Granularity",
        /// Number of dynamically creatable channels (CiA 302-4).
        dynamic_channels_supported: Option<u8> = "DynamicChannelsSupported",
        /// Sub-objects of PDO communication objects that are described in short form.
        compact_pdo: Option<u16> = "CompactPDO",
        /// True if the device supports group messaging.
        group_messaging: Option<bool> = "GroupMessaging",
        /// Number of receive PDOs.
        receive_pdos: Option<u16> = "NrOfRXPDO",
        /// Number of transmit PDOs.
        transmit_pdos: Option<u16> = "NrOfTXPDO",
        /// True if the device supports LSS (CiA 305).
        lss_supported: Option<bool> = "LSS_Supported",
    }
}

section_struct! {
    /// The section `[DeviceComissioning]` of a DCF, in the spelling of the standard.
    Commissioning {
        /// Node-ID of the device.
        node_id: Option<NodeId> = "NodeID",
        /// Name of the node.
        node_name: String = "NodeName",
        /// Reference designation of the node.
        node_reference: String = "NodeRefd",
        /// Bit rate in kbit/s.
        bit_rate_kbit: Option<u16> = "Baudrate",
        /// Number of the network.
        net_number: Option<u32> = "NetNumber",
        /// Name of the network.
        network_name: String = "NetworkName",
        /// Reference designation of the network.
        network_reference: String = "NetRefd",
        /// True if the node is the CANopen manager.
        is_manager: Option<bool> = "CANopenManager",
        /// Serial number for LSS (0x1018:04).
        lss_serial_number: Option<u32> = "LSS_SerialNumber",
    }
}

section_struct! {
    /// The section `[MxModuleInfo]`: a module that a modular device supports.
    ModuleInfo {
        /// Name of the module.
        product_name: String = "ProductName",
        /// Version of the module.
        product_version: String = "ProductVersion",
        /// Revision of the module.
        product_revision: String = "ProductRevision",
        /// Order code.
        order_code: String = "OrderCode",
    }
}

section_struct! {
    /// A section `[Toolx]`: a program for the device.
    Tool {
        /// Name of the program.
        name: String = "Name",
        /// Command line.
        command: String = "Command",
    }
}

/// Owner of an object: the device, or one of its modules by number.
pub(super) type Owner = Option<u16>;

/// Part of an object that a section describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Object,
    Sub(u8),
    Names,
    Values,
    Denotations,
    References,
    Links,
}

/// Meaning of a section's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SectionName {
    Object(Owner, u16, Part),
    /// An index with fewer than four digits, which may be another name as well.
    ShortObject(u16, Part),
    ModuleInfo(u16),
    ModuleComments(u16),
    /// A list of the objects of a module.
    ModuleList(u16),
    ModuleExtension(u16, u16),
    Tool(u16),
    Other,
}

impl SectionName {
    pub(super) fn of(name: &str) -> Self {
        let name = name.to_ascii_lowercase();
        if let Some((index, part)) = object_part(&name) {
            return Self::Object(None, index, part);
        }
        if let Some(number) = numbered(&name, "tool") {
            return Self::Tool(number);
        }
        module_part(&name).or_else(|| short_object(&name)).unwrap_or(Self::Other)
    }
}

fn module_part(name: &str) -> Option<SectionName> {
    let rest = name.strip_prefix('m')?;
    let (digits, rest) = rest.split_at(rest.find(|digit: char| !digit.is_ascii_digit())?);
    let module = digits.parse().ok()?;
    Some(match rest {
        "moduleinfo" => SectionName::ModuleInfo(module),
        "comments" => SectionName::ModuleComments(module),
        "fixedobjects" | "subextends" => SectionName::ModuleList(module),
        _ => {
            if let Some(index) = rest.strip_prefix("subext") {
                let (index, Part::Object) = object_part(index)? else { return None };
                return Some(SectionName::ModuleExtension(module, index));
            }
            let (index, part) = object_part(rest.strip_prefix("fixed")?)?;
            SectionName::Object(Some(module), index, part)
        }
    })
}

/// Part of an object with four digits, for example `1018sub1`.
fn object_part(name: &str) -> Option<(u16, Part)> {
    let (digits, rest) = name.split_at_checked(4)?;
    let index = hexadecimal(digits)?;
    let part = match rest {
        "" => Part::Object,
        "name" => Part::Names,
        "value" => Part::Values,
        "denotation" => Part::Denotations,
        "paramrefd" | "parameterrefd" => Part::References,
        "objectlinks" => Part::Links,
        _ => Part::Sub(u8::try_from(hexadecimal(rest.strip_prefix("sub")?)?).ok()?),
    };
    Some((index, part))
}

/// An object with one to three digits, for example `A0sub1`.
fn short_object(name: &str) -> Option<SectionName> {
    let (digits, part) = match name.split_once("sub") {
        Some((digits, sub)) => (digits, Part::Sub(u8::try_from(hexadecimal(sub)?).ok()?)),
        None => (name, Part::Object),
    };
    let index = hexadecimal(digits).filter(|_| digits.len() < 4)?;
    Some(SectionName::ShortObject(index, part))
}

fn hexadecimal(digits: &str) -> Option<u16> {
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_number.then(|| u16::from_str_radix(digits, 16).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_their_meaning() {
        let object = |index, part| SectionName::Object(None, index, part);
        let cases = [
            ("1018", object(0x1018, Part::Object)),
            ("1a00SUB1", object(0x1A00, Part::Sub(1))),
            ("1018subFE", object(0x1018, Part::Sub(0xFE))),
            ("1018sub01", object(0x1018, Part::Sub(1))),
            ("1018sub100", SectionName::Other),
            ("1018sub", SectionName::Other),
            ("2000Denotation", object(0x2000, Part::Denotations)),
            ("2000Value", object(0x2000, Part::Values)),
            ("2000ObjectLinks", object(0x2000, Part::Links)),
            ("A0sub1", SectionName::ShortObject(0xA0, Part::Sub(1))),
            ("A0", SectionName::ShortObject(0xA0, Part::Object)),
            ("M2ModuleInfo", SectionName::ModuleInfo(2)),
            ("M2Fixed6000sub1", SectionName::Object(Some(2), 0x6000, Part::Sub(1))),
            ("M2SubExt6000", SectionName::ModuleExtension(2, 0x6000)),
            ("M2SubExtends", SectionName::ModuleList(2)),
            ("MandatoryObjects", SectionName::Other),
            ("Tool3", SectionName::Tool(3)),
            ("Tools", SectionName::Other),
            ("Commentsé", SectionName::Other),
        ];
        for (name, meaning) in cases {
            assert_eq!(SectionName::of(name), meaning, "{name}");
        }
    }
}
