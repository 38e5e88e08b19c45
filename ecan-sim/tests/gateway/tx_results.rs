//! TX_RESULT packets (manual 10): one per CAN_FRAME of each new image, in frame order, with the
//! result of the service that parsed it.

use super::fixture::{Fixture, MS, chunks, fd, standard};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig, NodeMode, TxOverflow};
use ecan_protocol::image::{HeaderFlags, OptionFlags, PdoProfile, ResultCode, Schedule};
use ecan_sim::ErrorState;

fn with_results() -> PdoProfile {
    PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(16) }
}

#[test]
fn sent_frames_report_ok_and_waiting_ones_queued() {
    let mut fixture = Fixture::op(with_results(), chunks(16));
    fixture.push_ids(0, 0..6);
    fixture.push(1, standard(6, &[]));
    fixture.cycle();
    // the default budget hands four frames of a channel over per service
    use ResultCode::{Ok, Queued};
    assert_eq!(fixture.result_codes(), [Ok, Ok, Ok, Ok, Queued, Queued, Ok]);
    for (index, result) in fixture.results().iter().enumerate() {
        assert_eq!(usize::from(result.frame_index), index);
        assert_eq!(result.sequence, 1);
        assert_eq!(result.channel, u8::from(index == 6));
    }
    assert!(fixture.input().header().flags.contains(HeaderFlags::TX_RESULT_PRESENT));
    fixture.cycle();
    assert_eq!(fixture.result_codes(), [], "a frame gets one result");
    assert_eq!(fixture.sent(0).len(), 6);
}

#[test]
fn no_results_without_the_option() {
    let mut fixture = Fixture::op(chunks(16), chunks(16));
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    assert_eq!(fixture.result_codes(), []);
}

#[test]
fn invalid_channel_for_a_channel_that_cannot_send() {
    let mut fixture = Fixture::preop();
    fixture.apply_profiles(with_results(), chunks(16));
    fixture.apply_channel(0, McanChannelConfig::classic(500_000));
    let listen = McanChannelConfig { node_mode: NodeMode::Listen, ..McanChannelConfig::default() };
    fixture.apply_channel(1, listen);
    fixture.start();
    fixture.push(0, fd(1, &[1]));
    fixture.push(0, standard(2, &[1]));
    fixture.push(1, standard(3, &[1]));
    fixture.push(2, standard(4, &[1]));
    fixture.cycle();
    use ResultCode::{InvalidChannel, Ok};
    assert_eq!(fixture.result_codes(), [InvalidChannel, Ok, InvalidChannel, InvalidChannel]);
    assert_eq!(fixture.upload(0x8011, 14), 0, "no fault of the image");
    assert_eq!(fixture.gateway.counters().transmit_losses.invalid_channel, 3);
}

#[test]
fn bus_off() {
    let mut fixture = Fixture::op(with_results(), chunks(16));
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::BusOff, 256, 0);
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    assert_eq!(fixture.result_codes(), [ResultCode::BusOff]);
}

#[test]
fn full_ring_by_overflow_policy() {
    // the ring holds 64 before the service sends any
    for (tx_overflow, first_lost) in [(TxOverflow::DropNewest, 64), (TxOverflow::DropOldest, 0)] {
        let mut fixture = Fixture::configured(with_results(), chunks(16));
        fixture.apply_data_path(0, DataPathConfig { tx_overflow, ..DataPathConfig::default() });
        fixture.start();
        fixture.push_ids(0, 0..70);
        fixture.cycle();
        let mut results = fixture.results();
        assert_eq!(results.len(), 70, "{tx_overflow:?}");
        results.retain(|result| result.code == ResultCode::TxFifoFull);
        assert_eq!(
            (results.len(), results[0].frame_index),
            (70 - 64, first_lost),
            "{tx_overflow:?}"
        );
    }
}

#[test]
fn scheduled_frames_report_queued_and_late_ones_nothing() {
    // Late frames come from images close to a pulse.
    let sync0_window = ecan_sim::Sync0Window::OFF;
    let config = ecan_sim::GatewayModelConfig { sync0_window, ..Default::default() };
    let mut fixture = Fixture::configured_with(config, with_results(), chunks(16));
    let start = fixture.start_with_sync0(0);
    // 10 us before a pulse: the service runs 20 us after it
    fixture.now = start + 5 * MS - 10_000;
    for offset_ns in [10_000, 100_000] {
        let frame = standard(offset_ns as u16 & 0x7FF, &[]);
        fixture.push_scheduled(0, frame, Schedule { tag: 0, offset_ns });
    }
    fixture.cycle();
    let result = fixture.results()[0];
    assert_eq!(
        (fixture.results().len(), result.frame_index, result.code),
        (1, 1, ResultCode::Queued)
    );
    assert_eq!(fixture.gateway.counters().transmit_losses.late, 1);
}

#[test]
fn results_without_space_follow_in_the_next_image() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(1) };
    let mut fixture = Fixture::op(tx, chunks(16));
    fixture.push_ids(0, 0..40);
    fixture.cycle();
    let mut seen: Vec<_> = fixture.results().iter().map(|result| result.frame_index).collect();
    while seen.len() < 40 {
        fixture.cycle();
        let more: Vec<_> = fixture.results().iter().map(|result| result.frame_index).collect();
        assert!(!more.is_empty());
        seen.extend(more);
    }
    assert_eq!(seen, (0..40).collect::<Vec<u8>>());
}
