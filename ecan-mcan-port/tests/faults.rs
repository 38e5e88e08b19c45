//! The fault scenarios of docs/SIMULATION.md; each test carries the number of its row.

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, frame, frames_of, id};
use ecan_host::{AdapterConfig, DcSync, Diagnostics, Error};
use ecan_mcan_port::{
    Backpressure, GatewayConfig, ImageReport, Port, PortConfig, PortError, SendError, Session,
    VerificationFault,
};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ImageFault, PdoError};
use ecan_sim::{EcrtVersion, Fault, GatewayFault, LibraryCall, LossDirection, Topology};

fn on_channel_0() -> GatewayConfig {
    GatewayConfig::on_channel(0, classic())
}

fn bench_with(multiplier: u8, gateway: GatewayConfig) -> Fixture {
    let adapter =
        AdapterConfig::new(1).with_multiplier(multiplier).with_cycle(Duration::from_millis(1));
    Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway))
}

/// Sends one numbered frame per cycle for 60 cycles and strikes after 10; gives the numbers that
/// came back, in order.
fn numbers_around(fixture: &mut Fixture, fault: Fault) -> Vec<u8> {
    let mut next = 0;
    let mut back = Vec::new();
    for cycle in 0..80 {
        if cycle == 10 {
            fixture.simulation.inject(fault.clone());
        }
        let items = fixture.cycle(|cycle| {
            if next < 60 && cycle.send_can(0, 0, id(0x100), &[next]).is_ok() {
                next += 1;
            }
        });
        back.extend(frames_of(&items).iter().map(|f| f.frame.data()[0]));
    }
    assert_eq!(next, 60, "every frame was taken");
    back
}

fn frames_on_bus(fixture: &Fixture) -> u64 {
    fixture.simulation.with_world(|world| world.counters(0).unwrap().frames_on_bus)
}

fn all_numbers() -> Vec<u8> {
    (0..60).collect()
}

#[test]
fn f01_a_frame_lost_on_its_way_out_is_published_again() {
    for multiplier in [3, 8] {
        let mut fixture = bench_with(multiplier, on_channel_0());
        let fault = Fault::LostFrame { direction: LossDirection::Outward, cycles: 1 };
        assert_eq!(numbers_around(&mut fixture, fault), all_numbers(), "N = {multiplier}");
        let statistics = fixture.port.statistics(fixture.port.gw(0));
        assert_eq!(statistics.rxpdo_repeated, 1);
        assert_eq!(statistics.incomplete_cycles, 1);
        assert_eq!(statistics.txpdo_lost, 0);
        assert_eq!(frames_on_bus(&fixture), 60, "no frame twice");
    }
}

#[test]
fn f02_a_lost_reply_loses_its_txpdo_and_sends_nothing_twice() {
    for multiplier in [3, 8] {
        let mut fixture = bench_with(multiplier, on_channel_0());
        let fault = Fault::LostFrame { direction: LossDirection::Return, cycles: 1 };
        let back = numbers_around(&mut fixture, fault);
        assert_eq!(back.len(), 59, "the frame in the lost image is gone: {back:?}");
        assert!(back.is_sorted_by(|a, b| a < b), "order holds: {back:?}");
        let statistics = fixture.port.statistics(fixture.port.gw(0));
        assert_eq!((statistics.txpdo_lost, statistics.rxpdo_repeated), (1, 1));
        assert_eq!(frames_on_bus(&fixture), 60, "the repeat was a no-op");
    }
}

#[test]
fn f03_a_working_counter_that_cannot_be_told_apart_repeats_the_image() {
    // With LWR and LRD a sum of 1 may be either direction.
    let mut fixture = bench_with(8, on_channel_0());
    let fault = Fault::WorkingCounterOffset { offset: -1, cycles: 3 };
    assert_eq!(numbers_around(&mut fixture, fault), all_numbers());
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!(statistics.rxpdo_repeated, 3);
    assert_eq!(frames_on_bus(&fixture), 60);
}

