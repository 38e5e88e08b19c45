//! Tests of the watch over a gateway, by what a Port reports in each cycle.

use ecan_host::{DomainReport, WcState};
use ecan_mcan_port::SendTicket;
use ecan_protocol::image::ResultCode;

use super::*;

const NEW: ImageReport = ImageReport::New { lost: 0, is_incomplete: false, layout_changed: false };

fn running() -> ChannelStatus {
    ChannelStatus::default().with_state(ChannelState::Run)
}

#[test]
fn position_is_as_fresh_as_its_image() {
    let lost = ImageReport::New { lost: 3, is_incomplete: false, layout_changed: false };
    let short = ImageReport::New { lost: 0, is_incomplete: true, layout_changed: false };
    let other = ImageReport::New { lost: 0, is_incomplete: false, layout_changed: true };
    let none = Actual::None;
    let cases = [
        (NEW, running(), Some(5), Actual::Fresh(5)),
        (lost, running(), Some(5), Actual::Fresh(5)),
        (NEW, running().with_rx_pending(1), Some(5), Actual::Late(5)),
        (NEW, running().with_rx_pending(6), Some(5), Actual::Late(5)),
        (NEW, running().with_rx_pending(7), Some(5), none(PositionUnavailable::Backlog)),
        (NEW, running().with_rx_pressure(true), Some(5), none(PositionUnavailable::Backlog)),
        (NEW, running(), None, none(PositionUnavailable::NoTpdo)),
        (short, running(), Some(5), none(PositionUnavailable::Incomplete)),
        (other, running(), Some(5), none(PositionUnavailable::Layout)),
        (ImageReport::Repeated, running(), Some(5), none(PositionUnavailable::NoImage)),
        (ImageReport::None, running(), Some(5), none(PositionUnavailable::NoImage)),
    ];
    for (image, status, position, expected) in cases {
        let mut watch = ChannelWatch { status, ..ChannelWatch::default() };
        watch.note_left(image, false);
        assert_eq!(watch.classify(image, position), expected, "{image:?} {status:?}");
    }
}

/// A watch after images with these counts of waiting frames and frames brought.
fn after_images(images: &[(u8, u64)], left_only: bool) -> ChannelWatch {
    let mut watch = ChannelWatch::default();
    for &(counted, in_image) in images {
        watch.status = running().with_rx_pending(counted);
        watch.in_image = in_image;
        watch.note_left(NEW, left_only);
    }
    watch
}

#[test]
fn received_frames_do_not_count_as_waiting() {
    let backlog = Actual::None(PositionUnavailable::Backlog);
    let cases = [
        (1, 1, false, Actual::Fresh(5)),
        (4, 4, false, Actual::Fresh(5)),
        (5, 4, false, Actual::Late(5)),
        (6, 6, false, Actual::Fresh(5)),
        (7, 7, false, Actual::Late(5)),
        (7, 9, false, Actual::Late(5)),
        (7, 6, false, backlog),
        (0, 3, true, Actual::Fresh(5)),
        (1, 3, true, Actual::Late(5)),
        (7, 9, true, backlog),
    ];
    for (counted, in_image, left_only, expected) in cases {
        let watch = after_images(&[(counted, in_image)], left_only);
        let actual = watch.classify(NEW, Some(5));
        assert_eq!(actual, expected, "{counted} {in_image} {left_only}");
    }
}

#[test]
fn image_with_what_the_last_one_left_is_fresh() {
    let cases: [(&[(u8, u64)], _); 5] = [
        // One frame per cycle, each comes one image later.
        (&[(1, 0), (2, 1), (2, 1)], Actual::Fresh(5)),
        // One frame every second cycle.
        (&[(1, 0), (1, 1)], Actual::Fresh(5)),
        (&[(2, 0), (3, 2)], Actual::Fresh(5)),
        (&[(2, 0), (3, 1)], Actual::Late(5)),
        (&[(7, 1), (7, 6)], Actual::None(PositionUnavailable::Backlog)),
    ];
    for (images, expected) in cases {
        let watch = after_images(images, false);
        assert_eq!(watch.classify(NEW, Some(5)), expected, "{images:?}");
    }
    let mut lost = after_images(&[(1, 0), (2, 1)], false);
    lost.note_left(
        ImageReport::New { lost: 1, is_incomplete: false, layout_changed: false },
        false,
    );
    assert_eq!(lost.classify(NEW, Some(5)), Actual::Late(5), "an image is unknown");
}

