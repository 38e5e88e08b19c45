//! One scenario through both fronts of the simulator: the same startup list and the same images give
//! the same CAN traffic, over the simulated libethercat and over Ethernet frames.

use std::path::Path;
use std::time::Duration;

use crate::common::{Fixture, SendData, classic, id};
use crate::wire_support::{Line, MS, command::LRW};
use ecan_host::{AdapterConfig, StartupStep};
use ecan_mcan_port::{GatewayConfig, PortConfig};
use ecan_protocol::can::CanFrame;
use ecan_sim::{BusFrame, Scenario};

/// An echo that drops, corrupts and repeats, and a silent listener.
const SCENARIO: &str = r#"
seed = 77
[[gateway]]
[[node]]
kind = "faulty"
bus = "0.0"
name = "partner"
drop_permille = 100
corrupt_permille = 100
repeat_permille = 100
[[node]]
kind = "silent"
bus = "0.0"
name = "listener"
"#;

const CYCLES: usize = 300;
const BYTES: usize = 384;

/// Start against the first frame, the frame, whether the gateway sent it.
type Traffic = Vec<(u64, CanFrame, bool)>;

fn traffic(recorded: Vec<BusFrame>) -> Traffic {
    let first = recorded.first().map_or(0, |frame| frame.start_ns);
    let entry = |sent: BusFrame| (sent.start_ns - first, sent.frame, sent.is_from_channel);
    recorded.into_iter().map(entry).collect()
}

/// Sends up to six frames in a cycle through the Port; gives the images and the traffic.
fn over_libethercat(scenario: Scenario, config: &PortConfig) -> (Vec<Vec<u8>>, Traffic, u64) {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::ready(scenario, adapter, *config);
    fixture.idle(20);
    fixture.simulation.with_world(|world| assert!(world.record_bus_of(0, 0)));
    let mut images = Vec::new();
    for cycle in 0..CYCLES {
        fixture.cycle(|open| {
            for nth in 0..cycle % 7 {
                let data = [cycle as u8, nth as u8, 3, 4, 5, 6, 7, 8];
                // What is not taken is not in the image either.
                let _ = open.send_can(0, 0, id(0x100 + nth as u16), &data[..nth + 1]);
            }
        });
        images.push(fixture.port.adapter().rx_pdo(0)[..BYTES].to_vec());
    }
    fixture.idle(10);
    let counters = fixture.simulation.with_world(|world| world.counters(0).unwrap());
    let recorded = fixture.simulation.with_world(|world| world.take_recorded());
    (images, traffic(recorded), counters.frames_on_bus)
}

/// Brings the same gateway into OP by hand, and sends these images.
fn over_the_wire(scenario: &Scenario, config: &PortConfig, images: &[Vec<u8>]) -> (Traffic, u64) {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let startup = config.startup_plan(&adapter);
    let mut line = Line::with(scenario);
    line.address(0);
    line.set_up_mailboxes(0x1001);
    line.request(0x1001, 2);
    line.assign(0x1001, 3);
    for step in startup.of_slave(0) {
        if let StartupStep::Download(write) = step {
            let bytes = write.ty.size_bytes().unwrap();
            let data = &write.value.to_le_bytes()[..bytes];
            line.download(0x1001, (write.index, write.subindex), data).unwrap();
        }
    }
    line.map(0x1001, 3, 0);
    line.request(0x1001, 4);
    line.request(0x1001, 8);
    assert_eq!(line.state(0x1001), (8, 0));
    assert!(line.wire.world_mut().record_bus_of(0, 0));
    let mut cycle = |image: &[u8]| {
        line.pass(MS - 10_000);
        line.logical(LRW, 0, &[image, &[0; BYTES]].concat())
    };
    for image in images {
        cycle(image);
    }
    // The last image once more is a no-op.
    for _ in 0..10 {
        assert_eq!(cycle(images.last().unwrap()).counter, 3);
    }
    let counters = line.wire.world().counters(0).unwrap();
    (traffic(line.wire.world_mut().take_recorded()), counters.frames_on_bus)
}

#[test]
fn same_images_give_the_same_traffic() {
    let scenario = || Scenario::from_toml(SCENARIO, "both", Path::new(".")).unwrap();
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let (images, port, sent) = over_libethercat(scenario(), &config);
    let (wire, sent_on_wire) = over_the_wire(&scenario(), &config, &images);
    assert!(sent > 800 && port.len() as u64 > sent, "{sent} of {}", port.len());
    assert_eq!(sent_on_wire, sent);
    let differs = port.iter().zip(&wire).position(|(a, b)| a != b);
    assert_eq!((differs, wire.len()), (None, port.len()));
}
