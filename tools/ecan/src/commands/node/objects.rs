//! Names of the objects of a node, of its device file and of the CiA documents.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use ecan_canopen::DataType::{
    Integer8, Integer16, Integer32, Unsigned8, Unsigned16, Unsigned32, VisibleString,
};
use ecan_canopen::{
    AccessType, DataType, DeviceFile, DeviceObject, FindError, ObjectEntry, ObjectType,
};
use ecan_protocol::text::Printable;

use super::node_target::SelectedNode;
use crate::config_file;
use crate::context::{Failure, Result, note};
use crate::value::{parse_unsigned, reject_without_prefix};

/// The option for a device file.
#[derive(Clone, Debug, Args)]
pub struct DeviceFileArguments {
    /// Device file of the node (EDS or DCF): names, types and access of its objects
    /// [default: the one of the configuration file]
    #[arg(long, value_name = "FILE")]
    eds: Option<PathBuf>,
}

impl DeviceFileArguments {
    /// The device file of the option, else of the configuration file; with its name for messages.
    ///
    /// # Errors
    /// The file cannot be read or used.
    pub fn load(&self, selected: &SelectedNode) -> Result<Option<(String, Arc<DeviceFile>)>> {
        if let Some(path) = &self.eds {
            return Ok(Some((path.display().to_string(), Arc::new(read_device_file(path)?))));
        }
        let Some(device) = selected.device() else { return Ok(None) };
        let config = selected.config.as_ref().map(|config| config.display().to_string());
        let name = match device.file_info.file_name.as_str() {
            "" => config.unwrap_or_default(),
            name => name.to_owned(),
        };
        Ok(Some((name, Arc::clone(device))))
    }
}

/// Reads a device file and reports its deviations from CiA 306.
///
/// # Errors
/// The file cannot be read or used.
pub fn read_device_file(path: &std::path::Path) -> Result<DeviceFile> {
    let bytes = config_file::read_input(path)?;
    let file = DeviceFile::parse(&bytes).map_err(|error| Failure::file("use", path, error))?;
    if let Some(summary) = file.warning_summary() {
        note(format_args!("# {}: {summary}", Printable(path.display())));
    }
    Ok(file)
}

/// Names of the objects of a node.
#[derive(Debug)]
pub struct ObjectNames {
    device: Arc<DeviceFile>,
    /// Name of the device file; `None` for the standards.
    file: Option<String>,
}

/// Object by index and subindex.
pub type ObjectKey = (u16, u8);

impl ObjectNames {
    /// Names of CiA 301 and CiA 402-2.
    pub fn standard() -> Self {
        let mut device = DeviceFile::default();
        ROWS.iter().for_each(|row| add(&mut device, row, row.0, row.4));
        for number in 0..PDOS {
            for row in PDO_ROWS {
                let name = match row.4.split_once(' ') {
                    Some((kind, rest)) => format!("{kind} {} {rest}", number + 1),
                    None => row.4.to_owned(),
                };
                add(&mut device, row, row.0 + number, &name);
            }
        }
        Self { device: Arc::new(device), file: None }
    }

    /// Names of the device file of a node, if there is one, else of the standards.
    ///
    /// # Errors
    /// The file cannot be read or used.
    pub fn of(arguments: &DeviceFileArguments, selected: &SelectedNode) -> Result<Self> {
        Ok(match arguments.load(selected)? {
            Some((name, device)) => Self { device, file: Some(name) },
            None => Self::standard(),
        })
    }

    /// The device file and its name; `None` for the standards.
    pub fn file(&self) -> Option<(&str, &DeviceFile)> {
        self.file.as_deref().map(|name| (name, &*self.device))
    }

    /// All entries, in the order of index and subindex.
    pub fn entries(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.device.entries()
    }

    pub fn entry(&self, (index, subindex): ObjectKey) -> Option<&ObjectEntry> {
        self.device.entry(index, subindex)
    }

    /// Access of an entry by the device file; the standards state none.
    pub fn access(&self, entry: &ObjectEntry) -> Option<AccessType> {
        self.file.as_ref().map(|_| entry.access)
    }

    /// Name of an object; its number if it has none.
    pub fn name(&self, key: ObjectKey) -> String {
        self.entry(key).map_or_else(|| number(key), |entry| self.device.label(entry))
    }

