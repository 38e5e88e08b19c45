//! Division of the TxPDO frame area among the channels (manual 12): whole packets only, truncation
//! flag and count, no loss.

use super::fixture::{Fixture, MS, SERVICE, chunks, fd, standard};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::DataPathConfig;
use ecan_protocol::image::{
    BudgetPolicy, EncapsulationProfile, HeaderFlags, OptionFlags, PdoProfile, Timestamp,
};

/// In OP with large drain budgets, so that only the frame area limits.
fn with(tx: PdoProfile) -> Fixture {
    let mut fixture = Fixture::configured(tx, chunks(3));
    for channel in 0..4 {
        fixture.apply_data_path(channel, DataPathConfig::for_traffic(8, 8));
    }
    fixture.start();
    fixture
}

fn budget(multiplier: u8, budget: BudgetPolicy) -> PdoProfile {
    PdoProfile { budget, ..chunks(multiplier) }
}

fn per_channel(fixture: &Fixture) -> [usize; 4] {
    let mut counts = [0; 4];
    for (channel, _) in fixture.received() {
        counts[usize::from(channel)] += 1;
    }
    counts
}

#[test]
fn truncated_image_is_flagged_and_the_rest_follows() {
    // 104 bytes: 8 packets of 12
    let mut fixture = with(chunks(1));
    for id in 0..8 {
        fixture.deliver(0, standard(id, &[0; 8]));
        fixture.deliver(1, standard(0x100 + id, &[0; 8]));
    }
    fixture.cycle();
    let header = *fixture.input().header();
    assert!(header.flags.contains(HeaderFlags::STREAM_TRUNCATED));
    assert!(header.flags.contains(HeaderFlags::OVERFLOW_SAT_VALID));
    assert_eq!(header.frame_count, 8);
    assert_eq!(header.overflow_sat, 8);
    fixture.has(&[(0x8010, 16, 8), (0x8010, 2, 8), (0x8010, 14, 3)]);
    assert_eq!(fixture.upload(0x8010, 15), 0, "no packet was wrong");
    let mut frames = fixture.received();
    fixture.cycle();
    assert!(!fixture.input().is_incomplete());
    frames.extend(fixture.received());
    for channel in 0..2 {
        let ids: Vec<_> =
            frames.iter().filter(|(c, _)| *c == channel).map(|(_, f)| f.id().raw()).collect();
        let first = u32::from(channel) * 0x100;
        assert_eq!(ids, (first..first + 8).collect::<Vec<_>>());
    }
}

#[test]
fn frames_come_oldest_first_over_all_channels() {
    let mut fixture = with(chunks(3));
    for (channel, id) in [(2, 1), (0, 2), (3, 3), (0, 4), (1, 5)] {
        fixture.deliver(channel, standard(id, &[]));
        fixture.now += 10;
    }
    fixture.cycle();
    assert_eq!(fixture.received_ids(), [1, 2, 3, 4, 5]);
}

/// Eight frames of 12 bytes wait on channel 0 before one each on some others.
fn rush(tx: PdoProfile, others: std::ops::Range<usize>) -> [usize; 4] {
    let mut fixture = with(tx);
    for id in 0..8 {
        fixture.deliver(0, standard(id, &[0; 8]));
        fixture.now += 10;
    }
    for channel in others {
        fixture.deliver(channel, standard(0x100, &[0; 8]));
    }
    fixture.cycle();
    per_channel(&fixture)
}

#[test]
fn budget_policy_divides_the_frame_area() {
    // Deterministic shares are 26 bytes a channel.
    let deterministic = budget(1, BudgetPolicy::Deterministic);
    let one_channel = PdoProfile { channel_mask: 0x01, ..deterministic };
    for (tx, others, expected, reason) in [
        (budget(1, BudgetPolicy::SharedOnly), 1..4, [8, 0, 0, 0], "the first frame has it all"),
        (budget(1, BudgetPolicy::Balanced), 1..4, [5, 1, 1, 1], "a packet is reserved for each"),
        (deterministic, 1..4, [2, 1, 1, 1], "equal shares"),
        (deterministic, 0..0, [2, 0, 0, 0], "although no other channel has a frame"),
        (one_channel, 0..0, [8, 0, 0, 0], "shares are those of the enabled channels"),
    ] {
        assert_eq!(rush(tx, others), expected, "{reason}");
    }
}

#[test]
fn balanced_budget_lends_unused_reserves() {
    let mut fixture = with(budget(1, BudgetPolicy::Balanced));
    fixture.deliver(3, fd(1, &[7; 64]));
    fixture.cycle();
    assert_eq!(per_channel(&fixture), [0, 0, 0, 1]);
    // all four have a frame larger than any reserve: one per image, none starves
    for channel in 0..4 {
        fixture.deliver(channel, fd(1, &[7; 64]));
    }
    let mut seen = [0; 4];
    for _ in 0..4 {
        fixture.cycle();
        let counts = per_channel(&fixture);
        assert_eq!(counts.iter().sum::<usize>(), 1);
        for (seen, count) in seen.iter_mut().zip(counts) {
            *seen += count;
        }
    }
    assert_eq!(seen, [1; 4]);
}

