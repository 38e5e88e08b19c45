//! The reference clock, which is unknown during a scan.

use crate::ecrt_support::{CYCLE_NS, Program, stepped, stepped_echo};
use ecan_host::{Errno, Master, RequestState};
use ecan_sim::{EcrtVersion, Fault, Scenario, echo};

/// Results of the three calls for the clocks.
fn calls(master: &mut Master) -> [Result<(), Errno>; 3] {
    [
        master.sync_reference_clock(),
        master.sync_slave_clocks(),
        master.reference_clock_time().map(|_| ()),
    ]
}

#[test]
fn empty_bus_has_no_reference_clock() {
    let backend = stepped(Scenario::default());
    let mut master = Master::request(&backend.ecrt, 0).unwrap();
    master.activate().unwrap();
    assert_eq!(calls(&mut master), [Err(Errno::ENXIO); 3]);
    assert_eq!(master.sync_reference_clock_to(1).unwrap_err(), Errno::ENXIO);
    assert!(master.sync_monitor_queue().is_ok());
}

#[test]
fn version_1_5_reports_only_returned_errors() {
    let backend = stepped(Scenario { version: EcrtVersion::V1_5, ..Scenario::default() });
    let mut master = Master::request(&backend.ecrt, 0).unwrap();
    master.activate().unwrap();
    assert_eq!(calls(&mut master), [Ok(()), Ok(()), Err(Errno::ENXIO)]);
}

#[test]
fn reference_clock_is_missing_during_a_scan() {
    let mut program = Program::new(stepped_echo(2), &[3, 1]);
    let config = program.slaves[0].config;
    program.master.config_dc(config, 0x0300, CYCLE_NS as u32, 0, 0, 0).unwrap();
    let mut program = program.into_op();
    assert_eq!(calls(&mut program.master)[..2], [Ok(()); 2]);
    program.cycle();
    program.master.receive().unwrap();
    assert!(program.master.reference_clock_time().is_ok());
    program.simulation().inject(Fault::PowerCycle { gateway: 1, off_ms: 100 });
    // scanning, and the results of the clock calls
    let seen: Vec<_> = (0..4_000)
        .map(|_| {
            let calls = calls(&mut program.master);
            let scans = program.master.info().unwrap().scan_busy;
            program.cycle();
            (scans, calls[0], calls[1], calls[2] == Err(Errno::ENXIO))
        })
        .collect();
    assert!(seen.iter().any(|(scans, ..)| *scans));
    for (scans, reference, slaves, no_time) in seen {
        let expected = if scans { Err(Errno::ENXIO) } else { Ok(()) };
        assert_eq!((reference, slaves, no_time), (expected, expected, scans));
    }
    assert!(program.reaches_op());
}

#[test]
fn idle_bus_does_not_miss_its_clocks() {
    let backend = stepped(echo(1));
    let mut master = Master::request(&backend.ecrt, 0).unwrap();
    assert_eq!(calls(&mut master), [Ok(()), Ok(()), Err(Errno::EIO)]);
}

/// A program with Sync0 that does not lead the reference clock, up to OP; returns its cycles.
///
/// The clock has a difference of 50 us from an earlier program that led it.
fn cycles_until_op(clears_difference: bool) -> (usize, bool) {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let config = program.slaves[0].config;
    program.master.config_dc(config, 0x0300, CYCLE_NS as u32, 0, 0, 0).unwrap();
    let request = program.master.create_reg_request(config, 2).unwrap();
    program.simulation().with_world(|world| {
        world.with_gateway(0, |gateway, now| {
            gateway.write_dc_system_time(now, now);
            gateway.correct_dc_system_time(now, now + 50_000);
        })
    });
    if clears_difference {
        program.master.requests().register_write(request, 0x0930, &[0x00, 0x10]).unwrap();
        program.simulation().pass_ns(20 * CYCLE_NS);
        assert_eq!(program.master.requests().register_state(request), Ok(RequestState::Success));
    }
    program.activate();
    let mut cycles = 0;
    while !program.state(0).operational {
        program.master.application_time(program.next).unwrap();
        program.cycle();
        cycles += 1;
        assert!(cycles < 20_000, "not in OP");
    }
    let has_line = |line: &String| line.contains("did not follow the reference clock");
    (cycles, program.simulation().kernel_log().iter().any(has_line))
}

#[test]
fn difference_costs_the_settling_time_unless_it_is_cleared() {
    for (is_cleared, expected) in [(false, 5_001..20_000), (true, 0..1_000)] {
        let (cycles, is_logged) = cycles_until_op(is_cleared);
        assert!(expected.contains(&cycles), "cleared: {is_cleared}, {cycles} cycles");
        assert_eq!(is_logged, !is_cleared);
    }
}
