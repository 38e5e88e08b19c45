//! A Port on a master that the application owns and serves.
#![allow(missing_docs)]

use std::time::Duration;

mod common;

use common::{Handles, SendData, classic, id};
use ecan_host::{Adapter, AdapterConfig, DcSync, Master};
use ecan_mcan_port::{Cycle, GatewayConfig, Port, PortConfig};
use ecan_protocol::image::Schedule;
use ecan_sim::{ClockKind, SimOptions};

/// Sync0 is in phase with the application time of the owner, here half a period behind the grid of
/// the Port: that a cycle ends behind the shift on its own grid says nothing.
#[test]
fn lateness_is_not_judged_by_a_grid_that_sync0_does_not_follow() {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    // The pulses of the owner come close to the arrivals of this Port.
    let scenario = common::without_sync0_window(ecan_sim::echo(1));
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let simulation = backend.simulation.unwrap();
    let ecrt = backend.ecrt;
    let clock = ecrt.clock().clone();
    let mut owner = Master::request(&ecrt, 0).unwrap();
    // SAFETY: the owner outlives the Port below and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(100)));
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let startup = config.startup_plan(&adapter);
    let adapter = Adapter::attach(&ecrt, shared, adapter, startup).unwrap();
    let mut port = Port::new(adapter, config).unwrap();
    owner.set_send_interval(1_000).unwrap();
    owner.activate().unwrap();
    port.adapter_mut().owner_activated().unwrap();
    let mut cycle = |port: &mut Port, work: &mut dyn FnMut(&mut Cycle<'_>)| {
        port.wait_next_cycle();
        owner.application_time(port.adapter().cycle_start().deadline_ns + 500_000).unwrap();
        owner.receive().unwrap();
        let mut cycle = port.begin_cycle();
        cycle.received().for_each(drop);
        work(&mut cycle);
        assert_eq!(cycle.finish().error(), None);
        owner.sync_slave_clocks().unwrap();
        owner.send().unwrap();
    };
    let is_ready = (0..20_000).any(|_| {
        cycle(&mut port, &mut |_| ());
        port.is_ready()
    });
    assert!(is_ready);
    for _ in 0..50 {
        cycle(&mut port, &mut |cycle| {
            let at = Schedule { tag: 1, offset_ns: 50_000 };
            clock.sleep_until_ns(clock.now_ns() + 200_000);
            cycle.schedule_can(0, 0, id(1), &[], at).unwrap();
        });
    }
    for _ in 0..5 {
        cycle(&mut port, &mut |_| ());
    }
    let account = port.schedule_account(port.ch(0, 0));
    assert_eq!((account.scheduled, account.withdrawn, account.rejected_late), (50, 0, 0));
    let counters = simulation.with_world(|world| world.counters(0).unwrap());
    assert_eq!(counters.frames_released, 50);
}
