//! What the Port says of scheduled frames against what really happened in the gateway
//! (manual 8.4, 10, 13.7).
#![allow(missing_docs)]

mod common;

use common::{Bench, id, with_sync0};
use ecan_mcan_port::{
    GatewayConfig, MarginCheck, NoRoom, NotSchedulable, Received, ScheduleAccount, SendError,
};
use ecan_protocol::{OptionFlags, Schedule};
use ecan_sim::{Fault, GatewayFault, LostWay, Scenario, Truth, echo};

/// Phases at which frames leave, 500 us behind the start of the cycle: the images come long before.
const SHIFT_NS: u32 = 500_000;
const OFFSET_NS: u32 = 100_000;

fn results(gateway: &mut GatewayConfig) {
    gateway.tx_options = OptionFlags::TX_RESULT;
}

fn truth(bench: &Bench) -> Truth {
    bench.simulation.with_world(|world| world.truth(0).unwrap())
}

fn account(bench: &Bench) -> ScheduleAccount {
    bench.port.schedule_account(0, 0)
}

/// One cycle that schedules so many frames; gives how many were taken.
fn schedule(bench: &mut Bench, frames: u16, offset_ns: u32) -> u16 {
    let mut taken = 0;
    bench.cycle(|port| {
        for tag in 0..frames {
            let at = Schedule { tag, offset_ns };
            taken += u16::from(port.schedule_can(0, 0, id(0x100 + tag), &[], at).is_ok());
        }
    });
    taken
}

/// Compares the account with the truth once nothing is open any more: each kind of outcome may
/// hide among the unknown ones, none may be claimed that did not happen.
fn check(bench: &mut Bench) -> (ScheduleAccount, Truth) {
    bench.idle(500);
    let (told, truth) = (account(bench), truth(bench));
    assert_eq!(told.accounted(), told.scheduled, "{told:?}");
    assert_eq!(told.open, 0, "{told:?}");
    let losses = truth.transmit_losses;
    let refused = losses.bus_off + losses.invalid_channel;
    for (told_of, happened) in [
        (told.sent, truth.frames_released),
        (told.late_dropped, losses.late),
        (told.queue_full, losses.schedule_full),
        (told.not_sent, refused),
    ] {
        assert!(told_of <= happened, "{told:?} {truth:?}");
        assert!(happened <= told_of + told.unknown, "{told:?} {truth:?}");
    }
    // Stale are frames that still waited, and those that the controller had got already.
    let ended = truth.frames_released + losses.late + losses.schedule_full + refused;
    let ended = ended + losses.schedule_failed;
    assert!(ended <= truth.frames_parsed, "{truth:?}");
    assert!(truth.frames_parsed <= ended + losses.stale, "every frame ended somehow: {truth:?}");
    assert!(told.scheduled - told.withdrawn >= truth.frames_parsed, "{told:?} {truth:?}");
    (told, truth)
}

#[test]
fn every_frame_is_sent_with_and_without_results() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut bench = with_sync0(echo(1), SHIFT_NS, change);
        for _ in 0..300 {
            assert_eq!(schedule(&mut bench, 2, OFFSET_NS), 2);
        }
        let (told, truth) = check(&mut bench);
        assert_eq!((told.scheduled, told.sent, truth.frames_released), (600, 600, 600));
        let diagnostics = bench.port.schedule_diagnostics(0).unwrap();
        assert_eq!(diagnostics.flags, 0);
        assert!(diagnostics.sync0_count > 300 && diagnostics.service_max_cycles > 0);
        assert!(diagnostics.phase_min_cycles > 0, "{diagnostics:?}");
        assert_eq!(bench.cycle_errors, []);
    }
}

