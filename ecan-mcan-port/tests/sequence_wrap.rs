//! Sequence numbers of both directions over their wrap (manual 6.1).

use std::collections::HashSet;
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, Received, SendTicket, Session};
use ecan_protocol::image::{HeaderFlags, OptionFlags};
use ecan_sim::{Fault, GatewayCounters, GatewayFault, LossDirection};

/// Images before and after a wrap with traffic.
const AROUND: u16 = 40;

fn ready(gateways: usize) -> Fixture {
    let mut gateway = GatewayConfig::on_channel(0, classic());
    gateway.tx_options = OptionFlags::TX_RESULT;
    let adapter =
        AdapterConfig::new(gateways as u16).with_multiplier(1).with_cycle(Duration::from_millis(1));
    let config = PortConfig::uniform(gateways, gateway);
    Fixture::ready(ecan_sim::echo(gateways), adapter, config)
}

/// Sequence and flags of an image.
fn header(image: &[u8]) -> (u16, u8) {
    (u16::from_le_bytes([image[2], image[3]]), image[1])
}

fn sent(port: &Port, slave: usize) -> (u16, u8) {
    header(port.adapter().rx_pdo(slave))
}

fn received(port: &Port, slave: usize) -> (u16, u8) {
    header(port.adapter().tx_pdo(slave))
}

fn counters(fixture: &Fixture) -> GatewayCounters {
    fixture.simulation.with_world(|world| world.counters(0).unwrap())
}

/// Idle cycles until this many images before a wrap.
fn approach(fixture: &mut Fixture, before: u16, sequence: impl Fn(&Port) -> u16) {
    let cycles = 0_u16.wrapping_sub(sequence(&fixture.port)).wrapping_sub(before);
    fixture.idle(cycles.into());
    let distance = 0_u16.wrapping_sub(sequence(&fixture.port));
    assert!((1..=before + 1).contains(&distance), "{distance} images before the wrap");
}

/// A frame per cycle, each with a number.
#[derive(Default)]
struct Traffic {
    sent: u32,
    tickets: HashSet<SendTicket>,
    /// Numbers of the echoes and of the results, in the order of their arrival.
    echoes: Vec<u32>,
    results: Vec<SendTicket>,
}

impl Traffic {
    /// A cycle; sends if there is room.
    fn cycle(&mut self, fixture: &mut Fixture, sends: bool) {
        let items = fixture.cycle(|cycle| {
            if sends && let Ok(ticket) = cycle.send_can(0, 0, id(1), &self.sent.to_le_bytes()) {
                assert!(self.tickets.insert(ticket), "{ticket:?} twice");
                self.sent += 1;
            }
        });
        for item in items {
            match item {
                Received::Frame(it) => {
                    self.echoes.push(u32::from_le_bytes(it.frame.data().try_into().unwrap()));
                }
                Received::TransmitReport(it) => {
                    assert!(it.code.is_success(), "{it:?}");
                    self.results.push(it.ticket.expect("the ticket is known"));
                }
            }
        }
    }
}

#[test]
fn frames_and_results_cross_both_wraps() {
    let mut fixture = ready(1);
    let before = counters(&fixture);
    let mut traffic = Traffic::default();
    let mut flagged = [0; 2];
    type HeaderOf = fn(&Port) -> (u16, u8);
    let both: [HeaderOf; 2] = [|port| sent(port, 0), |port| received(port, 0)];
    for sequence_of in both {
        approach(&mut fixture, AROUND, |port| sequence_of(port).0);
        for _ in 0..2 * AROUND {
            traffic.cycle(&mut fixture, true);
            for (count, of) in flagged.iter_mut().zip(both) {
                let (sequence, flags) = of(&fixture.port);
                let is_flagged = flags & HeaderFlags::SEQ_WRAP.bits() != 0;
                assert_eq!(is_flagged, sequence == 0, "sequence {sequence}");
                *count += u32::from(is_flagged);
            }
        }
        (0..10).for_each(|_| traffic.cycle(&mut fixture, false));
    }
    assert_eq!(flagged, [1, 1], "images with SEQ_WRAP");
    assert_eq!(traffic.sent, 4 * u32::from(AROUND));
    assert_eq!(traffic.echoes, (0..traffic.sent).collect::<Vec<_>>());
    assert_eq!(traffic.results.len(), traffic.tickets.len());
    assert_eq!(traffic.results.into_iter().collect::<HashSet<_>>(), traffic.tickets);
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    let of_images = (statistics.txpdo_lost, statistics.txpdo_unknown, statistics.sessions_lost);
    assert_eq!((of_images, statistics.unmatched_results), ((0, 0, 0), 0));
    let counters = counters(&fixture);
    assert_eq!(counters.images_faulty - before.images_faulty, 0);
    assert_eq!(counters.frames_parsed - before.frames_parsed, u64::from(traffic.sent));
}

