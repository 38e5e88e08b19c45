//! What changed at gateways and channels is told once, with its cause and duration.

use std::time::Duration;

use crate::common::{Fixture, SendData as _, classic, id};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    BusEvent, BusWatch, Cycle, GatewayConfig, NotDelivered, PendingStep, Port, PortConfig,
    check_delivery,
};
use ecan_sim::Fault;

fn fixture(gateways: usize) -> Fixture {
    let adapter = AdapterConfig::new(gateways as u16).with_cycle(Duration::from_millis(1));
    let config = PortConfig::uniform(gateways, GatewayConfig::on_channel(0, classic()));
    Fixture::ready(ecan_sim::echo(gateways), adapter, config)
}

/// The changes of some cycles: gateway and event.
fn changes(fixture: &mut Fixture, watch: &mut BusWatch, cycles: usize) -> Vec<(usize, BusEvent)> {
    let mut told = Vec::new();
    for _ in 0..cycles {
        fixture.idle(1);
        let changes = watch.changes(&fixture.port);
        told.extend(changes.map(|change| (change.gateway.slave(), change.event)));
    }
    told
}

fn duration_ms(event: BusEvent) -> u128 {
    match event {
        BusEvent::Ready(Some(after)) => after.as_millis(),
        event => panic!("{event}"),
    }
}

#[test]
fn link_loss_and_power_failure_are_told_apart() {
    let mut fixture = fixture(2);
    let mut watch = BusWatch::new(&fixture.port);
    assert_eq!(changes(&mut fixture, &mut watch, 100), []);

    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 300 });
    let told = changes(&mut fixture, &mut watch, 10_000);
    let lost: Vec<_> = (0..2).map(|gateway| (gateway, BusEvent::Lost(PendingStep::Link))).collect();
    assert_eq!(told[..2], lost);
    let returned: Vec<_> =
        told[2..].iter().filter(|(_, event)| matches!(event, BusEvent::Ready(_))).collect();
    assert_eq!(returned.len(), 2, "{told:?}");
    assert!(returned.iter().all(|(_, event)| (300..10_000).contains(&duration_ms(*event))));

    fixture.simulation.inject(Fault::PowerOff { gateway: 1 });
    let told = changes(&mut fixture, &mut watch, 5_000);
    let expected = [BusEvent::Lost(PendingStep::ProcessData), BusEvent::Waits(PendingStep::Answer)];
    assert_eq!(told, expected.map(|event| (1, event)));
}

#[test]
fn program_whose_frames_reach_no_bus_gets_the_reason() {
    let reason = |port: &Port| check_delivery(port).unwrap_err().to_string();
    let mut fixture = fixture(1);
    assert_eq!(check_delivery(&fixture.port), Err(NotDelivered::Nothing));
    fixture.simulation.inject(Fault::PowerOff { gateway: 0 });
    fixture.idle(1_000);
    assert!(
        reason(&fixture.port).starts_with("no frame was delivered: slave 0 waits for the slave")
    );

    let mut fixture = self::fixture(1);
    let send = |cycle: &mut Cycle<'_>| {
        let _ = cycle.send_can(0, 0, id(1), &[]);
    };
    fixture.cycle(send);
    fixture.idle(10);
    assert_eq!(check_delivery(&fixture.port), Ok(()));
    let mut watch = BusWatch::new(&fixture.port);
    fixture.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
    let told = changes(&mut fixture, &mut watch, 2);
    assert_eq!(
        told.iter().map(|(_, event)| event.to_string()).collect::<Vec<_>>(),
        ["channel 0: bus-off"]
    );
    fixture.cycle(send);
    assert!(reason(&fixture.port).contains("; bus-off; check that another node is on"));
}