#[test]
fn f04_a_working_counter_that_shows_only_the_read_repeats_the_image() {
    // In one LRW a counter of 1 is the read, a counter of 2 the write.
    let mut fixture = bench_with(3, on_channel_0());
    let fault = Fault::WorkingCounterOffset { offset: -2, cycles: 1 };
    assert_eq!(numbers_around(&mut fixture, fault), all_numbers());
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).rxpdo_repeated, 1);
    let mut fixture = bench_with(3, on_channel_0());
    let fault = Fault::WorkingCounterOffset { offset: -1, cycles: 1 };
    assert_eq!(numbers_around(&mut fixture, fault), all_numbers());
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!((statistics.rxpdo_repeated, statistics.incomplete_cycles), (0, 1));
}

#[test]
fn f05_a_short_outage_is_held_and_nothing_is_lost() {
    let mut fixture = bench_with(3, on_channel_0());
    let fault = Fault::LostFrame { direction: LossDirection::Outward, cycles: 8 };
    assert_eq!(numbers_around(&mut fixture, fault), all_numbers());
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!((statistics.rxpdo_repeated, statistics.sessions_lost), (8, 0));
}

#[test]
fn f06_frames_sent_while_an_image_is_held_can_be_discarded() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 5 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(1), &[]).unwrap();
    });
    fixture.cycle(|cycle| {
        assert!(cycle.cycle_report(cycle.gw(0)).is_unconfirmed);
        cycle.send_can(0, 0, id(2), &[]).unwrap();
        assert_eq!(cycle.discard_pending(cycle.gw(0)), 2);
        assert!(!cycle.cycle_report(cycle.gw(0)).is_unconfirmed);
        cycle.send_can(0, 0, id(3), &[]).unwrap();
    });
    let back: Vec<_> = frames_of(&fixture.idle(20)).iter().map(|f| f.frame.id().raw()).collect();
    assert_eq!(back, [3]);
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    let channel = &statistics.channels[0];
    assert_eq!((channel.frames_unknown, channel.frames_discarded), (1, 1), "published, or not");
    assert_eq!(statistics.rxpdo_discarded, 2, "their images");
}

#[test]
fn input_limit_counts_cycles_without_an_image() {
    for (input_limit, is_lost) in [(19, true), (20, false), (0, false)] {
        let gateway = GatewayConfig { hold_limit: 1000, input_limit, ..on_channel_0() };
        let mut fixture = bench_with(3, gateway);
        let fault = Fault::LostFrame { direction: LossDirection::Return, cycles: 20 };
        fixture.simulation.inject(fault);
        fixture.idle(40);
        let lost = fixture.port.statistics(fixture.port.gw(0)).sessions_lost;
        assert_eq!(lost > 0, is_lost, "limit {input_limit}");
    }
}

#[test]
fn f07_a_long_outage_ends_the_session_and_the_gateway_is_verified_anew() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 40 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(1), &[]).unwrap();
    });
    let lost = fixture.until(30, |port| port.session(port.gw(0)) == Session::Waiting);
    assert_eq!(lost, Some(11), "hold limit 10");
    fixture.cycle(|cycle| {
        let rejected = cycle.send_can(0, 0, id(2), &[]);
        assert_eq!(rejected, Err(SendError::NotReady { slave: 0 }));
    });
    assert_eq!(fixture.port.cycle_report(fixture.port.gw(0)).image, ImageReport::None, "not ready");
    assert!(fixture.until(1000, Port::is_ready).is_some());
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!((statistics.sessions, statistics.sessions_lost), (2, 1));
    let channel = statistics.channels[0];
    assert_eq!((channel.frames_unknown, channel.frames_delivered), (1, 0));
    assert_eq!(fixture.carry(0, &[frame(3, &[])], 20).len(), 1);
    assert_eq!(frames_on_bus(&fixture), 1, "the discarded frame stayed off the bus");
}

