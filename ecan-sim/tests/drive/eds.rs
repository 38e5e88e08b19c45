//! Nodes that are made from device files (EDS, DCF).

use super::fixture::{Fixture, MS, NODE, config, expand, parse_file};
use ecan_canopen::{
    Commissioning, DeviceFile, Download, DownloadScope, DriveState, NmtCommand, NmtState, NodeId,
    OperatingMode,
};
use ecan_sim::{Drive, DriveConfig};

/// A small device, in the notation of `expand`; the tests change some of its keys.
const SMALL: &str = "\
; a comment
[DeviceInfo] VendorName=none
[MandatoryObjects] SupportedObjects=3, 1=0x1000, 2=0x1001, 3=0x1018
[OptionalObjects] SupportedObjects=4, 1=0x1014, 2=0x2100, 3=0x2101, 4=0x2102
[1000] ParameterName=Device type, ObjectType=0x7, DataType=0x0007, AccessType=ro, DefaultValue=0x00020192
[1001] DataType=5, AccessType=ro
[1018] ObjectType=9, SubNumber=2
[1018sub0] DataType=5, AccessType=const, DefaultValue=1
[1018sub1] DataType=7, AccessType=ro, DefaultValue=010
[1014] DataType=0x0007, AccessType=rw, DefaultValue=$NODEID+0x80
[2100] DataType=0x0003, AccessType=rw, LowLimit=-100, HighLimit=0x64, DefaultValue=-5
[2101] ObjectType=0x8, CompactSubObj=3, DataType=0x0002, AccessType=rw, DefaultValue=0xFF
[2102] DataType=0x0009, AccessType=rw, DefaultValue=hello world
";

fn read_with(config: &DriveConfig, text: &str) -> Drive {
    Drive::from_device_file(config, &parse_file(text))
}

#[test]
fn eds_values_are_parsed() {
    let mut fixture = Fixture::from_file(SMALL);
    let number = |index, sub| fixture.drive.object(index, sub);
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
    assert_eq!(fixture.sdo([0x40, 0x02, 0x21, 0, 0, 0, 0, 0])[4], 11);
    assert_eq!(fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]), *b"\x00hello w");
    // limits
    assert_eq!(fixture.write(0x2100, 0, 101, 2), Err(0x0609_0031));
    assert_eq!(fixture.write(0x2100, 0, -101, 2), Err(0x0609_0032));
}

#[test]
fn drive_has_its_own_values_where_the_file_states_none() {
    let text = SMALL.replace("DefaultValue=0x00020192", "DefaultValue=")
        + "[6040] DataType=6, AccessType=rww\n[6041] DataType=6, AccessType=ro\n\
           [6502] DataType=7, AccessType=ro, DefaultValue=\n[6085] DataType=7, AccessType=rw, DefaultValue=7\n";
    let fixture = Fixture::from_file(&text);
    assert!(fixture.drive.is_drive());
    let number = |index| fixture.drive.object(index, 0);
    let built_in = Drive::new(&config());
    for index in [0x1000, 0x6502] {
        assert_eq!(number(index), built_in.object(index, 0), "{index:04X}");
    }
    assert_eq!((number(0x6085), number(0x1001)), (Some(7), Some(0)));
}

#[test]
fn deviations_of_file_do_not_prevent_drive() {
    let text = SMALL
        .replace("SubNumber=2", "SubNumber=9")
        .replace("SupportedObjects=4", "SupportedObjects=1")
        .replace("DefaultValue=-5", "DefaultValue=-101")
        .replace("AccessType=rw", "AccessType=wr")
        .replace("3=0x1018", "3=0x1019");
    let drive = read_with(&config(), &expand(&text).replace('\n', "\r\n"));
    assert_eq!(drive.object(0x1018, 1), Some(8));
    assert_eq!(drive.object(0x2101, 3), Some(-1));
    // outside its limits, but what the device has
    assert_eq!(drive.object(0x2100, 0), Some(-101));
}

#[test]
fn parameter_value_counts_until_defaults_are_restored() {
    let text = SMALL.replace("DefaultValue=-5", "DefaultValue=-5, ParameterValue=42")
        + "[1011] ObjectType=8, SubNumber=2\n[1011sub0] DataType=5, AccessType=ro, DefaultValue=1\n\
           [1011sub1] DataType=7, AccessType=rw\n";
    let mut fixture = Fixture::from_file(&text);
    assert_eq!(fixture.read(0x2100, 0), Ok(42));
    fixture.write(0x2100, 0, 7, 2).unwrap();
    fixture.nmt(NmtCommand::ResetNode);
    fixture.pass_ms(50);
    assert_eq!(fixture.read(0x2100, 0), Ok(42));
    // "load"
    fixture.write(0x1011, 1, 0x6461_6F6C, 4).unwrap();
    fixture.nmt(NmtCommand::ResetNode);
    fixture.pass_ms(50);
    assert_eq!(fixture.read(0x2100, 0), Ok(0xFFFB));
}

