//! Alternatives for the data path and the CAN side, as the gateway shows them.

use ecan_protocol::config::{
    CacheDepth, CriticalFrames, DataPathConfig, McanChannelConfig, NodeMode, RxBudget, RxOverflow,
};
use ecan_protocol::image::{BudgetPolicy, OptionFlags, PdoError, PdoProfile, ResultCode, Schedule};
use ecan_sim::variant::{
    CriticalSet, GatewayVariant, LateResult, NodeModes, Number, RepeatedImage, RxBudgetPolicy,
    RxDrain, RxPending, ScheduledResults, ServicePeriod, TxPending, TxResults, UnsendableResult,
};
use ecan_sim::{GatewayModelConfig, StationMode, Sync0Window};

use super::fixture::{Fixture, MS, SERVICE, chunks, configured, preop, standard, with_variant};

/// In OP with one chunk per direction.
fn op(variant: GatewayVariant) -> Fixture {
    let mut fixture = configured(variant);
    fixture.start();
    fixture
}

#[test]
fn repeated_image_can_be_error_10() {
    let repeated_image = RepeatedImage::CountedAsError;
    let mut fixture = op(GatewayVariant { repeated_image, ..GatewayVariant::default() });
    fixture.push(0, standard(0x123, &[1]));
    assert!(fixture.write());
    assert!(fixture.write_again());
    assert_eq!(fixture.sent(0).len(), 1);
    let error = u32::from(PdoError::DuplicateSequence.raw());
    assert_eq!((fixture.upload(0x8011, 14), fixture.upload(0x8011, 15)), (error, 1));
}

#[test]
fn node_modes_follow_the_numbers_of_the_variant() {
    use StationMode::{ExternalLoopback, InternalLoopback, Listen};
    for (node_modes, expected) in [
        (NodeModes::Manual, [Listen, InternalLoopback, ExternalLoopback]),
        (NodeModes::LoopbackFirst, [InternalLoopback, ExternalLoopback, Listen]),
    ] {
        let mut fixture = op(GatewayVariant { node_modes, ..GatewayVariant::default() });
        for (number, expected) in (1..).zip(expected) {
            let node_mode = NodeMode::from_raw(number).unwrap();
            let config = McanChannelConfig::classic(500_000);
            fixture.apply_channel(0, McanChannelConfig { node_mode, ..config });
            let station = fixture.gateway.station_config(0).unwrap();
            assert_eq!(station.mode, expected, "{node_modes:?} {number}");
        }
    }
}

fn with_policy(variant: GatewayVariant, policy: DataPathConfig) -> Fixture {
    let mut fixture = Fixture::configured_with(with_variant(variant), chunks(16), chunks(1));
    fixture.apply_data_path(0, policy);
    fixture.start();
    fixture
}

const EMCY: u16 = 0x081;
const SYNC: u16 = 0x080;
const DEGRADED: u8 = 15;

/// Delivers 15 frames and an EMCY between two services; the cache holds eight, and two leave it per service.
fn overload(rx_drain: RxDrain, rx_overflow: RxOverflow) -> (Vec<u32>, u32) {
    let policy = DataPathConfig {
        rx_cache_depth: CacheDepth::D8,
        rx_budget: RxBudget::Limited,
        rx_drain_max: 2,
        rx_overflow,
        degraded_threshold: 4,
        ..DataPathConfig::default()
    };
    let variant = GatewayVariant { rx_drain, ..GatewayVariant::default() };
    let mut fixture = with_policy(variant, policy);
    fixture.deliver_ids(0, (0x10..0x1F).chain([EMCY]));
    let mut ids = Vec::new();
    let mut degraded = 0;
    for _ in 0..9 {
        fixture.cycle();
        let received = fixture.received();
        assert!(received.len() <= 2, "{received:?}");
        ids.extend(received.iter().map(|(_, frame)| frame.id().raw()));
        degraded |= fixture.upload(0x9020, DEGRADED);
    }
    (ids, degraded)
}

const OVERFLOW_POLICIES: [RxOverflow; 4] = [
    RxOverflow::DropOldest,
    RxOverflow::DropNewest,
    RxOverflow::PreserveCritical,
    RxOverflow::Degraded,
];

#[test]
fn overload_stays_in_the_controller_under_every_policy() {
    let all: Vec<_> = (0x10..0x1F).chain([u32::from(EMCY)]).collect();
    for policy in OVERFLOW_POLICIES {
        assert_eq!(overload(RxDrain::Controller, policy), (all.clone(), 0), "{policy:?}");
    }
}

