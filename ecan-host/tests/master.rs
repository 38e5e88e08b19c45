//! The safe handles behave the same on a library of 1.5, whose functions return nothing, and on one
//! of 1.6, whose functions return a status; opening a master reports the cause of each failure.

use crate::fake::{Fake, RELEASES, assert_contains};
use ecan_host::{
    DomainState, Errno, LinkState, Master, MasterInfo, MasterState, OpenFailure, PortKind,
    RequestState, SdoError, SlaveConfigState, SyncDirection, WatchdogMode, WcState,
};

/// What the fake counts, see the enumeration there.
#[derive(Clone, Copy)]
pub enum Count {
    Released,
    Sent,
    Received,
    Queued,
    Deactivated,
    Written,
}

/// How often something happened in the fake, over all its masters.
pub fn count(master: &Master, what: Count) -> u8 {
    let mut value = [0];
    assert_eq!(master.sdo_upload(0, 0x2000, what as u8, &mut value), Ok(1));
    value[0]
}

/// Runs a test on a reserved master of each release.
fn on_each_release(test: impl Fn(Master, (u8, u8))) {
    for macros in RELEASES {
        let Some(fake) = Fake::build(macros) else {
            return;
        };
        let ecrt = fake.load();
        test(Master::request(&ecrt, 0).unwrap(), ecrt.version());
    }
}

#[test]
fn master_reports_the_state_of_the_bus() {
    on_each_release(|master, _| {
        assert_eq!(
            master.info(),
            Ok(MasterInfo {
                slave_count: 2,
                link_up: true,
                scan_busy: false,
                app_time_ns: 0x1122_3344_5566_7788,
            })
        );
        assert_eq!(
            master.state(),
            Ok(MasterState { slaves_responding: 2, al_states: 8, link_up: true })
        );
        assert_eq!(
            master.link_state(0),
            Ok(LinkState { slaves_responding: 2, al_states: 3, link_up: true })
        );
        assert_eq!(master.link_state(1), Err(Errno::EINVAL));
    });
}

#[test]
fn master_reports_a_slave() {
    on_each_release(|master, _| {
        let slave = master.slave_info(1).unwrap();
        assert_eq!(slave.position, 1);
        assert_eq!((slave.vendor_id, slave.product_code), (0xec0, 0x1234_5678));
        assert_eq!((slave.alias, slave.al_state), (5, 2));
        assert!(slave.error_flag);
        assert_eq!(slave.sdo_count, 300);
        assert_eq!(slave.name, "ECAN-Lite");
        assert_eq!(slave.ports[0].kind, PortKind::Mii);
        assert!(slave.ports[0].link_up);
        assert_eq!(slave.ports[0].next_slave, None);
        assert_eq!(slave.ports[1].kind, PortKind::EBus);
        assert_eq!(slave.ports[1].next_slave, Some(1));
        assert_eq!(slave.ports[3].kind, PortKind::NotImplemented);
        assert_eq!(master.slave_info(2), Err(Errno::EINVAL));
    });
}

#[test]
fn sdo_transfers_and_their_abort_codes() {
    on_each_release(|master, _| {
        let mut target = [0; 8];
        assert_eq!(master.sdo_upload(1, 0x1018, 1, &mut target), Ok(4));
        assert_eq!(target, [0x44, 0x33, 0x22, 0x11, 0, 0, 0, 0]);
        assert_eq!(master.sdo_download(1, 0x8010, 1, &[1]), Ok(()));

        let aborted = master.sdo_download(1, 0x8010, 3, &[30]).unwrap_err();
        assert_eq!(aborted.abort_code, Some(0x0609_0030));
        assert_eq!(aborted.to_string(), "aborted by the slave with code 0x06090030");
        let upload = |index| master.sdo_upload(1, index, 0, &mut [0; 4]).unwrap_err();
        assert_eq!(upload(0x3001).abort_code, Some(0x0602_0000));
        // A code that comes with another error than EIO is left over from something else.
        let invalid = SdoError { errno: Errno::EINVAL, abort_code: None };
        assert_eq!(upload(0x3002), invalid);
        assert_eq!(upload(0x3003).abort_code, None);
        // A library that claims more than it was given room for.
        assert_eq!(upload(0x3000).errno, Errno::EOVERFLOW);
    });
}

