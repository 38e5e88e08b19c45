//! Frames out and back through simulated gateways.

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, frame, frames_of, id};
use ecan_host::{AdapterConfig, ConfigFault, PlanError};
use ecan_mcan_port::{
    AddressError, Backpressure, ChannelConfig, GatewayConfig, PortConfig, PortConfigFault,
    PortError, ReceiveSource, SendError, SendOptions, TransmitFrame, TransmitHint,
};
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameRef};
use ecan_protocol::config::{FilterAction, StandardFilter, StandardMatch};
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags, Timestamp};
use ecan_protocol::mapping::CHANNELS;
use ecan_sim::variant::RxBudgetPolicy;

#[test]
fn example_of_the_manual_lies_in_the_process_image() {
    let gateway = GatewayConfig::on_all_channels(classic());
    let adapter = AdapterConfig::new(1).with_multiplier(8).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway));
    let data = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];
    let mut sequence = 0;
    fixture.cycle(|cycle| {
        sequence = cycle.send_can(0, 0, id(0x123), &data).unwrap().sequence;
    });
    let image = fixture.port.adapter().rx_pdo(0);
    let [low, high] = sequence.to_le_bytes();
    // Manual 5.4.4.1; the CRC covers the payload alone, so it does not depend on the sequence.
    let header = [
        0x16, 0x00, low, high, low, high, 0x0c, 0x00, 0xd3, 0x56, 0xe7, 0x01, 0x0f, 0x01, 0x00,
        0x01, 0, 0, 0, 0, 0, 0, 0, 0,
    ];
    let packet = [0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];
    assert_eq!(image[..24], header);
    assert_eq!(image[24..36], packet);
    assert!(image[36..].iter().all(|byte| *byte == 0));
    let back = frames_of(&fixture.idle(5));
    assert_eq!(back.len(), 1);
    assert_eq!(back[0].frame, frame(0x123, &data));
    assert_eq!((back[0].slave, back[0].channel), (0, 0));
    // The packet of a received frame has the same bytes.
    let tx = fixture.port.adapter().tx_pdo(0);
    assert_eq!(tx[0], 0x16);
}

#[test]
fn every_size_works_in_either_direction() {
    for n in [1, 3, 8, 11] {
        for (rx, tx) in [(n, n), (n, 3), (3, n)] {
            let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
            adapter.slaves[0].rx_multiplier = rx;
            adapter.slaves[0].tx_multiplier = tx;
            let gateway = GatewayConfig::on_channel(2, classic());
            let config = PortConfig::uniform(1, gateway);
            let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
            assert_eq!(fixture.port.adapter().rx_pdo(0).len(), usize::from(rx) * 128);
            assert_eq!(fixture.port.adapter().tx_pdo(0).len(), usize::from(tx) * 128);
            let frames: Vec<_> = (0..40).map(|n| frame(0x100 + n, &n.to_le_bytes())).collect();
            let back: Vec<_> = fixture.carry(2, &frames, 200).iter().map(|f| f.frame).collect();
            assert_eq!(back, frames, "N = {rx} out, {tx} back");
            assert_eq!(fixture.port.statistics(fixture.port.gw(0)).parse_errors, 0);
        }
    }
}

#[test]
fn twelve_chunks_and_more_need_a_master_that_carries_them() {
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    for n in [12, 16, 24] {
        let mut adapter = AdapterConfig::new(1).with_multiplier(n);
        let rejected = Fixture::open(ecan_sim::echo(1), adapter, config);
        let Err(PortError::Config(faults)) = rejected.map(|_| ()) else { panic!("N = {n} taken") };
        assert!(
            matches!(
                faults.0[0],
                PortConfigFault::Adapter(ConfigFault::Plan(PlanError::LargePdo { multiplier, .. }))
                    if multiplier == n
            ),
            "{faults}"
        );
        adapter.allow_large_pdos = true;
        let mut scenario = ecan_sim::echo(1);
        scenario.carries_large_pdos = true;
        let mut fixture = Fixture::ready(scenario, adapter, config);
        let frames: Vec<_> = (0..100).map(|n| frame(0x200 + n, &[7; 8])).collect();
        assert_eq!(fixture.carry(0, &frames, 200).len(), 100);
    }
}

