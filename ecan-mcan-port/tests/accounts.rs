//! Accounts of frames and images over faults, compared with the records of the simulated gateway.

use std::path::Path;
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_host::{AdapterConfig, Delivery};
use ecan_mcan_port::{
    ChannelStatistics, GatewayConfig, ImageReport, Port, PortConfig, Session, SlaveStatistics,
};
use ecan_protocol::image::OptionFlags;
use ecan_sim::variant::{Choice, toml, variants};
use ecan_sim::{
    EcrtVersion, Fault, GatewayCounters, GatewayFault, LibraryCall, LossDirection, MasterBehaviour,
    Scenario,
};
use proptest::prelude::*;

const AL_ERROR: Fault =
    Fault::Gateway { gateway: 0, fault: GatewayFault::AlError { code: 0x001A } };

fn open(scenario: Scenario, multiplier: u8, has_results: bool) -> Fixture {
    let mut gateway = GatewayConfig::on_channel(0, classic());
    if has_results {
        gateway.tx_options = OptionFlags::TX_RESULT;
    }
    let adapter =
        AdapterConfig::new(1).with_multiplier(multiplier).with_cycle(Duration::from_millis(1));
    Fixture::ready(scenario, adapter, PortConfig::uniform(1, gateway))
}

fn statistics(fixture: &Fixture) -> SlaveStatistics {
    fixture.port.statistics(fixture.port.gw(0))
}

fn channel(fixture: &Fixture) -> ChannelStatistics {
    statistics(fixture).channels[0]
}

fn counters(fixture: &Fixture) -> GatewayCounters {
    fixture.simulation.with_world(|world| world.counters(0).unwrap())
}

/// Checks the transmit columns, also against the frames that the gateway parsed.
fn check_transmit(channel: &ChannelStatistics, parsed: u64) {
    let ChannelStatistics { frames_delivered, frames_unknown, frames_pending, .. } = *channel;
    let never_taken = channel.frames_lost + channel.frames_discarded;
    let sum = frames_delivered + frames_unknown + frames_pending + never_taken;
    assert_eq!(channel.frames_accepted, sum, "{channel:?}");
    assert!(frames_delivered <= parsed, "{parsed} parsed: {channel:?}");
    assert!(parsed <= frames_delivered + frames_unknown + frames_pending, "{parsed}: {channel:?}");
}

/// Sends one frame per cycle while the gateway is ready; returns the number of cycles until it is
/// not, at most `limit`.
fn send_until_lost(fixture: &mut Fixture, limit: usize) -> Option<usize> {
    (0..limit).find(|_| {
        fixture.cycle(|cycle| {
            let _ = cycle.send_can(0, 0, id(0x100), &[1]);
        });
        !fixture.port.is_ready()
    })
}

fn outward_loss(cycles: u32) -> Fault {
    Fault::LostFrame { direction: LossDirection::Outward, cycles }
}

/// A gateway that has sent frames for 300 cycles and is lost by this fault, with the number of cycles
/// from the fault to the loss.
fn lost_by(fault: Fault, has_results: bool) -> (Fixture, usize) {
    let mut fixture = open(ecan_sim::echo(1), 3, has_results);
    assert_eq!(send_until_lost(&mut fixture, 300), None);
    assert!(channel(&fixture).frames_delivered > 280);
    fixture.simulation.inject(fault);
    let cycles = send_until_lost(&mut fixture, 500).expect("lost");
    (fixture, cycles)
}

/// A gateway with 50 sent frames, whose AL status cannot be read for 200 ms.
fn sent_without_al_status(has_results: bool) -> Fixture {
    let mut fixture = open(ecan_sim::echo(1), 3, has_results);
    fixture.simulation.inject(Fault::RequestsHeld { for_ms: 200 });
    fixture.idle(20);
    assert_eq!(send_until_lost(&mut fixture, 50), None);
    fixture
}

fn pending_and_delivered(fixture: &Fixture) -> (u64, u64) {
    let ChannelStatistics { frames_pending, frames_delivered, .. } = channel(fixture);
    (frames_pending, frames_delivered)
}

