//! Configurations whose bytes the application overwrote: a code, in bounded time.

use std::ffi::{CStr, c_int};

use ecan_c_boundary::result::ecan_result_t::ECAN_ERR_NOT_INITIALISED;
use ecan_igh_host::adapter::config::{
    ecan_igh_config_add_startup_sdo, ecan_igh_config_get_slave_count, ecan_igh_config_set_dc_sync0,
    ecan_igh_config_set_ecrt, ecan_igh_config_set_slave_count, ecan_igh_config_t,
    ecan_igh_default_config,
};
use ecan_igh_host::mcan_port::config::{
    igh_mcan_port_add_standard_filter, igh_mcan_port_apply_config, igh_mcan_port_check_config,
    igh_mcan_port_config_t, igh_mcan_port_default_config, igh_mcan_port_get_channel_mask,
    igh_mcan_port_set_canfd_channel,
};
use ecan_mcan_host::common::ecan_last_error;

const SLAVES: usize = 4;

/// Both configurations, filled.
struct Filled {
    igh: Box<ecan_igh_config_t>,
    port: Box<igh_mcan_port_config_t>,
}

impl Filled {
    fn new() -> Self {
        let mut igh = Box::new(ecan_igh_config_t { opaque: [0; _] });
        let mut port = Box::new(igh_mcan_port_config_t { opaque: [0; _] });
        // SAFETY: the pointers are valid.
        unsafe {
            ok(ecan_igh_default_config(&raw mut *igh));
            ok(ecan_igh_config_set_slave_count(&raw mut *igh, SLAVES));
            ok(ecan_igh_config_set_ecrt(&raw mut *igh, c"sim:echo".as_ptr()));
            ok(ecan_igh_config_set_dc_sync0(&raw mut *igh, 10_000, 700));
            let value = [1_u8, 2];
            let (data, size) = (value.as_ptr().cast(), value.len());
            ok(ecan_igh_config_add_startup_sdo(&raw mut *igh, 1, 0x2000, 1, data, size));
            ok(igh_mcan_port_default_config(&raw mut *port));
            for (slave, channel) in (0..SLAVES).flat_map(|slave| [(slave, 0), (slave, 2)]) {
                let port = &raw mut *port;
                ok(igh_mcan_port_set_canfd_channel(port, slave, channel, 500_000, 2_000_000));
                ok(igh_mcan_port_add_standard_filter(port, slave, channel, 0, 1, 0x100, 0x1FF));
            }
            ok(igh_mcan_port_apply_config(&raw mut *igh, &raw const *port));
        }
        Self { igh, port }
    }

    /// Both as bytes.
    fn bytes(&mut self) -> [&mut [u8]; 2] {
        fn of(words: &mut [u64]) -> &mut [u8] {
            // SAFETY: the bytes of integers.
            unsafe { std::slice::from_raw_parts_mut(words.as_mut_ptr().cast(), size_of_val(words)) }
        }
        [of(&mut self.igh.opaque), of(&mut self.port.opaque)]
    }

    /// Result of functions that read them.
    fn read(&self) -> [c_int; 2] {
        let (mut count, mut mask, mut fd) = (0, 0, 0);
        let (igh, port) = (&raw const *self.igh, &raw const *self.port);
        // SAFETY: the pointers are valid.
        unsafe {
            [
                ecan_igh_config_get_slave_count(igh, &raw mut count),
                igh_mcan_port_get_channel_mask(port, 0, &raw mut mask, &raw mut fd),
            ]
        }
    }

    /// Bytes of the header and the encoding; the rest is 0.
    fn used(bytes: &[u8]) -> usize {
        24 + u64::from_ne_bytes(bytes[8..16].try_into().unwrap()) as usize
    }
}

fn ok(code: c_int) {
    assert_eq!(code, 0, "{}", last_error());
}

fn last_error() -> String {
    // SAFETY: the text ends with NUL and is not changed before it was copied.
    unsafe { CStr::from_ptr(ecan_last_error()) }.to_str().unwrap().to_owned()
}

const NOT_INITIALISED: c_int = ECAN_ERR_NOT_INITIALISED.code();

#[test]
fn every_corrupted_byte_returns_a_code() {
    let mut filled = Filled::new();
    for which in 0..2 {
        let used = Filled::used(filled.bytes()[which]);
        let size = filled.bytes()[which].len();
        assert!((200..size).contains(&used), "{used} of {size}");
        for at in 0..used {
            for mask in [0x01, 0x80, 0xFF] {
                filled.bytes()[which][at] ^= mask;
                let found = filled.read();
                assert_eq!(found[which], NOT_INITIALISED, "byte {at} of {which}");
                assert_eq!(found[1 - which], 0);
                filled.bytes()[which][at] ^= mask;
            }
            if at >= 8 {
                assert!(last_error().contains("was overwritten"), "{}", last_error());
            }
        }
        for at in (used..size).step_by(97).chain([size - 1]) {
            filled.bytes()[which][at] ^= 0x10;
            assert_eq!(filled.read()[which], NOT_INITIALISED, "byte {at} of {which}");
            filled.bytes()[which][at] ^= 0x10;
        }
        assert_eq!(filled.read(), [0, 0]);
    }
}

#[test]
fn random_overwrites_return_a_code_or_change_nothing() {
    let mut random = fastrand::Rng::with_seed(17);
    let mut filled = Filled::new();
    for _ in 0..2_000 {
        let which = random.usize(0..2);
        let bytes = &mut filled.bytes()[which];
        let saved = bytes.to_vec();
        let used = Filled::used(bytes);
        let end = if random.bool() { bytes.len() } else { used };
        let start = random.usize(0..end);
        let most = (end - start).min(1 << random.u32(0..16));
        let length = random.usize(1..=most);
        for byte in &mut bytes[start..start + length] {
            *byte = random.u8(..);
        }
        let is_changed = bytes[..] != saved[..];
        let found = filled.read()[which];
        assert_eq!(found, if is_changed { NOT_INITIALISED } else { 0 }, "{start}+{length}");
        filled.bytes()[which].copy_from_slice(&saved);
    }
    assert_eq!(filled.read(), [0, 0]);
}

#[test]
fn copies_are_configurations_too() {
    let Filled { igh, port } = Filled::new();
    let (igh, port) = (Box::new(*igh), Box::new(*port));
    // SAFETY: the pointers are valid.
    ok(unsafe { igh_mcan_port_check_config(&raw const *igh, &raw const *port) });
}