    /// Finds an object by `INDEX[:SUBINDEX]`, or by its names or parts of them: `OBJECT[/ENTRY]`.
    ///
    /// # Errors
    /// The text is no object, or several.
    pub fn find(&self, text: &str) -> Result<ObjectKey, String> {
        let (object, entry) = match text.split_once([':', '/']) {
            None => (text, None),
            Some((object, entry)) => (object, Some(entry)),
        };
        reject_without_prefix(object, |index| self.device.object(index).is_some())?;
        if let Some(index) = parse_unsigned(object) {
            let index = u16::try_from(index)
                .map_err(|_| format!("invalid object index {object}; allowed: 0 to 0xFFFF"))?;
            let entry = entry.unwrap_or("0");
            if let Some(subindex) = parse_unsigned(entry) {
                let wrong = |_| format!("invalid subindex {entry}; allowed: 0 to 255");
                return u8::try_from(subindex).map(|subindex| (index, subindex)).map_err(wrong);
            }
        }
        match self.device.find(text) {
            Ok(entry) => Ok((entry.index, entry.subindex)),
            Err(error @ FindError::NotFound { .. }) => self.find_parts(object, entry, &error),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Finds the only entry whose names contain these parts.
    fn find_parts(
        &self,
        object: &str,
        entry: Option<&str>,
        error: &FindError,
    ) -> Result<ObjectKey, String> {
        let index = parse_unsigned(object);
        let of_object = |candidate: &&DeviceObject| match index {
            Some(index) => u64::from(candidate.index) == index,
            None => plain(&candidate.name).contains(&plain(object)),
        };
        let objects: Vec<_> = self.device.objects().filter(of_object).collect();
        let exact: Vec<_> =
            objects.iter().copied().filter(|known| plain(&known.name) == plain(object)).collect();
        let objects = if exact.is_empty() { objects } else { exact };
        let subindex = entry.and_then(parse_unsigned);
        let is_named = |candidate: &&ObjectEntry| match (entry, subindex) {
            (None, _) => true,
            (_, Some(subindex)) => u64::from(candidate.subindex) == subindex,
            (Some(entry), None) => plain(&candidate.name).contains(&plain(entry)),
        };
        let found: Vec<_> =
            objects.iter().flat_map(|object| object.entries()).filter(is_named).collect();
        let is_same = |candidate: &&ObjectEntry| {
            entry.is_some_and(|part| plain(&candidate.name) == plain(part))
        };
        match (&found[..], found.iter().copied().find(is_same)) {
            ([only], _) => Ok((only.index, only.subindex)),
            (_, Some(exact)) if objects.len() == 1 => Ok((exact.index, exact.subindex)),
            ([], _) => Err(format!("{error}; see `ecan node sdo list`")),
            (several, _) => {
                let labels: Vec<_> =
                    several.iter().take(SHOWN).map(|object| self.device.label(object)).collect();
                let more = if several.len() > SHOWN { ", ..." } else { "" };
                Err(format!("ambiguous object; candidates: {}{more}", labels.join(", ")))
            }
        }
    }

    /// Indices of the object of this name, or of those whose names contain it.
    pub fn objects_of(&self, name: &str) -> Vec<u16> {
        let name = plain(name);
        let names = || self.device.objects().map(|object| (object.index, plain(&object.name)));
        match names().find(|object| object.1 == name) {
            Some((index, _)) => vec![index],
            None => {
                names().filter(|object| object.1.contains(&name)).map(|object| object.0).collect()
            }
        }
    }
}

/// Number of candidates in a message.
const SHOWN: usize = 8;

/// `0x6064:00`.
pub fn number((index, subindex): ObjectKey) -> String {
    format!("0x{index:04X}:{subindex:02X}")
}

/// Adds the entries of a row to an object.
fn add(device: &mut DeviceFile, row: &'static Row, index: u16, object: &str) {
    let (_, first, last, data_type, _, entry) = *row;
    if entry.is_empty() {
        device.insert(DeviceObject::variable(ObjectEntry::new(index, 0, object, data_type)));
        return;
    }
    let known = device.object(index).cloned();
    let mut record = known.unwrap_or_else(|| DeviceObject::new(index, object, ObjectType::Record));
    for subindex in first..=last {
        let name = entry.replace("{}", &subindex.to_string());
        record.insert(ObjectEntry::new(index, subindex, &name, data_type));
    }
    device.insert(record);
}

/// Normalizes a name for comparison: letters and digits, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Index, first and last subindex, type, name of the object, name of the entry (`{}` is the subindex).
pub type Row = (u16, u8, u8, DataType, &'static str, &'static str);

/// Objects with their entries, in the order of their indices. The PDOs are in [`PDO_ROWS`].
#[rustfmt::skip]
pub const ROWS: &[Row] = &[
    (0x1000, 0, 0, Unsigned32, "device type", ""),
    (0x1001, 0, 0, Unsigned8, "error register", ""),
    (0x1002, 0, 0, Unsigned32, "manufacturer status register", ""),
    (0x1003, 0, 0, Unsigned8, "error history", "number of errors"),
    (0x1003, 1, 16, Unsigned32, "error history", "error {}"),
    (0x1005, 0, 0, Unsigned32, "COB-ID SYNC", ""),
    (0x1006, 0, 0, Unsigned32, "communication cycle period", ""),
    (0x1007, 0, 0, Unsigned32, "synchronous window length", ""),
    (0x1008, 0, 0, VisibleString, "device name", ""),
    (0x1009, 0, 0, VisibleString, "hardware version", ""),
    (0x100A, 0, 0, VisibleString, "software version", ""),
    (0x100C, 0, 0, Unsigned16, "guard time", ""),
    (0x100D, 0, 0, Unsigned8, "life time factor", ""),
    (0x1010, 0, 0, Unsigned8, "store parameters", "highest subindex"),
    (0x1010, 1, 1, Unsigned32, "store parameters", "all"),
    (0x1010, 2, 2, Unsigned32, "store parameters", "communication"),
    (0x1010, 3, 3, Unsigned32, "store parameters", "application"),
    (0x1011, 0, 0, Unsigned8, "restore default parameters", "highest subindex"),
    (0x1011, 1, 1, Unsigned32, "restore default parameters", "all"),
    (0x1011, 2, 2, Unsigned32, "restore default parameters", "communication"),
    (0x1011, 3, 3, Unsigned32, "restore default parameters", "application"),
    (0x1012, 0, 0, Unsigned32, "COB-ID TIME", ""),
    (0x1014, 0, 0, Unsigned32, "COB-ID EMCY", ""),
    (0x1015, 0, 0, Unsigned16, "inhibit time EMCY", ""),
    (0x1016, 0, 0, Unsigned8, "consumer heartbeat time", "number of entries"),
    (0x1016, 1, 8, Unsigned32, "consumer heartbeat time", "entry {}"),
    (0x1017, 0, 0, Unsigned16, "producer heartbeat time", ""),
    (0x1018, 0, 0, Unsigned8, "identity", "highest subindex"),
    (0x1018, 1, 1, Unsigned32, "identity", "vendor-ID"),
    (0x1018, 2, 2, Unsigned32, "identity", "product code"),
    (0x1018, 3, 3, Unsigned32, "identity", "revision number"),
    (0x1018, 4, 4, Unsigned32, "identity", "serial number"),
    (0x1019, 0, 0, Unsigned8, "synchronous counter overflow", ""),
    (0x1020, 0, 0, Unsigned8, "verify configuration", "highest subindex"),
    (0x1020, 1, 1, Unsigned32, "verify configuration", "configuration date"),
    (0x1020, 2, 2, Unsigned32, "verify configuration", "configuration time"),
    (0x1029, 0, 0, Unsigned8, "error behaviour", "highest subindex"),
    (0x1029, 1, 1, Unsigned8, "error behaviour", "communication error"),
    (0x1200, 0, 0, Unsigned8, "SDO server parameter", "highest subindex"),
    (0x1200, 1, 1, Unsigned32, "SDO server parameter", "COB-ID client to server"),
    (0x1200, 2, 2, Unsigned32, "SDO server parameter", "COB-ID server to client"),
    (0x1F80, 0, 0, Unsigned32, "NMT startup", ""),
    (0x6007, 0, 0, Integer16, "abort connection option code", ""),
    (0x603F, 0, 0, Unsigned16, "error code", ""),
    (0x6040, 0, 0, Unsigned16, "controlword", ""),
    (0x6041, 0, 0, Unsigned16, "statusword", ""),
    (0x6042, 0, 0, Integer16, "vl target velocity", ""),
    (0x605A, 0, 0, Integer16, "quick stop option code", ""),
    (0x605B, 0, 0, Integer16, "shutdown option code", ""),
    (0x605C, 0, 0, Integer16, "disable operation option code", ""),
    (0x605D, 0, 0, Integer16, "halt option code", ""),
    (0x605E, 0, 0, Integer16, "fault reaction option code", ""),
    (0x6060, 0, 0, Integer8, "modes of operation", ""),
    (0x6061, 0, 0, Integer8, "modes of operation display", ""),
    (0x6062, 0, 0, Integer32, "position demand value", ""),
    (0x6063, 0, 0, Integer32, "position actual internal value", ""),
    (0x6064, 0, 0, Integer32, "position actual value", ""),
    (0x6065, 0, 0, Unsigned32, "following error window", ""),
    (0x6066, 0, 0, Unsigned16, "following error time out", ""),
    (0x6067, 0, 0, Unsigned32, "position window", ""),
    (0x6068, 0, 0, Unsigned16, "position window time", ""),
    (0x606B, 0, 0, Integer32, "velocity demand value", ""),
    (0x606C, 0, 0, Integer32, "velocity actual value", ""),
    (0x606D, 0, 0, Unsigned16, "velocity window", ""),
    (0x606E, 0, 0, Unsigned16, "velocity window time", ""),
    (0x606F, 0, 0, Unsigned16, "velocity threshold", ""),
    (0x6071, 0, 0, Integer16, "target torque", ""),
    (0x6072, 0, 0, Unsigned16, "max torque", ""),
    (0x6074, 0, 0, Integer16, "torque demand", ""),
    (0x6075, 0, 0, Unsigned32, "motor rated current", ""),
    (0x6076, 0, 0, Unsigned32, "motor rated torque", ""),
    (0x6077, 0, 0, Integer16, "torque actual value", ""),
    (0x6078, 0, 0, Integer16, "current actual value", ""),
    (0x6079, 0, 0, Unsigned32, "DC link circuit voltage", ""),
    (0x607A, 0, 0, Integer32, "target position", ""),
    (0x607C, 0, 0, Integer32, "home offset", ""),
    (0x607D, 0, 0, Unsigned8, "software position limit", "highest subindex"),
    (0x607D, 1, 1, Integer32, "software position limit", "minimum"),
    (0x607D, 2, 2, Integer32, "software position limit", "maximum"),
    (0x607E, 0, 0, Unsigned8, "polarity", ""),
    (0x607F, 0, 0, Unsigned32, "max profile velocity", ""),
    (0x6080, 0, 0, Unsigned32, "max motor speed", ""),
    (0x6081, 0, 0, Unsigned32, "profile velocity", ""),
    (0x6083, 0, 0, Unsigned32, "profile acceleration", ""),
    (0x6084, 0, 0, Unsigned32, "profile deceleration", ""),
    (0x6085, 0, 0, Unsigned32, "quick stop deceleration", ""),
    (0x6086, 0, 0, Integer16, "motion profile type", ""),
    (0x6087, 0, 0, Unsigned32, "torque slope", ""),
    (0x608F, 0, 0, Unsigned8, "position encoder resolution", "highest subindex"),
    (0x608F, 1, 1, Unsigned32, "position encoder resolution", "encoder increments"),
    (0x608F, 2, 2, Unsigned32, "position encoder resolution", "motor revolutions"),
    (0x6091, 0, 0, Unsigned8, "gear ratio", "highest subindex"),
    (0x6091, 1, 1, Unsigned32, "gear ratio", "motor revolutions"),
    (0x6091, 2, 2, Unsigned32, "gear ratio", "shaft revolutions"),
    (0x6092, 0, 0, Unsigned8, "feed constant", "highest subindex"),
    (0x6092, 1, 1, Unsigned32, "feed constant", "feed"),
    (0x6092, 2, 2, Unsigned32, "feed constant", "shaft revolutions"),
    (0x6098, 0, 0, Integer8, "homing method", ""),
    (0x6099, 0, 0, Unsigned8, "homing speeds", "highest subindex"),
    (0x6099, 1, 1, Unsigned32, "homing speeds", "speed to the switch"),
    (0x6099, 2, 2, Unsigned32, "homing speeds", "speed to the zero"),
    (0x609A, 0, 0, Unsigned32, "homing acceleration", ""),
    (0x60B0, 0, 0, Integer32, "position offset", ""),
    (0x60B1, 0, 0, Integer32, "velocity offset", ""),
    (0x60B2, 0, 0, Integer16, "torque offset", ""),
    (0x60B8, 0, 0, Unsigned16, "touch probe function", ""),
    (0x60B9, 0, 0, Unsigned16, "touch probe status", ""),
    (0x60C1, 0, 0, Unsigned8, "interpolation data record", "highest subindex"),
    (0x60C1, 1, 1, Integer32, "interpolation data record", "set-point 1"),
    (0x60C2, 0, 0, Unsigned8, "interpolation time period", "highest subindex"),
    (0x60C2, 1, 1, Unsigned8, "interpolation time period", "value"),
    (0x60C2, 2, 2, Integer8, "interpolation time period", "power of ten"),
    (0x60C5, 0, 0, Unsigned32, "max acceleration", ""),
    (0x60C6, 0, 0, Unsigned32, "max deceleration", ""),
    (0x60F4, 0, 0, Integer32, "following error actual value", ""),
    (0x60FC, 0, 0, Integer32, "position demand internal value", ""),
    (0x60FD, 0, 0, Unsigned32, "digital inputs", ""),
    (0x60FE, 0, 0, Unsigned8, "digital outputs", "highest subindex"),
    (0x60FE, 1, 1, Unsigned32, "digital outputs", "outputs"),
    (0x60FE, 2, 2, Unsigned32, "digital outputs", "bit mask"),
    (0x60FF, 0, 0, Integer32, "target velocity", ""),
    (0x6402, 0, 0, Unsigned16, "motor type", ""),
    (0x6502, 0, 0, Unsigned32, "supported drive modes", ""),
];

/// Entries of the communication and the mapping of a PDO: first index, subindices, type, object, entry.
#[rustfmt::skip]
pub const PDO_ROWS: &[Row] = &[
    (0x1400, 0, 0, Unsigned8, "RPDO communication", "highest subindex"),
    (0x1400, 1, 1, Unsigned32, "RPDO communication", "COB-ID"),
    (0x1400, 2, 2, Unsigned8, "RPDO communication", "transmission type"),
    (0x1400, 3, 3, Unsigned16, "RPDO communication", "inhibit time"),
    (0x1400, 5, 5, Unsigned16, "RPDO communication", "event timer"),
    (0x1400, 6, 6, Unsigned8, "RPDO communication", "SYNC start value"),
    (0x1600, 0, 0, Unsigned8, "RPDO mapping", "number of entries"),
    (0x1600, 1, 8, Unsigned32, "RPDO mapping", "entry {}"),
    (0x1800, 0, 0, Unsigned8, "TPDO communication", "highest subindex"),
    (0x1800, 1, 1, Unsigned32, "TPDO communication", "COB-ID"),
    (0x1800, 2, 2, Unsigned8, "TPDO communication", "transmission type"),
    (0x1800, 3, 3, Unsigned16, "TPDO communication", "inhibit time"),
    (0x1800, 5, 5, Unsigned16, "TPDO communication", "event timer"),
    (0x1800, 6, 6, Unsigned8, "TPDO communication", "SYNC start value"),
    (0x1A00, 0, 0, Unsigned8, "TPDO mapping", "number of entries"),
    (0x1A00, 1, 8, Unsigned32, "TPDO mapping", "entry {}"),
];

/// PDOs of each direction that the names cover.
pub const PDOS: u16 = 8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_found_by_number_and_name() {
        let names = ObjectNames::standard();
        for (text, key) in [
            ("0x6064", (0x6064, 0)),
            ("0x1018:1", (0x1018, 1)),
            ("4120:0x02", (0x1018, 2)),
            ("0x1018:serial", (0x1018, 4)),
            ("Position actual value", (0x6064, 0)),
            ("identity:vendor", (0x1018, 1)),
            ("identity/vendor-ID", (0x1018, 1)),
            ("identity:4", (0x1018, 4)),
            ("statusword", (0x6041, 0)),
            ("TPDO 2 mapping:entry 1", (0x1A01, 1)),
            ("0x2000:7", (0x2000, 7)),
        ] {
            assert_eq!(names.find(text), Ok(key), "{text}");
        }
        for (text, part) in [
            ("6064", "6064 is read as the decimal number of 0x17B0, which is no known object"),
            ("6064:0", "write 0x6064"),
            ("velocity", "ambiguous object"),
            ("identity", "has sub-objects; use one of `identity/highest subindex`"),
            ("nonsense", "ecan node sdo list"),
            ("0x10000", "invalid object index"),
            ("0x1018:256", "invalid subindex"),
            ("0x1018:colour", "no object `0x1018:colour`"),
            ("TPDO 2 mapping:entry", "ambiguous object; candidates: TPDO 2 mapping/"),
        ] {
            let error = names.find(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn standard_rows_are_in_order_and_not_repeated() {
        let rows: Vec<_> = ROWS.iter().chain(PDO_ROWS).map(|row| (row.0, row.1, row.2)).collect();
        let is_after = |a: (u16, u8, u8), b: (u16, u8, u8)| (a.0, a.2) < (b.0, b.1);
        assert!(rows[..ROWS.len()].windows(2).all(|pair| is_after(pair[0], pair[1])));
        assert!(rows[ROWS.len()..].windows(2).all(|pair| is_after(pair[0], pair[1])));
        let names = ObjectNames::standard();
        assert_eq!(names.name((0x1400, 1)), "RPDO 1 communication/COB-ID");
        assert_eq!(names.name((0x1003, 4)), "error history/error 4");
        assert_eq!(names.name((0x5FFF, 3)), "0x5FFF:03");
    }
}
