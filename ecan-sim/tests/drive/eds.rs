//! Electronic data sheets: parsed values and error messages.

use crate::fixture::{Fixture, MS, config};
use ecan_canopen::{DriveState, NmtCommand, OperatingMode};
use ecan_sim::{Drive, EdsError};
use proptest::prelude::*;

/// A small device; the tests change it line by line.
const SMALL: &str = "\
; a comment
[DeviceInfo]
VendorName=none

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
DataType=5
AccessType=ro

[1018]
ObjectType=9
SubNumber=2

[1018sub0]
DataType=5
AccessType=const
DefaultValue=1

[1018sub1]
DataType=7
AccessType=ro
DefaultValue=010

[1014]
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x80

[2100]
DataType=0x0003
AccessType=rw
LowLimit=-100
HighLimit=0x64
DefaultValue=-5

[2101]
ObjectType=0x8
CompactSubObj=3
DataType=0x0002
AccessType=rw
DefaultValue=0xFF

[2102]
DataType=0x0009
AccessType=rw
DefaultValue=hello world
";

fn read(text: &str) -> Result<Drive, EdsError> {
    Drive::from_eds(&config(), text)
}

#[test]
fn eds_values_are_parsed() {
    let drive = read(SMALL).unwrap();
    let number = |index, sub| drive.object(index, sub);
    assert_eq!(number(0x1000, 0), Some(0x0002_0192));
    // without a default
    assert_eq!(number(0x1001, 0), Some(0));
    // octal
    assert_eq!((number(0x1018, 0), number(0x1018, 1)), (Some(1), Some(8)));
    // node 5
    assert_eq!(number(0x1014, 0), Some(0x85));
    assert_eq!(number(0x2100, 0), Some(-5));
    // bits of a negative number; an array without a section each
    assert_eq!((number(0x2101, 0), number(0x2101, 3)), (Some(3), Some(-1)));
    assert_eq!(number(0x2101, 4), None);
    // nothing of the built-in dictionary
    assert_eq!(number(0x6040, 0), None);
    let mut fixture = Fixture::cold(drive);
    fixture.pass_ms(50);
    assert_eq!(fixture.sdo([0x40, 0x02, 0x21, 0, 0, 0, 0, 0])[4], 11);
    assert_eq!(fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]), *b"\x00hello w");
    // limits
    assert_eq!(fixture.write(0x2100, 0, 101, 2), Err(0x0609_0031));
    assert_eq!(fixture.write(0x2100, 0, -101, 2), Err(0x0609_0032));
}

#[test]
fn eds_accepts_crlf_any_case_and_byte_order_mark() {
    let text = format!(
        "\u{feff}{}",
        SMALL.replace('\n', "\r\n").replace("AccessType=rw", "accesstype=RW")
    );
    let text = text.replace("[1018sub1]", "[1018SUB1]");
    assert_eq!(read(&text).unwrap().object(0x1018, 1), Some(8));
}

/// Replaces one line and returns the error's line and text.
fn wrong(line: &str, with: &str) -> (usize, String) {
    let changed: Vec<_> = SMALL.lines().map(|l| if l == line { with } else { l }).collect();
    assert!(SMALL.lines().any(|l| l == line), "{line}");
    let error = read(&changed.join("\n")).unwrap_err();
    (error.line, error.reason)
}

/// Line number of a text in the small device, from 1.
fn line(text: &str) -> usize {
    1 + SMALL.lines().position(|line| line == text).unwrap()
}

