//! A running bus allocates no memory.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{BusEvent, BusFault, CanBus, StationConfig};
use ecan_test_support::allocations;

/// Traffic with errors, a bus-off and its recovery.
#[test]
fn traffic_and_errors_allocate_nothing() {
    let mut bus = CanBus::new("test");
    let stations: [_; 5] = std::array::from_fn(|_| bus.attach());
    for station in stations {
        bus.configure(0, station, Some(StationConfig::fd(1_000_000, 5_000_000)));
    }
    let frames: [_; 5] = std::array::from_fn(|i| {
        let id = CanId::standard(0x100 + i as u16).unwrap();
        CanFrame::fd(id, &[i as u8; 32], true, false).unwrap()
    });
    let mut events: Vec<BusEvent> = Vec::with_capacity(64);
    let mut now = 0;
    let mut ended = 0;
    let before = allocations();
    for round in 0..20_000 {
        for (station, frame) in stations.iter().zip(frames) {
            bus.offer(now, *station, frame);
        }
        if round % 1000 == 0 {
            bus.inject(BusFault::ErrorFrames { station: stations[round / 1000 % 5], count: 40 });
        }
        events.clear();
        now = bus.advance(now + 1_000_000, &mut events);
        for event in &events {
            match *event {
                BusEvent::Transmitted { .. } => ended += 1,
                BusEvent::StateChanged { station, .. } => bus.recover(now, station),
                _ => {}
            }
        }
    }
    let after = allocations();
    assert!(ended > 10_000, "{ended} frames");
    assert_eq!(after - before, 0);
}
