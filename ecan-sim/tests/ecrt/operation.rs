//! From an idle bus to CAN frames through the simulated library.

use crate::ecrt_support::{PATIENCE, Program, frame, stepped, stepped_echo};
use ecan_host::{Errno, WcState};
use ecan_sim::{BusFrame, EcrtVersion, Scenario, World, echo};

#[test]
fn three_slaves_carry_traffic_on_all_twelve_channels() {
    let mut program = Program::new(stepped_echo(3), &[3, 8, 1]).into_op();
    program.simulation().with_world(World::record_all_buses);
    let mut sent = Vec::new();
    for slave in 0..3 {
        for channel in 0..4u8 {
            let id = 0x100 + 16 * slave as u16 + u16::from(channel);
            sent.push((slave, channel, frame(id, &[slave as u8, channel])));
        }
    }
    program.cycle_with(&sent);
    program.receive_frames(sent.len());
    program.received.sort_by_key(|(slave, channel, _)| (*slave, *channel));
    assert_eq!(program.received, sent);
    let recorded = program.simulation().with_world(World::take_recorded);
    let of_channel =
        |frame: &BusFrame| frame.channel.map(|(slave, at)| (slave, at as u8, frame.frame));
    let mut of_channels: Vec<_> = recorded.iter().filter_map(of_channel).collect();
    of_channels.sort_by_key(|(slave, channel, _)| (*slave, *channel));
    assert_eq!((of_channels, recorded.len()), (sent, 24), "frames and echoes");
}

/// N of each slave, version, working counters in OP.
#[test]
fn working_counters_are_those_of_the_release() {
    for (multipliers, version, expected) in [
        (&[1][..], EcrtVersion::V1_6, &[3][..]),
        (&[5], EcrtVersion::V1_6, &[3]),
        (&[6], EcrtVersion::V1_6, &[2]),
        (&[11], EcrtVersion::V1_6, &[2]),
        (&[5], EcrtVersion::V1_5, &[3]),
        (&[6], EcrtVersion::V1_5, &[3]),
        (&[11], EcrtVersion::V1_5, &[3]),
        (&[3, 6], EcrtVersion::V1_6, &[3, 2]),
    ] {
        let scenario = Scenario { version, ..echo(multipliers.len()) };
        let mut program = Program::new(stepped(scenario), multipliers).into_op();
        // the input buffer can be empty in the cycle in which OP was reached
        program.cycles(5);
        for (slave, expected) in expected.iter().enumerate() {
            let state = program.domain(slave);
            let found = (state.working_counter, state.wc_state);
            assert_eq!(found, (*expected, WcState::Complete), "N = {multipliers:?}, {version:?}");
        }
    }
}

#[test]
fn twelve_chunks_block_the_whole_bus() {
    let mut program = Program::new(stepped_echo(2), &[12, 1]);
    program.activate();
    program.cycles(PATIENCE / 10);
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
    assert_eq!(program.domain(1).wc_state, WcState::Zero);
    assert!(!program.state(0).operational && !program.state(1).operational);
    // mailbox traffic is blocked in the same queue
    let mut data = [0; 4];
    let error = program.master.sdo_upload(1, 0x1000, 0, &mut data).unwrap_err();
    assert_eq!((error.errno, error.abort_code), (Errno::ETIMEDOUT, None));
}

#[test]
fn datagrams_before_an_oversized_one_are_sent() {
    let mut program = Program::new(stepped_echo(2), &[1, 12]);
    program.activate();
    program.cycles(50);
    let cycles = program.simulation().with_world(|world| world.cycles());
    assert_eq!(cycles, 50);
    assert!(!program.reaches_op());
}

#[test]
fn twelve_or_more_chunks_work_with_large_pdos() {
    for n in [12, 24] {
        let carries = Scenario { carries_large_pdos: true, ..echo(1) };
        let mut program = Program::new(stepped(carries), &[n]).into_op();
        program.cycle_with(&[(0, 3, frame(0x7FF, &[9; 8]))]);
        program.receive_frames(1);
        assert_eq!(program.received, [(0, 3, frame(0x7FF, &[9; 8]))]);
    }
}

#[test]
fn stepped_clock_moves_only_in_sleep() {
    let mut program = Program::new(stepped_echo(1), &[3]).into_op();
    let clock = program.backend.ecrt.clock().clone();
    let before = clock.now_ns();
    for _ in 0..10 {
        program.master.receive().unwrap();
        program.master.domain_process(program.slaves[0].domain).unwrap();
        program.master.domain_queue(program.slaves[0].domain).unwrap();
        program.master.send().unwrap();
        program.master.state().unwrap();
    }
    assert_eq!(clock.now_ns(), before);
    clock.sleep_until_ns(before + 123);
    assert_eq!(clock.now_ns(), before + 123);
}

#[test]
fn reply_needs_its_time_on_the_wire() {
    let mut program = Program::new(stepped_echo(1), &[3]).into_op();
    let domain = program.slaves[0].domain;
    let clock = program.backend.ecrt.clock().clone();
    program.master.receive().unwrap();
    program.master.domain_queue(domain).unwrap();
    program.master.send().unwrap();
    program.master.receive().unwrap();
    program.master.domain_process(domain).unwrap();
    assert_eq!(program.master.domain_state(domain).unwrap().working_counter, 0);
    clock.sleep_until_ns(clock.now_ns() + 200_000);
    program.master.receive().unwrap();
    program.master.domain_process(domain).unwrap();
    assert_eq!(program.master.domain_state(domain).unwrap().working_counter, 3);
}

#[test]
fn deactivated_slaves_return_to_preop_for_another_n() {
    let mut program = Program::new(stepped_echo(1), &[3]).into_op();
    program.master.deactivate().unwrap();
    assert_eq!(program.master.domain_state(program.slaves[0].domain).unwrap_err(), Errno::EBADF);
    let backend = program.backend.clone();
    drop(program);
    let mut again = Program::new(backend, &[8]);
    assert_eq!(again.master.slave_info(0).unwrap().al_state, 2);
    again.activate();
    assert!(again.reaches_op());
    assert_eq!(again.domain(0).working_counter, 2);
}
