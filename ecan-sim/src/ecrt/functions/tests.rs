//! Calls of a C program with stale, unknown and null handles.

use std::ptr::{null, null_mut};

use ecrt_sys::{Errno, Functions, OpenMaster as _, Status, ec_master_t};
use libc::c_int;

use super::boundary::{data_or_null, guarded, handle_or_null, status};
use super::masters::SimulatedMasters;
use super::*;
use crate::scenario::{ClockKind, EcrtVersion, echo};
use crate::simulation::Simulation;

fn simulated() -> (Functions, SimulatedMasters) {
    let simulation = Simulation::new(&echo(1), ClockKind::Stepped, None).unwrap();
    (table(EcrtVersion::V1_6), SimulatedMasters { shared: simulation.shared().clone() })
}

fn call<A>(
    function: Status<unsafe extern "C" fn(A) -> i32, unsafe extern "C" fn(A)>,
    argument: A,
) -> i32 {
    match function {
        // SAFETY: the simulated library checks every handle before it uses it.
        Status::Reported(function) => unsafe { function(argument) },
        Status::Silent(_) => panic!("a simulated 1.6 reports"),
    }
}

#[test]
fn invalid_handle_is_rejected() {
    let (table, _) = simulated();
    for address in [0usize, 1, 0x5ECA_0000 - 16, usize::MAX & !15] {
        let master = std::ptr::without_provenance_mut(address);
        assert_eq!(call(table.master_send, master), -libc::EINVAL);
        assert_eq!(call(table.domain_queue, master.cast()), -libc::EINVAL);
        assert_eq!(call(table.sdo_request_read, master.cast()), -libc::EINVAL);
        // SAFETY: as above.
        unsafe {
            assert!((table.master_create_domain)(master).is_null());
            assert!((table.domain_data)(master.cast()).is_null());
            assert_eq!((table.domain_size)(master.cast()), usize::MAX);
            assert_eq!((table.slave_config_sdo)(master.cast(), 1, 1, null(), 0), -libc::EINVAL);
            (table.release_master)(master);
        }
    }
}

#[test]
fn handles_die_with_deactivation_and_release() {
    let (table, library) = simulated();
    let master = library.request(0);
    // SAFETY: as above.
    unsafe {
        let domain = (table.master_create_domain)(master);
        assert!(!domain.is_null());
        assert!((table.domain_data)(domain).is_null(), "no data before activation");
        assert_eq!((table.master_activate)(master), 0);
        assert_eq!(call(table.domain_process, domain), 0);
        // a master is not a domain
        assert_eq!(call(table.domain_process, master.cast()), -libc::EINVAL);
        assert_eq!(call(table.master_deactivate, master), 0);
        assert_eq!(call(table.domain_process, domain), -libc::EINVAL);
        let second = (table.master_create_domain)(master);
        assert!(!second.is_null() && second != domain);
        (table.release_master)(master);
        assert_eq!(call(table.master_send, master), -libc::EINVAL);
        assert_eq!((table.master)(master, null_mut()), -libc::EINVAL);
    }
}

#[test]
fn panic_ends_as_an_error_of_the_call() {
    assert_eq!(status(|| panic!("on purpose")), -libc::EIO);
    assert_eq!(guarded::<c_int>(|| panic!("on purpose")), Err(libc::EIO));
    assert!(data_or_null(|| panic!("on purpose")).is_null());
    Errno::new(0).set_last();
    assert!(handle_or_null::<ec_master_t>(|| panic!("on purpose")).is_null());
    assert_eq!(Errno::last(), Errno::EIO);
}