#[test]
fn every_error_has_line_and_text() {
    let cases: [(&str, &str, &str, &str); 22] = [
        ("VendorName=none", "VendorName", "VendorName=none", "neither [section] nor key=value"),
        ("[1000]", "[1000", "[1000]", "section name without closing bracket"),
        ("[1001]", "[1000]", "[1001]", "section [1000] already exists at line 18"),
        ("; a comment", "key=value", "; a comment", "entry outside any section"),
        (
            "AccessType=const",
            "DATATYPE=5",
            "AccessType=const",
            "`DATATYPE` already exists at line 34",
        ),
        ("2=0x2100", "2=0x2107", "2=0x2100", "section [2107] is missing"),
        ("2=0x2100", "2=0x1014", "[2100]", "object 2100 is in no object list"),
        (
            "SupportedObjects=4",
            "SupportedObjects=5",
            "SupportedObjects=4",
            "[OptionalObjects] has no `5`",
        ),
        ("3=0x1018", "3=0x1000", "[1018]", "object 1018 is in no object list"),
        ("; a comment", "[1019sub1]", "; a comment", "[1019sub1] belongs to no object"),
        (
            "SubNumber=2",
            "SubNumber=3",
            "SubNumber=2",
            "object 1018 has 2 subindices; `SubNumber` is 3",
        ),
        ("SubNumber=2", "", "[1018]", "[1018] has no `SubNumber`"),
        (
            "ObjectType=9",
            "ObjectType=5",
            "ObjectType=9",
            "invalid object type 5; allowed: 2 (DOMAIN), 7 (VAR), 8 (ARRAY), 9 (RECORD)",
        ),
        (
            "ParameterName=Device type",
            "DataType=0x0030",
            "DataType=0x0007",
            "`DataType` already exists at line 19",
        ),
        ("DataType=0x0003", "DataType=0x0030", "DataType=0x0003", "unknown data type 0x0030"),
        ("DataType=0x0003", "", "[2100]", "[2100] has no `DataType`"),
        (
            "LowLimit=-100",
            "LowLimit=101",
            "LowLimit=-100",
            "the lower limit 101 is above the upper limit 100",
        ),
        (
            "DefaultValue=-5",
            "DefaultValue=-101",
            "DefaultValue=-5",
            "-101 is out of range; allowed: -100 to 100",
        ),
        ("DefaultValue=-5", "DefaultValue=five", "DefaultValue=-5", "`five` is not a number"),
        ("DefaultValue=010", "DefaultValue=09", "DefaultValue=010", "`09` is not a number"),
        (
            "DefaultValue=0xFF",
            "DefaultValue=0x100",
            "DefaultValue=0xFF",
            "0x100 is out of range; allowed: -128 to 127",
        ),
        (
            "DefaultValue=$NODEID+0x80",
            "DefaultValue=$NODE+1",
            "DefaultValue=$NODEID+0x80",
            "`$NODE+1` is not a number",
        ),
    ];
    for (old, new, at_line, expected) in cases {
        let (at, text) = wrong(old, new);
        assert_eq!(text, expected, "{old} -> {new}");
        assert_eq!(at, line(at_line), "{old} -> {new}: {text}");
    }
}

#[test]
fn invalid_access_and_missing_mandatory_object_are_reported() {
    let text = SMALL.replacen("AccessType=rw", "AccessType=wr", 1);
    let error = read(&text).unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 45: invalid access type `wr`; allowed: const, ro, wo, rw, rwr, rww"
    );
    let text = SMALL.replace("SupportedObjects=3", "SupportedObjects=2").replace("[1018", "[x1018");
    assert_eq!(read(&text).unwrap_err().reason, "mandatory object 1018 is missing");
}

proptest! {
    #[test]
    fn any_text_is_parsed_or_rejected(text in "(\\[?[0-9a-fA-Fsub]{0,8}\\]?|[a-zA-Z]{0,10}=[$0-9xA-F+-]{0,12})(\n.{0,30}){0,10}") {
        let _ = read(&text);
    }

    #[test]
    fn file_with_one_changed_line_is_parsed_or_rejected(
        at_line in 0..SMALL.lines().count(),
        with in "[\\[\\]=;0-9a-zA-Z$+-]{0,20}",
    ) {
        let lines: Vec<_> = SMALL.lines().enumerate()
            .map(|(number, line)| if number == at_line { with.as_str() } else { line })
            .collect();
        if let Err(error) = read(&lines.join("\n")) {
            prop_assert!((1..=lines.len()).contains(&error.line));
        }
    }
}

/// The EDS of a real device, if the shared data exist.
fn shared() -> Option<String> {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/cia402_slave.eds");
    let text = std::fs::read_to_string(path).ok();
    if text.is_none() {
        eprintln!("skipped: ../shared/data/cia402_slave.eds is not there");
    }
    text
}

#[test]
fn drive_from_foreign_eds_moves() {
    let Some(text) = shared() else { return };
    let mut fixture = Fixture::cold(read(&text).unwrap());
    fixture.pass_ms(50);
    fixture.lines();
    assert_eq!(fixture.read(0x1000, 0), Ok(0xFFFF_0192));
    assert_eq!(fixture.read(0x1018, 1), Ok(0x555));
    assert_eq!(fixture.read(0x1800, 1), Ok(0x8000_0185));
    assert_eq!(fixture.read(0x60C2, 2), Ok(0xFE));
    assert_eq!(fixture.read(0x6007, 0), Err(0x0602_0000));
    // defaults for values that the file leaves open
    assert_eq!(fixture.read(0x6065, 0), Ok(32_768));
    // it supports only PP, PV, HM and CSP
    assert_eq!(fixture.write(0x6060, 0, 9, 1), Err(0x0609_0030));
    fixture.write(0x60C2, 1, 1, 1).unwrap();
    fixture.write(0x60C2, 2, -3, 1).unwrap();
    fixture.map_csp();
    fixture.nmt(NmtCommand::Start);
    let mut target = 1000;
    for word in [0x06, 0x07, 0x0F] {
        fixture.cycle(word, target);
    }
    for _ in 0..1000 {
        target += 50;
        fixture.cycle(0x0F, target);
    }
    fixture.pass(100 * MS);
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    assert_eq!(fixture.drive.mode(), Some(OperatingMode::CyclicPosition));
    assert_eq!(fixture.drive.position(), target);
}
