//! The bridge on a pair of datagram sockets; the other end replaces the kernel.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

use ecan_protocol::can::{CanFrame, CanId};
use socketcan::CanFdSocket;

use crate::bridge::config::{BridgeStatistics, BusEvent, BusRates, ErrorCounters};
use crate::bridge::socketcan::SocketCanBridge;

/// Timeout of a failing test.
const LIMIT: Duration = Duration::from_secs(60);

/// A bridge, and the kernel's end of its socket.
fn bridge(queue: usize) -> (SocketCanBridge, UnixDatagram) {
    let (ours, kernel) = UnixDatagram::pair().unwrap();
    kernel.set_read_timeout(Some(LIMIT)).unwrap();
    let socket = CanFdSocket::from(OwnedFd::from(ours));
    (SocketCanBridge::over(socket, "vcan0", queue).unwrap(), kernel)
}

/// Waits until the bridge's threads have made this progress.
fn wait_until<T>(bridge: &SocketCanBridge, look: impl Fn() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(start.elapsed() < LIMIT, "{:?}", bridge.clients().statistics());
        std::thread::yield_now();
    }
}

fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

/// A frame in the kernel's format.
fn bytes(id: u32, length: u8, flags: u8, data: &[u8], size: usize) -> Vec<u8> {
    let mut bytes = [&id.to_ne_bytes()[..], &[length, flags, 0, 0], data].concat();
    bytes.resize(size, 0);
    bytes
}

fn received(kernel: &UnixDatagram) -> Vec<u8> {
    let mut bytes = [0; 256];
    let length = kernel.recv(&mut bytes).unwrap();
    bytes[..length].to_vec()
}

#[test]
fn frames_pass_both_directions_in_order() {
    let (bridge, kernel) = bridge(64);
    let clients = bridge.clients();
    clients.set_bus(BusRates::fd(500_000, 2_000_000));
    assert!(clients.is_any_connected());
    kernel.send(&bytes(0x123, 2, 0, &[1, 2], 16)).unwrap();
    kernel.send(&bytes(0x8000_0124, 16, 5, &[3; 16], 72)).unwrap();
    let first = wait_until(&bridge, || clients.next_for_bus());
    let second = wait_until(&bridge, || clients.next_for_bus());
    assert_eq!(first.frame, frame(0x123, &[1, 2]));
    let id = CanId::extended(0x124).unwrap();
    assert_eq!(second.frame, CanFrame::fd(id, &[3; 16], true, false).unwrap());

    // A frame from the interface does not return to it; frames of others do.
    clients.confirm(&first, 1);
    clients.deliver(&frame(0x7FF, &[9]), 2, None);
    clients.deliver(&second.frame, 3, None);
    assert_eq!(received(&kernel), bytes(0x7FF, 1, 0, &[9], 16));
    assert_eq!(received(&kernel), bytes(0x8000_0124, 16, 5, &[3; 16], 72));
    let expected = BridgeStatistics {
        clients: 1,
        connections: 1,
        sent: 1,
        delivered: 2,
        ..Default::default()
    };
    assert_eq!(clients.statistics(), expected);
    assert!(bridge.end().is_none());
}

#[test]
fn frames_unfit_for_bus_are_counted() {
    let (bridge, kernel) = bridge(2);
    let clients = bridge.clients();
    let count = |look: fn(&BridgeStatistics) -> u64, wanted: u64| {
        wait_until(&bridge, || (look(&clients.statistics()) == wanted).then_some(()));
    };
    // Before the bus is known, then CAN FD on a classic bus.
    kernel.send(&bytes(0x123, 0, 0, &[], 16)).unwrap();
    count(|counters| counters.mismatched, 1);
    clients.set_bus(BusRates::classic(500_000));
    kernel.send(&bytes(0x123, 0, 4, &[], 72)).unwrap();
    count(|counters| counters.mismatched, 2);
    // An error frame, and data that is not a frame.
    kernel.send(&bytes(0x2000_0040, 8, 0, &[], 16)).unwrap();
    kernel.send(&[1, 2, 3]).unwrap();
    count(|counters| counters.rejected, 4);
    // The interface receives an event for each frame that the bus cannot carry.
    for _ in 0..2 {
        assert_eq!(received(&kernel), bytes(0x2000_0001, 8, 0, &[], 16));
    }
}

/// Neither the bridge nor the kernel loses a frame while the bus is slower than the interface.
#[test]
fn full_queue_to_bus_stops_reading() {
    let (bridge, kernel) = bridge(2);
    let clients = bridge.clients();
    clients.set_bus(BusRates::classic(500_000));
    kernel.set_nonblocking(true).unwrap();
    let mut sent = 0;
    // The sender is held back when all queues are full.
    let start = Instant::now();
    while sent < 100_000 && kernel.send(&bytes(sent, 0, 0, &[], 16)).is_ok() {
        sent += 1;
    }
    assert!((3..100_000).contains(&sent), "{sent} frames in {:?}", start.elapsed());
    for number in 0..sent {
        let next = wait_until(&bridge, || clients.next_for_bus());
        assert_eq!(next.frame.id().raw(), number);
    }
    assert_eq!(clients.next_for_bus(), None);
    assert_eq!(clients.statistics().dropped_to_bus, 0);
}

#[test]
fn bus_events_reach_interface_as_error_frames() {
    let (bridge, kernel) = bridge(8);
    let clients = bridge.clients();
    let counters = ErrorCounters { transmit: 130, receive: 2 };
    clients.report(BusEvent::BusOff, None, 1);
    clients.deliver(&frame(0x100, &[]), 2, None);
    clients.report(BusEvent::ErrorPassive, Some(counters), 3);
    assert_eq!(received(&kernel), bytes(0x2000_0040, 8, 0, &[], 16));
    assert_eq!(received(&kernel), bytes(0x100, 0, 0, &[], 16));
    assert_eq!(received(&kernel), bytes(0x2000_0204, 8, 0, &[0, 0x20, 0, 0, 0, 0, 130, 2], 16));
}

#[test]
fn blocked_interface_drops_frames_and_recovers() {
    let (bridge, kernel) = bridge(4096);
    let clients = bridge.clients();
    // More frames than the socket holds.
    for number in 0..2000 {
        clients.deliver(&frame(number, &[]), 0, None);
    }
    let dropped = || clients.statistics().dropped_to_clients;
    wait_until(&bridge, || (dropped() > 0).then_some(()));
    // From now on frames are read: all that were not dropped arrive in order.
    let mut last = 0;
    clients.deliver(&frame(0x7FF, &[]), 0, None);
    loop {
        let id = u32::from_ne_bytes(received(&kernel)[..4].try_into().unwrap());
        if id == 0x7FF {
            break;
        }
        assert!(last == 0 || id > last, "{id} after {last}");
        last = id;
    }
}

#[test]
fn idle_bridge_ends() {
    let (bridge, _kernel) = bridge(8);
    let clients = bridge.clients().clone();
    drop(bridge);
    assert!(!clients.is_any_connected());
    // No client is connected, so nothing is counted as delivered.
    clients.deliver(&frame(1, &[]), 0, None);
    assert_eq!(clients.statistics().delivered, 0);
}
