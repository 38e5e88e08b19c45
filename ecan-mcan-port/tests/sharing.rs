//! Images for another thread, and frames of another thread.

use std::collections::VecDeque;
use std::time::Duration;

use crate::common::Fixture;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    AddressError, ChannelConfig, GatewayConfig, ImageEvent, ImageStream, PortConfig, QueueError,
    Received, TransmitQueues,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{ImageReader, OptionFlags, Packet};
use ecan_protocol::mapping::{CHANNELS, Direction};
use ecan_sim::{Fault, LossDirection};

fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

fn gateway() -> GatewayConfig {
    let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::fd(1_000_000, 5_000_000));
    gateway.tx_options = OptionFlags::TX_RESULT;
    gateway
}

/// Frames and results of a stream, by direction.
#[derive(Debug, Default)]
struct Recorded {
    received: Vec<(u8, CanFrame)>,
    /// Channel, frame, and whether it came from a queue.
    published: Vec<(u8, CanFrame, bool)>,
    results: usize,
    rejected: Vec<(u8, u32)>,
    expired: Vec<(u8, u32)>,
    lost: u32,
    last_cycle: u64,
}

impl Recorded {
    fn drain(&mut self, stream: &mut ImageStream) {
        while let Some(record) = stream.next() {
            assert!(record.cycle >= self.last_cycle);
            self.last_cycle = record.cycle;
            self.lost += record.lost_before;
            match record.event {
                ImageEvent::Received { profile, image, .. } => {
                    let reader = ImageReader::new(Direction::TxPdo, profile);
                    for packet in reader.read(image).unwrap().packets() {
                        match packet.unwrap() {
                            Packet::Frame(packet) => {
                                self.received.push((packet.channel, packet.frame.to_owned()));
                            }
                            Packet::TxResult(_) => self.results += 1,
                        }
                    }
                }
                ImageEvent::Published { profile, image, queued, .. } => {
                    let reader = ImageReader::new(Direction::RxPdo, profile);
                    let mut frames: [VecDeque<CanFrame>; CHANNELS] = Default::default();
                    for packet in reader.read(image).unwrap().packets() {
                        let Packet::Frame(packet) = packet.unwrap() else { continue };
                        frames[usize::from(packet.channel)].push_back(packet.frame.to_owned());
                    }
                    for (channel, (frames, queued)) in frames.iter().zip(queued.sent).enumerate() {
                        let own = frames.len() - usize::from(queued);
                        for (at, frame) in frames.iter().enumerate() {
                            self.published.push((channel as u8, *frame, at >= own));
                        }
                    }
                }
                ImageEvent::Rejected { channel, frames, is_expired, .. } => match is_expired {
                    true => self.expired.push((channel, frames)),
                    false => self.rejected.push((channel, frames)),
                },
            }
        }
    }
}

fn shared(config: GatewayConfig, depth: usize) -> (Fixture, ImageStream, TransmitQueues) {
    let mut fixture = Fixture::single(config);
    let (stream, queues) =
        (fixture.port.image_stream(1 << 16), fixture.port.transmit_queues(depth));
    (fixture, stream, queues)
}

#[test]
fn stream_has_every_frame_of_both_directions_in_order() {
    let (mut fixture, mut stream, _queues) = shared(gateway(), 8);
    let frames: Vec<_> = (0..200).map(|n| frame(0x100 + n, &n.to_le_bytes())).collect();
    let mut recorded = Recorded::default();
    for chunk in frames.chunks(5) {
        // The application takes none of these itself.
        fixture.cycle(|cycle| {
            let to = cycle.channel(0, 1).unwrap();
            for frame in chunk {
                cycle.send(to, frame).unwrap();
            }
        });
        recorded.drain(&mut stream);
    }
    for _ in 0..20 {
        fixture.idle(1);
        recorded.drain(&mut stream);
    }
    let sent: Vec<_> = recorded.published.iter().map(|(_, frame, _)| *frame).collect();
    assert_eq!(sent, frames);
    assert_eq!(recorded.received.len(), frames.len(), "the echo node answers each frame");
    assert_eq!((recorded.results, recorded.lost), (frames.len(), 0));
    assert!(recorded.published.iter().all(|(channel, _, is_queued)| *channel == 1 && !is_queued));
}