#[test]
fn open_serial_number_is_that_of_configuration() {
    let with_serial = |default: &str| {
        let sub = format!("[1018sub4] DataType=7, AccessType=ro{default}\n");
        read_with(&DriveConfig { serial: 77, ..config() }, &(SMALL.to_owned() + &sub))
    };
    assert_eq!(with_serial("").object(0x1018, 4), Some(77));
    assert_eq!(with_serial(", DefaultValue=0").object(0x1018, 4), Some(77));
    assert_eq!(with_serial(", DefaultValue=5").object(0x1018, 4), Some(5));
}

/// One file, drives of different temper.
#[test]
fn quirks_apply_to_drive_from_file() {
    let text = SMALL.replace("SubNumber=2", "SubNumber=9");
    let with = |change: fn(&mut DriveConfig)| {
        let mut config = config();
        change(&mut config);
        let mut fixture = Fixture::cold(read_with(&config, &text));
        fixture.pass_ms(u64::from(config.boot_ms));
        fixture
    };
    // slow boot
    let mut fixture = Fixture::cold(read_with(&DriveConfig { boot_ms: 8000, ..config() }, &text));
    fixture.pass_ms(7999);
    assert_eq!(fixture.lines(), []);
    fixture.pass_ms(1);
    assert_eq!(fixture.lines(), [(0x705, vec![0])]);
    // an object of the file that the device does not have
    let mut fixture = with(|config| config.quirks.missing.push(0x2100));
    assert_eq!(fixture.read(0x2100, 0), Err(0x0602_0000));
    // no block transfer: upload of 0x1018:01
    let request = [0xA4, 0x18, 0x10, 1, 0x7F, 0, 0, 0];
    let mut fixture = with(|config| config.quirks.no_block_transfer = true);
    assert_eq!(fixture.sdo(request)[0], 0x80);
    let mut fixture = with(|config| config.quirks.block_upload_falls_back = true);
    assert_eq!(fixture.sdo(request), [0x43, 0x18, 0x10, 1, 8, 0, 0, 0]);
    let mut fixture = with(|_| {});
    assert_eq!(fixture.sdo(request)[0] & 0xE1, 0xC0);
}

/// A module with eight inputs (0x6000:01) and eight outputs (0x6200:01), by CiA 401, in the notation of
/// `expand`.
pub const MODULE: &str = "\
[MandatoryObjects] SupportedObjects=3, 1=0x1000, 2=0x1001, 3=0x1018
[1000] DataType=7, AccessType=ro, DefaultValue=0x00030191
[1001] DataType=5, AccessType=ro, PDOMapping=1
[1016] ObjectType=8, CompactSubObj=1, DataType=7, AccessType=rw
[1018] ObjectType=9, CompactSubObj=4, DataType=7, AccessType=ro
[1400] ObjectType=9, SubNumber=3
[1400sub0] DataType=5, AccessType=ro, DefaultValue=2
[1400sub1] DataType=7, AccessType=rw, DefaultValue=$NODEID+0x200
[1400sub2] DataType=5, AccessType=rw, DefaultValue=255
[1600] ObjectType=9, SubNumber=2
[1600sub0] DataType=5, AccessType=rw, DefaultValue=1
[1600sub1] DataType=7, AccessType=rw, DefaultValue=0x62000108
[1800] ObjectType=9, SubNumber=3
[1800sub0] DataType=5, AccessType=ro, DefaultValue=2
[1800sub1] DataType=7, AccessType=rw, DefaultValue=$NODEID+0x180
[1800sub2] DataType=5, AccessType=rw, DefaultValue=255
[1A00] ObjectType=9, SubNumber=2
[1A00sub0] DataType=5, AccessType=rw, DefaultValue=1
[1A00sub1] DataType=7, AccessType=rw, DefaultValue=0x60000108
[6000] ObjectType=8, CompactSubObj=1, DataType=5, AccessType=ro, PDOMapping=1
[6200] ObjectType=8, CompactSubObj=1, DataType=5, AccessType=rww, PDOMapping=1
[6060] DataType=5, AccessType=rw
";

