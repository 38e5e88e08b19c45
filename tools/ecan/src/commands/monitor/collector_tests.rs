use ecan_mcan_port::{ChannelConfig, GatewayConfig};
use ecan_protocol::can::{CanFrame, CanId};

use super::super::observation::ChannelRates;
use super::*;

fn collector(position: usize, window_ns: u64) -> Collector {
    let config = GatewayConfig::on_channel(2, ChannelConfig::classic(500_000));
    let rates = ChannelRates::of(&config);
    let gateways = vec![LayoutGateway { position, rates, ..LayoutGateway::default() }];
    let mut collector = Collector::new(Origin::default(), window_ns);
    collector.set_layout(&Layout { cycle_ns: 1_000_000, gateways, ..Layout::default() });
    collector
}

fn observe(collector: &mut Collector, now_ns: u64, change: impl Fn(&mut GatewayObservation)) {
    let mut observation = Observation::new(1);
    observation.now_ns = now_ns;
    change(&mut observation.gateways[0]);
    collector.take(&observation);
}

#[test]
fn loss_and_recovery_between_observations_is_reported() {
    let mut collector = collector(4, u64::MAX);
    let ready = |lost| {
        move |gateway: &mut GatewayObservation| {
            gateway.condition.session = SessionState::Ready;
            gateway.condition.statistics.sessions = lost + 1;
            gateway.condition.statistics.sessions_lost = lost;
        }
    };
    observe(&mut collector, 0, ready(0));
    observe(&mut collector, 500_000_000, ready(1));
    let snapshot = collector.snapshot();
    let words: Vec<_> = snapshot.events.iter().map(|event| event.words.as_str()).collect();
    let interrupted = format!("gateway 4: {}", BusEvent::Interrupted);
    assert_eq!(words, ["gateway 4: ready", &interrupted]);
    assert_eq!(snapshot.gateways[0].times_lost, 1);
}

#[test]
fn rates_use_the_window_and_counters_the_last_clear() {
    let mut collector = collector(0, 1_000_000_000);
    let mut observation = Observation::new(1);
    let mut observe = |collector: &mut Collector, second: u64, frames: u64| {
        observation.clear();
        observation.now_ns = second * 1_000_000_000;
        let gateway = &mut observation.gateways[0];
        gateway.condition.session = SessionState::Ready;
        let received = &mut gateway.condition.statistics.channels[2].frames_received;
        let (before, gateway, channel) = (std::mem::replace(received, frames), 0, 2);
        for _ in before..frames {
            let (time_ns, direction) = (observation.now_ns, Direction::Received);
            let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[0; 8]).unwrap();
            observation.frames.push(ObservedFrame { time_ns, gateway, channel, direction, frame });
        }
        collector.take(&observation);
        collector.snapshot().gateways[0].channels[2].clone()
    };
    observe(&mut collector, 0, 0);
    observe(&mut collector, 1, 1000);
    let channel = observe(&mut collector, 2, 1100);
    assert_eq!(channel.received, 1100);
    assert!((channel.rx_per_second - 100.0).abs() < 1e-9);
    // 111 bits at 500 kbit/s.
    assert!((channel.load - 100.0 * 111.0 / 500_000.0).abs() < 1e-9, "{}", channel.load);
    assert_eq!(collector.snapshot().ids.ids[0].count, 1100);
    collector.clear();
    assert_eq!(observe(&mut collector, 3, 1103).received, 3);
    assert_eq!(collector.snapshot().ids.ids[0].count, 3);
}

#[test]
fn interruption_keeps_the_last_state_and_is_a_problem() {
    let mut collector = collector(0, u64::MAX);
    let mut observation = Observation::new(1);
    observation.gateways[0].condition.session = SessionState::Ready;
    collector.take(&observation);
    assert!(!collector.snapshot().has_problem());
    observation.gateways[0].condition.session = SessionState::Failed;
    observation.interruption = Some("NO RESPONSE");
    collector.take(&observation);
    let snapshot = collector.snapshot();
    assert_eq!(snapshot.gateways[0].state, GatewayState::Ready);
    assert!(snapshot.has_problem() && snapshot.head.interruption.is_some());
}

#[test]
fn new_layout_counts_again_and_is_an_event() {
    let mut collector = collector(3, u64::MAX);
    observe(&mut collector, 0, |gateway| gateway.condition.statistics.sessions_lost = 7);
    let base = SlaveStatistics { sessions_lost: 5, ..SlaveStatistics::default() };
    let gateway = |position| LayoutGateway { position, base, ..LayoutGateway::default() };
    let event = Some("configured again".to_owned());
    let gateways = vec![gateway(8), gateway(9)];
    let mut observation = Observation::new(2);
    observation.layout = Some(Layout { gateways, event, ..Layout::default() });
    observation
        .gateways
        .iter_mut()
        .for_each(|gateway| gateway.condition.statistics.sessions_lost = 5);
    observation.frames.lose(4);
    collector.take(&observation);
    let snapshot = collector.snapshot();
    let gateways: Vec<_> =
        snapshot.gateways.iter().map(|gateway| (gateway.position, gateway.times_lost)).collect();
    assert_eq!(gateways, [(8, 0), (9, 0)]);
    assert_eq!(snapshot.events.last().unwrap().words, "configured again");
    assert_eq!(snapshot.head.frames_lost, 4);
}

#[test]
fn axis_error_is_an_event_once() {
    let mut collector = collector(0, u64::MAX);
    let axes = super::super::test_snapshots::axes().axes.axes;
    let mut observation = Observation { axes, ..Observation::new(1) };
    collector.take(&observation);
    collector.take(&observation);
    observation.axes[1].error = None;
    collector.take(&observation);
    let words: Vec<_> = collector.events.iter().map(|event| event.words.as_str()).collect();
    assert_eq!(words, ["gateway 0 can1 node 4: the drive is in fault"]);
    assert_eq!(collector.snapshot().axes.without_axes, None);
}
