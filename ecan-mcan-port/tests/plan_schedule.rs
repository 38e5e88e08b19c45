//! Scheduled frames and the Sync0 shift in the preflight plan of a Port: figures worked out by hand, and
//! against the simulated gateway.

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic};
use crate::plan_support::{EVERY_CYCLE, adapter, eight, one_channel};
use ecan_host::{AdapterConfig, DcSync, PlanWarning};
use ecan_mcan_port::{
    FrameRate, FrameStream, GatewayConfig, MarginCheck, NotSchedulable, PortConfig, PortPlan,
    PortPlanError, PortWarning, SendError,
};
use ecan_protocol::can::CanId;
use ecan_protocol::image::Schedule;

/// Two clock datagrams with N = 3: the image is there 67.2 us after the send at the latest, and
/// not before its own 384 bytes, 30.72 us; 100 us until the send and 30 us through the host come
/// on top, then 50 us in the firmware.
fn with_sync0(shift_ns: u32) -> AdapterConfig {
    let mut adapter = adapter(3);
    adapter.dc = Some(DcSync {
        monitor_every: 0,
        ..DcSync::new(Duration::from_millis(1), Duration::from_nanos(shift_ns.into()))
    });
    adapter
}

fn scheduled(adapter: &AdapterConfig, config: &PortConfig, offset_ns: u32) -> PortPlan {
    let stream = FrameStream::to_bus(0, 0, eight(), EVERY_CYCLE).scheduled(offset_ns);
    PortPlan::of(adapter, config, &[stream])
}

#[test]
fn scheduled_frames_have_a_margin() {
    let mut config = one_channel(classic());
    let plan = scheduled(&with_sync0(700_000), &config, 100_000);
    assert_eq!((&plan.rejections[..], &plan.warnings[..]), (&[][..], &[][..]));
    let margin = plan.schedule_margin(0, 100_000).unwrap();
    assert_eq!((margin.earliest_arrival_ns, margin.latest_arrival_ns), (30_720, 142_200));
    assert_eq!((margin.pulse_ns, margin.release_ns), (700_000, 800_000));
    assert_eq!((margin.after_pulse_ns, margin.before_pulse_ns), (330_720, 557_800));
    assert_eq!((margin.before_release_ns, margin.least_ns()), (607_800, 330_720));
    let none = plan.schedule_margin(1, 100_000);
    assert_eq!(none, Err(NotSchedulable::NotSupported), "there is no slave 1");
    // An application that works for 600 us before it sends cuts it fine: 697.2 us.
    config.gateways[0].schedule.latest_send_ns = 600_000;
    let plan = scheduled(&with_sync0(700_000), &config, 50_000);
    let margin = plan.schedule_margin(0, 50_000).unwrap();
    assert_eq!((margin.before_pulse_ns, margin.before_release_ns), (2_800, 2_800));
    let thin = PortWarning::ThinMargin { slave: 0, offset_ns: 50_000, margin };
    assert!(thin.to_string().contains("margin 2.8 us: image in the gateway"), "{thin}");
    let small = PortWarning::SmallOffset { offset_ns: 50_000 };
    assert!(small.to_string().contains("50.0 us") && small.to_string().contains("with 100 us"));
    // The pulse comes while the firmware still has the image to process.
    let unread = PortWarning::EtherCat(PlanWarning::Sync0Shift {
        shift_ns: 700_000,
        lacking_ns: 47_200,
        best_ns: Some(888_000),
    });
    assert_eq!((plan.rejections, plan.warnings), (vec![], vec![unread, thin, small]));
}