/// Link losses and power cycles in a row at different times of the reads of the AL status, with frames
/// in flight. Returns the gateway when it is ready again, and its number of accepted frames.
fn return_from_losses(keeps_lost_requests: bool) -> Fixture {
    let mut scenario = ecan_sim::echo(1);
    scenario.master = MasterBehaviour { keeps_lost_requests, ..MasterBehaviour::IGH };
    let mut fixture = open(scenario, 3, false);
    for loss in 0..16u32 {
        assert_eq!(send_until_lost(&mut fixture, 40 + loss as usize), None);
        fixture.simulation.inject(match loss % 4 {
            3 => Fault::PowerCycle { gateway: 0, off_ms: 20 * loss },
            _ => Fault::LinkLoss { gateway: 0, for_ms: 30 + 7 * loss },
        });
        send_until_lost(&mut fixture, 500).expect("lost");
        assert!(fixture.until(60_000, Port::is_ready).is_some(), "loss {loss}");
        check_transmit(&channel(&fixture), counters(&fixture).frames_parsed);
    }
    fixture
}

#[test]
fn frames_over_link_losses_are_accounted_for() {
    let mut fixture = return_from_losses(false);
    let before = channel(&fixture);
    assert_eq!(send_until_lost(&mut fixture, 100), None);
    fixture.idle(30);
    let after = channel(&fixture);
    assert_eq!(after.frames_pending, 0, "{after:?}");
    assert_eq!(after.frames_delivered, before.frames_delivered + before.frames_pending + 100);
    check_transmit(&after, counters(&fixture).frames_parsed);
}

#[test]
fn frames_without_readable_al_status_become_unknown() {
    let mut fixture = return_from_losses(true);
    let before = channel(&fixture);
    assert_eq!(send_until_lost(&mut fixture, 100), None);
    assert_eq!(channel(&fixture).frames_pending, before.frames_pending + 100);
    // Twice the limit, because an image expires with those that the limit began with.
    fixture.idle(2 * 10_000);
    let after = channel(&fixture);
    assert_eq!(after.frames_pending, 0, "{after:?}");
    assert_eq!(after.frames_unknown, before.frames_unknown + before.frames_pending + 100);
    check_transmit(&after, counters(&fixture).frames_parsed);
    assert!(fixture.port.is_ready());
}

#[test]
fn frames_taken_outside_op_are_unknown() {
    for has_results in [false, true] {
        let (mut fixture, cycles) = lost_by(AL_ERROR, has_results);
        assert!(cycles < 25, "noticed after {cycles} ms");
        let channel = channel(&fixture);
        check_transmit(&channel, counters(&fixture).frames_parsed);
        assert!(channel.frames_unknown > 0 && channel.frames_pending == 0, "{channel:?}");
        assert!(fixture.until(10_000, Port::is_ready).is_some());
        assert_eq!(statistics(&fixture).sessions_lost, 1, "not ready in SAFEOP in between");
    }
}

#[test]
fn delivered_frames_are_pending_until_op_is_proven() {
    let mut fixture = sent_without_al_status(false);
    assert_eq!(pending_and_delivered(&fixture), (50, 0));
    fixture.idle(250);
    assert_eq!(pending_and_delivered(&fixture), (0, 50));
}

/// Only every fourth image is confirmed, in step with the interval of the reads.
#[test]
fn delivery_to_a_slow_gateway_is_proven() {
    let text = "[[gateway]]\n[gateway.variant]\nservice_period_us = 1000\n\
                [[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";
    let scenario = Scenario::from_toml(text, "slow", Path::new(".")).unwrap();
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_micros(250));
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(scenario, adapter, config);
    send_until_lost(&mut fixture, 100);
    fixture.idle(2_000);
    let (pending, delivered) = pending_and_delivered(&fixture);
    assert!(pending == 0 && delivered > 20, "{pending} pending, {delivered} delivered");
}

#[test]
fn transmit_results_prove_the_delivery() {
    let mut fixture = sent_without_al_status(true);
    fixture.idle(5);
    assert_eq!(pending_and_delivered(&fixture), (0, 50));
}

/// A working counter of 0 does not show whether the image was taken.
#[test]
fn frames_for_a_stalled_gateway_are_unknown_or_discarded() {
    let mut fixture = open(ecan_sim::echo(1), 3, false);
    let stall = GatewayFault::ServiceStall { ms: 100 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: stall });
    send_until_lost(&mut fixture, 200).expect("lost");
    let (channel, parsed) = (channel(&fixture), counters(&fixture).frames_parsed);
    check_transmit(&channel, parsed);
    assert!(channel.frames_unknown > 0 && channel.frames_discarded > 0, "{channel:?}");
}

