//! 0x8001..0x8004: accepted configurations, their effect on the controller, and filters of the
//! editing window (manual 13.4).

use super::fixture::{Fixture, chunks, extended, fd, standard};
use ecan_protocol::can::{BitTiming, CanFrame, CanId, Dlc};
use ecan_protocol::config::{
    BitTimingMode, DataPathConfig, DataSize, ExtendedFilter, ExtendedMatch, FifoMode, FilterAction,
    McanChannelConfig, MessageRamLayout, NodeMode, NonMatch, SamplePointWindow, StandardFilter,
    StandardMatch, filter_writes,
};
use ecan_protocol::image::Packet;
use ecan_sim::{StationConfig, StationMode};

/// In OP with this configuration and these filters on channel 0.
fn with(
    config: McanChannelConfig,
    standard: &[StandardFilter],
    extended: &[ExtendedFilter],
) -> Fixture {
    let mut fixture = Fixture::preop();
    fixture.apply_profiles(chunks(16), chunks(3));
    for write in filter_writes(0, standard, extended) {
        fixture.send([write]);
        assert_eq!((fixture.upload(0x8001, 47), fixture.upload(0x8001, 48)), (0, 0));
    }
    fixture.apply_channel(0, config);
    fixture.apply_data_path(0, DataPathConfig::for_traffic(8, 8));
    fixture.start();
    fixture
}

/// Identifier and receive source of the frames that pass.
fn passing(fixture: &mut Fixture, frames: &[CanFrame]) -> Vec<(u32, u8)> {
    let mut passed = Vec::new();
    for frame in frames {
        fixture.deliver(0, *frame);
        fixture.cycle();
        passed.extend(fixture.packets(|packet| match packet {
            Packet::Frame(frame) => Some((frame.frame.id().raw(), frame.id_aux)),
            Packet::TxResult(_) => None,
        }));
    }
    passed
}

fn filter(matching: StandardMatch, action: FilterAction, id1: u16, id2: u16) -> StandardFilter {
    StandardFilter { matching, action, sync: false, id1, id2 }
}

#[test]
fn channels_are_disabled_until_applied() {
    let mut fixture = Fixture::preop();
    assert_eq!(fixture.gateway.station_config(0), None);
    assert_eq!(fixture.upload(0x9000, 9) & 7, 0, "disabled");
    assert_eq!(fixture.try_apply_channel(0, McanChannelConfig::default()), 0);
    assert_eq!(fixture.gateway.station_config(0), Some(StationConfig::fd(500_000, 5_000_000)));
    assert_eq!(fixture.gateway.station_config(1), None);
    assert_eq!(fixture.upload(0x9000, 9) & 0xF, 2 | 1 << 3, "run, FD");
    assert_eq!(fixture.upload(0x8001, 5), 1, "command sequence");
}

#[test]
fn configuration_reaches_the_bus() {
    let mut fixture = Fixture::preop();
    let before = fixture.gateway.station_generation(0);
    assert_eq!(fixture.try_apply_channel(0, McanChannelConfig::classic(125_000)), 0);
    assert_eq!(fixture.gateway.station_config(0), Some(StationConfig::classic(125_000)));
    assert_ne!(fixture.gateway.station_generation(0), before);
    for (node_mode, mode) in [
        (NodeMode::Normal, StationMode::Normal),
        (NodeMode::Listen, StationMode::Listen),
        (NodeMode::InternalLoopback, StationMode::InternalLoopback),
        (NodeMode::ExternalLoopback, StationMode::ExternalLoopback),
    ] {
        let config = McanChannelConfig {
            node_mode,
            disable_auto_retransmission: true,
            ..McanChannelConfig::default()
        };
        assert_eq!(fixture.try_apply_channel(0, config), 0);
        let station = fixture.gateway.station_config(0).unwrap();
        assert_eq!((station.mode, station.auto_retransmit), (mode, false));
    }
}

#[test]
fn apply_fails_without_timing_or_with_a_bad_value() {
    let default = McanChannelConfig::default();
    let window = |min, max| SamplePointWindow { min, max };
    for bad in [
        McanChannelConfig { nominal_bitrate: 0, ..default },
        McanChannelConfig { nominal_bitrate: 2_000_000, ..default },
        McanChannelConfig { data_bitrate: 7_777_777, ..default },
        McanChannelConfig { data_sample_point: window(760, 800), ..default },
        McanChannelConfig { data_sample_point: window(875, 750), ..default },
        McanChannelConfig { tdc_offset: 128, ..default },
        McanChannelConfig { timeout_select: 4, ..default },
        McanChannelConfig { tsu_prescaler: 0, ..default },
    ] {
        let mut fixture = Fixture::preop();
        assert_eq!(fixture.try_apply_channel(0, bad), 3, "{bad:?}");
        assert_eq!(fixture.gateway.station_config(0), None);
        assert_eq!(fixture.upload(0x9000, 9) & 7, 4, "error");
    }
    let mut fixture = Fixture::preop();
    fixture.write_u8(0x8001, 8, 4);
    fixture.write_u8(0x8001, 1, 1);
    assert_eq!(fixture.upload(0x8001, 2), 3, "no such node mode");
}

