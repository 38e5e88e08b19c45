//! Snapshots of the Adapter's cycle, requests to stop, and an opening that ends early.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use crate::common::{open, raw_config, raw_config_of, run, simulated};
use ecan_host::{Adapter, AdapterConfig, Error, Master, Observer, ObserverError, StartupPlan};

#[track_caller]
fn assert_last_cycle(adapter: &Adapter, observer: &Observer) {
    let mut snapshot = observer.snapshot();
    snapshot.update().unwrap();
    assert_eq!(snapshot.cycle(), adapter.cycle_number());
    assert_eq!(snapshot.time_ns(), adapter.cycle_time_ns());
    assert_eq!(snapshot.slave_count(), adapter.slave_count());
    for slave in 0..adapter.slave_count() {
        assert_eq!(snapshot.domain_report(slave), Some(adapter.domain_report(slave)));
    }
    assert_eq!(snapshot.domain_report(adapter.slave_count()), None);
}

#[test]
fn snapshot_has_the_values_of_the_last_cycle() {
    let mut adapter = open(ecan_sim::echo(2), raw_config_of(2, 3)).unwrap();
    adapter.measure_cycles();
    let observer = adapter.observer();
    let mut snapshot = observer.snapshot();
    assert_eq!(snapshot.update(), Err(ObserverError::NoCycle));
    assert_eq!((snapshot.cycle(), snapshot.slave_count()), (0, 0));
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    for nth in 0..20 {
        adapter.wait_next_cycle();
        adapter.receive().unwrap();
        if nth % 5 == 4 {
            // A cycle that takes too long.
            let clock = adapter.clock();
            clock.sleep_until_ns(clock.now_ns() + 2_500_000);
        }
        adapter.send().unwrap();
        assert_last_cycle(&adapter, &observer);
        snapshot.update().unwrap();
        assert_eq!(snapshot.cycle_start(), Some(adapter.cycle_start()));
        if nth % 5 == 4 {
            assert_eq!(snapshot.run_time_ns(), 2_500_000);
        }
    }
    let statistics = adapter.cycle_statistics().unwrap();
    assert!(snapshot.overruns() >= 3 && snapshot.skipped() >= 3);
    assert!(snapshot.overruns() >= statistics.overruns());
    // Without a wait there is no deadline.
    adapter.receive().unwrap();
    adapter.send().unwrap();
    snapshot.update().unwrap();
    assert_eq!(snapshot.cycle_start(), None);
}

#[test]
fn observer_reports_the_end_of_its_adapter() {
    let mut adapter = open(ecan_sim::echo(1), raw_config().0).unwrap();
    let observer = adapter.observer();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let mut snapshot = observer.clone().snapshot();
    let last = adapter.cycle_number();
    assert!(!observer.is_closed());
    drop(adapter);
    assert!(observer.is_closed());
    assert_eq!(snapshot.update(), Err(ObserverError::Closed));
    assert_eq!(snapshot.cycle(), last, "the last one can still be read");
    observer.request_stop();
    assert!(observer.quick_stop(0).is_err());
}

#[test]
fn observer_follows_a_reconfiguration() {
    let mut adapter = open(ecan_sim::echo(2), raw_config_of(1, 3)).unwrap();
    let observer = adapter.observer();
    let mut snapshot = observer.snapshot();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    snapshot.update().unwrap();
    assert_eq!(snapshot.slave_count(), 1);
    adapter.reconfigure(raw_config_of(2, 3), StartupPlan::default()).unwrap();
    snapshot.update().unwrap();
    assert_eq!(snapshot.slave_count(), 1, "the last cycle was one of the old configuration");
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    snapshot.update().unwrap();
    assert_eq!(snapshot.slave_count(), 2);
    assert_last_cycle(&adapter, &observer);
}

