//! Scheduled frames that would miss their Sync0 pulse: rejected, withdrawn or discarded, but never
//! reported as sent (manual 8.4, 13.8).

use crate::common::{Handles, SendData, id, with_sync0, without_sync0_window};
use crate::schedule_support::{
    OFFSET_NS, SHIFT_NS, account, check, counters, results, schedule, sluggish, with_long_sync0,
};
use ecan_mcan_port::{
    Backpressure, GatewayConfig, MarginCheck, NotSchedulable, Received, SendError,
};
use ecan_protocol::image::Schedule;
use ecan_sim::{Fault, LossDirection, echo};

#[test]
fn frame_of_a_cycle_after_the_pulse_is_rejected() {
    // The images of late cycles arrive around the pulse; the firmware is to read them all.
    let mut fixture = with_sync0(without_sync0_window(sluggish()), 300_000, results);
    fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
    let mut sent = 0;
    for _ in 0..2_000 {
        fixture.cycle(|cycle| {
            let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
            match cycle.schedule_can(0, 0, id(1), &[], at) {
                Ok(_) => sent += 1,
                Err(SendError::Backpressure { what: Backpressure::Phase, .. }) => {}
                Err(error) => panic!("{error}"),
            }
        });
    }
    let (frames, counters) = check(&mut fixture);
    assert!(frames.rejected_late > 10, "{frames:?}");
    assert_eq!((frames.scheduled, frames.rejected_late), (sent, 2_000 - sent));
    assert_eq!((counters.frames_released, frames.sent), (sent, sent), "{counters:?}");
    let frames = fixture.simulation.with_world(|world| world.take_recorded());
    let sent: Vec<_> = frames.iter().filter(|f| f.is_from_channel).collect();
    for pair in sent.windows(2) {
        let period = pair[1].start_ns - pair[0].start_ns;
        let nearest = (period + 500_000) / 1_000_000;
        assert!(nearest >= 1 && period.abs_diff(nearest * 1_000_000) <= 13_000, "{period}");
    }
}

#[test]
fn long_cycle_withdraws_late_frames() {
    let mut fixture = with_sync0(echo(1), 300_000, results);
    let clock = fixture.port.adapter().ecrt().clock().clone();
    for nth in 0..50 {
        fixture.cycle(|cycle| {
            let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
            cycle.schedule_can(0, 0, id(1), &[], at).unwrap();
            if nth % 10 == 0 {
                clock.sleep_until_ns(clock.now_ns() + 400_000);
            }
        });
    }
    let (frames, counters) = check(&mut fixture);
    assert_eq!((frames.withdrawn, frames.sent, counters.frames_released), (5, 45, 45));
}

#[test]
fn margin_is_reported_counted_or_required() {
    let mut fixture = with_sync0(echo(1), 120_000, results);
    let margin = fixture.port.schedule_margin(fixture.port.gw(0), OFFSET_NS).unwrap();
    assert!(!margin.is_sufficient(), "{margin}");
    assert!(margin.to_string().starts_with("margin -"), "{margin}");
    schedule(&mut fixture, 1, OFFSET_NS);
    assert_eq!(check(&mut fixture).0.without_margin, 1);
    let mut fixture = with_sync0(echo(1), 120_000, |gateway| {
        gateway.schedule.margin_check = MarginCheck::Reject;
    });
    fixture.cycle(|cycle| {
        let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
        let rejected = cycle.schedule_can(0, 0, id(1), &[], at).unwrap_err();
        let SendError::NotSchedulable { reason: NotSchedulable::NoMargin { lacking_ns }, .. } =
            rejected
        else {
            panic!("{rejected}");
        };
        assert_eq!(i64::try_from(lacking_ns).unwrap(), -margin.least_ns());
        assert!(rejected.to_string().contains("move the Sync0 shift"), "{rejected}");
    });
    let fixture = with_sync0(echo(1), SHIFT_NS, |_| ());
    assert!(fixture.port.schedule_margin(fixture.port.gw(0), OFFSET_NS).unwrap().is_sufficient());
    let beyond = fixture.port.schedule_margin(fixture.port.gw(0), 1_000_000);
    assert_eq!(beyond, Err(NotSchedulable::BeyondPeriod { sync0_ns: 1_000_000 }));
}