#[test]
fn oversized_ram_layout_fails_and_keeps_the_old_one() {
    let mut fixture = Fixture::preop();
    assert_eq!(fixture.try_apply_channel(0, McanChannelConfig::classic(250_000)), 0);
    let before = fixture.gateway.station_generation(0);
    let fits = MessageRamLayout::fd();
    for ram in [
        MessageRamLayout { rx_buffer_count: 13, ..fits },
        MessageRamLayout { tx_dedicated_count: 1, rx_buffer_count: 0, ..fits },
    ] {
        let config = McanChannelConfig { ram, ..McanChannelConfig::default() };
        assert_eq!(fixture.try_apply_channel(0, config), 4, "{ram:?}");
        assert_eq!(fixture.gateway.station_config(0), Some(StationConfig::classic(250_000)));
        assert_eq!(fixture.gateway.station_generation(0), before);
    }
    assert_eq!(
        fixture.try_apply_channel(0, McanChannelConfig::default()),
        0,
        "8192 bytes are just enough"
    );
}

#[test]
fn manual_timing_decides_the_bit_rate() {
    let config = McanChannelConfig {
        bit_timing_mode: BitTimingMode::Manual,
        manual_nominal: BitTiming { brp: 2, tseg1: 63, tseg2: 16, sjw: 16 },
        manual_data: BitTiming { brp: 1, tseg1: 30, tseg2: 9, sjw: 9 },
        ..McanChannelConfig::default()
    };
    let mut fixture = Fixture::preop();
    assert_eq!(fixture.try_apply_channel(0, config), 0);
    assert_eq!(fixture.gateway.station_config(0), Some(StationConfig::fd(500_000, 2_000_000)));
    let too_wide = BitTiming { brp: 1, tseg1: 30, tseg2: 20, sjw: 9 };
    assert_eq!(
        fixture.try_apply_channel(0, McanChannelConfig { manual_data: too_wide, ..config }),
        3
    );
}

#[test]
fn unmatched_frames_follow_the_non_match_rules() {
    for (rule, expected) in [
        (NonMatch::Fifo0, vec![(0x10, 0), (0x20, 0)]),
        (NonMatch::Fifo1, vec![(0x10, 1), (0x20, 1)]),
        (NonMatch::Reject, vec![]),
        (NonMatch::RejectToo, vec![]),
    ] {
        let config = McanChannelConfig {
            non_match_standard: rule,
            non_match_extended: rule,
            ..McanChannelConfig::default()
        };
        let mut fixture = with(config, &[], &[]);
        let passed = passing(&mut fixture, &[standard(0x10, &[]), extended(0x20)]);
        assert_eq!(passed, expected, "{rule:?}");
    }
}

#[test]
fn remote_frames_can_be_rejected() {
    let remote = |id: CanId| CanFrame::remote(id, Dlc::new(2).unwrap()).unwrap();
    let frames = [
        remote(CanId::standard(1).unwrap()),
        remote(CanId::extended(2).unwrap()),
        standard(3, &[]),
    ];
    for (standard, extended, expected) in
        [(false, false, vec![1, 2, 3]), (true, false, vec![2, 3]), (false, true, vec![1, 3])]
    {
        let config = McanChannelConfig {
            reject_remote_standard: standard,
            reject_remote_extended: extended,
            ..McanChannelConfig::default()
        };
        let passed = passing(&mut with(config, &[], &[]), &frames);
        assert_eq!(passed.iter().map(|(id, _)| *id).collect::<Vec<_>>(), expected);
    }
}