#[test]
fn f08_a_power_cycled_gateway_comes_back_configured_and_verified() {
    let mut fixture = bench_with(8, on_channel_0());
    assert_eq!(fixture.carry(0, &[frame(1, &[1])], 20).len(), 1);
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 500 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(2), &[2]).unwrap();
    });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    let cycles = fixture.until(30_000, Port::is_ready).expect("ready again");
    assert!(cycles > 500, "after {cycles} cycles of 1 ms");
    let read = |index, subindex| {
        move |diagnostics: &Diagnostics| diagnostics.sdo_upload_u32(0, index, subindex).unwrap()
    };
    assert_eq!(fixture.port.diagnose(read(0x8011, 9)).unwrap(), 1024);
    assert_eq!(fixture.port.diagnose(read(0x8001, 19)).unwrap(), 1_000_000);
    let frames: Vec<CanFrame> = (3..40).map(|n| frame(n, &[9])).collect();
    let back: Vec<_> = fixture.carry(0, &frames, 100).iter().map(|f| f.frame).collect();
    assert_eq!(back, frames, "the stale frame 2 must not appear");
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).sessions, 2);
}

#[test]
fn f09_one_gateway_of_two_fails_and_the_other_goes_on() {
    let mut scenario = ecan_sim::echo(2);
    scenario.topology = Topology::Star;
    // Aliases keep the configurations in place when positions move up.
    scenario.gateways[0].alias = 100;
    scenario.gateways[1].alias = 200;
    let mut adapter = AdapterConfig::new(2).with_cycle(Duration::from_millis(1));
    for (slave, alias) in [(0, 100), (1, 200)] {
        adapter.slaves[slave].alias = alias;
        adapter.slaves[slave].position = 0;
    }
    let mut fixture = Fixture::ready(scenario, adapter, PortConfig::uniform(2, on_channel_0()));
    fixture.simulation.inject(Fault::PowerOff { gateway: 0 });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    let mut back = 0;
    for n in 0..5000u16 {
        let items = fixture.cycle(|cycle| {
            let sent = cycle.send_can(1, 0, id(n % 0x700), &[]);
            assert!(sent.is_ok(), "cycle {n}: {sent:?}");
        });
        back += frames_of(&items).len();
    }
    assert!(back > 4990, "{back}");
    assert_eq!(fixture.port.session(fixture.port.gw(1)), Session::Ready);
}

#[test]
fn f10_an_open_cable_is_survived_like_a_power_cycle() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 2_000 });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    assert!(fixture.until(30_000, Port::is_ready).is_some());
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 20).len(), 1);
}

