//! The preflight plan of a Port: figures worked out by hand, and against the simulated gateway.

use std::time::Duration;

use crate::common::{Fixture, Handles, classic, frame};
use crate::plan_support::{EVERY_CYCLE, adapter, eight, one_channel};
use ecan_host::{AdapterConfig, DcSync, PlanError};
use ecan_mcan_port::{
    ChannelConfig, Config, CpuCost, FrameRate, FrameRoute, FrameStream, GatewayConfig, ImageFill,
    PortConfig, PortConfigFault, PortPlan, PortPlanError, PortWarning, SendError, Traffic,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags};
use ecan_protocol::mapping::Direction;

fn fd_frame(length: usize) -> CanFrame {
    CanFrame::fd(CanId::standard(0x123).unwrap(), &[0x5A; 64][..length], true, false).unwrap()
}

fn fill(packets: u32, bytes: u32) -> ImageFill {
    ImageFill { packets: packets.into(), bytes: bytes.into() }
}

/// Frames of 8 bytes, standard: 2 + 2 + 8 = 12 bytes a packet, 30 of them in 384 - 24 = 360 bytes.
/// Four out and three back in 1000 bits: 7 * 111 = 777 to 7 * 135 = 945.
#[test]
fn classic_frames_on_one_channel() {
    let traffic = [
        FrameStream::to_bus(0, 0, eight(), FrameRate::PerCycle(4)),
        FrameStream::from_bus(0, 0, eight(), FrameRate::PerSecond(3_000.0)),
    ];
    let plan = PortPlan::of(&adapter(3), &one_channel(classic()), &traffic);
    let load = plan.channels[0].load;
    assert!((load.least - 0.777).abs() < 1e-9 && (load.most - 0.945).abs() < 1e-9, "{load:?}");
    let gateway = &plan.gateways[0];
    assert_eq!(gateway.rx.area_bytes(), 360);
    assert_eq!(gateway.rx.frames_per_image(eight().as_ref(), false), 30);
    assert_eq!(gateway.rx.peak, fill(4, 48));
    assert_eq!(gateway.tx.peak, fill(3, 36));
    assert_eq!(plan.rejections, []);
    let high = PortWarning::BusLoad { slave: 0, channel: 0, least_percent: 78, most_percent: 95 };
    assert_eq!(plan.warnings, [high]);
    // Two images, seven packets, 84 bytes: 2 * 50 + 7 * 9 + 84 * 0.08 = 169.72 ns.
    assert!((plan.cpu_ns(CpuCost::MEASURED) - 169.72).abs() < 1e-6);
    assert!((plan.cpu_share(CpuCost::MEASURED) - 169.72e-6).abs() < 1e-12);
}

/// The manual's examples of lengths (8): 68 bytes for a standard FD frame of 64, 72 with extended identifier
/// and delta16. A schedule record takes 8, a TX_RESULT 6 or, aligned, 8.
#[test]
fn packets_have_the_sizes_of_the_manual() {
    let mut gateway = GatewayConfig::on_channel(0, ChannelConfig::fd(1_000_000, 5_000_000));
    gateway.tx_encapsulation = EncapsulationProfile::Window64Timestamped;
    gateway.tx_options = OptionFlags::TX_RESULT.with(OptionFlags::ALIGN4);
    let mut adapter = adapter(8);
    adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(700)));
    let extended = CanFrame::fd(CanId::extended(1).unwrap(), &[0; 64], true, false).unwrap();
    let traffic = [
        FrameStream::to_bus(0, 0, fd_frame(64), EVERY_CYCLE).scheduled(100_000),
        FrameStream::to_bus(0, 0, fd_frame(64), EVERY_CYCLE),
        FrameStream::from_bus(0, 0, extended, EVERY_CYCLE),
    ];
    let plan = PortPlan::of(&adapter, &PortConfig::uniform(1, gateway), &traffic);
    let images = &plan.gateways[0];
    assert_eq!(images.rx.peak, fill(2, 76 + 68));
    assert_eq!(images.tx.peak, fill(3, 72 + 2 * 8));
    // In a window of 64 bytes even a short one takes 2 + 2 + 2 + 64, aligned 72.
    assert_eq!(images.tx.packet_bytes(fd_frame(1).as_ref(), false), 72);
    assert_eq!(images.rx.packet_bytes(fd_frame(1).as_ref(), false), 5);
    assert_eq!(images.rx.frames_per_image(fd_frame(64).as_ref(), false), 14, "1000 / 68");
    assert_eq!((plan.rejections, plan.warnings), (vec![], vec![]));
}

