//! Warnings about settings that lose frames, or may not match the bus.

use ecan_lite::config::parse;
use ecan_mcan_port::{Elements, PortPlan, PortWarning, SettingWarning};
use ecan_protocol::can::Phase;
use ecan_protocol::config::ChannelWarning;
use ecan_protocol::mapping::Direction;

fn warnings(text: &str) -> Vec<SettingWarning> {
    let config = parse(text.as_bytes()).unwrap_or_else(|faults| panic!("{text}: {faults}"));
    let plan = PortPlan::of(&config.adapter, &config.port, &[]);
    let setting = |warning| match warning {
        PortWarning::Setting(warning) => Some(warning),
        _ => None,
    };
    plan.warnings.into_iter().filter_map(setting).collect()
}

/// Elements that are too short, and their bytes.
fn short(channel: &str) -> Vec<(Elements, u8)> {
    let all =
        warnings(&format!("[[gateway]]\nn = 8\n[gateway.can2]\nbitrate = 500_000\n{channel}"));
    let short = all.into_iter().map(|warning| match warning {
        SettingWarning::ShortElements { slave: 0, channel: 2, elements, bytes } => {
            (elements, bytes)
        }
        other => panic!("{other}"),
    });
    short.collect()
}

#[test]
fn elements_that_truncate_fd_frames_are_reported() {
    let fd = "data_bitrate = 2_000_000\n";
    let classic = format!("{fd}ram = {{ layout = \"classic\" }}\n");
    assert_eq!(short(&classic), [(Elements::RxFifo0, 8), (Elements::Transmit, 8)]);
    let filters = format!(
        "{classic}[[gateway.can2.standard_filter]]\naction = \"rx_buffer\"\nrx_buffer = 0\nid1 = 1\n\
         [[gateway.can2.extended_filter]]\naction = \"priority_fifo1\"\nmatch = \"two\"\nid1 = 1\n\
         id2 = 2\n"
    );
    let all = [Elements::RxFifo0, Elements::RxFifo1, Elements::RxBuffers, Elements::Transmit];
    assert_eq!(short(&filters), all.map(|elements| (elements, 8)));
    let fifo1 = "non_match_standard = \"fifo1\"\nnon_match_extended = \"reject\"\n\
                 ram = { rx_fifo0_data_bytes = 8, rx_fifo1_data_bytes = 48 }\n";
    assert_eq!(short(&format!("{fd}{fifo1}")), [(Elements::RxFifo1, 48)]);
    let listening = format!("{classic}node_mode = \"listen\"\n");
    assert_eq!(short(&listening), [(Elements::RxFifo0, 8)]);
    assert_eq!(short(fd), []);
    assert_eq!(short("ram = { layout = \"classic\" }\n"), [], "classic CAN needs no more");
    let text =
        warnings(&format!("[[gateway]]\nn = 8\n[gateway.can0]\nbitrate = 500_000\n{classic}"));
    assert!(text[1].to_string().contains("raise `tx_data_bytes` in its table `ram`"), "{text:?}");
}

/// A gateway with CAN FD on all channels and these keys of the TxPDO.
fn four(n: u8, tx_pdo: &str) -> String {
    let channels = (0..4).map(|channel| {
        format!("can{channel} = {{ bitrate = 500_000, data_bitrate = 2_000_000 }}\n")
    });
    format!("[[gateway]]\nn = {n}\ntx_pdo = {{ {tx_pdo} }}\n{}", channels.collect::<String>())
}

/// Shares of an image that are too small.
fn short_shares(text: &str) -> Vec<SettingWarning> {
    let mut all = warnings(text);
    all.retain(|warning| matches!(warning, SettingWarning::ShareBelowFrame { .. }));
    all
}