#[test]
fn results_bring_the_tag_of_their_frame() {
    let mut bench = with_sync0(echo(1), SHIFT_NS, results);
    let mut tickets = Vec::new();
    let mut items = bench.cycle(|port| {
        for tag in [7, 9] {
            let at = Schedule { tag, offset_ns: OFFSET_NS };
            tickets.push((port.schedule_can(0, 0, id(tag), &[], at).unwrap(), Some(tag)));
        }
        tickets.push((port.send_can(0, 0, id(1), &[]).unwrap(), None));
    });
    items.extend(bench.idle(5));
    let told: Vec<_> = items
        .iter()
        .filter_map(|item| match item {
            Received::TransmitReport(report) => {
                assert!(report.code.is_success() && !report.is_late_drop());
                Some((report.ticket.unwrap(), report.schedule_tag))
            }
            Received::Frame(_) => None,
        })
        .collect();
    assert_eq!(told, tickets);
}

/// A service that comes so late that phases have passed: results name each frame.
fn stalled(change: fn(&mut GatewayConfig)) -> Bench {
    let mut bench = with_sync0(echo(1), SHIFT_NS, change);
    for nth in 0..200 {
        if nth == 100 {
            let fault = GatewayFault::ServiceStall { ms: 2 };
            bench.simulation.inject(Fault::Gateway { gateway: 0, fault });
        }
        schedule(&mut bench, 3, OFFSET_NS);
    }
    bench
}

#[test]
fn late_frames_are_dropped_and_told_by_results() {
    let mut bench = stalled(results);
    let (told, truth) = check(&mut bench);
    assert!(truth.transmit_losses.late > 0, "{truth:?}");
    assert_eq!(told.late_dropped, truth.transmit_losses.late);
    assert_eq!(told.sent, truth.frames_released);
    assert!(bench.port.schedule_diagnostics(0).unwrap().has_late_drop());
}

#[test]
fn without_results_a_flag_makes_frames_unknown_until_it_is_cleared() {
    let mut bench = stalled(|_| ());
    let (told, truth) = check(&mut bench);
    assert!(truth.transmit_losses.late > 0 && told.unknown > 0 && told.sent < 600, "{told:?}");
    schedule(&mut bench, 1, OFFSET_NS);
    assert_eq!(check(&mut bench).0.unknown, told.unknown + 1, "the flag stays");
    bench.port.clear_schedule_flags(0);
    bench.idle(50);
    for _ in 0..10 {
        schedule(&mut bench, 1, OFFSET_NS);
    }
    let after = check(&mut bench).0;
    assert_eq!((after.unknown, after.sent), (told.unknown + 1, told.sent + 10));
    assert_eq!(bench.port.schedule_diagnostics(0).unwrap().flags, 0);
}

#[test]
fn a_full_schedule_is_told() {
    let mut bench = with_sync0(echo(1), SHIFT_NS, |gateway| {
        results(gateway);
        gateway.paced = false;
    });
    let bits = |n: u64| n > 0;
    // An image of N = 3 holds less than the schedule, so two Sync0 periods of it would be needed.
    let mut adapter = bench.port.adapter().config().clone();
    adapter = adapter.with_multiplier(8);
    let config = bench.port.config().clone();
    bench.port.reconfigure(adapter, config).unwrap();
    bench.port.wait_ready(common::READY_MS).unwrap();
    let taken = schedule(&mut bench, 100, OFFSET_NS);
    assert!(taken > 64);
    let (told, truth) = check(&mut bench);
    assert!(bits(truth.transmit_losses.schedule_full), "{truth:?}");
    assert_eq!(told.queue_full, truth.transmit_losses.schedule_full);
    let diagnostics = bench.port.schedule_diagnostics(0).unwrap();
    assert!(diagnostics.has_queue_full(), "{diagnostics:?}");
    // More at a phase than the controller holds: the flags do not name the frames.
    assert!(!bits(truth.transmit_losses.schedule_failed) || told.unknown > 0, "{told:?}");
}

