//! The Port's part of a snapshot, with traffic and faults.

use std::time::Duration;

use crate::common::{Fixture, Handles};
use ecan_host::{AdapterConfig, Observer, Snapshot};
use ecan_mcan_port::{
    ChannelConfig, Config, GatewayConfig, PendingStep, Port, PortConfig, PortError, PortSnapshot,
    SessionState,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::Fault;

#[track_caller]
fn assert_last_cycle(port: &Port, snapshot: &mut Snapshot) {
    snapshot.update().unwrap();
    assert_eq!(snapshot.cycle(), port.adapter().cycle_number());
    let view = PortSnapshot::of(snapshot).unwrap();
    assert_eq!(view.slave_count(), port.slave_count());
    for gateway in port.gateways() {
        let slave = gateway.slave();
        assert_eq!(view.session(slave), Some(port.session(gateway).into()));
        assert_eq!(view.waiting_for(slave).is_none(), port.gateway_is_ready(gateway));
        assert_eq!(view.statistics(slave), Some(port.statistics(gateway)));
        assert_eq!(snapshot.domain_report(slave), Some(port.adapter().domain_report(slave)));
        for number in 0..5 {
            let Ok(channel) = port.channel(slave, number) else {
                assert_eq!(view.channel_status(slave, number), None);
                assert_eq!(view.channel_statistics(slave, number), None);
                continue;
            };
            assert_eq!(view.channel_status(slave, number), Some(port.channel_status(channel)));
            let statistics = port.statistics(gateway).channels[usize::from(number)];
            assert_eq!(view.channel_statistics(slave, number), Some(statistics));
        }
    }
    assert_eq!(view.session(port.slave_count()), None);
    assert_eq!(view.statistics(port.slave_count()), None);
}

/// One classic channel more per gateway.
fn config(gateways: u16) -> Config {
    let adapter = AdapterConfig::new(gateways).with_cycle(Duration::from_millis(1));
    let mut port = PortConfig::uniform(gateways.into(), GatewayConfig::default());
    for (slave, gateway) in port.gateways.iter_mut().enumerate() {
        for channel in gateway.channels.iter_mut().take(slave + 1) {
            *channel = Some(ChannelConfig::classic(1_000_000));
        }
    }
    (adapter, port).into()
}

#[test]
fn snapshot_equals_the_getters_of_its_cycle() {
    let Config { adapter, port, .. } = config(2);
    let mut fixture = Fixture::open(ecan_sim::echo(2), adapter, port).unwrap();
    let observer: Observer = fixture.port.adapter().observer();
    let mut snapshot = observer.snapshot();
    fixture.port.wait_ready().unwrap();
    let id = CanId::standard(0x100).unwrap();
    let frame = CanFrame::classic(id, &[1, 2]).unwrap();
    let mut steps = Vec::new();
    for nth in 0..3_000 {
        if nth == 1_500 {
            let fault = Fault::PowerCycle { gateway: 1, off_ms: 100 };
            fixture.simulation.with_world(|world| world.inject(fault));
        }
        fixture.cycle(|cycle| {
            for (slave, channel) in [(0, 0), (1, 0), (1, 1)] {
                let _ = cycle.send(cycle.ch(slave, channel), &frame);
            }
        });
        assert_last_cycle(&fixture.port, &mut snapshot);
        steps.extend(PortSnapshot::of(&snapshot).unwrap().waiting_for(1));
    }
    for step in [PendingStep::Answer, PendingStep::Operational] {
        assert!(steps.contains(&step), "{step} after the loss of the supply");
    }
    let view = PortSnapshot::of(&snapshot).unwrap();
    assert_eq!(view.session(0), Some(SessionState::Ready));
    assert_eq!(view.statistics(1).unwrap().sessions_lost, 1);
    assert!(view.channel_statistics(1, 1).unwrap().frames_received > 1_000);
    assert!(view.statistics(0).unwrap().incomplete_cycles == 0);
}

#[test]
fn snapshot_follows_a_reconfiguration_of_the_port() {
    let Config { adapter, port, .. } = config(1);
    let mut fixture = Fixture::ready(ecan_sim::echo(2), adapter, port);
    let mut snapshot = fixture.port.adapter().observer().snapshot();
    fixture.idle(1);
    assert_last_cycle(&fixture.port, &mut snapshot);
    fixture.port.reconfigure(config(2)).unwrap();
    fixture.port.wait_ready().unwrap();
    assert_last_cycle(&fixture.port, &mut snapshot);
    assert_eq!(PortSnapshot::of(&snapshot).unwrap().slave_count(), 2);
    // A cycle of the Adapter alone has no part of the Port.
    let adapter = fixture.port.adapter_mut();
    adapter.receive().and_then(|()| adapter.send()).unwrap();
    snapshot.update().unwrap();
    assert!(PortSnapshot::of(&snapshot).is_none());
}

#[test]
fn stop_request_ends_the_wait_for_ready_and_an_opening() {
    let Config { adapter, port, .. } = config(1);
    let mut fixture = Fixture::open(ecan_sim::echo(1), adapter, port).unwrap();
    let observer = fixture.port.adapter().observer();
    observer.request_stop();
    let error = fixture.port.wait_ready().unwrap_err();
    assert!(matches!(error, PortError::Adapter(ecan_host::Error::Stopped)), "{error}");
    fixture.port.adapter().clear_stop_request();
    fixture.port.wait_ready().unwrap();
    let ecrt = fixture.port.adapter().ecrt().clone();
    drop(fixture);
    let opened = Port::open_with_stop(&ecrt, config(1), Some(Box::new(|| true)));
    assert!(matches!(opened, Err(PortError::Adapter(ecan_host::Error::Stopped))));
}
