//! Faults of line, slave and bus in an application of the simulated library.

use crate::ecrt_support::{CYCLE_NS, Program, stepped, stepped_echo};
use ecan_host::{RequestState, WcState};
use ecan_protocol::can::CanFrame;
use ecan_protocol::object::{ObjectType, SdoWrite};
use ecan_sim::{Fault, GatewayFault, GatewaySpec, LossDirection, Scenario, When, echo};

const PREOP: u8 = 2;
const SAFEOP: u8 = 4;
const OP: u8 = 8;

fn frame(id: u16) -> CanFrame {
    crate::ecrt_support::frame(id, &[1, 2, 3, 4])
}

fn crosses(program: &mut Program, slave: usize, id: u16) {
    program.received.clear();
    program.cycle_with(&[(slave, 0, frame(id))]);
    program.receive_frames(1);
    assert_eq!(program.received, [(slave, 0, frame(id))]);
}

#[test]
fn frame_lost_before_the_slaves_reaches_none() {
    let mut program = Program::operational(&[3]);
    let before = program.counters(0).images_written;
    program.simulation().inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 1 });
    program.cycle();
    assert_eq!(program.counters(0).images_written, before);
    program.cycle();
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
    program.cycle();
    assert_eq!(program.domain(0).wc_state, WcState::Complete);
}

#[test]
fn frame_lost_on_return_was_executed() {
    let mut program = Program::operational(&[3]);
    program.simulation().inject(Fault::LostFrame { direction: LossDirection::Return, cycles: 1 });
    program.cycle_with(&[(0, 0, frame(0x42))]);
    program.cycle();
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
    program.receive_frames(1);
    assert_eq!(program.received, [(0, 0, frame(0x42))]);
}

#[test]
fn working_counter_offset_makes_the_domain_incomplete() {
    let mut program = Program::operational(&[3]);
    program.simulation().inject(Fault::WorkingCounterOffset { offset: -1, cycles: 2 });
    program.cycle();
    for _ in 0..2 {
        program.cycle();
        let state = program.domain(0);
        assert_eq!((state.working_counter, state.wc_state), (2, WcState::Incomplete));
    }
    program.cycle();
    assert_eq!(program.domain(0).working_counter, 3);
}

#[test]
fn power_cycled_slave_returns_configured() {
    let mut program = Program::operational(&[3]);
    crosses(&mut program, 0, 0x10);
    program.simulation().inject(Fault::PowerCycle { gateway: 0, off_ms: 300 });
    program.cycles(2);
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
    // the master's slave state lags
    assert!(program.state(0).operational);
    program.cycles(1_100);
    assert!(!program.state(0).operational);
    assert!(program.reaches_op());
    // a rebooted gateway executes from the first sequence on; the bus side is configured
    crosses(&mut program, 0, 0x11);
}

#[test]
fn power_cycle_between_two_polls_is_detected() {
    let mut scenario = echo(1);
    scenario.gateways[0].config.boot_ms = 1;
    let mut program = Program::new(stepped(scenario), &[3]).into_op();
    program.simulation().inject(Fault::PowerCycle { gateway: 0, off_ms: 1 });
    program.cycles(2_000);
    assert!(program.reaches_op());
    crosses(&mut program, 0, 0x12);
}

#[test]
fn slaves_after_a_lost_one_vanish_and_return() {
    let mut program = Program::operational(&[3, 1, 1]);
    program.simulation().inject(Fault::PowerCycle { gateway: 1, off_ms: 100 });
    program.cycles(3);
    let states: Vec<_> = (0..3).map(|slave| program.domain(slave).wc_state).collect();
    assert_eq!(states, [WcState::Complete, WcState::Zero, WcState::Zero]);
    program.cycles(1_500);
    assert!(program.reaches_op());
    for slave in 0..3 {
        crosses(&mut program, slave, 0x20 + slave as u16);
    }
}

#[test]
fn without_link_nothing_is_sent() {
    let mut program = Program::operational(&[3]);
    program.simulation().inject(Fault::LinkLoss { gateway: 0, for_ms: 200 });
    program.cycles(2);
    assert!(!program.master.link_state(0).unwrap().link_up);
    assert_eq!(program.domain(0).wc_state, WcState::Zero);
    program.cycles(250);
    assert!(program.master.link_state(0).unwrap().link_up);
    assert_eq!(program.al_status(0), (SAFEOP, true, 0x001B), "the watchdog of the outputs expired");
    // the master detects it with its next poll
    program.cycles(1_100);
    assert!(program.reaches_op());
    crosses(&mut program, 0, 0x30);
}

#[test]
fn short_link_loss_does_not_disturb_the_slave() {
    let mut program = Program::operational(&[1, 1]);
    program.simulation().inject(Fault::LinkLoss { gateway: 1, for_ms: 20 });
    program.cycles(3);
    assert_eq!(program.domain(1).wc_state, WcState::Zero);
    assert_eq!(program.domain(0).wc_state, WcState::Complete);
    program.cycles(30);
    assert_eq!(program.domain(1).wc_state, WcState::Complete);
}

#[test]
fn aborted_startup_sdo_keeps_preop_and_sets_error_flag() {
    let wrong = SdoWrite { index: 0x5FFF, subindex: 0, value: 1, ty: ObjectType::U8 };
    let mut program = Program::with_startup(stepped_echo(1), &[3], |_| vec![wrong]);
    program.activate();
    program.cycles(2_000);
    let info = program.master.slave_info(0).unwrap();
    assert_eq!((info.al_state, info.error_flag), (PREOP, true));
    assert!(!program.state(0).operational);
    let log = program.simulation().kernel_log().join("\n");
    assert!(log.contains("0x5FFF:00"), "{log}");
    assert!(log.to_lowercase().contains("0x06020000"), "{log}");
}

