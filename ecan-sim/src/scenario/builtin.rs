//! The built-in scenarios.

use ecan_canopen::NodeId;

use crate::drive::{DriveConfig, MotorConfig};
use crate::random::WakeUpDelay;
use crate::scenario::{DriveSpec, GatewaySpec, NodeKind, NodeSpec, Scenario};

/// Names of the built-in scenarios.
pub const BUILTIN_SCENARIOS: &[&str] = &["echo", "drives", "jitter"];

/// Gateways with an echo node on each of their channels. The nodes use the bit rates of their
/// channel, so they work with every configuration.
pub fn echo(gateways: usize) -> Scenario {
    let gateways: Vec<_> = (0..gateways).map(GatewaySpec::at).collect();
    let nodes = gateways
        .iter()
        .flat_map(|gateway| &gateway.buses)
        .map(|bus| NodeSpec {
            name: format!("echo {bus}"),
            bus: bus.clone(),
            kind: NodeKind::Echo,
            bitrate: None,
            data_bitrate: None,
            physical_layer: None,
        })
        .collect();
    Scenario { name: "echo".to_owned(), gateways, nodes, ..Scenario::default() }
}

/// The built-in scenario `jitter`: as [`echo`], with the delays of a loaded machine and firmware,
/// to compare the two ways of sending of manual 13.9 in stepped time.
///
/// Half of the application's sleeps end up to 15 us late, one of 100 between 150 and 600 us. A
/// data-path service is late by up to 40 us. Scheduled frames are sent up to 13 us after their
/// phase, which fits the table of 13.9 (the difference of two such delays is below 12 us in 99 of
/// 100 cases).
pub fn jitter(gateways: usize) -> Scenario {
    let mut scenario = echo(gateways);
    "jitter".clone_into(&mut scenario.name);
    scenario.wake_up =
        Some(WakeUpDelay { typical_ns: 15_000, p99_ns: 150_000, longest_ns: 600_000 });
    for gateway in &mut scenario.gateways {
        gateway.config.service_jitter_ns = 40_000;
        gateway.config.release_jitter_ns = 13_000;
    }
    scenario
}

/// Number of drives on each channel of the built-in scenario `drives`.
const DRIVES_PER_CHANNEL: u8 = 4;

/// Gateways with drives on each of their channels: node-IDs 1 to `per_channel` (at most 127), named
/// `drive <gateway>.<channel>/<node-ID>`.
///
/// The built-in scenario `drives` has four per channel: 16 axes with one gateway, 48 with three.
/// The drives use the bit rates of their channel. Their start positions all differ and none is 0:
/// 100000 * gateway + 10000 * channel + 1000 * node-ID + 7 increments.
pub fn drives(gateways: usize, per_channel: u8) -> Scenario {
    let gateways: Vec<_> = (0..gateways).map(GatewaySpec::at).collect();
    let mut nodes = Vec::new();
    for (position, gateway) in gateways.iter().enumerate() {
        for (channel, bus) in gateway.buses.iter().enumerate() {
            let ids = (1..=per_channel.min(NodeId::MAX.get())).filter_map(NodeId::new);
            nodes.extend(ids.map(|node| built_in_drive(position, channel, bus, node)));
        }
    }
    Scenario { name: "drives".to_owned(), gateways, nodes, ..Scenario::default() }
}

fn built_in_drive(gateway: usize, channel: usize, bus: &str, node: NodeId) -> NodeSpec {
    let start_position = 100_000 * gateway + 10_000 * channel + 1_000 * usize::from(node.get()) + 7;
    let config = DriveConfig {
        serial: 1 + start_position as u32,
        motor: MotorConfig {
            start_position: i32::try_from(start_position).unwrap_or(i32::MAX),
            ..MotorConfig::default()
        },
        ..DriveConfig::new(node)
    };
    NodeSpec {
        name: format!("drive {bus}/{node}"),
        bus: bus.to_owned(),
        kind: NodeKind::Drive(Box::new(DriveSpec { config, eds: None })),
        bitrate: None,
        data_bitrate: None,
        physical_layer: None,
    }
}

/// A built-in scenario by its name.
pub(crate) fn by_name(name: &str, gateways: usize) -> Option<Scenario> {
    match name {
        "echo" => Some(echo(gateways)),
        "jitter" => Some(jitter(gateways)),
        "drives" => Some(drives(gateways, DRIVES_PER_CHANNEL)),
        _ => None,
    }
}