/// An image of N = 24 holds 255 packets of 4 bytes though 762 would fit.
#[test]
fn image_holds_255_packets_at_most() {
    let mut adapter = adapter(24).with_cycle(Duration::from_millis(10));
    adapter.allow_large_pdos = true;
    let empty = frame(1, &[]);
    let config = PortConfig::uniform(1, GatewayConfig::on_all_channels(classic()));
    let traffic = |frames| [FrameStream::to_bus(0, 0, empty, FrameRate::PerCycle(frames))];
    let plan = PortPlan::of(&adapter, &config, &traffic(255));
    assert_eq!(plan.gateways[0].rx.frames_per_image(empty.as_ref(), false), 255);
    let is_image =
        |rejection: &&PortPlanError| matches!(rejection, PortPlanError::ImageTooSmall { .. });
    assert_eq!(plan.rejections.iter().find(is_image), None);
    let plan = PortPlan::of(&adapter, &config, &traffic(256));
    let text = plan.rejections.iter().find(is_image).unwrap().to_string();
    assert!(text.contains("256 packets of together 1024 bytes") && text.contains("3048"), "{text}");
}

#[test]
fn frames_that_do_not_fit_an_image_are_rejected_or_wait() {
    let config = PortConfig::uniform(1, GatewayConfig::on_all_channels(classic()));
    // Eight frames of 12 bytes on each channel are 384 bytes, and 360 fit.
    let all = |rate| [0u8, 1, 2, 3].map(|channel| FrameStream::to_bus(0, channel, eight(), rate));
    let plan = PortPlan::of(&adapter(3), &config, &all(FrameRate::PerCycle(8)));
    let expected = PortPlanError::ImageTooSmall {
        slave: 0,
        direction: Direction::RxPdo,
        packets: 32,
        bytes: 384,
        area: 360,
        needed: Some(4),
    };
    assert!(plan.rejections.contains(&expected), "{:?}", plan.rejections);
    // 31 kinds of frame in every fourth cycle: 7.75 on the average, 372 bytes when they meet.
    let meeting = vec![FrameStream::to_bus(0, 1, eight(), FrameRate::EveryCycles(4)); 31];
    let plan = PortPlan::of(&adapter(3), &config, &meeting);
    let expected = PortWarning::ImagePeak {
        slave: 0,
        direction: Direction::RxPdo,
        packets: 31,
        bytes: 372,
        area: 360,
        needed: Some(4),
    };
    assert!(plan.warnings.contains(&expected), "{:?}", plan.warnings);
}

/// 360 bytes for four channels are 90 each: seven frames of 12 bytes fit, eight do not. Balanced keeps 16 bytes for
/// each of the other three channels of an RxPDO: 26 frames fit into 312 bytes. In a TxPDO the gateway lends them.
#[test]
fn share_of_a_channel_is_that_of_the_budget_policy() {
    let rejection = |budget, direction, frames| {
        let mut gateway = GatewayConfig::on_all_channels(classic());
        (gateway.tx_budget, gateway.rx_budget) = (budget, budget);
        let config = PortConfig::uniform(1, gateway);
        let rate = FrameRate::PerCycle(frames);
        let traffic = match direction {
            Direction::RxPdo => [FrameStream::to_bus(0, 2, eight(), rate)],
            Direction::TxPdo => [FrameStream::from_bus(0, 2, eight(), rate)],
        };
        let found = PortPlan::of(&adapter(3), &config, &traffic).rejections;
        found.into_iter().find(|found| matches!(found, PortPlanError::ShareTooSmall { .. }))
    };
    let share_of = |budget, direction, fitting: u32| {
        assert_eq!(rejection(budget, direction, fitting), None, "{budget} {direction}");
        match rejection(budget, direction, fitting + 1) {
            Some(PortPlanError::ShareTooSmall { channel: 2, bytes, share, needed, .. }) => {
                Some((bytes, share, needed?))
            }
            _ => None,
        }
    };
    for direction in [Direction::RxPdo, Direction::TxPdo] {
        let deterministic = share_of(BudgetPolicy::Deterministic, direction, 7);
        assert_eq!(deterministic, Some((96, 90, 4)), "{direction}");
        assert_eq!(share_of(BudgetPolicy::SharedOnly, direction, 30), None, "{direction}");
    }
    assert_eq!(share_of(BudgetPolicy::Balanced, Direction::RxPdo, 26), Some((324, 312, 4)));
    assert_eq!(share_of(BudgetPolicy::Balanced, Direction::TxPdo, 30), None);
}