/// A pulse within the time that an image needs through the host and on the wire: without a margin,
/// but frames are taken and sent, as is promised where margins are only counted.
#[test]
fn pulse_during_the_transfer_rejects_no_frame() {
    for shift_ns in [31_000, 50_000, 95_000] {
        // All images arrive around a pulse; with the window the gateway would leave OP.
        let mut fixture = with_sync0(without_sync0_window(echo(1)), shift_ns, results);
        assert!(
            fixture.port.schedule_margin(fixture.port.gw(0), OFFSET_NS).unwrap().after_pulse_ns < 0
        );
        for _ in 0..100 {
            assert_eq!(schedule(&mut fixture, 1, OFFSET_NS), 1, "shift {shift_ns}");
        }
        let (frames, _) = check(&mut fixture);
        assert_eq!((frames.without_margin, frames.sent, frames.rejected_late), (100, 100, 0));
    }
}

#[test]
fn unconfirmed_image_takes_no_scheduled_frame() {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, results);
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 2 });
    fixture.cycle(|cycle| {
        cycle.send_can(0, 0, id(1), &[]).unwrap();
        let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
        cycle.schedule_can(0, 0, id(2), &[], at).unwrap();
    });
    let mut rejected = 0;
    while rejected < 2 {
        fixture.cycle(|cycle| {
            assert!(cycle.cycle_report(cycle.gw(0)).is_unconfirmed);
            let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
            let error = cycle.schedule_can(0, 0, id(3), &[], at).unwrap_err();
            assert!(
                matches!(error, SendError::Backpressure { what: Backpressure::Phase, .. }),
                "{error}"
            );
        });
        rejected += 1;
    }
    assert_eq!(schedule(&mut fixture, 1, OFFSET_NS), 1, "it arrived");
    fixture.idle(500);
    let (frames, counters) = (account(&fixture), counters(&fixture));
    // The first one left two periods late.
    assert_eq!((frames.rejected_late, frames.scheduled), (2, 2));
    assert_eq!((frames.sent, frames.unknown), (1, 1));
    assert_eq!(
        (counters.frames_released, counters.frames_on_bus),
        (2, 3),
        "no frame to be sent at once was lost"
    );
}

/// Images with frames of both kinds that are published again: what left may have left late.
#[test]
fn repeated_image_is_never_reported_as_sent() {
    for way in [LossDirection::Outward, LossDirection::Return] {
        for change in [results as fn(&mut GatewayConfig), |_| ()] {
            let mut fixture = with_sync0(echo(1), SHIFT_NS, change);
            fixture.simulation.inject(Fault::LostFrame { direction: way, cycles: 3 });
            fixture.cycle(|cycle| {
                let at = Schedule { tag: 0, offset_ns: OFFSET_NS };
                cycle.schedule_can(0, 0, id(2), &[], at).unwrap();
                cycle.send_can(0, 0, id(1), &[]).unwrap();
            });
            fixture.idle(500);
            let (frames, counters) = (account(&fixture), counters(&fixture));
            assert_eq!((frames.sent, frames.unknown, frames.open), (0, 1, 0), "{way:?}");
            assert_eq!((counters.frames_released, counters.frames_on_bus), (1, 2));
        }
    }
}

