//! TX_RESULT packets (manual 10): one per CAN_FRAME of each new image, in frame order, with the
//! result of the service that parsed it.

use super::fixture::{Fixture, MS, chunks, fd, standard};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig, NodeMode, TxOverflow};
use ecan_protocol::image::{OptionFlags, PdoProfile, ResultCode, Schedule};
use ecan_sim::ErrorState;

fn with_results() -> PdoProfile {
    PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(16) }
}

fn codes(fixture: &Fixture) -> Vec<ResultCode> {
    fixture.results().iter().map(|result| result.code).collect()
}

#[test]
fn sent_frames_report_ok_and_waiting_ones_queued() {
    let mut fixture = Fixture::op(with_results(), chunks(16));
    for id in 0..6 {
        fixture.push(0, standard(id, &[]));
    }
    fixture.push(1, standard(6, &[]));
    fixture.cycle();
    // the default budget hands four frames of a channel over per service
    use ResultCode::{Ok, Queued};
    assert_eq!(codes(&fixture), [Ok, Ok, Ok, Ok, Queued, Queued, Ok]);
    for (index, result) in fixture.results().iter().enumerate() {
        assert_eq!(usize::from(result.frame_index), index);
        assert_eq!(result.sequence, 1);
        assert_eq!(result.channel, u8::from(index == 6));
    }
    assert!(
        fixture
            .input()
            .header()
            .flags
            .contains(ecan_protocol::image::HeaderFlags::TX_RESULT_PRESENT)
    );
    fixture.cycle();
    assert_eq!(codes(&fixture), [], "a frame gets one result");
    assert_eq!(fixture.sent(0).len(), 6);
}

#[test]
fn no_results_without_the_option() {
    let mut fixture = Fixture::op(chunks(16), chunks(16));
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    assert_eq!(codes(&fixture), []);
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
    assert_eq!(codes(&fixture), [InvalidChannel, Ok, InvalidChannel, InvalidChannel]);
    assert_eq!(fixture.upload(0x8011, 14), 0, "no fault of the image");
    assert_eq!(fixture.gateway.counters().transmit_losses.invalid_channel, 3);
}

#[test]
fn bus_off() {
    let mut fixture = Fixture::op(with_results(), chunks(16));
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::BusOff, 256, 0);
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    assert_eq!(codes(&fixture), [ResultCode::BusOff]);
}

#[test]
fn full_ring_by_overflow_policy() {
    // the ring holds 64 before the service sends any
    for (tx_overflow, rejected, lost) in [
        (TxOverflow::DropNewest, 70 - 64, ResultCode::TxFifoFull),
        (TxOverflow::DropOldest, 70 - 64, ResultCode::TxFifoFull),
    ] {
        let mut fixture = Fixture::configured(with_results(), chunks(16));
        fixture.apply_data_path(0, DataPathConfig { tx_overflow, ..DataPathConfig::default() });
        fixture.start();
        for id in 0..70 {
            fixture.push(0, standard(id, &[]));
        }
        fixture.cycle();
        let full: Vec<_> = fixture.results().iter().filter(|r| r.code == lost).copied().collect();
        assert_eq!(full.len(), rejected);
        let first_lost = if tx_overflow == TxOverflow::DropOldest { 0 } else { 64 };
        assert_eq!(full[0].frame_index, first_lost);
        assert_eq!(fixture.results().len(), 70);
    }
}

#[test]
fn scheduled_frames_report_queued_and_late_ones_busy() {
    // Late frames come from images close to a pulse.
    let sync0_window = ecan_sim::Sync0Window::OFF;
    let config = ecan_sim::GatewayModelConfig { sync0_window, ..Default::default() };
    let mut fixture = Fixture::configured_with(config, with_results(), chunks(16));
    let start = fixture.start_sync0();
    fixture.pass(MS);
    fixture.start();
    // 10 us before a pulse: the service runs 20 us after it
    fixture.now = start + 5 * MS - 10_000;
    for offset_ns in [10_000, 100_000] {
        let frame = standard(offset_ns as u16 & 0x7FF, &[]);
        fixture
            .writer
            .push_scheduled(
                &mut fixture.image,
                0,
                0,
                frame.as_ref(),
                Schedule { tag: 0, offset_ns },
            )
            .unwrap();
    }
    fixture.cycle();
    assert_eq!(codes(&fixture), [ResultCode::BusBusy, ResultCode::Queued]);
}

#[test]
fn results_without_space_follow_in_the_next_image() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(1) };
    let mut fixture = Fixture::op(tx, chunks(16));
    for id in 0..40 {
        fixture.push(0, standard(id, &[]));
    }
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
