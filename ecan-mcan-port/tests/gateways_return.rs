//! Gateways come back after their mailbox was silent, and after a branch of the bus was away: ready
//! again, or with a state that names what to do; and no frame reaches another gateway.

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, PendingStep, Port, PortConfig, PortError, Session};
use ecan_protocol::device::AlState;
use ecan_sim::{Fault, GatewayFault, MasterBehaviour, ScriptedFault, Topology, When};

fn adapter(slaves: usize) -> AdapterConfig {
    AdapterConfig::new(slaves as u16).with_cycle(Duration::from_millis(1))
}

fn config(slaves: usize) -> PortConfig {
    PortConfig::uniform(slaves, GatewayConfig::on_channel(0, classic()))
}

fn silent(ms: u32) -> Fault {
    Fault::Gateway { gateway: 0, fault: GatewayFault::MailboxSilent { ms } }
}

fn waiting_for(port: &Port, slave: usize) -> Option<PendingStep> {
    port.waiting_for(port.gw(slave))
}

#[test]
fn startup_without_response_is_requested_again() {
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(1), config(1));
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    let in_preop = |port: &Port| {
        let state = port.adapter().slave_state(0);
        state.is_ok_and(|state| state.online && state.al_state == 2)
    };
    assert!(fixture.until(10_000, in_preop).is_some());
    fixture.simulation.inject(silent(3_000));
    let is_held = |port: &Port| waiting_for(port, 0) == Some(PendingStep::StartupRetry);
    assert!(fixture.until(30_000, is_held).is_some(), "{:?}", waiting_for(&fixture.port, 0));
    let log = fixture.simulation.kernel_log();
    assert!(log.iter().any(|line| line.contains("no response")), "{log:?}");
    assert!(fixture.until(10_000, Port::is_ready).is_some(), "{:?}", waiting_for(&fixture.port, 0));
    assert!(fixture.port.statistics(fixture.port.gw(0)).startup_requests > 0);
}

/// The master meets an error while it takes the gateway to INIT, and leaves it there.
#[test]
fn startup_that_failed_in_init_is_requested_again() {
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(1), config(1));
    let al_state = |port: &Port| port.adapter().slave_state(0).map_or(0, |state| state.al_state);
    leave_op(&fixture, 0);
    // As soon as the master has taken it out of SAFEOP.
    for _ in 0..10_000 {
        fixture.idle(1);
        let in_init = fixture.simulation.with_world(|world| {
            world.gateway(0).is_some_and(|gateway| gateway.al_state() == AlState::Init)
        });
        if in_init {
            break;
        }
    }
    leave_op(&fixture, 0);
    let is_held = |port: &Port| waiting_for(port, 0) == Some(PendingStep::StartupRetry);
    assert!(fixture.until(60_000, is_held).is_some(), "{:?}", waiting_for(&fixture.port, 0));
    assert_eq!(al_state(&fixture.port) & 0x0F, 1);
    assert!(fixture.until(10_000, Port::is_ready).is_some(), "{:?}", waiting_for(&fixture.port, 0));
}

#[test]
fn wait_ready_repeats_a_startup_without_response() {
    for master in [MasterBehaviour::IDEAL, MasterBehaviour::IGH] {
        let mut scenario = ecan_sim::echo(1);
        scenario.master = master;
        let mut fixture = Fixture::open(scenario, adapter(1), config(1)).unwrap();
        fixture.simulation.inject(silent(2_500));
        fixture.port.wait_ready().unwrap_or_else(|error| panic!("{error}"));
        let log = fixture.simulation.kernel_log();
        assert!(log.iter().any(|line| line.contains("no response")), "{log:?}");
    }
}

#[test]
fn wait_ready_does_not_repeat_a_rejected_startup() {
    let mut fixture = Fixture::open(ecan_sim::echo(1), adapter(1), config(1)).unwrap();
    let fault =
        GatewayFault::SdoAbort { index: 0x8010, subindex: 3, code: 0x0609_0030, times: 1_000 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    let error = fixture.port.wait_ready().unwrap_err().to_string();
    assert!(error.contains("0x8010:03") && error.contains("0x06090030"), "{error}");
    let log = fixture.simulation.kernel_log();
    assert_eq!(log.iter().filter(|line| line.contains("aborted")).count(), 1, "{log:?}");
}

#[test]
fn failed_reconfiguration_waits_for_another_one() {
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(1), config(1));
    let gateway = fixture.port.gw(0);
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 30_000 });
    fixture.port.reconfigure((adapter(1), config(1))).unwrap_err();
    assert_eq!(fixture.port.waiting_for(gateway), Some(PendingStep::Configuration));
    let error = fixture.port.next_cycle().end().unwrap_err().to_string();
    assert!(error.contains("call reconfigure again"), "{error}");
    fixture.simulation.pass_ns(30_000_000_000);
    fixture.port.reconfigure((adapter(1), config(1))).unwrap();
    fixture.port.wait_ready().unwrap();
    assert_eq!(fixture.port.waiting_for(gateway), None);
}