#[test]
fn standard_filters_match_and_route() {
    use FilterAction::{Disabled, Fifo0, Fifo1, Priority, PriorityFifo0, PriorityFifo1, Reject};
    use StandardMatch::{Masked, Range, Two};
    let filters = [
        filter(Range, Fifo1, 0x100, 0x10F),
        filter(Two, Reject, 0x200, 0x300),
        filter(Masked, PriorityFifo0, 0x400, 0x7F0),
        filter(Range, FilterAction::RxBuffer(5), 0x500, 0),
        filter(Range, Disabled, 0x600, 0x600),
        filter(StandardMatch::Disabled, Fifo1, 0x600, 0x600),
        filter(Two, PriorityFifo1, 0x601, 0x602),
        filter(Two, Priority, 0x603, 0x603),
        filter(Two, Fifo0, 0x100, 0x200),
    ];
    let mut fixture = with(McanChannelConfig::default(), &filters, &[]);
    let ids =
        [0x0FF, 0x100, 0x10F, 0x110, 0x200, 0x300, 0x405, 0x410, 0x500, 0x501, 0x600, 0x602, 0x603];
    let passed = passing(&mut fixture, &ids.map(|id| standard(id, &[])));
    assert_eq!(
        passed,
        [
            (0x0FF, 0),
            (0x100, 1),
            (0x10F, 1),
            (0x110, 0),
            (0x405, 3),
            (0x410, 0),
            (0x500, 2),
            (0x501, 0),
            (0x600, 0),
            (0x602, 3),
        ],
        "the first filter that matches decides"
    );
    assert_eq!(fixture.gateway.counters().receive_losses.filtered, 3);
    assert_eq!(fixture.upload(0x9000, 8), 7 << 8, "HPMS: filter 7, not stored");
}

#[test]
fn extended_filters_use_the_global_mask_by_default() {
    let config = McanChannelConfig {
        extended_id_mask: 0x1FFF_FF00,
        non_match_extended: NonMatch::Reject,
        ..McanChannelConfig::default()
    };
    let filter = |matching, id1, id2| ExtendedFilter {
        matching,
        action: FilterAction::Fifo1,
        sync: false,
        id1,
        id2,
    };
    let filters = [
        filter(ExtendedMatch::Two, 0x1234_5600, 0x1234_5600),
        filter(ExtendedMatch::RangeUnmasked, 0x42, 0x43),
        filter(ExtendedMatch::Range, 0x1000, 0x10FF),
        filter(ExtendedMatch::Masked, 0x0700_0000, 0x0F00_0000),
    ];
    let mut fixture = with(config, &[], &filters);
    let ids = [0x1234_5678, 0x1234_5778, 0x41, 0x42, 0x10AB, 0x1100, 0x1712_3456];
    let passed = passing(&mut fixture, &ids.map(extended));
    assert_eq!(passed, [(0x1234_5678, 1), (0x42, 1), (0x10AB, 1), (0x1712_3456, 1)]);
}

#[test]
fn receive_buffer_is_locked_until_it_is_read() {
    let filters = [filter(StandardMatch::Range, FilterAction::RxBuffer(0), 0x100, 0)];
    let mut fixture = with(McanChannelConfig::default(), &filters, &[]);
    fixture.deliver(0, standard(0x100, &[1]));
    fixture.deliver(0, standard(0x100, &[2]));
    fixture.cycle();
    assert_eq!(fixture.received(), [(0, standard(0x100, &[1]))]);
    assert_eq!(fixture.gateway.counters().receive_losses.controller_full, 1);
    fixture.deliver(0, standard(0x100, &[3]));
    fixture.cycle();
    assert_eq!(fixture.received(), [(0, standard(0x100, &[3]))]);
}

#[test]
fn blocking_fifo_keeps_old_frames_and_overwriting_keeps_new_ones() {
    for (mode, expected) in
        [(FifoMode::Blocking, [0, 1, 2, 3]), (FifoMode::Overwrite, [2, 3, 4, 5])]
    {
        let mut ram = MessageRamLayout::fd();
        ram.rx_fifo0.mode = mode;
        ram.rx_fifo0.size = 4;
        let mut fixture = with(McanChannelConfig { ram, ..Default::default() }, &[], &[]);
        fixture.deliver_ids(0, 0..6);
        assert_eq!(fixture.upload(0x9000, 4) & (1 << 24 | 1 << 25 | 0x7F), 1 << 25 | 1 << 24 | 4);
        fixture.cycle();
        assert_eq!(fixture.received_ids(), expected, "{mode:?}");
        assert_eq!(fixture.gateway.counters().receive_losses.controller_full, 2);
    }
}

#[test]
fn element_too_small_for_a_received_frame_keeps_what_fits() {
    let mut ram = MessageRamLayout::fd();
    ram.rx_fifo0.data_size = DataSize::B8;
    let mut fixture = with(McanChannelConfig { ram, ..Default::default() }, &[], &[]);
    fixture.deliver(0, fd(1, &[0x55; 12]));
    fixture.cycle();
    let mut data = [0; 12];
    data[..8].fill(0x55);
    assert_eq!(fixture.received(), [(0, fd(1, &data))]);
}