#[test]
fn lost_images_leave_unknown_frames_and_none_is_sent_late() {
    for way in [LostWay::Outward, LostWay::Return] {
        for change in [results as fn(&mut GatewayConfig), |_| ()] {
            let mut bench = with_sync0(echo(1), SHIFT_NS, change);
            bench.simulation.with_world(|world| world.record_bus_of(0, 0));
            for nth in 0..200_u32 {
                if nth % 20 == 10 {
                    bench.simulation.inject(Fault::LostFrame { way, cycles: 1 + nth / 60 });
                }
                schedule(&mut bench, 1, OFFSET_NS);
            }
            let (told, truth) = check(&mut bench);
            assert!(told.unknown > 0, "{way:?} {told:?}");
            assert!(told.sent + told.unknown == 200, "{told:?} {truth:?}");
            // One frame a cycle, so two in one would be one that was sent late.
            let frames = bench.simulation.with_world(|world| world.take_recorded());
            let sent: Vec<_> = frames.iter().filter(|f| f.is_from_channel).collect();
            assert_eq!(sent.len() as u64, truth.frames_released);
            for pair in sent.windows(2) {
                let period = pair[1].start_ns - pair[0].start_ns;
                assert!(period > 900_000, "{way:?}: {period}");
            }
        }
    }
}

#[test]
fn a_channel_that_goes_off_the_bus_is_told() {
    let mut bench = with_sync0(echo(1), SHIFT_NS, |gateway| {
        results(gateway);
        gateway.paced = false;
    });
    for nth in 0..300 {
        if nth == 100 {
            bench.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
        }
        schedule(&mut bench, 2, OFFSET_NS);
    }
    let (told, truth) = check(&mut bench);
    assert!(truth.transmit_losses.bus_off > 0, "{truth:?}");
    assert_eq!(told.not_sent, truth.transmit_losses.bus_off);
    assert!(bench.port.schedule_diagnostics(0).unwrap().channels[0].bus_offs > 0);
}

#[test]
fn a_lost_gateway_leaves_nothing_open() {
    let mut bench = with_sync0(echo(1), SHIFT_NS, results);
    for nth in 0..100 {
        if nth == 50 {
            bench.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
        }
        schedule(&mut bench, 2, OFFSET_NS);
    }
    assert!(bench.until(20_000, |port| port.is_ready()).is_some());
    for _ in 0..100 {
        schedule(&mut bench, 2, OFFSET_NS);
    }
    let (told, _) = check(&mut bench);
    assert!(told.unknown > 0 && told.sent >= 200, "{told:?}");
}

/// A machine that now and then wakes up behind the pulse.
fn sluggish() -> Scenario {
    let mut scenario = ecan_sim::jitter(1);
    let wake_up =
        ecan_sim::WakeUpDelay { typical_ns: 20_000, p99_ns: 400_000, longest_ns: 900_000 };
    scenario.wake_up = Some(wake_up);
    scenario
}

#[test]
fn a_cycle_that_begins_behind_the_pulse_is_refused_and_never_sent_late() {
    let mut bench = with_sync0(sluggish(), 300_000, results);
    bench.simulation.with_world(|world| world.record_bus_of(0, 0));
    let mut sent = 0;
    for _ in 0..2_000 {
        bench.cycle(|port| {
            let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
            match port.schedule_can(0, 0, id(1), &[], at) {
                Ok(_) => sent += 1,
                Err(SendError::NoRoom { what: NoRoom::Phase, .. }) => {}
                Err(error) => panic!("{error}"),
            }
        });
    }
    let (told, truth) = check(&mut bench);
    assert!(told.refused_late > 10, "{told:?}");
    assert_eq!((told.scheduled, told.refused_late), (sent, 2_000 - sent));
    assert_eq!((truth.frames_released, told.sent), (sent, sent), "{truth:?}");
    let frames = bench.simulation.with_world(|world| world.take_recorded());
    let sent: Vec<_> = frames.iter().filter(|f| f.is_from_channel).collect();
    for pair in sent.windows(2) {
        let period = pair[1].start_ns - pair[0].start_ns;
        let nearest = (period + 500_000) / 1_000_000;
        assert!(nearest >= 1 && period.abs_diff(nearest * 1_000_000) <= 13_000, "{period}");
    }
}

#[test]
fn an_application_that_takes_too_long_withdraws_what_would_be_late() {
    let mut bench = with_sync0(echo(1), 300_000, results);
    let clock = bench.port.adapter().ecrt().clock().clone();
    for nth in 0..50 {
        bench.cycle(|port| {
            let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
            port.schedule_can(0, 0, id(1), &[], at).unwrap();
            if nth % 10 == 0 {
                clock.sleep_until_ns(clock.now_ns() + 400_000);
            }
        });
    }
    let (told, truth) = check(&mut bench);
    assert_eq!((told.withdrawn, told.sent, truth.frames_released), (5, 45, 45));
}