/// A star of gateways without aliases: a branch that is away shifts the positions of those after it.
fn star(slaves: usize) -> Fixture {
    let mut scenario = ecan_sim::echo(slaves);
    scenario.topology = Topology::Star;
    let fixture = Fixture::ready(scenario, adapter(slaves), config(slaves));
    fixture.simulation.with_world(|world| world.record_all_buses());
    fixture
}

/// Cycles in which every gateway gets a frame that carries its number, until `done`.
fn until(fixture: &mut Fixture, limit: usize, done: impl Fn(&Port) -> bool) {
    let slaves = fixture.port.slave_count();
    for _ in 0..limit {
        if done(&fixture.port) {
            return;
        }
        fixture.cycle(|cycle| {
            for slave in 0..slaves {
                // Rejected while it is not ready.
                let _ = cycle.send_can(slave, 0, id(0x100 + slave as u16), &[slave as u8]);
            }
        });
    }
    let states: Vec<_> = fixture
        .port
        .gateways()
        .map(|gateway| (fixture.port.session(gateway), fixture.port.waiting_for(gateway)))
        .collect();
    panic!("{states:#?}");
}

/// Frames on another bus than that of the gateway for which they were sent: bus and slave, number.
fn strays(fixture: &Fixture, slaves: usize) -> BTreeMap<(usize, usize), usize> {
    fixture.simulation.with_world(|world| {
        let buses: HashMap<String, usize> = (0..slaves)
            .map(|slave| (world.bus_of(slave, 0).unwrap().name().to_owned(), slave))
            .collect();
        let mut strays = BTreeMap::new();
        world.drain_recorded(|bus, frame| {
            let (at, slave) = (buses[bus], frame.frame.id().raw() as usize - 0x100);
            if frame.is_from_channel && slave != at {
                *strays.entry((at, slave)).or_default() += 1;
            }
        });
        strays
    })
}

fn leave_op(fixture: &Fixture, gateway: usize) {
    let fault = GatewayFault::AlError { code: 0x001B };
    fixture.simulation.inject(Fault::Gateway { gateway, fault });
}

fn for_cycles(fixture: &mut Fixture, cycles: u64) {
    let end = fixture.port.adapter().clock().now_ns() + cycles * 1_000_000;
    until(fixture, 100_000, |port| port.adapter().clock().now_ns() >= end);
}

#[test]
fn lost_branch_does_not_disturb_gateways_that_moved() {
    let mut fixture = star(3);
    fixture.simulation.inject(Fault::LinkLoss { gateway: 1, for_ms: 12_000 });
    for_cycles(&mut fixture, 11_000);
    let text = fixture.port.session(fixture.port.gw(1)).to_string();
    assert!(text.contains("another gateway is at this address"), "{text}");
    assert!(text.contains("positions shift while a branch of the bus is away"), "{text}");
    until(&mut fixture, 20_000, Port::is_ready);
    for slave in [0, 2] {
        assert_eq!(fixture.port.statistics(fixture.port.gw(slave)).sessions_lost, 0, "{slave}");
    }
    assert_eq!(strays(&fixture, 3), BTreeMap::new());
}

/// The second gateway to leave OP gets the process data of the one that is away.
#[test]
fn gateway_with_shifted_process_data_returns() {
    let mut fixture = star(3);
    fixture.simulation.inject(Fault::LinkLoss { gateway: 1, for_ms: 10_000 });
    for_cycles(&mut fixture, 3_000);
    leave_op(&fixture, 2);
    for_cycles(&mut fixture, 8_000);
    until(&mut fixture, 20_000, Port::is_ready);
    assert_eq!(strays(&fixture, 3), BTreeMap::new());
}

/// Every gateway gets the process data of the one before it; after the return the second one has
/// the address of one gateway and process data of another.
#[test]
fn gateways_with_exchanged_process_data_return() {
    let mut fixture = star(3);
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 12_000 });
    for_cycles(&mut fixture, 3_000);
    leave_op(&fixture, 1);
    for_cycles(&mut fixture, 3_000);
    leave_op(&fixture, 2);
    for_cycles(&mut fixture, 7_000);
    until(&mut fixture, 40_000, Port::is_ready);
    assert_eq!(strays(&fixture, 3), BTreeMap::new());
}

/// A gateway gets the process data of one that is in use: what is published until the working
/// counter shows it reaches both.
#[test]
fn second_gateway_gets_one_image_at_most() {
    let mut fixture = star(3);
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 15_000 });
    for_cycles(&mut fixture, 3_000);
    leave_op(&fixture, 2);
    for_cycles(&mut fixture, 10_000);
    let waiting_for = waiting_for(&fixture.port, 1);
    assert_eq!(waiting_for, Some(PendingStep::ExclusiveProcessData));
    for_cycles(&mut fixture, 3_000);
    until(&mut fixture, 40_000, Port::is_ready);
    let strays = strays(&fixture, 3);
    assert!(strays.iter().all(|(at, frames)| *at == (2, 1) && *frames <= 1), "{strays:?}");
}

