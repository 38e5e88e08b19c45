//! Deviations of a file: warnings with their line, and faults, all of them at once.

use ecan_canopen::{DataType, DataValue, DeviceFile, ObjectType};

use super::node;

/// A small device without deviations; the tests change it line by line.
const SMALL: &str = "\
; a comment
[FileInfo]
FileName=small.eds
[DeviceInfo]
VendorName=none
NrOfRXPDO=0

[MandatoryObjects]
SupportedObjects=3
1=0x1000
2=0x1001
3=0x1018

[OptionalObjects]
SupportedObjects=4
1=0x1014
2=0x2100
3=0x2101
4=0x2102

[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x00020192

[1001]
ParameterName=Error register
DataType=5
AccessType=ro

[1018]
ParameterName=Identity
ObjectType=9
SubNumber=2

[1018sub0]
ParameterName=Highest subindex
DataType=5
AccessType=const
DefaultValue=1

[1018sub1]
ParameterName=Vendor-ID
DataType=7
AccessType=ro
DefaultValue=010

[1014]
ParameterName=COB-ID EMCY
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x80

[2100]
ParameterName=Gain
DataType=0x0003
AccessType=rw
LowLimit=-100
HighLimit=0x64
DefaultValue=-5

[2101]
ParameterName=Table
ObjectType=0x8
CompactSubObj=3
DataType=0x0002
AccessType=rw
DefaultValue=0xFF

[2102]
ParameterName=Text
DataType=0x0009
AccessType=rw
DefaultValue=hello world
";

/// Line number of a text in the small device, from 1.
fn line(text: &str) -> usize {
    1 + SMALL.lines().position(|line| line == text).unwrap()
}

/// The small device with one line replaced.
fn changed(line: &str, with: &str) -> String {
    assert!(SMALL.lines().any(|l| l == line), "{line}");
    let first = SMALL.lines().position(|l| l == line);
    let lines = SMALL.lines().enumerate();
    let lines = lines.map(|(at, l)| if Some(at) == first { with } else { l });
    lines.collect::<Vec<_>>().join("\n")
}

fn read(text: &str) -> DeviceFile {
    DeviceFile::parse(text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn small_device_has_no_warning() {
    assert_eq!(read(SMALL).warnings(), []);
}

/// A line of the small device, what replaces it, the line that the warning names, and its text.
const DEVIATIONS: &str = "\
VendorName=none | VendorName | VendorName=none | line is neither [section] nor key=value; ignored
[1000] | [1000 | [1000] | section [1000 has no closing bracket; read as if it had one
[1000] | [1000] x | [1000] | text after [1000]; ignored
; a comment | key=value | ; a comment | `key` is outside any section; ignored
AccessType=const | DATATYPE=5 | AccessType=const | `DATATYPE` already exists at line 40; the first one counts
2=0x2100 | 2=0x2107 | 2=0x2100 | section [2107] of a listed object is missing; the object is left out
2=0x2100 | 2=0x1014 | 2=0x2100 | object 1014 is listed twice; read once
2=0x2100 | 2=0x1014 | [2100] | object 2100 is in no object list; read nevertheless
2=0x2100 | 2=x | 2=0x2100 | `2`: `x` is not a number; allowed: decimal, hexadecimal with 0x, octal with 0; ignored
SupportedObjects=4 | SupportedObjects=5 | SupportedObjects=4 | `SupportedObjects` of [OptionalObjects] is 5, but 4 exist; the latter counts
[MandatoryObjects] | [OtherObjects] | ; a comment | section [MandatoryObjects] is missing; read as if it were empty
[FileInfo] |  | ; a comment | section [FileInfo] is missing; read as if it were empty
[1001] | [2103] | [MandatoryObjects] | mandatory object 1001 is missing; the device is used without it
SubNumber=2 | SubNumber=3 | SubNumber=2 | object 1018 has 2 sub-objects, but `SubNumber` is 3; the former counts
SubNumber=2 |  | [1018] | [1018] has no `SubNumber`; the number of sub-objects is assumed
ObjectType=9 | ObjectType=7 | [1018] | object 1018 of type VAR has sub-objects; read as RECORD
ObjectType=9 | ObjectType=12 | ObjectType=9 | `ObjectType` = 12; allowed: 0 (NULL), 2 (DOMAIN), 5 (DEFTYPE), 6 (DEFSTRUCT), 7 (VAR), 8 (ARRAY), 9 (RECORD); RECORD is assumed
ObjectType=9 |  | [1018] | [1018] has no `ObjectType`; RECORD is assumed
ParameterName=Gain |  | [2100] | [2100] has no `ParameterName`; the index is assumed
DataType=0x0003 | DataType=0x0030 | DataType=0x0003 | unknown data type 0x0030; its values are read as bytes
DataType=0x0003 |  | [2100] | [2100] has no valid `DataType`; it is left out
DataType=0x0003 | DataType=0xZZ | [2100] | [2100] has no valid `DataType`; it is left out
CompactSubObj=3 | CompactSubObj=255 | CompactSubObj=3 | `CompactSubObj`: 255 is out of range for UNSIGNED8; allowed: 0 to 254; 254 is the most
AccessType=rw | AccessType=wr | AccessType=rw | `AccessType` = wr; allowed: const, ro, wo, rw, rwr, rww; rw is assumed
AccessType=rw |  | [1014] | [1014] has no `AccessType`; rw is assumed
LowLimit=-100 | LowLimit=101 | LowLimit=-100 | `LowLimit` 101 is above `HighLimit` 100; both are ignored
DefaultValue=-5 | DefaultValue=-101 | DefaultValue=-5 | `DefaultValue` -101 is outside the limits -100 to 100; read nevertheless
DefaultValue=-5 | DefaultValue=five | DefaultValue=-5 | `DefaultValue`: `five` is not a number; allowed: decimal, hexadecimal with 0x, octal with 0; ignored
DefaultValue=010 | DefaultValue=09 | DefaultValue=010 | `DefaultValue` = 09: invalid octal number, read as decimal
DefaultValue=0xFF | DefaultValue=0x100 | DefaultValue=0xFF | `DefaultValue`: 0x100 is out of range for INTEGER8; allowed: -128 to 127; ignored
DefaultValue=0xFF | DefaultValue=0xFFFFFFFB | DefaultValue=0xFF | `DefaultValue` = 0xFFFFFFFB: out of range, read as the bits of the value
DefaultValue=$NODEID+0x80 | DefaultValue=NODEID+1 | DefaultValue=$NODEID+0x80 | `DefaultValue` = NODEID+1: read as $NODEID
DefaultValue=$NODEID+0x80 | DefaultValue=-1 | DefaultValue=$NODEID+0x80 | `DefaultValue` = -1: out of range, read as the bits of the value
NrOfRXPDO=0 | NrOfRXPDO=none | NrOfRXPDO=0 | `NrOfRXPDO`: `none` is not a number; allowed: decimal, hexadecimal with 0x, octal with 0; ignored";

#[test]
fn every_deviation_is_a_warning_with_its_line() {
    for row in DEVIATIONS.lines() {
        let [old, new, at, text] = row.split(" | ").collect::<Vec<_>>()[..] else {
            panic!("{row}")
        };
        let file = read(&changed(old, new));
        let expected = format!("line {}: {text}", line(at));
        let warnings: Vec<_> = file.warnings().iter().map(ToString::to_string).collect();
        assert!(warnings.contains(&expected), "{old} -> {new}: {expected}: {warnings:#?}");
    }
}

#[test]
fn object_without_data_type_is_left_out_and_no_other() {
    let file = read(&changed("DataType=0x0003", "DataType=nonsense"));
    assert!(file.object(0x2100).is_none() && file.object(0x2101).is_some());
    let file = read(&changed("DefaultValue=0xFF", "DefaultValue=0xFFFFFFFB"));
    let value = file.entry(0x2101, 1).unwrap().default_value(node(5)).unwrap();
    assert_eq!(value.to_integer(), Some(-5));
    let file = read(&changed("CompactSubObj=3", "CompactSubObj=255"));
    assert_eq!(file.object(0x2101).unwrap().entries().count(), 255, "with subindex 0");
}

#[test]
fn duplicate_section_is_ignored() {
    let text = format!("{SMALL}[2100]\nParameterName=Other\nDataType=7\n[1018sub01]\nDataType=1\n");
    let file = read(&text);
    let at = SMALL.lines().count() + 1;
    let warnings: Vec<_> = file.warnings().iter().map(ToString::to_string).collect();
    assert_eq!(
        warnings,
        [
            format!(
                "line {at}: section [2100] already exists at line {}; the first one counts",
                line("[2100]")
            ),
            format!(
                "line {}: section [1018sub01] already exists at line {}; the first one counts",
                at + 3,
                line("[1018sub1]")
            ),
        ]
    );
    assert_eq!(file, read(SMALL));
}

#[test]
fn all_faults_are_reported_at_once() {
    let text = SMALL
        .replace("DefaultValue=hello world", "ParameterValue=h\u{20ac}llo")
        .replace("DefaultValue=0x00020192", "ParameterValue=0x100000000\nDefaultValue=x");
    let faults = DeviceFile::parse(text.as_bytes()).unwrap_err();
    let texts: Vec<_> = faults.faults.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "line 26: `ParameterValue`: 0x100000000 is out of range for UNSIGNED32; allowed: 0 to \
             4294967295; correct it",
            "line 77: `ParameterValue`: '€' is not a character of VISIBLE_STRING; allowed: \
             characters up to U+00FF (ISO 8859-1); correct it",
        ]
    );
    assert_eq!(faults.to_string(), texts.join("; "));
    let warnings: Vec<_> = faults.warnings.iter().map(|warning| warning.line).collect();
    assert_eq!(warnings, [27, 77]);
    for bytes in [&b""[..], b"\xEF\xBB\xBF", b"<?xml version=\"1.0\"?>", b"[FileInfo]\n"] {
        let faults = DeviceFile::parse(bytes).unwrap_err();
        assert_eq!(faults.faults.len(), 1);
        assert!(faults.to_string().starts_with("line 1: no object is described; "));
    }
}

#[test]
fn any_encoding_and_line_end_is_read() {
    let text = changed("VendorName=none", "VendorName=Gerätebau");
    let utf_8 = read(&text);
    assert_eq!(utf_8.device_info.vendor_name, "Gerätebau");
    let latin_1: Vec<u8> = text.chars().map(|character| character as u8).collect();
    let units = |bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
        format!("\u{feff}{text}").encode_utf16().flat_map(bytes).collect()
    };
    let encodings = [
        (latin_1, "line 5: character outside ASCII; read as ISO 8859-1"),
        (units(u16::to_le_bytes), "line 5: character outside ASCII; read as UTF-16"),
        (units(u16::to_be_bytes), "line 5: character outside ASCII; read as UTF-16"),
        (
            format!("\u{feff}{text}").into(),
            "line 1: byte order mark; allowed: ASCII without it; ignored",
        ),
        (
            text.replace('\n', "\r").into(),
            "line 1: line ends with CR alone; allowed: CR LF or LF; read as the end of the line",
        ),
        (text.replace('\n', "\r\n").into(), "line 5: character outside ASCII; read as UTF-8"),
        (
            text.replace("AccessType=rw", "accesstype = RW").into(),
            "line 5: character outside ASCII; read as UTF-8",
        ),
        (
            text.replace("[1018sub1]", "[1018SUB1]").into(),
            "line 5: character outside ASCII; read as UTF-8",
        ),
    ];
    for (bytes, warning) in encodings {
        let file = DeviceFile::parse(&bytes).unwrap();
        assert_eq!(file, utf_8, "{warning}");
        let warnings: Vec<_> = file.warnings().iter().map(ToString::to_string).collect();
        assert!(warnings.contains(&warning.to_owned()), "{warning}: {warnings:?}");
    }
}

#[test]
fn unusable_texts_are_kept() {
    let file = read(&changed("DefaultValue=-5", "DefaultValue=five"));
    let entry = file.entry(0x2100, 0).unwrap();
    assert_eq!(entry.default, None);
    assert_eq!(entry.extra, [("DefaultValue".to_owned(), "five".to_owned())]);
    assert!(file.write().contains("DefaultValue=five"));
}

#[test]
fn sub_objects_without_object_form_a_record() {
    let text = SMALL.replace("[1018]\nParameterName=Identity\nObjectType=9\nSubNumber=2\n", "");
    let file = read(&text);
    let object = file.object(0x1018).unwrap();
    assert_eq!(object.object_type, ObjectType::Record);
    assert_eq!(object.entries().count(), 2);
    let warning = file.warnings()[0].to_string();
    assert_eq!(warning, "line 34: [1018sub0] belongs to no object; read as part of a RECORD");
}

/// A field bus coupler of a real maker counts the sub-objects that a larger model has, and lists the
/// manufacturer's object among the optional ones.
#[test]
fn sub_number_may_count_gaps() {
    let text = format!(
        "{}[20A0]\nParameterName=status\nObjectType=0x9\nSubNumber=8\n\n[20A0sub7]\n\
         ParameterName=state\nObjectType=0x7\nDataType=0x0005\nAccessType=ro\nPDOMapping=1\n",
        SMALL.replace("SupportedObjects=4", "SupportedObjects=5\n5=0x20A0")
    );
    let file = read(&text);
    assert_eq!(file.warnings().len(), 1);
    assert_eq!(file.object(0x20A0).unwrap().entries().count(), 1);
    assert_eq!(file.entry(0x20A0, 7).unwrap().name, "state");
}

/// An editor of a free stack describes ranges by types of its own, in sections with short names.
#[test]
fn derived_types_are_simple_types() {
    let text = changed("DataType=0x0003", "DataType=0x00A0")
        + "\n[A0]\nObjectType=0x6\nSubNumber=2\nParameterName=range\n[A0sub0]\nDataType=5\n\
           ParameterName=n\nAccessType=ro\n[A0sub1]\nParameterName=type\nDataType=7\n\
           AccessType=ro\nDefaultValue=0x3\n";
    let file = read(&text);
    let entry = file.entry(0x2100, 0).unwrap();
    assert_eq!(entry.data_type, DataType::Integer16);
    assert_eq!(entry.default_value(node(1)), Some(DataValue::Signed(-5)));
    assert_eq!(file.object(0xA0).unwrap().object_type, ObjectType::DefStruct);
    let again = read(&file.write());
    assert_eq!(again, file);
}

/// A drive of a real maker has `DefaultValue=0` for texts of bytes, and numbers with suffixes of C.
#[test]
fn defaults_of_generated_files_are_tolerated() {
    let text = changed("DataType=0x0009", "DataType=0x000F");
    let file = read(&text.replace("DefaultValue=hello world", "DefaultValue=0"));
    assert_eq!(file.entry(0x2102, 0).unwrap().default, None);
    let file = read(&changed("DefaultValue=-5", "DefaultValue=0x0010L"));
    let value = file.entry(0x2100, 0).unwrap().default_value(node(1));
    assert_eq!(value, Some(DataValue::Signed(16)));
    assert_eq!(file.warnings().len(), 1);
}

/// The largest compact object: one value for each of its 254 sub-objects.
#[test]
fn largest_compact_object_is_written() {
    let values: String = (1..=254).map(|sub| format!("{sub}={}\n", sub % 100)).collect();
    let text = SMALL.replace("CompactSubObj=3", "CompactSubObj=254")
        + "[2101Value]\nNrOfEntries=254\n"
        + &values;
    let file = read(&text);
    assert_eq!(file.warnings(), []);
    let value = file.entry(0x2101, 254).unwrap().parameter_value(node(1));
    assert_eq!(value, Some(DataValue::Signed(54)));
    assert_eq!(read(&file.write()), file);
}

#[test]
fn compact_object_with_own_sub_object_is_expanded() {
    let text = format!(
        "{SMALL}[2101sub2]\nParameterName=other\nDataType=7\nAccessType=ro\n[2101Name]\n\
         NrOfEntries=2\n1=x\n7=y\n[2101Value]\nNrOfEntries=1\n1=5\n"
    );
    let file = read(&text);
    let object = file.object(0x2101).unwrap();
    assert!(!object.is_compact);
    assert_eq!(object.entry(2).unwrap().data_type, DataType::Unsigned32);
    assert_eq!(object.entry(1).unwrap().parameter_value(node(1)), Some(DataValue::Signed(5)));
    assert_eq!(read(&file.write()), file);
    // Its section says no more than the compact description, so that the object remains compact.
    let text = format!("{SMALL}[2101sub2]\nParameterName=z\n[2101Name]\n1=x\n2=y\n");
    let file = read(&text);
    let names = [1, 2].map(|sub| file.entry(0x2101, sub).unwrap().name.clone());
    assert_eq!(names, ["x", "z"]);
    assert_eq!(file.other_sections, []);
    assert_eq!(read(&file.write()), file);
    let text = SMALL.to_owned() + "[2101Name]\nNrOfEntries=2\n1=x\n7=y\n";
    let file = read(&text);
    assert_eq!(file.entry(0x2101, 1).unwrap().name, "x");
    let warning = file.warnings()[0].to_string();
    assert!(warning.ends_with("sub-object 2101:07 does not exist; ignored"), "{warning}");
}

#[test]
fn commissioning_has_two_spellings() {
    let standard = format!("{SMALL}[DeviceComissioning]\nNodeID=5\nBaudrate=250\n");
    let corrected = standard.replace("Comissioning", "Commissioning");
    let file = read(&corrected);
    assert_eq!(file, read(&standard));
    assert!(file.write().contains("[DeviceComissioning]\nNodeID=5\n"));
    let file = read(&standard.replace("NodeID=5", "NodeID=0"));
    let commissioning = file.commissioning.as_ref().unwrap();
    assert_eq!(commissioning.node_id, None);
    assert_eq!(
        file.warnings()[0].problem.to_string(),
        "`NodeID`: 0 is out of range for UNSIGNED8; allowed: 1 to 127; ignored"
    );
}

/// Files of editors count comment lines that they do not write.
#[test]
fn wrong_counts_of_other_sections_are_warnings() {
    let cases = [
        ("[Comments]\nLines=3\nLine1=a\n", "`Lines` of [Comments] is 3, but 1 exist"),
        ("[Tools]\nItems=2\n[Tool1]\nName=a\n", "`Items` of [Tools] is 2, but 1 exist"),
        (
            "[SupportedModules]\nNrOfEntries=2\n[M1ModuleInfo]\nProductName=a\n",
            "`NrOfEntries` of [SupportedModules] is 2, but 1 exist",
        ),
        (
            "[M1FixedObjects]\nNrOfEntries=0\n1=0x6000\n[M1Fixed6000]\nDataType=5\n\
             AccessType=ro\nParameterName=a\n",
            "`NrOfEntries` of [M1FixedObjects] is 0, but 1 exist",
        ),
        ("[1018Name]\nNrOfEntries=x\n", ""),
        ("[2101Name]\nNrOfEntries=x\n1=a\n", "`NrOfEntries`: `x` is not a number; "),
    ];
    for (text, warning) in cases {
        let file = read(&(SMALL.to_owned() + text));
        let warnings: Vec<_> =
            file.warnings().iter().map(|warning| warning.problem.to_string()).collect();
        match warning {
            "" => assert_eq!(warnings.len(), 0, "{text}"),
            _ => assert!(warnings.len() == 1 && warnings[0].starts_with(warning), "{warnings:?}"),
        }
        assert_eq!(read(&file.write()), file);
    }
}
