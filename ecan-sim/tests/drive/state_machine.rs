//! The CiA 402 state machine of the drive: transitions, option codes, faults.

use std::collections::BTreeSet;

use super::fixture::{Fixture, config};
use ecan_canopen::DriveState::{
    self, Fault, FaultReactionActive, OperationEnabled, QuickStopActive, ReadyToSwitchOn,
    SwitchOnDisabled, SwitchedOn,
};
use ecan_canopen::{Command, NmtCommand, OperatingMode};
use ecan_sim::{DriveConfig, DriveQuirks, NodeOutput};

const SHUTDOWN: u16 = 0x06;
const SWITCH_ON: u16 = 0x07;
const ENABLE: u16 = 0x0F;
const DISABLE_VOLTAGE: u16 = 0x00;
const QUICK_STOP: u16 = 0x02;
const FAULT_RESET: u16 = 0x80;

/// Controlwords from switch on disabled to a state, at standstill.
fn way_to(state: DriveState) -> Fixture {
    let mut fixture = Fixture::booted();
    fixture.mode(OperatingMode::CyclicPosition);
    // stay in quick stop active
    fixture.write(0x605A, 0, 6, 2).unwrap();
    // disable at once
    fixture.write(0x605C, 0, 0, 2).unwrap();
    let controlwords: &[u16] = match state {
        ReadyToSwitchOn => &[SHUTDOWN],
        SwitchedOn => &[SHUTDOWN, SWITCH_ON],
        OperationEnabled => &[SHUTDOWN, SWITCH_ON, ENABLE],
        QuickStopActive => &[SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP],
        _ => &[],
    };
    controlwords.iter().for_each(|word| fixture.controlword(*word));
    if state == Fault {
        fixture.drive.fail(fixture.now, 0x1000, &mut NodeOutput::new());
    }
    assert_eq!(fixture.drive.state(), state);
    fixture
}

#[test]
fn every_controlword_in_every_state_has_its_transition() {
    let table: [(_, &[u16], _); 21] = [
        (SwitchOnDisabled, &[SHUTDOWN], ReadyToSwitchOn),
        (SwitchOnDisabled, &[SWITCH_ON, ENABLE], SwitchOnDisabled),
        (SwitchOnDisabled, &[DISABLE_VOLTAGE, QUICK_STOP, FAULT_RESET], SwitchOnDisabled),
        (ReadyToSwitchOn, &[SHUTDOWN], ReadyToSwitchOn),
        (ReadyToSwitchOn, &[SWITCH_ON], SwitchedOn),
        // transitions 3 and 4 together
        (ReadyToSwitchOn, &[ENABLE], OperationEnabled),
        // bit 7 has no meaning here, the rest is disable voltage
        (ReadyToSwitchOn, &[DISABLE_VOLTAGE, QUICK_STOP, FAULT_RESET], SwitchOnDisabled),
        (SwitchedOn, &[SHUTDOWN], ReadyToSwitchOn),
        (SwitchedOn, &[SWITCH_ON], SwitchedOn),
        (SwitchedOn, &[ENABLE], OperationEnabled),
        (SwitchedOn, &[DISABLE_VOLTAGE, QUICK_STOP, FAULT_RESET], SwitchOnDisabled),
        (OperationEnabled, &[SHUTDOWN], ReadyToSwitchOn),
        (OperationEnabled, &[SWITCH_ON], SwitchedOn),
        (OperationEnabled, &[ENABLE], OperationEnabled),
        (OperationEnabled, &[DISABLE_VOLTAGE, FAULT_RESET], SwitchOnDisabled),
        (OperationEnabled, &[QUICK_STOP], QuickStopActive),
        (QuickStopActive, &[SHUTDOWN, SWITCH_ON, QUICK_STOP], QuickStopActive),
        // transition 16
        (QuickStopActive, &[ENABLE], OperationEnabled),
        (QuickStopActive, &[DISABLE_VOLTAGE, FAULT_RESET], SwitchOnDisabled),
        (Fault, &[SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP], Fault),
        (Fault, &[FAULT_RESET], SwitchOnDisabled),
    ];
    let mut pairs = BTreeSet::new();
    for (from, words, to) in table {
        for word in words {
            let mut fixture = way_to(from);
            fixture.controlword(*word);
            assert_eq!(fixture.drive.state(), to, "{from} with {word:#04X}");
            pairs.insert((from.to_string(), word));
        }
    }
    assert_eq!(pairs.len(), 6 * 6, "every controlword in every state");
}

