//! Random sequences of faults and commands, with targets at their very limits: what the drives got
//! is judged by the drives.
#![allow(missing_docs)]

mod axes;

use axes::{Fixture, axes};
use ecan_canopen::DriveState;
use ecan_cia402::AxisPhase;
use ecan_sim::{DriveFault, Fault, GatewayFault, LossDirection};
use proptest::prelude::*;

const AXES: usize = 3;
const STEP: i32 = 150;

#[derive(Debug, Clone)]
enum Event {
    LostFrames(LossDirection, u32),
    BusOff,
    ErrorFrames(u32),
    Silent(usize, u32),
    DriveError(usize),
    DrivePower(usize, u32),
    Blocked(usize, u32),
    GatewayPower(u32),
    LinkLoss(u32),
    Torn,
    Stall(u32),
    HostPause(u64),
    Enable(usize),
    Disable(usize),
    QuickStop(usize),
    Halt(usize),
    Resume(usize),
    Reset(usize),
    Turn(usize),
    FarTarget(usize, i32),
    /// Cycles without `process_rx`, with or without targets.
    Skip(usize, bool),
}

fn event() -> impl Strategy<Value = Event> {
    let n = 0..AXES;
    prop_oneof![
        3 => (any::<bool>(), 1..8_u32).prop_map(|(out, cycles)| {
            Event::LostFrames(if out { LossDirection::Outward } else { LossDirection::Return }, cycles)
        }),
        2 => Just(Event::BusOff),
        1 => (1..20_u32).prop_map(Event::ErrorFrames),
        1 => (n.clone(), 1..300_u32).prop_map(|(n, ms)| Event::Silent(n, ms)),
        1 => n.clone().prop_map(Event::DriveError),
        1 => (n.clone(), 1..300_u32).prop_map(|(n, ms)| Event::DrivePower(n, ms)),
        1 => (n.clone(), 1..200_u32).prop_map(|(n, ms)| Event::Blocked(n, ms)),
        1 => (10..300_u32).prop_map(Event::GatewayPower),
        1 => (1..50_u32).prop_map(Event::LinkLoss),
        1 => Just(Event::Torn),
        1 => (1..12_u32).prop_map(Event::Stall),
        1 => (1..300_u64).prop_map(Event::HostPause),
        2 => n.clone().prop_map(Event::Enable),
        1 => n.clone().prop_map(Event::Disable),
        1 => n.clone().prop_map(Event::QuickStop),
        1 => n.clone().prop_map(Event::Halt),
        1 => n.clone().prop_map(Event::Resume),
        2 => n.clone().prop_map(Event::Reset),
        2 => n.clone().prop_map(Event::Turn),
        1 => (n, any::<i32>()).prop_map(|(n, to)| Event::FarTarget(n, to)),
        3 => (1..12_usize, any::<bool>()).prop_map(|(cycles, sends)| Event::Skip(cycles, sends)),
    ]
}

fn strike(fixture: &mut Fixture, event: &Event) {
    let gateway = |fault| Fault::Gateway { gateway: 0, fault };
    match *event {
        Event::LostFrames(way, cycles) => {
            fixture.inject(Fault::LostFrame { direction: way, cycles })
        }
        Event::BusOff => fixture.inject(Fault::BusOff { gateway: 0, channel: 0 }),
        Event::ErrorFrames(frames) => {
            fixture.inject(Fault::ErrorFrames { gateway: 0, channel: 0, frames });
        }
        Event::Silent(n, for_ms) => {
            fixture.inject(Fault::NodeSilent { node: format!("drive 0.0/{}", n + 1), for_ms });
        }
        Event::DriveError(n) => fixture.strike(n, DriveFault::Error { code: 0x2310 }),
        Event::DrivePower(n, off_ms) => fixture.strike(n, DriveFault::PowerCycle { off_ms }),
        Event::Blocked(n, for_ms) => fixture.strike(n, DriveFault::Blocked { for_ms }),
        Event::GatewayPower(off_ms) => fixture.inject(Fault::PowerCycle { gateway: 0, off_ms }),
        Event::LinkLoss(for_ms) => fixture.inject(Fault::LinkLoss { gateway: 0, for_ms }),
        Event::Torn => fixture.inject(gateway(GatewayFault::TornTxPdo { images: 2 })),
        Event::Stall(ms) => fixture.inject(gateway(GatewayFault::ServiceStall { ms })),
        Event::HostPause(ms) => fixture.simulation.pass_ns(ms * 1_000_000),
        Event::Skip(cycles, sends) => fixture.skip(cycles, sends),
        _ => {}
    }
    let cia402 = &mut fixture.cia402;
    // A command that is rejected is one more thing that can happen.
    let _ = match *event {
        Event::Enable(n) => cia402.enable(n),
        Event::Disable(n) => cia402.disable(n),
        Event::QuickStop(n) => cia402.quick_stop(n),
        Event::Halt(n) => cia402.halt(n),
        Event::Resume(n) => cia402.resume(n),
        Event::Reset(n) => cia402.reset_fault(n),
        Event::Turn(n) => cia402.set_target_step(n, -STEP),
        Event::FarTarget(n, to) => cia402.set_target(n, to),
        _ => Ok(()),
    };
}

/// A patient operator: every axis that holds is activated again. A command that is rejected
/// is given again later.
fn operate(fixture: &mut Fixture) {
    for n in 0..AXES {
        let _ = match fixture.cia402.phase(n) {
            Some(AxisPhase::NotConfigured | AxisPhase::SetupFailed) => fixture.cia402.configure(n),
            Some(AxisPhase::Halted) => fixture.cia402.resume(n),
            Some(AxisPhase::Fault) => fixture.cia402.reset_fault(n),
            Some(AxisPhase::Standby | AxisPhase::Holding(_) | AxisPhase::Stopped(_)) => {
                fixture.cia402.enable(n)
            }
            _ => Ok(()),
        };
    }
}

/// Targets at the limit: a step is the limit.
fn fixture() -> Fixture {
    let table = axes(AXES)
        .into_iter()
        .map(|mut axis| {
            axis.step_limit = STEP as u32;
            axis.target_step = STEP;
            axis.following_window = 3_000;
            axis.ramp = 50;
            axis.drive.following_error = Some((3_000, 20));
            axis
        })
        .collect();
    Fixture::single(table).started()
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: axes::cases(64),
        failure_persistence: None,
        max_shrink_iters: 200,
        ..ProptestConfig::default()
    })]

    #[test]
    fn no_axis_ever_jumps(events in prop::collection::vec((event(), 1..120_usize), 1..14)) {
        let mut fixture = fixture();
        for (event, cycles) in &events {
            strike(&mut fixture, event);
            for cycle in 0..*cycles {
                fixture.step();
                if cycle % 40 == 39 {
                    operate(&mut fixture);
                }
            }
        }
        // And back to work, however bad it was. What has struck may show late.
        let mut sound = 0;
        for cycle in 0..20_000 {
            sound = if fixture.cia402.all_running() { sound + 1 } else { 0 };
            if sound > 400 {
                break;
            }
            fixture.step();
            if cycle % 40 == 39 {
                operate(&mut fixture);
            }
        }
        prop_assert!(
            sound > 400,
            "gateway {}, {:#?}",
            fixture.session(),
            fixture.cia402.progress_all().map(|axis| axis.to_string()).collect::<Vec<_>>()
        );
        for n in 0..AXES {
            let state = fixture.drive(n, |drive| drive.state());
            prop_assert_eq!(state, DriveState::OperationEnabled);
        }
        fixture.check();
    }
}