#[test]
fn overload_of_the_cache_is_handled_by_the_policy() {
    let with_emcy = |ids: std::ops::Range<u32>| ids.chain([u32::from(EMCY)]).collect::<Vec<_>>();
    let [oldest, newest, critical, degraded] =
        OVERFLOW_POLICIES.map(|policy| overload(RxDrain::Cache, policy));
    assert_eq!(oldest, (with_emcy(0x18..0x1F), 0));
    assert_eq!(newest, ((0x10..0x18).collect(), 0));
    assert_eq!(critical, (with_emcy(0x11..0x18), 0));
    assert_eq!(degraded, ((0x10..0x18).collect(), 1));
}

/// Delivers eight frames, SYNC and an EMCY; the cache holds eight.
fn preserved(critical_frames: CriticalSet) -> Vec<u32> {
    let policy = DataPathConfig {
        rx_cache_depth: CacheDepth::D8,
        rx_budget: RxBudget::Limited,
        rx_drain_max: 8,
        rx_overflow: RxOverflow::PreserveCritical,
        critical_frames: CriticalFrames::CanopenSafety,
        ..DataPathConfig::default()
    };
    let rx_drain = RxDrain::Cache;
    let variant = GatewayVariant { critical_frames, rx_drain, ..GatewayVariant::default() };
    let mut fixture = with_policy(variant, policy);
    fixture.deliver_ids(0, (0x200..0x208).chain([SYNC, EMCY]));
    fixture.cycle();
    fixture.received_ids()
}

#[test]
fn critical_frames_are_those_of_the_variant() {
    let [sync, emcy] = [SYNC, EMCY].map(u32::from);
    let expected: Vec<_> = (0x201..0x208).chain([emcy]).collect();
    assert_eq!(preserved(CriticalSet::WithoutSync), expected);
    let expected: Vec<_> = (0x202..0x208).chain([sync, emcy]).collect();
    assert_eq!(preserved(CriticalSet::WithSync), expected);
}

#[test]
fn rx_budget_is_applied_or_not() {
    use ResultCode::{Ok, TxFifoFull};
    for (rx_budget, codes, error) in [
        (RxBudgetPolicy::NotApplied, &[Ok, Ok, Ok][..], PdoError::Ok),
        (RxBudgetPolicy::Applied, &[Ok, Ok, TxFifoFull], PdoError::PacketOverrun),
    ] {
        let variant = GatewayVariant { rx_budget, ..GatewayVariant::default() };
        let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(1) };
        let rx = PdoProfile { budget: BudgetPolicy::Deterministic, ..chunks(1) };
        let mut fixture = Fixture::configured_with(with_variant(variant), tx, rx);
        fixture.start();
        // 26 bytes for each of four channels
        for (channel, id) in [(0, 1), (0, 2), (0, 3), (1, 4)] {
            fixture.push(channel, standard(id, &[0; 8]));
        }
        fixture.cycle();
        let results: Vec<_> = fixture
            .results()
            .iter()
            .filter(|result| result.channel == 0)
            .map(|result| result.code)
            .collect();
        assert_eq!(results, codes, "{rx_budget:?}");
        assert_eq!(fixture.sent(1).len(), 1, "{rx_budget:?}");
        assert_eq!(fixture.upload(0x8011, 14), u32::from(error.raw()), "{rx_budget:?}");
        assert_eq!(fixture.upload(0x8011, 15), 0, "{rx_budget:?}");
    }
}

#[test]
fn frame_that_cannot_be_sent_has_a_result_or_none() {
    for (unsendable_result, expected) in [
        (UnsendableResult::InvalidChannel, &[ResultCode::InvalidChannel][..]),
        (UnsendableResult::Absent, &[]),
    ] {
        let variant = GatewayVariant { unsendable_result, ..GatewayVariant::default() };
        let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(1) };
        let mut fixture = preop(variant);
        fixture.apply_profiles(tx, chunks(1));
        fixture.start();
        fixture.push(0, standard(1, &[]));
        fixture.cycle();
        assert_eq!(fixture.result_codes(), expected, "{unsendable_result:?}");
    }
}

#[test]
fn rx_pending_counts_the_frames_of_its_image_or_not() {
    for (rx_pending, expected) in [(RxPending::WithOwnImage, 3), (RxPending::WithoutOwnImage, 1)] {
        let policy = DataPathConfig { rx_drain_max: 2, ..DataPathConfig::default() };
        let variant = GatewayVariant { rx_pending, ..GatewayVariant::default() };
        let mut fixture = with_policy(variant, policy);
        fixture.deliver_ids(0, 0..3);
        fixture.cycle();
        assert_eq!(fixture.received().len(), 2);
        let status = fixture.input().header().channel_status[0];
        assert_eq!(status.rx_pending(), expected, "{rx_pending:?}");
    }
}

#[test]
fn tx_pending_counts_the_running_frame_or_not() {
    for (tx_pending, expected) in [(TxPending::WithRunning, 3), (TxPending::WithoutRunning, 2)] {
        let mut fixture = op(GatewayVariant { tx_pending, ..GatewayVariant::default() });
        fixture.push_ids(0, 0..3);
        fixture.cycle();
        assert!(fixture.gateway.next_transmit(0).is_some());
        assert_eq!(fixture.upload(0x9000, 11), expected, "{tx_pending:?}");
    }
}

