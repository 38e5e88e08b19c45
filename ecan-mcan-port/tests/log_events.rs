//! Log events of Adapter and Port: one per transition, none in undisturbed cycles.

use crate::common::{Fixture, Handles, classic};
use ecan_mcan_port::{GatewayConfig, Port, Session};
use ecan_sim::{Fault, GatewayFault};
use tracing_test::traced_test;

fn ready() -> Fixture {
    Fixture::single(GatewayConfig::on_channel(0, classic()))
}

/// The events that contain one of `texts`, each as its level and the text.
fn events(lines: &[&str], texts: &[&str]) -> Vec<String> {
    let event = |line: &&str| {
        let level = ["INFO", "WARN", "ERROR"].into_iter().find(|level| line.contains(level))?;
        let text = texts.iter().find(|text| line.contains(**text))?;
        Some(format!("{level} {text}"))
    };
    lines.iter().filter_map(event).collect()
}

fn expect(actual: Vec<String>, expected: &[&str]) -> Result<(), String> {
    if actual == expected { Ok(()) } else { Err(format!("{actual:?}")) }
}

#[test]
#[traced_test]
fn power_cycle_logs_each_transition_once() {
    let mut fixture = ready();
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 50 });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    assert!(fixture.until(30_000, Port::is_ready).is_some());
    logs_assert(|lines: &[&str]| {
        let texts = [
            "slave 0: ready",
            "slave 0: no process data (working counter 0)",
            "slave 0: lost",
            "slave 0: process data resumed",
        ];
        let expected = [
            "INFO slave 0: ready",
            "WARN slave 0: no process data (working counter 0)",
            "WARN slave 0: lost",
            "INFO slave 0: process data resumed",
            "INFO slave 0: ready",
        ];
        expect(events(lines, &texts), &expected)
    });
}

#[test]
#[traced_test]
fn failed_verification_and_bus_off_are_logged() {
    let mut fixture = ready();
    fixture.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
    let bus_off = |port: &Port| port.channel_status(port.ch(0, 0)).bus_off();
    assert!(fixture.until(10, bus_off).is_some());
    assert!(fixture.until(500, |port| !bus_off(port)).is_some());
    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 50 });
    assert!(fixture.until(100, |port| port.session(port.gw(0)) == Session::Waiting).is_some());
    let silent = GatewayFault::MailboxSilent { ms: 8_000 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault: silent });
    let failed = |port: &Port| matches!(port.session(port.gw(0)), Session::Failed(_));
    assert!(fixture.until(30_000, failed).is_some());
    logs_assert(|lines: &[&str]| {
        let texts =
            ["channel 0: bus-off ended", "channel 0: bus-off", "slave 0: verification failed ("];
        let expected = [
            "WARN channel 0: bus-off",
            "INFO channel 0: bus-off ended",
            "WARN slave 0: verification failed (",
        ];
        expect(events(lines, &texts), &expected)
    });
}

#[test]
#[traced_test]
fn undisturbed_cycles_log_nothing() {
    let mut fixture = ready();
    tracing::info!("cycles begin");
    fixture.idle(1_000);
    logs_assert(|lines: &[&str]| {
        let has_warned = lines.iter().any(|line| line.contains("WARN"));
        let last = lines.last().filter(|line| line.contains("cycles begin") && !has_warned);
        last.map(|_| ()).ok_or(format!("{lines:?}"))
    });
}
