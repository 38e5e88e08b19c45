//! Modes of operation: motion of the motor and its limits.

use super::fixture::{Fixture, MS, config};
use ecan_canopen::{DriveState, NmtCommand, OperatingMode};
use ecan_sim::{DriveConfig, DriveQuirks, MotorConfig, NodeOutput, TargetKind};

const ENABLE: u16 = 0x0F;

/// A drive in CSP with 1 ms SYNC, enabled, at 1000.
fn cyclic() -> Fixture {
    let mut fixture = Fixture::booted();
    fixture.start_csp(1000);
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    fixture
}

#[test]
fn drive_follows_cyclic_positions() {
    let mut fixture = cyclic();
    let mut target = 1000;
    let mut worst = 0;
    for _ in 0..2000 {
        target += 100;
        let (status, position) = fixture.cycle(ENABLE, target);
        assert_eq!(status & 0x106F, 0x1027);
        worst = worst.max((target - position).abs());
        assert!(fixture.drive.following_error().abs() < 200, "{}", fixture.drive.following_error());
    }
    // one cycle on the wire, one of interpolation, and the controller's error
    assert!((100..500).contains(&worst), "{worst}");
    for _ in 0..100 {
        fixture.cycle(ENABLE, target);
    }
    assert_eq!(fixture.drive.position(), target);
    assert_eq!((fixture.drive.velocity().round(), fixture.drive.following_error()), (0.0, 0));
    let sums = fixture.drive.targets().sums();
    assert_eq!((sums.largest_first_offset, sums.largest_step), (0, 100));
    assert_eq!(sums.outside_window, 0);
}

#[test]
fn motion_between_targets_is_linear() {
    let mut fixture = cyclic();
    fixture.write(0x60C2, 1, 10, 1).unwrap();
    let mut target = 1000;
    let mut speeds = Vec::new();
    for cycle in 0..100 {
        target += 1000;
        fixture.cycle(ENABLE, target);
        for _ in 0..9 {
            fixture.pass_ms(1);
            if cycle > 10 {
                speeds.push(fixture.drive.velocity());
            }
        }
    }
    // 1000 increments in 10 ms
    assert!(speeds.iter().all(|speed| (speed - 100_000.0).abs() < 10_000.0), "{speeds:?}");
}

#[test]
fn drive_enabled_without_target_stays_at_standstill() {
    let mut fixture = Fixture::booted();
    fixture.write(0x607A, 0, 50_000, 4).unwrap();
    fixture.enable(OperatingMode::CyclicPosition);
    fixture.pass_ms(500);
    assert_eq!(fixture.drive.position(), 1000);
    // the quirk: it moves to the previous value of 0x607A
    let quirks = DriveQuirks { follows_old_target: true, ..DriveQuirks::default() };
    let mut fixture = Fixture::with_quirks(quirks);
    fixture.writes(&[(0x6065, 0, 0xFFFF_FFFF, 4), (0x607A, 0, 50_000, 4)]);
    fixture.enable(OperatingMode::CyclicPosition);
    fixture.pass_ms(500);
    assert_eq!(fixture.drive.position(), 50_000);
}

