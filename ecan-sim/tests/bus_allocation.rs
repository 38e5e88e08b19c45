//! A bus in operation allocates nothing.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

use ecan_protocol::{CanFrame, CanId};
use ecan_sim::{BusEvent, BusFault, CanBus, StationConfig};

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Traffic with errors, a bus-off and its recovery. The only test of this file, since the
/// counter is the process's.
#[test]
fn traffic_and_errors_need_no_heap() {
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
    let before = ALLOCATIONS.load(Ordering::Relaxed);
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
    let after = ALLOCATIONS.load(Ordering::Relaxed);
    assert!(ended > 10_000, "{ended} frames");
    assert_eq!(after - before, 0);
}