#[test]
fn loss_during_the_verification_is_no_lost_session() {
    let mut fixture = open(ecan_sim::echo(1), 3, false);
    fixture.simulation.inject(outward_loss(20));
    assert!(send_until_lost(&mut fixture, 50).is_some());
    for _ in 0..3 {
        let is_verifying = |port: &Port| port.session(port.gw(0)) == Session::Verifying;
        assert!(fixture.until(5_000, is_verifying).is_some());
        fixture.simulation.inject(outward_loss(20));
        assert!(fixture.until(50, |port| !is_verifying(port)).is_some());
    }
    assert!(fixture.until(5_000, Port::is_ready).is_some());
    let statistics = statistics(&fixture);
    assert_eq!((statistics.sessions, statistics.sessions_lost), (2, 1));
}

/// The gateway becomes ready in a cycle without an answer, so that the memory holds an old image.
#[test]
fn old_image_is_not_new_when_the_gateway_becomes_ready() {
    let ready_after = |lost_at: Option<usize>| {
        let mut fixture = open(ecan_sim::echo(1), 3, false);
        fixture.simulation.inject(outward_loss(20));
        assert!(send_until_lost(&mut fixture, 50).is_some());
        for cycle in 0..5_000 {
            if lost_at == Some(cycle) {
                fixture.simulation.inject(outward_loss(1));
            }
            fixture.cycle(|_| ());
            if fixture.port.is_ready() {
                return (cycle, fixture.port.cycle_report(fixture.port.gw(0)));
            }
        }
        panic!("not ready again");
    };
    let (usual, _) = ready_after(None);
    let mut without_answer = 0;
    for lost_at in usual - 4..usual {
        let (_, report) = ready_after(Some(lost_at));
        if report.domain.inputs == Delivery::Missed {
            without_answer += 1;
            assert_eq!(report.image, ImageReport::Repeated, "lost at {lost_at} of {usual}");
        }
    }
    assert!(without_answer > 0);
}

/// Echoes in images that were lost with the gateway.
#[test]
fn lost_session_shows_in_the_received_images() {
    for fault in [Fault::PowerCycle { gateway: 0, off_ms: 200 }, AL_ERROR] {
        let (mut fixture, _) = lost_by(fault.clone(), false);
        assert!(fixture.until(30_000, Port::is_ready).is_some());
        fixture.idle(50);
        let (statistics, counters) = (statistics(&fixture), counters(&fixture));
        let channel = statistics.channels[0];
        let known = channel.frames_received + channel.frames_not_taken;
        assert!(known <= counters.frames_to_master);
        let missing_images = statistics.txpdo_lost + statistics.txpdo_unknown;
        let missing = counters.frames_to_master - known;
        assert!(missing == 0 || missing_images > 0, "{fault:?}: {missing}, {statistics:?}");
    }
}

#[derive(Debug, Clone)]
struct Case {
    /// What the gateway does differently.
    variants: Vec<Choice>,
    multiplier: u8,
    has_results: bool,
    version: EcrtVersion,
    /// Cycles before each fault, and the fault.
    faults: Vec<(usize, Fault)>,
    /// Of the behaviour of the application.
    seed: u64,
}

fn fault() -> impl Strategy<Value = Fault> {
    let direction = prop_oneof![Just(LossDirection::Outward), Just(LossDirection::Return)];
    let in_gateway = |fault| Fault::Gateway { gateway: 0, fault };
    prop_oneof![
        4 => (direction, 1..30u32)
            .prop_map(|(direction, cycles)| Fault::LostFrame { direction, cycles }),
        // A smaller offset would show a read without the write that took place.
        2 => (1..15u32).prop_map(|cycles| Fault::WorkingCounterOffset { offset: -3, cycles }),
        2 => (1..400u32).prop_map(|off_ms| Fault::PowerCycle { gateway: 0, off_ms }),
        2 => (1..400u32).prop_map(|for_ms| Fault::LinkLoss { gateway: 0, for_ms }),
        3 => Just(AL_ERROR),
        2 => (1..30u32).prop_map(move |ms| in_gateway(GatewayFault::ServiceStall { ms })),
        1 => (1..4u32).prop_map(move |images| in_gateway(GatewayFault::TornTxPdo { images })),
        1 => (1..4u32).prop_map(move |images| in_gateway(GatewayFault::CrcErrorTxPdo { images })),
        2 => (prop::sample::select(&LibraryCall::ALL[..]), 1..4u32)
            .prop_map(|(call, times)| Fault::LibraryError { call, errno: 4, times }),
        1 => (1..300u32).prop_map(|for_ms| Fault::RequestsHeld { for_ms }),
        1 => Just(Fault::BusOff { gateway: 0, channel: 0 }),
    ]
}