#[test]
fn the_margin_is_told_counted_or_demanded() {
    let mut bench = with_sync0(echo(1), 120_000, results);
    let margin = bench.port.schedule_margin(0, OFFSET_NS).unwrap();
    assert!(!margin.is_sufficient(), "{margin}");
    assert!(margin.to_string().starts_with("margin -"), "{margin}");
    schedule(&mut bench, 1, OFFSET_NS);
    assert_eq!(check(&mut bench).0.without_margin, 1);
    let mut bench = with_sync0(echo(1), 120_000, |gateway| {
        gateway.schedule.margin_check = MarginCheck::Refuse;
    });
    bench.cycle(|port| {
        let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
        let refused = port.schedule_can(0, 0, id(1), &[], at).unwrap_err();
        let SendError::NotSchedulable { reason: NotSchedulable::NoMargin { lacking_ns }, .. } =
            refused
        else {
            panic!("{refused}");
        };
        assert_eq!(i64::try_from(lacking_ns).unwrap(), -margin.least_ns());
        assert!(refused.to_string().contains("move the Sync0 shift"), "{refused}");
    });
    let bench = with_sync0(echo(1), SHIFT_NS, |_| ());
    assert!(bench.port.schedule_margin(0, OFFSET_NS).unwrap().is_sufficient());
    let beyond = bench.port.schedule_margin(0, 1_000_000);
    assert_eq!(beyond, Err(NotSchedulable::BeyondPeriod { sync0_ns: 1_000_000 }));
}

/// A pulse within the time that an image needs through the host and on the wire: without a margin,
/// but frames are taken and sent, as is promised where margins are only counted.
#[test]
fn a_pulse_within_the_way_of_the_images_refuses_no_frame() {
    for shift_ns in [31_000, 50_000, 95_000] {
        let mut bench = with_sync0(echo(1), shift_ns, results);
        assert!(bench.port.schedule_margin(0, OFFSET_NS).unwrap().after_pulse_ns < 0);
        for _ in 0..100 {
            assert_eq!(schedule(&mut bench, 1, OFFSET_NS), 1, "shift {shift_ns}");
        }
        let (told, _) = check(&mut bench);
        assert_eq!((told.without_margin, told.sent, told.refused_late), (100, 100, 0));
    }
}

#[test]
fn an_image_with_other_frames_is_held_and_takes_no_scheduled_one_meanwhile() {
    let mut bench = with_sync0(echo(1), SHIFT_NS, results);
    bench.simulation.inject(Fault::LostFrame { way: LostWay::Outward, cycles: 2 });
    bench.cycle(|port| {
        port.send_can(0, 0, id(1), &[]).unwrap();
        let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
        port.schedule_can(0, 0, id(2), &[], at).unwrap();
    });
    let mut refused = 0;
    while refused < 2 {
        bench.cycle(|port| {
            assert!(port.cycle_report(0).is_holding);
            let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
            let error = port.schedule_can(0, 0, id(3), &[], at).unwrap_err();
            assert!(matches!(error, SendError::NoRoom { what: NoRoom::Phase, .. }), "{error}");
        });
        refused += 1;
    }
    assert_eq!(schedule(&mut bench, 1, OFFSET_NS), 1, "it arrived");
    bench.idle(500);
    let (told, truth) = (account(&bench), truth(&bench));
    // The first one left two periods late.
    assert_eq!((told.refused_late, told.scheduled), (2, 2));
    assert_eq!((told.sent, told.unknown), (1, 1));
    assert_eq!(
        (truth.frames_released, truth.frames_on_bus),
        (2, 3),
        "no frame to be sent at once was lost"
    );
}