/// Three frames in each image, and none in the newest one.
fn watch(pending: u8, image_age: u32) -> GatewayWatch {
    let mut watch = GatewayWatch { image_age, ..GatewayWatch::new(0, 1) };
    let [channel, ..] = &mut watch.channels;
    channel.status = running().with_tx_pending(pending);
    channel.confirmed = std::array::from_fn(|nth| 100 - 3 * (nth as u64).saturating_sub(1));
    watch
}

#[test]
fn frames_of_one_image_are_no_backlog() {
    let cases = [
        (0, 0, Backlog::None),
        (3, 0, Backlog::None),
        (3, 1, Backlog::None),
        (3, 2, Backlog::Suspected),
        (4, 0, Backlog::Waiting),
        (7, 0, Backlog::Waiting),
    ];
    for (pending, age, expected) in cases {
        assert_eq!(watch(pending, age).backlog(0), expected, "{pending} {age}");
    }
    let mut full = watch(4, 0);
    full.channels[0].confirmed[0] += 3;
    assert_eq!(full.backlog(0), Backlog::Suspected, "the newest image has frames, too");
    full.schedule_images = 1;
    assert_eq!(full.backlog(0), Backlog::None, "they wait for their phase");
    full.channels[0].confirmed[0] += 3;
    full.channels[0].status = running().with_tx_pending(7);
    assert_eq!(full.backlog(0), Backlog::Suspected, "the count is saturated");
    full.channels[0].status = running().with_tx_pressure(true);
    assert_eq!(full.backlog(0), Backlog::Waiting);
}

/// Longer than the confirmed frames are remembered.
#[test]
fn long_schedule_does_not_hide_a_backlog() {
    let mut late = watch(4, 0);
    late.schedule_images = 100;
    late.channels[0].confirmed = [100; HISTORY];
    assert_eq!(late.backlog(0), Backlog::Waiting);
}

#[test]
fn gateway_that_was_removed_keeps_its_schedule_only() {
    let mut removed = undisturbed(9);
    removed.schedule_images = 1;
    removed.forget_cycles();
    assert_eq!(removed.path(0, false), GatewayWatch::new(0, 1).path(0, false));
    removed.channels = watch(4, 0).channels;
    removed.channels[0].confirmed[0] += 3;
    assert_eq!(removed.backlog(0), Backlog::None, "they wait for their phase");
}

#[test]
fn answers_show_that_a_full_bus_sends() {
    let mut full = watch(7, 0);
    full.channels[0].confirmed[0] += 9;
    assert_eq!(full.backlog(0), Backlog::Suspected);
    for (age, has_backlog) in [(0, false), (1, true)] {
        full.channels[0].answer_age = age;
        assert_eq!(full.path(0, false).has_backlog, has_backlog, "{age}");
        assert_eq!(full.withholds_sync(0, true), has_backlog, "{age}");
        assert!(!full.withholds_sync(0, false), "without an axis nobody answers");
    }
}

#[test]
fn channel_status_needs_a_new_image() {
    assert_eq!(view(ImageReport::Repeated, running()), ChannelView::NotSeen);
    assert_eq!(view(NEW, running().with_bus_off(true)), ChannelView::BusOff);
    let off = ChannelStatus::default().with_state(ChannelState::BusOff);
    assert_eq!(view(NEW, off), ChannelView::BusOff);
    for state in [ChannelState::Init, ChannelState::Listen, ChannelState::Error] {
        let status = ChannelStatus::default().with_state(state);
        assert_eq!(view(NEW, status), ChannelView::NotRunning);
    }
    let busy = running().with_tx_pending(3).with_tx_pressure(true);
    assert_eq!(view(NEW, busy), ChannelView::Running { pending: 3, pressure: true });
}