#[test]
fn oversized_frame_is_an_overrun_and_blocks_no_other() {
    let mut fixture = with(budget(1, BudgetPolicy::Deterministic));
    fixture.deliver(0, fd(1, &[0; 64]));
    fixture.deliver(0, standard(2, &[]));
    fixture.cycle();
    assert_eq!(fixture.received(), [(0, standard(2, &[]))]);
    fixture.has(&[(0x8010, 14, 2), (0x8010, 16, 1)]);
    assert_eq!(fixture.input().header().overflow_sat, 1);
    assert_eq!(fixture.gateway.counters().receive_losses.oversized, 1);
}

#[test]
fn overflow_count_saturates() {
    let mut fixture = with(chunks(1));
    assert!(fixture.write());
    fixture.deliver_ids(0, (0..2000).map(|id| id & 0x7FF));
    assert!(fixture.write());
    assert!(fixture.read());
    fixture.cycle();
    assert_eq!(fixture.input().header().overflow_sat, 255);
}

#[test]
fn image_holds_at_most_255_packets() {
    let tx = PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(24) };
    let mut fixture = Fixture::configured(tx, chunks(24));
    fixture.apply_data_path(0, DataPathConfig::for_traffic(8, 8));
    fixture.start();
    fixture.push_ids(0, 0..254);
    fixture.deliver_ids(0, 0..4);
    fixture.cycle();
    let header = *fixture.input().header();
    assert_eq!(header.frame_count, 255);
    assert!(header.flags.contains(HeaderFlags::STREAM_TRUNCATED));
    fixture.cycle();
    assert_eq!(fixture.received().len(), 3);
}

#[test]
fn align4_pads_every_packet() {
    let tx = PdoProfile { options: OptionFlags::ALIGN4, ..chunks(3) };
    let mut fixture = with(tx);
    let frame = CanFrame::classic(CanId::extended(0x1234_5678).unwrap(), &[1; 8]).unwrap();
    fixture.deliver(0, frame);
    fixture.deliver(0, standard(1, &[1; 8]));
    fixture.cycle();
    assert_eq!(fixture.input().header().payload_len, 16 + 12);
    assert_eq!(fixture.input[24 + 14..24 + 16], [0, 0]);
    assert_eq!(fixture.received(), [(0, frame), (0, standard(1, &[1; 8]))]);
}

#[test]
fn timestamps_are_microseconds_since_the_last_service() {
    for profile in
        [EncapsulationProfile::CompactTimestamped, EncapsulationProfile::Window64Timestamped]
    {
        let mut fixture = with(PdoProfile { profile, ..chunks(3) });
        fixture.cycle();
        let service = fixture.now - MS + SERVICE;
        for us in [100, 350] {
            fixture.gateway.received(service + us * 1000, 0, &standard(1, &[]), service);
        }
        fixture.cycle();
        let times = fixture.timestamps();
        assert_eq!(times, [Timestamp::Delta16(100), Timestamp::Delta16(350)]);
    }
}

#[test]
fn profiles_without_timestamps_have_none() {
    for profile in [EncapsulationProfile::Compact, EncapsulationProfile::Window64] {
        let mut fixture = with(PdoProfile { profile, ..chunks(3) });
        fixture.deliver(0, standard(1, &[]));
        fixture.cycle();
        assert_eq!(fixture.input().header().payload_len, 4);
    }
}

#[test]
fn window_profiles_use_64_bytes_for_fd_data_only() {
    let tx = PdoProfile { profile: EncapsulationProfile::Window64, ..chunks(3) };
    let mut fixture = with(tx);
    fixture.deliver(0, fd(1, &[1, 2, 3]));
    fixture.deliver(0, standard(2, &[4, 5]));
    fixture.cycle();
    assert_eq!(fixture.input().header().payload_len, (4 + 64) + (4 + 2));
    assert_eq!(fixture.received(), [(0, fd(1, &[1, 2, 3])), (0, standard(2, &[4, 5]))]);
}

#[test]
fn without_crc_and_payload_only() {
    let tx = PdoProfile { options: OptionFlags::NO_CRC16, ..chunks(3) };
    let mut fixture = with(tx);
    fixture.deliver(0, standard(1, &[1]));
    fixture.cycle();
    let header = *fixture.input().header();
    assert_eq!((header.crc_alg, header.payload_crc16), (0, 0));
    assert_eq!(fixture.received().len(), 1);

    let tx = PdoProfile { options: OptionFlags::PAYLOAD_ONLY, ..chunks(3) };
    let mut fixture = with(tx);
    fixture.deliver(0, standard(1, &[0xAB; 8]));
    fixture.cycle();
    fixture.cycle();
    assert_eq!(fixture.received(), []);
    assert_eq!(fixture.input[28..36], [0xAB; 8], "stale bytes stay");

    let mut fixture = with(chunks(3));
    fixture.deliver(0, standard(1, &[0xAB; 8]));
    fixture.cycle();
    fixture.cycle();
    assert!(fixture.input[24..].iter().all(|&byte| byte == 0), "and are cleared otherwise");
}
