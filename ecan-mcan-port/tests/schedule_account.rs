//! What the Port says of scheduled frames against what really happened in the gateway
//! (manual 8.4, 10, 13.7).

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, id, with_sync0};
use crate::schedule_support::{OFFSET_NS, SHIFT_NS, check, results, schedule, sluggish};
use ecan_mcan_port::{GatewayConfig, Port, Received, ScheduleDiagnostics, ScheduleFault};
use ecan_protocol::image::Schedule;
use ecan_sim::{Fault, GatewayFault, LossDirection, MasterBehaviour, echo};

#[test]
fn every_frame_is_sent_with_and_without_results() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut fixture = with_sync0(echo(1), SHIFT_NS, change);
        for _ in 0..300 {
            assert_eq!(schedule(&mut fixture, 2, OFFSET_NS), 2);
        }
        let (frames, counters) = check(&mut fixture);
        assert_eq!((frames.scheduled, frames.sent, counters.frames_released), (600, 600, 600));
        let diagnostics = fixture.port.schedule_diagnostics(fixture.port.gw(0)).unwrap();
        assert_eq!(diagnostics.flags, 0);
        assert!(diagnostics.sync0_count > 300 && diagnostics.service_max_cycles > 0);
        assert!(diagnostics.phase_min_cycles > 0, "{diagnostics:?}");
        assert_eq!(fixture.cycle_errors, []);
    }
}

#[test]
fn results_bring_the_tag_of_their_frame() {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, results);
    let mut tickets = Vec::new();
    let mut items = fixture.cycle(|cycle| {
        for tag in [7, 9] {
            let at = Schedule { tag, offset_ns: OFFSET_NS };
            tickets.push((cycle.schedule_can(0, 0, id(tag), &[], at).unwrap(), Some(tag)));
        }
        tickets.push((cycle.send_can(0, 0, id(1), &[]).unwrap(), None));
    });
    items.extend(fixture.idle(5));
    let reported: Vec<_> = items
        .iter()
        .filter_map(|item| match item {
            Received::TransmitReport(report) => {
                assert!(report.code.is_success());
                Some((report.ticket.unwrap(), report.schedule_tag))
            }
            Received::Frame(_) => None,
        })
        .collect();
    assert_eq!(reported, tickets);
}

/// A service that comes so late that phases have passed.
fn stalled(change: fn(&mut GatewayConfig)) -> Fixture {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, change);
    for nth in 0..200 {
        if nth == 100 {
            let fault = GatewayFault::ServiceStall { ms: 2 };
            fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
        }
        schedule(&mut fixture, 3, OFFSET_NS);
    }
    fixture
}

#[test]
fn late_flag_makes_frames_unknown_until_it_is_cleared() {
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut fixture = stalled(change);
        let (frames, counters) = check(&mut fixture);
        assert!(counters.transmit_losses.late > 0, "{counters:?}");
        assert!(frames.unknown > 0 && frames.sent > 200, "{frames:?}");
        let flags = ScheduleDiagnostics::LATE_DROP;
        let fault = |port: &Port| port.schedule_fault(port.gw(0));
        assert_eq!(fault(&fixture.port), Some(ScheduleFault::Flagged { flags }));
        schedule(&mut fixture, 1, OFFSET_NS);
        assert_eq!(check(&mut fixture).0.unknown, frames.unknown + 1, "the flag stays");
        fixture.port.clear_schedule_flags(fixture.port.gw(0));
        fixture.idle(50);
        for _ in 0..10 {
            schedule(&mut fixture, 1, OFFSET_NS);
        }
        let after = check(&mut fixture).0;
        assert_eq!((after.unknown, after.sent), (frames.unknown + 1, frames.sent + 10));
        assert_eq!(fault(&fixture.port), None);
        assert_eq!(fixture.port.schedule_diagnostics(fixture.port.gw(0)).unwrap().flags, 0);
    }
}

