//! No allocation between `cycle_begin` and `cycle_end`, with full images both ways.

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, id, with_sync0};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, PortConfig, Received};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{OptionFlags, Schedule};
use ecan_test_support::allocations;

/// Runs `cycles` of sending until the image is full and receiving everything; gives the
/// allocations inside the cycles and the frames that came back.
fn full_images(fixture: &mut Fixture, frames: &[CanFrame; 4], cycles: u32) -> (u64, u64) {
    let (mut inside, mut back) = (0, 0);
    for _ in 0..cycles {
        fixture.port.wait_next_cycle();
        let before = allocations();
        let mut cycle = fixture.port.begin_cycle();
        cycle.received().map(|item| item.to_owned()).for_each(|item| {
            if let Received::Frame(_) = item {
                back += 1;
            }
        });
        let mut channel = 0;
        while cycle.send(cycle.ch(0, channel % 4), &frames[usize::from(channel % 4)]).is_ok() {
            channel += 1;
        }
        assert_eq!(cycle.finish().error(), None);
        inside += allocations() - before;
    }
    (inside, back)
}

#[test]
fn counter_counts() {
    let before = allocations();
    let boxed = std::hint::black_box(Box::new(1));
    assert_eq!(allocations() - before, 1, "{boxed}");
}

#[test]
fn full_images_allocate_nothing() {
    for paced in [true, false] {
        let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::fd(1_000_000, 5_000_000));
        gateway.tx_options = OptionFlags::TX_RESULT;
        gateway.paced = paced;
        let adapter =
            AdapterConfig::new(1).with_multiplier(11).with_cycle(Duration::from_millis(1));
        let config = PortConfig::uniform(1, gateway);
        let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
        // Every cycle publishes a snapshot, copies its images and takes frames of another thread.
        let mut stream = fixture.port.image_stream(1 << 21);
        let mut queues = fixture.port.transmit_queues(16);
        let mut snapshot = fixture.port.adapter().observer().snapshot();
        let id = CanId::standard(0x100).unwrap();
        let frames = [0, 1, 2, 3].map(|n| CanFrame::fd(id, &[n; 64], true, false).unwrap());
        // The simulated world grows its queues to their working size first.
        full_images(&mut fixture, &frames, 200);
        while stream.next().is_some() {}
        for channel in 0..4 {
            (0..16).for_each(|_| queues.push(0, channel, &frames[0]).unwrap());
        }
        let (inside, back) = full_images(&mut fixture, &frames, 500);
        assert!(stream.next().is_some() && stream.lost() == 0);
        assert!(back > 1_000, "only {back} frames came back");
        assert_eq!(inside, 0, "paced: {paced}");
        snapshot.update().unwrap();
        assert_eq!(snapshot.cycle(), fixture.port.adapter().cycle_number());
    }
}

#[test]
fn scheduled_frames_and_the_look_at_their_flags_allocate_nothing() {
    let mut fixture = with_sync0(ecan_sim::echo(1), 500_000, |gateway| {
        gateway.tx_options = OptionFlags::TX_RESULT;
        gateway.schedule.watch_ms = 10;
    });
    let run = |fixture: &mut Fixture, cycles: u16| {
        let mut inside = 0;
        for tag in 0..cycles {
            fixture.port.wait_next_cycle();
            let before = allocations();
            let mut cycle = fixture.port.begin_cycle();
            cycle.received().for_each(drop);
            let at = Schedule { tag, offset_ns: 100_000 };
            cycle.schedule_can(0, 0, id(1), &[1], at).unwrap();
            assert_eq!(cycle.finish().error(), None);
            if tag % 100 == 10 {
                fixture.port.clear_schedule_flags(fixture.port.gw(0));
            }
            inside += allocations() - before;
        }
        inside
    };
    run(&mut fixture, 200);
    assert_eq!(run(&mut fixture, 500), 0);
    let account = fixture.port.schedule_account(fixture.port.ch(0, 0));
    assert!(
        account.sent > 300 && fixture.port.schedule_diagnostics(fixture.port.gw(0)).is_some(),
        "{account:?}"
    );
}