#[test]
fn f11_a_rejected_startup_sdo_is_named_with_its_abort_code() {
    let mut scenario = ecan_sim::echo(1);
    let abort = GatewayFault::SdoAbort { index: 0x8001, subindex: 19, code: 0x0609_0030, times: 9 };
    scenario.faults.push(ecan_sim::ScriptedFault {
        when: ecan_sim::When::At(0),
        fault: Fault::Gateway { gateway: 0, fault: abort },
    });
    let config = PortConfig::uniform(1, on_channel_0());
    let mut fixture = Fixture::open(scenario, AdapterConfig::new(1), config).unwrap();
    let text = fixture.port.wait_ready().expect_err("rejected").to_string();
    for part in ["SDO download", "0x8001:19", "slave 0", "0x06090030"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn f12_a_startup_sdo_rejected_after_a_power_cycle_is_named_in_the_report() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    let abort = GatewayFault::SdoAbort { index: 0x8011, subindex: 3, code: 0x0800_0022, times: 9 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: abort });
    fixture.idle(3000);
    let error = fixture.port.wait_ready().expect_err("stuck in PREOP");
    let PortError::Adapter(Error::NotOperational(report)) = &error else { panic!("{error}") };
    assert_eq!(report.slaves[0].al_state, Some(2), "{error}");
    let text = error.to_string();
    for part in ["slave 0", "PREOP", "0x8011:03", "0x08000022"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn f13_a_torn_image_is_skipped_and_counted() {
    let mut fixture = bench_with(3, on_channel_0());
    let torn = Fault::Gateway { gateway: 0, fault: GatewayFault::TornTxPdo { images: 1 } };
    let back = numbers_around(&mut fixture, torn);
    assert!(back.len() >= 59 && back.is_sorted_by(|a, b| a < b), "{back:?}");
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert_eq!((statistics.txpdo_torn, statistics.parse_errors), (1, 0));
    let fault = fixture.port.last_diagnosis(fixture.port.gw(0)).map(|diagnosis| diagnosis.fault);
    assert_eq!(fault, Some(ImageFault::Updating));
}

#[test]
fn f14_a_damaged_image_is_rejected_and_diagnosed() {
    let mut fixture = bench_with(3, on_channel_0());
    let damaged = GatewayFault::CrcErrorTxPdo { images: 1 };
    let back = numbers_around(&mut fixture, Fault::Gateway { gateway: 0, fault: damaged });
    assert!(back.len() >= 59 && back.is_sorted_by(|a, b| a < b), "{back:?}");
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).parse_errors, 1);
    let diagnosis = fixture.port.last_diagnosis(fixture.port.gw(0)).expect("diagnosis");
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadCrc));
    assert_ne!(diagnosis.payload_crc16, diagnosis.computed_crc16);
}

#[test]
fn f15_bus_off_shows_in_the_status_and_recovers_by_itself() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
    let seen = fixture.until(10, |port| port.channel_status(port.ch(0, 0)).bus_off());
    assert!(seen.is_some(), "bus-off is reported");
    fixture.cycle(|cycle| {
        let what = Backpressure::BusOff;
        let rejected = cycle.send_can(0, 0, id(7), &[]);
        assert_eq!(rejected, Err(SendError::Backpressure { slave: 0, channel: 0, what }));
    });
    let losses = fixture.simulation.with_world(|world| world.counters(0).unwrap().transmit_losses);
    assert_eq!(losses.bus_off, 0, "nothing was thrown away");
    let recovered = fixture.until(500, |port| !port.channel_status(port.ch(0, 0)).bus_off());
    assert!(recovered.is_some(), "automatic recovery is the default (manual 13.2.2)");
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 50).len(), 1);
}

#[test]
fn f16_without_a_partner_on_the_bus_the_queue_fills_and_the_host_is_held_back() {
    let mut scenario = ecan_sim::echo(1);
    scenario.nodes.clear();
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::ready(scenario, adapter, PortConfig::uniform(1, on_channel_0()));
    let (mut taken, mut rejected) = (0, None);
    for _ in 0..300 {
        fixture.cycle(|cycle| match cycle.send_can(0, 0, id(1), &[]) {
            Ok(_) => taken += 1,
            Err(error) => rejected = Some(error),
        });
    }
    let what = Backpressure::Queue;
    assert_eq!(rejected, Some(SendError::Backpressure { slave: 0, channel: 0, what }));
    let status = fixture.port.channel_status(fixture.port.ch(0, 0));
    assert!(status.warn() && status.tx_pressure(), "{status:?}");
    let losses = fixture.simulation.with_world(|world| world.counters(0).unwrap().transmit_losses);
    assert_eq!((losses.ring_full, losses.stale), (0, 0), "{taken} taken, none dropped");
}

#[test]
fn f16_pacing_holds_whatever_threshold_the_gateway_has() {
    for tx_pressure_percent in [30, 75, 100] {
        let mut scenario = ecan_sim::echo(1);
        scenario.gateways[0].config.tx_pressure_percent = tx_pressure_percent;
        let adapter =
            AdapterConfig::new(1).with_multiplier(11).with_cycle(Duration::from_millis(1));
        let slow = ecan_mcan_port::ChannelConfig::classic(125_000);
        let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, slow));
        let mut fixture = Fixture::ready(scenario, adapter, config);
        let frames: Vec<_> = (0..500u16).map(|n| frame(n, &n.to_le_bytes())).collect();
        let back: Vec<_> = fixture.carry(0, &frames, 5_000).iter().map(|f| f.frame).collect();
        assert_eq!(back, frames, "{tx_pressure_percent} %");
    }
}

