//! Firmware partitions without FoE: progress, maintenance commands on the free partition, return to
//! the previous version (manual 13.7, 13.8, 15.3.1).

use super::fixture::{Fixture, MS, chunks};
use ecan_protocol::device::AlState;
use ecan_sim::{
    FirmwarePackage, FirmwarePackageError, FirmwareProgress, FirmwareUpdateError, Gateway,
    GatewayModelConfig,
};
use proptest::prelude::*;

const VALIDATE: u8 = 1 << 3;
const ACTIVATE: u8 = 1 << 4;
const OK: u32 = 0;
const DENIED: u32 = 2;
const CRC_ERROR: u32 = 3;
const IMAGE_INVALID: u32 = 4;

/// Sends a whole file, waiting for the flash.
fn update(fixture: &mut Fixture, file: &[u8]) -> Result<(), FirmwareUpdateError> {
    fixture.gateway.begin_firmware_update(fixture.now)?;
    for piece in file.chunks(1000) {
        while fixture.gateway.write_firmware(fixture.now, piece)? != FirmwareProgress::Done {
            fixture.pass(MS);
        }
    }
    while fixture.gateway.finish_firmware_update(fixture.now)? != FirmwareProgress::Done {
        fixture.pass(MS);
    }
    Ok(())
}

fn restart(fixture: &mut Fixture) {
    fixture.pass(500 * MS);
    fixture.boot();
}

fn maintain(fixture: &mut Fixture, bits: u8) -> u32 {
    fixture.write_u8(0xB000, 1, 1);
    fixture.write_u8(0xB000, 4, bits);
    fixture.pass(10 * MS);
    fixture.upload(0xB000, 5)
}

fn version(fixture: &mut Fixture) -> (u32, u32) {
    (fixture.upload(0xF000, 5), fixture.upload(0xF000, 6))
}

fn file(version: u32) -> Vec<u8> {
    FirmwarePackage::new(0, version, vec![0x5A; 10_000]).to_bytes()
}

#[test]
fn size_crc_and_status_of_the_last_file_are_shown() {
    let mut fixture = Fixture::preop();
    for subindex in 9..=11 {
        assert_eq!(fixture.upload(0xB000, subindex), 0);
    }
    let check = b"123456789";
    fixture.gateway.begin_firmware_update(fixture.now).unwrap();
    assert_eq!(fixture.upload(0xB000, 11), 1, "receiving");
    let rejected = FirmwareUpdateError::Package(FirmwarePackageError::NoHeader(9));
    assert_eq!(update(&mut fixture, check), Err(rejected));
    // the check value of CRC-32
    let shown = [9, 10, 11].map(|subindex| fixture.upload(0xB000, subindex));
    assert_eq!(shown, [9, 0xCBF4_3926, 0x8010]);
    update(&mut fixture, &file(0x0303_0003)).unwrap();
    assert_eq!((fixture.upload(0xB000, 9), fixture.upload(0xB000, 11)), (10_032, 2));
    restart(&mut fixture);
    assert_eq!((fixture.upload(0xB000, 9), fixture.upload(0xB000, 11)), (10_032, 0));
    assert_eq!(version(&mut fixture), (0x0303, 3));
    assert_eq!(fixture.try_upload(0x100A, 0).unwrap(), b"3.3.3");
}

#[test]
fn update_in_op_restarts_the_gateway() {
    let mut fixture = Fixture::op(chunks(1), chunks(1));
    fixture.gateway.set_watchdog_ns(0);
    update(&mut fixture, &file(0x0303_0003)).unwrap();
    assert_eq!(fixture.gateway.al_state(), AlState::Op);
    restart(&mut fixture);
    assert_eq!(version(&mut fixture), (0x0303, 3));
}

