//! Durations of the master: SDO transfers that travel with the application's sends, slaves
//! configured one after the other, activation.

use crate::ecrt_support::{CYCLE_NS, Program, stepped_echo};
use ecan_host::{Errno, Master, RequestState, SdoRequestId};
use ecan_protocol::object::{ObjectType, SdoWrite};
use ecan_sim::{Fault, GatewayFault};

const MS: u64 = 1_000_000;

/// In OP with a request that reads the vendor id.
fn with_request() -> (Program, SdoRequestId) {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let config = program.slaves[0].config;
    let request = program.master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
    (program.into_op(), request)
}

/// Exchanges process data and advances time by `ns`.
fn exchange(program: &mut Program, then_ns: u64) {
    program.master.receive().unwrap();
    program.master.domain_queue(program.slaves[0].domain).unwrap();
    program.master.send().unwrap();
    program.simulation().pass_ns(then_ns);
}

/// Sends with this period until the request is complete; returns the number of sends.
fn sends_of(program: &mut Program, request: SdoRequestId, distance_ns: u64) -> usize {
    program.master.requests().sdo_read(request).unwrap();
    for sends in 0..100 {
        if program.master.requests().sdo_state(request).unwrap() == RequestState::Success {
            return sends;
        }
        exchange(program, distance_ns);
    }
    panic!("the request does not end");
}

#[test]
fn request_takes_three_sends_and_the_time_of_the_device() {
    let (mut program, request) = with_request();
    // the master sees the request after one send
    for (distance_ns, sends) in [(4 * MS, 4), (2 * MS, 4), (MS, 4), (MS / 2, 6), (MS / 4, 10)] {
        assert_eq!(sends_of(&mut program, request, distance_ns), sends, "{distance_ns} ns");
    }
}

#[test]
fn request_does_not_move_without_sends() {
    let (mut program, request) = with_request();
    program.master.requests().sdo_read(request).unwrap();
    program.simulation().pass_ns(50 * MS);
    assert_eq!(program.master.requests().sdo_state(request).unwrap(), RequestState::Busy);
    (0..4).for_each(|_| exchange(&mut program, MS));
    assert_eq!(program.master.requests().sdo_state(request).unwrap(), RequestState::Success);
}

#[test]
fn transfer_before_activation_takes_two_milliseconds() {
    let backend = stepped_echo(1);
    let master = Master::request(&backend.ecrt, 0).unwrap();
    let clock = backend.ecrt.clock();
    let before = clock.now_ns();
    let mut data = [0; 4];
    master.sdo_upload(0, 0x1018, 1, &mut data).unwrap();
    assert_eq!(clock.now_ns() - before, 2 * MS);
}

#[test]
fn blocking_transfer_on_an_active_master_waits_for_the_cycle() {
    let mut program = Program::new(stepped_echo(1), &[1]).into_op();
    let ecrt = program.backend.ecrt.clone();
    let sends = |program: &Program| program.simulation().with_world(|world| world.cycles());
    let before = sends(&program);
    std::thread::scope(|scope| {
        let transfer = scope.spawn(|| {
            let mut data = [0; 4];
            let looking = Master::open(&ecrt, 0).unwrap();
            looking.sdo_upload(0, 0x1018, 1, &mut data)
        });
        while !transfer.is_finished() {
            program.cycle();
        }
        assert_eq!(transfer.join().unwrap().unwrap(), 4);
    });
    assert!(sends(&program) >= before + 3);
    let log = program.simulation().kernel_log();
    assert!(log.is_empty(), "{log:#?}");
}

#[test]
fn blocking_transfer_without_sends_is_cancelled_and_logged() {
    let program = Program::new(stepped_echo(1), &[1]).into_op();
    let before = program.backend.ecrt.clock().now_ns();
    let mut data = [0; 4];
    let error = program.master.sdo_upload(0, 0x1018, 1, &mut data).unwrap_err();
    assert_eq!((error.errno, error.abort_code), (Errno::ETIMEDOUT, None));
    assert_eq!(program.backend.ecrt.clock().now_ns(), before);
    let log = program.simulation().kernel_log();
    assert!(log.iter().any(|line| line.starts_with("simulator: ")), "{log:#?}");
}