#[test]
fn two_gateways_with_different_sizes_do_not_mix() {
    let mut adapter = AdapterConfig::new(2).with_cycle(Duration::from_millis(2));
    adapter.slaves[1].rx_multiplier = 8;
    adapter.slaves[1].tx_multiplier = 6;
    let config = PortConfig::from([
        GatewayConfig::on_channel(1, classic()),
        GatewayConfig::on_channel(3, ChannelConfig::fd(500_000, 2_000_000)),
    ]);
    let mut fixture = Fixture::ready(ecan_sim::echo(2), adapter, config);
    let long = [0xA5; 48];
    fixture.cycle(|cycle| {
        cycle.send_can(0, 1, id(0x11), &[1]).unwrap();
        let fd = FrameRef::fd(id(0x22), &long, true, false).unwrap();
        cycle.send(cycle.ch(1, 3), fd).unwrap();
        assert_eq!(
            cycle.send_can(1, 1, id(0x33), &[]),
            Err(AddressError::Disabled { slave: 1, channel: 1 }.into())
        );
        assert_eq!(
            cycle.send(cycle.ch(0, 1), FrameRef::fd(id(0x33), &[], false, false).unwrap()),
            Err(SendError::NotFd { slave: 0, channel: 1 })
        );
    });
    let back = frames_of(&fixture.idle(6));
    let seen: Vec<_> = back.iter().map(|f| (f.slave, f.channel, f.frame)).collect();
    assert_eq!(seen.len(), 2, "{seen:?}");
    assert!(seen.contains(&(0, 1, frame(0x11, &[1]))));
    assert!(seen.contains(&(1, 3, CanFrame::fd(id(0x22), &long, true, false).unwrap())));
}

#[test]
fn three_gateways_carry_traffic_on_all_twelve_channels() {
    let adapter = AdapterConfig::new(3).with_cycle(Duration::from_millis(2));
    let gateway = GatewayConfig::on_all_channels(classic());
    let mut fixture = Fixture::ready(ecan_sim::echo(3), adapter, PortConfig::uniform(3, gateway));
    let mut back = vec![Vec::new(); 12];
    for round in 0..50u8 {
        let items = fixture.cycle(|cycle| {
            for slave in 0..3 {
                for channel in 0..4 {
                    let data = [slave as u8, channel, round];
                    cycle.send_can(slave, channel, id(0x100 + u16::from(round)), &data).unwrap();
                }
            }
        });
        collect(&items, &mut back);
    }
    collect(&fixture.idle(6), &mut back);
    for (place, frames) in back.iter().enumerate() {
        let (slave, channel) = ((place / CHANNELS) as u8, (place % CHANNELS) as u8);
        let expected: Vec<_> = (0..50u8)
            .map(|round| frame(0x100 + u16::from(round), &[slave, channel, round]))
            .collect();
        assert_eq!(*frames, expected, "slave {slave} channel {channel}");
    }
}

fn collect(items: &[ecan_mcan_port::Received], back: &mut [Vec<CanFrame>]) {
    for received in frames_of(items) {
        back[received.slave * CHANNELS + usize::from(received.channel)].push(received.frame);
    }
}

#[test]
fn every_kind_of_frame_comes_back_as_it_went() {
    let fd = ChannelConfig::fd(1_000_000, 5_000_000);
    let mut fixture = Fixture::single(GatewayConfig::on_channel(0, fd));
    let mut frames = Vec::new();
    let ids =
        [id(0), id(0x7FF), CanId::extended(0).unwrap(), CanId::extended(0x1FFF_FFFF).unwrap()];
    for can_id in ids {
        for raw in 0..=15 {
            let dlc = Dlc::new(raw).unwrap();
            let data: Vec<u8> = (0..dlc.fd_len() as u8).map(|b| b ^ raw).collect();
            if raw <= 8 {
                frames.push(CanFrame::classic(can_id, &data).unwrap());
                frames.push(CanFrame::remote(can_id, dlc).unwrap());
            }
            frames.push(CanFrame::fd(can_id, &data, true, false).unwrap());
            frames.push(CanFrame::fd(can_id, &data, false, false).unwrap());
        }
    }
    let back: Vec<_> = fixture.carry(0, &frames, 2000).iter().map(|f| f.frame).collect();
    assert_eq!(back, frames);
}