/// The smallest N with space for each frame of the fullest cycle, as manual 5.2 counts: 128 N - 24 bytes.
#[test]
fn plan_names_the_smallest_n_that_carries_the_traffic() {
    let needed = |frames: u32| {
        let traffic = [FrameStream::to_bus(0, 0, eight(), FrameRate::PerCycle(frames))];
        let adapter = adapter(1).with_cycle(Duration::from_millis(100));
        let plan = PortPlan::of(&adapter, &one_channel(classic()), &traffic);
        let text =
            plan.rejections.iter().map(ToString::to_string).find(|text| text.contains("image"));
        let text = text.unwrap_or_default();
        text.split_once("use N = ")
            .map(|(_, rest)| rest.split_once(',').unwrap().0.parse::<u8>().unwrap())
    };
    for (frames, n) in [(8, None), (9, Some(2)), (19, Some(2)), (20, Some(3)), (30, Some(3))] {
        assert_eq!(needed(frames), n, "{frames} frames");
    }
    assert_eq!((needed(254), needed(255), needed(256)), (Some(24), None, None));
}

#[test]
fn default_n_is_that_of_the_kinds_of_can() {
    let fd = ChannelConfig::fd(1_000_000, 5_000_000);
    let n = |gateway: GatewayConfig| {
        let config = Config::new(Duration::from_millis(10)).with_gateway(gateway);
        let slave = config.adapter.slaves[0];
        (slave.rx_multiplier, slave.tx_multiplier)
    };
    assert_eq!(n(GatewayConfig::on_all_channels(classic())), (3, 3));
    assert_eq!(n(GatewayConfig::on_channel(0, classic()).with_channel(3, fd)), (8, 8));
    assert_eq!(n(GatewayConfig::default()), (3, 3));
}

/// Eight frames of 111 to 135 bits in 1000: 89 to 108 %.
#[test]
fn bus_that_stuff_bits_can_fill_is_rejected() {
    let traffic = [FrameStream::to_bus(0, 0, eight(), FrameRate::PerCycle(8))];
    let plan = PortPlan::of(&adapter(3), &one_channel(classic()), &traffic);
    let [PortPlanError::BusLoad { least_percent: 89, most_percent: 108, .. }] = plan.rejections[..]
    else {
        panic!("{:?}", plan.rejections)
    };
    let text = plan.rejections[0].to_string();
    assert!(text.contains("89 to 108 % of the bus") && text.contains("bit rate"), "{text}");
    // What other nodes tell each other counts, too, and only there.
    let way = FrameRoute::OnBusOnly;
    let plan =
        PortPlan::of(&adapter(3), &one_channel(classic()), &[FrameStream { way, ..traffic[0] }]);
    assert_eq!(plan.rejections.len(), 1);
    assert_eq!(plan.gateways[0].rx.peak, fill(0, 0));
}

#[test]
fn budgets_of_the_service_are_compared_with_the_traffic() {
    // Ten frames in 2 ms are more than a service hands on, though the bus could carry them.
    let adapter = adapter(3).with_cycle(Duration::from_millis(2));
    let sent = |frames| [FrameStream::to_bus(0, 0, eight(), FrameRate::PerCycle(frames))];
    let plan = PortPlan::of(&adapter, &one_channel(classic()), &sent(10));
    assert_eq!(
        plan.rejections,
        [PortPlanError::Budget { slave: 0, channel: 0, received: 0, sent: 10 }]
    );
    // The device's own budgets hand four on.
    let mut settings = classic();
    settings.data_path = Default::default();
    let plan = PortPlan::of(&adapter, &one_channel(settings), &sent(5));
    assert_eq!(plan.rejections, []);
    let [warning] = &plan.warnings[..] else { panic!("{:?}", plan.warnings) };
    let text = warning.to_string();
    assert!(text.contains("5 sent") && text.contains("2 and 4 per service"), "{text}");
    assert!(text.contains("0x8021:05"), "{text}");
    // What the SDK sets for that traffic does.
    let settings = classic().with_traffic(Traffic { received: 0, sent: 5 });
    let plan = PortPlan::of(&adapter, &one_channel(settings), &sent(5));
    assert_eq!((plan.rejections, plan.warnings), (vec![], vec![]));
}

#[test]
fn check_rejects_a_budget_with_the_text_of_the_plan() {
    let settings = classic().with_traffic(Traffic { received: 9, sent: 1 });
    let faults = one_channel(settings).check(&adapter(3)).unwrap_err().0;
    let rejection = PortPlanError::Budget { slave: 0, channel: 0, received: 9, sent: 1 };
    assert_eq!(faults, [PortConfigFault::Plan(rejection)]);
    let plan = PortPlan::of(
        &adapter(3),
        &one_channel(classic()),
        &[
            FrameStream::from_bus(0, 0, eight(), FrameRate::PerCycle(9)),
            FrameStream::to_bus(0, 0, eight(), FrameRate::PerCycle(1)),
        ],
    );
    assert!(plan.rejections.contains(&rejection));
}