/// The gateway was seen below OP, and gets the process data of another one before its own arrive again.
#[test]
fn gateway_seen_below_op_before_it_moved_returns() {
    let mut fixture = star(2);
    leave_op(&fixture, 1);
    until(&mut fixture, 5_000, |port| waiting_for(port, 1) == Some(PendingStep::Operational));
    fixture.simulation.inject(Fault::PowerCycle { gateway: 1, off_ms: 5 });
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 5_000 });
    for_cycles(&mut fixture, 6_000);
    until(&mut fixture, 40_000, Port::is_ready);
    assert_eq!(strays(&fixture, 2), BTreeMap::new());
}

#[test]
fn retry_needs_an_active_bus() {
    let mut fixture = Fixture::open(ecan_sim::echo(1), adapter(1), config(1)).unwrap();
    assert!(matches!(fixture.port.retry_startup(), Err(PortError::Adapter(_))));
    fixture.port.wait_ready().unwrap();
    fixture.port.retry_startup().unwrap();
    fixture.idle(5_000);
    assert_eq!(fixture.port.session(fixture.port.gw(0)), Session::Ready, "nothing is disturbed");
}

#[test]
fn reconfiguration_succeeds_after_the_bus_was_seen_empty() {
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(1), config(1));
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 3_000 });
    fixture.idle(1_500);
    let waits = adapter(1).with_cycle(Duration::from_millis(2));
    fixture.port.reconfigure((waits, config(1))).unwrap();
    fixture.port.wait_ready().unwrap();
}

#[test]
fn port_opens_although_the_gateway_is_powered_later() {
    let mut scenario = ecan_sim::echo(1);
    scenario.faults.push(ScriptedFault {
        when: When::At(0),
        fault: Fault::LinkLoss { gateway: 0, for_ms: 2_000 },
    });
    let mut fixture = Fixture::open(scenario, adapter(1), config(1)).unwrap();
    fixture.port.wait_ready().unwrap();
}

/// Each step of a startup SDO would take a cycle otherwise.
#[test]
fn startup_at_a_slow_cycle_does_not_wait_for_the_cycle() {
    let slow = adapter(3).with_cycle(Duration::from_millis(10));
    let mut fixture = Fixture::open(ecan_sim::echo(3), slow, config(3)).unwrap();
    let mut cycles = 0;
    let count = |port: &mut Port| {
        cycles += 1;
        port.begin_cycle().finish();
        Ok::<_, PortError>(())
    };
    fixture.port.wait_ready_with(Duration::from_secs(100), count).unwrap();
    assert!(cycles < 400, "{cycles}");
}

/// A reserved master does not look for slaves.
#[test]
fn gateway_that_is_lost_while_the_port_opens_is_found_again() {
    for (at_ms, fault) in [
        (800, Fault::LinkLoss { gateway: 0, for_ms: 1_000 }),
        (1_000, Fault::PowerCycle { gateway: 0, off_ms: 300 }),
    ] {
        let mut scenario = ecan_sim::echo(1);
        scenario.master = MasterBehaviour::IGH;
        scenario.faults.push(ScriptedFault { when: When::At(at_ms * 1_000_000), fault });
        let mut fixture = Fixture::open(scenario, adapter(1), config(1)).unwrap();
        fixture.port.wait_ready().unwrap();
        assert!(fixture.port.adapter().clock().now_ns() > at_ms * 1_000_000);
    }
}

#[test]
fn gateway_that_is_switched_off_is_named() {
    let mut scenario = ecan_sim::echo(1);
    scenario.master = MasterBehaviour::IGH;
    scenario
        .faults
        .push(ScriptedFault { when: When::At(800_000_000), fault: Fault::PowerOff { gateway: 0 } });
    let error =
        Fixture::open(scenario, adapter(1), config(1)).err().expect("it is off").to_string();
    assert!(error.contains("slave 0 (alias 0, position 0) is not on the bus"), "{error}");
}

/// The master notices nothing while it reads the dictionary of another gateway; without rounds between
/// the cycles that takes half a minute at this cycle.
fn returns_while_a_dictionary_is_read(fault: Fault) {
    let mut scenario = ecan_sim::echo(2);
    scenario.master = MasterBehaviour::IGH;
    let slow = adapter(2).with_cycle(Duration::from_millis(4));
    let mut fixture = Fixture::ready(scenario, slow, config(2));
    // The master reads the dictionaries after the scan that follows the restart.
    for fault in [Fault::PowerCycle { gateway: 1, off_ms: 300 }, fault] {
        fixture.simulation.inject(fault);
        until(&mut fixture, 500, |port| !port.is_ready());
        until(&mut fixture, 3_000, Port::is_ready);
        for_cycles(&mut fixture, 5_000);
    }
}

#[test]
fn gateway_that_restarts_while_a_dictionary_is_read_returns_within_seconds() {
    returns_while_a_dictionary_is_read(Fault::PowerCycle { gateway: 1, off_ms: 300 });
}

#[test]
fn gateway_that_leaves_op_while_a_dictionary_is_read_returns_within_seconds() {
    let fault = GatewayFault::AlError { code: 0x001B };
    returns_while_a_dictionary_is_read(Fault::Gateway { gateway: 1, fault });
}
