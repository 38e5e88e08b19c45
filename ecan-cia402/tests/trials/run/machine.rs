//! The simulated machine of a plan.

use std::time::Duration;

use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{ChannelConfig, Config, GatewayConfig, PortConfig};
use ecan_sim::{DriveSpec, NodeKind, Scenario};

use crate::plan::Plan;
use crate::variants;

fn alias(slave: usize) -> u16 {
    100 + slave as u16
}

pub fn config(plan: &Plan) -> Config {
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let mut adapter =
        AdapterConfig::new(plan.gateways as u16).with_cycle(Duration::from_nanos(plan.cycle_ns));
    if plan.clock.is_some() {
        let cycle = Duration::from_nanos(plan.cycle_ns);
        adapter.dc = Some(DcSync::new(cycle, Duration::from_micros(700)));
    }
    if plan.has_aliases {
        for (n, slave) in adapter.slaves.iter_mut().enumerate() {
            (slave.alias, slave.position) = (alias(n), 0);
        }
    }
    (adapter, PortConfig::uniform(plan.gateways, gateway)).into()
}

pub fn scenario(plan: &Plan) -> Scenario {
    let mut scenario = ecan_sim::drives(plan.gateways, 5);
    scenario.seed = plan.seed;
    scenario.topology = plan.topology;
    let configs = variants::gateway_configs(&plan.variants, plan.gateways);
    for (gateway, config) in scenario.gateways.iter_mut().zip(configs) {
        gateway.config = config;
    }
    if plan.has_aliases {
        for (n, gateway) in scenario.gateways.iter_mut().enumerate() {
            gateway.alias = alias(n);
        }
    }
    let names: Vec<String> = plan.axes.iter().map(|axis| axis.node_name()).collect();
    scenario.nodes.retain_mut(|node| {
        let Some(n) = names.iter().position(|name| *name == node.name) else { return false };
        let mut config = plan.axes[n].drive.clone();
        config.trace = TRACE;
        node.kind = NodeKind::Drive(Box::new(DriveSpec { config, eds: None }));
        true
    });
    scenario
}

/// Records of a drive between two looks at its trace; a restart of the application takes some seconds.
const TRACE: usize = 40_000;