#[test]
fn diagnostics_are_known_before_the_interval_even_if_a_transfer_fails() {
    for times in [0, 1] {
        let mut fixture = with_sync0(echo(1), SHIFT_NS, |gateway| {
            gateway.schedule.watch_ms = 60_000;
        });
        let fault = GatewayFault::SdoAbort { index: 0x9011, subindex: 2, code: 0x0800_0022, times };
        fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
        schedule(&mut fixture, 1, OFFSET_NS);
        let is_known = |port: &Port| port.schedule_diagnostics(port.gw(0)).is_some();
        assert!(fixture.until(1_000, is_known).is_some(), "{times} transfers fail");
    }
}

/// A reading that fails shows nothing about a frame.
#[test]
fn counter_that_is_never_readable_leaves_no_frame_unknown() {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, |gateway| gateway.schedule.watch_ms = 10);
    let fault =
        GatewayFault::SdoAbort { index: 0x9011, subindex: 2, code: 0x0800_0022, times: u32::MAX };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    for _ in 0..40 {
        schedule(&mut fixture, 1, OFFSET_NS);
        fixture.idle(50);
    }
    let (frames, _) = check(&mut fixture);
    assert_eq!((frames.scheduled, frames.sent), (40, 40), "{frames:?}");
    assert!(fixture.port.schedule_diagnostics(fixture.port.gw(0)).is_none(), "not all are known");
}

#[test]
fn full_schedule_is_reported() {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, |gateway| {
        results(gateway);
        gateway.paced = false;
    });
    let bits = |n: u64| n > 0;
    // An image of N = 3 holds less than the schedule, so two Sync0 periods of it would be needed.
    let mut adapter = *fixture.port.adapter().config();
    adapter = adapter.with_multiplier(8);
    let config = *fixture.port.config();
    fixture.port.reconfigure((adapter, config)).unwrap();
    fixture.port.wait_ready().unwrap();
    let taken = schedule(&mut fixture, 100, OFFSET_NS);
    assert!(taken > 64);
    let (frames, counters) = check(&mut fixture);
    assert!(bits(counters.transmit_losses.schedule_full), "{counters:?}");
    assert_eq!(frames.queue_full, counters.transmit_losses.schedule_full);
    let diagnostics = fixture.port.schedule_diagnostics(fixture.port.gw(0)).unwrap();
    assert_ne!(diagnostics.flags & ScheduleDiagnostics::QUEUE_FULL, 0, "{diagnostics:?}");
    // More at a phase than the controller holds: the flags do not name the frames.
    assert!(!bits(counters.transmit_losses.schedule_failed) || frames.unknown > 0, "{frames:?}");
}