/// Direction, bytes of the largest frame and of the share of each of four channels.
fn of_four(found: &[SettingWarning]) -> Vec<(Direction, usize, usize)> {
    let parts = |warning: &SettingWarning| match *warning {
        SettingWarning::ShareBelowFrame { direction, frame_bytes, share_bytes, .. } => {
            (direction, frame_bytes, share_bytes)
        }
        other => panic!("{other}"),
    };
    let mut all: Vec<_> = found.iter().map(parts).collect();
    all.sort_unstable_by_key(|(direction, ..)| *direction == Direction::TxPdo);
    let (first, rest) = (all.iter().step_by(4), all.len());
    assert_eq!(rest % 4, 0, "{all:?}");
    first.copied().collect()
}

#[test]
fn share_smaller_than_a_frame_is_reported() {
    // A quarter of 104 bytes; the packet is control word, 4 bytes of CAN ID and 64 of data. The RxPDO is balanced:
    // 16 bytes of it are kept for each of the other channels.
    let rx = (Direction::RxPdo, 70, 56);
    let found = short_shares(&four(1, "budget = \"deterministic\""));
    assert_eq!(of_four(&found), [rx, (Direction::TxPdo, 70, 26)]);
    let texts: Vec<_> = found.iter().map(ToString::to_string).collect();
    let expected = "the largest frame needs 70 bytes of the TxPDO, the channel has 26";
    assert!(texts.iter().any(|text| text.contains(expected)), "{texts:?}");
    // With timestamp and padding it needs 72, and (3 * 128 - 24) / 4 are 90.
    let padded = "budget = \"deterministic\", profile = 1, options = [\"align4\"]";
    assert_eq!(of_four(&short_shares(&four(2, padded))), [(Direction::TxPdo, 72, 58)]);
    assert_eq!(short_shares(&four(3, padded)), []);
    // The gateway lends the unused reserves of a balanced TxPDO; a classic frame fits into 26 bytes.
    assert_eq!(of_four(&short_shares(&four(1, "budget = \"balanced\""))), [rx]);
    let classic = four(1, "budget = \"deterministic\"").replace(", data_bitrate = 2_000_000", "");
    assert_eq!(short_shares(&classic), []);
}

/// A gateway with these sizes and this channel.
fn one(n: u8, channel: &str) -> Vec<SettingWarning> {
    warnings(&format!("[[gateway]]\nn = {n}\n[gateway.can1]\nbitrate = 500_000\n{channel}"))
}

#[test]
fn bit_timing_left_to_the_firmware_is_reported() {
    let wide = "data_bitrate = 2_000_000\nsample_point = [75, 87.5]\n";
    let warning =
        ChannelWarning::WideWindow { phase: Phase::Nominal, min_permille: 750, max_permille: 875 };
    assert_eq!(one(8, wide), [SettingWarning::BitTiming { slave: 0, channel: 1, warning }]);
    let text = one(8, wide)[0].to_string();
    assert!(text.starts_with("slave 0, channel 1: the firmware chooses the nominal"), "{text}");
    assert_eq!(one(8, "data_bitrate = 2_000_000\n"), []);
}

#[test]
fn image_too_small_for_can_fd_is_reported() {
    let fd = "data_bitrate = 2_000_000\n";
    let expected = [Direction::RxPdo, Direction::TxPdo]
        .map(|direction| SettingWarning::FdImageSize { slave: 0, direction, multiplier: 7 });
    assert_eq!(one(7, fd), expected);
    assert_eq!(one(3, ""), [], "classic CAN");
}

#[test]
fn filters_that_reject_every_frame_are_reported() {
    let rejecting = "non_match_standard = \"reject\"\nnon_match_extended = \"reject\"\n";
    let nothing = SettingWarning::NothingReceived { slave: 0, channel: 1 };
    assert_eq!(one(3, rejecting), [nothing]);
    let filter = |action: &str| {
        format!(
            "{rejecting}[[gateway.can1.standard_filter]]\naction = \"{action}\"\nmatch = \"two\"\nid1 = 1\nid2 = 2\n"
        )
    };
    assert_eq!(one(3, &filter("reject")), [nothing]);
    assert_eq!(one(3, &filter("fifo0")), []);
    assert_eq!(one(3, "non_match_standard = \"reject\"\n"), [], "29-bit CAN IDs are accepted");
}