#[test]
fn schedules_are_judged() {
    let config = one_channel(classic());
    let rejected = |adapter: &AdapterConfig, offset_ns| {
        let rejections = scheduled(adapter, &config, offset_ns).rejections;
        let [PortPlanError::NotSchedulable { slave: 0, offset_ns: reported, reason }] =
            rejections[..]
        else {
            panic!("{rejections:?}")
        };
        assert_eq!(reported, offset_ns);
        (reason, rejections[0].to_string())
    };
    let (reason, text) = rejected(&adapter(3), 100_000);
    assert_eq!(reason, NotSchedulable::NoSync0);
    assert!(text.contains("100.0 us after Sync0") && text.contains("send frames at once"));
    let (reason, text) = rejected(&with_sync0(700_000), 1_000_000);
    assert_eq!(reason, NotSchedulable::BeyondPeriod { sync0_ns: 1_000_000 });
    assert!(text.contains("not below the Sync0 period of 1000.0 us"), "{text}");
    // Four frames of at most 135 us from 600 us on end at 1140 us.
    let four = FrameStream::to_bus(0, 0, eight(), FrameRate::PerCycle(4));
    let plan = |offset_ns| {
        PortPlan::of(&with_sync0(700_000), &config, &[four.scheduled(offset_ns)]).warnings
    };
    assert_eq!(plan(100_000), []);
    let overruns = PortWarning::ScheduleOverruns {
        slave: 0,
        channel: 0,
        offset_ns: 600_000,
        frames_ns: 540_000,
        sync0_ns: 1_000_000,
    };
    assert_eq!(plan(600_000), [overruns]);
}

/// With Sync0 every fourth cycle the frames of four cycles meet.
#[test]
fn frames_of_all_cycles_of_a_sync0_period_meet_at_its_pulse() {
    let config = one_channel(classic());
    let mut adapter = adapter(3);
    adapter.dc = Some(DcSync::new(Duration::from_millis(4), Duration::from_micros(700)));
    let plan = |rate, offset_ns| {
        let stream = FrameStream::to_bus(0, 0, eight(), rate).scheduled(offset_ns);
        PortPlan::of(&adapter, &config, &[stream]).warnings
    };
    let overruns = |offset_ns, frames_ns| PortWarning::ScheduleOverruns {
        slave: 0,
        channel: 0,
        offset_ns,
        frames_ns,
        sync0_ns: 4_000_000,
    };
    // Of at most 135 us each.
    assert_eq!(plan(FrameRate::PerCycle(4), 100_000), []);
    assert_eq!(plan(FrameRate::PerCycle(4), 2_000_000), [overruns(2_000_000, 2_160_000)]);
    assert_eq!(plan(FrameRate::EveryCycles(3), 3_700_000), []);
    assert_eq!(plan(FrameRate::EveryCycles(3), 3_750_000), [overruns(3_750_000, 270_000)]);
    let crowded = PortWarning::ScheduleCrowded { slave: 0, frames: 80, depth: 64 };
    let reported = plan(FrameRate::PerCycle(20), 100_000);
    assert!(reported.contains(&crowded), "{reported:?}");
    assert!(crowded.to_string().contains("80 scheduled frames wait for one Sync0 pulse"));
    assert!(
        !plan(FrameRate::PerCycle(16), 100_000)
            .iter()
            .any(|warning| { matches!(warning, PortWarning::ScheduleCrowded { .. }) })
    );
}

/// Arrivals until 142.2 us and 50 us of processing; the times of each gateway move their end.
#[test]
fn sync0_margin_follows_the_times_of_the_gateways() {
    let mut config = one_channel(classic());
    let adapter = with_sync0(175_000);
    let sync0 = |config: &PortConfig| {
        let plan = PortPlan::of(&adapter, config, &[]);
        let latest_ns = plan.ethercat.output_arrivals().unwrap().latest_ns;
        assert_eq!(plan.warnings.len(), usize::from(config.sync0_warning(&adapter).is_some()));
        (latest_ns, config.sync0_warning(&adapter))
    };
    let lacking = |lacking_ns, best_ns| {
        let best_ns = Some(best_ns);
        Some(PlanWarning::Sync0Shift { shift_ns: 175_000, lacking_ns, best_ns })
    };
    assert_eq!(sync0(&config), (192_200, lacking(17_200, 611_000)));
    config.gateways[0].schedule.processing_ns = 30_000;
    assert_eq!(sync0(&config), (172_200, None));
    config.gateways[0].schedule.latest_send_ns = 150_000;
    assert_eq!(sync0(&config), (277_200, lacking(102_200, 653_000)));
    config.gateways[0].schedule.transport_ns = 0;
    assert_eq!(sync0(&config).0, 247_200);
}