#[test]
fn lost_images_leave_unknown_frames_and_none_is_sent_late() {
    for way in [LossDirection::Outward, LossDirection::Return] {
        for change in [results as fn(&mut GatewayConfig), |_| ()] {
            let mut fixture = with_sync0(echo(1), SHIFT_NS, change);
            fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
            for nth in 0..200_u32 {
                if nth % 20 == 10 {
                    fixture
                        .simulation
                        .inject(Fault::LostFrame { direction: way, cycles: 1 + nth / 60 });
                }
                schedule(&mut fixture, 1, OFFSET_NS);
            }
            let (frames, counters) = check(&mut fixture);
            assert!(frames.unknown > 0, "{way:?} {frames:?}");
            assert!(frames.sent + frames.unknown == 200, "{frames:?} {counters:?}");
            // One frame a cycle, so two in one would be one that was sent late.
            let frames = fixture.simulation.with_world(|world| world.take_recorded());
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
fn channel_off_the_bus_is_reported() {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, |gateway| {
        results(gateway);
        gateway.paced = false;
    });
    for nth in 0..300 {
        if nth == 100 {
            fixture.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
        }
        schedule(&mut fixture, 2, OFFSET_NS);
    }
    let (frames, counters) = check(&mut fixture);
    assert!(counters.transmit_losses.bus_off > 0, "{counters:?}");
    assert_eq!(frames.not_sent, counters.transmit_losses.bus_off);
    assert!(
        fixture.port.schedule_diagnostics(fixture.port.gw(0)).unwrap().channels[0].bus_offs > 0
    );
}

#[test]
fn lost_gateway_leaves_nothing_open() {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, results);
    for nth in 0..100 {
        if nth == 50 {
            fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
        }
        schedule(&mut fixture, 2, OFFSET_NS);
    }
    assert!(fixture.until(20_000, |port| port.is_ready()).is_some());
    for _ in 0..100 {
        schedule(&mut fixture, 2, OFFSET_NS);
    }
    let (frames, _) = check(&mut fixture);
    assert!(frames.unknown > 0 && frames.sent >= 200, "{frames:?}");
}

/// If reading the flags takes longer than its interval, and Sync0 is long, frames wait for a reading
/// after their phase: more at a phase than the controller holds are never reported as sent.
#[test]
fn reading_before_the_phase_decides_nothing() {
    let mut failed = 0;
    for nth in 0..40 {
        let mut adapter = ecan_host::AdapterConfig::new(1)
            .with_cycle(Duration::from_millis(10))
            .with_multiplier(8);
        adapter.dc =
            Some(ecan_host::DcSync::new(Duration::from_millis(100), Duration::from_millis(5)));
        let mut gateway = GatewayConfig::on_channel(0, crate::common::classic());
        results(&mut gateway);
        gateway.paced = false;
        let config = ecan_mcan_port::PortConfig::uniform(1, gateway);
        let mut fixture = Fixture::ready(echo(1), adapter, config);
        // The looks begin with the first frame.
        assert_eq!(schedule(&mut fixture, 1, OFFSET_NS), 1);
        fixture.idle(nth);
        let taken = schedule(&mut fixture, 60, 90_000_000);
        assert!(taken > 40);
        let (frames, counters) = check(&mut fixture);
        let happened = counters.transmit_losses.schedule_failed;
        assert!(frames.unknown >= u64::from(taken), "{nth} {frames:?}");
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
fn account_never_claims_frames_that_were_not_sent() {
    let mut kinds = [0_u64; 3];
    for seed in 1..=24 {
        let mut state = seed;
        let change: fn(&mut GatewayConfig) = if seed % 3 == 0 { |_| () } else { results };
        let mut scenario = if seed % 2 == 0 { sluggish() } else { ecan_sim::jitter(1) };
        if seed % 4 > 1 {
            scenario.master = MasterBehaviour::IGH;
        }
        let shift_ns = [150_000, 300_000, 500_000, 700_000][(seed % 4) as usize];
        let mut fixture = with_sync0(scenario, shift_ns, change);
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
                fixture.simulation.inject(fault);
            }
            let (frames, offset) = (draw(&mut state, 6) as u16, draw(&mut state, 9) as u32);
            schedule(&mut fixture, frames, offset * 50_000);
        }
        assert!(fixture.until(20_000, |port| port.is_ready()).is_some(), "seed {seed}");
        let (frames, _) = check(&mut fixture);
        let of_seed = [frames.sent, frames.unknown, frames.rejected_late];
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
        let mut fixture = with_sync0(echo(1), SHIFT_NS, change);
        fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
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
                fixture.simulation.inject(fault);
            }
            let offset_ns = draw(&mut state, 9) as u32 * 50_000;
            fixture.cycle(|cycle| {
                // Each frame carries the time at which it is due.
                let pulse_ns = cycle.adapter().cycle_time_ns() + u64::from(SHIFT_NS);
                let due_ns = pulse_ns + u64::from(offset_ns);
                let at = Schedule { tag: 0, offset_ns };
                let _ = cycle.schedule_can(0, 0, id(1), &due_ns.to_le_bytes(), at);
            });
        }
        let (frames, counters) = check(&mut fixture);
        lost += frames.scheduled - counters.frames_released;
        let frames = fixture.simulation.with_world(|world| world.take_recorded());
        for frame in frames.iter().filter(|frame| frame.is_from_channel) {
            let due_ns = u64::from_le_bytes(*frame.frame.data().first_chunk().unwrap());
            let after_ns = i128::from(frame.start_ns) - i128::from(due_ns);
            // The echo of the frame before may still be on the bus.
            assert!((0..400_000).contains(&after_ns), "seed {seed}: {after_ns} ns");
        }
    }
    assert!(lost > 100, "only {lost} frames were lost");
}
