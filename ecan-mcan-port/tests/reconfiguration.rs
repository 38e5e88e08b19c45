//! Switching N and channels at run time (manual 14.2).

use std::time::Duration;

use crate::common::{Fixture, Handles, classic, frame};
use ecan_host::{AdapterConfig, Diagnostics, Phase};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, PendingStep, PortConfig, PortError};
use ecan_sim::{Fault, LossDirection};

fn adapter(multiplier: u8) -> AdapterConfig {
    AdapterConfig::new(1).with_multiplier(multiplier).with_cycle(Duration::from_millis(1))
}

#[test]
fn n_goes_up_and_down_and_frames_flow_after_each_switch() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    for multiplier in [8, 1, 11, 3] {
        fixture.port.reconfigure((adapter(multiplier), config)).unwrap();
        assert_eq!(fixture.port.adapter().phase(), Phase::Configured);
        fixture.port.wait_ready().unwrap();
        let read = |diagnostics: &Diagnostics| {
            [0x8010, 0x8011].map(|object| diagnostics.sdo_upload_u32(0, object, 9).unwrap())
        };
        let bytes = u32::from(multiplier) * 128;
        assert_eq!(fixture.port.diagnose(read).unwrap(), [bytes; 2]);
        let frames: Vec<_> = (0..30).map(|n| frame(n, &[multiplier])).collect();
        let back: Vec<_> = fixture.carry(0, &frames, 100).iter().map(|f| f.frame).collect();
        assert_eq!(back, frames, "N = {multiplier}");
    }
}

#[test]
fn other_channels_and_bit_rates_can_be_chosen() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    let fd = ChannelConfig::fd(500_000, 4_000_000);
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(3, fd));
    fixture.port.reconfigure((adapter(8), config)).unwrap();
    fixture.port.wait_ready().unwrap();
    let frames = [frame(7, &[1, 2, 3])];
    let back = fixture.carry(3, &frames, 50);
    assert_eq!((back[0].channel, back[0].frame), (3, frames[0]));
}

#[test]
fn faulty_configuration_leaves_everything_running() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    let rejected = fixture.port.reconfigure((adapter(12), config));
    assert!(matches!(rejected, Err(PortError::Config(_))), "{rejected:?}");
    let frames = [frame(1, &[])];
    assert_eq!(fixture.carry(0, &frames, 50).len(), 1);
}

#[test]
fn after_a_failed_switch_the_old_configuration_can_be_taken_up_again() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    let mut elsewhere = adapter(3);
    elsewhere.slaves[0].position = 5;
    elsewhere.preop_timeout = Duration::from_millis(200);
    let failed = fixture.port.reconfigure((elsewhere, config));
    assert!(failed.unwrap_err().to_string().contains("position 5"));
    assert_eq!(fixture.port.adapter().phase(), Phase::Down);
    fixture.port.reconfigure((adapter(3), config)).unwrap();
    fixture.port.wait_ready().unwrap();
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 50).len(), 1);
}

#[test]
fn configuration_in_force_can_be_changed_and_given_back() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    let larger = (*fixture.port.adapter().config()).with_multiplier(8);
    fixture.port.reconfigure((larger, config)).unwrap();
    fixture.port.wait_ready().unwrap();
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 50).len(), 1);
}

#[test]
fn limits_change_without_a_reconfiguration() {
    let mut gateway = GatewayConfig::on_channel(0, classic());
    let config = PortConfig::uniform(1, gateway);
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    let outage = || Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 };
    fixture.simulation.inject(outage());
    fixture.idle(20);
    assert!(fixture.port.is_ready());
    gateway.hold_limit = 3;
    gateway.channels[0] = Some(ChannelConfig::classic(125_000));
    fixture.port.set_limits(&PortConfig::uniform(1, gateway));
    let active = fixture.port.config().gateways[0];
    assert_eq!((active.hold_limit, active.channels[0]), (3, Some(classic())));
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 50).len(), 1);
    fixture.simulation.inject(outage());
    assert!(fixture.until(20, |port| !port.is_ready()).is_some());
}

#[test]
fn another_master_is_rejected_and_nothing_changes() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    let mut elsewhere = adapter(3);
    elsewhere.master_index = 3;
    let rejected = fixture.port.reconfigure((elsewhere, config)).unwrap_err();
    assert!(rejected.to_string().contains("master 3"), "{rejected}");
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 50).len(), 1);
}

/// Cycles without a `wait_ready` do not activate the master.
#[test]
fn gateway_waits_for_op_until_the_master_is_activated() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
    fixture.port.reconfigure((adapter(3), config)).unwrap();
    fixture.idle(10_000);
    let waiting_for = fixture.port.waiting_for(fixture.port.gw(0));
    assert_eq!(waiting_for, Some(PendingStep::Operational));
}