#[test]
fn module_without_motor_exchanges_process_data() {
    let mut fixture = Fixture::from_file(MODULE);
    assert!(!fixture.drive.is_drive());
    assert_eq!(fixture.lines(), [(0x705, vec![0])]);
    // The number of the modes of a drive is any object here.
    fixture.write(0x6060, 0, 99, 1).unwrap();
    assert_eq!(fixture.nmt(NmtCommand::Start), [(0x185, vec![0])]);
    assert_eq!(fixture.frame(0x205, &[0x5A]), []);
    assert_eq!(fixture.read(0x6200, 1), Ok(0x5A));
    assert!(fixture.set_object((0x6000, 1), 0x81));
    assert_eq!(fixture.lines(), [(0x185, vec![0x81])]);
    assert!(!fixture.set_object((0x6000, 2), 1));
    assert!(!fixture.set_object((0x1001, 0), 1));
    assert_eq!(fixture.read(0x1018, 4), Ok(1));
}

/// Objects of times with a wrong type and values that no time can have.
#[test]
fn times_beyond_their_range_are_the_longest() {
    let keys = "DataType=0x1B, AccessType=rw, DefaultValue=0x7FFFFFFFFFFFFFFF";
    let names =
        ["1015", "1017", "100C", "100D", "1800sub3", "1800sub5", "1400sub5", "6066", "6068"];
    // The first section with a name counts.
    let times = names.map(|name| format!("[{name}] ParameterName=t{name}, {keys}\n")).concat();
    let mut fixture = Fixture::from_file(&(times + MODULE));
    fixture.nmt(NmtCommand::Start);
    fixture.lines();
    fixture.pass_ms(65_000);
    assert_eq!(fixture.lines(), []);
    fixture.pass_ms(600);
    assert!(fixture.lines().contains(&(0x705, vec![5])), "a heartbeat after 65,535 ms");
}

#[test]
fn module_without_motor_reports_lost_host_and_runs_on() {
    let emergency = "[1014] DataType=7, AccessType=rw, DefaultValue=$NODEID+0x80\n";
    let mut fixture = Fixture::from_file(&(emergency.to_owned() + MODULE));
    // heartbeats of node 1 within 100 ms
    fixture.write(0x1016, 1, 0x0001_0064, 4).unwrap();
    fixture.nmt(NmtCommand::Start);
    fixture.frame(0x701, &[5]);
    fixture.lines();
    fixture.pass_ms(99);
    assert_eq!(fixture.lines(), []);
    fixture.pass_ms(1);
    let lines = fixture.lines();
    assert_eq!(lines.len(), 1, "{lines:02X?}");
    assert_eq!((lines[0].0, &lines[0].1[..2]), (0x085, &[0x30, 0x81][..]));
    assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational);
    fixture.nmt(NmtCommand::Start);
    assert_eq!(fixture.frame(0x205, &[0x0F]), []);
    assert_eq!(fixture.read(0x6200, 1), Ok(0x0F));
}

/// Downloads a configuration to a node that has only the defaults of the file; returns the number
/// of downloads, and those that the node aborts with their codes.
fn configure(file: &DeviceFile) -> (usize, Vec<(u16, u8, u32)>) {
    let node = NodeId::new(NODE as u8).unwrap();
    let defaults = file.to_dcf(Commissioning::default());
    let mut fixture = Fixture::cold(Drive::from_device_file(&config(), &defaults));
    fixture.pass_ms(50);
    let mut downloads = file.downloads(node, DownloadScope::Changed).unwrap();
    // The fixture has expedited transfers only.
    downloads.retain(|download| (1..=4).contains(&download.data.len()));
    let mut aborts = Vec::new();
    for Download { index, subindex, data } in &downloads {
        let value = data.iter().rev().fold(0, |value, byte| value << 8 | i64::from(*byte));
        if let Err(code) = fixture.write(*index, *subindex, value, data.len() as u8) {
            aborts.push((*index, *subindex, code));
        }
    }
    let mut configured = Fixture::cold(Drive::from_device_file(&config(), file));
    configured.pass_ms(50);
    // Where nothing was aborted, the node has what a node with this file has.
    for Download { index, subindex, .. } in downloads.iter().filter(|_| aborts.is_empty()) {
        let value = fixture.read(*index, *subindex);
        assert_eq!(value, configured.read(*index, *subindex), "{index:04X}:{subindex}");
    }
    (downloads.len(), aborts)
}

