//! Library calls that fail as if interrupted by a signal.

use crate::ecrt_support::{CYCLE_NS, Program, frame, stepped};
use ecan_host::{Errno, WcState};
use ecan_sim::{EcrtVersion, Fault, LibraryCall, Scenario, echo};

const EINTR: i32 = 4;

fn fails(program: &Program, call: LibraryCall, times: u32) {
    program.simulation().inject(Fault::LibraryError { call, errno: EINTR, times });
}

#[test]
fn only_the_configured_calls_fail() {
    let mut program = Program::operational(&[3]);
    let domain = program.slaves[0].domain;
    for (position, call) in LibraryCall::ALL.into_iter().enumerate() {
        fails(&program, call, 2);
        for attempt in 0..3 {
            let results = [
                program.master.receive(),
                program.master.send(),
                program.master.domain_process(domain),
                program.master.domain_queue(domain),
                program.master.domain_state(domain).map(|_| ()),
            ];
            for (other, result) in results.into_iter().enumerate() {
                let expected =
                    if other == position && attempt < 2 { Err(Errno::EINTR) } else { Ok(()) };
                assert_eq!(result, expected, "{call:?}, attempt {attempt}, call {other}");
            }
        }
    }
}

#[test]
fn receive_after_an_interrupted_one_gets_its_frames() {
    let mut program = Program::operational(&[3]);
    let domain = program.slaves[0].domain;
    fails(&program, LibraryCall::Receive, 1);
    assert_eq!(program.master.receive(), Err(Errno::EINTR));
    program.master.domain_process(domain).unwrap();
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
    // after the timeout of a datagram: it has arrived long ago
    program.simulation().pass_ns(5 * CYCLE_NS);
    program.master.receive().unwrap();
    program.master.domain_process(domain).unwrap();
    assert_eq!(program.domain(0).wc_state, WcState::Complete);
}

#[test]
fn send_after_an_interrupted_one_sends_its_datagrams() {
    let mut program = Program::operational(&[3]);
    let domain = program.slaves[0].domain;
    let before = program.counters(0).images_written;
    program.master.receive().unwrap();
    program.master.domain_queue(domain).unwrap();
    fails(&program, LibraryCall::Send, 1);
    assert_eq!(program.master.send(), Err(Errno::EINTR));
    assert_eq!(program.counters(0).images_written, before);
    program.master.send().unwrap();
    assert_eq!(program.counters(0).images_written, before + 1);
}

#[test]
fn interrupted_process_keeps_the_last_working_counter() {
    let mut program = Program::operational(&[3]);
    let domain = program.slaves[0].domain;
    program.simulation().pass_ns(CYCLE_NS);
    program.master.domain_queue(domain).unwrap();
    program.master.send().unwrap();
    program.master.receive().unwrap();
    fails(&program, LibraryCall::DomainProcess, 1);
    assert_eq!(program.master.domain_process(domain), Err(Errno::EINTR));
    assert_eq!(program.domain(0).wc_state, WcState::Complete);
    program.master.domain_process(domain).unwrap();
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
}

#[test]
fn version_1_5_leaves_the_error_in_errno() {
    let backend = stepped(Scenario { version: EcrtVersion::V1_5, ..echo(1) });
    let mut program = Program::new(backend, &[3]).into_op();
    program.cycles(5);
    fails(&program, LibraryCall::Receive, 1);
    assert_eq!(program.master.receive(), Err(Errno::EINTR));
    assert_eq!(program.master.receive(), Ok(()));
    program.cycles(2);
    assert_eq!(program.domain(0).wc_state, WcState::Complete);
}

#[test]
fn bus_with_interrupted_calls_still_carries_frames() {
    let mut program = Program::operational(&[3]);
    for call in [LibraryCall::Receive, LibraryCall::Send, LibraryCall::DomainQueue] {
        fails(&program, call, 1);
        let domain = program.slaves[0].domain;
        let _ = program.master.receive();
        let _ = program.master.domain_queue(domain);
        let _ = program.master.send();
        program.simulation().pass_ns(CYCLE_NS);
        program.received.clear();
        let frame = frame(0x77, &[7]);
        program.cycle_with(&[(0, 0, frame)]);
        program.receive_frames(1);
        assert_eq!(program.received, [(0, 0, frame)], "{call:?}");
    }
}
