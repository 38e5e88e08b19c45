//! The slave controller in OP.

use std::time::Duration;

use ecan_protocol::device::AlState;

use crate::probe::outcome::{Interruption, Outcome, Result};
use crate::probe::run::Probe;
use crate::probe::session::{SYNC0, SYNC0_AND_SYNC1, Session, Setup};

pub(in crate::probe) fn controller(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    let [kind, _, _, _, fmmus, sync_managers, memory, _] = session.read_registers(0x0000)?;
    let detail = format!(
        "type 0x{kind:02X}, {fmmus} FMMUs, {sync_managers} sync managers, {memory} KiB of memory"
    );
    Ok(match (fmmus, sync_managers, memory) {
        (0, 0, 0) => Outcome::undecided("the registers read 0, as with the simulated library"),
        found => Outcome::decided(found == (8, 8, 8), detail),
    })
}

/// Longest way out of OP and back, in cycles of 2 ms.
const RETURN_CYCLES: u32 = 15_000;

pub(in crate::probe) fn al_control(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    session.adapter.requests().reconfigure(0)?;
    let has_left =
        session.cycles_until(100, |adapter| adapter.domain_report(0).working_counter == 0)?;
    if !has_left {
        return Ok(Outcome::differs("the gateway exchanges process data 200 ms after the write"));
    }
    let is_back = session.cycles_until(RETURN_CYCLES, |adapter| {
        adapter.all_operational().is_ok_and(|is_operational| is_operational)
    })?;
    session.take_missed();
    Ok(match is_back {
        true => Outcome::holds("the gateway left OP and returned"),
        false => Outcome::differs("the gateway left OP and did not return within 30 s"),
    })
}

const SYNC0_CYCLE: Duration = Duration::from_millis(4);

/// Sync0 with this word: the pulses counted, or the reason for which OP was not reached.
fn pulses(probe: &mut Probe, assign_activate: u16) -> Result<std::result::Result<u32, String>> {
    probe.assign_activate = assign_activate;
    let sync0_shift = Some(SYNC0_CYCLE / 2);
    let setup = Setup { cycle: SYNC0_CYCLE, sync0_shift, ..Setup::plain() };
    let session = match probe.session(&setup) {
        Ok(session) => session,
        Err(Interruption::NotInOp { reason, .. }) => return Ok(Err(reason)),
        Err(other) => return Err(other),
    };
    let before = session.read(0x9011, 2)?;
    session.cycles(10)?;
    Ok(Ok(session.read(0x9011, 2)?.wrapping_sub(before)))
}

pub(in crate::probe) fn sync0(probe: &mut Probe) -> Result<Outcome> {
    // The plainest configuration reaches OP.
    probe.session(&Setup::plain())?;
    let reason = match pulses(probe, SYNC0)? {
        Ok(pulses) => {
            let detail = format!("0x9011:02 counted {pulses} pulses in some 15 cycles");
            return Ok(Outcome::decided(pulses > 0, detail));
        }
        Err(reason) => reason,
    };
    let detail = format!("OP not reached with 0x0300: {reason}");
    match pulses(probe, SYNC0_AND_SYNC1)? {
        Ok(pulses) => {
            let detail = format!("{detail}; 0x9011:02 counted {pulses} pulses with 0x0700");
            Ok(Outcome::differs(detail).like("0x0700"))
        }
        Err(_) => {
            probe.assign_activate = SYNC0;
            Ok(Outcome::differs(format!("{detail}; the same with 0x0700")))
        }
    }
}

const WATCHDOG_MS: u64 = 20;
/// Pauses of the process data: shorter and longer than the watchdog, and longer than its usual default.
const PAUSES_MS: [u64; 3] = [WATCHDOG_MS * 7 / 10, WATCHDOG_MS * 15 / 10, 150];

pub(in crate::probe) fn watchdog(probe: &mut Probe) -> Result<Outcome> {
    let setup = Setup { watchdog: Duration::from_millis(WATCHDOG_MS), ..Setup::plain() };
    let mut found = Vec::new();
    for gap_ms in PAUSES_MS {
        let session = probe.session(&setup)?;
        session.cycles(5)?;
        let clock = session.adapter.ecrt().clock().clone();
        clock.sleep_until_ns(clock.now_ns() + gap_ms * 1_000_000);
        let (state, code) = session.al_status()?;
        let has_left = session.take_missed() > 0 || state != Some(AlState::Op);
        found.push((has_left, code));
    }
    probe.end_session()?;
    let text = |(has_left, code): &(bool, u16)| match (has_left, code) {
        (false, _) => "in OP".to_owned(),
        (true, 0) => "not in OP".to_owned(),
        (true, code) => format!("not in OP, with AL status 0x{code:04X}"),
    };
    let detail = format!(
        "watchdog of {WATCHDOG_MS} ms: {} after pauses of 14, 30 and 150 ms",
        found.iter().map(text).collect::<Vec<_>>().join(", ")
    );
    // The master may have acknowledged the error before the code was read.
    Ok(match found[..] {
        [(false, _), (true, 0 | 0x001B), (true, _)] => Outcome::holds(detail),
        [(false, _), (false, _), (true, 0 | 0x001B)] => Outcome::differs(detail).like("fixed"),
        [(false, _), (false, _), (false, _)] => Outcome::differs(detail).like("none"),
        _ => Outcome::differs(detail),
    })
}

/// Error code "life guard".
const LIFE_GUARD: u16 = 0x8130;

/// Lets the watchdog expire, and reads an object: with its response the master receives the emergency.
pub(in crate::probe) fn emergencies(probe: &mut Probe) -> Result<Outcome> {
    let setup = Setup { watchdog: Duration::from_millis(WATCHDOG_MS), ..Setup::plain() };
    let session = probe.session(&setup)?;
    session.cycles(5)?;
    // Those of the start.
    emergency_codes(session);
    let clock = session.adapter.ecrt().clock().clone();
    clock.sleep_until_ns(clock.now_ns() + PAUSES_MS[2] * 1_000_000);
    let mut codes = emergency_codes(session);
    if codes.is_empty() {
        // Fails if the master configures the gateway again.
        let _ = session.read_while_silent(0x8010, 2);
        codes = emergency_codes(session);
    }
    let (state, _) = session.al_status()?;
    session.take_missed();
    probe.end_session()?;
    if !codes.is_empty() {
        let detail =
            format!("emergencies {codes:04X?} (hexadecimal) after a pause of the process data");
        return Ok(Outcome::decided(codes.contains(&LIFE_GUARD), detail));
    }
    Ok(match state {
        Some(AlState::SafeOp) => {
            Outcome::differs("the watchdog ended OP without an emergency").like("none")
        }
        _ => Outcome::undecided(
            "no emergency: the watchdog did not end OP, or the master left SAFEOP before it fetched one",
        ),
    })
}

fn emergency_codes(session: &mut Session) -> Vec<u16> {
    let code = |[low, high, ..]: [u8; 8]| u16::from_le_bytes([low, high]);
    std::iter::from_fn(|| session.adapter.take_emergency(0)).map(code).collect()
}
