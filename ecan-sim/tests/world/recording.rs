//! Recording every bus of a world.
use std::path::Path;

use ecan_sim::{Scenario, ScenarioChoice, SimOptions, Wire, load_scenario};

const MS: u64 = 1_000_000;

/// Two buses, each with a node that replays a log and one that echoes.
const TOML: &str = "
[[gateway]]

[[node]]
kind = \"replay\"
bus = \"0.0\"
file = \"recording.log\"
bitrate = 1000000

[[node]]
kind = \"echo\"
bus = \"0.0\"
bitrate = 1000000

[[node]]
kind = \"replay\"
bus = \"0.3\"
file = \"recording.log\"
bitrate = 500000

[[node]]
kind = \"echo\"
bus = \"0.3\"
bitrate = 500000
";

fn scenario() -> Scenario {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(directory.join("recording.log"), "(0.001000) can0 123#1122\n").unwrap();
    let path = directory.join("recording.toml");
    std::fs::write(&path, TOML).unwrap();
    let choice = ScenarioChoice::parse(path.to_str().unwrap()).unwrap();
    let options = SimOptions { seed: Some(77), gateways: vec![0; 5], ..SimOptions::default() };
    load_scenario(&choice, &options).unwrap()
}

#[test]
fn buses_are_recorded_with_name_in_order_of_time() {
    let scenario = scenario();
    assert_eq!((scenario.seed, scenario.gateways.len()), (77, 1), "the file decides on gateways");
    let mut wire = Wire::new(&scenario, 1_000 * MS).unwrap();
    wire.world_mut().record_all_buses();
    wire.advance(1_100 * MS);
    let mut recorded = Vec::new();
    wire.world_mut().drain_recorded(|bus, frame| recorded.push((bus.to_owned(), *frame)));
    let buses: Vec<_> = recorded.iter().map(|(bus, _)| bus.as_str()).collect();
    // Frame and echo at 1 Mbit/s end before the first frame of the slow bus.
    assert_eq!(buses, ["0.0", "0.0", "0.3", "0.3"]);
    assert!(recorded.is_sorted_by_key(|(_, frame)| frame.end_ns));
    for (_, frame) in &recorded {
        assert!(frame.start_ns < frame.end_ns && !frame.is_from_channel);
        assert_eq!(frame.channel, None);
        assert_eq!(frame.frame.as_ref().data(), [0x11, 0x22]);
    }
    let mut later = 0;
    wire.world_mut().drain_recorded(|_, _| later += 1);
    assert_eq!(later, 0, "they were fetched");
    assert_eq!(wire.world().channel_statistics(0, 0).map(|channel| channel.transmitted), Some(0));
    assert!(wire.world().channel_statistics(1, 0).is_none());
}
