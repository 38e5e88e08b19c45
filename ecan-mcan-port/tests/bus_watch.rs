//! What changed at gateways and channels is told once, with its cause and duration.

use std::time::Duration;

use crate::common::{Fixture, SendData as _, classic, id};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    BusEvent, BusWatch, Cycle, GatewayCondition, GatewayConfig, GatewayWatch, ImageLoss,
    ImageLossWatch, NotDelivered, PendingStep, Port, PortConfig, SessionState, SlaveStatistics,
    check_delivery,
};
use ecan_protocol::image::{ChannelState, ChannelStatus};
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
fn loss_and_bus_off_between_two_looks_are_told() {
    let condition = |session, sessions_lost, bus_off_images| {
        let run = Some(ChannelStatus::default().with_state(ChannelState::Run));
        let mut statistics = SlaveStatistics { sessions_lost, ..SlaveStatistics::default() };
        statistics.channels[1].bus_off_images = bus_off_images;
        let channels = [None, run, None, None];
        GatewayCondition { session, channels, statistics, ..GatewayCondition::default() }
    };
    let ready = |losses, bus_off_images| condition(SessionState::Ready, losses, bus_off_images);
    let mut watch = GatewayWatch::new(true, &ready(1, 7).statistics);
    let mut texts = |now, at_s: u64| -> Vec<_> {
        watch.events(now, at_s * 1_000_000_000).map(|event| event.to_string()).collect()
    };
    assert!(texts(ready(1, 7), 1).is_empty());
    let interrupted = "lost and ready again; cause and duration are not known";
    assert_eq!(texts(ready(2, 7), 2), [interrupted]);
    assert_eq!(texts(ready(2, 9), 3), ["channel 1: bus-off", "channel 1: run"]);

    // A step of a later version, and a failure without its fault.
    let away = condition(SessionState::Failed, 3, 9);
    let away = GatewayCondition { waiting_for: PendingStep::decode(99), ..away };
    assert_eq!(texts(away, 4), ["lost, waits for OP", "not ready: verification failed"]);
    assert!(texts(away, 30).is_empty());
    assert_eq!(texts(ready(3, 9), 34), ["ready after 30.000 s"]);
    assert!(texts(ready(3, 9), 35).is_empty());
}

#[test]
fn lost_images_are_told_once_per_interval_and_at_the_end() {
    let counters = |txpdo_lost, txpdo_incomplete| SlaveStatistics {
        txpdo_lost,
        txpdo_incomplete,
        ..SlaveStatistics::default()
    };
    let mut watch = ImageLossWatch::new(&counters(5, 0), Duration::from_nanos(100));
    let mut losses = |lost, incomplete, now_ns| -> Vec<_> {
        watch.losses(&counters(lost, incomplete), now_ns).collect()
    };
    assert_eq!(losses(5, 0, 10), []);
    assert_eq!(losses(7, 1, 20), [ImageLoss::Lost(2), ImageLoss::Incomplete(1)]);
    assert_eq!(losses(8, 1, 119), []);
    assert_eq!(losses(9, 1, 120), [ImageLoss::Lost(2)]);
    assert_eq!(losses(10, 1, u64::MAX), [ImageLoss::Lost(1)]);
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