#[test]
fn f17_disturbed_transmissions_are_repeated_by_the_controller() {
    let mut fixture = bench_with(3, on_channel_0());
    let fault = Fault::ErrorFrames { gateway: 0, channel: 0, frames: 5 };
    assert_eq!(numbers_around(&mut fixture, fault), all_numbers());
}

#[test]
fn f18_an_al_error_in_op_is_recovered_by_the_master_and_verified() {
    let mut fixture = bench_with(3, on_channel_0());
    let error = GatewayFault::AlError { code: 0x001B };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: error });
    // In SAFEOP the working counter stays complete; only the master's state tells.
    assert!(fixture.until(5_000, |port| port.session(port.gw(0)) != Session::Ready).is_some());
    assert!(fixture.until(30_000, Port::is_ready).is_some());
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 20).len(), 1);
}

#[test]
fn f19_a_silent_mailbox_delays_verification_and_is_named() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 15 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(1), &[]).unwrap();
    });
    fixture.idle(12);
    let silent = GatewayFault::MailboxSilent { ms: 4_000 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: silent });
    let failed = |port: &Port| {
        matches!(port.session(port.gw(0)), Session::Failed(VerificationFault::Transfer { .. }))
    };
    assert!(fixture.until(4_000, failed).is_some(), "{}", fixture.port.session(fixture.port.gw(0)));
    assert!(
        fixture.until(10_000, Port::is_ready).is_some(),
        "{}",
        fixture.port.session(fixture.port.gw(0))
    );
    assert!(fixture.port.statistics(fixture.port.gw(0)).verification_failures > 0);
}

#[test]
fn f20_a_standing_firmware_rejects_images_and_catches_up() {
    let mut fixture = bench_with(3, on_channel_0());
    let stall = Fault::Gateway { gateway: 0, fault: GatewayFault::ServiceStall { ms: 5 } };
    assert_eq!(numbers_around(&mut fixture, stall), all_numbers());
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert!(statistics.rxpdo_repeated >= 3, "{statistics:?}");
    assert_eq!(frames_on_bus(&fixture), 60);
}

#[test]
fn f21_a_host_that_pauses_is_caught_by_the_watchdog_and_comes_back() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.pass_ns(1_000_000_000);
    assert!(fixture.until(500, |port| port.session(port.gw(0)) != Session::Ready).is_some());
    assert!(fixture.until(30_000, Port::is_ready).is_some());
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 20).len(), 1);
}

#[test]
fn f22_a_master_held_by_another_program_is_said_to_be() {
    let mut scenario = ecan_sim::echo(1);
    scenario.reserved = true;
    let config = PortConfig::uniform(1, on_channel_0());
    let error = Fixture::open(scenario, AdapterConfig::new(1), config).err().expect("rejected");
    assert!(error.to_string().contains("another"), "{error}");
}

#[test]
fn f23_a_missing_gateway_is_named_with_its_place() {
    let mut adapter = AdapterConfig::new(2);
    adapter.preop_timeout = Duration::from_millis(500);
    let config = PortConfig::uniform(2, on_channel_0());
    let error = Fixture::open(ecan_sim::echo(1), adapter, config).err().expect("rejected");
    let text = error.to_string();
    assert!(text.contains("position 1") && text.contains("1 slave(s) found"), "{text}");
}