#[test]
fn history_contains_every_target_and_marks_first() {
    let mut fixture = Fixture::booted();
    fixture.map_csp();
    fixture.nmt(NmtCommand::Start);
    fixture.cycle(0x06, 77);
    fixture.cycle(0x07, 1000);
    fixture.cycle(0x0F, 1001);
    fixture.cycle(0x0F, 1003);
    fixture.cycle(0x00, 1006);
    let history = fixture.drive.targets();
    let seen: Vec<_> = history
        .iter()
        .map(|record| (record.target, record.state, record.first, record.previous))
        .collect();
    use DriveState::{OperationEnabled, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    assert_eq!(
        seen,
        [
            (77, ReadyToSwitchOn, false, None),
            (1000, SwitchedOn, false, None),
            (1001, OperationEnabled, true, None),
            (1003, OperationEnabled, false, Some(1001)),
            (1006, SwitchOnDisabled, false, None),
        ]
    );
    let first = history.iter().find(|record| record.first).unwrap();
    assert_eq!((first.kind, first.actual, first.offset()), (TargetKind::Position, 1000, 1));
    assert_eq!(first.time_ns, history.iter().next().unwrap().time_ns + 2 * MS);
    assert_eq!(first.window, 32_768);
    let sums = history.sums();
    assert_eq!((sums.followed, sums.ignored, sums.firsts), (2, 3, 1));
    assert_eq!((sums.largest_first_offset, sums.largest_step), (1, 2));
    // after enabling again, the next target is a first target
    for word in [0x06, 0x07, 0x0F] {
        fixture.cycle(word, 5000);
    }
    assert_eq!(fixture.drive.targets().sums().firsts, 2);
    assert!(fixture.drive.targets().sums().largest_first_offset >= 3990);
}

#[test]
fn history_is_bounded_and_sums_are_complete() {
    let mut fixture = Fixture::with(&DriveConfig { history: 4, ..config() });
    fixture.map_csp();
    fixture.nmt(NmtCommand::Start);
    for target in 0..10 {
        fixture.cycle(0, target);
    }
    let targets: Vec<_> = fixture.drive.targets().iter().map(|record| record.target).collect();
    assert_eq!(targets, [6, 7, 8, 9]);
    assert_eq!(fixture.drive.targets().sums().ignored, 10);
}

#[test]
fn unreachable_target_causes_following_error() {
    let mut fixture = cyclic();
    let (mut faulted_at, mut status) = (None, 0);
    for cycle in 0..300 {
        status = fixture.cycle(ENABLE, 1_000_000).0;
        if faulted_at.is_none() && fixture.drive.error_code() != 0 {
            faulted_at = Some(cycle);
        }
    }
    // 10 ms beyond the window (0x6066)
    assert!((10..15).contains(&faulted_at.unwrap()), "{faulted_at:?}");
    assert_eq!(fixture.drive.error_code(), 0x8611);
    assert_eq!(status & 0x4F, 0x08);
    assert!(fixture.drive.targets().sums().outside_window > 0);
    assert!(fixture.sent.iter().any(|(_, (id, data))| *id == 0x085 && data[..2] == [0x11, 0x86]));
}

#[test]
fn blocked_motor_causes_following_error() {
    let mut fixture = cyclic();
    fixture.write(0x6065, 0, 500, 4).unwrap();
    let until = fixture.now + 50 * MS;
    fixture.drive.block(fixture.now, until, &mut NodeOutput::new());
    let mut target = 1000;
    for _ in 0..40 {
        target += 50;
        fixture.cycle(ENABLE, target);
    }
    assert_eq!(fixture.drive.position(), 1000);
    assert_eq!(fixture.drive.error_code(), 0x8611);
    assert_eq!(fixture.drive.state(), DriveState::Fault);
}

#[test]
fn software_limits_clamp_targets() {
    let mut fixture = cyclic();
    fixture.writes(&[(0x607D, 1, -500, 4), (0x607D, 2, 1500, 4)]);
    let mut target = 1000;
    let mut status = 0;
    for _ in 0..200 {
        target += 10;
        status = fixture.cycle(ENABLE, target).0;
    }
    assert_eq!(fixture.drive.position(), 1500);
    assert_eq!(status & 0x0800, 0x0800);
}

#[test]
fn positions_wrap_at_32_bits() {
    let motor = MotorConfig { start_position: i32::MAX - 500, ..MotorConfig::default() };
    let mut fixture = Fixture::with(&DriveConfig { motor, ..config() });
    let mut target = i32::MAX - 500;
    fixture.start_csp(target);
    for _ in 0..100 {
        target = target.wrapping_add(100);
        fixture.cycle(ENABLE, target);
    }
    for _ in 0..100 {
        fixture.cycle(ENABLE, target);
    }
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    assert_eq!(fixture.drive.position(), target);
    assert!(target < 0);
}

#[test]
fn cyclic_velocity_and_torque_are_followed() {
    let mut fixture = Fixture::booted();
    fixture.write(0x60FF, 0, 500_000, 4).unwrap();
    fixture.enable(OperatingMode::CyclicVelocity);
    fixture.pass_ms(50);
    // the velocity was written before enabling
    assert_eq!(fixture.drive.velocity(), 0.0);
    fixture.write(0x60FF, 0, 500_000, 4).unwrap();
    fixture.pass_ms(50);
    assert!((fixture.drive.velocity() - 500_000.0).abs() < 1.0);
    assert_eq!(fixture.read(0x606C, 0), Ok(500_000));
    // torque first overcomes friction: 5 of 200 million at 3000 thousandths
    assert_eq!(fixture.read(0x6077, 0), Ok(75));

    let mut fixture = Fixture::booted();
    fixture.enable(OperatingMode::CyclicTorque);
    fixture.write(0x6071, 0, 150, 2).unwrap();
    fixture.pass_ms(100);
    // 75 of 150 thousandths remain for acceleration: 5 000 000 increments/s² for 100 ms
    assert!(
        (fixture.drive.velocity() - 500_000.0).abs() < 10_000.0,
        "{}",
        fixture.drive.velocity()
    );
    fixture.write(0x6071, 0, 0, 2).unwrap();
    fixture.pass_ms(110);
    assert_eq!(fixture.drive.velocity(), 0.0);
}

#[test]
fn velocity_and_torque_are_limited() {
    let mut fixture = Fixture::booted();
    fixture.enable(OperatingMode::CyclicVelocity);
    fixture.write(0x60FF, 0, i64::from(i32::MAX), 4).unwrap();
    fixture.pass_ms(200);
    assert_eq!(fixture.drive.velocity(), 6_553_600.0);
    let mut fixture = Fixture::booted();
    fixture.write(0x6072, 0, 150, 2).unwrap();
    fixture.enable(OperatingMode::CyclicTorque);
    fixture.write(0x6071, 0, 3000, 2).unwrap();
    fixture.pass_ms(100);
    assert_eq!(fixture.read(0x6077, 0), Ok(150));
    assert!((fixture.drive.velocity() - 500_000.0).abs() < 10_000.0);
}

#[test]
fn profile_velocity_uses_profile_acceleration() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x6083, 0, 1_000_000, 4), (0x60FF, 0, 200_000, 4)]);
    fixture.enable(OperatingMode::ProfileVelocity);
    fixture.pass_ms(100);
    assert!((fixture.drive.velocity() - 100_000.0).abs() < 5_000.0);
    assert_eq!(fixture.drive.statusword().0 & 0x1400, 0);
    fixture.pass_ms(150);
    // target reached, not at standstill
    assert_eq!(fixture.drive.statusword().0 & 0x1400, 0x0400);
    fixture.write(0x60FF, 0, 0, 4).unwrap();
    fixture.pass_ms(100);
    assert_eq!(fixture.drive.statusword().0 & 0x1400, 0x1400);
    assert_eq!(fixture.drive.velocity(), 0.0);
}

