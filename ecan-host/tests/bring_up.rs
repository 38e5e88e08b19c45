//! The way to OP and out of it: what the bus is told before, between and after the cycles.

use std::time::Duration;

use crate::common::{raw_config, raw_config_of, run, simulated};
use ecan_host::{
    Adapter, Clock as _, ClockSource, CycleError, DcSync, Delivery, Error, Master, Phase,
    RequestState, StartupPlan, StartupRounds,
};
use ecan_protocol::device::AlState;
use ecan_sim::{Fault, Simulation};

fn al_states(simulation: &Simulation) -> Vec<AlState> {
    simulation.with_world(|world| {
        (0..world.gateway_count()).map(|index| world.gateway(index).unwrap().al_state()).collect()
    })
}

fn in_op(gateways: u16) -> (Adapter, Simulation) {
    let (ecrt, simulation) = simulated(ecan_sim::echo(gateways.into()));
    let config = raw_config_of(gateways, 3);
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    (adapter, simulation)
}

#[test]
fn slaves_leave_op_within_a_few_cycles() {
    let (mut adapter, simulation) = in_op(2);
    let before_ns = simulation.clock().now_ns();
    adapter.leave_op();
    assert_eq!(al_states(&simulation), [AlState::PreOp; 2]);
    let outputs = [0, 1].map(|slave| adapter.domain_report(slave).outputs);
    assert!(!outputs.contains(&Delivery::Confirmed), "{outputs:?}");
    let cycles = (simulation.clock().now_ns() - before_ns) / 1_000_000;
    assert!((1..15).contains(&cycles), "{cycles}");
}

#[test]
fn attached_adapter_leaves_the_slaves_of_its_owner_in_op() {
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut owner = Master::request(&ecrt, 0).unwrap();
    // SAFETY: the owner outlives the Adapter below and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let mut adapter =
        Adapter::attach(&ecrt, shared, raw_config().0, StartupPlan::default()).unwrap();
    owner.set_send_interval(1_000).unwrap();
    owner.activate().unwrap();
    adapter.owner_activated().unwrap();
    let mut cycle = |adapter: &mut Adapter| {
        adapter.wait_next_cycle();
        owner.receive().unwrap();
        adapter.receive().unwrap();
        adapter.send().unwrap();
        owner.send().unwrap();
    };
    for _ in 0..20_000 {
        cycle(&mut adapter);
        if adapter.all_operational().unwrap() {
            break;
        }
    }
    adapter.leave_op();
    (0..30).for_each(|_| cycle(&mut adapter));
    assert_eq!(al_states(&simulation), [AlState::Op]);
}

#[test]
fn startup_has_time_for_every_slave_and_download() {
    let [bare, one, two] = [
        (1, ecan_host::AdapterConfig::new(1).with_cycle(Duration::from_millis(1))),
        (1, raw_config_of(1, 3)),
        (2, raw_config_of(2, 3)),
    ]
    .map(|(gateways, config)| {
        let (ecrt, _simulation) = simulated(ecan_sim::echo(gateways));
        Adapter::open(&ecrt, config, StartupPlan::default()).unwrap().startup_timeout()
    });
    // 5 s of each slave and of the bus; each download takes four cycles and at least 5 ms.
    let states = Duration::from_secs(10);
    assert!(bare > states && one > bare + 10 * Duration::from_millis(9), "{bare:?} {one:?}");
    assert_eq!(two - states - Duration::from_secs(5), 2 * (one - states));
}

#[test]
fn failed_wait_reports_its_time_and_the_held_slave() {
    let (mut adapter, simulation) = in_op(1);
    simulation.inject(Fault::PowerOff { gateway: 0 });
    run(&mut adapter, 100);
    let error = adapter.wait_op(Duration::from_millis(2_500)).unwrap_err();
    let Error::NotOperational(report) = &error else { panic!("{error}") };
    assert!((2_500..2_600).contains(&report.waited_ms), "{}", report.waited_ms);

    // Without a startup that applies a profile for N = 3 the master keeps the slave in PREOP.
    let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
    let config = ecan_host::AdapterConfig::new(1);
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    let error = adapter.wait_op(Duration::from_secs(60)).unwrap_err();
    let Error::NotOperational(report) = &error else { panic!("{error}") };
    assert!(report.waited_ms < 30_000 && report.slaves[0].was_held, "{report:?}");
}

#[test]
fn rounds_let_a_request_end_within_its_cycle() {
    let cycles = |rounds| {
        let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
        let config = raw_config().0.with_cycle(Duration::from_millis(20));
        let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
        let read = adapter.requests().create_sdo(0, 4).unwrap();
        adapter.wait_op(Duration::from_secs(30)).unwrap();
        adapter.set_startup_rounds(rounds);
        run(&mut adapter, 10);
        adapter.requests().sdo_read(read, 0x8000, 10).unwrap();
        let mut count = 0;
        while adapter.requests().sdo_state(read).unwrap() == RequestState::Busy {
            run(&mut adapter, 1);
            count += 1;
        }
        count
    };
    let [off, in_op, on] =
        [StartupRounds::Off, StartupRounds::UntilSafeOp, StartupRounds::On].map(cycles);
    assert!(on <= 2 && off >= 3 && in_op == off, "{off} {in_op} {on}");
}

#[test]
fn clock_difference_of_an_earlier_program_is_cleared_before_activation() {
    let (ecrt, simulation) = simulated(ecan_sim::echo(2));
    let mut config = raw_config_of(2, 3);
    config.dc = Some(DcSync {
        source: ClockSource::Reference,
        ..DcSync::new(Duration::from_millis(1), Duration::ZERO)
    });
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    let differences = |simulation: &Simulation| {
        simulation.with_world(|world| {
            [0, 1].map(|index| world.gateway(index).unwrap().dc_difference_ns())
        })
    };
    simulation.with_world(|world| {
        let now_ns = world.now_ns();
        for index in 0..2 {
            world.with_gateway(index, |gateway, _| {
                gateway.write_dc_system_time(now_ns, 1_000_000);
                gateway.correct_dc_system_time(now_ns, 4_000_000);
            });
        }
    });
    assert!(differences(&simulation).iter().all(|difference| *difference != 0));
    let before_ns = simulation.clock().now_ns();
    adapter.activate().unwrap();
    assert_eq!(differences(&simulation), [0; 2]);
    assert!(simulation.clock().now_ns() - before_ns < 500_000_000, "the writes took effect");
}

#[test]
fn grid_of_the_cycles_starts_with_the_first_cycle_after_the_activation() {
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, raw_config().0, StartupPlan::default()).unwrap();
    adapter.wait_next_cycle();
    adapter.activate().unwrap();
    simulation.pass_ns(1_000_000_000);
    let before_ns = simulation.clock().now_ns();
    adapter.wait_next_cycle();
    let start = adapter.cycle_start();
    assert_eq!((start.skipped, start.has_overrun, start.deadline_ns), (0, false, before_ns));
}

#[test]
fn only_failed_calls_of_the_library_may_pass() {
    let call = "ecrt_master_send";
    let errno = ecan_host::Errno::EIO;
    assert!(CycleError::Library { call, slave: None, errno }.is_temporary());
    assert!(!CycleError::NotActive { is: Phase::Down }.is_temporary());
}

#[test]
fn serial_number_has_both_halves() {
    let (adapter, _simulation) = in_op(1);
    assert_eq!(adapter.slave(0).unwrap().serial_number(), 0x0000_0001_0000_0001);
}
