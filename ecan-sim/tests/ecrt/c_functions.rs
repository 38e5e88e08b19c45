//! The functions that only C programs call: lists, positions, whole objects, registers,
//! reservation.

use std::ptr::{null, null_mut};

use super::c_master::{CMaster, stepped_echo};
use ecan_sim::libethercat as c;
use ecrt_sys::{EC_REQUEST_BUSY, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, Errno};

const PREOP: u8 = 2;
const SAFEOP: u8 = 4;

#[test]
fn lists_of_pdos_and_entries_bring_a_slave_to_op() {
    let program = CMaster::configured();
    assert_eq!(program.register_by_list(), (0, [0, 128]));
    program.activate();
    assert!(program.reaches_op(), "{}", program.log());
}

#[test]
fn entry_is_found_by_position_and_by_object() {
    let program = CMaster::configured();
    let (config, domain) = (program.config, program.domain);
    let at = |sync, pdo, entry| {
        let mut bit = u32::MAX;
        // SAFETY: the handles are the library's, the pointer is valid.
        let byte = unsafe {
            c::slave_config_reg_pdo_entry_pos(config, sync, pdo, entry, domain, &mut bit)
        };
        (byte, bit)
    };
    assert_eq!(at(2, 0, 3), (48, 0));
    assert_eq!(at(3, 0, 7), (128 + 112, 0));
    // SAFETY: as above.
    let by_object = unsafe { c::slave_config_reg_pdo_entry(config, 0x7030, 1, domain, null_mut()) };
    assert_eq!(by_object, 48);
    let nowhere = (-libc::ENOENT, u32::MAX);
    assert_eq!([at(2, 1, 0), at(2, 0, 8), at(5, 0, 0)], [nowhere; 3]);
    assert_eq!(at(16, 0, 0), (-libc::EINVAL, u32::MAX));
}

#[test]
fn entry_inside_a_byte_needs_a_bit_position() {
    let program = CMaster::configured();
    let (config, domain) = (program.config, program.domain);
    let mut bit = 0;
    // SAFETY: the handles are the library's, the pointer is valid.
    unsafe {
        assert_eq!(c::slave_config_pdo_mapping_clear(config, 0x1600), 0);
        assert_eq!(c::slave_config_pdo_mapping_add(config, 0x1600, 0x7000, 1, 3), 0);
        assert_eq!(c::slave_config_pdo_mapping_add(config, 0x1600, 0x7010, 1, 8), 0);
        let rejected = c::slave_config_reg_pdo_entry(config, 0x7010, 1, domain, null_mut());
        assert_eq!(rejected, -libc::EFAULT);
        assert_eq!(c::slave_config_reg_pdo_entry(config, 0x7010, 1, domain, &mut bit), 0);
    }
    assert_eq!(bit, 3);
}

#[test]
fn list_with_an_unmapped_entry_or_other_device_fails() {
    let mut program = CMaster::configured();
    program.product_code += 1;
    assert_eq!(program.register_by_list(), (-libc::ENOENT, [u32::MAX; 2]));
    // SAFETY: the handles are the library's; null lists are allowed where IgH allows them.
    unsafe {
        assert_eq!(c::slave_config_pdos(program.config, 3, null()), 0);
        assert_eq!(c::domain_reg_pdo_entry_list(program.domain, null()), -libc::EFAULT);
    }
}

#[test]
fn one_handle_at_a_time_reserves_the_master() {
    let simulation = stepped_echo();
    let first = c::open_master(&simulation, 0);
    // SAFETY: the handles are the library's.
    unsafe {
        assert_eq!(c::master_reset(first), -libc::EPERM);
        assert_eq!(c::master_reserve(first), 0);
        assert_eq!(c::master_reserve(first), -libc::EBUSY);
        assert!(c::request_master(&simulation, 0).is_null());
        assert_eq!(Errno::last(), Errno::EBUSY);
        c::release_master(first);
        let second = c::request_master(&simulation, 0);
        assert!(!second.is_null());
        c::release_master(second);
    }
    assert!(c::open_master(&simulation, 1).is_null());
    assert_eq!(Errno::last(), Errno::ENOENT);
}

#[test]
fn complete_access_is_aborted() {
    let program = CMaster::configured();
    let (data, mut abort_code) = ([8u8, 0, 0, 0], 0);
    // SAFETY: the handle is the library's, the data and the pointer are valid.
    let result = unsafe {
        let (first, size) = (data.as_ptr(), data.len());
        c::master_sdo_download_complete(program.master, 0, 0x8010, first, size, &mut abort_code)
    };
    assert_eq!((result, abort_code), (-libc::EIO, 0x0601_0000));
}