#[test]
fn frames_without_a_place_are_rejected_once() {
    let traffic = [
        FrameStream::to_bus(0, 3, eight(), EVERY_CYCLE),
        FrameStream::to_bus(0, 3, eight(), EVERY_CYCLE),
        FrameStream::to_bus(2, 0, eight(), EVERY_CYCLE),
        FrameStream::to_bus(0, 9, eight(), EVERY_CYCLE),
        FrameStream::to_bus(0, 0, fd_frame(8), EVERY_CYCLE),
    ];
    let plan = PortPlan::of(&adapter(3), &one_channel(classic()), &traffic);
    assert_eq!(
        plan.rejections,
        [
            PortPlanError::NoChannel { slave: 0, channel: 3 },
            PortPlanError::NoChannel { slave: 2, channel: 0 },
            PortPlanError::NoChannel { slave: 0, channel: 9 },
            PortPlanError::NotFd { slave: 0, channel: 0 },
        ]
    );
}

#[test]
fn findings_of_the_ethercat_side_are_among_those_of_the_whole() {
    let plan = PortPlan::of(&adapter(12), &one_channel(classic()), &[]);
    assert!(matches!(
        plan.rejections[..],
        [
            PortPlanError::EtherCat(PlanError::LargePdo { pdo: "RxPDO", .. }),
            PortPlanError::EtherCat(PlanError::LargePdo { pdo: "TxPDO", .. })
        ]
    ));
}

#[test]
fn configurations_that_do_not_match_have_a_plan_all_the_same() {
    let mut adapter = AdapterConfig::new(3).with_cycle(Duration::ZERO);
    adapter.slaves[0].rx_multiplier = 0;
    adapter.slaves[1].tx_multiplier = 255;
    let stream = FrameStream::to_bus(1, 0, eight(), FrameRate::PerCycle(u32::MAX));
    let plan = PortPlan::of(&adapter, &PortConfig::default(), &[stream, stream]);
    assert!(plan.gateways.is_empty() && !plan.rejections.is_empty());
    let plan = PortPlan::of(&adapter, &one_channel(classic()), &[]);
    assert_eq!(plan.gateways.len(), 1);
}

// Against the simulated gateway

/// The Port takes as many frames into one image as the plan says, and not one more.
#[test]
fn image_takes_the_frames_of_the_plan() {
    let empty_fd = fd_frame(0);
    let cases = [(1, eight()), (3, eight()), (2, fd_frame(64)), (3, fd_frame(20)), (8, empty_fd)];
    for (multiplier, frame) in cases {
        for options in [OptionFlags::NONE, OptionFlags::ALIGN4] {
            let settings = ChannelConfig::fd(500_000, 2_000_000);
            let mut gateway = GatewayConfig::on_channel(0, settings);
            gateway.rx_options = options;
            gateway.paced = false;
            let config = PortConfig::uniform(1, gateway);
            let planned = PortPlan::of(&adapter(multiplier), &config, &[]).gateways[0]
                .rx
                .frames_per_image(frame.as_ref(), false);
            let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(multiplier), config);
            let mut taken = 0;
            fixture.cycle(|cycle| {
                let can0 = cycle.ch(0, 0);
                while cycle.send(can0, &frame).is_ok() {
                    taken += 1;
                }
                let full = cycle.send(can0, &frame);
                assert!(matches!(full, Err(SendError::Backpressure { .. })), "{full:?}");
            });
            assert_eq!(taken, planned, "N = {multiplier}, {frame:?}, {options}");
        }
    }
}

/// What the simulated bus measures to the bit lies between the bounds of the plan.
#[test]
fn measured_load_lies_within_the_planned_one() {
    let settings = ChannelConfig::fd(500_000, 2_000_000);
    let frames = [eight(), frame(0, &[0; 8]), fd_frame(32), frame(0x7FF, &[])];
    for sample in frames {
        // Every frame comes back from the echo node.
        let traffic = [
            FrameStream::to_bus(0, 0, sample, EVERY_CYCLE),
            FrameStream::from_bus(0, 0, sample, EVERY_CYCLE),
        ];
        let config = one_channel(settings);
        let load = PortPlan::of(&adapter(3), &config, &traffic).channels[0].load;
        let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter(3), config);
        let busy = |fixture: &Fixture| {
            fixture.simulation.with_world(|world| world.bus("0.0").unwrap().statistics())
        };
        let send = |fixture: &mut Fixture| {
            fixture.cycle(|cycle| {
                cycle.send(cycle.ch(0, 0), &sample).unwrap();
            });
        };
        for _ in 0..20 {
            send(&mut fixture);
        }
        let before = busy(&fixture);
        for _ in 0..500 {
            send(&mut fixture);
        }
        let measured = busy(&fixture);
        assert_eq!(measured.frames - before.frames, 1_000);
        let share = (measured.busy_ns - before.busy_ns) as f64 / 500e6;
        assert!(load.least - 1e-6 <= share && share <= load.most + 1e-6, "{share}: {load:?}");
    }
}