#[test]
fn queued_frames_follow_those_of_the_application_and_keep_their_order() {
    let (mut fixture, mut stream, mut queues) = shared(gateway(), 64);
    let mut recorded = Recorded::default();
    let mut reports = 0;
    for round in 0..40_u16 {
        for nth in 0..3 {
            queues.push(0, 2, &frame(0x200 + round * 3 + nth, &[nth as u8])).unwrap();
        }
        let received = fixture.cycle(|cycle| {
            let to = cycle.channel(0, 2).unwrap();
            cycle.send(to, &frame(0x600, &round.to_le_bytes())).unwrap();
        });
        let own =
            |item: &Received| matches!(item, Received::TransmitReport(it) if it.ticket.is_some());
        reports += received.iter().filter(|item| own(item)).count();
        recorded.drain(&mut stream);
    }
    reports +=
        fixture.idle(20).iter().filter(|item| matches!(item, Received::TransmitReport(_))).count();
    recorded.drain(&mut stream);
    assert_eq!(reports, 40, "results of queued frames are not those of the application");
    assert_eq!(recorded.results, 160);
    let queued: Vec<_> =
        recorded.published.iter().filter(|image| image.2).map(|image| image.1.id().raw()).collect();
    assert_eq!(queued, (0x200..0x200 + 120).collect::<Vec<_>>());
    assert_eq!(queues.taken(0, 2), 120);
    assert_eq!(fixture.port.statistics(fixture.port.gateway(0).unwrap()).unmatched_results, 0);
}

#[test]
fn full_queue_returns_an_error_and_waits_for_the_bus() {
    let mut config = gateway();
    config.paced = true;
    let (mut fixture, mut stream, mut queues) = shared(config, 16);
    let (mut accepted, mut full, mut recorded) = (Vec::new(), 0, Recorded::default());
    for number in 0..2000_u16 {
        let frame = frame(number % 0x700, &number.to_le_bytes());
        match queues.push(0, 0, &frame) {
            Ok(()) => accepted.push(frame),
            Err(error) => {
                assert_eq!(error, QueueError::Full { slave: 0, channel: 0 });
                full += 1;
                fixture.idle(1);
            }
        }
        recorded.drain(&mut stream);
    }
    fixture.idle(300);
    recorded.drain(&mut stream);
    assert!(full > 100, "{full}");
    let sent: Vec<_> = recorded.published.iter().map(|(_, frame, _)| *frame).collect();
    assert_eq!(sent, accepted, "each accepted frame once, in order");
    let statistics = fixture.port.statistics(fixture.port.gateway(0).unwrap());
    let channel = statistics.channels[0];
    assert_eq!(channel.results_ok, accepted.len() as u64);
    assert_eq!((channel.rejected_queue_full, channel.rejected_image_full), (0, 0));
}

#[test]
fn frame_that_the_channel_cannot_carry_is_rejected_at_once() {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut config = GatewayConfig::default();
    config.channels[0] = Some(ChannelConfig::classic(500_000));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, config));
    let mut queues = fixture.port.transmit_queues(4);
    let fd = CanFrame::fd(CanId::standard(1).unwrap(), &[0; 12], true, false).unwrap();
    assert_eq!(queues.push(0, 0, &fd), Err(QueueError::NotFd { slave: 0, channel: 0 }));
    let disabled = AddressError::Disabled { slave: 0, channel: 1 };
    assert_eq!(queues.push(0, 1, &fd), Err(disabled.into()));
    assert_eq!(queues.push(0, 4, &fd), Err(AddressError::Channel { slave: 0, channel: 4 }.into()));
    let slave = AddressError::Slave { slave: 1, count: 1 };
    assert_eq!(queues.push(1, 0, &fd), Err(slave.into()));
    drop(fixture);
    assert_eq!(queues.push(0, 0, &frame(1, &[])), Err(QueueError::Closed));
}

#[test]
fn frames_for_a_gateway_that_is_lost_are_rejected_and_reported() {
    let (mut fixture, mut stream, mut queues) = shared(gateway(), 16);
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 200 });
    let gateway = fixture.port.gateway(0).unwrap();
    fixture.until(1000, |port| !port.gateway_is_ready(gateway)).unwrap();
    let mut recorded = Recorded::default();
    recorded.drain(&mut stream);
    let before = recorded.published.len();
    (0..3).for_each(|n| queues.push(0, 3, &frame(n, &[])).unwrap());
    fixture.idle(1);
    recorded.drain(&mut stream);
    assert_eq!(recorded.rejected, [(3, 3)]);
    assert_eq!((recorded.published.len(), queues.taken(0, 3)), (before, 3));
    while !fixture.port.gateway_is_ready(gateway) {
        fixture.idle(1);
        recorded.drain(&mut stream);
    }
    queues.push(0, 3, &frame(9, &[])).unwrap();
    fixture.idle(10);
    recorded.drain(&mut stream);
    assert_eq!(recorded.published.last(), Some(&(3, frame(9, &[]), true)));
}