#[test]
fn upload_without_data_has_failed_without_abort_code() {
    on_each_release(|master, _| {
        let failed = SdoError { errno: Errno::EIO, abort_code: None };
        for size in [1, 4, 5, 200] {
            assert_eq!(master.sdo_upload(1, 0x3004, size, &mut [0; 4]), Err(failed), "{size}");
        }
    });
}

#[test]
fn configuration_reaches_the_library() {
    on_each_release(|mut master, version| {
        assert!(master.is_reserved());
        let config = master.slave_config(0, 1, 0xec0, 0x1234_5678).unwrap();
        assert_eq!(master.slave_config(0, 9, 0xec0, 0x1234_5678), Err(Errno::ENOMEM));
        let (out, enable) = (SyncDirection::Output, WatchdogMode::Enable);
        assert_eq!(master.config_sync_manager(config, 2, out, enable), Ok(()));
        assert_eq!(master.config_pdo_assign_clear(config, 2), Ok(()));
        assert_eq!(master.config_pdo_assign_add(config, 2, 0x1600), Ok(()));
        assert_eq!(master.config_pdo_assign_add(config, 2, 0x1601), Err(Errno::new(17)));
        assert_eq!(master.config_pdo_mapping_clear(config, 0x1600), Ok(()));
        assert_eq!(master.config_pdo_mapping_add(config, 0x1600, 0x7000, 1, 128), Ok(()));
        assert_eq!(master.config_watchdog(config, 2498, 1000), Ok(()));
        assert_eq!(master.config_sdo(config, 0x8010, 1, &[1]), Ok(()));
        assert_eq!(master.config_sdo(config, 0x8010, 1, &[]), Err(Errno::EINVAL));
        assert_eq!(master.config_dc(config, 0x300, 1_000_000, 0, 0, 0), Ok(()));
        assert_eq!(
            master.config_state(config),
            Ok(SlaveConfigState { online: true, operational: false, al_state: 4 })
        );
        assert_eq!(master.set_send_interval(1000), Ok(()));
        assert_eq!(master.select_reference_clock(Some(config)), Ok(()));
        assert_eq!(master.select_reference_clock(None), Err(Errno::ENOENT));

        let newer = match version {
            (1, 5) => Err(Errno::ENOSYS),
            _ => Ok(()),
        };
        assert_eq!(master.sync_reference_clock_to(1), newer);

        let domain = master.create_domain().unwrap();
        assert_eq!(master.config_reg_pdo_entry(config, 0x7000, 3, domain), Ok(32));
        assert_eq!(master.config_reg_pdo_entry(config, 0x7001, 1, domain), Err(Errno::ENOENT));
    });
}

#[test]
fn cycle_exchanges_the_image() {
    on_each_release(|mut master, _| {
        let first = master.create_domain().unwrap();
        let second = master.create_domain().unwrap();
        assert_eq!(master.domain_size(first), Ok(16));
        assert!(master.domain_data(first).is_empty());
        assert!(master.domain_data_mut(first).is_empty());

        assert_eq!(master.activate(), Ok(()));
        assert!(master.is_active());
        assert_eq!(master.activate(), Err(Errno::EINVAL));
        assert_eq!(master.domain_data(first).len(), 16);
        master.domain_data_mut(second)[0] = 0x5a;

        assert_eq!(master.receive(), Ok(()));
        assert_eq!(master.domain_process(first), Ok(()));
        assert_eq!(
            master.domain_state(first),
            Ok(DomainState {
                working_counter: 3,
                wc_state: WcState::Complete,
                redundancy_active: false,
            })
        );
        assert_eq!(master.domain_data(first)[8], 1);
        assert_eq!(master.domain_data(second)[8], 2);
        assert_eq!(master.domain_data(second)[0], 0x5a);
        assert_eq!(master.domain_queue(first), Ok(()));
        assert_eq!(master.application_time(1), Ok(()));
        assert_eq!(master.sync_reference_clock(), Ok(()));
        assert_eq!(master.sync_slave_clocks(), Ok(()));
        assert_eq!(master.sync_monitor_queue(), Ok(()));
        assert_eq!(master.send(), Ok(()));
        assert_eq!(master.reference_clock_time(), Ok(0xfedc_ba98));
        assert_eq!(master.sync_monitor_process(), Ok(42));
        for what in [Count::Received, Count::Queued, Count::Sent] {
            assert_eq!(count(&master, what), 1);
        }
    });
}