/// Images with frames of both kinds that are published again: what left may have left late.
#[test]
fn a_repeated_image_is_never_told_as_sent() {
    for way in [LostWay::Outward, LostWay::Return] {
        for change in [results as fn(&mut GatewayConfig), |_| ()] {
            let mut bench = with_sync0(echo(1), SHIFT_NS, change);
            bench.simulation.inject(Fault::LostFrame { way, cycles: 3 });
            bench.cycle(|port| {
                let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
                port.schedule_can(0, 0, id(2), &[], at).unwrap();
                port.send_can(0, 0, id(1), &[]).unwrap();
            });
            bench.idle(500);
            let (told, truth) = (account(&bench), truth(&bench));
            assert_eq!((told.sent, told.unknown, told.open), (0, 1, 0), "{way:?}");
            assert_eq!((truth.frames_released, truth.frames_on_bus), (1, 2));
        }
    }
}

/// Frames to be sent at once leave in a late cycle, too, with their own results; scheduled ones
/// beside them do not.
#[test]
fn a_late_cycle_takes_scheduled_frames_out_of_an_image_with_others() {
    for has_results in [true, false] {
        let change = if has_results { results } else { |_: &mut GatewayConfig| () };
        let mut bench = with_sync0(echo(1), 300_000, change);
        let clock = bench.port.adapter().ecrt().clock().clone();
        let mut tickets = Vec::new();
        let mut items = Vec::new();
        for nth in 0..20_u8 {
            items.extend(bench.cycle(|port| {
                let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
                port.schedule_can(0, 0, id(1), &[], at).unwrap();
                tickets.push(port.send_can(0, 0, id(2), &[nth; 8]).unwrap());
                port.schedule_can(0, 0, id(3), &[9], at).unwrap();
                let long = ecan_protocol::CanId::extended(0x1234).unwrap();
                tickets.push(port.send_can(0, 0, long, &[nth; 3]).unwrap());
                if nth % 2 == 0 {
                    clock.sleep_until_ns(clock.now_ns() + 400_000);
                }
            }));
        }
        items.extend(bench.idle(500));
        let (told, truth) = (account(&bench), truth(&bench));
        assert_eq!((told.scheduled, told.withdrawn, told.sent), (40, 20, 20));
        assert_eq!((truth.frames_released, truth.frames_on_bus), (20, 60));
        let mut sent_at_once = Vec::new();
        let mut ended = Vec::new();
        for item in &items {
            match item {
                Received::Frame(frame) if frame.frame.data().len() >= 3 => {
                    sent_at_once.push((frame.frame.data().len(), frame.frame.data()[0]));
                }
                Received::TransmitReport(report) if report.schedule_tag.is_none() => {
                    ended.push(report.ticket.unwrap());
                }
                _ => {}
            }
        }
        let expected: Vec<_> = (0..20).flat_map(|nth| [(8, nth), (3, nth)]).collect();
        assert_eq!(sent_at_once, expected);
        tickets.retain(|_| has_results);
        assert_eq!(ended, tickets);
        let statistics = bench.port.statistics(0);
        assert_eq!(statistics.channels[0].frames_discarded, 20);
        assert_eq!(statistics.channels[0].frames_delivered, 60);
    }
}

/// Sync0 of 4 ms with cycles of 1 ms: one cycle in four has a pulse.
fn with_long_sync0(shift_ns: u32, change: fn(&mut GatewayConfig)) -> Bench {
    let mut bench = with_sync0(echo(1), SHIFT_NS, change);
    let mut adapter = bench.port.adapter().config().clone();
    adapter.dc = Some(ecan_host::DcSync::new(4_000_000, shift_ns));
    let config = bench.port.config().clone();
    bench.port.reconfigure(adapter, config).unwrap();
    bench.port.wait_ready(common::READY_MS).unwrap();
    bench
}

