//! Late wake-ups of the application in stepped time.

use crate::ecrt_support::stepped;
use ecan_sim::{Scenario, WakeUpDelay, echo, jitter};

const MS: u64 = 1_000_000;
const DELAY: WakeUpDelay = WakeUpDelay { typical_ns: 10_000, p99_ns: 80_000, longest_ns: 600_000 };

fn machine(seed: u64, wake_up: Option<WakeUpDelay>) -> ecan_sim::Backend {
    stepped(Scenario { wake_up, seed, ..echo(1) })
}

/// Delays of sleeps of a millisecond, with a spin before their ends.
fn delays(backend: &ecan_sim::Backend, count: usize, spin_ns: u64) -> Vec<u64> {
    let clock = backend.ecrt.clock();
    let late = |_| {
        let deadline = clock.now_ns() + MS;
        clock.sleep_and_spin_until_ns(deadline, spin_ns);
        clock.now_ns() - deadline
    };
    (0..count).map(late).collect()
}

#[test]
fn sleeps_end_late_by_scenario_and_seed() {
    let late = delays(&machine(1, Some(DELAY)), 2_000, 0);
    let beyond = |ns: u64| late.iter().filter(|late| **late > ns).count();
    assert!(beyond(0) == 2_000 && beyond(DELAY.longest_ns) == 0);
    assert!((900..1_100).contains(&beyond(DELAY.typical_ns)), "{}", beyond(DELAY.typical_ns));
    assert!((5..40).contains(&beyond(DELAY.p99_ns)), "{}", beyond(DELAY.p99_ns));
    assert_eq!(late, delays(&machine(1, Some(DELAY)), 2_000, 0), "the same seed");
    assert_ne!(late, delays(&machine(2, Some(DELAY)), 2_000, 0), "another seed");
    assert_eq!(delays(&machine(1, None), 100, 0), [0; 100], "without a delay");
}

#[test]
fn spin_absorbs_the_wake_up_delay() {
    let plain = delays(&machine(1, Some(DELAY)), 2_000, 0);
    let spun = delays(&machine(1, Some(DELAY)), 2_000, 50_000);
    let expected: Vec<u64> = plain.iter().map(|late| late.saturating_sub(50_000)).collect();
    assert_eq!(spun, expected);
    assert!(spun.iter().any(|late| *late > 0), "the tail is longer than the spin");
}

#[test]
fn calls_without_sleep_are_not_late() {
    let backend = machine(1, Some(DELAY));
    let (clock, simulation) = (backend.ecrt.clock(), backend.simulation.as_ref().unwrap());
    let now = clock.now_ns();
    clock.sleep_until_ns(now);
    clock.sleep_and_spin_until_ns(now + 10_000, 10_000);
    assert_eq!(clock.now_ns(), now + 10_000, "all of it was spun");
    simulation.pass_ns(MS);
    assert_eq!(clock.now_ns(), now + 10_000 + MS);
}

#[test]
fn built_in_scenario_has_all_three_delays() {
    let scenario = jitter(2);
    assert_eq!(scenario.nodes, echo(2).nodes);
    assert!(scenario.wake_up.is_some());
    for gateway in &scenario.gateways {
        assert!(gateway.config.service_jitter_ns > 0 && gateway.config.release_jitter_ns > 0);
    }
}