#[test]
fn deactivation_makes_every_id_stale() {
    on_each_release(|mut master, _| {
        assert_eq!(master.deactivate(), Err(Errno::EINVAL));
        let domain = master.create_domain().unwrap();
        let config = master.slave_config(0, 0, 1, 2).unwrap();
        let sdo = master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
        let reg = master.create_reg_request(config, 2).unwrap();
        master.activate().unwrap();
        assert_eq!(master.deactivate(), Ok(()));
        assert!(!master.is_active());
        assert_eq!(count(&master, Count::Deactivated), 1);

        // The next configuration fills the same places with new handles.
        let again = master.create_domain().unwrap();
        master.slave_config(0, 0, 1, 2).unwrap();
        assert_ne!(domain, again);

        assert_eq!(master.domain_size(domain), Err(Errno::EBADF));
        assert_eq!(master.domain_process(domain), Err(Errno::EBADF));
        assert_eq!(master.domain_queue(domain), Err(Errno::EBADF));
        assert_eq!(master.domain_state(domain), Err(Errno::EBADF));
        assert!(master.domain_data(domain).is_empty());
        assert!(master.domain_data_mut(domain).is_empty());
        assert_eq!(master.config_state(config), Err(Errno::EBADF));
        assert_eq!(master.create_sdo_request(config, 0x1018, 1, 4), Err(Errno::EBADF));
        assert_eq!(master.requests().sdo_read(sdo), Err(Errno::EBADF));
        assert_eq!(master.requests().sdo_state(sdo), Err(Errno::EBADF));
        assert!(master.requests().sdo_data(sdo).is_empty());
        assert_eq!(master.requests().register_read(reg, 0x134, 2), Err(Errno::EBADF));
        assert!(master.requests().register_data(reg).is_empty());
    });
}

#[test]
fn id_is_valid_for_its_own_master_only() {
    on_each_release(|mut master, _| {
        let mut other = Master::request(master.ecrt(), 1).unwrap();
        let domain = master.create_domain().unwrap();
        other.create_domain().unwrap();
        assert_eq!(other.domain_size(domain), Err(Errno::EBADF));
    });
}

#[test]
fn sdo_request_reads_and_writes() {
    on_each_release(|mut master, _| {
        let config = master.slave_config(0, 0, 1, 2).unwrap();
        let request = master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
        // What the allocator left there is not shown.
        assert_eq!(master.requests().sdo_data(request), [0; 4]);
        assert_eq!(master.requests().sdo_state(request), Ok(RequestState::Unused));
        assert_eq!(master.requests().sdo_timeout(request, 500), Ok(()));

        let value = [0x77, 2, 3, 4];
        assert_eq!(master.requests().sdo_write(request, &value), Ok(()));
        assert_eq!(count(&master, Count::Written), 0x77);
        assert_eq!(master.requests().sdo_write(request, &value), Err(Errno::EBUSY));
        assert_eq!(master.requests().sdo_read(request), Err(Errno::EBUSY));
        assert_eq!(master.requests().sdo_index(request, 0x1018, 2), Err(Errno::EBUSY));
        assert_eq!(master.requests().sdo_state(request), Ok(RequestState::Busy));
        assert_eq!(master.requests().sdo_state(request), Ok(RequestState::Success));
        assert_eq!(master.requests().sdo_index(request, 0x1018, 2), Ok(()));

        assert_eq!(master.requests().sdo_read(request), Ok(()));
        assert_eq!(master.requests().sdo_state(request), Ok(RequestState::Busy));
        assert_eq!(master.requests().sdo_state(request), Ok(RequestState::Success));
        assert_eq!(master.requests().sdo_data(request), [0xcd, 0xab]);
        // The library would now write two bytes of the four.
        assert_eq!(master.requests().sdo_write(request, &value), Err(Errno::EMSGSIZE));
        assert_eq!(master.requests().sdo_write(request, &[0x77, 2]), Ok(()));
    });
}

