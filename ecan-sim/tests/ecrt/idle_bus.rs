//! Calls before activation, and calls with invalid handles.

use crate::ecrt_support::{Program, stepped, stepped_echo};
use ecan_host::{Errno, Master, OpenFailure, RequestState, SyncDirection, WatchdogMode};
use ecan_protocol::mapping::{Direction, data_object_index, pdo_map_index};
use ecan_protocol::object::MAPPED_SUBINDEX;
use ecan_sim::libethercat as c;
use ecan_sim::{Fault, GatewayFault, GatewaySpec, Scenario, Topology, echo};
use ecrt_sys::{EC_DIR_OUTPUT, ec_pdo_entry_info_t, ec_pdo_info_t, ec_sync_info_t};

#[test]
fn slaves_are_scanned_and_in_preop() {
    let mut scenario = echo(2);
    scenario.gateways[1].alias = 77;
    scenario.gateways[1].config.serial = 0xAB_0000_1234;
    let backend = stepped(scenario);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    let info = master.info().unwrap();
    assert_eq!((info.slave_count, info.link_up, info.scan_busy), (2, true, false));
    let state = master.state().unwrap();
    assert_eq!((state.slaves_responding, state.al_states, state.link_up), (2, 2, true));
    let slave = master.slave_info(1).unwrap();
    let config = GatewaySpec::at(1).config;
    assert_eq!((slave.vendor_id, slave.product_code), (config.vendor_id, config.product_code));
    assert_eq!((slave.alias, slave.serial_number, slave.al_state), (77, 0x1234, 2));
    assert_eq!((slave.sync_count, slave.error_flag), (4, false));
    assert_eq!(slave.ports[0].next_slave, Some(0));
    assert_eq!(master.slave_info(2).unwrap_err(), Errno::EINVAL);
    assert_eq!(master.link_state(0).unwrap().slaves_responding, 2);
    assert_eq!(master.link_state(1).unwrap_err(), Errno::EINVAL);
}

#[test]
fn only_the_default_assignment_is_known() {
    let backend = stepped_echo(1);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    let (raw, einval) = (master.as_raw(), -libc::EINVAL);
    // SAFETY: zero is valid for these plain structures.
    let (mut sync, mut pdo, mut entry): (ec_sync_info_t, ec_pdo_info_t, ec_pdo_entry_info_t) =
        unsafe { std::mem::zeroed() };
    // SAFETY: the master is the library's, and the targets are writable.
    unsafe {
        assert_eq!(c::master_get_sync_manager(raw, 0, 2, &mut sync), 0);
        assert_eq!(sync.dir, EC_DIR_OUTPUT);
        let chunks = sync.n_pdos as u16;
        assert_eq!(c::master_get_pdo(raw, 0, 2, chunks - 1, &mut pdo), 0);
        assert_eq!(pdo.index, pdo_map_index(Direction::RxPdo, chunks as u8 - 1));
        assert_eq!(c::master_get_pdo_entry(raw, 0, 2, 0, 7, &mut entry), 0);
        assert_eq!(entry.index, data_object_index(Direction::RxPdo, 0, 7));
        assert_eq!((entry.subindex, entry.bit_length), (MAPPED_SUBINDEX, 128));
        assert_eq!(c::master_get_pdo(raw, 0, 2, chunks, &mut pdo), einval);
        assert_eq!(c::master_get_sync_manager(raw, 0, 4, &mut sync), einval);
        assert_eq!(c::master_get_sync_manager(raw, 0, 0, &mut sync), 0);
    }
    assert_eq!(sync.n_pdos, 0);
}