#[test]
fn options_and_profiles_keep_frames_whole() {
    let options = [
        OptionFlags::ALIGN4,
        OptionFlags::NO_CRC16,
        OptionFlags::PAYLOAD_ONLY,
        OptionFlags::ALIGN4.with(OptionFlags::NO_CRC16).with(OptionFlags::PAYLOAD_ONLY),
    ];
    for option in options {
        for raw in [0, 1, 4, 5] {
            let mut gateway = GatewayConfig::on_channel(0, ChannelConfig::fd(1_000_000, 4_000_000));
            gateway.tx_options = option;
            gateway.rx_options = option;
            gateway.tx_encapsulation = EncapsulationProfile::from_raw(raw).unwrap();
            gateway.rx_encapsulation = gateway.tx_encapsulation;
            let mut fixture = Fixture::single(gateway);
            let frames: Vec<_> = (0..60)
                .map(|n: u8| match n % 3 {
                    0 => CanFrame::fd(id(n.into()), &[n; 12], true, false).unwrap(),
                    1 => frame(n.into(), &[n; 3]),
                    _ => CanFrame::fd(id(n.into()), &[n; 64], true, false).unwrap(),
                })
                .collect();
            let back = fixture.carry(0, &frames, 500);
            let same: Vec<_> = back.iter().map(|f| f.frame).collect();
            assert_eq!(same, frames, "{option:?}, profile {raw}");
            let stamped = back.iter().any(|f| f.timestamp != Timestamp::None);
            assert_eq!(stamped, raw == 1 || raw == 5, "profile {raw}");
        }
    }
}

#[test]
fn full_image_rejects_the_frame_and_counts_it() {
    let adapter = AdapterConfig::new(1).with_multiplier(1).with_cycle(Duration::from_millis(1));
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
    // 104 bytes of frame area hold 8 packets of 12 bytes (manual 5.2, 8.3).
    let mut rejected = None;
    fixture.cycle(|cycle| {
        for n in 0..8 {
            cycle.send_can(0, 0, id(n), &[0; 8]).unwrap();
        }
        assert_eq!(cycle.image_room(cycle.gw(0)), 8);
        rejected = cycle.send_can(0, 0, id(8), &[0; 8]).err();
        cycle.send_can(0, 0, id(9), &[0; 4]).unwrap();
    });
    let what = Backpressure::Image;
    assert_eq!(rejected, Some(SendError::Backpressure { slave: 0, channel: 0, what }));
    assert_eq!(fixture.port.statistics(fixture.port.gw(0)).channels[0].rejected_image_full, 1);
    let back = frames_of(&fixture.idle(10));
    assert_eq!(back.len(), 9);
    assert_eq!(back[8].frame, frame(9, &[0; 4]));
}

/// Manual 12, on a gateway that applies the budget policy of the RxPDO: 104 bytes for two channels. A packet has 12.
#[test]
fn channel_sends_only_its_share_of_an_image() {
    for (rx_budget, fitting) in [
        (BudgetPolicy::Balanced, 7),
        (BudgetPolicy::SharedOnly, 8),
        (BudgetPolicy::Deterministic, 4),
    ] {
        let adapter = AdapterConfig::new(1).with_multiplier(1).with_cycle(Duration::from_millis(2));
        let mut gateway = GatewayConfig::on_channel(0, classic()).with_channel(1, classic());
        gateway.rx_budget = rx_budget;
        let mut scenario = ecan_sim::echo(1);
        scenario.gateways[0].config.variant.rx_budget = RxBudgetPolicy::Applied;
        let mut fixture = Fixture::ready(scenario, adapter, PortConfig::uniform(1, gateway));
        fixture.cycle(|cycle| {
            let sent = (0..30).take_while(|n| cycle.send_can(0, 0, id(*n), &[0; 8]).is_ok());
            assert_eq!(sent.count(), fitting, "{rx_budget}");
            let what = match rx_budget {
                BudgetPolicy::SharedOnly => Backpressure::Image,
                _ => Backpressure::Share,
            };
            let rejected = cycle.send_can(0, 0, id(9), &[0; 8]);
            assert_eq!(rejected, Err(SendError::Backpressure { slave: 0, channel: 0, what }));
            let other = cycle.send_can(0, 1, id(9), &[0; 8]);
            assert_eq!(other.is_ok(), rx_budget != BudgetPolicy::SharedOnly, "{rx_budget}");
        });
        fixture.idle(10);
        let frames: Vec<_> = (0..200).map(|n| frame(n, &[0; 8])).collect();
        let back: Vec<_> = fixture.carry(0, &frames, 500).iter().map(|f| f.frame).collect();
        assert_eq!(back, frames, "{rx_budget}");
        let counters = fixture.simulation.with_world(|world| world.counters(0).unwrap());
        assert_eq!(counters.transmit_losses.over_budget, 0, "{rx_budget}");
    }
}

