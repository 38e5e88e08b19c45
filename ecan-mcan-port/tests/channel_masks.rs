//! Channel masks per direction (manual 3, 13.2): channels that only receive or only send.

use std::path::Path;
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, frame, frames_of, id};
use ecan_host::{AdapterConfig, StartupStep};
use ecan_mcan_port::{
    FrameRate, FrameStream, GatewayConfig, PortConfig, PortConfigFault, PortPlan, PortPlanError,
    PortWarning, SendError, SettingWarning,
};
use ecan_protocol::config::NonMatch;
use ecan_protocol::image::{OptionFlags, ProfileError, Schedule};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::{ObjectType, SdoWrite};
use ecan_sim::Scenario;

/// Channels 0 and 1 of one gateway on the same bus.
fn joined() -> Scenario {
    let text = "[[gateway]]\nbuses = [\"0\", \"0\", \"2\", \"3\"]\n";
    Scenario::from_toml(text, "joined", Path::new(".")).unwrap_or_else(|error| panic!("{error}"))
}

fn adapter() -> AdapterConfig {
    AdapterConfig::new(1).with_cycle(Duration::from_millis(1)).with_multiplier(4)
}

fn gateway(tx_pdo: u8, rx_pdo: u8) -> GatewayConfig {
    let both = GatewayConfig::on_channel(0, classic()).with_channel(1, classic());
    both.with_channel_masks(tx_pdo, rx_pdo)
}

fn fixture(gateway: GatewayConfig) -> Fixture {
    Fixture::ready(joined(), adapter(), PortConfig::uniform(1, gateway))
}

#[test]
fn channel_outside_the_rx_mask_only_receives() {
    let mut fixture = fixture(gateway(0b11, 0b01));
    fixture.cycle(|cycle| {
        let rejected = cycle.send_can(0, 1, id(0x11), &[1]);
        assert_eq!(rejected, Err(SendError::ReceiveOnly { slave: 0, channel: 1 }));
        assert!(!rejected.unwrap_err().is_temporary());
        cycle.send_can(0, 0, id(0x22), &[2]).unwrap();
    });
    let received = frames_of(&fixture.idle(6));
    let seen: Vec<_> = received.iter().map(|frame| (frame.channel, frame.frame)).collect();
    assert_eq!(seen, [(1, frame(0x22, &[2]))]);
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!(statistics.channels.map(|channel| channel.frames_accepted), [1, 0, 0, 0]);
}

#[test]
fn channel_outside_the_tx_mask_only_sends() {
    let mut fixture = fixture(gateway(0b10, 0b11));
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(0x11), &[1]).unwrap();
        cycle.send_can(0, 1, id(0x22), &[2]).unwrap();
    });
    let received = frames_of(&fixture.idle(6));
    let seen: Vec<_> = received.iter().map(|frame| (frame.channel, frame.frame)).collect();
    assert_eq!(seen, [(1, frame(0x11, &[1]))], "what channel 1 sent reaches channel 0 only");
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).parse_errors, 0);
}

#[test]
fn each_image_and_profile_has_the_mask_of_its_direction() {
    let fixture = fixture(gateway(0b10, 0b01));
    let adapter = fixture.port.adapter();
    assert_eq!((adapter.tx_pdo(0)[12], adapter.rx_pdo(0)[12]), (0b10, 0b01));
    // The gateway is ready because its active profile words are these.
    let config = fixture.port.config();
    let steps = config.startup_plan(adapter.config()).steps(adapter.config(), 0);
    for (index, mask) in [(0x8010, 0b10), (0x8011, 0b01)] {
        assert!(steps.contains(&StartupStep::Download(SdoWrite::new(
            index,
            4,
            ObjectType::U8,
            mask
        ))));
        assert!(steps.contains(&StartupStep::expect(index, 12, 3 | mask << 5)));
    }
}

#[test]
fn scheduled_frame_for_a_receiving_channel_is_rejected_by_its_mask() {
    let mut fixture = fixture(gateway(0b11, 0b01));
    let at = Schedule { tag: 1, offset_ns: 100_000 };
    fixture.cycle(|cycle| {
        let rejected = cycle.schedule_can(0, 1, id(0x11), &[], at);
        assert_eq!(rejected, Err(SendError::ReceiveOnly { slave: 0, channel: 1 }));
    });
}