#[test]
fn gateway_with_complete_access_takes_a_whole_object() {
    let mut scenario = ecan_sim::echo(1);
    scenario.gateways[0].config.complete_access = true;
    let program = CMaster::in_scenario(scenario);
    let (data, mut abort_code) = ([2u8, 0, 0x05, 0x16, 0x07, 0x16], 0);
    // SAFETY: the handle is the library's, the data and the pointers are valid.
    unsafe {
        let (first, size) = (data.as_ptr(), data.len());
        let result = c::master_sdo_download_complete(
            program.master,
            0,
            0x1C12,
            first,
            size,
            &mut abort_code,
        );
        assert_eq!((result, abort_code), (0, 0));
        let (mut chunk, mut length) = ([0u8; 2], 0);
        let target = chunk.as_mut_ptr();
        let (length, code) = (&mut length, &mut abort_code);
        let result = c::master_sdo_upload(program.master, 0, 0x1C12, 2, target, 2, length, code);
        assert_eq!((result, u16::from_le_bytes(chunk)), (0, 0x1607));
    }
}

#[test]
fn startup_complete_access_keeps_the_slave_in_preop() {
    let program = CMaster::configured();
    program.register_by_list();
    let data = [8u8, 0, 0, 0];
    // SAFETY: the handle is the library's, the data are there.
    let result =
        unsafe { c::slave_config_complete_sdo(program.config, 0x8010, data.as_ptr(), data.len()) };
    assert_eq!(result, 0);
    program.activate();
    assert_eq!(program.ends_without_op(), (PREOP, true));
    assert!(program.log().contains("startup SDO 0x8010"), "{}", program.log());
}

#[test]
fn master_reset_restarts_a_failed_slave() {
    let program = CMaster::configured();
    program.register_by_list();
    let fault = ecan_sim::GatewayFault::SdoAbort {
        index: 0x8010,
        subindex: 1,
        code: 0x0800_0022,
        times: 1,
    };
    program.simulation.inject(ecan_sim::Fault::Gateway { gateway: 0, fault });
    program.activate();
    assert_eq!(program.ends_without_op(), (PREOP, true));
    // SAFETY: the handle is the library's.
    assert_eq!(unsafe { c::master_reset(program.master) }, 0);
    assert!(program.reaches_op(), "{}", program.log());
}

#[test]
fn written_register_takes_effect() {
    let program = CMaster::configured();
    program.register_by_list();
    // SAFETY: the handles are the library's, the request's memory has two bytes.
    unsafe {
        let request = c::slave_config_create_reg_request(program.config, 2);
        assert_eq!(c::reg_request_state(request), EC_REQUEST_UNUSED);
        assert_eq!(c::reg_request_write(request, 0x0120, 3), -libc::ENOBUFS);
        program.activate();
        assert!(program.reaches_op(), "{}", program.log());
        let data = c::reg_request_data(request);
        data.write(SAFEOP);
        assert_eq!(c::reg_request_write(request, 0x0120, 2), 0);
        while c::reg_request_state(request) == EC_REQUEST_BUSY {
            program.cycle();
        }
        assert_eq!(c::reg_request_state(request), EC_REQUEST_SUCCESS);
        assert_eq!(c::reg_request_read(request, 0x0130, 2), 0);
        while c::reg_request_state(request) == EC_REQUEST_BUSY {
            program.cycle();
        }
        assert_eq!(data.read(), SAFEOP);
    }
}

#[test]
fn slave_without_emergencies_has_none() {
    let program = CMaster::configured();
    let mut message = [0xEE; 8];
    // SAFETY: the handle is the library's, a message has room for its eight bytes.
    unsafe {
        assert_eq!(c::slave_config_emerg_size(program.config, 10), 0);
        let popped = c::slave_config_emerg_pop(program.config, message.as_mut_ptr());
        assert_eq!(popped, -libc::ENOENT);
        assert_eq!(c::slave_config_emerg_overruns(program.config), 0);
        assert_eq!(c::slave_config_emerg_clear(program.config), 0);
    }
    assert_eq!(message, [0xEE; 8]);
}

#[test]
fn configuration_flag_without_a_name_is_invalid() {
    let program = CMaster::configured();
    // SAFETY: the handle is the library's, the text ends with a zero.
    let result = unsafe { c::slave_config_flag(program.config, c"".as_ptr(), 1) };
    assert_eq!(result, -libc::EINVAL);
}