/// A pulse at 100 us, images until 142.2 us: what is counted by default is rejected on wish.
#[test]
fn short_margin_is_warned_of_or_rejected_as_in_the_port() {
    let mut config = one_channel(classic());
    let adapter = with_sync0(100_000);
    let (offset_ns, lacking_ns) = (100_000, 42_200);
    let counted = scheduled(&adapter, &config, offset_ns);
    let short = PortWarning::NoMargin { slave: 0, offset_ns, lacking_ns };
    assert!(short.to_string().contains("short by 42.2 us"), "{short}");
    // Whether frames are scheduled or not.
    let among_arrivals = PortWarning::EtherCat(PlanWarning::Sync0Shift {
        shift_ns: 100_000,
        lacking_ns: 69_280,
        best_ns: Some(611_000),
    });
    assert_eq!((counted.rejections, counted.warnings), (vec![], vec![among_arrivals, short]));
    config.gateways[0].schedule.margin_check = MarginCheck::Reject;
    let rejected = scheduled(&adapter, &config, offset_ns);
    let reason = NotSchedulable::NoMargin { lacking_ns };
    let expected = PortPlanError::NotSchedulable { slave: 0, offset_ns, reason };
    assert!(expected.to_string().contains("short by 42.2 us; move the Sync0 shift"), "{expected}");
    assert_eq!((rejected.rejections, rejected.warnings), (vec![expected], vec![among_arrivals]));
}

/// Plan and Port reckon alike, and what one takes the other takes.
#[test]
fn port_has_the_margins_of_the_plan() {
    for shift_us in [0, 30, 150, 210, 230, 700] {
        let mut adapter =
            AdapterConfig::new(2).with_multiplier(3).with_cycle(Duration::from_millis(1));
        adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(shift_us)));
        let mut gateway = GatewayConfig::on_channel(0, classic());
        gateway.schedule.margin_check = MarginCheck::Reject;
        let config = PortConfig::uniform(2, gateway);
        // Some shifts are among the arrivals, where a gateway with the window would leave OP.
        let mut fixture =
            Fixture::ready(crate::common::without_sync0_window(ecan_sim::echo(2)), adapter, config);
        for (slave, offset_ns) in [0, 1]
            .into_iter()
            .flat_map(|slave| [0, 20_000, 60_000, 999_999, 1_000_000].map(|ns| (slave, ns)))
        {
            let stream = FrameStream::to_bus(slave, 0, eight(), EVERY_CYCLE).scheduled(offset_ns);
            let plan = PortPlan::of(&adapter, &config, &[stream]);
            let planned = plan.schedule_margin(slave, offset_ns);
            assert_eq!(planned, fixture.port.schedule_margin(fixture.port.gw(slave), offset_ns));
            let mut sent = None;
            fixture.cycle(|cycle| {
                let at = Schedule { tag: 0, offset_ns };
                sent = Some(cycle.schedule_can(slave, 0, crate::common::id(1), &[], at).map(drop));
            });
            let expected = match plan.rejections[..] {
                [] => Ok(()),
                [PortPlanError::NotSchedulable { slave, offset_ns, reason }] => {
                    Err(SendError::NotSchedulable { slave, offset_ns, reason })
                }
                _ => panic!("{:?}", plan.rejections),
            };
            assert_eq!(sent, Some(expected), "shift {shift_us} us, offset {offset_ns} ns");
            assert_eq!(
                plan.rejections.is_empty(),
                planned.is_ok_and(|margin| margin.is_sufficient())
            );
        }
    }
}

/// The simulated gateway releases scheduled frames when the plan says, to the microsecond.
#[test]
fn scheduled_frames_leave_when_the_plan_says() {
    for (shift_us, offset_us) in [(500, 100), (700, 100), (700, 350), (900, 0)] {
        let mut adapter = adapter(3);
        adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(shift_us)));
        let config = one_channel(classic());
        let offset_ns = offset_us * 1_000;
        let plan = PortPlan::of(&adapter, &config, &[]);
        let planned = plan.schedule_margin(0, offset_ns).unwrap().release_ns;
        let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
        fixture.cycle(|port| {
            let schedule = Schedule { tag: 1, offset_ns };
            port.schedule_can(0, 0, CanId::standard(1).unwrap(), &[1], schedule).unwrap();
        });
        let released = |fixture: &Fixture| {
            fixture.simulation.with_world(|world| world.counters(0).unwrap().frames_released)
        };
        let mut passed_us = 0;
        while released(&fixture) == 0 {
            assert!(passed_us < 3_000, "it never left");
            fixture.simulation.pass_ns(1_000);
            passed_us += 1;
        }
        assert_eq!(passed_us * 1_000, planned, "shift {shift_us} us, offset {offset_us} us");
    }
}
