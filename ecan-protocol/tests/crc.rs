//! Both CRC kernels against the `crc` crate.

use crc::{CRC_16_IBM_3740, Crc};
use ecan_protocol::image::{crc16, crc16_is_accelerated, crc16_portable};

/// CRC-16/CCITT-FALSE by its name in the catalogue.
const ORACLE: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

const LONGEST: usize = if cfg!(miri) { 1024 } else { 4096 };
/// Distance of the lengths: Miri is slow.
const STEP: usize = if cfg!(miri) { 61 } else { 1 };

/// Bytes of a small linear congruential generator.
fn bytes(seed: u64, length: usize) -> Vec<u8> {
    let mut state = seed;
    (0..length)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        })
        .collect()
}

#[test]
fn crc_of_every_length_and_alignment() {
    if !crc16_is_accelerated() {
        println!("no carry-less multiplication here: only the table kernel is tested");
    }
    for alignment in 0..16 {
        let data = bytes(alignment as u64, LONGEST + 32);
        // The allocator decides the alignment of the vector.
        let start = (alignment + 16 - data.as_ptr() as usize % 16) % 16;
        let mut digest = ORACLE.digest();
        for length in 0..=LONGEST {
            if length.is_multiple_of(STEP) {
                let slice = &data[start..start + length];
                let expected = digest.clone().finalize();
                assert_eq!(crc16(slice), expected, "length {length} at {alignment}");
                let portable = crc16_portable(slice);
                assert_eq!(portable, expected, "length {length} at {alignment}, tables");
            }
            digest.update(&data[start + length..=start + length]);
        }
    }
}

#[test]
fn crc_changes_with_every_bit() {
    for length in [1, 2, 15, 16, 17, 31, 33, 143, 144, 145, 3048] {
        let mut data = bytes(7, length);
        for bit in 0..length * 8 {
            data[bit / 8] ^= 1 << (bit % 8);
            let expected = ORACLE.checksum(&data);
            assert_eq!(crc16(&data), expected, "length {length}, bit {bit}");
            assert_eq!(crc16_portable(&data), expected, "length {length}, bit {bit}");
            data[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

#[test]
fn crc_of_uniform_data() {
    for fill in [0x00, 0xFF] {
        for length in 0..600 {
            let data = vec![fill; length];
            assert_eq!(crc16(&data), ORACLE.checksum(&data), "{length} of {fill}");
        }
    }
}
