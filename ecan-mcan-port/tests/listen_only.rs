//! Channels that must only listen: the registers of the controller decide, not the number of the node mode
//! (assumption H9).
#![allow(missing_docs)]

use std::path::Path;
use std::time::Duration;

mod common;

use common::{Fixture, classic};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, PortConfig, PortError, VerificationFault};
use ecan_protocol::config::NodeMode;
use ecan_protocol::device::ControllerMode;
use ecan_sim::{Fault, GatewayFault, Scenario, StationMode};

/// A gateway whose channels 0 and 2 listen, and channel 1 takes part.
fn open(table: &str) -> Fixture {
    let text = format!("[[gateway]]\n{table}");
    let scenario = Scenario::from_toml(&text, "listening", Path::new(".")).unwrap();
    let mut listening = classic();
    listening.can.node_mode = NodeMode::Listen;
    let channels = [Some(listening), Some(classic()), Some(listening), None];
    let gateway = GatewayConfig { channels, ..GatewayConfig::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    Fixture::open(scenario, adapter, PortConfig::uniform(1, gateway)).unwrap()
}

fn modes(fixture: &Fixture) -> [Option<StationMode>; 4] {
    fixture.simulation.with_world(|world| {
        let gateway = world.gateway(0).unwrap();
        [0, 1, 2, 3].map(|channel| gateway.station_config(channel).map(|station| station.mode))
    })
}

#[test]
fn listening_channels_are_verified() {
    let mut fixture = open("");
    fixture.port.wait_ready().unwrap();
    let (listen, normal) = (Some(StationMode::Listen), Some(StationMode::Normal));
    assert_eq!(modes(&fixture), [listen, normal, listen, None]);
}

#[test]
fn channel_in_another_mode_is_a_fault_and_leaves_its_bus() {
    let mut fixture = open("[gateway.variant]\nnode_modes = \"loopback_first\"\n");
    let error = fixture.port.wait_ready().unwrap_err();
    let PortError::NotReady { last_fault: Some(fault), .. } = &error else { panic!("{error}") };
    let mode = ControllerMode::InternalLoopback;
    assert_eq!(*fault, VerificationFault::NodeMode { channel: 0, mode });
    let message = error.to_string();
    let words =
        "node mode 1 puts channel 0 into internal loopback, not into listen-only (assumption H9";
    assert!(message.contains(words) && !error.is_temporary(), "{message}");
    assert_eq!(modes(&fixture), [None, Some(StationMode::Normal), None, None]);
}

#[test]
fn missing_register_service_is_no_fault() {
    let mut fixture = open("");
    for (index, subindex) in [(0xA000, 1), (0xA002, 3)] {
        let fault = GatewayFault::SdoAbort { index, subindex, code: 0x0602_0000, times: 1000 };
        fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    }
    fixture.port.wait_ready().unwrap();
    assert!(fixture.port.is_ready());
}