/// Where a look at the flags takes longer than the interval between looks, and Sync0 is long, frames
/// wait for a look behind their phase: more at a phase than the controller holds are never told as
/// sent.
#[test]
fn a_look_before_the_phase_tells_nothing() {
    let mut failed = 0;
    for nth in 0..40 {
        let mut adapter = ecan_host::AdapterConfig::new(1).with_cycle_us(10_000).with_multiplier(8);
        adapter.dc = Some(ecan_host::DcSync::new(100_000_000, 5_000_000));
        let mut gateway = GatewayConfig::on_channel(0, common::classic());
        results(&mut gateway);
        gateway.paced = false;
        let config = ecan_mcan_port::PortConfig::uniform(1, gateway);
        let mut bench = Bench::ready(echo(1), adapter, config);
        // The looks begin with the first frame.
        assert_eq!(schedule(&mut bench, 1, OFFSET_NS), 1);
        bench.idle(nth);
        let taken = schedule(&mut bench, 60, 90_000_000);
        assert!(taken > 40);
        let (told, truth) = check(&mut bench);
        let happened = truth.transmit_losses.schedule_failed;
        assert!(told.unknown >= u64::from(taken), "{nth} {told:?}");
        failed += happened;
    }
    assert!(failed > 400, "{failed}");
}

/// A cycle that ends behind the time at which a pulse stands misses one only where there is one.
#[test]
fn only_the_cycle_with_the_pulse_can_miss_it() {
    let mut bench = with_long_sync0(300_000, results);
    bench.simulation.with_world(|world| world.record_bus_of(0, 0));
    let clock = bench.port.adapter().ecrt().clock().clone();
    for _ in 0..400 {
        bench.cycle(|port| {
            let point_ns = port.adapter().cycle_time_ns();
            let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
            port.schedule_can(0, 0, id(1), &point_ns.to_le_bytes(), at).unwrap();
            clock.sleep_until_ns(clock.now_ns() + 250_000);
        });
    }
    bench.idle(500);
    let (told, truth) = (account(&bench), truth(&bench));
    assert_eq!((told.scheduled, told.withdrawn, told.sent), (400, 100, 300));
    assert_eq!(truth.frames_released, 300);
    let frames = bench.simulation.with_world(|world| world.take_recorded());
    for frame in frames.iter().filter(|it| it.is_from_channel) {
        let point_ns = u64::from_le_bytes(*frame.frame.data().first_chunk().unwrap());
        let waited_ns = frame.start_ns - point_ns;
        // Three share a pulse, and the bus with their echoes.
        assert!((1_400_000..4_400_000).contains(&waited_ns), "{waited_ns} ns");
    }
}

/// A lost image that goes out again before its pulse is as good as new.
#[test]
fn a_repeat_that_meets_the_same_pulse_loses_nothing() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut bench = with_long_sync0(SHIFT_NS, change);
        let mut outcomes = Vec::new();
        for _ in 0..4 {
            let (before, released) = (account(&bench), truth(&bench).frames_released);
            for nth in 0..40 {
                if nth % 4 == 0 {
                    let way = LostWay::Outward;
                    bench.simulation.inject(Fault::LostFrame { way, cycles: 1 });
                }
                schedule(&mut bench, u16::from(nth % 4 == 0), OFFSET_NS);
            }
            bench.idle(501);
            let (told, released) = (account(&bench), truth(&bench).frames_released - released);
            outcomes.push((told.sent - before.sent, told.unknown - before.unknown, released));
        }
        outcomes.sort_unstable();
        // In the cycle of the pulse it comes too late.
        assert_eq!(outcomes, [(0, 10, 0), (10, 0, 10), (10, 0, 10), (10, 0, 10)]);
    }
}

/// An image that stays lost until its pulse has passed is given up then.
#[test]
fn a_repeat_is_given_up_when_the_pulse_has_passed() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut bench = with_long_sync0(SHIFT_NS, change);
        for _ in 0..20 {
            let way = LostWay::Outward;
            bench.simulation.inject(Fault::LostFrame { way, cycles: 5 });
            schedule(&mut bench, 1, OFFSET_NS);
            bench.idle(12);
        }
        bench.idle(500);
        let (told, truth) = (account(&bench), truth(&bench));
        assert_eq!((told.sent, told.unknown, truth.frames_released), (0, 20, 0));
    }
}

/// The next number of a plain generator.
fn draw(state: &mut u64, below: u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) % below
}

