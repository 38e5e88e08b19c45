//! Requests in parallel with the cycle while no slave can serve them.

use crate::ecrt_support::{CYCLE_NS, Program, stepped};
use ecan_host::{RegRequestId, RequestState, SdoRequestId};
use ecan_sim::{Fault, Scenario};

/// In OP, with a request for the vendor id and one for the AL status.
fn with_requests() -> (Program, SdoRequestId, RegRequestId) {
    with_requests_in(ecan_sim::echo(1))
}

fn with_requests_in(scenario: Scenario) -> (Program, SdoRequestId, RegRequestId) {
    let mut program = Program::new(stepped(scenario), &[1]);
    let config = program.slaves[0].config;
    let sdo = program.master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
    let register = program.master.create_reg_request(config, 2).unwrap();
    (program.into_op(), sdo, register)
}

fn sdo_state(program: &mut Program, request: SdoRequestId) -> RequestState {
    program.master.requests().sdo_state(request).unwrap()
}

fn register_state(program: &mut Program, request: RegRequestId) -> RequestState {
    program.master.requests().register_state(request).unwrap()
}

/// Cycles with a lost link until the bus is rescanned, with `keep_busy` in each; returns their
/// number.
fn into_scan(program: &mut Program, mut keep_busy: impl FnMut(&mut Program)) -> usize {
    program.simulation().inject(Fault::LinkLoss { gateway: 0, for_ms: 1_100 });
    let mut cycles = 0;
    while !program.master.info().unwrap().scan_busy {
        keep_busy(program);
        program.cycle();
        cycles += 1;
    }
    cycles
}

#[test]
fn request_in_progress_fails_at_a_rescan() {
    // the scan interrupts the transfer at each of its steps
    for delay in 0..4 {
        let (mut program, request, _) = with_requests();
        program.cycles(delay);
        into_scan(&mut program, |program| {
            if sdo_state(program, request) != RequestState::Busy {
                program.master.requests().sdo_read(request).unwrap();
            }
        });
        assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
        program.cycles(5);
        assert_ne!(sdo_state(&mut program, request), RequestState::Busy, "delay {delay}");
        program.master.requests().sdo_read(request).unwrap();
        program.cycles(5);
        assert_eq!(sdo_state(&mut program, request), RequestState::Success, "delay {delay}");
    }
}

/// Brings a register request into a rescan, at each phase of the cycle, because a register is read
/// within a cycle. Returns the requests that the library reports as busy after the slave has returned.
fn busy_after_a_rescan(keeps_lost_requests: bool) -> Vec<(Program, RegRequestId)> {
    let mut busy = Vec::new();
    for quarter in 0..4 {
        let mut scenario = ecan_sim::echo(1);
        scenario.master.keeps_lost_requests = keeps_lost_requests;
        let (mut program, _, request) = with_requests_in(scenario);
        program.cycles(5);
        program.simulation().pass_ns(quarter * CYCLE_NS / 4);
        program.next += quarter * CYCLE_NS / 4;
        into_scan(&mut program, |program| {
            if register_state(program, request) != RequestState::Busy {
                program.master.requests().register_read(request, 0x0130, 2).unwrap();
            }
        });
        assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
        program.cycles(1_000);
        if register_state(&mut program, request) == RequestState::Busy {
            busy.push((program, request));
        }
    }
    assert!(!busy.is_empty(), "no request was in progress at the rescan");
    busy
}

#[test]
fn register_request_lost_at_a_rescan_stays_busy() {
    for (mut program, request) in busy_after_a_rescan(false) {
        program.master.requests().abandon_register(request).unwrap();
        program.master.requests().register_read(request, 0x0130, 2).unwrap();
        program.cycles(3);
        assert_eq!(register_state(&mut program, request), RequestState::Success);
    }
}

#[test]
fn kept_register_request_stays_busy_when_started_again() {
    for (mut program, request) in busy_after_a_rescan(true) {
        program.master.requests().abandon_register(request).unwrap();
        program.master.requests().register_read(request, 0x0130, 2).unwrap();
        program.cycles(1_000);
        assert_eq!(register_state(&mut program, request), RequestState::Busy);
    }
}

#[test]
fn register_request_started_without_a_slave_ends_on_its_return() {
    for keeps_lost_requests in [false, true] {
        let mut scenario = ecan_sim::echo(1);
        scenario.master.keeps_lost_requests = keeps_lost_requests;
        let (mut program, _, request) = with_requests_in(scenario);
        into_scan(&mut program, |_| {});
        program.master.requests().register_read(request, 0x0130, 2).unwrap();
        program.cycles(50);
        assert_eq!(register_state(&mut program, request), RequestState::Busy);
        assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
        program.cycles(5);
        let is_busy = register_state(&mut program, request) == RequestState::Busy;
        assert_eq!(is_busy, keeps_lost_requests);
    }
}

#[test]
fn queued_request_of_a_lost_slave_ends_on_its_return() {
    let (mut program, request, _) = with_requests();
    into_scan(&mut program, |_| {});
    program.master.requests().sdo_read(request).unwrap();
    program.cycles(50);
    assert_eq!(sdo_state(&mut program, request), RequestState::Busy);
    assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
    program.cycles(5);
    // the slave returned with an AL error, in which no request is served
    assert_eq!(sdo_state(&mut program, request), RequestState::Error);
    program.master.requests().sdo_read(request).unwrap();
    program.cycles(5);
    assert_eq!(sdo_state(&mut program, request), RequestState::Success);
}

#[test]
fn queued_request_is_served_after_the_scan() {
    let (mut program, _, _) = with_requests();
    let cycles = into_scan(&mut program, |_| {});
    // free only for a moment, when the master polls the bus
    let (mut program, request, _) = with_requests();
    program.cycles(cycles - 2);
    program.simulation().inject(Fault::LinkLoss { gateway: 0, for_ms: 4 });
    program.cycles(2);
    assert!(program.master.info().unwrap().scan_busy);
    program.master.requests().sdo_read(request).unwrap();
    program.cycles(1_000);
    assert!(program.state(0).operational);
    assert_eq!(sdo_state(&mut program, request), RequestState::Success);
}

#[test]
fn request_timeout_is_checked_when_it_is_served() {
    let (mut program, request, _) = with_requests();
    program.master.requests().sdo_timeout(request, 100).unwrap();
    program.simulation().inject(Fault::RequestsHeld { for_ms: 1_000 });
    program.master.requests().sdo_read(request).unwrap();
    program.cycles(990);
    assert_eq!(sdo_state(&mut program, request), RequestState::Busy);
    program.cycles(20);
    assert_eq!(sdo_state(&mut program, request), RequestState::Error);
    program.master.requests().sdo_read(request).unwrap();
    program.cycles(5);
    assert_eq!(sdo_state(&mut program, request), RequestState::Success);
}