/// Cycles until all slaves are in OP, with further startup SDOs each.
fn cycles_to_op(slaves: usize, downloads: usize) -> usize {
    let write = SdoWrite { index: 0x8000, subindex: 10, value: 1, ty: ObjectType::U32 };
    let multipliers = vec![1; slaves];
    let mut program =
        Program::with_startup(stepped_echo(slaves), &multipliers, |_| vec![write; downloads]);
    program.activate();
    (1..=10_000)
        .find(|_| {
            program.cycle();
            (0..slaves).all(|slave| program.state(slave).operational)
        })
        .expect("the slaves reach OP")
}

#[test]
fn startup_takes_three_cycles_per_download_and_slave() {
    assert_eq!(cycles_to_op(1, 40) - cycles_to_op(1, 0), 3 * 40);
    assert_eq!(cycles_to_op(3, 40) - cycles_to_op(3, 0), 3 * 40 * 3);
    let (one, four) = (cycles_to_op(1, 0), cycles_to_op(4, 0));
    assert!((4 * one).abs_diff(four) <= 8, "{one} cycles for one slave, {four} for four");
}

#[test]
fn slaves_are_configured_one_after_the_other() {
    let mut program = Program::new(stepped_echo(3), &[1, 1, 1]);
    program.activate();
    let states = |program: &Program| {
        program.simulation().with_world(|world| {
            [0, 1, 2].map(|slave| world.gateway(slave).unwrap().al_state().raw())
        })
    };
    // a slave that waits is still in PREOP; a configured one is in OP
    let mut seen = Vec::new();
    while states(&program) != [8, 8, 8] {
        seen.push(states(&program));
        program.cycle();
        assert!(seen.len() < 5_000);
    }
    for [first, second, third] in seen {
        assert!(second == 2 || first == 8, "{first} {second}");
        assert!(third == 2 || (first, second) == (8, 8), "{first} {second} {third}");
    }
}

#[test]
fn failing_slave_does_not_delay_later_slaves() {
    let mut program = Program::new(stepped_echo(2), &[1, 1]);
    let fault = GatewayFault::SdoAbort { index: 0x8010, subindex: 1, code: 0x0800_0022, times: 1 };
    program.simulation().inject(Fault::Gateway { gateway: 0, fault });
    program.activate();
    program.cycles(2_000);
    assert!(program.master.slave_info(0).unwrap().error_flag);
    assert!(!program.state(0).operational && program.state(1).operational);
}

#[test]
fn slave_lost_during_configuration_delays_no_other() {
    let mut program = Program::new(stepped_echo(2), &[1, 1]);
    program.activate();
    program.cycles(100);
    program.simulation().inject(Fault::PowerCycle { gateway: 1, off_ms: 300 });
    program.cycles(20);
    program.simulation().inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
}

#[test]
fn short_link_loss_during_configuration_starts_a_scan() {
    let mut program = Program::new(stepped_echo(2), &[1, 1]);
    program.activate();
    program.cycles(100);
    program.simulation().inject(Fault::LinkLoss { gateway: 0, for_ms: 20 });
    program.cycles(3);
    assert!(program.master.info().unwrap().scan_busy);
    assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
}

#[test]
fn request_of_a_slave_runs_while_another_is_configured() {
    let mut program = Program::new(stepped_echo(2), &[1, 1]);
    let config = program.slaves[1].config;
    let request = program.master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
    program.activate();
    program.cycles(20);
    program.master.requests().sdo_read(request).unwrap();
    program.cycles(5);
    assert_eq!(program.master.requests().sdo_state(request).unwrap(), RequestState::Success);
    assert!(!program.state(0).operational);
    assert!(program.reaches_op());
}

#[test]
fn activation_takes_time() {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let clock = program.backend.ecrt.clock().clone();
    let before = clock.now_ns();
    program.activate();
    assert_eq!(clock.now_ns() - before, 3 * CYCLE_NS);
}
