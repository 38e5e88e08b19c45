//! TX_RESULT packets (manual 10): one per CAN_FRAME of each new image, in frame order, with
//! the code for what became of the frame in the service that parsed it.

mod gateway_support;

use ecan_protocol::config::{DataPathConfig, McanChannelConfig, NodeMode, TxOverflow};
use ecan_protocol::image::{OptionFlags, PdoProfile, ResultCode, Schedule};
use ecan_sim::ErrorState;
use gateway_support::{Fixture, MS, chunks, fd, standard};

fn with_results() -> PdoProfile {
    PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(16) }
}

fn codes(bench: &Fixture) -> Vec<ResultCode> {
    bench.results().iter().map(|result| result.code).collect()
}

#[test]
fn ok_for_what_reached_the_controller_and_queued_for_what_waits_in_the_ring() {
    let mut bench = Fixture::op(with_results(), chunks(16));
    for id in 0..6 {
        bench.push(0, standard(id, &[]));
    }
    bench.push(1, standard(6, &[]));
    bench.cycle();
    // the default budget hands four frames of a channel over per service
    use ResultCode::{Ok, Queued};
    assert_eq!(codes(&bench), [Ok, Ok, Ok, Ok, Queued, Queued, Ok]);
    for (index, result) in bench.results().iter().enumerate() {
        assert_eq!(usize::from(result.frame_index), index);
        assert_eq!(result.sequence, 1);
        assert_eq!(result.channel, u8::from(index == 6));
    }
    assert!(
        bench.input().header().flags.contains(ecan_protocol::image::HeaderFlags::TX_RESULT_PRESENT)
    );
    bench.cycle();
    assert_eq!(codes(&bench), [], "a frame gets one result");
    assert_eq!(bench.sent(0).len(), 6);
}

#[test]
fn without_the_option_there_are_none() {
    let mut bench = Fixture::op(chunks(16), chunks(16));
    bench.push(0, standard(1, &[]));
    bench.cycle();
    assert_eq!(codes(&bench), []);
}

#[test]
fn invalid_channel_for_a_channel_that_cannot_send() {
    let mut bench = Fixture::preop();
    bench.apply_profiles(with_results(), chunks(16));
    bench.apply_channel(0, McanChannelConfig::classic(500_000));
    let listen = McanChannelConfig { node_mode: NodeMode::Listen, ..McanChannelConfig::default() };
    bench.apply_channel(1, listen);
    bench.start();
    bench.push(0, fd(1, &[1]));
    bench.push(0, standard(2, &[1]));
    bench.push(1, standard(3, &[1]));
    bench.push(2, standard(4, &[1]));
    bench.cycle();
    use ResultCode::{InvalidChannel, Ok};
    assert_eq!(codes(&bench), [InvalidChannel, Ok, InvalidChannel, InvalidChannel]);
    assert_eq!(bench.upload(0x8011, 14), 0, "no fault of the image");
    assert_eq!(bench.gateway.counters().transmit_losses.invalid_channel, 3);
}

#[test]
fn bus_off() {
    let mut bench = Fixture::op(with_results(), chunks(16));
    bench.gateway.bus_state(bench.now, 0, ErrorState::BusOff, 256, 0);
    bench.push(0, standard(1, &[]));
    bench.cycle();
    assert_eq!(codes(&bench), [ResultCode::BusOff]);
}

#[test]
fn full_ring_by_overflow_policy() {
    // 64 fit the ring, before the service takes any out
    for (tx_overflow, refused, lost) in [
        (TxOverflow::DropNewest, 70 - 64, ResultCode::TxFifoFull),
        (TxOverflow::DropOldest, 70 - 64, ResultCode::TxFifoFull),
    ] {
        let mut bench = Fixture::configured(with_results(), chunks(16));
        bench.apply_data_path(0, DataPathConfig { tx_overflow, ..DataPathConfig::default() });
        bench.start();
        for id in 0..70 {
            bench.push(0, standard(id, &[]));
        }
        bench.cycle();
        let full: Vec<_> = bench.results().iter().filter(|r| r.code == lost).copied().collect();
        assert_eq!(full.len(), refused);
        let first_lost = if tx_overflow == TxOverflow::DropOldest { 0 } else { 64 };
        assert_eq!(full[0].frame_index, first_lost);
        assert_eq!(bench.results().len(), 70);
    }
}

#[test]
fn scheduled_frames_are_queued_late_ones_busy() {
    let mut bench = Fixture::configured(with_results(), chunks(16));
    let start = bench.start_sync0();
    bench.pass(MS);
    bench.start();
    // 10 us before a pulse: the service comes 20 us behind it
    bench.now = start + 5 * MS - 10_000;
    for offset_ns in [10_000, 100_000] {
        let frame = standard(offset_ns as u16 & 0x7FF, &[]);
        bench
            .writer
            .push_scheduled(&mut bench.image, 0, 0, frame.as_ref(), Schedule { tag: 0, offset_ns })
            .unwrap();
    }
    bench.cycle();
    assert_eq!(codes(&bench), [ResultCode::BusBusy, ResultCode::Queued]);
}

#[test]
fn results_that_do_not_fit_follow_in_the_next_image() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(1) };
    let mut bench = Fixture::op(tx, chunks(16));
    for id in 0..40 {
        bench.push(0, standard(id, &[]));
    }
    bench.cycle();
    let mut seen: Vec<_> = bench.results().iter().map(|result| result.frame_index).collect();
    while seen.len() < 40 {
        bench.cycle();
        let more: Vec<_> = bench.results().iter().map(|result| result.frame_index).collect();
        assert!(!more.is_empty());
        seen.extend(more);
    }
    assert_eq!(seen, (0..40).collect::<Vec<u8>>());
}
