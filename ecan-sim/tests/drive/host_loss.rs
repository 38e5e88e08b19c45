//! Reaction to the loss of the host (0x6007, 0x605A, 0x605E) in every mode and for every cause.
use ecan_canopen::{DriveState, NmtCommand, NmtState, OperatingMode};
use ecan_sim::{DriveConfig, NodeOutput, TraceCause, TraceEvent};

use super::fixture::{Fixture, config};

const MODES: [OperatingMode; 6] = [
    OperatingMode::CyclicPosition,
    OperatingMode::CyclicVelocity,
    OperatingMode::CyclicTorque,
    OperatingMode::ProfileVelocity,
    OperatingMode::ProfilePosition,
    OperatingMode::Homing,
];

/// Default decelerations of the drive: 0x6084, 0x6085 and the maximum.
const PROFILE: f64 = 10_000_000.0;
const QUICK: f64 = 50_000_000.0;
const LIMIT: f64 = 200_000_000.0;

#[derive(Clone, Copy, Debug)]
enum Loss {
    Heartbeat,
    NmtStop,
    ResetCommunication,
    BusOff,
}

const LOSSES: [Loss; 4] = [Loss::Heartbeat, Loss::NmtStop, Loss::ResetCommunication, Loss::BusOff];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Reaction {
    None,
    Release,
    Stop(f64),
}

/// 0x6007, 0x605A, 0x605E and the reaction.
const OPTIONS: [(i64, i64, i64, Reaction); 14] = [
    (0, 2, 2, Reaction::None),
    (1, 2, 0, Reaction::Release),
    (1, 2, 1, Reaction::Stop(PROFILE)),
    (1, 2, 2, Reaction::Stop(QUICK)),
    (1, 2, 3, Reaction::Stop(LIMIT)),
    (2, 2, 2, Reaction::Release),
    (3, 0, 2, Reaction::Release),
    (3, 1, 2, Reaction::Stop(PROFILE)),
    (3, 2, 2, Reaction::Stop(QUICK)),
    (3, 3, 2, Reaction::Stop(LIMIT)),
    (3, 4, 2, Reaction::Stop(LIMIT)),
    (3, 5, 2, Reaction::Stop(PROFILE)),
    (3, 6, 2, Reaction::Stop(QUICK)),
    (3, 7, 2, Reaction::Stop(LIMIT)),
];

fn heartbeat(fixture: &mut Fixture) {
    fixture.frame(0x77F, &[5]);
}

/// A drive that moves, and watches the host.
fn moving(mode: OperatingMode, (host_loss, quick_stop, fault): (i64, i64, i64)) -> Fixture {
    let mut fixture = Fixture::with(&DriveConfig { trace: 5_000, ..config() });
    fixture.write(0x1016, 1, 0x007F_0064, 4).unwrap();
    for (index, value) in [(0x6007, host_loss), (0x605A, quick_stop), (0x605E, fault)] {
        fixture.write(index, 0, value, 2).unwrap();
    }
    fixture.write(0x6098, 0, 19, 1).unwrap();
    heartbeat(&mut fixture);
    fixture.nmt(NmtCommand::Start);
    fixture.enable(mode);
    match mode {
        OperatingMode::CyclicVelocity | OperatingMode::ProfileVelocity => {
            fixture.write(0x60FF, 0, 200_000, 4).unwrap();
        }
        OperatingMode::ProfilePosition => {
            fixture.write(0x607A, 0, 100_000_000, 4).unwrap();
            fixture.controlword(0x1F);
        }
        OperatingMode::Homing => fixture.controlword(0x1F),
        _ => {}
    }
    for ms in 1..=40 {
        if mode == OperatingMode::CyclicPosition {
            fixture.write(0x607A, 0, 1_000 + ms * 200, 4).unwrap();
        }
        if mode == OperatingMode::CyclicTorque {
            // 75 thousandths balance the friction.
            let torque = if fixture.drive.velocity() < 200_000.0 { 150 } else { 75 };
            fixture.write(0x6071, 0, torque, 2).unwrap();
        }
        fixture.pass_ms(1);
        heartbeat(&mut fixture);
    }
    assert!(fixture.drive.velocity() > 100_000.0, "{mode}: {}", fixture.drive.velocity());
    fixture
}

fn lose(fixture: &mut Fixture, loss: Loss) {
    match loss {
        Loss::Heartbeat => fixture.pass_ms(100),
        Loss::NmtStop => drop(fixture.nmt(NmtCommand::Stop)),
        Loss::ResetCommunication => drop(fixture.nmt(NmtCommand::ResetCommunication)),
        Loss::BusOff => {
            let until = fixture.now + 1_000_000_000;
            fixture.drive.bus_off(fixture.now, until, &mut NodeOutput::new());
        }
    }
}

#[test]
fn host_loss_has_its_reaction_in_every_mode() {
    for loss in LOSSES {
        for mode in MODES {
            for (host_loss, quick_stop, fault, expected) in OPTIONS {
                let mut fixture = moving(mode, (host_loss, quick_stop, fault));
                let since = fixture.drive.trace().recorded();
                lose(&mut fixture, loss);
                let found = fixture.drive.trace().since(since).find_map(|record| {
                    let by_host = |cause| match cause {
                        TraceCause::HostLost(_) => host_loss != 1,
                        TraceCause::Fault(_) => host_loss == 1,
                        _ => false,
                    };
                    match record.event {
                        TraceEvent::Stop { deceleration, cause } => {
                            assert!(by_host(cause), "{cause:?}");
                            Some(Reaction::Stop(deceleration))
                        }
                        TraceEvent::Release { cause, .. } => {
                            assert!(by_host(cause), "{cause:?}");
                            Some(Reaction::Release)
                        }
                        _ => None,
                    }
                });
                let text = format!("{loss:?}, {mode}, 0x6007 = {host_loss}, {quick_stop}, {fault}");
                assert_eq!(found.unwrap_or(Reaction::None), expected, "{text}");
                fixture.pass_ms(400);
                let (state, velocity) = (fixture.drive.state(), fixture.drive.velocity());
                match expected {
                    Reaction::None => assert_eq!(state, DriveState::OperationEnabled, "{text}"),
                    _ => {
                        assert_ne!(state, DriveState::OperationEnabled, "{text}");
                        assert!(velocity.abs() < 656.0, "{text}: {velocity}/s");
                    }
                }
            }
        }
    }
}

#[test]
fn drive_recovers_from_bus_off_with_an_emergency() {
    let mut fixture = moving(OperatingMode::CyclicVelocity, (3, 2, 2));
    fixture.lines();
    lose(&mut fixture, Loss::BusOff);
    assert_eq!(fixture.drive.state(), DriveState::QuickStopActive);
    assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational, "0x1029:01 is 0");
    fixture.pass_ms(999);
    assert!(!ecan_sim::Node::is_on_bus(&fixture.drive));
    fixture.lines();
    fixture.pass_ms(2);
    assert!(ecan_sim::Node::is_on_bus(&fixture.drive));
    // In bus-off the heartbeat of the host was missed as well.
    let emergency: Vec<_> = fixture.lines();
    assert_eq!(emergency, [(0x85, vec![0x40, 0x81, 0x11, 0, 0, 0, 0, 0])]);
}
