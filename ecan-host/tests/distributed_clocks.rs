//! Distributed clocks on the stepped clock: drift, start phase, lost frames, both directions.

use std::time::Duration;

use crate::common::{raw_config, raw_config_of, simulated};
use ecan_host::{Adapter, ClockSource, ClockStatus, DcSync, StartupPlan};
use ecan_sim::{
    EcrtVersion, Fault, GatewayFault, LossDirection, Scenario, Simulation, WakeUpDelay,
};

const CYCLE_NS: u32 = 1_000_000;

/// A line of gateways with these drifts in ppm, and an Adapter that is not active yet.
fn opened(drifts: &[i32], scenario: Scenario, dc: DcSync) -> (Adapter, Simulation) {
    let mut scenario = Scenario { gateways: ecan_sim::echo(drifts.len()).gateways, ..scenario };
    for (gateway, ppm) in scenario.gateways.iter_mut().zip(drifts) {
        gateway.config.clock_drift_ppb = ppm * 1_000;
    }
    let (ecrt, simulation) = simulated(scenario);
    let mut config = raw_config_of(drifts.len() as u16, 3);
    config.dc = Some(dc);
    (Adapter::open(&ecrt, config, StartupPlan::default()).unwrap(), simulation)
}

/// The same in OP.
fn in_op(drifts: &[i32], scenario: Scenario, dc: DcSync) -> (Adapter, Simulation) {
    let (mut adapter, simulation) = opened(drifts, scenario, dc);
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    (adapter, simulation)
}

fn following() -> DcSync {
    DcSync {
        source: ClockSource::Reference,
        ..DcSync::new(Duration::from_nanos(CYCLE_NS.into()), Duration::ZERO)
    }
}

fn status(adapter: &Adapter) -> ClockStatus {
    adapter.clock_status().expect("clocks are configured")
}

/// Phase errors that the Adapter tells, one a cycle.
fn phase_errors(adapter: &mut Adapter, cycles: usize) -> Vec<i32> {
    let mut errors = Vec::with_capacity(cycles);
    for _ in 0..cycles {
        adapter.wait_next_cycle();
        adapter.receive().unwrap();
        errors.push(status(adapter).phase_error_ns.unwrap());
        adapter.send().unwrap();
    }
    errors
}

fn worst(errors: &[i32]) -> u32 {
    errors.iter().map(|e| e.unsigned_abs()).max().unwrap()
}

/// How far apart the points of the host's cycle stand in the Sync0 period of a gateway, as its
/// clock tells.
fn true_spread(adapter: &mut Adapter, simulation: &Simulation, cycles: usize) -> u64 {
    let (mut phases, mut first) = (Vec::with_capacity(cycles), None);
    for _ in 0..cycles {
        adapter.wait_next_cycle();
        let now = adapter.clock().now_ns();
        let time = simulation.with_world(|world| world.gateway(0).unwrap().dc_system_time(now));
        let half = u64::from(CYCLE_NS) / 2;
        // From the first on, which is taken into the middle.
        let first = *first.get_or_insert(time.unwrap());
        phases.push((time.unwrap() - first + half) % u64::from(CYCLE_NS));
        adapter.receive().unwrap();
        adapter.send().unwrap();
    }
    phases.iter().max().unwrap() - phases.iter().min().unwrap()
}

#[test]
fn host_follows_from_any_phase_and_with_any_drift() {
    for ppm in [-50, 50] {
        for jump_ns in [0, 1_000, 250_000, 499_000, 750_000] {
            let (mut adapter, simulation) = in_op(&[ppm], Scenario::default(), following());
            let fault = GatewayFault::ClockJump { ns: jump_ns };
            simulation.inject(Fault::Gateway { gateway: 0, fault });
            phase_errors(&mut adapter, 1_000);
            let errors = phase_errors(&mut adapter, 200);
            assert!(worst(&errors) < 1_000, "{ppm} ppm, {jump_ns} ns: {} ns", worst(&errors));
            assert!(status(&adapter).is_locked);
            let rate = status(&adapter).rate_ppb;
            assert!((rate + ppm * 1_000).abs() < 1_000, "{ppm} ppm: {rate} ppb");
            // The gateway's own clock says the same.
            let spread = true_spread(&mut adapter, &simulation, 200);
            assert!(spread < 1_000, "{ppm} ppm, {jump_ns} ns: phases differ by {spread} ns");
        }
    }
}

#[test]
fn cycle_is_in_phase_with_sync0() {
    let dc = DcSync { shift: Duration::from_micros(300), ..following() };
    let (mut adapter, simulation) = in_op(&[50], Scenario::default(), dc);
    phase_errors(&mut adapter, 500);
    let now = adapter.clock().now_ns();
    let point = adapter.cycle_start().deadline_ns;
    let pulse = simulation.with_world(|world| world.gateway(0).unwrap().next_sync0(now).unwrap());
    let phase = (pulse + u64::from(CYCLE_NS) - point % u64::from(CYCLE_NS)) % u64::from(CYCLE_NS);
    assert!(phase.abs_diff(300_000) < 1_000, "Sync0 comes {phase} ns after the point");
}

