//! A bus under test and its events.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{BusEvent, CanBus, ErrorState, FrameTiming, StationConfig, StationId};

/// One bit at 500 kbit/s.
pub const BIT: u64 = 2_000;
pub const CLASSIC: StationConfig = StationConfig::classic(500_000);
pub const FD: StationConfig = StationConfig::fd(500_000, 5_000_000);

pub fn classic(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

pub fn bits(frame: &CanFrame) -> u64 {
    u64::from(FrameTiming::of(frame).total_bits())
}

/// A bus whose stations have joined: configured at 0, the test begins at 1 ms.
pub fn bus_of(configs: &[StationConfig]) -> (CanBus, Vec<StationId>) {
    let mut bus = CanBus::new("test");
    let stations = configs
        .iter()
        .map(|config| {
            let station = bus.attach();
            bus.configure(0, station, Some(*config));
            station
        })
        .collect();
    assert_eq!(run(&mut bus, START), []);
    (bus, stations)
}

pub const START: u64 = 1_000_000;

pub fn run(bus: &mut CanBus, until: u64) -> Vec<BusEvent> {
    let mut events = Vec::new();
    loop {
        let before = events.len();
        let reached = bus.advance(until, &mut events);
        if events.len() == before {
            assert_eq!(reached, until);
            return events;
        }
    }
}

pub fn states(events: &[BusEvent], of: StationId) -> Vec<ErrorState> {
    events
        .iter()
        .filter_map(|event| match event {
            BusEvent::StateChanged { station, state, .. } if *station == of => Some(*state),
            _ => None,
        })
        .collect()
}

pub fn error_frames(events: &[BusEvent]) -> usize {
    events.iter().filter(|e| matches!(e, BusEvent::ErrorFrame { .. })).count()
}

pub fn sent(events: &[BusEvent]) -> Vec<(StationId, CanFrame, u64, u64)> {
    events
        .iter()
        .filter_map(|event| match *event {
            BusEvent::Transmitted { station, frame, start_ns, at_ns } => {
                Some((station, frame, start_ns, at_ns))
            }
            _ => None,
        })
        .collect()
}

pub fn received(events: &[BusEvent]) -> Vec<(StationId, CanFrame)> {
    events
        .iter()
        .filter_map(|event| match *event {
            BusEvent::Received { station, frame, .. } => Some((station, frame)),
            _ => None,
        })
        .collect()
}