/// In OP with TX_RESULT and pulses at every whole millisecond. Late frames come from images close to a
/// pulse, which the firmware does not miss.
fn with_results(variant: GatewayVariant) -> Fixture {
    let sync0_window = Sync0Window::OFF;
    let config = GatewayModelConfig { variant, sync0_window, ..GatewayModelConfig::default() };
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(16) };
    let mut fixture = Fixture::configured_with(config, tx, chunks(16));
    let start = fixture.start_with_sync0(0);
    fixture.now = start + 4 * MS + 300_000;
    fixture
}

fn schedule(fixture: &mut Fixture, id: u16, offset_ns: u32) {
    fixture.push_scheduled(0, standard(id, &[]), Schedule { tag: 0, offset_ns });
}

/// Codes of a frame in the controller, of one that waits, and of a scheduled one that is late.
fn sent_waiting_late(variant: GatewayVariant) -> Vec<ResultCode> {
    let mut fixture = with_results(variant);
    let pulse = fixture.now.next_multiple_of(MS);
    fixture.pass(pulse - SERVICE / 2 - fixture.now);
    fixture.push_ids(0, 0..5);
    schedule(&mut fixture, 5, 0);
    fixture.cycle();
    let mut codes = fixture.result_codes();
    codes.dedup_by(|code, before| code == before && *code == ResultCode::Ok);
    codes
}

#[test]
fn late_frame_has_the_result_of_the_variant() {
    use ResultCode::{BusBusy, Ok, Queued};
    for (late_result, expected) in [
        (LateResult::Absent, &[Ok, Queued][..]),
        (LateResult::Queued, &[Ok, Queued, Queued]),
        (LateResult::BusBusy, &[Ok, Queued, BusBusy]),
    ] {
        let variant = GatewayVariant { late_result, ..GatewayVariant::default() };
        assert_eq!(sent_waiting_late(variant), expected, "{late_result:?}");
    }
}

#[test]
fn tx_results_are_those_of_failures_only() {
    let (tx_results, late_result) = (TxResults::FailuresOnly, LateResult::BusBusy);
    let variant = GatewayVariant { tx_results, late_result, ..GatewayVariant::default() };
    assert_eq!(sent_waiting_late(variant), [ResultCode::BusBusy]);
}

#[test]
fn scheduled_frame_has_one_or_two_results() {
    for (scheduled_results, second) in
        [(ScheduledResults::One, &[][..]), (ScheduledResults::Two, &[ResultCode::Ok])]
    {
        let mut fixture = with_results(GatewayVariant { scheduled_results, ..Default::default() });
        schedule(&mut fixture, 1, 100_000);
        fixture.cycle();
        assert_eq!(fixture.result_codes(), [ResultCode::Queued], "{scheduled_results:?}");
        fixture.cycle();
        assert_eq!(Fixture::identifiers(&fixture.sent(0)), [1]);
        assert_eq!(fixture.result_codes(), second, "{scheduled_results:?}");
    }
}

#[test]
fn schedule_holds_as_many_frames_as_the_variant() {
    for depth in [16, 64, 256] {
        let schedule_depth = Number::nearest(depth);
        let mut fixture = with_results(GatewayVariant { schedule_depth, ..Default::default() });
        for id in 0..80 {
            schedule(&mut fixture, id, 100_000);
        }
        fixture.cycle();
        let accepted = fixture.result_codes().iter().filter(|code| code.is_success()).count();
        assert_eq!(accepted, (depth as usize).min(80), "{depth}");
        assert_eq!(fixture.gateway.counters().frames_scheduled, accepted as u64, "{depth}");
    }
}

#[test]
fn service_follows_the_outputs_or_its_own_period() {
    let after_outputs = ServicePeriod::AFTER_OUTPUTS;
    let free_running = ServicePeriod::free_running(250).unwrap();
    for (service_period_us, at_30_us, without_outputs) in
        [(after_outputs, 1, 0), (free_running, 0, 40)]
    {
        let mut fixture = op(GatewayVariant { service_period_us, ..GatewayVariant::default() });
        fixture.push(0, standard(1, &[]));
        assert!(fixture.write(), "and passes 30 us");
        assert_eq!(fixture.gateway.counters().images_parsed, at_30_us, "{service_period_us:?}");
        fixture.pass(250_000);
        assert_eq!(fixture.gateway.counters().images_parsed, 1, "{service_period_us:?}");
        let before = fixture.gateway.counters().services;
        fixture.pass(10 * MS);
        let services = fixture.gateway.counters().services - before;
        assert_eq!(services, without_outputs, "{service_period_us:?}");
    }
}