/// An undisturbed cycle of a gateway that has been ready since cycle 1.
fn cycle(number: u64) -> GatewayCycle {
    GatewayCycle {
        report: CycleReport {
            domain: DomainReport { wc_state: WcState::Complete, ..DomainReport::default() },
            image: NEW,
            cycle: number,
            ready_since: 1,
            ..CycleReport::default()
        },
        statistics: SlaveStatistics::default(),
        is_ready: true,
        channels: [running(); CHANNELS],
    }
}

/// A watch after undisturbed cycles 1 to `count`.
fn undisturbed(count: u64) -> GatewayWatch {
    let mut watch = GatewayWatch::new(0, 1);
    (1..=count).for_each(|number| watch.note_cycle(&cycle(number)));
    watch
}

const CLEAR: PathStatus = PathStatus::CLEAR;

#[test]
fn undisturbed_path_is_clear() {
    assert_eq!(undisturbed(1).path(0, false), CLEAR);
    assert_eq!(undisturbed(9).path(3, false), CLEAR);
    assert_eq!(undisturbed(9).path(1, true), PathStatus { target_lost: true, ..CLEAR });
    assert!(!undisturbed(0).path(0, false).is_ready, "nothing was observed");
}

/// Each event is seen in its cycle, on its channel, and not in the next one.
#[test]
fn events_of_a_cycle_are_reported_once() {
    type Event = fn(&mut GatewayCycle);
    let of_gateway: [(Event, PathStatus); 6] = [
        (
            |cycle| cycle.report.domain.wc_state = WcState::Zero,
            PathStatus { is_complete: false, ..CLEAR },
        ),
        (|cycle| cycle.report.is_unconfirmed = true, PathStatus { is_unconfirmed: true, ..CLEAR }),
        (|cycle| cycle.is_ready = false, PathStatus { is_ready: false, ..CLEAR }),
        (
            |cycle| cycle.report.image = ImageReport::Repeated,
            PathStatus { channel: ChannelView::NotSeen, ..CLEAR },
        ),
        (|cycle| cycle.report.ready_since = 5, PathStatus { is_ready: false, ..CLEAR }),
        (
            |cycle| cycle.channels = [running().with_bus_off(true); CHANNELS],
            PathStatus { channel: ChannelView::BusOff, ..CLEAR },
        ),
    ];
    for (nth, (event, expected)) in of_gateway.into_iter().enumerate() {
        let mut watch = undisturbed(4);
        let mut disturbed = cycle(5);
        event(&mut disturbed);
        watch.note_cycle(&disturbed);
        for channel in 0..4 {
            assert_eq!(watch.path(channel, false), expected, "event {nth}, channel {channel}");
        }
        let mut next = cycle(6);
        next.report.ready_since = disturbed.report.ready_since;
        watch.note_cycle(&next);
        assert_eq!(watch.path(0, false), CLEAR, "after event {nth}");
    }
}

