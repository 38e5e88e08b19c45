//! The scenarios that need no file.

use crate::scenario::{GatewaySpec, NodeKind, NodeSpec, Scenario};

/// Names of the built-in scenarios.
pub const BUILTIN_SCENARIOS: &[&str] = &["echo"];

/// So many gateways with an echo node on each of their channels. The nodes take over the bit rates
/// of their channel, so every configuration finds a partner.
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
        })
        .collect();
    Scenario { name: "echo".to_owned(), gateways, nodes, ..Scenario::default() }
}

/// A built-in scenario by its name.
pub(crate) fn by_name(name: &str, gateways: usize) -> Option<Scenario> {
    match name {
        "echo" => Some(echo(gateways)),
        _ => None,
    }
}