#[test]
fn each_state_has_its_statusword() {
    let controlwords = [
        (SwitchOnDisabled, 0x0240),
        (ReadyToSwitchOn, 0x0221),
        (SwitchedOn, 0x0233),
        // cyclic: bit 12, the drive follows its target
        (OperationEnabled, 0x1237),
        (QuickStopActive, 0x0217),
        (Fault, 0x0208),
    ];
    for (state, word) in controlwords {
        let mut fixture = way_to(state);
        assert_eq!(fixture.read(0x6041, 0), Ok(word), "{state}");
        assert_eq!(u32::from(fixture.drive.statusword().0), word);
    }
}

#[test]
fn only_rising_edge_resets_fault() {
    let mut fixture = Fixture::booted();
    fixture.controlword(FAULT_RESET);
    fixture.drive.fail(fixture.now, 0x2310, &mut NodeOutput::new());
    // the bit is still set
    for _ in 0..3 {
        fixture.controlword(FAULT_RESET);
        assert_eq!(fixture.drive.state(), Fault);
    }
    fixture.controlword(0);
    fixture.controlword(FAULT_RESET);
    assert_eq!(fixture.drive.state(), SwitchOnDisabled);
    assert_eq!(fixture.drive.error_code(), 0);
}

/// An axis that moves at 1 000 000 increments per second in profile velocity.
fn turning() -> Fixture {
    let mut fixture = Fixture::booted();
    fixture.write(0x60FF, 0, 1_000_000, 4).unwrap();
    fixture.enable(OperatingMode::ProfileVelocity);
    fixture.pass_ms(200);
    assert!((fixture.drive.velocity() - 1e6).abs() < 1e3, "{}", fixture.drive.velocity());
    fixture
}

/// Returns the milliseconds until standstill and the states until then.
fn until_standing(fixture: &mut Fixture) -> (usize, Vec<DriveState>) {
    let mut states = Vec::new();
    for ms in 0..1000 {
        if states.last() != Some(&fixture.drive.state()) {
            states.push(fixture.drive.state());
        }
        if fixture.drive.velocity().abs() < 1_000.0 {
            return (ms, states);
        }
        fixture.pass_ms(1);
    }
    panic!("no standstill");
}

// Speed over deceleration: friction 200 ms, profile (10 000 000) 100 ms, quick (50 000 000) 20 ms,
// limit (200 000 000) 5 ms.

#[test]
fn quick_stop_option_codes_apply() {
    let cases = [
        (0, 150..250, SwitchOnDisabled),
        (1, 95..115, SwitchOnDisabled),
        (2, 18..35, SwitchOnDisabled),
        (3, 4..20, SwitchOnDisabled),
        (5, 95..115, QuickStopActive),
        (6, 18..35, QuickStopActive),
        (7, 4..20, QuickStopActive),
    ];
    for (option, time, end) in cases {
        let mut fixture = turning();
        fixture.write(0x605A, 0, option, 2).unwrap();
        fixture.controlword(QUICK_STOP);
        let first = if option == 0 { SwitchOnDisabled } else { QuickStopActive };
        assert_eq!(fixture.drive.state(), first);
        let (ms, _) = until_standing(&mut fixture);
        assert!(time.contains(&ms), "option {option}: {ms} ms");
        fixture.pass_ms(20);
        assert_eq!(fixture.drive.state(), end, "option {option}");
    }
}

#[test]
fn shutdown_and_disable_operation_option_codes_apply() {
    // 0x605B, 0x605C: 0 switches the current off, 1 decelerates first
    for (object, word, end) in
        [(0x605B, SHUTDOWN, ReadyToSwitchOn), (0x605C, SWITCH_ON, SwitchedOn)]
    {
        let mut fixture = turning();
        fixture.write(object, 0, 0, 2).unwrap();
        fixture.controlword(word);
        assert_eq!(fixture.drive.state(), end);
        assert!(until_standing(&mut fixture).0 > 150);
        let mut fixture = turning();
        fixture.write(object, 0, 1, 2).unwrap();
        fixture.controlword(word);
        let (ms, states) = until_standing(&mut fixture);
        assert!((95..115).contains(&ms), "{ms}");
        assert_eq!(states[0], OperationEnabled);
        fixture.pass_ms(20);
        assert_eq!(fixture.drive.state(), end);
    }
}

#[test]
fn enabling_again_cancels_slow_down() {
    let mut fixture = turning();
    fixture.controlword(SWITCH_ON);
    fixture.pass_ms(20);
    fixture.controlword(ENABLE);
    fixture.pass_ms(200);
    assert_eq!(fixture.drive.state(), OperationEnabled);
    assert!((fixture.drive.velocity() - 1e6).abs() < 1e3);
}

