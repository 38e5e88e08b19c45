//! Configuration of a gateway before OP, faults that are found before the bus is touched, and
//! leaving OP.

use std::time::Duration;

use crate::common::{Fixture, classic};
use ecan_host::{AdapterConfig, Clock as _, Diagnostics, Error, Expectation, StartupStep};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, PortConfig, PortConfigFault, PortError};
use ecan_protocol::config::{FilterAction, StandardFilter, StandardMatch};
use ecan_protocol::image::OptionFlags;
use ecan_sim::{MasterBehaviour, Simulation};

/// (index, subindex, value) of the downloads; checks in between are left out.
fn downloads(steps: &[StartupStep]) -> Vec<(u16, u8, u32)> {
    let download = |step: &StartupStep| match step {
        StartupStep::Download(sdo) => Some((sdo.index, sdo.subindex, sdo.value)),
        StartupStep::Expect { .. } => None,
    };
    steps.iter().filter_map(download).collect()
}

#[test]
fn sequence_of_the_manual_is_written() {
    let adapter = AdapterConfig::new(1).with_multiplier(8);
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::fd(1_000_000, 5_000_000));
    let plan = PortConfig::uniform(1, gateway).startup_plan(&adapter);
    let written = downloads(plan.of_slave(0));
    // Manual 5.4.2: both profiles, then both apply commands.
    let profile: Vec<_> = [0x8010, 0x8011]
        .into_iter()
        .flat_map(|object| {
            [(object, 3, 8), (object, 4, 0x0F), (object, 5, 0), (object, 6, 0), (object, 7, 0)]
        })
        .chain([(0x8010, 1, 1), (0x8011, 1, 1)])
        .collect();
    assert_eq!(written[..12], profile);
    // Manual 5.4.3 phase E, for each channel, with the apply command last.
    for channel in 0..4 {
        let object = 0x8001 + channel;
        let of_channel: Vec<_> = written.iter().filter(|w| w.0 == object).collect();
        for expected in
            [(15, 1), (16, 1), (19, 1_000_000), (20, 5_000_000), (62, 48), (65, 7), (72, 7)]
        {
            assert!(of_channel.contains(&&(object, expected.0, expected.1)), "{expected:?}");
        }
        assert_eq!(of_channel.last(), Some(&&(object, 1, 1)));
        // Budgets above the default of 2 and 4 (13.2.2).
        let data_path: Vec<_> = written.iter().filter(|w| w.0 == 0x8021 + channel).collect();
        assert!(data_path.contains(&&(0x8021 + channel, 5, 8)));
        assert!(data_path.contains(&&(0x8021 + channel, 12, 8)));
        assert_eq!(data_path.last(), Some(&&(0x8021 + channel, 2, 1)));
    }
}

#[test]
fn capabilities_are_asked_before_anything_is_written() {
    let adapter = AdapterConfig::new(1).with_multiplier(8);
    let mut gateway = GatewayConfig::on_channel(2, classic());
    gateway.tx_options = OptionFlags::TX_RESULT;
    gateway.rx_options = OptionFlags::ALIGN4;
    let plan = PortConfig::uniform(1, gateway).startup_plan(&adapter);
    let steps = plan.of_slave(0);
    let leading = steps.iter().take_while(|step| !step.is_download()).count();
    let asked = &steps[..leading];
    let expect = |subindex, expected| StartupStep::Expect { index: 0xF000, subindex, expected };
    for step in [
        expect(2, Expectation::AtLeast(3)),
        expect(11, Expectation::AtLeast(8)),
        expect(15, Expectation::HasBits(0x03)),
        expect(17, Expectation::Equals(128)),
    ] {
        assert!(asked.contains(&step), "{step:?} in {asked:?}");
    }
}