#[test]
fn editing_window_saves_loads_and_clears() {
    let mut fixture = Fixture::preop();
    for (subindex, value) in [(43, 7), (50, 2), (51, 1), (52, 1)] {
        fixture.write_u8(0x8001, subindex, value);
    }
    fixture.download(0x8001, 53, &0x123u32.to_le_bytes()).unwrap();
    fixture.download(0x8001, 54, &0x7F0u32.to_le_bytes()).unwrap();
    fixture.write_u8(0x8001, 45, 2);
    assert_eq!(fixture.upload(0x8001, 47), 0);
    fixture.write_u8(0x8001, 43, 8);
    fixture.write_u8(0x8001, 45, 1);
    assert_eq!((fixture.upload(0x8001, 51), fixture.upload(0x8001, 53)), (0, 0));
    fixture.write_u8(0x8001, 43, 7);
    fixture.write_u8(0x8001, 45, 1);
    let window: Vec<_> = (50..=54).map(|subindex| fixture.upload(0x8001, subindex)).collect();
    assert_eq!(window, [2, 1, 1, 0x123, 0x7F0]);
    fixture.write_u8(0x8001, 45, 3);
    fixture.write_u8(0x8001, 45, 1);
    assert_eq!(fixture.upload(0x8001, 53), 0);
}

#[test]
fn editing_window_statuses() {
    let mut fixture = Fixture::preop();
    for (index, command, max) in [(43, 45, 64), (44, 46, 24)] {
        let status = command + 2;
        for (at, value, expected) in
            [(max, 2, 1), (max - 1, 2, 0), (0, 4, 2), (0, 9, 2), (0, 0, 0), (255, 1, 1)]
        {
            fixture.write_u8(0x8001, index, at);
            fixture.write_u8(0x8001, command, value);
            assert_eq!(fixture.upload(0x8001, status), expected, "{at} {value}");
        }
    }
}

#[test]
fn filters_take_effect_with_the_apply() {
    let mut fixture = with(McanChannelConfig::default(), &[], &[]);
    let reject = [filter(StandardMatch::Two, FilterAction::Reject, 1, 1)];
    fixture.send(filter_writes(0, &reject, &[]));
    assert_eq!(passing(&mut fixture, &[standard(1, &[])]), [(1, 0)]);
    fixture.send([McanChannelConfig::apply_write(0)]);
    assert_eq!(passing(&mut fixture, &[standard(1, &[])]), []);
}

#[test]
fn pin_rotation_moves_channels_to_other_connectors() {
    let mut fixture = Fixture::preop();
    fixture.apply_profiles(chunks(3), chunks(3));
    fixture.apply_channel(0, McanChannelConfig::classic(125_000));
    fixture.apply_channel(1, McanChannelConfig::classic(250_000));
    let generation = fixture.gateway.station_generation(0);
    fixture.write_u8(0x8000, 12, 1);
    assert_eq!((fixture.upload(0x8000, 13), fixture.upload(0x8000, 15)), (1, 0));
    assert_ne!(fixture.gateway.station_generation(0), generation);
    assert_eq!(fixture.gateway.station_config(0), None);
    assert_eq!(fixture.gateway.station_config(1), Some(StationConfig::classic(125_000)));
    assert_eq!(fixture.gateway.station_config(2), Some(StationConfig::classic(250_000)));
    fixture.start();
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    assert_eq!(fixture.sent(1).len(), 1);
    fixture.deliver(2, standard(2, &[]));
    fixture.cycle();
    assert_eq!(fixture.received(), [(1, standard(2, &[]))]);
    fixture.write_u8(0x8000, 12, 0);
    assert_eq!((fixture.upload(0x8000, 13), fixture.upload(0x8000, 15)), (1, 1), "not in OP");
}

#[test]
fn tsu_captures_start_of_frame_if_configured() {
    let config = McanChannelConfig { tsu: true, tsu_capture_sof: true, ..Default::default() };
    for (config, expected) in [(config, 100), (McanChannelConfig::default(), 400)] {
        let tx = ecan_protocol::image::PdoProfile {
            profile: ecan_protocol::image::EncapsulationProfile::CompactTimestamped,
            ..chunks(3)
        };
        let mut fixture = Fixture::preop();
        fixture.apply_profiles(tx, chunks(3));
        fixture.apply_channel(0, config);
        fixture.start();
        fixture.cycle();
        let service = fixture.now - super::fixture::MS + super::fixture::SERVICE;
        let end = service + 400_000;
        fixture.gateway.received(end, 0, &standard(1, &[]), service + 100_000);
        fixture.cycle();
        let times = fixture.timestamps();
        assert_eq!(times, [ecan_protocol::image::Timestamp::Delta16(expected)]);
    }
}