/// The library returns the lower half of the system time, which wraps every 4.3 s.
#[test]
fn wraps_of_the_system_time_do_not_shift_the_phase() {
    let led = DcSync::new(Duration::from_nanos(CYCLE_NS.into()), Duration::ZERO);
    for dc in [following(), led] {
        let (mut adapter, simulation) = in_op(&[50], Scenario::default(), dc);
        phase_errors(&mut adapter, 1_000);
        let time = |adapter: &Adapter| {
            let now = adapter.clock().now_ns();
            simulation.with_world(|world| world.gateway(0).unwrap().dc_system_time(now)).unwrap()
        };
        let (begin, before) = (time(&adapter) >> 32, status(&adapter));
        let errors = phase_errors(&mut adapter, 9_000);
        assert!((time(&adapter) >> 32) - begin >= 2, "two wraps");
        assert!(worst(&errors) < 1_000, "{:?}: {} ns", dc.source, worst(&errors));
        let after = status(&adapter);
        assert_eq!(after.missed_readings, before.missed_readings);
        assert!((after.rate_ppb - before.rate_ppb).abs() < 1_000, "{after:?}");
    }
}

#[test]
fn lost_frames_are_counted_and_do_not_shift_the_phase() {
    let (mut adapter, simulation) = in_op(&[50, -30], Scenario::default(), following());
    phase_errors(&mut adapter, 1_000);
    for way in [LossDirection::Outward, LossDirection::Return] {
        let before = status(&adapter).missed_readings;
        simulation.inject(Fault::LostFrame { direction: way, cycles: 1 });
        let errors = phase_errors(&mut adapter, 200);
        assert!(worst(&errors) < 1_000, "{way:?}: {} ns", worst(&errors));
        assert_eq!(status(&adapter).missed_readings - before, 1);
        simulation.inject(Fault::LostFrame { direction: way, cycles: 50 });
        let errors = phase_errors(&mut adapter, 300);
        assert!(worst(&errors) < 1_000, "{way:?}: {} ns", worst(&errors));
    }
    assert_eq!(simulation.stderr_lines(), 0);
}

#[test]
fn slaves_follow_the_host() {
    for version in [EcrtVersion::V1_5, EcrtVersion::V1_6] {
        let scenario = Scenario { version, ..Scenario::default() };
        let (mut adapter, _simulation) = in_op(
            &[50, -80, 20],
            scenario,
            DcSync::new(Duration::from_nanos(CYCLE_NS.into()), Duration::ZERO),
        );
        phase_errors(&mut adapter, 1_000);
        let errors = phase_errors(&mut adapter, 200);
        assert!(worst(&errors) < 1_000, "{version:?}: {} ns", worst(&errors));
        let ClockStatus { is_locked, synchrony_ns, rate_ppb, .. } = status(&adapter);
        assert!(is_locked && rate_ppb == 0);
        assert!(synchrony_ns.unwrap() < 1_000, "{synchrony_ns:?}");
        assert_eq!(adapter.clock_correction_ns(), 0);
    }
}

#[test]
fn another_slave_can_be_the_reference() {
    let dc = DcSync { reference: Some(1), ..following() };
    let (mut adapter, _simulation) = in_op(&[-90, 40], Scenario::default(), dc);
    phase_errors(&mut adapter, 1_500);
    let rate = status(&adapter).rate_ppb;
    assert!((rate + 40_000).abs() < 1_000, "the host follows a clock of {rate} ppb");
}

#[test]
fn synchrony_shows_a_clock_that_jumped() {
    let dc = DcSync { monitor_every: 1, ..following() };
    let (mut adapter, simulation) = in_op(&[0, 0], Scenario::default(), dc);
    phase_errors(&mut adapter, 100);
    assert_eq!(status(&adapter).synchrony_ns, Some(0));
    let fault = GatewayFault::ClockJump { ns: 100_000 };
    simulation.inject(Fault::Gateway { gateway: 1, fault });
    phase_errors(&mut adapter, 3);
    assert!(status(&adapter).synchrony_ns.unwrap() > 90_000);
    phase_errors(&mut adapter, 500);
    assert!(status(&adapter).synchrony_ns.unwrap() < 100);
}

#[test]
fn restarted_gateway_is_in_phase_again() {
    let (mut adapter, simulation) = in_op(&[50, -50], Scenario::default(), following());
    phase_errors(&mut adapter, 500);
    simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    let mut cycles = 0;
    while cycles < 20_000 {
        adapter.wait_next_cycle();
        let _ = adapter.receive();
        adapter.send().unwrap();
        cycles += 1;
        if cycles > 5_000 && adapter.domain_is_complete() {
            break;
        }
    }
    assert!(adapter.domain_is_complete());
    phase_errors(&mut adapter, 1_500);
    let errors = phase_errors(&mut adapter, 200);
    assert!(worst(&errors) < 1_000, "{} ns", worst(&errors));
    let lines = simulation.stderr_lines();
    assert!(lines <= 1, "{lines} lines on stderr: at most the one of a scan that just began");
}