/// Counters stay where they are after the event.
#[test]
fn counted_events_are_reported_once() {
    type Event = fn(&mut SlaveStatistics);
    let cases: [(Event, PathStatus, PathStatus); 8] = [
        (
            |counters| counters.rxpdo_discarded += 1,
            PathStatus { discarded: true, ..CLEAR },
            PathStatus { discarded: true, ..CLEAR },
        ),
        (
            |counters| counters.incomplete_cycles += 2,
            PathStatus { skipped_incomplete: 2, ..CLEAR },
            PathStatus { skipped_incomplete: 2, ..CLEAR },
        ),
        (
            |counters| counters.channels[2].frames_discarded += 1,
            CLEAR,
            PathStatus { discarded: true, ..CLEAR },
        ),
        (
            |counters| counters.channels[2].rejected_queue_full += 3,
            CLEAR,
            PathStatus { queue_rejected: true, ..CLEAR },
        ),
        (
            |counters| counters.channels[2].rejected_image_full += 1,
            CLEAR,
            PathStatus { image_full: true, ..CLEAR },
        ),
        (
            |counters| counters.channels[2].bus_off_images += 1,
            CLEAR,
            PathStatus { channel: ChannelView::BusOff, ..CLEAR },
        ),
        (
            |counters| counters.channels[2].not_running_images += 1,
            CLEAR,
            PathStatus { channel: ChannelView::NotRunning, ..CLEAR },
        ),
        (
            |counters| counters.channels[2].results_failed += 1,
            CLEAR,
            PathStatus { target_lost: true, ..CLEAR },
        ),
    ];
    for (nth, (event, of_others, expected)) in cases.into_iter().enumerate() {
        let mut watch = undisturbed(4);
        let mut counters = SlaveStatistics::default();
        event(&mut counters);
        watch.note_cycle(&GatewayCycle { statistics: counters, ..cycle(5) });
        assert_eq!(watch.path(0, false), of_others, "counter {nth}");
        assert_eq!(watch.path(2, false), expected, "counter {nth}");
        watch.note_cycle(&GatewayCycle { statistics: counters, ..cycle(6) });
        assert_eq!(watch.path(2, false), CLEAR, "after counter {nth}");
        // What happened before the first cycle, or before a reconfiguration, concerns others.
        let mut first = GatewayWatch::new(0, 1);
        first.note_cycle(&GatewayCycle { statistics: counters, ..cycle(1) });
        assert_eq!(first.path(2, false), CLEAR, "first cycle, counter {nth}");
        let mut restarted = cycle(7);
        restarted.report.ready_since = 7;
        watch.note_cycle(&restarted);
        assert_eq!(watch.path(2, false), PathStatus { is_ready: false, ..CLEAR }, "{nth}");
    }
}

#[test]
fn own_incomplete_cycle_is_no_skipped_one() {
    for (counted, is_complete, expected) in
        [(1, false, 0), (1, true, 1), (3, false, 2), (70_000, true, u16::MAX)]
    {
        let mut watch = undisturbed(4);
        let mut next = cycle(5);
        next.statistics.incomplete_cycles = counted;
        if !is_complete {
            next.report.domain.wc_state = WcState::Incomplete;
        }
        watch.note_cycle(&next);
        let path = watch.path(0, false);
        assert_eq!((path.skipped_incomplete, path.is_complete), (expected, is_complete));
    }
}

#[test]
fn only_failed_results_that_were_not_taken_are_missed() {
    let report =
        |code, ticket| TransmitReport { ticket, slave: 0, channel: 1, code, schedule_tag: None };
    let ticket = Some(SendTicket { slave: 0, sequence: 1, index: 0 });
    let failed = ResultCode::BusOff;
    for (report, is_missed) in [
        (report(failed, ticket), false),
        (report(failed, None), true),
        (report(ResultCode::Ok, ticket), true),
        (TransmitReport { channel: 2, ..report(failed, ticket) }, true),
        (TransmitReport { channel: 9, ..report(failed, ticket) }, true),
    ] {
        let mut watch = undisturbed(4);
        watch.take_report(&report);
        let mut next = cycle(5);
        next.statistics.channels[1].results_failed = 1;
        watch.note_cycle(&next);
        assert_eq!(watch.path(1, false).target_lost, is_missed, "{report:?}");
        next.report.cycle = 6;
        watch.note_cycle(&next);
        assert!(!watch.path(1, false).target_lost, "{report:?}");
    }
}