/// Frames to be sent at once leave in a late cycle, too, with their own results; scheduled ones
/// beside them do not.
#[test]
fn late_cycle_takes_scheduled_frames_out_of_an_image_with_others() {
    for has_results in [true, false] {
        let change = if has_results { results } else { |_: &mut GatewayConfig| () };
        let mut fixture = with_sync0(echo(1), 300_000, change);
        let clock = fixture.port.adapter().ecrt().clock().clone();
        let mut tickets = Vec::new();
        let mut items = Vec::new();
        for nth in 0..20_u8 {
            items.extend(fixture.cycle(|cycle| {
                let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
                cycle.schedule_can(0, 0, id(1), &[], at).unwrap();
                tickets.push(cycle.send_can(0, 0, id(2), &[nth; 8]).unwrap());
                cycle.schedule_can(0, 0, id(3), &[9], at).unwrap();
                let long = ecan_protocol::can::CanId::extended(0x1234).unwrap();
                tickets.push(cycle.send_can(0, 0, long, &[nth; 3]).unwrap());
                if nth % 2 == 0 {
                    clock.sleep_until_ns(clock.now_ns() + 400_000);
                }
            }));
        }
        items.extend(fixture.idle(500));
        let (frames, counters) = (account(&fixture), counters(&fixture));
        assert_eq!((frames.scheduled, frames.withdrawn, frames.sent), (40, 20, 20));
        assert_eq!((counters.frames_released, counters.frames_on_bus), (20, 60));
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
        let statistics = fixture.port.statistics(fixture.port.gw(0));
        assert_eq!(statistics.channels[0].frames_discarded, 20);
        assert_eq!(statistics.channels[0].frames_delivered, 60);
    }
}

/// A cycle that ends behind the time at which a pulse stands misses one only where there is one.
#[test]
fn only_the_cycle_with_the_pulse_can_miss_it() {
    let mut fixture = with_long_sync0(300_000, results);
    fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
    let clock = fixture.port.adapter().ecrt().clock().clone();
    for _ in 0..400 {
        fixture.cycle(|cycle| {
            let point_ns = cycle.adapter().cycle_time_ns();
            let at = Schedule { tag: 1, offset_ns: OFFSET_NS };
            cycle.schedule_can(0, 0, id(1), &point_ns.to_le_bytes(), at).unwrap();
            clock.sleep_until_ns(clock.now_ns() + 250_000);
        });
    }
    fixture.idle(500);
    let (frames, counters) = (account(&fixture), counters(&fixture));
    assert_eq!((frames.scheduled, frames.withdrawn, frames.sent), (400, 100, 300));
    assert_eq!(counters.frames_released, 300);
    let frames = fixture.simulation.with_world(|world| world.take_recorded());
    for frame in frames.iter().filter(|frame| frame.is_from_channel) {
        let point_ns = u64::from_le_bytes(*frame.frame.data().first_chunk().unwrap());
        let waited_ns = frame.start_ns - point_ns;
        // Three share a pulse, and the bus with their echoes.
        assert!((1_400_000..4_400_000).contains(&waited_ns), "{waited_ns} ns");
    }
}

/// A lost image that goes out again before its pulse is as good as new.
#[test]
fn repeat_that_meets_the_same_pulse_loses_nothing() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut fixture = with_long_sync0(SHIFT_NS, change);
        let mut outcomes = Vec::new();
        for _ in 0..4 {
            let (before, released) = (account(&fixture), counters(&fixture).frames_released);
            for nth in 0..40 {
                if nth % 4 == 0 {
                    let way = LossDirection::Outward;
                    fixture.simulation.inject(Fault::LostFrame { direction: way, cycles: 1 });
                }
                schedule(&mut fixture, u16::from(nth % 4 == 0), OFFSET_NS);
            }
            fixture.idle(501);
            let (frames, released) =
                (account(&fixture), counters(&fixture).frames_released - released);
            outcomes.push((frames.sent - before.sent, frames.unknown - before.unknown, released));
        }
        outcomes.sort_unstable();
        // In the cycle of the pulse it comes too late.
        assert_eq!(outcomes, [(0, 10, 0), (10, 0, 10), (10, 0, 10), (10, 0, 10)]);
    }
}

/// An image that stays lost until its pulse has passed is given up then.
#[test]
fn repeat_is_discarded_after_the_pulse() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut fixture = with_long_sync0(SHIFT_NS, change);
        for _ in 0..20 {
            let way = LossDirection::Outward;
            fixture.simulation.inject(Fault::LostFrame { direction: way, cycles: 5 });
            schedule(&mut fixture, 1, OFFSET_NS);
            fixture.idle(12);
        }
        fixture.idle(500);
        let (frames, counters) = (account(&fixture), counters(&fixture));
        assert_eq!((frames.sent, frames.unknown, counters.frames_released), (0, 20, 0));
    }
}
