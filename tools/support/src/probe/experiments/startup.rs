//! Restart of the gateway, its state afterwards, and its states on the way to OP.

use ecan_host::{Diagnostics, Error};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use crate::probe::outcome::{Interruption, Outcome, Result, Verdict, unavailable};
use crate::probe::run::{Probe, Restart};
use crate::probe::sdo::Upload;
use crate::probe::session::Setup;

/// Index of a filter editing window: has no effect of its own.
const MARK: (u16, u8) = (0x8001, 43);
const WRITTEN: u8 = 5;
/// Longest time from the command to the restart, in ns.
const VANISH_NS: u64 = 5_000_000_000;
const RETURN_NS: u64 = 30_000_000_000;
const POLL_NS: u64 = 20_000_000;
/// Time from the command to the restart that is not immediate, in ns.
const IMMEDIATE_NS: u64 = 20_000_000;
/// Longest time to the first response that agrees with the assumption: the master's scan is part of it.
const BOOT_NS: u64 = 2_500_000_000;

fn write_mark(probe: &Probe) -> Result<(), Error> {
    probe.diagnostics.sdo_download_once(probe.slave, MARK.0, MARK.1, &[WRITTEN])
}

/// Restarts the gateway once.
fn restart(probe: &mut Probe) -> Result<Restart> {
    if let Some(restart) = &probe.restart {
        return Ok(restart.clone());
    }
    write_mark(probe)?;
    let start = probe.clock().now_ns();
    let command = probe.diagnostics.sdo_download_once(probe.slave, 0x8000, 1, &[1]);
    let is_answered = match command {
        Ok(()) => true,
        Err(Error::Sdo { abort_code: None, .. }) => false,
        Err(error) => return Err(error.into()),
    };
    let mut vanished_ns = probe.clock().now_ns() - start;
    // Until the first transfer without response.
    while is_answered && write_mark(probe).is_ok() {
        vanished_ns = probe.clock().now_ns() - start;
        if vanished_ns > VANISH_NS {
            return unavailable("the gateway accepts the restart command and does not restart");
        }
    }
    let vanished_at = start + vanished_ns;
    let boot_ns = wait_response(probe, vanished_at)? - vanished_at;
    let mark = probe.sdo().read(MARK.0, MARK.1)?;
    let mut chunks = [0; 2];
    for (index, chunks) in [0x1C12, 0x1C13].into_iter().zip(&mut chunks) {
        *chunks = probe.sdo().read(index, 0)?;
    }
    let mut channels = [None; CHANNELS];
    for (index, state) in (0x9000..).zip(&mut channels) {
        if let Upload::Value(word) = probe.sdo().try_read(index, 9)? {
            *state = Some(ChannelStatus::from_raw(word as u16).state());
        }
    }
    let restart = Restart { is_answered, vanished_ns, boot_ns, mark, chunks, channels };
    probe.profile.restart_ms = u32::try_from((vanished_ns + boot_ns) / 1_000_000).ok();
    probe.restart = Some(restart.clone());
    Ok(restart)
}

/// Waits for the first SDO response; returns its time.
fn wait_response(probe: &mut Probe, since: u64) -> Result<u64> {
    loop {
        if probe.is_stopped() {
            return Err(Interruption::Stopped);
        }
        probe.sleep_ns(POLL_NS);
        if let Ok(diagnostics) = Diagnostics::of_bus(&probe.ecrt, probe.master)
            && diagnostics.slave_count() > probe.slave
        {
            probe.diagnostics = diagnostics;
            let state = probe.diagnostics.al_state(probe.slave);
            let is_there = state.is_ok_and(|state| state.is_some_and(AlState::has_mailbox));
            // Written once: a read would be repeated. A response with an abort is a response, too.
            let answer = || probe.diagnostics.sdo_download_once(probe.slave, MARK.0, 42, &[0]);
            if is_there
                && !matches!(
                    answer(),
                    Err(Error::Sdo { abort_code: None, .. } | Error::NoSuchSlave { .. })
                )
            {
                return Ok(probe.clock().now_ns());
            }
        }
        if probe.clock().now_ns().saturating_sub(since) > RETURN_NS {
            return Err(Interruption::LinkLost);
        }
    }
}

pub(in crate::probe) fn restart_answer(probe: &mut Probe) -> Result<Outcome> {
    let Restart { is_answered, vanished_ns, .. } = restart(probe)?;
    let ms = vanished_ns / 1_000_000;
    Ok(match is_answered {
        false => Outcome::differs(
            "no answer: the gateway restarts before it answers, or before the master has fetched the answer",
        )
        .like(0),
        true if vanished_ns < IMMEDIATE_NS => {
            let detail = format!("answered, but the gateway did not respond {ms} ms after the command");
            Outcome::differs(detail).like(1)
        }
        true => Outcome::holds(format!("answered; the gateway responded for {ms} ms after it")),
    })
}

pub(in crate::probe) fn boot_time(probe: &mut Probe) -> Result<Outcome> {
    let Restart { boot_ns, .. } = restart(probe)?;
    let ms = boot_ns / 1_000_000;
    let detail = format!("first SDO response {ms} ms after the restart, with the master's scan");
    Ok(Outcome::decided(boot_ns <= BOOT_NS, detail).like(ms))
}

pub(in crate::probe) fn assignment_at_start(probe: &mut Probe) -> Result<Outcome> {
    let [rx, tx] = restart(probe)?.chunks;
    let detail = format!("0x1C12 has {rx} entries, 0x1C13 {tx}");
    let outcome = Outcome::decided((rx, tx) == (24, 24), detail);
    Ok(if (rx, tx) == (0, 0) { outcome.like("none") } else { outcome })
}

