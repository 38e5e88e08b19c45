//! The jobs of a Port under each alternative of each switch of the simulated gateway: frames out and back over
//! a disturbed line, each once and in order, and scheduled frames with a true account, or an error.

use std::path::Path;
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, frame, frames_of, id};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{GatewayConfig, PendingStep, PortConfig};
use ecan_protocol::image::{OptionFlags, Schedule};
use ecan_protocol::mapping::CHANNELS;
use ecan_sim::variant::{Alternative, Variant, variants};
use ecan_sim::{Fault, GatewayFault, LossDirection, Scenario};

/// Result of a job that does not work: key, alternative and a part of its error.
type Failing = (&'static str, &'static str, &'static str);

const START_FAILS: &[Failing] = &[
    ("assignment_rewritten", "\"status_5\"", "assumption H41"),
    ("missing_entries", "[\"0xF000:17..18\"]", "assumption H1"),
];

/// A rotated gateway is not ready.
const ROTATION_FAILS: &[Failing] = &[("rotation_effect", "\"start\"", "assumption H47")];

/// Scheduled transmission is not offered, or not without another setting.
const SCHEDULE_FAILS: &[Failing] = &[
    ("assign_activate", "\"0x0700\"", "assumption H2:"),
    ("missing_entries", "[\"0xF000:13..16\"]", "assumption H42"),
];

/// The account of scheduled frames states their results as unknown, with a finding.
const ACCOUNT_FINDINGS: &[Failing] = &[
    ("tx_results", "\"failures_only\"", "600 frames are unknown"),
    ("scheduled_pulse", "\"previous\"", "assumption H24"),
    ("missing_entries", "[\"0x9020\"]", "0x9020:12 cannot be read (assumption H42"),
];

/// One gateway with echo nodes.
fn scenario(variant: &'static Variant, alternative: &'static Alternative) -> Scenario {
    let mut text = format!("[[gateway]]\n{}", variant.toml(alternative));
    for channel in 0..CHANNELS {
        text += &format!("[[node]]\nkind = \"echo\"\nbus = \"0.{channel}\"\n");
    }
    Scenario::from_toml(&text, variant.key, Path::new(".")).unwrap_or_else(|e| panic!("{text}{e}"))
}

fn start(
    scenario: Scenario,
    adapter: AdapterConfig,
    mut gateway: GatewayConfig,
) -> Result<Fixture, String> {
    gateway.tx_options = OptionFlags::TX_RESULT;
    let config = PortConfig::uniform(1, gateway);
    let mut fixture = Fixture::open(scenario, adapter, config).map_err(|e| e.to_string())?;
    fixture.port.wait_ready().map_err(|e| e.to_string())?;
    Ok(fixture)
}

fn lose_frame(fixture: &Fixture, direction: LossDirection) {
    fixture.simulation.inject(Fault::LostFrame { direction, cycles: 1 });
}

/// Sends 60 frames on each channel in bursts of four per cycle. Some EtherCAT frames are lost.
fn echo_job(scenario: Scenario) -> Result<(), String> {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut gateway = GatewayConfig::on_all_channels(classic());
    gateway.device.pin_rotation = Some(1);
    let mut fixture = start(scenario, adapter, gateway)?;
    let frames: Vec<_> = (0..60).map(|n| frame(0x100 + n, &n.to_le_bytes())).collect();
    let mut sent = [0; CHANNELS];
    let mut back: [Vec<_>; CHANNELS] = Default::default();
    for nth in 0..400 {
        match nth {
            5 => lose_frame(&fixture, LossDirection::Outward),
            10 => lose_frame(&fixture, LossDirection::Return),
            _ => {}
        }
        let items = fixture.cycle(|cycle| {
            for (channel, sent) in (0..).zip(&mut sent) {
                for frame in frames.iter().skip(*sent).take(4) {
                    if cycle.send(cycle.ch(0, channel), frame).is_err() {
                        break;
                    }
                    *sent += 1;
                }
            }
        });
        for received in frames_of(&items) {
            back[usize::from(received.channel)].push(received.frame);
        }
    }
    let statistics = fixture.port.statistics(fixture.port.gw(0));
    for (channel, back) in back.iter().enumerate() {
        let counted = statistics.channels[channel];
        // one lost return can hold eight of them
        let mut expected = frames.iter();
        if let Some(wrong) = back.iter().find(|frame| !expected.any(|sent| sent == *frame)) {
            return Err(format!("channel {channel}: {wrong:?} twice or out of order, {counted:?}"));
        }
        let lost = frames.len() - back.len();
        if lost > 8 || (lost > 0 && statistics.txpdo_lost == 0) {
            return Err(format!("channel {channel}: {lost} frames missing, {counted:?}"));
        }
        if counted.frames_delivered != frames.len() as u64 || counted.results_failed > 0 {
            return Err(format!("channel {channel}: all frames are sent, {counted:?}"));
        }
    }
    match statistics.parse_errors {
        0 => Ok(()),
        errors => Err(format!("{errors} parse errors")),
    }
}

/// Schedules three frames in each of 200 cycles, and then until the firmware is too late for some.
fn schedule_job(scenario: Scenario) -> Result<(), String> {
    let millisecond = Duration::from_millis(1);
    let mut adapter = AdapterConfig::new(1).with_cycle(millisecond);
    adapter.dc = Some(DcSync::new(millisecond, millisecond / 2));
    let mut fixture = start(scenario, adapter, GatewayConfig::on_channel(0, classic()))?;
    let mut rejected = None;
    let mut schedule = |fixture: &mut Fixture| {
        fixture.cycle(|cycle| {
            for tag in 0..3 {
                let at = Schedule { tag, offset_ns: 100_000 };
                let sent = cycle.schedule_can(0, 0, id(0x100 + tag), &[], at);
                rejected = rejected.take().or(sent.err());
            }
        });
    };
    (0..200).for_each(|_| schedule(&mut fixture));
    fixture.idle(500);
    let account = fixture.port.schedule_account(fixture.port.ch(0, 0));
    if let Some(fault) = fixture.port.schedule_fault(fixture.port.gw(0)) {
        return Err(fault.to_string());
    }
    if account.unknown > 0 {
        return Err(format!("{} frames are unknown", account.unknown));
    }

    let fault = GatewayFault::ServiceStall { ms: 2 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    (0..10).for_each(|_| schedule(&mut fixture));
    fixture.idle(500);
    let account = fixture.port.schedule_account(fixture.port.ch(0, 0));
    let counters = fixture.simulation.with_world(|world| world.counters(0).unwrap());
    let (sent, late) = (counters.frames_released, counters.transmit_losses.late);
    assert!(account.sent <= sent && sent <= account.sent + account.unknown, "{account:?}");
    assert!(late <= account.unknown + account.not_sent && account.open == 0, "{account:?}");
    match rejected.filter(|_| account.scheduled == 0) {
        Some(rejected) => Err(rejected.to_string()),
        None => Ok(()),
    }
}

/// Runs a job under each alternative, and compares the errors with the expected ones.
fn run_all(job: fn(Scenario) -> Result<(), String>, failing: &[&[Failing]]) {
    let mut unexpected = Vec::new();
    for variant in variants() {
        for alternative in variant.alternatives {
            let (key, value) = (variant.key, alternative.value);
            let error = job(scenario(variant, alternative)).err();
            println!("{key} = {value}: {}", error.as_deref().unwrap_or("works"));
            let mut failing = failing.iter().copied().flatten();
            let expected = failing.find(|failing| (failing.0, failing.1) == (key, value));
            let is_expected = match (&error, expected) {
                (None, None) => true,
                (Some(error), Some((.., part))) => error.contains(part),
                _ => false,
            };
            if !is_expected {
                unexpected.push((key, value, error));
            }
        }
    }
    assert!(unexpected.is_empty(), "{unexpected:#?}");
}

#[test]
fn echo_job_works_or_ends_with_an_error() {
    run_all(echo_job, &[START_FAILS, ROTATION_FAILS]);
}

#[test]
fn schedule_job_works_or_ends_with_an_error() {
    run_all(schedule_job, &[START_FAILS, SCHEDULE_FAILS, ACCOUNT_FINDINGS]);
}

#[test]
fn unchanged_assignment_keeps_the_profile_valid() {
    for value in ["status_5", "dropped_at_safeop"] {
        let text = format!(
            "[[gateway]]\npdo_assign = false\n[gateway.variant]\nassignment_rewritten = \"{value}\"\n\
             [[node]]\nkind = \"echo\"\nbus = \"0.0\"\n"
        );
        let scenario = Scenario::from_toml(&text, value, Path::new(".")).unwrap();
        schedule_job(scenario).unwrap_or_else(|error| panic!("{value}: {error}"));
    }
}

/// Frames that nobody fetches before OP overflow; the status keeps that, and the profile is in use.
#[test]
fn lost_profile_is_applied_again_after_an_overflow() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let frames: String = (0..30_000)
        .map(|ms| format!("({}.{:03}000) can0 100#00\n", ms / 1_000, ms % 1_000))
        .collect();
    std::fs::write(folder.join("overflow.log"), frames).unwrap();
    let text = "[[gateway]]\n[gateway.variant]\nassignment_rewritten = \"dropped_at_safeop\"\n\
                [[node]]\nkind = \"replay\"\nbus = \"0.0\"\nfile = \"overflow.log\"\n";
    let scenario = Scenario::from_toml(text, "overflow", folder).unwrap();
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let started = start(scenario, adapter, GatewayConfig::on_channel(0, classic()));
    started.unwrap_or_else(|error| panic!("{error}"));
}

/// A startup that is requested again begins in INIT, before the profiles that were restored in SAFEOP lead to OP.
#[test]
fn lost_profile_is_applied_again_although_startups_are_requested() {
    let text = "[[gateway]]\nmailbox_delay_us = 50000\n\
                [gateway.variant]\nassignment_rewritten = \"dropped_at_safeop\"\n";
    let scenario = Scenario::from_toml(text, "slow", Path::new(".")).unwrap();
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut fixture = start(scenario, adapter, GatewayConfig::on_channel(0, classic())).unwrap();
    fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 300 });
    // With this mailbox the startup of the gateway takes 15 s.
    for _ in 0..60 {
        fixture.idle(250);
        let gateway = fixture.port.gw(0);
        if fixture.port.waiting_for(gateway) == Some(PendingStep::StartupRetry) {
            fixture.port.retry_startup().unwrap();
        }
    }
    assert!(fixture.port.is_ready(), "{:?}", fixture.port.waiting_for(fixture.port.gw(0)));
}