/// Images around each wrap that are repeated because the host did not see them arrive, and images that it
/// does not receive.
#[test]
fn lost_frames_at_the_wraps_neither_double_nor_hide_a_frame() {
    let mut fixture = ready(1);
    let mut traffic = Traffic::default();
    fixture.simulation.with_world(|world| assert!(world.record_bus_of(0, 0)));
    let before = (fixture.port.statistics(fixture.port.gw(0)), counters(&fixture));
    let both: [fn(&Port) -> u16; 2] = [|port| sent(port, 0).0, |port| received(port, 0).0];
    for sequence_of in both {
        approach(&mut fixture, AROUND, sequence_of);
        for nth in 0..2 * AROUND + 20 {
            let direction =
                if nth % 5 == 0 { LossDirection::Outward } else { LossDirection::Return };
            if nth % 5 < 3 {
                fixture.simulation.inject(Fault::LostFrame { direction, cycles: 1 });
            }
            traffic.cycle(&mut fixture, true);
        }
        (0..20).for_each(|_| traffic.cycle(&mut fixture, false));
        assert!(sequence_of(&fixture.port) < AROUND + 60, "the wrap has passed");
    }
    let recorded = fixture.simulation.with_world(|world| world.take_recorded());
    let own = recorded.iter().filter(|frame| frame.is_from_channel);
    let on_bus = own.map(|frame| frame.frame.data().to_vec());
    let expected = (0..traffic.sent).map(|number| number.to_le_bytes().to_vec());
    assert!(traffic.sent > 60, "{}", traffic.sent);
    assert_eq!(on_bus.collect::<Vec<_>>(), expected.collect::<Vec<_>>());
    assert!(traffic.echoes.is_sorted_by(|a, b| a < b), "{:?}", traffic.echoes);
    let (statistics, counters) = (fixture.port.statistics(fixture.port.gw(0)), counters(&fixture));
    assert_eq!((statistics.sessions_lost, statistics.txpdo_unknown), (0, 0));
    assert!(statistics.rxpdo_repeated - before.0.rxpdo_repeated > 60, "{statistics:?}");
    assert!(counters.images_repeated > before.1.images_repeated, "{counters:?}");
    let lost = statistics.txpdo_lost - before.0.txpdo_lost;
    assert!(lost > 60, "{lost}");
    let known = statistics.txpdo_received - before.0.txpdo_received + lost;
    let read = counters.images_read - before.1.images_read;
    assert!(known.abs_diff(read) <= 1, "{known} known, {read} read");
}

/// The second of two gateways, whose images begin at half of the range: its verification compares
/// the sequence that the gateway reports.
#[test]
fn verification_passes_while_the_sequence_wraps() {
    let mut fixture = ready(2);
    approach(&mut fixture, 3_000, |port| sent(port, 1).0);
    let fault = GatewayFault::AlError { code: 0x001A };
    fixture.simulation.inject(Fault::Gateway { gateway: 1, fault });
    let is_verifying = |port: &Port| port.session(port.gw(1)) == Session::Verifying;
    assert!(fixture.until(2_500, is_verifying).is_some());
    let first = sent(&fixture.port, 1).0;
    let for_ms = u32::from(0_u16.wrapping_sub(first)) + 100;
    fixture.simulation.inject(Fault::RequestsHeld { for_ms });
    let cycles = fixture.until(5_000, Port::is_ready).expect("ready");
    let last = sent(&fixture.port, 1).0;
    assert!(last < first, "{first} to {last} in {cycles} cycles: the wrap is not among them");
    let statistics = fixture.port.statistics(fixture.port.gw(1));
    assert_eq!((statistics.sessions_lost, statistics.verification_failures), (1, 0));
}
