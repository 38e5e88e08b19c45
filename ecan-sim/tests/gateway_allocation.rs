//! A gateway in operation allocates nothing.

mod counting;

mod gateway_support;

use counting::allocations;
use ecan_protocol::config::DataPathConfig;
use ecan_protocol::image::{OptionFlags, PdoProfile, Schedule};
use gateway_support::{Fixture, MS, chunks, fd, standard};

/// Traffic in both directions with results, schedules, overflows and a faulty image.
#[test]
fn cycles_need_no_heap() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(8) };
    let mut bench = Fixture::configured(tx, chunks(24));
    for channel in 0..4 {
        bench.apply_data_path(channel, DataPathConfig::for_traffic(4, 4));
    }
    bench.start_sync0();
    bench.pass(MS);
    bench.start();
    let before = allocations();
    for cycle in 0..200u16 {
        for channel in 0..4u8 {
            for number in 0..(cycle % 40) {
                bench.push(channel, standard(number, &[channel; 8]));
                bench.gateway.received(bench.now, channel.into(), &fd(number, &[9; 12]), bench.now);
            }
            let frame = fd(cycle, &[1; 16]);
            let schedule = Schedule { tag: cycle, offset_ns: 300_000 };
            let result =
                bench.writer.push_scheduled(&mut bench.image, channel, 0, frame.as_ref(), schedule);
            assert!(result.is_ok());
        }
        if cycle % 50 == 49 {
            bench.image[24] ^= 0xFF;
        }
        assert!(bench.write() && bench.read());
        bench.pass(MS / 2);
        for channel in 0..4 {
            while let Some(frame) = bench.gateway.next_transmit(channel) {
                bench.gateway.transmitted(bench.now, channel, &frame);
            }
        }
        bench.pass(MS / 2);
    }
    assert_eq!(allocations() - before, 0);
    let counters = bench.gateway.counters();
    assert!(
        counters.frames_on_bus > 1000
            && counters.frames_released > 0
            && counters.results_to_master > 0
    );
    assert!(counters.frames_to_master > 1000 && counters.receive_losses.cache_full > 0);
}