#[test]
fn register_request_reads() {
    on_each_release(|mut master, _| {
        let config = master.slave_config(0, 0, 1, 2).unwrap();
        let request = master.create_reg_request(config, 2).unwrap();
        assert_eq!(master.requests().register_data(request), [0; 2]);
        assert_eq!(master.requests().register_read(request, 0x134, 3), Err(Errno::EMSGSIZE));
        assert_eq!(master.requests().register_read(request, 0x134, 2), Ok(()));
        assert_eq!(master.requests().register_read(request, 0x134, 2), Err(Errno::EBUSY));
        assert_eq!(master.requests().register_state(request), Ok(RequestState::Busy));
        assert_eq!(master.requests().register_state(request), Ok(RequestState::Success));
        assert_eq!(master.requests().register_data(request), [0x34, 0x01]);
    });
}

#[test]
fn status_of_1_6_is_an_error_and_garbage_of_1_5_is_not() {
    for (macros, expected) in RELEASES.into_iter().zip([Ok(()), Err(Errno::EINTR)]) {
        let Some(fake) = Fake::build(macros) else {
            return;
        };
        // Master 7 reports EINTR where it can. The silent functions of the other release leave
        // -EIO where a return value would be.
        let mut master = Master::request(&fake.load(), 7).unwrap();
        let config = master.slave_config(0, 0, 1, 2).unwrap();
        let domain = master.create_domain().unwrap();
        master.activate().unwrap();
        assert_eq!(master.send(), expected);
        assert_eq!(master.receive(), expected);
        assert_eq!(master.domain_process(domain), expected);
        assert_eq!(master.domain_queue(domain), expected);
        assert_eq!(master.domain_state(domain).map(drop), expected);
        assert_eq!(master.state().map(drop), expected);
        assert_eq!(master.config_state(config).map(drop), expected);
        assert_eq!(master.application_time(1), expected);
        assert_eq!(master.sync_reference_clock(), expected);
        assert_eq!(master.sync_slave_clocks(), expected);
        assert_eq!(master.sync_monitor_queue(), expected);
        assert_eq!(master.sync_monitor_process(), Err(Errno::EIO));
        assert_eq!(master.config_watchdog(config, 1, 1), expected);
        assert_eq!(master.config_dc(config, 0, 0, 0, 0, 0), expected);
        assert_eq!(master.config_pdo_assign_clear(config, 2), expected);
        assert_eq!(master.config_pdo_mapping_clear(config, 0x1600), expected);
        assert_eq!(master.deactivate(), expected);
        // Reported or not, the handles are gone.
        assert_eq!(master.domain_queue(domain), Err(Errno::EBADF));
    }
}

