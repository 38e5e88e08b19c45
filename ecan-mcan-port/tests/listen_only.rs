//! Channels that must only listen: the registers of the controller decide, not the number of the node mode
//! (assumption H9).

use std::path::Path;
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_host::{AdapterConfig, CanController};
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, PortError, VerificationFault};
use ecan_protocol::config::NodeMode;
use ecan_protocol::device::{CCCR, CCCR_INIT as INIT, ControllerMode};
use ecan_sim::{Fault, GatewayFault, Scenario, StationMode};

/// CCCR.CCE: the mode can be changed.
const CCE: u32 = 1 << 1;
/// CCCR.MON: bus monitoring.
const MON: u32 = 1 << 5;

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
    assert!(!message.contains("waits for"), "{message}");
    assert_eq!(modes(&fixture), [None, Some(StationMode::Normal), None, None]);
}

fn abort(fixture: &Fixture, index: u16, subindex: u8, times: u32) {
    let fault = GatewayFault::SdoAbort { index, subindex, code: 0x0602_0000, times };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
}

#[test]
fn failed_transfer_does_not_end_the_verification() {
    let mut fixture = open("[gateway.variant]\nnode_modes = \"loopback_first\"\n");
    abort(&fixture, 0xA000, 1, 1);
    abort(&fixture, 0xA002, 1, 1);
    let error = fixture.port.wait_ready().unwrap_err();
    let PortError::NotReady { last_fault, .. } = error else { panic!("{error}") };
    let mode = ControllerMode::InternalLoopback;
    assert_eq!(last_fault, Some(VerificationFault::NodeMode { channel: 0, mode }));
    assert_eq!(modes(&fixture), [None, Some(StationMode::Normal), None, None]);
}

#[test]
fn channel_that_listens_stays_on_its_bus() {
    let mut fixture = open("");
    fixture.port.wait_ready().unwrap();
    let written = fixture.port.diagnose(|diagnostics| {
        let controller = CanController::new(diagnostics, 0, 0);
        let cccr = controller.read(CCCR)?;
        let normal = cccr & !MON;
        [cccr | INIT, cccr | INIT | CCE, normal | INIT | CCE, normal]
            .into_iter()
            .try_for_each(|value| controller.write(CCCR, value))
    });
    written.unwrap().unwrap();
    let (listen, normal) = (Some(StationMode::Listen), Some(StationMode::Normal));
    assert_eq!(modes(&fixture), [normal, normal, listen, None]);
    assert!(fixture.port.stop_channels_not_listening().is_none());
    // Images that are lost begin another verification, without another startup.
    fixture.simulation.inject(Fault::WorkingCounterOffset { offset: -3, cycles: 100 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 1, id(1), &[]).unwrap();
    });
    let is_found = |port: &Port| port.last_verification_fault(port.gw(0)).is_some();
    assert!(fixture.until(2_000, is_found).is_some());
    let error = fixture.port.stop_channels_not_listening().unwrap().to_string();
    assert!(error.contains("puts channel 0 into normal operation"), "{error}");
    assert_eq!(modes(&fixture), [None, normal, listen, None]);
}

#[test]
fn missing_register_service_is_no_fault() {
    let mut fixture = open("");
    for (index, subindex) in [(0xA000, 1), (0xA002, 3)] {
        abort(&fixture, index, subindex, 1000);
    }
    fixture.port.wait_ready().unwrap();
    assert!(fixture.port.is_ready());
}