#[test]
fn attached_adapter_publishes_too() {
    let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
    let (config, _) = raw_config();
    let mut owner = Master::request(&ecrt, 0).unwrap();
    // SAFETY: the owner outlives the Adapter below and is used from this thread only.
    let master = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let mut adapter = Adapter::attach(&ecrt, master, config, StartupPlan::default()).unwrap();
    let observer = adapter.observer();
    owner.activate().unwrap();
    adapter.owner_activated().unwrap();
    for _ in 0..5 {
        adapter.wait_next_cycle();
        owner.receive().unwrap();
        adapter.receive().unwrap();
        adapter.send().unwrap();
        owner.send().unwrap();
        assert_last_cycle(&adapter, &observer);
    }
}

#[test]
fn stop_request_ends_a_wait_until_it_is_cleared() {
    let mut adapter = open(ecan_sim::echo(1), raw_config().0).unwrap();
    let observer = adapter.observer();
    let ticket = observer.request_stop();
    assert!(adapter.is_stop_requested() && adapter.should_stop());
    let error = adapter.wait_op(Duration::from_secs(20)).unwrap_err();
    assert!(matches!(error, Error::Stopped), "{error}");
    let mut snapshot = observer.snapshot();
    snapshot.update().unwrap();
    assert!(snapshot.is_stop_requested() && snapshot.has_executed(ticket));
    adapter.clear_stop_request();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    run(&mut adapter, 1);
    snapshot.update().unwrap();
    assert!(!snapshot.is_stop_requested());
}

#[test]
fn signal_handler_requests_the_stop() {
    static OBSERVER: OnceLock<Observer> = OnceLock::new();
    extern "C" fn on_signal(_: i32) {
        if let Some(observer) = OBSERVER.get() {
            observer.request_stop();
        }
    }
    let mut adapter = open(ecan_sim::echo(1), raw_config().0).unwrap();
    OBSERVER.set(adapter.observer()).unwrap();
    let handler = on_signal as extern "C" fn(i32);
    // SAFETY: the handler uses atomics only.
    let before = unsafe { libc::signal(libc::SIGUSR1, handler as libc::sighandler_t) };
    assert_ne!(before, libc::SIG_ERR);
    let cycles = Arc::new(AtomicU32::new(0));
    let error = adapter
        .wait_op_with(Duration::from_secs(20), |adapter| {
            if cycles.fetch_add(1, Ordering::Relaxed) == 7 {
                // SAFETY: the handler is set.
                let raised = unsafe { libc::raise(libc::SIGUSR1) };
                assert_eq!(raised, 0);
            }
            adapter.receive().and_then(|()| adapter.send())
        })
        .unwrap_err();
    assert!(matches!(error, Error::Stopped), "{error}");
    assert_eq!(cycles.load(Ordering::Relaxed), 8, "in the cycle of the signal");
}

#[test]
fn opening_ends_early_on_request() {
    let open_until = |scenario, config: AdapterConfig, calls: u32| {
        let asked = AtomicU32::new(0);
        let stop = move || asked.fetch_add(1, Ordering::Relaxed) + 1 >= calls;
        let (ecrt, _simulation) = simulated(scenario);
        let clock = ecrt.clock().clone();
        let begun_ns = clock.now_ns();
        let plan = StartupPlan::default();
        let result = Adapter::open_with_stop(&ecrt, config, plan, Some(Box::new(stop)));
        (result, Duration::from_nanos(clock.now_ns() - begun_ns))
    };
    let config = |gateways| {
        let mut config = raw_config_of(gateways, 3);
        config.preop_timeout = Duration::from_secs(60);
        config
    };
    // The second gateway is missing.
    let (result, waited) = open_until(ecan_sim::echo(1), config(2), 10);
    assert!(matches!(result, Err(Error::Stopped)));
    assert!(waited < Duration::from_secs(10), "{waited:?}");
    // All are there: between two of them.
    let (result, _) = open_until(ecan_sim::echo(3), config(3), 5);
    assert!(matches!(result, Err(Error::Stopped)));
    // The function stays in force.
    let (result, _) = open_until(ecan_sim::echo(1), config(1), 100);
    let mut adapter = result.unwrap();
    let error = adapter.wait_op(Duration::from_secs(20)).unwrap_err();
    assert!(matches!(error, Error::Stopped), "{error}");
}
