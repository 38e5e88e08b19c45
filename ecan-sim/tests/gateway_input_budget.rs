//! How channels share the frame area of the TxPDO (manual 12): whole packets only, a truncation
//! mark and a count for what has to wait, and nothing lost by it.

mod gateway_support;

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::DataPathConfig;
use ecan_protocol::image::{
    BudgetPolicy, EncapsulationProfile, HeaderFlags, OptionFlags, Packet, PdoProfile, Timestamp,
};
use gateway_support::{Fixture, MS, SERVICE, chunks, fd, standard};

/// In OP with eager drain budgets, so that only the frame area limits.
fn with(tx: PdoProfile) -> Fixture {
    let mut bench = Fixture::configured(tx, chunks(3));
    for channel in 0..4 {
        bench.apply_data_path(channel, DataPathConfig::for_traffic(8, 8));
    }
    bench.start();
    bench
}

fn budget(multiplier: u8, budget: BudgetPolicy) -> PdoProfile {
    PdoProfile { budget, ..chunks(multiplier) }
}

fn per_channel(bench: &Fixture) -> [usize; 4] {
    let mut counts = [0; 4];
    for (channel, _) in bench.received() {
        counts[usize::from(channel)] += 1;
    }
    counts
}

#[test]
fn truncated_image_says_so_and_the_rest_follows_in_order() {
    // 104 bytes: 8 packets of 12
    let mut bench = with(chunks(1));
    for id in 0..8 {
        bench.deliver(0, standard(id, &[0; 8]));
        bench.deliver(1, standard(0x100 + id, &[0; 8]));
    }
    bench.cycle();
    let header = *bench.input().header();
    assert!(header.flags.contains(HeaderFlags::STREAM_TRUNCATED));
    assert!(header.flags.contains(HeaderFlags::OVERFLOW_SAT_VALID));
    assert_eq!(header.frame_count, 8);
    assert_eq!(header.overflow_sat, 8);
    assert_eq!(bench.upload(0x8010, 16), 8);
    assert_eq!(bench.upload(0x8010, 2), 8);
    assert_eq!(bench.upload(0x8010, 14), 3);
    assert_eq!(bench.upload(0x8010, 15), 0, "no packet was wrong");
    let mut frames = bench.received();
    bench.cycle();
    assert!(!bench.input().is_incomplete());
    frames.extend(bench.received());
    for channel in 0..2 {
        let ids: Vec<_> =
            frames.iter().filter(|(c, _)| *c == channel).map(|(_, f)| f.id().raw()).collect();
        let first = u32::from(channel) * 0x100;
        assert_eq!(ids, (first..first + 8).collect::<Vec<_>>());
    }
}

#[test]
fn frames_come_oldest_first_over_all_channels() {
    let mut bench = with(chunks(3));
    for (channel, id) in [(2, 1), (0, 2), (3, 3), (0, 4), (1, 5)] {
        bench.deliver(channel, standard(id, &[]));
        bench.now += 10;
    }
    bench.cycle();
    let ids: Vec<_> = bench.received().iter().map(|(_, frame)| frame.id().raw()).collect();
    assert_eq!(ids, [1, 2, 3, 4, 5]);
}

/// Eight frames wait on channel 0 before one each on the others: 12 bytes a frame.
fn rush(policy: BudgetPolicy, multiplier: u8) -> [usize; 4] {
    let mut bench = with(budget(multiplier, policy));
    for id in 0..8 {
        bench.deliver(0, standard(id, &[0; 8]));
        bench.now += 10;
    }
    for channel in 1..4 {
        bench.deliver(channel, standard(0x100, &[0; 8]));
    }
    bench.cycle();
    per_channel(&bench)
}

#[test]
fn shared_only_lets_the_first_comer_take_all() {
    assert_eq!(rush(BudgetPolicy::SharedOnly, 1), [8, 0, 0, 0]);
}

#[test]
fn balanced_keeps_a_packet_for_everyone() {
    assert_eq!(rush(BudgetPolicy::Balanced, 1), [5, 1, 1, 1]);
}

#[test]
fn deterministic_gives_equal_shares_and_lends_nothing() {
    // 26 bytes a channel
    assert_eq!(rush(BudgetPolicy::Deterministic, 1), [2, 1, 1, 1]);
    let mut bench = with(budget(1, BudgetPolicy::Deterministic));
    for id in 0..8 {
        bench.deliver(0, standard(id, &[0; 8]));
    }
    bench.cycle();
    assert_eq!(per_channel(&bench), [2, 0, 0, 0], "though nobody else has anything");
    let tx = PdoProfile { channel_mask: 0x01, ..budget(1, BudgetPolicy::Deterministic) };
    let mut bench = with(tx);
    for id in 0..8 {
        bench.deliver(0, standard(id, &[0; 8]));
    }
    bench.cycle();
    assert_eq!(per_channel(&bench), [8, 0, 0, 0], "shares are those of the enabled channels");
}

#[test]
fn balanced_lends_reserves_that_nobody_uses() {
    let mut bench = with(budget(1, BudgetPolicy::Balanced));
    bench.deliver(3, fd(1, &[7; 64]));
    bench.cycle();
    assert_eq!(per_channel(&bench), [0, 0, 0, 1]);
    // all four have a frame that no reserve can hold: one an image, none starves
    for channel in 0..4 {
        bench.deliver(channel, fd(1, &[7; 64]));
    }
    let mut seen = [0; 4];
    for _ in 0..4 {
        bench.cycle();
        let counts = per_channel(&bench);
        assert_eq!(counts.iter().sum::<usize>(), 1);
        for (seen, count) in seen.iter_mut().zip(counts) {
            *seen += count;
        }
    }
    assert_eq!(seen, [1; 4]);
}