#[test]
fn the_account_never_claims_what_did_not_happen_whatever_strikes() {
    let mut kinds = [0_u64; 4];
    for seed in 1..=24 {
        let mut state = seed;
        let change: fn(&mut GatewayConfig) = if seed % 3 == 0 { |_| () } else { results };
        let scenario = if seed % 2 == 0 { sluggish() } else { ecan_sim::jitter(1) };
        let shift_ns = [150_000, 300_000, 500_000, 700_000][(seed % 4) as usize];
        let mut bench = with_sync0(scenario, shift_ns, change);
        for _ in 0..400 {
            let fault = match draw(&mut state, 200) {
                0..4 => Some(Fault::LostFrame {
                    way: [LostWay::Outward, LostWay::Return][draw(&mut state, 2) as usize],
                    cycles: 1 + draw(&mut state, 5) as u32,
                }),
                4..6 => Some(Fault::Gateway {
                    gateway: 0,
                    fault: GatewayFault::ServiceStall { ms: 1 + draw(&mut state, 4) as u32 },
                }),
                6 => Some(Fault::BusOff { gateway: 0, channel: 0 }),
                7 => Some(Fault::WorkingCounterOffset { offset: -1, cycles: 2 }),
                8 if seed % 4 == 0 => Some(Fault::PowerCycle { gateway: 0, off_ms: 20 }),
                _ => None,
            };
            if let Some(fault) = fault {
                bench.simulation.inject(fault);
            }
            let (frames, offset) = (draw(&mut state, 6) as u16, draw(&mut state, 9) as u32);
            schedule(&mut bench, frames, offset * 50_000);
        }
        assert!(bench.until(20_000, |port| port.is_ready()).is_some(), "seed {seed}");
        let (told, _) = check(&mut bench);
        let of_seed = [told.sent, told.late_dropped, told.unknown, told.refused_late];
        for (sum, more) in kinds.iter_mut().zip(of_seed) {
            *sum += more;
        }
    }
    assert!(kinds.iter().all(|sum| *sum > 0), "every kind of outcome was there: {kinds:?}");
}

#[test]
fn no_frame_leaves_before_its_phase_or_a_period_behind_it() {
    let mut lost = 0;
    for seed in 1..=8 {
        let mut state = seed;
        let change: fn(&mut GatewayConfig) = if seed % 2 == 0 { |_| () } else { results };
        let mut bench = with_sync0(echo(1), SHIFT_NS, change);
        bench.simulation.with_world(|world| world.record_bus_of(0, 0));
        for _ in 0..400 {
            let fault = match draw(&mut state, 100) {
                0..6 => Some(Fault::LostFrame {
                    way: [LostWay::Outward, LostWay::Return][draw(&mut state, 2) as usize],
                    cycles: 1 + draw(&mut state, 5) as u32,
                }),
                6..9 => Some(Fault::Gateway {
                    gateway: 0,
                    fault: GatewayFault::ServiceStall { ms: 1 + draw(&mut state, 4) as u32 },
                }),
                9 => Some(Fault::WorkingCounterOffset { offset: -2, cycles: 2 }),
                _ => None,
            };
            if let Some(fault) = fault {
                bench.simulation.inject(fault);
            }
            let offset_ns = draw(&mut state, 9) as u32 * 50_000;
            bench.cycle(|port| {
                // Each frame carries the time at which it is due.
                let pulse_ns = port.adapter().cycle_time_ns() + u64::from(SHIFT_NS);
                let due_ns = pulse_ns + u64::from(offset_ns);
                let at = Schedule { tag: 0, offset_ns };
                let _ = port.schedule_can(0, 0, id(1), &due_ns.to_le_bytes(), at);
            });
        }
        let (told, truth) = check(&mut bench);
        lost += told.scheduled - truth.frames_released;
        let frames = bench.simulation.with_world(|world| world.take_recorded());
        for frame in frames.iter().filter(|it| it.is_from_channel) {
            let due_ns = u64::from_le_bytes(*frame.frame.data().first_chunk().unwrap());
            let after_ns = i128::from(frame.start_ns) - i128::from(due_ns);
            // The echo of the frame before may still be on the bus.
            assert!((0..400_000).contains(&after_ns), "seed {seed}: {after_ns} ns");
        }
    }
    assert!(lost > 100, "only {lost} frames met trouble");
}