#[test]
fn halt_option_codes_decelerate_and_stay_enabled() {
    for (option, time) in [(1, 95..115), (2, 18..35), (3, 4..20)] {
        let mut fixture = turning();
        fixture.write(0x605D, 0, option, 2).unwrap();
        fixture.controlword(ENABLE | 0x100);
        let (ms, states) = until_standing(&mut fixture);
        assert!(time.contains(&ms), "option {option}: {ms} ms");
        assert_eq!(states, [OperationEnabled]);
        // target reached indicates standstill
        fixture.pass_ms(10);
        assert_eq!(fixture.drive.statusword().0 & 0x0400, 0x0400);
        fixture.controlword(ENABLE);
        fixture.pass_ms(200);
        assert!((fixture.drive.velocity() - 1e6).abs() < 1e3);
    }
}

#[test]
fn fault_reaction_option_codes_apply() {
    for (option, time) in [(0, 150..250), (1, 95..115), (2, 18..35), (3, 4..20)] {
        let mut fixture = turning();
        fixture.write(0x605E, 0, option, 2).unwrap();
        fixture.drive.fail(fixture.now, 0x4310, &mut NodeOutput::new());
        let first = if option == 0 { Fault } else { FaultReactionActive };
        assert_eq!(fixture.drive.state(), first);
        let (ms, _) = until_standing(&mut fixture);
        assert!(time.contains(&ms), "option {option}: {ms} ms");
        fixture.pass_ms(20);
        assert_eq!(fixture.drive.state(), Fault);
    }
}

#[test]
fn enabling_takes_brake_time() {
    let mut fixture = Fixture::with(&DriveConfig { enable_ms: 30, ..config() });
    fixture.mode(OperatingMode::CyclicPosition);
    fixture.command(Command::Shutdown);
    fixture.command(Command::SwitchOn);
    fixture.command(Command::EnableOperation);
    fixture.pass_ms(29);
    assert_eq!(fixture.drive.state(), SwitchedOn);
    fixture.command(Command::EnableOperation);
    fixture.pass_ms(1);
    assert_eq!(fixture.drive.state(), OperationEnabled);
}

#[test]
fn state_machine_quirks_apply() {
    let mut fixture =
        Fixture::with_quirks(DriveQuirks { needs_mode: true, ..DriveQuirks::default() });
    for word in [SHUTDOWN, SWITCH_ON, ENABLE] {
        fixture.controlword(word);
    }
    assert_eq!(fixture.drive.state(), SwitchedOn);
    fixture.mode(OperatingMode::CyclicPosition);
    fixture.controlword(ENABLE);
    assert_eq!(fixture.drive.state(), OperationEnabled);

    let mut fixture =
        Fixture::with_quirks(DriveQuirks { stuck_in_fault: true, ..DriveQuirks::default() });
    fixture.drive.fail(fixture.now, 0x2310, &mut NodeOutput::new());
    for word in [0, FAULT_RESET, 0, FAULT_RESET] {
        fixture.controlword(word);
        assert_eq!(fixture.drive.state(), Fault);
    }
    fixture.nmt(NmtCommand::ResetNode);
    fixture.pass_ms(50);
    assert_eq!(fixture.drive.state(), SwitchOnDisabled);

    let mut fixture =
        Fixture::with_quirks(DriveQuirks { ignores_quick_stop: true, ..DriveQuirks::default() });
    fixture.mode(OperatingMode::CyclicPosition);
    for word in [SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP] {
        fixture.controlword(word);
    }
    assert_eq!(fixture.drive.state(), OperationEnabled);
    fixture.controlword(SWITCH_ON);
    fixture.pass_ms(5);
    assert_eq!(fixture.drive.state(), SwitchedOn);

    let quirks = DriveQuirks { ignored_modes: vec![8], mode_delay_ms: 5, ..Default::default() };
    let mut fixture = Fixture::with_quirks(quirks);
    fixture.mode(OperatingMode::CyclicPosition);
    fixture.pass_ms(100);
    assert_eq!((fixture.read(0x6060, 0), fixture.read(0x6061, 0)), (Ok(8), Ok(0)));
    fixture.mode(OperatingMode::Homing);
    fixture.pass_ms(4);
    assert_eq!(fixture.read(0x6061, 0), Ok(0));
    fixture.pass_ms(1);
    assert_eq!(fixture.read(0x6061, 0), Ok(6));
}