#[test]
fn master_is_released_once_and_an_attached_one_never() {
    on_each_release(|mut watcher, _| {
        let ecrt = watcher.ecrt().clone();
        drop(Master::request(&ecrt, 1).unwrap());
        let opened = Master::open(&ecrt, 1).unwrap();
        assert!(!opened.is_reserved());
        drop(opened);
        assert_eq!(count(&watcher, Count::Released), 2);

        // The application's own master.
        // SAFETY: the fake is loaded, and has these functions with these types.
        let (raw, activate, release) = unsafe {
            let path = match ecrt.origin() {
                ecrt_sys::Origin::Library { path, .. } => path.clone(),
                ecrt_sys::Origin::Simulated { .. } => unreachable!(),
            };
            let library = libloading::os::unix::Library::new(path).unwrap();
            type Master = *mut ecrt_sys::ec_master_t;
            let request: extern "C" fn(u32) -> Master =
                *library.get(b"ecrt_request_master").unwrap();
            let activate: extern "C" fn(Master) -> i32 =
                *library.get(b"ecrt_master_activate").unwrap();
            let release: extern "C" fn(Master) = *library.get(b"ecrt_release_master").unwrap();
            (request(3), activate, release)
        };
        // SAFETY: the master is of the same library and outlives the handle.
        let mut foreign = unsafe { Master::from_raw(ecrt.clone(), raw) }.unwrap();
        assert!(foreign.is_attached() && foreign.is_reserved());
        let domain = foreign.create_domain().unwrap();
        for rejected in [
            foreign.activate(),
            foreign.deactivate(),
            foreign.send(),
            foreign.receive(),
            foreign.set_send_interval(1000),
        ] {
            assert_eq!(rejected, Err(Errno::EPERM));
        }
        // Too early: what the library answers then is no address.
        assert_eq!(foreign.refresh_domain_data(), Err(Errno::EAGAIN));
        assert!(foreign.domain_data(domain).is_empty());
        assert_eq!(activate(raw), 0);
        assert_eq!(foreign.refresh_domain_data(), Ok(()));
        assert_eq!(foreign.domain_data(domain).len(), 16);
        assert_eq!(foreign.domain_queue(domain), Ok(()));
        drop(foreign);
        assert_eq!(count(&watcher, Count::Released), 2);
        release(raw);
        assert_eq!(count(&watcher, Count::Released), 3);

        // SAFETY: null is rejected, nothing is used.
        let null = unsafe { Master::from_raw(ecrt, std::ptr::null_mut()) };
        assert_eq!(null.map(drop).unwrap_err(), Errno::EINVAL);
        assert!(watcher.create_domain().is_ok());
    });
}

#[test]
fn null_has_the_error_number_of_the_library() {
    on_each_release(|mut master, _| {
        for _ in 0..4 {
            master.create_domain().unwrap();
        }
        assert_eq!(master.create_domain(), Err(Errno::EPERM));
    });
}

#[test]
fn master_may_move_to_another_thread() {
    on_each_release(|mut master, _| {
        let domain = master.create_domain().unwrap();
        master.activate().unwrap();
        let master = std::thread::spawn(move || {
            master.receive().unwrap();
            master
        })
        .join()
        .unwrap();
        assert_eq!(master.domain_data(domain)[8], 1);
    });
}

#[test]
fn each_open_failure_says_what_to_do() {
    let Some(fake) = Fake::build(&[]) else { return };
    let ecrt = fake.load();
    let text = |index| {
        let requested = Master::request(&ecrt, index).unwrap_err();
        let opened = Master::open(&ecrt, index).unwrap_err();
        assert_eq!(requested, opened);
        assert_eq!(requested.index, index);
        requested.to_string()
    };
    assert_contains(&text(101), &["EtherCAT master 101", "/dev/EtherCAT101"]);
    assert_contains(&text(102), &["/dev/EtherCAT102", "may not be opened", "udev"]);
    assert_contains(&text(103), &["another application has reserved it"]);
    // Nothing left in errno, and a look at the device node finds none.
    assert_contains(&text(104), &["/dev/EtherCAT104 does not exist"]);

    let other = Master::request(&ecrt, 105).unwrap_err();
    // 105 has no device node either, which says more than what the library left.
    assert!(
        matches!(other.failure, OpenFailure::NotRunning { .. } | OpenFailure::NoSuchMaster { .. }),
        "{other:?}"
    );
}

#[test]
fn failed_request_does_not_affect_the_next() {
    let Some(fake) = Fake::build(&[]) else { return };
    let ecrt = fake.load();
    assert_eq!(Master::request(&ecrt, 103).unwrap_err().failure, OpenFailure::Busy);
    Errno::EBUSY.set_last();
    assert_ne!(Master::request(&ecrt, 104).unwrap_err().failure, OpenFailure::Busy);
    assert!(Master::request(&ecrt, 0).is_ok());
}