#[test]
fn queued_frames_wait_while_an_image_is_unconfirmed() {
    let (mut fixture, mut stream, mut queues) = shared(gateway(), 16);
    let lost = Fault::LostFrame { direction: LossDirection::Outward, cycles: 3 };
    let mut recorded = Recorded::default();
    fixture.cycle(|cycle| {
        let to = cycle.channel(0, 0).unwrap();
        cycle.send(to, &frame(1, &[])).unwrap();
    });
    fixture.simulation.inject(lost);
    for number in 2..8 {
        queues.push(0, 0, &frame(number, &[])).unwrap();
        fixture.idle(1);
    }
    fixture.idle(20);
    recorded.drain(&mut stream);
    let ids: Vec<_> = recorded.published.iter().map(|(_, frame, _)| frame.id().raw()).collect();
    assert_eq!(ids, [1, 2, 3, 4, 5, 6, 7], "each once, in order");
    assert_eq!(recorded.results, 7);
}

#[test]
fn expired_queued_frames_are_withdrawn_and_reported() {
    let (mut fixture, mut stream, mut queues) = shared(gateway(), 16);
    let mut recorded = Recorded::default();
    // An unconfirmed image keeps the queued frames waiting.
    fixture.simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.cycle(|cycle| {
        let to = cycle.channel(0, 0).unwrap();
        cycle.send(to, &frame(1, &[])).unwrap();
    });
    fixture.idle(1);
    let now_ns = fixture.port.adapter().clock().now_ns();
    let lives = [2_000_000, 1_000_000_000, 2_000_000, 2_000_000, 1_000_000_000];
    for (number, life_ns) in (2..).zip(lives) {
        queues.push_until(0, 0, &frame(number, &[]), now_ns + life_ns).unwrap();
    }
    fixture.idle(20);
    recorded.drain(&mut stream);
    let ids: Vec<_> = recorded.published.iter().map(|(_, frame, _)| frame.id().raw()).collect();
    assert_eq!(ids, [1, 3, 6], "in order, without the expired ones");
    assert_eq!((recorded.expired, recorded.rejected), (vec![(0, 1), (0, 2)], vec![]));
    assert_eq!((recorded.results, queues.taken(0, 0)), (3, 5));
}

/// The age limit ends when a frame enters an image; the number of repeats bounds what follows.
#[test]
fn expired_frame_in_unconfirmed_image_has_hold_limit_repeats() {
    for (lost_images, sent) in [(10, 1), (11, 0)] {
        let (mut fixture, mut stream, mut queues) = shared(gateway(), 16);
        let mut recorded = Recorded::default();
        assert_eq!(gateway().hold_limit, 10);
        let fault = Fault::LostFrame { direction: LossDirection::Outward, cycles: lost_images };
        fixture.simulation.inject(fault);
        let now_ns = fixture.port.adapter().clock().now_ns();
        queues.push_until(0, 0, &frame(1, &[]), now_ns + 1_500_000).unwrap();
        fixture.idle(40);
        recorded.drain(&mut stream);
        assert_eq!((recorded.results, recorded.expired.len()), (sent, 0), "{lost_images}");
        let gateway = fixture.port.gateway(0).unwrap();
        let of_channel = fixture.port.statistics(gateway).channels[0];
        assert_eq!(of_channel.frames_confirmed, sent as u64, "{lost_images}: {of_channel:?}");
    }
}

#[test]
fn slow_reader_loses_records_and_counts_them() {
    let mut fixture = Fixture::single(gateway());
    let images = |fixture: &Fixture| {
        let statistics = fixture.port.statistics(fixture.port.gateway(0).unwrap());
        statistics.rxpdo_published + statistics.txpdo_received
    };
    let before = images(&fixture);
    let mut stream = fixture.port.image_stream(0);
    let send = |fixture: &mut Fixture, id| {
        fixture.cycle(|cycle| {
            let to = cycle.channel(0, 0).unwrap();
            cycle.send(to, &frame(id, &[])).unwrap();
        })
    };
    (0..500).for_each(|id| drop(send(&mut fixture, id)));
    let written = images(&fixture) - before;
    let taken = std::iter::from_fn(|| stream.next().map(|_| ())).count();
    // The first record after a gap reports it.
    send(&mut fixture, 500);
    let record = stream.next().unwrap();
    let (lost, packets) = (record.lost_before, record.lost_packets);
    assert!(taken > 2 && lost > 800 && packets >= lost, "{taken}; {packets} packets in {lost}");
    // A small image may have found room after a large one did not.
    assert_eq!(taken as u64 + stream.lost(), written);
    let second = fixture.port.image_stream(0);
    assert!(stream.is_closed() && !second.is_closed());
}

#[test]
fn paused_stream_has_no_records_and_loses_none() {
    let (mut fixture, mut stream, _queues) = shared(gateway(), 8);
    stream.set_paused(true);
    fixture.idle(10);
    assert!(stream.next().is_none());
    stream.set_paused(false);
    fixture.idle(3);
    let record = stream.next().unwrap();
    assert_eq!((record.lost_before, record.cycle), (0, fixture.port.adapter().cycle_number() - 2));
    stream.clear();
    assert!(stream.next().is_none());
    assert_eq!(stream.lost(), 0);
}