pub(in crate::probe) fn channels_off(probe: &mut Probe) -> Result<Outcome> {
    let channels = restart(probe)?.channels;
    let known: Vec<_> = (0..).zip(channels).filter_map(|(at, state)| Some((at, state?))).collect();
    if known.is_empty() {
        return Ok(Outcome::undecided("0x9000:09 was not read"));
    }
    let on = known.iter().find(|(_, state): &&(u8, _)| *state != ChannelState::Disabled);
    Ok(match on {
        None => Outcome::holds("every channel is disabled (0x9000:09)"),
        Some((channel, state)) => {
            let detail = format!(
                "channel {channel} is in state {state} (0x9000:09); a configuration in the Flash can be the cause"
            );
            Outcome::differs(detail).like("active")
        }
    })
}

/// Counters of 0x9000 and 0x9020.
const COUNTERS: [(u16, u8); 7] = [
    (0x9000, 13),
    (0x9000, 14),
    (0x9000, 15),
    (0x9020, 5),
    (0x9020, 11),
    (0x9020, 12),
    (0x9020, 13),
];

pub(in crate::probe) fn counters_at_start(probe: &mut Probe) -> Result<Outcome> {
    if restart(probe)?.channels != [Some(ChannelState::Disabled); CHANNELS] {
        return Ok(Outcome::undecided("a channel is active after the restart"));
    }
    for (index, subindex) in COUNTERS {
        let value = probe.sdo().read(index, subindex)?;
        if value != 0 {
            return Ok(Outcome::differs(format!("0x{index:04X}:{subindex:02} is {value}")));
        }
    }
    Ok(Outcome::holds("the counters of 0x9000 and 0x9020 are 0"))
}

pub(in crate::probe) fn filter_index(probe: &mut Probe) -> Result<Outcome> {
    let outcome = volatile_setting(probe)?;
    Ok(if outcome.verdict == Verdict::Differs { outcome.like("kept") } else { outcome })
}

pub(in crate::probe) fn volatile_setting(probe: &mut Probe) -> Result<Outcome> {
    let Restart { mark, .. } = restart(probe)?;
    let detail = format!("0x8001:43 was {WRITTEN} before the restart and is {mark} after it");
    Ok(Outcome::decided(mark != u32::from(WRITTEN), detail))
}

pub(in crate::probe) fn assignment_rewritten(probe: &mut Probe) -> Result<Outcome> {
    let statuses = match probe.session(&Setup::plain()) {
        Ok(session) => [session.read(0x8010, 2)?, session.read(0x8011, 2)?],
        Err(Interruption::NotInOp { reason, .. }) => return not_in_op(probe, &reason),
        Err(other) => return Err(other),
    };
    let [tx, rx] = statuses;
    let detail = format!("OP reached; 0x8010:02 is {tx}, 0x8011:02 is {rx}");
    Ok(match statuses {
        [0, 0] => Outcome::holds(detail),
        [5, 5] => Outcome::differs(detail).like("status_5"),
        _ => Outcome::differs(detail),
    })
}

/// The profile was applied before the master wrote the assignment again, and rejected then.
fn not_in_op(probe: &mut Probe, reason: &str) -> Result<Outcome> {
    probe.wait_preop()?;
    let detail = |status| format!("OP not reached, 0x8010:02 is {status} then: {reason}");
    Ok(match probe.sdo().read(0x8010, 2)? {
        5 => Outcome::differs(detail(5)).like("dropped_at_safeop"),
        status => Outcome::undecided(detail(status)),
    })
}

/// The first session after the restart, so that no profile is active.
pub(in crate::probe) fn apply_at_safeop(probe: &mut Probe) -> Result<Outcome> {
    let active = [probe.sdo().read(0x8010, 9)?, probe.sdo().read(0x8011, 9)?];
    if active != [0, 0] {
        return Ok(Outcome::undecided("a profile is active after a restart (Flash)"));
    }
    let setup = Setup { is_applied: false, ..Setup::plain() };
    match probe.session(&setup) {
        Ok(session) => {
            let bytes = [session.read(0x8010, 9)?, session.read(0x8011, 9)?];
            let detail =
                format!("OP reached without an apply command, with images of {bytes:?} bytes");
            Ok(Outcome::decided(bytes == [128, 128], detail))
        }
        Err(Interruption::NotInOp { reason, .. }) => {
            // The same with an apply command shows whether that is the cause.
            probe.session(&Setup::plain())?;
            let detail = format!("OP reached only after an apply command; without: {reason}");
            Ok(Outcome::differs(detail).like("required"))
        }
        Err(other) => Err(other),
    }
}

pub(in crate::probe) fn safeop_inputs(probe: &mut Probe) -> Result<Outcome> {
    let startup = probe.session(&Setup::plain())?.startup;
    if startup.cycles == 0 {
        return Ok(Outcome::undecided("no process data were exchanged before OP"));
    }
    let (missed, cycles) = (startup.inputs_missed, startup.cycles);
    let detail = format!("before OP {missed} of {cycles} cycles had no new TxPDO image");
    Ok(match missed * 2 > cycles {
        false => Outcome::holds(detail),
        true => Outcome::differs(detail).like("none"),
    })
}

pub(in crate::probe) fn safeop_outputs(probe: &mut Probe) -> Result<Outcome> {
    let startup = probe.session(&Setup::plain())?.startup;
    if startup.cycles == 0 {
        return Ok(Outcome::undecided("no process data were exchanged before OP"));
    }
    let (missed, cycles) = (startup.outputs_missed, startup.cycles);
    let detail = format!("before OP the gateway did not take {missed} of {cycles} RxPDO images");
    Ok(match missed * 2 > cycles {
        false => Outcome::holds(detail),
        true => Outcome::differs(detail).like("kept"),
    })
}