#[test]
fn own_cycle_timer_receives_the_correction() {
    let (mut adapter, _simulation) = in_op(&[50], Scenario::default(), following());
    let mut next = adapter.clock().now_ns();
    let mut errors = Vec::new();
    for _ in 0..2_000 {
        adapter.clock().sleep_until_ns(next);
        adapter.receive().unwrap();
        errors.extend(status(&adapter).phase_error_ns);
        adapter.send().unwrap();
        next = (next + u64::from(CYCLE_NS)).saturating_add_signed(adapter.clock_correction_ns());
    }
    assert!(worst(&errors[1_500..]) < 1_000, "{} ns", worst(&errors[1_500..]));
}

#[test]
fn without_clocks_there_is_no_status() {
    let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, raw_config().0, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    assert_eq!(adapter.clock_status(), None);
    assert_eq!(adapter.clock_correction_ns(), 0);
}

/// Phase errors from the first reading on, of a bus whose reference clock jumps before it.
fn first_errors(sync0_cycles: u32, jump_ns: i64, count: usize) -> Vec<i32> {
    let dc =
        DcSync { cycle: Duration::from_nanos((sync0_cycles * CYCLE_NS).into()), ..following() };
    let (mut adapter, simulation) = opened(&[50], Scenario::default(), dc);
    adapter.activate().unwrap();
    let mut errors: Vec<i32> = Vec::new();
    let mut jump = Some(GatewayFault::ClockJump { ns: jump_ns });
    for _ in 0..5_000 {
        adapter.wait_next_cycle();
        adapter.receive().unwrap();
        // Behind the master's own setting of the clocks, before the first answer of the slave.
        if simulation.with_world(|world| world.gateway(0).unwrap().dc_system_time(0)).is_some()
            && let Some(fault) = jump.take()
        {
            simulation.inject(Fault::Gateway { gateway: 0, fault });
        }
        errors.extend(status(&adapter).phase_error_ns);
        adapter.send().unwrap();
        if errors.len() == count {
            return errors;
        }
    }
    panic!("the reference clock was read {} times", errors.len());
}

#[test]
fn first_phase_error_is_corrected_at_once() {
    for sync0_cycles in [1, 4] {
        let half = i64::from(sync0_cycles * CYCLE_NS) / 2;
        for jump_ns in [-half + 1_000, -600_000, -300_000, 300_000, 600_000, half - 1_000] {
            let errors = first_errors(sync0_cycles, jump_ns, 1_000);
            assert!(errors[0].abs() > 100_000, "{jump_ns}: the start is out of phase");
            // The second is of a cycle from before; then the rate is learnt.
            let least = errors[2..].iter().map(|e| e.unsigned_abs()).max().unwrap();
            assert!(least < 5_000, "{sync0_cycles} cycles, {jump_ns}: {least} ns");
            assert!(worst(&errors[600..]) < 1_000, "{sync0_cycles} cycles, {jump_ns}");
        }
    }
}

#[test]
fn late_cycles_of_the_host_do_not_reach_the_clocks() {
    let wake_up = WakeUpDelay { typical_ns: 40_000, p99_ns: 80_000, longest_ns: 200_000 };
    for version in [EcrtVersion::V1_5, EcrtVersion::V1_6] {
        for dc in [DcSync::new(Duration::from_nanos(CYCLE_NS.into()), Duration::ZERO), following()]
        {
            let scenario = Scenario { version, wake_up: Some(wake_up), ..Scenario::default() };
            let (mut adapter, _simulation) = in_op(&[50, -30], scenario, dc);
            phase_errors(&mut adapter, 1_000);
            let errors = phase_errors(&mut adapter, 500);
            assert!(worst(&errors) < 1_000, "{version:?}, {:?}: {}", dc.source, worst(&errors));
            assert!(status(&adapter).is_locked);
        }
    }
}

#[test]
fn lost_reference_slave_is_not_followed() {
    let dc = DcSync { reference: Some(1), ..following() };
    let (mut adapter, simulation) = in_op(&[0, 50], Scenario::default(), dc);
    phase_errors(&mut adapter, 1_000);
    let rate = status(&adapter).rate_ppb;
    let before = status(&adapter).missed_readings;
    simulation.inject(Fault::PowerOff { gateway: 1 });
    for _ in 0..3_000 {
        adapter.wait_next_cycle();
        let _ = adapter.receive();
        adapter.send().unwrap();
        let status_now = status(&adapter);
        assert!((status_now.rate_ppb - rate).abs() < 1_000, "{status_now:?}");
        assert!(status_now.phase_error_ns.unwrap().abs() < 1_000, "{status_now:?}");
    }
    assert!(status(&adapter).missed_readings > before);
}
