//! Frames at a phase of the next Sync0 period (manual 8.4, 13.8).

use std::time::Duration;

use crate::common::{Fixture, SendData, classic, frames_of, id};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{GatewayConfig, NotSchedulable, PortConfig, SendError};
use ecan_protocol::image::Schedule;

fn with_sync0() -> Fixture {
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(500)));
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    Fixture::ready(ecan_sim::echo(1), adapter, config)
}

#[test]
fn scheduled_frame_leaves_at_its_phase_and_in_pdo_order() {
    let mut fixture = with_sync0();
    let schedule = |offset_ns| Schedule { tag: 7, offset_ns };
    fixture.cycle(|cycle| {
        cycle.schedule_can(0, 0, id(3), &[], schedule(300_000)).unwrap();
        cycle.schedule_can(0, 0, id(1), &[], schedule(100_000)).unwrap();
        cycle.schedule_can(0, 0, id(2), &[], schedule(100_000)).unwrap();
    });
    let back: Vec<_> = frames_of(&fixture.idle(8)).iter().map(|f| f.frame.id().raw()).collect();
    assert_eq!(back, [1, 2, 3], "by phase, then in the order of the image");
    let counters = fixture.simulation.with_world(|world| world.counters(0).unwrap());
    assert_eq!((counters.frames_scheduled, counters.frames_released), (3, 3));
    assert_eq!(counters.transmit_losses.late, 0);
}

#[test]
fn what_cannot_be_scheduled_is_rejected_with_the_reason() {
    let mut fixture = with_sync0();
    let beyond = Schedule { tag: 0, offset_ns: 1_000_000 };
    fixture.cycle(|cycle| {
        let rejected = cycle.schedule_can(0, 0, id(1), &[], beyond).unwrap_err();
        let reason = NotSchedulable::BeyondPeriod { sync0_ns: 1_000_000 };
        assert_eq!(rejected, SendError::NotSchedulable { slave: 0, offset_ns: 1_000_000, reason });
    });
    let mut fixture = Fixture::single(GatewayConfig::on_channel(0, classic()));
    fixture.cycle(|cycle| {
        let schedule = Schedule { tag: 0, offset_ns: 1 };
        let rejected = cycle.schedule_can(0, 0, id(1), &[], schedule).unwrap_err();
        assert!(rejected.to_string().contains("not configured"), "{rejected}");
    });
}
