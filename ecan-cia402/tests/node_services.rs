//! Services of nodes that wait while axes follow their targets.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, address, axis};
use ecan_canopen::{
    BootConfig, BootPhase, BootState, IdentityCheck, LssCommand, LssResult, NodeConfig, NodeHandle,
    ParameterGroup, Step, WaitError, object,
};
use ecan_cia402::{Cia402Error, CommandError};

const LONG: Duration = Duration::from_secs(20);

/// An axis that moves, and a node on its channel.
fn fixture() -> (Fixture, NodeHandle) {
    let mut fixture = Fixture::single(vec![axis(0, 0, 1).with_target_step(10)]).started();
    fixture.steps(50);
    let network = fixture.cia402.network_mut();
    let node = network.add_node(address(0, 0, 2), NodeConfig::default()).unwrap();
    (fixture, node)
}

fn boot(fixture: &mut Fixture, id: u8, config: BootConfig) {
    let network = fixture.cia402.network_mut();
    let at = address(0, 0, id);
    let known = network.find(at);
    let node = known.unwrap_or_else(|| network.add_node(at, NodeConfig::default()).unwrap());
    network.boot(node, config);
}

#[test]
fn boot_up_names_the_nodes_that_fail_and_the_axis_goes_on() {
    let (mut fixture, _) = fixture();
    let wrong = IdentityCheck { vendor_id: Some(0x99), ..IdentityCheck::default() };
    let named = |name: &str| BootConfig {
        name: name.into(),
        boot_timeout: Duration::from_millis(500),
        ..BootConfig::default()
    };
    boot(&mut fixture, 2, named("pump"));
    boot(&mut fixture, 3, BootConfig { identity: wrong, ..named("valve") });
    boot(&mut fixture, 99, BootConfig { is_mandatory: false, ..named("lamp") });
    boot(&mut fixture, 98, named("horn"));
    let mut phases = Vec::new();
    let Fixture { port, cia402, .. } = &mut fixture;
    let error = cia402
        .blocking(port, LONG)
        .wait_booted(|node| {
            if &*node.name == "pump" && phases.last() != Some(&node.phase) {
                phases.push(node.phase);
            }
        })
        .unwrap_err();
    let Cia402Error::BootTimeout(timeout) = &error else { panic!("{error}") };
    let names: Vec<_> = timeout.nodes.iter().map(|node| &*node.name).collect();
    assert_eq!(names, ["valve", "horn"], "{error}");
    assert!(timeout.waited >= Duration::from_millis(500), "it waited for the last one: {error}");
    let text = error.to_string();
    assert!(text.starts_with("2 mandatory nodes not booted after "), "{text}");
    assert!(text.contains("\n  - valve, node 3 (slave 0, channel 0): boot-up failed (status D)"));
    assert_eq!(phases.last(), Some(&BootPhase::Booted), "{phases:?}");
    assert!(fixture.cia402.all_running(), "the axis kept its last target");
    fixture.steps(50);
    fixture.check();
    // Without the two, the network is booted; the optional one is still missing.
    let optional = BootConfig { is_mandatory: false, ..BootConfig::default() };
    boot(&mut fixture, 3, optional.clone());
    boot(&mut fixture, 98, optional);
    let Fixture { port, cia402, .. } = &mut fixture;
    cia402.blocking(port, LONG).wait_booted(|_| {}).unwrap();
    assert_eq!(cia402.network().boot_state(), BootState::Booted);
}

#[test]
fn boot_up_that_takes_too_long_is_reported() {
    let (mut fixture, _) = fixture();
    boot(&mut fixture, 99, BootConfig::default());
    let Fixture { port, cia402, .. } = &mut fixture;
    let error = cia402.blocking(port, Duration::from_millis(100)).wait_booted(|_| {}).unwrap_err();
    let text = error.to_string();
    assert!(text.starts_with("1 mandatory node not booted after "), "{text}");
    assert!(text.contains("waiting for a response"), "{text}");
    assert!(fixture.cia402.all_running());
}

#[test]
fn services_of_nodes_leave_the_axis_at_its_target() {
    let (mut fixture, node) = fixture();
    let Fixture { port, cia402, .. } = &mut fixture;
    let speed = 12_345_u32.to_le_bytes();
    cia402.blocking(port, LONG).download(node, (0x6081, 0), &speed).unwrap();
    let value = cia402.blocking(port, LONG).upload(node, (0x6081, 0)).unwrap();
    assert_eq!(value, speed);
    cia402.blocking(port, LONG).execute(node, ParameterGroup::All.store_steps()).unwrap();
    let read = [Step::read(0x6081, 0), Step::read(object::DEVICE_TYPE, 0)];
    let values = cia402.blocking(port, LONG).execute(node, read).unwrap();
    assert_eq!(values.uploaded(node, 0x6081, 0), Some(12_345));
    assert_eq!(values.uploaded(node, object::DEVICE_TYPE, 0).map(|raw| raw as u16), Some(402));
    let missing = [Step::write(0x5FFF, 0, 1_u8)];
    let error = cia402.blocking(port, LONG).execute(node, missing).unwrap_err();
    assert!(matches!(error, Cia402Error::Wait(WaitError::Step(_))), "{error}");
    assert!(error.to_string().contains("0x5FFF"), "{error}");

    let search = LssCommand::IdentifyNonConfigured;
    let found = cia402.blocking(port, LONG).lss((0, 0), search).unwrap();
    assert_eq!(found, LssResult::NotFound, "every drive has a node-ID");
    let error = cia402.blocking(port, LONG).lss((0, 3), search).unwrap_err();
    assert!(matches!(error, Cia402Error::Wait(WaitError::LssStart(_))), "{error}");
    let short = Duration::from_millis(10);
    let error = cia402.blocking(port, short).lss((0, 0), search).unwrap_err();
    assert!(matches!(error, Cia402Error::Wait(WaitError::TimedOut { .. })), "{error}");
    assert_eq!(cia402.blocking(port, LONG).lss((0, 0), search).unwrap(), LssResult::NotFound);
    let none = cia402.axis_mut(1).unwrap_err();
    assert_eq!((none, cia402.axis(1).is_none()), (CommandError::NoSuchAxis { axis: 1 }, true));
    assert!(fixture.cia402.all_running());
    fixture.steps(50);
    fixture.check();
}