/// The node checks the order: a mapping changes only while the PDO is invalid and has no entries.
#[test]
fn node_accepts_downloads_of_dcf() {
    let text = MODULE
        .replace("=$NODEID+0x180", "=$NODEID+0x180, ParameterValue=$NODEID+0x280")
        .replace("DefaultValue=255", "DefaultValue=255, ParameterValue=1")
        .replace("DefaultValue=0x60000108", "DefaultValue=0, ParameterValue=0x10010008")
        .replace("[6060]", "[1600sub2] DataType=7, AccessType=rw\n[6060] ParameterValue=3,");
    assert_eq!(configure(&parse_file(&text)), (10, vec![]));
    // In the order of the indices the node aborts: the COB-ID of a valid PDO cannot change.
    let mut fixture = Fixture::from_file(MODULE);
    assert_eq!(fixture.write(0x1800, 1, 0x285, 4), Err(0x0601_0000));
    assert_eq!(fixture.write(0x1A00, 1, 0x1001_0008, 4), Err(0x0601_0000));
}

/// A device whose COB-IDs are constant cannot demand that they are invalid.
#[test]
fn mapping_of_constant_cob_id_changes_while_valid() {
    let text = MODULE
        .replace("AccessType=rw, DefaultValue=$", "AccessType=ro, DefaultValue=$")
        .replace("=0x60000108", "=0x60000108, ParameterValue=0x10010008");
    assert_eq!(configure(&parse_file(&text)), (3, vec![]));
}

/// Device files of other makers, in the directory that `ECAN_DEVICE_FILES` names.
#[test]
fn nodes_from_foreign_files_boot_and_answer() {
    let Some(directory) = std::env::var_os("ECAN_DEVICE_FILES").filter(|path| !path.is_empty())
    else {
        eprintln!("skipped: ECAN_DEVICE_FILES names no directory with device files");
        return;
    };
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        let Ok(file) = DeviceFile::parse(&std::fs::read(&path).unwrap()) else { continue };
        let mut fixture = Fixture::cold(Drive::from_device_file(&config(), &file));
        fixture.pass_ms(50);
        assert_eq!(fixture.lines()[..1], [(0x705, vec![0])], "{}", path.display());
        let node = NodeId::new(NODE as u8).unwrap();
        let mut uploads = 0;
        for entry in file.parameters().filter(|entry| entry.data_type.is_integer()) {
            let Some(value) = entry.configured_value(node).filter(|_| entry.index >= 0x1000) else {
                continue;
            };
            let Some(expected) = value.to_integer().filter(|_| entry.data_type.size() <= Some(4))
            else {
                continue;
            };
            // Some motion parameters must not be 0.
            if expected == 0 && entry.index >= 0x6000 {
                continue;
            }
            let found = fixture.read(entry.index, entry.subindex).unwrap();
            let mask = |number: i128| entry.data_type.mask(number as u64);
            let context = format!("{}: {:04X}:{}", path.display(), entry.index, entry.subindex);
            assert_eq!(mask(found.into()), mask(expected), "{context}");
            uploads += 1;
        }
        let (downloads, aborts) = configure(&file);
        println!(
            "{}: drive: {}, {uploads} values, {downloads} downloads, aborted: {aborts:04X?}",
            path.display(),
            fixture.drive.is_drive()
        );
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
    let file = DeviceFile::parse(text.as_bytes()).unwrap();
    let mut fixture = Fixture::cold(Drive::from_device_file(&config(), &file));
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
    fixture.writes(&[(0x60C2, 1, 1, 1), (0x60C2, 2, -3, 1)]);
    let mut target = 1000;
    fixture.start_csp(target);
    for _ in 0..1000 {
        target += 50;
        fixture.cycle(0x0F, target);
    }
    fixture.pass(100 * MS);
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    assert_eq!(fixture.drive.mode(), Some(OperatingMode::CyclicPosition));
    assert_eq!(fixture.drive.position(), target);
}

/// The example of a network describes the built-in drive, so that it can be used with it.
#[test]
fn example_file_describes_the_built_in_drive() {
    let bytes = include_bytes!("../../../examples/network/servo_drive.eds");
    let file = DeviceFile::parse(bytes).unwrap();
    assert_eq!(file.warnings(), []);
    let config = config();
    let built_in = Drive::new(&config);
    let by_file = Drive::from_device_file(&config, &file);
    for entry in file.entries() {
        let key = (entry.index, entry.subindex);
        assert_eq!(by_file.object(key.0, key.1), built_in.object(key.0, key.1), "{key:X?}");
    }
}