/// Sends the reboot command before activation; returns the result and the time until the gateway
/// has left the bus, in ms.
fn reboot(reboot_delay_ms: u32) -> (Result<(), ecan_host::SdoError>, u64) {
    let mut scenario = echo(1);
    scenario.gateways[0].config.reboot_delay_ms = reboot_delay_ms;
    let backend = stepped(scenario);
    let simulation = backend.simulation.as_ref().unwrap();
    let master = Master::open(&backend.ecrt, 0).unwrap();
    let before = backend.ecrt.clock().now_ns();
    let result = master.sdo_download(0, 0x8000, 1, &[1]);
    let responds = || simulation.with_world(|world| world.gateway(0).unwrap().is_responding());
    let elapsed_ms = || (backend.ecrt.clock().now_ns() - before) / 1_000_000;
    while responds() {
        assert!(elapsed_ms() < 10_000, "no reboot");
        simulation.pass_ns(1_000_000);
    }
    (result, elapsed_ms())
}

#[test]
fn reboot_command_gets_its_response_before_the_reboot() {
    let (result, ms) = reboot(100);
    assert_eq!(result, Ok(()));
    assert!((100..=102).contains(&ms), "{ms} ms");
}

#[test]
fn reboot_without_response_is_an_error_without_abort_code() {
    let (result, _) = reboot(0);
    let failure = result.unwrap_err();
    assert_eq!((failure.errno, failure.abort_code), (Errno::EIO, None));
}

#[test]
fn response_takes_the_mailbox_delay() {
    for (mailbox_delay_ns, longest_ms) in [(200_000, 4), (50_000_000, 54)] {
        let mut scenario = echo(1);
        scenario.gateways[0].config.mailbox_delay_ns = mailbox_delay_ns;
        let backend = stepped(scenario);
        let master = Master::open(&backend.ecrt, 0).unwrap();
        let before = backend.ecrt.clock().now_ns();
        master.sdo_upload(0, 0x8010, 3, &mut [0]).unwrap();
        let elapsed_ns = backend.ecrt.clock().now_ns() - before;
        assert!((mailbox_delay_ns..longest_ms * 1_000_000).contains(&elapsed_ns), "{elapsed_ns}");
    }
}

#[test]
fn lost_response_leaves_the_value_written() {
    let backend = stepped_echo(1);
    let fault = GatewayFault::SdoResponseLost { index: 0x8010, subindex: 3, times: 1 };
    backend.simulation.as_ref().unwrap().inject(Fault::Gateway { gateway: 0, fault });
    let master = Master::request(&backend.ecrt, 0).unwrap();
    let failure = master.sdo_download(0, 0x8010, 3, &[5]).unwrap_err();
    assert_eq!((failure.errno, failure.abort_code), (Errno::EIO, None));
    let mut data = [0];
    master.sdo_upload(0, 0x8010, 3, &mut data).unwrap();
    assert_eq!(data, [5]);
}

#[test]
fn reserved_master_is_busy_but_readable() {
    let backend = stepped_echo(1);
    let owner = Master::request(&backend.ecrt, 0).unwrap();
    let error = Master::request(&backend.ecrt, 0).unwrap_err();
    assert_eq!(error.failure, OpenFailure::Busy);
    let other = Master::open(&backend.ecrt, 0).unwrap();
    assert_eq!(other.slave_info(0).unwrap().al_state, 2);
    drop(owner);
    assert!(Master::request(&backend.ecrt, 0).is_ok());
}

#[test]
fn another_program_may_hold_the_master() {
    let backend = stepped(Scenario { reserved: true, ..echo(1) });
    assert_eq!(Master::request(&backend.ecrt, 0).unwrap_err().failure, OpenFailure::Busy);
    assert!(Master::open(&backend.ecrt, 0).is_ok());
}

#[test]
fn second_master_index_does_not_exist() {
    let backend = stepped_echo(1);
    assert!(Master::request(&backend.ecrt, 1).is_err());
    assert!(Master::open(&backend.ecrt, 1).is_err());
}