#[test]
fn f24_a_profile_changed_behind_the_back_is_found_at_the_next_verification() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    // The gateway comes back, but its readback is another one than configured.
    let reached_op = |port: &Port| port.session(port.gw(0)) == Session::Verifying;
    assert!(fixture.until(30_000, reached_op).is_some());
    fixture.simulation.with_world(|world| {
        world.with_gateway(0, |gateway, now| {
            let _ = gateway.sdo_download(now, 0x8010, 7, &[0xE0]);
            let _ = gateway.sdo_download(now, 0x8010, 1, &[1]);
        })
    });
    let failed = |port: &Port| matches!(port.session(port.gw(0)), Session::Failed(_));
    assert!(fixture.until(2_000, failed).is_some(), "{}", fixture.port.session(fixture.port.gw(0)));
    let text = fixture.port.session(fixture.port.gw(0)).to_string();
    assert!(text.contains("0x8010:02"), "{text}");
}

#[test]
fn cycle_report_names_what_the_image_was() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.idle(3);
    let report = fixture.port.cycle_report(fixture.port.gw(0));
    let new = ImageReport::New { lost: 0, is_incomplete: false, layout_changed: false };
    assert_eq!(report.image, new);
    assert!(report.domain.is_complete());
    assert_eq!(report.frames, [0; 4]);
    assert!(report.ready_since > 0 && report.ready_since < report.cycle);
    fixture.idle(1);
    let next = fixture.port.cycle_report(fixture.port.gw(0));
    assert_eq!((next.cycle, next.ready_since), (report.cycle + 1, report.ready_since));
    assert!(fixture.port.wait_ready().is_ok(), "already ready");
}

#[test]
fn f25_another_gateway_in_the_place_of_a_lost_one_is_not_taken_for_it() {
    let mut scenario = ecan_sim::echo(2);
    scenario.topology = Topology::Star;
    let adapter = AdapterConfig::new(2).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::ready(scenario, adapter, PortConfig::uniform(2, on_channel_0()));
    fixture.simulation.inject(Fault::PowerOff { gateway: 0 });
    fixture.idle(6_000);
    // The positions have moved up: the master gives the first configuration to the second gateway,
    // and configures it so once it has left OP.
    let error = GatewayFault::AlError { code: 0x001B };
    fixture.simulation.inject(Fault::Gateway { gateway: 1, fault: error });
    fixture.idle(20_000);
    // It is verified again every second.
    let fault = fixture.port.last_verification_fault(fixture.port.gw(0));
    assert!(matches!(fault, Some(VerificationFault::OtherGateway { .. })), "{fault:?}");
    fixture.cycle(|cycle| {
        let rejected = cycle.send_can(0, 0, id(0x77), &[]);
        assert_eq!(rejected, Err(SendError::NotReady { slave: 0 }));
    });
}

#[test]
fn f26_a_busy_bus_does_not_keep_a_gateway_out_of_service() {
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    (adapter.slaves[0].rx_multiplier, adapter.slaves[0].tx_multiplier) = (8, 1);
    let gateway = GatewayConfig::on_all_channels(classic());
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway));
    // More comes back than images of 104 bytes carry: 0x8010:02 then shows 8 (manual 13.2).
    for _ in 0..20 {
        fixture.cycle(|cycle| {
            for channel in 0..4 {
                for n in 0..6 {
                    let _ = cycle.send_can(0, channel, id(n), &[0; 8]);
                }
            }
        });
    }
    assert!(fixture.port.statistics(fixture.port.gw(0)).txpdo_incomplete > 0);
    let status = |diagnostics: &Diagnostics| diagnostics.sdo_upload_u32(0, 0x8010, 2).unwrap();
    assert_eq!(fixture.port.diagnose(status).unwrap(), 8);
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 30 });
    fixture.cycle(|cycle| {
        let _ = cycle.send_can(0, 0, id(1), &[]);
    });
    assert!(fixture.until(40, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    assert!(
        fixture.until(2_000, Port::is_ready).is_some(),
        "{}",
        fixture.port.session(fixture.port.gw(0))
    );
}

#[test]
fn f27_a_loss_in_the_middle_of_a_verification_starts_it_from_the_beginning() {
    for cycles in 1..45 {
        let mut fixture = bench_with(3, on_channel_0());
        fixture
            .simulation
            .inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 15 });
        fixture.cycle(|cycle| {
            cycle.send_can(0, 0, id(1), &[]).unwrap();
        });
        let verifying = |port: &Port| port.session(port.gw(0)) == Session::Verifying;
        assert!(fixture.until(100, verifying).is_some());
        fixture.idle(cycles);
        fixture
            .simulation
            .inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 15 });
        assert!(fixture.until(2_000, |port| port.statistics(port.gw(0)).sessions == 2).is_some());
        assert_eq!(fixture.carry(0, &[frame(3, &[])], 20).len(), 1, "lost after {cycles}");
        assert_eq!(fixture.port.statistics(fixture.port.gw(0)).verification_failures, 0);
    }
}