#[test]
fn frame_that_fits_no_image_is_an_overrun_and_blocks_nobody() {
    let mut bench = with(budget(1, BudgetPolicy::Deterministic));
    bench.deliver(0, fd(1, &[0; 64]));
    bench.deliver(0, standard(2, &[]));
    bench.cycle();
    assert_eq!(bench.received(), [(0, standard(2, &[]))]);
    assert_eq!(bench.upload(0x8010, 14), 2);
    assert_eq!(bench.upload(0x8010, 16), 1);
    assert_eq!(bench.input().header().overflow_sat, 1);
    assert_eq!(bench.gateway.counters().receive_losses.oversized, 1);
}

#[test]
fn overflow_count_saturates() {
    let mut bench = with(chunks(1));
    assert!(bench.write());
    for id in 0..2000 {
        bench.deliver(0, standard(id & 0x7FF, &[]));
    }
    assert!(bench.write());
    assert!(bench.read());
    bench.cycle();
    assert_eq!(bench.input().header().overflow_sat, 255);
}

#[test]
fn image_holds_at_most_255_packets() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(24) };
    let mut bench = Fixture::configured(tx, chunks(24));
    bench.apply_data_path(0, DataPathConfig::for_traffic(8, 8));
    bench.start();
    for id in 0..254 {
        bench.push(0, standard(id, &[]));
    }
    for id in 0..4 {
        bench.deliver(0, standard(id, &[]));
    }
    bench.cycle();
    let header = *bench.input().header();
    assert_eq!(header.frame_count, 255);
    assert!(header.flags.contains(HeaderFlags::STREAM_TRUNCATED));
    bench.cycle();
    assert_eq!(bench.received().len(), 3);
}

#[test]
fn align4_pads_every_packet() {
    let tx = PdoProfile { options: OptionFlags::ALIGN4, ..chunks(3) };
    let mut bench = with(tx);
    let frame = CanFrame::classic(CanId::extended(0x1234_5678).unwrap(), &[1; 8]).unwrap();
    bench.deliver(0, frame);
    bench.deliver(0, standard(1, &[1; 8]));
    bench.cycle();
    assert_eq!(bench.input().header().payload_len, 16 + 12);
    assert_eq!(bench.input[24 + 14..24 + 16], [0, 0]);
    assert_eq!(bench.received(), [(0, frame), (0, standard(1, &[1; 8]))]);
}

#[test]
fn timestamps_are_microseconds_since_the_last_service() {
    for profile in
        [EncapsulationProfile::CompactTimestamped, EncapsulationProfile::Window64Timestamped]
    {
        let mut bench = with(PdoProfile { profile, ..chunks(3) });
        bench.cycle();
        let service = bench.now - MS + SERVICE;
        for us in [100, 350] {
            bench.gateway.received(service + us * 1000, 0, &standard(1, &[]), service);
        }
        bench.cycle();
        let times = bench.packets(|packet| match packet {
            Packet::Frame(frame) => Some(frame.timestamp),
            Packet::TxResult(_) => None,
        });
        assert_eq!(times, [Timestamp::Delta16(100), Timestamp::Delta16(350)]);
    }
}

#[test]
fn profiles_without_timestamps_have_none() {
    for profile in [EncapsulationProfile::Compact, EncapsulationProfile::Window64] {
        let mut bench = with(PdoProfile { profile, ..chunks(3) });
        bench.deliver(0, standard(1, &[]));
        bench.cycle();
        assert_eq!(bench.input().header().payload_len, 4);
    }
}

#[test]
fn window_profiles_put_fd_data_into_64_bytes_and_classic_data_not() {
    let tx = PdoProfile { profile: EncapsulationProfile::Window64, ..chunks(3) };
    let mut bench = with(tx);
    bench.deliver(0, fd(1, &[1, 2, 3]));
    bench.deliver(0, standard(2, &[4, 5]));
    bench.cycle();
    assert_eq!(bench.input().header().payload_len, (4 + 64) + (4 + 2));
    assert_eq!(bench.received(), [(0, fd(1, &[1, 2, 3])), (0, standard(2, &[4, 5]))]);
}

#[test]
fn without_crc_and_payload_only() {
    let tx = PdoProfile { options: OptionFlags::NO_CRC16, ..chunks(3) };
    let mut bench = with(tx);
    bench.deliver(0, standard(1, &[1]));
    bench.cycle();
    let header = *bench.input().header();
    assert_eq!((header.crc_alg, header.payload_crc16), (0, 0));
    assert_eq!(bench.received().len(), 1);

    let tx = PdoProfile { options: OptionFlags::PAYLOAD_ONLY, ..chunks(3) };
    let mut bench = with(tx);
    bench.deliver(0, standard(1, &[0xAB; 8]));
    bench.cycle();
    bench.cycle();
    assert_eq!(bench.received(), []);
    assert_eq!(bench.input[28..36], [0xAB; 8], "stale bytes stay");

    let mut bench = with(chunks(3));
    bench.deliver(0, standard(1, &[0xAB; 8]));
    bench.cycle();
    bench.cycle();
    assert!(bench.input[24..].iter().all(|&byte| byte == 0), "and are cleared otherwise");
}
