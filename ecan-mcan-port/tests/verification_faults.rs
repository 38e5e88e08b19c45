//! Faults that strike while a gateway is being verified: rows 31 and 32 of docs/SIMULATION.md.

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, frame, id};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    GatewayConfig, PendingStep, Port, PortConfig, PortError, SendError, Session, VerificationFault,
};
use ecan_sim::{Fault, GatewayFault, LossDirection};

fn fixture() -> Fixture {
    let gateway = GatewayConfig::on_all_channels(classic());
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway))
}

/// In a verification, at its first objects.
fn verifying() -> Fixture {
    let mut fixture = fixture();
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 15 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(1), &[]).unwrap();
    });
    let begun = fixture.until(100, |port| port.session(port.gw(0)) == Session::Verifying);
    assert!(begun.is_some(), "{}", fixture.port.session(fixture.port.gw(0)));
    fixture.idle(2);
    fixture
}

/// Frames cross again.
fn works(fixture: &mut Fixture) {
    assert_eq!(fixture.carry(0, &[frame(1, &[7])], 50).len(), 1);
}

#[test]
fn f31_a_cable_that_opens_twice_in_a_row_is_survived() {
    let open = |for_ms| Fault::LinkLoss { gateway: 0, for_ms };
    for cycles in (20..140).step_by(4) {
        for phase in (0..500).step_by(125) {
            let mut fixture = fixture();
            fixture.idle(phase);
            fixture.simulation.inject(open(37));
            fixture.idle(cycles);
            fixture.simulation.inject(open(45));
            fixture.idle(30);
            let back = fixture.until(10_000, Port::is_ready);
            assert!(
                back.is_some(),
                "{cycles} {phase}: {}",
                fixture.port.session(fixture.port.gw(0))
            );
            works(&mut fixture);
        }
    }
}

#[test]
fn f32_a_request_that_the_master_does_not_end_is_named_until_it_is_free() {
    let mut fixture = verifying();
    fixture.simulation.inject(Fault::RequestsHeld { for_ms: 22_000 });
    let mut said = Vec::new();
    for attempt in 1..=4 {
        let failed = |port: &Port| port.statistics(port.gw(0)).verification_failures == attempt;
        assert!(
            fixture.until(3_000, failed).is_some(),
            "{attempt}: {}",
            fixture.port.session(fixture.port.gw(0))
        );
        said.push(fixture.port.session(fixture.port.gw(0)).to_string());
        fixture.cycle(|cycle| {
            let rejected = cycle.send_can(0, 0, id(2), &[]);
            assert_eq!(rejected, Err(SendError::NotReady { slave: 0 }));
        });
    }
    for text in &said {
        assert!(text.contains("has not ended the SDO upload of 0x"), "{text}");
    }
    assert!(said.windows(2).all(|pair| pair[0] != pair[1]), "the time grows: {said:?}");
    // Free again 3 s later: the attempt that waits for it goes on, without failing first.
    assert!(
        fixture.until(1_800, Port::is_ready).is_some(),
        "{}",
        fixture.port.session(fixture.port.gw(0))
    );
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).verification_failures, 4);
    works(&mut fixture);
}

#[test]
fn what_a_gateway_waits_for_is_told_at_every_step() {
    let mut fixture = fixture();
    assert_eq!(fixture.port.waiting_for(fixture.port.gw(0)), None);
    // Outputs that arrive nowhere, then a master that has not looked yet.
    fixture.simulation.inject(Fault::WorkingCounterOffset { offset: -3, cycles: 100 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(1), &[]).unwrap();
    });
    assert!(fixture.until(50, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    assert_eq!(fixture.port.waiting_for(fixture.port.gw(0)), Some(PendingStep::ProcessData));
    assert!(fixture.until(200, |port| port.session(port.gw(0)) == Session::Verifying).is_some());
    let mut steps = Vec::new();
    while !fixture.port.is_ready() {
        steps.push(fixture.port.waiting_for(fixture.port.gw(0)).unwrap().to_string());
        fixture.idle(1);
    }
    assert!(steps[0].starts_with("the SDO upload of 0xF000:07"), "{steps:?}");
    assert!(steps.iter().any(|step| step.starts_with("the SDO download of 0x8010:08")));
    assert!(!steps.iter().any(|step| step.contains("earlier")), "{steps:?}");
    // A gateway that is off.
    fixture.simulation.inject(Fault::PowerOff { gateway: 0 });
    fixture.idle(1_000);
    assert_eq!(fixture.port.waiting_for(fixture.port.gw(0)), Some(PendingStep::Answer));
}

fn not_ready(fixture: &mut Fixture, timeout_ms: u64) -> (PortError, String) {
    let error = fixture
        .port
        .wait_ready_timeout(Duration::from_millis(timeout_ms))
        .expect_err("it does not become ready");
    let text = error.to_string();
    assert!(matches!(error, PortError::NotReady { slave: 0, .. }), "{text}");
    (error, text)
}

#[test]
fn wait_ready_names_the_step_that_it_waits_for() {
    let mut fixture = verifying();
    fixture.simulation.inject(Fault::RequestsHeld { for_ms: 60_000 });
    let (_, text) = not_ready(&mut fixture, 2_000);
    assert!(text.contains("being verified after 2"), "{text}");
    assert!(text.contains("it waits for the SDO upload of 0x"), "{text}");
    // In the second attempt the first one's reason is not forgotten.
    let (error, text) = not_ready(&mut fixture, 4_000);
    assert!(text.contains("it waits for the master to end the SDO upload of 0x"), "{text}");
    assert!(text.contains("the last attempt failed: the master has not ended"), "{text}");
    let PortError::NotReady { last_fault, .. } = error else { unreachable!() };
    assert!(matches!(last_fault, Some(VerificationFault::Unended { .. })), "{text}");
    assert_eq!(fixture.port.last_verification_fault(fixture.port.gw(0)), last_fault);
}

#[test]
fn wait_ready_names_the_fault_once_while_the_next_attempt_is_due() {
    let mut fixture = verifying();
    let silent = GatewayFault::MailboxSilent { ms: 60_000 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: silent });
    assert!(
        fixture
            .until(2_000, |port| matches!(port.session(port.gw(0)), Session::Failed(_)))
            .is_some()
    );
    let (_, text) = not_ready(&mut fixture, 100);
    assert!(text.ends_with("it waits for the next attempt"), "{text}");
    assert_eq!(text.matches("failed").count(), 1, "{text}");
}

#[test]
fn verification_that_succeeds_forgets_the_fault() {
    let mut fixture = verifying();
    let silent = GatewayFault::MailboxSilent { ms: 3_000 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: silent });
    assert!(
        fixture.until(2_000, |port| port.last_verification_fault(port.gw(0)).is_some()).is_some()
    );
    assert!(
        fixture.until(5_000, Port::is_ready).is_some(),
        "{}",
        fixture.port.session(fixture.port.gw(0))
    );
    assert_eq!(fixture.port.last_verification_fault(fixture.port.gw(0)), None);
    works(&mut fixture);
}