/// Bits of the statusword in profile position: target reached 10, set-point acknowledged 12.
fn profile_bits(fixture: &Fixture) -> (bool, bool) {
    let word = fixture.drive.statusword().0;
    (word & 0x0400 != 0, word & 0x1000 != 0)
}

#[test]
fn profile_position_accepts_set_points_on_edge() {
    let mut fixture = Fixture::booted();
    fixture.enable(OperatingMode::ProfilePosition);
    fixture.write(0x607A, 0, 31_000, 4).unwrap();
    fixture.pass_ms(100);
    assert_eq!(fixture.drive.position(), 1000);
    fixture.controlword(0x1F);
    assert_eq!(profile_bits(&fixture), (false, true));
    fixture.controlword(0x0F);
    assert_eq!(profile_bits(&fixture), (false, false));
    fixture.pass_ms(400);
    assert_eq!((fixture.drive.position(), profile_bits(&fixture)), (31_000, (true, false)));
    // relative to the present set-point
    fixture.write(0x607A, 0, -1_000, 4).unwrap();
    fixture.controlword(0x5F);
    fixture.controlword(0x0F);
    fixture.pass_ms(400);
    assert_eq!(fixture.drive.position(), 30_000);
}

fn furthest_within_a_second(fixture: &mut Fixture) -> i32 {
    let positions = (0..1000).map(|_| {
        fixture.pass_ms(1);
        fixture.drive.position()
    });
    positions.max().unwrap()
}

#[test]
fn set_points_are_queued_or_replaced() {
    let mut fixture = Fixture::booted();
    fixture.enable(OperatingMode::ProfilePosition);
    let set_point = |fixture: &mut Fixture, target: i64, word: u16| {
        fixture.write(0x607A, 0, target, 4).unwrap();
        fixture.controlword(word);
        fixture.controlword(0x0F);
    };
    set_point(&mut fixture, 51_000, 0x1F);
    fixture.pass_ms(10);
    // the buffer is full: acknowledged until it is free
    set_point(&mut fixture, 1_000, 0x1F);
    assert_eq!(profile_bits(&fixture), (false, true));
    let furthest = furthest_within_a_second(&mut fixture);
    assert!((50_900..51_100).contains(&furthest), "{furthest}");
    assert_eq!(fixture.drive.position(), 1_000);
    // immediately
    set_point(&mut fixture, 51_000, 0x1F);
    fixture.pass_ms(20);
    set_point(&mut fixture, -9_000, 0x3F);
    assert!(furthest_within_a_second(&mut fixture) < 40_000);
    assert_eq!(fixture.drive.position(), -9_000);
}