#[test]
fn commands_check_the_free_partition() {
    let mut fixture = Fixture::preop();
    for bits in [VALIDATE, ACTIVATE, VALIDATE | ACTIVATE] {
        assert_eq!(maintain(&mut fixture, bits), IMAGE_INVALID, "empty");
    }
    let mut damaged = file(0x0303_0003);
    damaged[5_000] ^= 1;
    assert!(update(&mut fixture, &damaged).is_err());
    assert_eq!(maintain(&mut fixture, VALIDATE), CRC_ERROR);
    assert_eq!(maintain(&mut fixture, ACTIVATE), CRC_ERROR);
    let foreign = FirmwarePackage::new(1, 1, Vec::new()).to_bytes();
    assert_eq!(update(&mut fixture, &foreign), Err(FirmwareUpdateError::WrongDevice(1)));
    assert_eq!(maintain(&mut fixture, VALIDATE), IMAGE_INVALID);
    fixture.pass(2_000 * MS);
    assert!(fixture.gateway.is_responding());
    fixture.gateway.begin_firmware_update(fixture.now).unwrap();
    assert_eq!(maintain(&mut fixture, VALIDATE), DENIED, "while a file arrives");
}

#[test]
fn activating_the_old_partition_restores_its_version() {
    let mut fixture = Fixture::preop();
    let factory = version(&mut fixture);
    update(&mut fixture, &file(0x0303_0003)).unwrap();
    restart(&mut fixture);
    assert_eq!(maintain(&mut fixture, VALIDATE), OK);
    fixture.pass(1_000 * MS);
    assert_eq!(version(&mut fixture), (0x0303, 3), "validated only");
    assert_eq!(maintain(&mut fixture, ACTIVATE), OK);
    restart(&mut fixture);
    assert_eq!(version(&mut fixture), factory);
}

#[test]
fn update_needs_a_running_gateway() {
    let mut gateway = Gateway::new(GatewayModelConfig::default(), 1);
    assert_eq!(gateway.begin_firmware_update(0), Err(FirmwareUpdateError::NotReady));
    assert_eq!(gateway.write_firmware(0, &[1]), Err(FirmwareUpdateError::NotBegun));
    assert_eq!(gateway.finish_firmware_update(0), Err(FirmwareUpdateError::NotBegun));
    gateway.abandon_firmware_update();
    assert!(FirmwarePackage::parse(gateway.running_firmware()).is_ok());
}

#[test]
fn serial_number_stays() {
    let config = GatewayModelConfig { serial: 0x1122_3344_5566_7788, ..Default::default() };
    let mut fixture = Fixture::preop_with(config);
    update(&mut fixture, &file(0x0909_0009)).unwrap();
    restart(&mut fixture);
    assert_eq!((fixture.upload(0xF000, 7), fixture.upload(0xF000, 8)), (0x5566_7788, 0x1122_3344));
}

#[test]
fn golden_bytes_of_a_package() {
    let file = FirmwarePackage::new(0x12, 0x0203_0405, b"123456789".to_vec()).to_bytes();
    let expected: [u8; 28] = [
        b'E', b'C', b'L', b'A', 32, 0, 0, 0, 0, 0, 0, 0x12, 5, 4, 3, 2, 9, 0, 0, 0, 0x26, 0x39,
        0xF4, 0xCB, 0, 0, 0, 0,
    ];
    assert_eq!(file[..28], expected);
    assert_eq!(&file[32..], b"123456789");
}

proptest! {
    #[test]
    fn what_is_written_is_read(device: u8, version: u32, payload: Vec<u8>) {
        let package = FirmwarePackage::new(device, version, payload);
        let file = package.to_bytes();
        prop_assert_eq!(FirmwarePackage::parse(&file), Ok(package));
    }

    #[test]
    fn every_changed_bit_is_noticed(payload: Vec<u8>, at: prop::sample::Index, bit in 0u8..8) {
        let mut file = FirmwarePackage::new(0, 1, payload).to_bytes();
        let at = at.index(file.len());
        file[at] ^= 1 << bit;
        prop_assert!(FirmwarePackage::parse(&file).is_err());
    }

    #[test]
    fn any_bytes_are_parsed_or_rejected(bytes: Vec<u8>, cut in 0usize..40) {
        prop_assert!(FirmwarePackage::parse(&bytes).is_err());
        let file = FirmwarePackage::new(0, 1, bytes).to_bytes();
        let short = &file[..cut.min(file.len() - 1)];
        prop_assert!(FirmwarePackage::parse(short).is_err());
    }
}