#[test]
fn rejected_assignment_is_only_a_warning() {
    let mut program = Program::new(stepped_echo(1), &[3]);
    let config = program.slaves[0].config;
    program.master.config_pdo_assign_add(config, 2, 0x17FF).unwrap();
    program.activate();
    program.cycles(2_000);
    let log = program.simulation().kernel_log();
    let warning = log.iter().position(|line| line.contains("warning: PDO configuration"));
    let rejection = log.iter().position(|line| line.contains("rejected the change to SAFEOP"));
    assert!(warning.is_some() && warning < rejection, "{log:#?}");
}

#[test]
fn startup_list_assigns_if_the_master_cannot() {
    let mut scenario = echo(1);
    scenario.gateways[0] = GatewaySpec { pdo_assign: false, ..GatewaySpec::at(0) };
    let mut program = Program::new(stepped(scenario), &[3]).into_op();
    crosses(&mut program, 0, 0x40);
}

#[test]
fn watchdog_drops_the_slave_without_process_data() {
    let mut program = Program::operational(&[1]);
    program.simulation().pass_ns(300 * CYCLE_NS);
    assert_eq!(program.al_status(0), (SAFEOP, true, 0x001B));
    program.cycles(1_100);
    assert!(program.reaches_op());
}

#[test]
fn watchdog_is_set_by_divider_and_intervals() {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let config = program.slaves[0].config;
    program.master.config_watchdog(config, 2498, 5000).unwrap();
    let mut program = program.into_op();
    program.simulation().pass_ns(400 * CYCLE_NS);
    program.cycles(3);
    assert_eq!(program.al_status(0).0, OP);
}

#[test]
fn al_error_is_reported_and_the_slave_returns_to_op() {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let config = program.slaves[0].config;
    let register = program.master.create_reg_request(config, 2).unwrap();
    let mut program = program.into_op();
    let fault = GatewayFault::AlError { code: 0x001A };
    program.simulation().inject(Fault::Gateway { gateway: 0, fault });
    program.master.requests().register_read(register, 0x0134, 2).unwrap();
    program.cycles(4);
    assert_eq!(program.master.requests().register_state(register).unwrap(), RequestState::Success);
    assert_eq!(program.master.requests().register_data(register), [0x1A, 0]);
    program.cycles(1_100);
    assert!(program.reaches_op());
}

#[test]
fn bus_off_channel_recovers() {
    let mut program = Program::operational(&[3]);
    program.simulation().inject(Fault::BusOff { gateway: 0, channel: 0 });
    program.cycles(100);
    crosses(&mut program, 0, 0x60);
}

#[test]
fn error_frames_delay_a_frame() {
    let mut program = Program::operational(&[3]);
    program.simulation().inject(Fault::ErrorFrames { gateway: 0, channel: 0, frames: 3 });
    crosses(&mut program, 0, 0x61);
    let statistics = program.simulation().with_world(|world| world.bus_statistics(0, 0)).unwrap();
    assert_eq!(statistics.error_frames, 3);
}

#[test]
fn silent_node_only_acknowledges() {
    let mut program = Program::operational(&[3]);
    let node = "echo 0.0".to_owned();
    program.simulation().inject(Fault::NodeSilent { node, for_ms: 50 });
    program.cycle_with(&[(0, 0, frame(0x70))]);
    program.cycles(60);
    assert_eq!(program.received, []);
    assert_eq!(program.counters(0).frames_on_bus, 1);
    crosses(&mut program, 0, 0x71);
}

#[test]
fn scheduled_faults_occur_in_their_cycle() {
    let mut program = Program::operational(&[3]);
    let now = program.simulation().with_world(|world| world.cycles());
    let fault = Fault::LostFrame { direction: LossDirection::Outward, cycles: 1 };
    program.simulation().schedule(When::Cycle(now + 4), fault);
    let zero: Vec<_> = (0..8)
        .map(|_| {
            program.cycle();
            program.domain(0).wc_state == WcState::Zero
        })
        .collect();
    // the fourth send from here; its missing response shows one cycle later
    assert_eq!(zero, [false, false, false, false, true, false, false, false]);
}

#[test]
fn sync0_starts_in_phase_with_the_application_time() {
    let mut program = Program::new(stepped_echo(1), &[1]);
    let config = program.slaves[0].config;
    program.master.config_dc(config, 0x0300, CYCLE_NS as u32, 250_000, 0, 0).unwrap();
    program.activate();
    assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
}

#[test]
fn scenario_needs_only_seed_and_script() {
    let text = r#"
        seed = 9
        clock = "stepped"
        [[gateway]]
        boot_ms = 50
        [[node]]
        kind = "echo"
        bus = "0.0"
        [[fault]]
        at_ms = 3000
        kind = "power_cycle"
        gateway = 0
        off_ms = 100
    "#;
    let scenario = Scenario::from_toml(text, "test", std::path::Path::new(".")).unwrap();
    let mut program = Program::new(stepped(scenario), &[1]).into_op();
    crosses(&mut program, 0, 0x80);
    program.cycles(3_000);
    assert!(program.reaches_op());
    let offs = program.simulation().kernel_log();
    assert!(offs.is_empty(), "{offs:#?}");
    crosses(&mut program, 0, 0x81);
}
