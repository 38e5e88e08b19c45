//! Transmit results find the sends that caused them (manual 10).

use std::collections::HashSet;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_mcan_port::{GatewayConfig, Received, TransmitReport};
use ecan_protocol::image::{OptionFlags, ResultCode};

fn with_results() -> GatewayConfig {
    let mut gateway = GatewayConfig::on_all_channels(classic());
    gateway.tx_options = OptionFlags::TX_RESULT;
    gateway
}

fn reports(items: &[Received]) -> Vec<TransmitReport> {
    let report = |item: &Received| match item {
        Received::TransmitReport(report) => Some(*report),
        Received::Frame(_) => None,
    };
    items.iter().filter_map(report).collect()
}

#[test]
fn every_send_gets_its_own_result() {
    let mut fixture = Fixture::single(with_results());
    let mut tickets = HashSet::new();
    let mut answered = Vec::new();
    for round in 0..20 {
        let items = fixture.cycle(|cycle| {
            for channel in 0..4 {
                let ticket = cycle.send_can(0, channel, id(round), &[channel]).unwrap();
                assert!(tickets.insert((ticket, channel)), "tickets are unique");
            }
        });
        answered.extend(reports(&items));
    }
    answered.extend(reports(&fixture.idle(10)));
    assert_eq!(answered.len(), 80);
    for report in &answered {
        let ticket = report.ticket.expect("known send");
        assert!(report.code.is_success(), "{report:?}");
        assert!(tickets.remove(&(ticket, report.channel)), "{report:?}");
    }
    assert!(tickets.is_empty());
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!(statistics.unmatched_results, 0);
    assert_eq!(statistics.channels.map(|c| c.results_ok), [20; 4]);
}

#[test]
fn bus_off_channel_answers_with_the_reason() {
    let mut gateway = with_results();
    // Frames go out all the same, and manual recovery keeps the channel off.
    gateway.paced = false;
    for settings in gateway.channels.iter_mut().flatten() {
        settings.data_path.bus_off_recovery = ecan_protocol::config::BusOffRecovery::Manual;
    }
    let mut fixture = Fixture::single(gateway);
    fixture.simulation.inject(ecan_sim::Fault::BusOff { gateway: 0, channel: 1 });
    fixture.idle(5);
    assert!(fixture.port.channel_status(fixture.port.ch(0, 1)).bus_off());
    let mut ticket = None;
    let mut items = fixture.cycle(|cycle| ticket = cycle.send_can(0, 1, id(5), &[]).ok());
    items.extend(fixture.idle(5));
    let reports = reports(&items);
    assert_eq!(reports.len(), 1, "{reports:?}");
    assert_eq!((reports[0].ticket, reports[0].code), (ticket, ResultCode::BusOff));
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).channels[1].results_failed, 1);
}

#[test]
fn results_that_nobody_takes_are_counted() {
    let mut fixture = Fixture::single(with_results());
    for _ in 0..10 {
        let mut cycle = fixture.port.next_cycle();
        cycle.send_can(0, 2, id(1), &[1]).unwrap();
    }
    for _ in 0..5 {
        fixture.port.next_cycle().end().unwrap();
    }
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!(statistics.channels[2].results_ok, 10);
    assert_eq!(statistics.channels[2].frames_received, 0);
}