/// Each disturbance of one cycle.
#[test]
fn position_is_fresh_after_three_cycles_in_which_everything_came() {
    let fresh = |watch: &GatewayWatch| watch.actual(0, Some(5)) == Actual::Fresh(5);
    assert_eq!([1, 2, 3, 4].map(|count| fresh(&undisturbed(count))), [false, false, true, true]);
    type Disturbance = fn(&mut GatewayCycle);
    let disturbances: [Disturbance; 6] = [
        |cycle| cycle.report.domain.wc_state = WcState::Incomplete,
        |cycle| cycle.report.is_unconfirmed = true,
        |cycle| cycle.report.image = ImageReport::Repeated,
        |cycle| cycle.report.cycle += 1,
        |cycle| cycle.report.ready_since = 9,
        |cycle| cycle.channels = [running().with_rx_pressure(true); CHANNELS],
    ];
    for (nth, disturb) in disturbances.into_iter().enumerate() {
        let mut watch = undisturbed(8);
        let mut disturbed = cycle(9);
        disturb(&mut disturbed);
        watch.note_cycle(&disturbed);
        assert!(!fresh(&watch), "disturbance {nth}");
        // A skipped cycle and a new session begin to count with the cycle itself.
        let counts_itself = nth == 3 || nth == 4;
        let mut later = cycle(disturbed.report.cycle);
        later.report.ready_since = disturbed.report.ready_since;
        let fresh_after = (1..=4).find(|_| {
            later.report.cycle += 1;
            watch.note_cycle(&later);
            fresh(&watch)
        });
        assert_eq!(fresh_after, Some(if counts_itself { 2 } else { 3 }), "disturbance {nth}");
    }
}

#[test]
fn answers_are_those_of_the_last_sync_period() {
    let mut watch = GatewayWatch::new(0, 3);
    for number in 1..=6 {
        if number == 2 {
            watch.take_tpdo(1);
            watch.take_tpdo(200);
        }
        watch.note_cycle(&cycle(number));
        let is_answering = [1, 0].map(|channel: u8| watch.channel(channel).is_answering(3));
        // Before any answer the age is that of the watch.
        let expected = [number <= 4, number <= 2];
        assert_eq!(is_answering, expected, "cycle {number}");
    }
}

#[test]
fn confirmed_frames_are_remembered_by_image() {
    let mut watch = undisturbed(0);
    for number in 1..=6 {
        let mut next = cycle(number);
        next.statistics.channels[0].frames_confirmed = 10 * number;
        if number == 4 {
            next.report.image = ImageReport::Repeated;
        }
        watch.note_cycle(&next);
        let path = watch.path(0, false);
        let covered = [0, 0, 10, 10, 20, 40][number as usize - 1];
        assert_eq!((path.confirmed, path.covered), (10 * number, covered), "cycle {number}");
        assert_eq!(watch.path(1, false).confirmed, 0);
    }
}

/// An image with more frames than its status counts shows that the count is of the others.
#[test]
fn meaning_of_the_count_of_waiting_frames_is_learnt() {
    for (counted, in_image, is_learnt) in
        [(1, 2, true), (0, 1, true), (2, 2, false), (3, 2, false), (7, 9, false)]
    {
        let mut watch = undisturbed(3);
        let mut next = cycle(4);
        next.channels[1] = running().with_rx_pending(counted);
        next.report.frames[1] = in_image;
        watch.note_cycle(&next);
        assert_eq!(watch.counts_left_only, is_learnt, "{counted} {in_image}");
        // One frame waits, and one came: with that knowledge it is another one.
        next.report.cycle = 5;
        next.channels[1] = running().with_rx_pending(1);
        next.report.frames[1] = 1;
        watch.note_cycle(&next);
        assert_eq!(watch.channel(1).left, Some(u64::from(is_learnt)), "{counted} {in_image}");
    }
}

#[test]
fn gateway_without_new_images_lacks_them() {
    let mut watch = undisturbed(3);
    assert!(watch.is_open() && watch.is_ready() && !watch.is_unconfirmed() && !watch.lacks_image());
    for number in 4..=6 {
        let mut next = cycle(number);
        next.report.image = ImageReport::Repeated;
        next.report.is_unconfirmed = number == 5;
        next.is_ready = number < 6;
        watch.note_cycle(&next);
        assert!(watch.lacks_image());
        assert_eq!(watch.backlog(0), if number == 4 { Backlog::None } else { Backlog::Suspected });
        assert_eq!(watch.is_open(), number == 4, "cycle {number}");
        assert_eq!((watch.is_unconfirmed(), watch.is_ready()), (number == 5, number < 6));
    }
    watch.note_cycle(&cycle(7));
    assert!(!watch.lacks_image() && watch.is_open());
}