#[test]
fn every_fault_of_both_configurations_is_reported_at_once() {
    let mut adapter = AdapterConfig::new(2).with_multiplier(12);
    adapter.cycle = Duration::from_nanos(1);
    let mut impossible = ChannelConfig::classic(1_234_567);
    let filter = StandardFilter {
        matching: StandardMatch::Range,
        action: FilterAction::Fifo0,
        sync: false,
        id1: 0x100,
        id2: 0x1FF,
    };
    impossible.data_path.rx_drain_max = 9;
    let mut gateway = GatewayConfig::on_channel(0, impossible);
    gateway.rx_options = OptionFlags::APP_BYPASS;
    let mut config = PortConfig::from([gateway, GatewayConfig::default()]);
    (0..65).for_each(|_| config.add_filter(0, 0, filter).unwrap());
    let faults = config.check(&adapter).unwrap_err().0;
    let has = |is_expected: &dyn Fn(&PortConfigFault) -> bool| faults.iter().any(is_expected);
    assert!(has(&|f| matches!(f, PortConfigFault::Adapter(_))), "{faults:?}");
    assert!(has(&|f| matches!(f, PortConfigFault::Channel { slave: 0, channel: 0, .. })));
    assert!(has(&|f| matches!(f, PortConfigFault::Filter { slave: 0, channel: 0, .. })));
    assert!(has(&|f| matches!(f, PortConfigFault::DataPath { slave: 0, channel: 0, .. })));
    assert!(has(&|f| matches!(f, PortConfigFault::Bypass { slave: 0, .. })));
    assert!(has(&|f| matches!(f, PortConfigFault::NoChannel { slave: 1 })));
}

#[test]
fn gateway_with_a_bypass_test_is_rejected_unless_allowed() {
    let cut_off = |diagnostics: &Diagnostics| {
        let key = 0x4543_414E_u32.to_le_bytes();
        diagnostics.sdo_download(0, 0x8030, 1, &key).unwrap();
        diagnostics.sdo_download(0, 0x8030, 6, &[3]).unwrap();
    };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut gateway = GatewayConfig::on_channel(0, classic());
    let mut fixture = Fixture::single(gateway);
    fixture.port.diagnose(cut_off).unwrap();
    let config = PortConfig::uniform(1, gateway);
    let rejected = fixture.port.reconfigure((adapter, config)).unwrap_err();
    let PortError::Adapter(Error::Readback { index: 0x8030, subindex: 6, found: 3, .. }) = rejected
    else {
        panic!("{rejected}")
    };
    gateway.allow_diagnostic_tests = true;
    fixture.port.reconfigure((adapter, PortConfig::uniform(1, gateway))).unwrap();
}

/// The frames of a cycle take longer than the master waits for a datagram that it has not received.
#[test]
fn gateways_with_long_frames_become_ready() {
    let adapter = AdapterConfig::new(5).with_multiplier(8).with_cycle(Duration::from_millis(2));
    let wire_ns = ecan_host::Plan::of(&adapter).wire_ns();
    assert!(wire_ns > 750_000, "{wire_ns}");
    let config = PortConfig::uniform(5, GatewayConfig::on_channel(0, classic()));
    let fixture = Fixture::ready(ecan_sim::echo(5), adapter, config);
    assert!(fixture.port.is_ready());
}

/// Gateways like those of `ecrt_like_igh::watchdog_runs_out_when_a_program_ends_in_op`, at the end of the
/// read of an SDO dictionary.
fn ending_on_igh() -> Fixture {
    let mut scenario = ecan_sim::echo(4);
    scenario.master = MasterBehaviour::IGH;
    let adapter = AdapterConfig::new(4).with_cycle(Duration::from_millis(1));
    let config = PortConfig::uniform(4, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(scenario, adapter, config);
    fixture.idle(100);
    fixture
}

#[track_caller]
fn assert_no_watchdog(simulation: &Simulation) {
    simulation.pass_ns(2_000_000_000);
    let log = simulation.kernel_log();
    assert!(!log.iter().any(|line| line.contains("0x001B")), "{log:#?}");
}

#[test]
fn watchdog_does_not_run_out_when_the_port_is_dropped() {
    let fixture = ending_on_igh();
    let simulation = fixture.simulation.clone();
    drop(fixture);
    assert_no_watchdog(&simulation);
}

#[test]
fn watchdog_does_not_run_out_while_the_program_ends() {
    let mut fixture = ending_on_igh();
    let simulation = fixture.simulation.clone();
    fixture.port.begin_cycle().keep_open();
    fixture.port.leave_op();
    // As a program that prints a long summary.
    simulation.pass_ns(2_000_000_000);
    let before = simulation.clock().now_ns();
    drop(fixture);
    assert!(simulation.clock().now_ns() - before < 1_000_000, "nothing to leave");
    assert_no_watchdog(&simulation);
}

#[test]
fn watchdog_does_not_run_out_at_a_reconfiguration() {
    let mut fixture = ending_on_igh();
    let adapter = AdapterConfig::new(4).with_multiplier(2).with_cycle(Duration::from_millis(1));
    let config = PortConfig::uniform(4, GatewayConfig::on_channel(0, classic()));
    fixture.port.reconfigure((adapter, config)).unwrap();
    assert_no_watchdog(&fixture.simulation);
}