/// Up to three alternatives with which the gateway starts.
fn variant_choices() -> impl Strategy<Value = Vec<Choice>> {
    let others = variants().flat_map(|variant| {
        variant.alternatives.iter().skip(1).map(move |alternative| (variant, alternative))
    });
    let starts =
        |(variant, _): &Choice| !matches!(variant.key, "missing_entries" | "assignment_rewritten");
    let others: Vec<Choice> = others.filter(starts).collect();
    prop::collection::vec(prop::sample::select(others), 0..4).prop_map(|mut choices| {
        choices.sort_by_key(|(variant, _)| variant.key);
        choices.dedup_by_key(|(variant, _)| variant.key);
        choices
    })
}

/// One gateway with such a difference, and echo nodes.
fn scenario(variants: &[Choice]) -> Scenario {
    let text = format!("[[gateway]]\n{}", toml(variants));
    let mut scenario = ecan_sim::echo(1);
    let different = Scenario::from_toml(&text, "variants", Path::new("."));
    scenario.gateways = different.unwrap_or_else(|error| panic!("{text}{error}")).gateways;
    scenario
}

fn case() -> impl Strategy<Value = Case> {
    let versions = [EcrtVersion::V1_5, EcrtVersion::V1_6];
    (
        variant_choices(),
        prop::sample::select(vec![1, 3, 8]),
        any::<bool>(),
        prop::sample::select(versions.to_vec()),
        prop::collection::vec((0..400usize, fault()), 1..6),
        any::<u64>(),
    )
        .prop_map(|(variants, multiplier, has_results, version, faults, seed)| Case {
            variants,
            multiplier,
            has_results,
            version,
            faults,
            seed,
        })
}

/// A pseudo-random number below `bound`.
fn draw(random: &mut u64, bound: u64) -> u64 {
    *random =
        random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*random >> 33) % bound
}

fn run(case: &Case) {
    let mut scenario = scenario(&case.variants);
    scenario.version = case.version;
    let mut fixture = open(scenario, case.multiplier, case.has_results);
    fixture.idle(5);
    let (before, recorded_before) = (statistics(&fixture), counters(&fixture));
    let mut random = case.seed;
    let mut cycle = |fixture: &mut Fixture| {
        let frames = draw(&mut random, 6) as u8;
        let mut cycle = fixture.port.next_cycle();
        if draw(&mut random, 10) > 0 {
            cycle.received().for_each(drop);
        } else {
            cycle.received().take(1).for_each(drop);
        }
        for _ in 0..frames {
            let _ = cycle.send_can(0, 0, id(0x100), &[frames; 8]);
        }
        if draw(&mut random, 100) == 0 {
            cycle.discard_pending(cycle.gw(0));
        }
        cycle.finish();
        check_transmit(&channel(fixture), counters(fixture).frames_parsed);
    };
    for (cycles, fault) in &case.faults {
        (0..*cycles).for_each(|_| cycle(&mut fixture));
        fixture.simulation.inject(fault.clone());
    }
    (0..300).for_each(|_| cycle(&mut fixture));
    assert!(fixture.until(60_000, Port::is_ready).is_some(), "{:?}", statistics(&fixture));
    fixture.idle(300);
    let (statistics, counters) = (statistics(&fixture), counters(&fixture));
    let channel = statistics.channels[0];
    check_transmit(&channel, counters.frames_parsed);
    assert_eq!(channel.frames_pending, 0, "{statistics:?}");
    // The receive columns, in images.
    let known = |statistics: &SlaveStatistics| {
        statistics.txpdo_received + statistics.txpdo_lost + statistics.txpdo_discarded
    };
    let known = known(&statistics) - known(&before);
    let unknown = statistics.txpdo_unknown - before.txpdo_unknown;
    let read = counters.images_read - recorded_before.images_read;
    let published = counters.images_published - recorded_before.images_published;
    assert!(known <= published + 1, "{known} of {published}: {statistics:?}");
    assert!(read <= known + unknown + 1, "{read} read, {known} + {unknown}: {statistics:?}");
    // In frames; none was on the bus before.
    let frames = channel.frames_received + channel.frames_not_taken;
    assert!(frames <= counters.frames_to_master, "{frames}: {counters:?}");
    if statistics.txpdo_lost + statistics.txpdo_unknown + statistics.parse_errors == 0 {
        assert_eq!(frames, counters.frames_to_master, "{statistics:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn random_faults_keep_the_sums(case in case()) {
        run(&case);
    }
}
