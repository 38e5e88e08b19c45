//! The types lie in memory as libethercat 1.6.2 (and 1.5.2) lays them out on 64-bit Linux: the
//! numbers were measured with a C compiler on IgH's own header.
#![cfg(target_pointer_width = "64")]

use std::mem::{align_of, offset_of, size_of};

use ecrt_sys::*;

macro_rules! layout {
    ($type:ident: size $size:literal, align $align:literal $(, $field:ident at $offset:literal)* $(,)?) => {{
        assert_eq!(size_of::<$type>(), $size, "size of {}", stringify!($type));
        assert_eq!(align_of::<$type>(), $align, "alignment of {}", stringify!($type));
        $( assert_eq!(
            offset_of!($type, $field), $offset,
            "offset of {}.{}", stringify!($type), stringify!($field)
        ); )*
    }};
}

#[test]
fn sizes_alignments_and_offsets() {
    layout!(ec_master_state_t: size 8, align 4, slaves_responding at 0);
    layout!(ec_master_link_state_t: size 8, align 4, slaves_responding at 0);
    layout!(ec_slave_config_state_t: size 4, align 4);
    layout!(ec_master_info_t: size 16, align 8,
        slave_count at 0, scan_busy at 5, app_time at 8);
    layout!(ec_master_scan_progress_t: size 8, align 4);
    layout!(ec_slave_port_desc_t: size 4, align 4);
    layout!(ec_slave_port_link_t: size 3, align 1);
    layout!(ec_slave_info_t: size 176, align 4,
        position at 0, vendor_id at 4, product_code at 8, revision_number at 12,
        serial_number at 16, alias at 20, current_on_ebus at 22, ports at 24, al_state at 104,
        error_flag at 105, sync_count at 106, sdo_count at 108, name at 110);
    layout!(ec_domain_state_t: size 12, align 4,
        working_counter at 0, wc_state at 4, redundancy_active at 8);
    layout!(ec_pdo_entry_info_t: size 4, align 2, index at 0, subindex at 2, bit_length at 3);
    layout!(ec_pdo_info_t: size 16, align 8, index at 0, n_entries at 4, entries at 8);
    layout!(ec_sync_info_t: size 32, align 8,
        index at 0, dir at 4, n_pdos at 8, pdos at 16, watchdog_mode at 24);
    layout!(ec_pdo_entry_reg_t: size 32, align 8,
        alias at 0, position at 2, vendor_id at 4, product_code at 8, index at 12,
        subindex at 14, offset at 16, bit_position at 24);
    layout!(ec_request_state_t: size 4, align 4);
    layout!(ec_al_state_t: size 4, align 4);
    layout!(ec_direction_t: size 4, align 4);
    layout!(ec_watchdog_mode_t: size 4, align 4);
    layout!(ec_wc_state_t: size 4, align 4);
}

#[test]
fn ports_and_name_of_a_slave() {
    let info = ec_slave_info_t::default();
    let start = (&raw const info) as usize;
    let at = |address: usize| address - start;
    assert_eq!(size_of_val(&info.ports), 80);
    assert_eq!(size_of_val(&info.name), 64);
    assert_eq!(at((&raw const info.ports[1]) as usize), 44);
    let port = &info.ports[0];
    assert_eq!(at((&raw const port.desc) as usize), 24);
    assert_eq!(at((&raw const port.link) as usize), 28);
    assert_eq!(at((&raw const port.receive_time) as usize), 32);
    assert_eq!(at((&raw const port.next_slave) as usize), 36);
    assert_eq!(at((&raw const port.delay_to_next_dc) as usize), 40);
}

/// A structure from the bytes that a C compiler gives it.
macro_rules! from_bytes {
    ($type:ident, $bytes:expr) => {{
        let bytes: [u8; size_of::<$type>()] = $bytes;
        // SAFETY: the sizes agree, and every bit pattern is valid for these plain structures.
        unsafe { std::mem::transmute::<[u8; size_of::<$type>()], $type>(bytes) }
    }};
}

#[test]
fn bits_of_the_master_state() {
    let state = from_bytes!(ec_master_state_t, [5, 1, 0, 0, 0x0f, 0, 0, 0]);
    assert_eq!((state.slaves_responding, state.al_states(), state.link_up()), (0x105, 0xf, 0));
    let state = from_bytes!(ec_master_state_t, [0, 0, 0, 0, 0x10, 0, 0, 0]);
    assert_eq!((state.al_states(), state.link_up()), (0, 1));
}

#[test]
fn bits_of_the_link_state() {
    let state = from_bytes!(ec_master_link_state_t, [0, 0, 0, 0, 0x0f, 0, 0, 0]);
    assert_eq!((state.al_states(), state.link_up()), (0xf, 0));
    let state = from_bytes!(ec_master_link_state_t, [0, 0, 0, 0, 0x10, 0, 0, 0]);
    assert_eq!((state.al_states(), state.link_up()), (0, 1));
}

#[test]
fn bits_of_the_slave_configuration_state() {
    let bits = |byte| {
        let state = from_bytes!(ec_slave_config_state_t, [byte, 0, 0, 0]);
        (state.online(), state.operational(), state.al_state())
    };
    assert_eq!(bits(0x01), (1, 0, 0));
    assert_eq!(bits(0x02), (0, 1, 0));
    assert_eq!(bits(0x3c), (0, 0, 0xf));
    assert_eq!(bits(0x23), (1, 1, 8));
}

#[test]
fn bits_of_the_master_information() {
    let mut bytes = [0; 16];
    bytes[4] = 1;
    let info = from_bytes!(ec_master_info_t, bytes);
    assert_eq!((info.link_up(), info.scan_busy), (1, 0));
    bytes[4] = 0;
    bytes[5] = 1;
    let info = from_bytes!(ec_master_info_t, bytes);
    assert_eq!((info.link_up(), info.scan_busy), (0, 1));
}

#[test]
fn values_of_the_enumerations() {
    assert_eq!(
        [EC_PORT_NOT_IMPLEMENTED, EC_PORT_NOT_CONFIGURED, EC_PORT_EBUS, EC_PORT_MII],
        [0, 1, 2, 3]
    );
    assert_eq!([EC_WC_ZERO, EC_WC_INCOMPLETE, EC_WC_COMPLETE], [0, 1, 2]);
    assert_eq!([EC_DIR_INVALID, EC_DIR_OUTPUT, EC_DIR_INPUT], [0, 1, 2]);
    assert_eq!([EC_WD_DEFAULT, EC_WD_ENABLE, EC_WD_DISABLE], [0, 1, 2]);
    assert_eq!(
        [EC_REQUEST_UNUSED, EC_REQUEST_BUSY, EC_REQUEST_SUCCESS, EC_REQUEST_ERROR],
        [0, 1, 2, 3]
    );
    assert_eq!(
        [EC_AL_STATE_INIT, EC_AL_STATE_PREOP, EC_AL_STATE_SAFEOP, EC_AL_STATE_OP],
        [1, 2, 4, 8]
    );
    assert_eq!([EC_MAX_SYNC_MANAGERS, EC_MAX_STRING_LENGTH, EC_MAX_PORTS], [16, 64, 4]);
}