#[test]
fn profile_position_respects_limits() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x6081, 0, 100_000, 4), (0x6083, 0, 1_000_000, 4), (0x6084, 0, 500_000, 4)]);
    fixture.enable(OperatingMode::ProfilePosition);
    fixture.write(0x607A, 0, 101_000, 4).unwrap();
    fixture.controlword(0x1F);
    let start = fixture.now;
    let mut fastest = 0.0f64;
    while !profile_bits(&fixture).0 {
        fixture.pass_ms(1);
        fastest = fastest.max(fixture.drive.velocity());
        assert!(fixture.now < start + 3_000 * MS);
    }
    assert!((fastest - 100_000.0).abs() < 5_000.0, "{fastest}");
    // 0.1 s up (5000), 0.2 s down (10 000), 85 000 at full speed: 1.15 s, and the window time
    let ms = (fixture.now - start) / MS;
    assert!((1_140..1_200).contains(&ms), "{ms}");
    // a halt stops the motion, which then continues
    fixture.controlword(0x0F);
    fixture.write(0x607A, 0, 1_000, 4).unwrap();
    fixture.controlword(0x1F);
    fixture.pass_ms(300);
    fixture.controlword(0x11F);
    fixture.pass_ms(400);
    let halted = fixture.drive.position();
    assert!((10_000..95_000).contains(&halted) && fixture.drive.velocity().abs() < 1.0);
    fixture.controlword(0x1F);
    fixture.pass_ms(2_000);
    assert_eq!(fixture.drive.position(), 1_000);
}

/// Bits of the statusword in homing: 10 target reached, 12 attained, 13 error.
fn homing_bits(fixture: &Fixture) -> (bool, bool, bool) {
    let word = fixture.drive.statusword().0;
    (word & 0x0400 != 0, word & 0x1000 != 0, word & 0x2000 != 0)
}

fn home(method: i64, offset: i64, machine: MotorConfig) -> (Fixture, u64) {
    let mut fixture = Fixture::with(&DriveConfig { motor: machine, ..config() });
    fixture.writes(&[(0x6098, 0, method, 1), (0x607C, 0, offset, 4)]);
    fixture.enable(OperatingMode::Homing);
    assert_eq!(homing_bits(&fixture), (true, false, false));
    fixture.controlword(0x1F);
    let start = fixture.now;
    while !homing_bits(&fixture).0 || fixture.now == start {
        fixture.pass_ms(1);
        assert!(fixture.now < start + 60_000 * MS, "homing never ends");
    }
    let ms = (fixture.now - start) / MS;
    (fixture, ms)
}

#[test]
fn homing_on_present_position_finishes_at_once() {
    for method in [35, 37] {
        let (fixture, ms) = home(method, 0, config().motor);
        assert!(ms < 5);
        assert_eq!(homing_bits(&fixture), (true, true, false));
        assert_eq!(fixture.drive.position(), 0);
        assert_eq!(fixture.drive.mechanical_position().round(), 1000.0);
        // the zero position is the offset away from home
        let (fixture, _) = home(method, 250, config().motor);
        assert_eq!(fixture.drive.position(), -250);
    }
}

#[test]
fn homing_on_switch_moves_to_switch() {
    let machine = MotorConfig {
        start_position: 30_000,
        limit_switches: (-20_000, 200_000),
        home_switch: 90_000,
        ..MotorConfig::default()
    };
    // slowly, so that the switches are detected within a few increments
    for (method, home_at) in [(17, -20_000), (18, 200_000), (19, 90_000), (20, 90_000)] {
        let (fixture, ms) = home(method, 0, machine);
        assert!(ms > 300, "method {method}: {ms} ms");
        assert_eq!(homing_bits(&fixture), (true, true, false), "method {method}");
        let zero = fixture.drive.mechanical_position() - f64::from(fixture.drive.position());
        assert!((zero - f64::from(home_at)).abs() < 60.0, "method {method}: zero at {zero}");
        // close to the new zero
        assert!(fixture.drive.position().abs() < 200, "{}", fixture.drive.position());
    }
    // index pulses at multiples of a revolution
    let (fixture, _) = home(34, 0, machine);
    let zero = fixture.drive.mechanical_position() - f64::from(fixture.drive.position());
    assert_eq!(zero.round(), 65_536.0);
}