/// A CAN FD packet of 68 bytes never fits a share of 26 or 56 bytes.
#[test]
fn packet_beyond_the_share_of_its_channel_is_an_error() {
    for (rx_budget, share) in [(BudgetPolicy::Deterministic, 26), (BudgetPolicy::Balanced, 56)] {
        let adapter = AdapterConfig::new(1).with_multiplier(1);
        let fd = ChannelConfig::fd(1_000_000, 5_000_000);
        let gateway = GatewayConfig { rx_budget, ..GatewayConfig::on_all_channels(fd) };
        let mut fixture =
            Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway));
        fixture.cycle(|cycle| {
            let frame = CanFrame::fd(id(1), &[0; 64], true, false).unwrap();
            let sent = cycle.send(cycle.ch(0, 1), &frame);
            let expected = SendError::BeyondShare { slave: 0, channel: 1, bytes: 68, share };
            assert_eq!(sent, Err(expected));
            assert!(!expected.is_temporary());
        });
    }
}

#[test]
fn burst_is_paced_by_the_gateways_queue_and_nothing_is_dropped() {
    let adapter = AdapterConfig::new(1).with_multiplier(11).with_cycle(Duration::from_millis(1));
    let config =
        PortConfig::uniform(1, GatewayConfig::on_channel(0, ChannelConfig::classic(125_000)));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
    let frames: Vec<_> = (0..1000u16).map(|n| frame(n % 0x700, &n.to_le_bytes())).collect();
    let back: Vec<_> = fixture.carry(0, &frames, 5000).iter().map(|f| f.frame).collect();
    assert_eq!(back, frames);
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    assert!(statistics.channels[0].rejected_queue_full > 0, "the burst was never held back");
    assert_eq!(statistics.txpdo_incomplete, 0);
}

#[test]
fn receive_source_and_the_transmit_hint_travel_along() {
    let filter = StandardFilter {
        matching: StandardMatch::Range,
        action: FilterAction::Fifo1,
        sync: false,
        id1: 0x200,
        id2: 0x2FF,
    };
    let mut config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    config.add_filter(0, 0, filter).unwrap();
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
    let hint = TransmitHint::HighPriority;
    fixture.cycle(|cycle| {
        let options = SendOptions { hint, schedule: None };
        let batch = [
            TransmitFrame { to: cycle.ch(0, 0), frame: frame(0x234, &[1]), options },
            TransmitFrame::new(cycle.ch(0, 0), frame(0x345, &[2])),
        ];
        assert_eq!(cycle.send_batch(&batch).sent, 2);
    });
    // ID_AUX stands in bits 11 to 13 of the identifier field (manual 8.1).
    assert_eq!(fixture.port.adapter().rx_pdo(0)[26..28], (0x234u16 | 1 << 11).to_le_bytes());
    let mut back: Vec<_> =
        frames_of(&fixture.idle(6)).iter().map(|f| (f.frame.id().raw(), f.source)).collect();
    back.sort_by_key(|(id, _)| *id);
    assert_eq!(back, [(0x234, ReceiveSource::Fifo1), (0x345, ReceiveSource::Fifo0)]);
}

#[test]
fn what_does_not_fit_the_buffer_stays_for_the_next_call() {
    let mut fixture = Fixture::single(GatewayConfig::on_channel(0, classic()));
    fixture.cycle(|cycle| {
        for n in 0..6 {
            cycle.send_can(0, 0, id(n), &[]).unwrap();
        }
    });
    let mut seen = Vec::new();
    for _ in 0..8 {
        let mut cycle = fixture.port.next_cycle();
        let blank = ecan_mcan_port::Received::TransmitReport(ecan_mcan_port::TransmitReport {
            ticket: None,
            slave: 9,
            channel: 0,
            code: ecan_protocol::image::ResultCode::Ok,
            schedule_tag: None,
        });
        let mut two = [blank; 2];
        loop {
            let count = cycle.receive(&mut two);
            seen.extend(frames_of(&two[..count]).iter().map(|f| f.frame.id().raw()));
            if count < 2 {
                break;
            }
        }
        assert_eq!(cycle.finish().error(), None);
    }
    assert_eq!(seen, [0, 1, 2, 3, 4, 5]);
}

#[test]
fn wrong_address_and_invalid_frame_return_errors() {
    let mut fixture = Fixture::single(GatewayConfig::on_channel(0, classic()));
    fixture.cycle(|cycle| {
        let wrong = [
            (cycle.channel(4, 0), AddressError::Slave { slave: 4, count: 1 }),
            (cycle.channel(0, 4), AddressError::Channel { slave: 0, channel: 4 }),
            (cycle.channel(0, 1), AddressError::Disabled { slave: 0, channel: 1 }),
        ];
        for (found, expected) in wrong {
            assert_eq!(found, Err(expected));
        }
        let too_long = cycle.send_can(0, 0, id(1), &[0; 9]);
        assert!(matches!(too_long, Err(SendError::Frame(_))), "{too_long:?}");
    });
}
