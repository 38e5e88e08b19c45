//! Functions that the headers call real-time safe allocate nothing, errors and their texts
//! included.

use std::ffi::CStr;
use std::ptr::null_mut;

use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_c_boundary::result::ecan_result_t::*;
use ecan_igh_host::mcan_port::cycle::{
    igh_mcan_port_cycle_begin, igh_mcan_port_cycle_end, igh_mcan_port_get_last_ticket,
    igh_mcan_port_receive, igh_mcan_port_send_can, igh_mcan_port_send_canfd,
    igh_mcan_port_wait_next_cycle, igh_mcan_ticket_t,
};
use ecan_igh_host::mcan_port::state::{
    igh_mcan_port_get_cycle_report, igh_mcan_port_get_session, igh_mcan_port_get_statistics,
    igh_mcan_statistics_t,
};
use ecan_igh_host::observer::{
    ecan_igh_observed_cycle_t, ecan_igh_observer_deinit, ecan_igh_observer_get_cycle,
    ecan_igh_observer_init, ecan_igh_observer_request_stop, ecan_igh_observer_t,
    ecan_igh_observer_update,
};
use ecan_mcan_host::common::ecan_last_error;
use ecan_test_support::allocations;

use crate::c_port::CPort;

const CAPACITY: usize = 64;

#[derive(Debug, Default)]
struct Counts {
    allocations: u64,
    received: usize,
    rejected: usize,
}

/// One cycle: receives everything, sends until the image is full, and makes rejected calls.
fn cycle(c: &mut CPort, rx: &mut [igh_mcan_rx_frame_t], counts: &mut Counts) {
    let port = c.port();
    let (data, mut received) = ([1; 8], 0);
    let mut ticket = igh_mcan_ticket_t::default();
    let mut statistics = igh_mcan_statistics_t::default();
    // SAFETY: every pointer is valid or NULL.
    unsafe {
        assert_eq!(igh_mcan_port_wait_next_cycle(port), 0);
        let before = allocations();
        assert_eq!(igh_mcan_port_cycle_begin(port), 0);
        assert_eq!(igh_mcan_port_receive(port, rx.as_mut_ptr(), CAPACITY, &mut received), 0);
        let mut channel = 0;
        loop {
            let code = igh_mcan_port_send_can(port, 0, channel % 4, 0x123, 0, data.as_ptr(), 8);
            if code != 0 {
                assert_eq!(code, ECAN_ERR_NO_ROOM.code());
                break;
            }
            channel += 1;
        }
        let code = igh_mcan_port_send_canfd(port, 0, 0, 0x123, 0, data.as_ptr(), 8);
        assert_eq!(code, ECAN_ERR_NOT_FD.code());
        let code = igh_mcan_port_send_can(port, 0, 0, 0x800, 0, data.as_ptr(), 8);
        assert_eq!(code, ECAN_ERR_FRAME.code());
        let text = CStr::from_ptr(ecan_last_error()).to_bytes();
        assert!(text.starts_with(b"igh_mcan_port_send_can: CAN ID 0x800"));
        let code = igh_mcan_port_send_can(port, 7, 0, 1, 0, data.as_ptr(), 8);
        assert_eq!(code, ECAN_ERR_SLAVE.code());
        let code = igh_mcan_port_get_cycle_report(port, 0, null_mut());
        assert_eq!(code, ECAN_ERR_NULL.code());
        assert!(igh_mcan_port_get_session(port, 0) >= 0);
        assert_eq!(igh_mcan_port_get_last_ticket(port, &mut ticket), 0);
        assert_eq!(igh_mcan_port_get_statistics(port, 0, &mut statistics), 0);
        assert_eq!(igh_mcan_port_cycle_end(port), 0);
        counts.allocations += allocations() - before;
    }
    counts.received += received;
    counts.rejected += 5;
}

#[test]
fn full_images_and_rejections_allocate_nothing() {
    let mut c = CPort::ready(4);
    // Every cycle publishes a snapshot.
    let mut observer = Box::new(ecan_igh_observer_t { opaque: [0; 4] });
    let mut observed = ecan_igh_observed_cycle_t::default();
    let observer: *mut _ = &mut *observer;
    // SAFETY: every pointer is valid.
    unsafe { assert_eq!(ecan_igh_observer_init(observer, c.igh()), 0) };
    let mut rx = vec![igh_mcan_rx_frame_t::EMPTY; CAPACITY];
    // The simulated world grows its queues to their working size first.
    let mut warm_up = Counts::default();
    for _ in 0..200 {
        cycle(&mut c, &mut rx, &mut warm_up);
    }
    let mut counts = Counts::default();
    for _ in 0..500 {
        cycle(&mut c, &mut rx, &mut counts);
    }
    assert!(counts.received > 1_000, "{counts:?}");
    assert_eq!(counts.allocations, 0, "{counts:?}");
    let before = allocations();
    // SAFETY: every pointer is valid or NULL.
    unsafe {
        assert_eq!(ecan_igh_observer_request_stop(observer, null_mut()), 0);
        assert_eq!(ecan_igh_observer_update(observer), 0);
        assert_eq!(ecan_igh_observer_get_cycle(observer, &mut observed), 0);
        assert_eq!(allocations() - before, 0, "an observer");
        assert_eq!(ecan_igh_observer_deinit(observer), 0);
    }
    assert!(observed.cycle > 700, "{observed:?}");
}
