//! A gateway in operation allocates nothing.

use crate::gateway::fixture::{Fixture, MS, chunks, fd, standard};
use ecan_protocol::config::DataPathConfig;
use ecan_protocol::image::{OptionFlags, PdoProfile, Schedule};
use ecan_test_support::allocations;

/// Traffic in both directions with results, schedules, overflows and a faulty image.
#[test]
fn cycles_allocate_nothing() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(8) };
    // Cycles are longer than the Sync0 period, so that writes come at every phase.
    let sync0_window = ecan_sim::Sync0Window::OFF;
    let config = ecan_sim::GatewayModelConfig { sync0_window, ..Default::default() };
    let mut fixture = Fixture::configured_with(config, tx, chunks(24));
    for channel in 0..4 {
        fixture.apply_data_path(channel, DataPathConfig::for_traffic(4, 4));
    }
    fixture.start_with_sync0(0);
    let before = allocations();
    for cycle in 0..200u16 {
        for channel in 0..4u8 {
            for number in 0..(cycle % 40) {
                fixture.push(channel, standard(number, &[channel; 8]));
                fixture.gateway.received(
                    fixture.now,
                    channel.into(),
                    &fd(number, &[9; 12]),
                    fixture.now,
                );
            }
            let frame = fd(cycle, &[1; 16]);
            let schedule = Schedule { tag: cycle, offset_ns: 300_000 };
            fixture.push_scheduled(channel, frame, schedule);
        }
        if cycle % 50 == 49 {
            fixture.image[24] ^= 0xFF;
        }
        assert!(fixture.write() && fixture.read());
        fixture.pass(MS / 2);
        for channel in 0..4 {
            while let Some(frame) = fixture.gateway.next_transmit(channel) {
                fixture.gateway.transmitted(fixture.now, channel, &frame);
            }
        }
        fixture.pass(MS / 2);
    }
    assert_eq!(allocations() - before, 0);
    let counters = fixture.gateway.counters();
    assert!(
        counters.frames_on_bus > 1000
            && counters.frames_released > 0
            && counters.results_to_master > 0
    );
    assert!(counters.frames_to_master > 1000 && counters.receive_losses.cache_full > 0);
}