#[test]
fn homing_without_switch_fails() {
    let machine = MotorConfig { home_switch: i32::MAX, ..config().motor };
    let (mut fixture, _) = home(19, 0, machine);
    assert_eq!(homing_bits(&fixture), (true, false, true));
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    assert_eq!(fixture.write(0x6098, 0, 3, 1), Err(0x0609_0030));
}

#[test]
fn homing_is_aborted_by_its_bit_and_by_halt() {
    for word in [0x0F, 0x11F] {
        let mut fixture = Fixture::booted();
        fixture.write(0x6098, 0, 17, 1).unwrap();
        fixture.enable(OperatingMode::Homing);
        fixture.controlword(0x1F);
        fixture.pass_ms(300);
        assert!(fixture.drive.velocity() < -1000.0);
        fixture.controlword(word);
        fixture.pass_ms(300);
        assert!(fixture.drive.velocity().abs() < 1.0);
        // interrupted: reached, not attained, no error
        assert_eq!(homing_bits(&fixture), (true, false, false));
    }
}

#[test]
fn target_after_homing_is_first() {
    let mut fixture = cyclic();
    fixture.cycle(ENABLE, 1000);
    assert_eq!(fixture.drive.targets().sums().firsts, 1);
    fixture.mode(OperatingMode::Homing);
    fixture.controlword(0x1F);
    fixture.pass_ms(10);
    assert_eq!(fixture.drive.position(), 0);
    fixture.mode(OperatingMode::CyclicPosition);
    fixture.cycle(ENABLE, 0);
    let sums = fixture.drive.targets().sums();
    assert_eq!((sums.firsts, sums.largest_step, sums.largest_first_offset), (2, 0, 0));
}

#[test]
fn mode_change_while_moving_stops_motor() {
    let mut fixture = Fixture::booted();
    fixture.enable(OperatingMode::CyclicVelocity);
    fixture.write(0x60FF, 0, 500_000, 4).unwrap();
    fixture.pass_ms(50);
    fixture.mode(OperatingMode::CyclicPosition);
    fixture.pass_ms(200);
    assert!(fixture.drive.velocity().abs() < 1.0);
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
}

#[test]
fn motor_coasts_after_loss_of_supply() {
    for absolute in [true, false] {
        let motor = MotorConfig { absolute_encoder: absolute, ..config().motor };
        let mut fixture = Fixture::with(&DriveConfig { motor, ..config() });
        fixture.enable(OperatingMode::CyclicVelocity);
        fixture.write(0x60FF, 0, 1_000_000, 4).unwrap();
        fixture.pass_ms(100);
        let (before, off) = (fixture.drive.mechanical_position(), fixture.now);
        fixture.drive.power_cycle(off, off + 500 * MS);
        assert!(!fixture.drive.is_powered());
        fixture.pass_ms(500);
        // not ready before it has booted
        assert_eq!(fixture.drive.state(), DriveState::NotReadyToSwitchOn);
        fixture.pass_ms(40);
        assert_eq!(fixture.drive.state(), DriveState::SwitchOnDisabled);
        assert_eq!(fixture.sent.last().unwrap().1, (0x705, vec![0]));
        // 1e6 increments/s on 5e6 increments/s² of friction are 100 000 increments
        let coasted = fixture.drive.mechanical_position() - before;
        assert!((coasted - 100_000.0).abs() < 2_000.0, "{coasted}");
        if absolute {
            let mechanical = fixture.drive.mechanical_position().round() as i32;
            assert_eq!(fixture.drive.position(), mechanical);
        } else {
            assert_eq!(fixture.drive.position(), 0);
        }
    }
}

#[test]
fn digital_inputs_show_switches() {
    for (start_position, inputs) in [(150_000, 4), (-500_000, 1)] {
        let motor = MotorConfig { start_position, ..MotorConfig::default() };
        let mut fixture = Fixture::with(&DriveConfig { motor, ..config() });
        assert_eq!(fixture.read(0x60FD, 0), Ok(inputs), "{start_position}");
    }
}