#[test]
fn unscheduled_frames_of_a_sending_channel_are_delivered() {
    let mut config = gateway(0b01, 0b11);
    config.tx_options = OptionFlags::TX_RESULT;
    let mut fixture = fixture(config);
    for _ in 0..20 {
        fixture.cycle(|cycle| {
            cycle.send_can(0, 1, id(0x22), &[2]).unwrap();
        });
    }
    fixture.idle(100);
    let channel = fixture.port.statistics(fixture.port.gw(0)).channels[1];
    assert_eq!((channel.frames_accepted, channel.frames_pending), (20, 0), "{channel:?}");
    assert_eq!((channel.frames_delivered, channel.frames_unknown), (20, 0), "{channel:?}");
    assert_eq!((channel.results_ok, channel.results_failed), (0, 0), "{channel:?}");
    assert_eq!(fixture.simulation.with_world(|world| world.counters(0).unwrap()).results_lost, 20);
}

fn faults(gateway: GatewayConfig) -> Vec<PortConfigFault> {
    match PortConfig::uniform(1, gateway).check(&adapter()) {
        Ok(()) => Vec::new(),
        Err(faults) => faults.0,
    }
}

#[test]
fn masks_that_do_not_match_the_channels_are_faults() {
    assert_eq!(faults(gateway(0b10, 0b01)), []);
    let beyond = |direction, mask| PortConfigFault::MaskBeyondChannels {
        slave: 0,
        direction,
        mask,
        enabled: 0b11,
    };
    assert_eq!(faults(gateway(0b0111, 0b11)), [beyond(Direction::TxPdo, 0b0111)]);
    assert_eq!(faults(gateway(0b11, 0b1001)), [beyond(Direction::RxPdo, 0b1001)]);
    assert_eq!(
        faults(gateway(0b01, 0b01)),
        [PortConfigFault::ChannelInNoMask { slave: 0, channel: 1 }]
    );
    let fault = ProfileError::ChannelMask(0);
    assert_eq!(
        faults(gateway(0b11, 0)),
        [PortConfigFault::Profile { slave: 0, direction: Direction::RxPdo, fault }]
    );
}

#[test]
fn plan_rejects_frames_to_a_receiving_channel_and_warns_of_those_from_a_sending_one() {
    let port = PortConfig::uniform(1, gateway(0b01, 0b10));
    let data = frame(0x11, &[0; 8]);
    let rate = FrameRate::PerCycle(2);
    let traffic = [
        FrameStream::to_bus(0, 0, data, rate),
        FrameStream::from_bus(0, 0, data, rate),
        FrameStream::to_bus(0, 1, data, rate),
        FrameStream::from_bus(0, 1, data, rate),
    ];
    let plan = PortPlan::of(&adapter(), &port, &traffic);
    assert_eq!(plan.rejections, [PortPlanError::ReceiveOnly { slave: 0, channel: 0 }]);
    assert_eq!(plan.warnings, [PortWarning::SendOnly { slave: 0, channel: 1 }]);
    let images = &plan.gateways[0];
    assert_eq!((images.tx.mean.packets, images.rx.mean.packets), (2.0, 2.0));
    assert!((plan.channels[0].load.most - plan.channels[1].load.most).abs() < 1e-9);
}

#[test]
fn settings_of_an_unused_direction_cause_no_warning() {
    let warnings = |config: GatewayConfig| -> Vec<_> {
        PortPlan::of(&adapter(), &PortConfig::uniform(1, config), &[]).warnings
    };
    let mut config = gateway(0b01, 0b11);
    for channel in config.channels.iter_mut().flatten() {
        channel.can.non_match_standard = NonMatch::Reject;
        channel.can.non_match_extended = NonMatch::Reject;
    }
    let nothing = SettingWarning::NothingReceived { slave: 0, channel: 0 };
    assert_eq!(warnings(config), [PortWarning::Setting(nothing)]);
    let mut config = gateway(0b01, 0b11);
    config.tx_options = OptionFlags::TX_RESULT;
    let results = SettingWarning::ResultsOfSendOnly { slave: 0, channel: 1 };
    assert_eq!(warnings(config), [PortWarning::Setting(results)]);
}
