//! TIME.

use std::time::Duration;

use ecan_canopen::{NodeConfig, TimeConfig, TimeReference};

use super::bench::{Bench, drives};

#[test]
fn time_of_the_host_reaches_the_drive() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    bench.write(node, (0x1012, 0), &0x8000_0100_u32.to_le_bytes());
    let clock = bench.port.adapter().ecrt().clock().clone();
    // 2026-11-24T13:45:00Z
    let reference = TimeReference { unix_ns: 1_795_527_900_000_000_000, bus_ns: clock.now_ns() };
    let config = TimeConfig { period: Duration::from_millis(100), reference };
    bench.network.set_time(Some(config)).unwrap();
    bench.pass(1_010);
    assert_eq!(bench.network.statistics().times_sent, 11);
    let time = bench.simulation().with_world(|world| world.drive("1").unwrap().time_of_day());
    let time = time.unwrap();
    assert_eq!(time.days(), 15_668);
    let after_ms = time.ms() - 49_500_000;
    assert!((1_000..1_010).contains(&after_ms), "{after_ms} ms");
}