#[test]
fn f28_a_gateway_that_sends_no_images_is_not_left_in_service() {
    let mut fixture = bench_with(3, on_channel_0());
    let stall = GatewayFault::ServiceStall { ms: 60_000 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: stall });
    assert!(fixture.until(300, |port| port.session(port.gw(0)) != Session::Ready).is_some());
}

#[test]
fn calls_out_of_order_lose_nothing() {
    let mut fixture = bench_with(3, on_channel_0());
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 1 });
    assert!(fixture.port.open_cycle().is_none());
    let mut cycle = fixture.port.next_cycle();
    cycle.send_can(0, 0, id(1), &[]).unwrap();
    cycle.keep_open();
    drop(fixture.port.open_cycle());
    let mut cycle = fixture.port.begin_cycle();
    cycle.send_can(0, 0, id(2), &[]).unwrap();
    assert_eq!(cycle.finish().error(), None);
    fixture.port.wait_next_cycle();
    fixture.port.repeat_images().unwrap();
    let back: Vec<_> = frames_of(&fixture.idle(10)).iter().map(|f| f.frame.id().raw()).collect();
    assert_eq!(back, [1, 2]);
}

#[test]
fn f29_an_interrupted_call_of_the_library_loses_and_repeats_nothing() {
    // In 1.5 the calls return nothing.
    let versions = [EcrtVersion::V1_5, EcrtVersion::V1_6];
    for (call, version) in
        LibraryCall::ALL.into_iter().flat_map(|call| versions.map(|version| (call, version)))
    {
        for multiplier in [3, 8] {
            let mut scenario = ecan_sim::echo(1);
            scenario.version = version;
            let adapter = AdapterConfig::new(1)
                .with_multiplier(multiplier)
                .with_cycle(Duration::from_millis(1));
            let config = PortConfig::uniform(1, on_channel_0());
            let mut fixture = Fixture::ready(scenario, adapter, config);
            let fault = Fault::LibraryError { call, errno: 4, times: 1 };
            let back = numbers_around(&mut fixture, fault);
            let case = format!("{call:?}, {version:?}, N = {multiplier}");
            assert!(back.len() >= 59 && back.is_sorted_by(|a, b| a < b), "{case}: {back:?}");
            assert_eq!(frames_on_bus(&fixture), 60, "{case}: every frame once");
            assert_eq!(fixture.cycle_errors.len(), 1, "{case}");
            assert_eq!(fixture.port.session(fixture.port.gw(0)), Session::Ready, "{case}");
        }
    }
}

#[test]
fn f30_with_distributed_clocks_a_power_cycle_is_survived_too() {
    // While the bus is scanned there is no reference clock, and the calls that need one fail.
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(300)));
    let config = PortConfig::uniform(1, on_channel_0());
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 500 });
    assert!(fixture.until(200, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    assert!(
        fixture.until(60_000, Port::is_ready).is_some(),
        "{}",
        fixture.port.session(fixture.port.gw(0))
    );
    assert_eq!(fixture.cycle_errors, []);
    assert_eq!(fixture.carry(0, &[frame(1, &[])], 20).len(), 1);
}