#[test]
fn two_worlds_are_independent() {
    let (one, two) = (stepped_echo(1), stepped_echo(2));
    let first = Master::request(&one.ecrt, 0).unwrap();
    let second = Master::request(&two.ecrt, 0).unwrap();
    assert_eq!(first.info().unwrap().slave_count, 1);
    assert_eq!(second.info().unwrap().slave_count, 2);
    let before = two.ecrt.clock().now_ns();
    one.ecrt.clock().sleep_until_ns(one.ecrt.clock().now_ns() + 1_000_000);
    assert_eq!(two.ecrt.clock().now_ns(), before);
}

#[test]
fn blocking_transfers_take_time_and_report_aborts() {
    let backend = stepped_echo(1);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    let clock = backend.ecrt.clock();
    let before = clock.now_ns();
    let mut data = [0; 4];
    assert_eq!(master.sdo_upload(0, 0x1018, 1, &mut data).unwrap(), 4);
    assert_eq!(u32::from_le_bytes(data), GatewaySpec::at(0).config.vendor_id);
    assert!(clock.now_ns() >= before + 1_000_000);
    let error = master.sdo_upload(0, 0x5FFF, 0, &mut data).unwrap_err();
    assert_eq!((error.errno, error.abort_code), (Errno::EIO, Some(0x0602_0000)));
    let error = master.sdo_upload(0, 0x1018, 1, &mut data[..2]).unwrap_err();
    assert_eq!((error.errno, error.abort_code), (Errno::EOVERFLOW, None));
    let error = master.sdo_download(4, 0x8010, 3, &[1]).unwrap_err();
    assert_eq!((error.errno, error.abort_code), (Errno::EINVAL, None));
    master.sdo_download(0, 0x8010, 3, &[5]).unwrap();
    assert_eq!(master.sdo_upload(0, 0x8010, 3, &mut data).unwrap(), 1);
    assert_eq!(data[0], 5);
}

#[test]
fn silent_mailbox_ends_in_an_error_without_abort_code() {
    let backend = stepped_echo(1);
    let simulation = backend.simulation.as_ref().unwrap();
    let fault = GatewayFault::MailboxSilent { ms: 1_500 };
    simulation.inject(Fault::Gateway { gateway: 0, fault });
    let master = Master::open(&backend.ecrt, 0).unwrap();
    let mut data = [0; 4];
    let error = master.sdo_upload(0, 0x1018, 1, &mut data).unwrap_err();
    assert_eq!(error.errno, Errno::EIO);
    assert_eq!(error.abort_code.unwrap_or(0), 0);
    simulation.pass_ns(600_000_000);
    assert!(master.sdo_upload(0, 0x1018, 1, &mut data).is_ok());
}

#[test]
fn switched_off_slave_is_missing_in_the_scan() {
    for (topology, remaining) in [(Topology::Line, 1), (Topology::Star, 2)] {
        let backend = stepped(Scenario { topology, ..echo(3) });
        let simulation = backend.simulation.as_ref().unwrap();
        simulation.inject(Fault::PowerOff { gateway: 1 });
        simulation.pass_ns(2_000_000_000);
        let master = Master::open(&backend.ecrt, 0).unwrap();
        assert_eq!(master.info().unwrap().slave_count, remaining);
        assert_eq!(master.state().unwrap().slaves_responding, remaining);
    }
}

#[test]
fn configuration_needs_the_reserved_master_before_activation() {
    let backend = stepped_echo(1);
    let mut looking = Master::open(&backend.ecrt, 0).unwrap();
    assert!(looking.create_domain().is_err());
    assert!(looking.slave_config(0, 0, 1, 2).is_err());
    let mut program = Program::new(backend, &[1]).into_op();
    assert!(program.master.create_domain().is_err());
    let config = program.slaves[0].config;
    assert_eq!(program.master.config_sdo(config, 0x8010, 3, &[1]).unwrap_err(), Errno::EBUSY);
    assert_eq!(program.master.config_pdo_assign_clear(config, 2).unwrap_err(), Errno::EBUSY);
}

