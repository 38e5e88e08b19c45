//! What the Port says of scheduled frames against what really happened in the gateway
//! (manual 8.4, 10, 13.7).
#![allow(missing_docs)]

use std::time::Duration;

mod common;
mod schedule_support;

use common::{Fixture, Handles, SendData, id, with_sync0};
use ecan_mcan_port::{GatewayConfig, Received};
use ecan_protocol::image::Schedule;
use ecan_sim::{Fault, GatewayFault, LossDirection, echo};
use schedule_support::{OFFSET_NS, SHIFT_NS, check, results, schedule, sluggish};

#[test]
fn every_frame_is_sent_with_and_without_results() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut bench = with_sync0(echo(1), SHIFT_NS, change);
        for _ in 0..300 {
            assert_eq!(schedule(&mut bench, 2, OFFSET_NS), 2);
        }
        let (told, counters) = check(&mut bench);
        assert_eq!((told.scheduled, told.sent, counters.frames_released), (600, 600, 600));
        let diagnostics = bench.port.schedule_diagnostics(bench.port.gw(0)).unwrap();
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
    let mut items = bench.cycle(|cycle| {
        for tag in [7, 9] {
            let at = Schedule { tag, offset_ns: OFFSET_NS };
            tickets.push((cycle.schedule_can(0, 0, id(tag), &[], at).unwrap(), Some(tag)));
        }
        tickets.push((cycle.send_can(0, 0, id(1), &[]).unwrap(), None));
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
fn stalled(change: fn(&mut GatewayConfig)) -> Fixture {
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
    let (told, counters) = check(&mut bench);
    assert!(counters.transmit_losses.late > 0, "{counters:?}");
    assert_eq!(told.late_dropped, counters.transmit_losses.late);
    assert_eq!(told.sent, counters.frames_released);
    assert!(bench.port.schedule_diagnostics(bench.port.gw(0)).unwrap().has_late_drop());
}

#[test]
fn without_results_a_flag_makes_frames_unknown_until_it_is_cleared() {
    let mut bench = stalled(|_| ());
    let (told, counters) = check(&mut bench);
    assert!(counters.transmit_losses.late > 0 && told.unknown > 0 && told.sent < 600, "{told:?}");
    schedule(&mut bench, 1, OFFSET_NS);
    assert_eq!(check(&mut bench).0.unknown, told.unknown + 1, "the flag stays");
    bench.port.clear_schedule_flags(bench.port.gw(0));
    bench.idle(50);
    for _ in 0..10 {
        schedule(&mut bench, 1, OFFSET_NS);
    }
    let after = check(&mut bench).0;
    assert_eq!((after.unknown, after.sent), (told.unknown + 1, told.sent + 10));
    assert_eq!(bench.port.schedule_diagnostics(bench.port.gw(0)).unwrap().flags, 0);
}

#[test]
fn a_full_schedule_is_told() {
    let mut bench = with_sync0(echo(1), SHIFT_NS, |gateway| {
        results(gateway);
        gateway.paced = false;
    });
    let bits = |n: u64| n > 0;
    // An image of N = 3 holds less than the schedule, so two Sync0 periods of it would be needed.
    let mut adapter = *bench.port.adapter().config();
    adapter = adapter.with_multiplier(8);
    let config = *bench.port.config();
    bench.port.reconfigure((adapter, config)).unwrap();
    bench.port.wait_ready().unwrap();
    let taken = schedule(&mut bench, 100, OFFSET_NS);
    assert!(taken > 64);
    let (told, counters) = check(&mut bench);
    assert!(bits(counters.transmit_losses.schedule_full), "{counters:?}");
    assert_eq!(told.queue_full, counters.transmit_losses.schedule_full);
    let diagnostics = bench.port.schedule_diagnostics(bench.port.gw(0)).unwrap();
    assert!(diagnostics.has_queue_full(), "{diagnostics:?}");
    // More at a phase than the controller holds: the flags do not name the frames.
    assert!(!bits(counters.transmit_losses.schedule_failed) || told.unknown > 0, "{told:?}");
}

#[test]
fn lost_images_leave_unknown_frames_and_none_is_sent_late() {
    for way in [LossDirection::Outward, LossDirection::Return] {
        for change in [results as fn(&mut GatewayConfig), |_| ()] {
            let mut bench = with_sync0(echo(1), SHIFT_NS, change);
            bench.simulation.with_world(|world| world.record_bus_of(0, 0));
            for nth in 0..200_u32 {
                if nth % 20 == 10 {
                    bench
                        .simulation
                        .inject(Fault::LostFrame { direction: way, cycles: 1 + nth / 60 });
                }
                schedule(&mut bench, 1, OFFSET_NS);
            }
            let (told, counters) = check(&mut bench);
            assert!(told.unknown > 0, "{way:?} {told:?}");
            assert!(told.sent + told.unknown == 200, "{told:?} {counters:?}");
            // One frame a cycle, so two in one would be one that was sent late.
            let frames = bench.simulation.with_world(|world| world.take_recorded());
            let sent: Vec<_> = frames.iter().filter(|f| f.is_from_channel).collect();
            assert_eq!(sent.len() as u64, counters.frames_released);
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
    let (told, counters) = check(&mut bench);
    assert!(counters.transmit_losses.bus_off > 0, "{counters:?}");
    assert_eq!(told.not_sent, counters.transmit_losses.bus_off);
    assert!(bench.port.schedule_diagnostics(bench.port.gw(0)).unwrap().channels[0].bus_offs > 0);
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

/// Where a look at the flags takes longer than the interval between looks, and Sync0 is long, frames
/// wait for a look behind their phase: more at a phase than the controller holds are never told as
/// sent.
#[test]
fn a_look_before_the_phase_tells_nothing() {
    let mut failed = 0;
    for nth in 0..40 {
        let mut adapter = ecan_host::AdapterConfig::new(1)
            .with_cycle(Duration::from_millis(10))
            .with_multiplier(8);
        adapter.dc = Some(ecan_host::DcSync::new(100_000_000, 5_000_000));
        let mut gateway = GatewayConfig::on_channel(0, common::classic());
        results(&mut gateway);
        gateway.paced = false;
        let config = ecan_mcan_port::PortConfig::uniform(1, gateway);
        let mut bench = Fixture::ready(echo(1), adapter, config);
        // The looks begin with the first frame.
        assert_eq!(schedule(&mut bench, 1, OFFSET_NS), 1);
        bench.idle(nth);
        let taken = schedule(&mut bench, 60, 90_000_000);
        assert!(taken > 40);
        let (told, counters) = check(&mut bench);
        let happened = counters.transmit_losses.schedule_failed;
        assert!(told.unknown >= u64::from(taken), "{nth} {told:?}");
        failed += happened;
    }
    assert!(failed > 400, "{failed}");
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
                    direction: [LossDirection::Outward, LossDirection::Return]
                        [draw(&mut state, 2) as usize],
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
                    direction: [LossDirection::Outward, LossDirection::Return]
                        [draw(&mut state, 2) as usize],
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
            bench.cycle(|cycle| {
                // Each frame carries the time at which it is due.
                let pulse_ns = cycle.adapter().cycle_time_ns() + u64::from(SHIFT_NS);
                let due_ns = pulse_ns + u64::from(offset_ns);
                let at = Schedule { tag: 0, offset_ns };
                let _ = cycle.schedule_can(0, 0, id(1), &due_ns.to_le_bytes(), at);
            });
        }
        let (told, counters) = check(&mut bench);
        lost += told.scheduled - counters.frames_released;
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
