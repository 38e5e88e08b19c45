//! Firmware packages, with valid checksums where the first byte has bit 0: what is parsed is written again.
#![no_main]

use ecan_sim::FirmwarePackage;
use libfuzzer_sys::fuzz_target;

/// Length of the header without its checksum.
const CHECKED_BYTES: usize = FirmwarePackage::HEADER_BYTES - 4;

/// CRC-32 of Ethernet, bit by bit.
fn crc32(data: &[u8]) -> u32 {
    !data.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0xEDB8_8320 }
        })
    })
}

fuzz_target!(|data: &[u8]| {
    let [choice, file @ ..] = data else { return };
    let mut file = file.to_vec();
    if choice & 1 != 0 && file.len() >= FirmwarePackage::HEADER_BYTES {
        file[..4].copy_from_slice(b"ECLA");
        let payload = crc32(&file[FirmwarePackage::HEADER_BYTES..]);
        file[20..24].copy_from_slice(&payload.to_le_bytes());
        let header = crc32(&file[..CHECKED_BYTES]);
        file[CHECKED_BYTES..FirmwarePackage::HEADER_BYTES].copy_from_slice(&header.to_le_bytes());
    }
    match FirmwarePackage::parse(&file) {
        Ok(package) => assert_eq!(package.to_bytes(), file),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