#[test]
fn unmapped_entries_and_wrong_sync_managers_are_rejected() {
    let backend = stepped_echo(1);
    let mut master = Master::request(&backend.ecrt, 0).unwrap();
    let info = master.slave_info(0).unwrap();
    let domain = master.create_domain().unwrap();
    let config = master.slave_config(0, 0, info.vendor_id, info.product_code).unwrap();
    assert_eq!(master.config_reg_pdo_entry(config, 0x7000, 9, domain).unwrap_err(), Errno::ENOENT);
    let wrong = master.config_sync_manager(config, 16, SyncDirection::Input, WatchdogMode::Default);
    assert_eq!(wrong.unwrap_err(), Errno::ENOENT);
    assert_eq!(
        master.config_pdo_mapping_add(config, 0x1777, 0x7000, 1, 128).unwrap_err(),
        Errno::ENOENT
    );
}

#[test]
fn configuration_of_the_wrong_identity_is_not_attached() {
    let backend = stepped_echo(1);
    let mut master = Master::request(&backend.ecrt, 0).unwrap();
    let config = master.slave_config(0, 0, 0xBAD, 0xBAD).unwrap();
    let far = master.slave_config(0, 9, 0xBAD, 0xBAD).unwrap();
    assert!(!master.config_state(config).unwrap().online);
    assert!(!master.config_state(far).unwrap().online);
}

#[test]
fn slaves_are_found_by_alias_and_distance() {
    let mut scenario = echo(3);
    scenario.gateways[1].alias = 500;
    let backend = stepped(scenario);
    let mut master = Master::request(&backend.ecrt, 0).unwrap();
    let info = master.slave_info(2).unwrap();
    let config = master.slave_config(500, 1, info.vendor_id, info.product_code).unwrap();
    assert!(master.config_state(config).unwrap().online);
    let beyond = master.slave_config(500, 2, info.vendor_id, info.product_code).unwrap();
    assert!(!master.config_state(beyond).unwrap().online);
}

#[test]
fn requests_run_in_parallel_with_the_cycle() {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let config = program.slaves[0].config;
    let read = program.master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
    let bad = program.master.create_sdo_request(config, 0x5FFF, 0, 4).unwrap();
    let write = program.master.create_sdo_request(config, 0x8010, 8, 1).unwrap();
    let status = program.master.create_reg_request(config, 2).unwrap();
    let mut program = program.into_op();
    assert_eq!(program.master.requests().sdo_state(read).unwrap(), RequestState::Unused);
    program.master.requests().sdo_read(read).unwrap();
    assert_eq!(program.master.requests().sdo_state(read).unwrap(), RequestState::Busy);
    program.cycle();
    assert_eq!(program.master.requests().sdo_state(read).unwrap(), RequestState::Busy);
    program.cycles(5);
    assert_eq!(program.master.requests().sdo_state(read).unwrap(), RequestState::Success);
    let vendor = GatewaySpec::at(0).config.vendor_id;
    assert_eq!(program.master.requests().sdo_data(read), vendor.to_le_bytes());
    program.master.requests().sdo_index(read, 0x1018, 2).unwrap();
    program.master.requests().sdo_read(read).unwrap();
    program.master.requests().sdo_read(bad).unwrap();
    program.master.requests().register_read(status, 0x0130, 2).unwrap();
    program.master.requests().sdo_write(write, &[2]).unwrap();
    program.cycles(18);
    assert_eq!(program.master.requests().sdo_state(read).unwrap(), RequestState::Success);
    let product = GatewaySpec::at(0).config.product_code;
    assert_eq!(program.master.requests().sdo_data(read), product.to_le_bytes());
    assert_eq!(program.master.requests().sdo_state(bad).unwrap(), RequestState::Error);
    assert_eq!(program.master.requests().register_state(status).unwrap(), RequestState::Success);
    assert_eq!(program.master.requests().register_data(status), [8, 0]);
    assert_eq!(program.master.requests().sdo_state(write).unwrap(), RequestState::Success);
}
