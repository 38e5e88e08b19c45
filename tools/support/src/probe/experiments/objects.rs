//! Objects in PREOP: identity, entries that a firmware may lack, services of the mailbox, and the maintenance
//! command that validates a received firmware image, which changes nothing.

use std::fmt::Write as _;
use std::time::Duration;

use ecan_host::{Error, Maintenance, MaintenanceError};
use ecan_protocol::device::{
    AccessMode, AlState, Capabilities, MaintenanceCommand, MaintenanceStatus,
};
use ecan_protocol::mapping::{
    Direction, MAX_MULTIPLIER, assignment_index, map_subindex, pdo_map_index,
};
use ecan_protocol::object::{AbortCode, Access, object};

use crate::probe::outcome::{Interruption, Outcome, Result};
use crate::probe::run::Probe;
use crate::probe::sdo::Upload;
use crate::probe::session::{SYNC0, SYNC0_AND_SYNC1, Session, Setup};

/// Objects that versions of the firmware may lack, of the first channel only.
const EXAMINED: [u16; 6] = [0xF000, 0x8030, 0x8021, 0x8001, 0x9011, 0x9020];
/// Of 0x8001 only the entry that was added.
const CHANNEL_CONFIG_ADDED: u8 = 74;

struct Missing {
    index: u16,
    subindices: Vec<u8>,
    is_whole: bool,
    abort: u32,
}

fn find_missing(probe: &Probe) -> Result<Vec<Missing>> {
    let mut found = Vec::new();
    for index in EXAMINED {
        let entries = object(index).map_or(&[][..], |object| object.entries);
        let examined: Vec<_> = entries
            .iter()
            .filter(|entry| entry.access != Access::Wo && entry.subindex != 0)
            .map(|entry| entry.subindex)
            .filter(|subindex| index != 0x8001 || *subindex == CHANNEL_CONFIG_ADDED)
            .collect();
        let (mut subindices, mut abort) = (Vec::new(), 0);
        for subindex in &examined {
            if let Upload::Aborted(code) = probe.sdo().try_read(index, *subindex)? {
                subindices.push(*subindex);
                abort = code;
            }
        }
        if !subindices.is_empty() {
            let is_whole = subindices.len() == examined.len() && index != 0x8001;
            found.push(Missing { index, subindices, is_whole, abort });
        }
    }
    Ok(found)
}

/// `0xF000:4..8`, as in a scenario file.
fn ranges(missing: &Missing) -> Vec<String> {
    let index = missing.index;
    if missing.is_whole {
        return vec![format!("0x{index:04X}")];
    }
    let mut texts = Vec::new();
    for run in missing.subindices.chunk_by(|a, b| b - a == 1) {
        let mut text = format!("0x{index:04X}:");
        match run {
            [only] => _ = write!(text, "{only}"),
            [first, .., last] => _ = write!(text, "{first}..{last}"),
            [] => continue,
        }
        texts.push(text);
    }
    texts
}

pub(in crate::probe) fn missing_entries(probe: &mut Probe) -> Result<Outcome> {
    let missing = find_missing(probe)?;
    if missing.is_empty() {
        return Ok(Outcome::holds("every entry was read"));
    }
    let texts: Vec<_> = missing.iter().flat_map(ranges).collect();
    let quoted: Vec<_> = texts.iter().map(|text| format!("\"{text}\"")).collect();
    Ok(Outcome::differs(format!("missing: {}", texts.join(", ")))
        .like(format!("[{}]", quoted.join(", "))))
}

pub(in crate::probe) fn missing_abort(probe: &mut Probe) -> Result<Outcome> {
    let Some(missing) = find_missing(probe)?.pop() else {
        return Ok(Outcome::undecided("no entry is missing"));
    };
    let detail =
        format!("an access to 0x{:04X} aborts with 0x{:08X}", missing.index, missing.abort);
    Ok(match missing.abort {
        0x0609_0011 => Outcome::holds(detail),
        0x0602_0000 => Outcome::differs(detail).like("no_object"),
        _ => Outcome::differs(detail),
    })
}

pub(in crate::probe) fn mapped_subindex(probe: &mut Probe) -> Result<Outcome> {
    let mut subindices = [0; 2];
    for (direction, subindex) in Direction::ALL.into_iter().zip(&mut subindices) {
        let entry = probe.sdo().read(pdo_map_index(direction, 0), map_subindex(0))?;
        let [high, low, found, bits] = entry.to_be_bytes();
        if bits != 128 {
            let index = u16::from_be_bytes([high, low]);
            return Ok(Outcome::differs(format!("0x{index:04X} is mapped with {bits} bits")));
        }
        *subindex = found;
    }
    let [tx, rx] = subindices;
    let detail = format!("0x1600:01 maps subindex {rx}, 0x1A00:01 subindex {tx}");
    Ok(match (tx, rx) {
        (1, 1) => Outcome::holds(detail),
        (0, 0) => Outcome::differs(detail).like("zero"),
        _ => Outcome::differs(detail),
    })
}

const VENDOR_ID: u32 = 0x4543;
const PRODUCT_CODE: u32 = 0x4C49_5445;

pub(in crate::probe) fn vendor(probe: &mut Probe) -> Result<Outcome> {
    let sii = probe.diagnostics.slave_info(probe.slave)?.vendor_id;
    compare_identity(probe, sii, 1, VENDOR_ID)
}

pub(in crate::probe) fn product(probe: &mut Probe) -> Result<Outcome> {
    let sii = probe.diagnostics.slave_info(probe.slave)?.product_code;
    compare_identity(probe, sii, 2, PRODUCT_CODE)
}

fn compare_identity(probe: &Probe, sii: u32, subindex: u8, assumed: u32) -> Result<Outcome> {
    let object = probe.sdo().read(0x1018, subindex)?;
    if object != sii {
        let detail = format!("0x1018:{subindex:02} is 0x{object:08X}, the SII has 0x{sii:08X}");
        return Ok(Outcome::differs(detail));
    }
    let detail = format!("SII and 0x1018:{subindex:02} are 0x{sii:08X}");
    Ok(Outcome::decided(sii == assumed, detail).like(sii))
}

pub(in crate::probe) fn serial(probe: &mut Probe) -> Result<Outcome> {
    let [low, high] =
        [probe.sdo().read(Capabilities::INDEX, 7)?, probe.sdo().read(Capabilities::INDEX, 8)?];
    let serial = u64::from(high) << 32 | u64::from(low);
    if matches!(serial, 0 | u64::MAX) {
        let detail = format!("0xF000:07 and :08 are {serial}: gateways cannot be distinguished");
        return Ok(Outcome::differs(detail).like(serial));
    }
    probe.profile.serial = Some(serial);
    let version = |subindex| probe.sdo().read(Capabilities::INDEX, subindex);
    if let (Ok(major), Ok(minor)) = (version(5), version(6)) {
        probe.profile.firmware = Some((major, minor));
    }
    Ok(Outcome::holds(format!("0xF000:07 and :08 are {serial}")))
}

/// Time after PREOP in which a master has fetched the dictionary, in ns.
const FETCH_NS: u64 = 8_000_000_000;
const FETCH_POLL_NS: u64 = 200_000_000;

pub(in crate::probe) fn sdo_information(probe: &mut Probe) -> Result<Outcome> {
    let end_ns = probe.clock().now_ns().saturating_add(FETCH_NS);
    loop {
        let count = probe.diagnostics.slave_info(probe.slave)?.sdo_count;
        if count > 0 {
            return Ok(Outcome::holds(format!("the master found {count} objects")));
        }
        if probe.clock().now_ns() >= end_ns {
            let detail = "the master found no object within 8 s after PREOP";
            return Ok(Outcome::differs(detail).like("none"));
        }
        probe.sleep_ns(FETCH_POLL_NS);
    }
}

/// Writes the PDO assignment as it is; each session writes it again.
pub(in crate::probe) fn complete_access(probe: &mut Probe) -> Result<Outcome> {
    let index = assignment_index(Direction::RxPdo);
    let count = probe.sdo().read(index, 0)?;
    let mut block = count.to_le_bytes()[..2].to_vec();
    for nth in 1..=count.min(u32::from(MAX_MULTIPLIER)) {
        let pdo = probe.sdo().read(index, nth as u8)?;
        block.extend(&pdo.to_le_bytes()[..2]);
    }
    let written = probe.diagnostics.sdo_download_complete(probe.slave, index, &block);
    Ok(match written {
        Ok(()) => Outcome::differs("a download of 0x1C12 succeeded").like("true"),
        Err(Error::Sdo { abort_code: Some(AbortCode::UNSUPPORTED_ACCESS), .. }) => {
            Outcome::holds("a download of 0x1C12 aborts with 0x06010000")
        }
        Err(Error::Sdo { abort_code: Some(code), .. }) => {
            Outcome::undecided(format!("a download of 0x1C12 aborts with {code}"))
        }
        Err(error) => return Err(error.into()),
    })
}

/// Cycles with which the transfers are measured, in ms.
const CYCLES_MS: [u64; 2] = [1, 3];
const GAP_NS: u64 = 200_000;
const LONGEST_US: u64 = 2_500;
/// Time of a transfer that a master in the kernel may spend on waiting for timer ticks: three, of 10 ms at
/// most. IgH 1.6.2 needs three of 4 ms on a usual kernel.
const TICKS_US: u64 = 30_000;

/// A transfer has steps of the master, one or more cycles each, and the time of the gateway.
pub(in crate::probe) fn mailbox_delay(probe: &mut Probe) -> Result<Outcome> {
    let [short_ms, long_ms] = CYCLES_MS;
    let short_us = shortest_upload_us(probe, short_ms)?;
    let long_us = shortest_upload_us(probe, long_ms)?;
    let cycles_us = long_us.saturating_sub(short_us) * short_ms / (long_ms - short_ms);
    let ticks_us = if probe.ecrt.is_simulated() { 0 } else { TICKS_US };
    let most_us = short_us.saturating_sub(cycles_us);
    let least_us = most_us.saturating_sub(ticks_us);
    probe.profile.mailbox_us = u32::try_from(most_us).ok();
    let detail = format!(
        "the fastest of 8 SDO uploads took {short_us} us with a cycle of {short_ms} ms and {long_us} us with \
         {long_ms} ms; {least_us} to {most_us} us of it are the gateway's"
    );
    Ok(if most_us <= LONGEST_US {
        Outcome::holds(detail).like(most_us)
    } else if least_us > LONGEST_US {
        Outcome::differs(detail).like(least_us)
    } else {
        Outcome::undecided(detail)
    })
}

fn shortest_upload_us(probe: &mut Probe, cycle_ms: u64) -> Result<u64> {
    let session =
        probe.session(&Setup { cycle: Duration::from_millis(cycle_ms), ..Setup::plain() })?;
    // Some masters advance only if receive and send are apart.
    session.gap_ns = GAP_NS;
    let mut shortest_ns = u64::MAX;
    for _ in 0..8 {
        let start_ns = session.adapter.clock().now_ns();
        session.read(0x8010, 3)?;
        shortest_ns = shortest_ns.min(session.adapter.clock().now_ns() - start_ns);
    }
    Ok(shortest_ns / 1_000)
}

/// Status of the command in a mode.
fn validate(probe: &Probe, mode: AccessMode) -> Result<MaintenanceStatus> {
    let maintenance = Maintenance::new(&probe.diagnostics, probe.slave);
    let command = || -> Result<MaintenanceStatus> {
        match maintenance.command(MaintenanceCommand::Validate, probe.clock()) {
            Ok(()) => Ok(MaintenanceStatus::Ok),
            Err(MaintenanceError::Status(status)) => Ok(status),
            Err(error) => Err(Interruption::from(error)),
        }
    };
    maintenance.in_mode(mode, command)
}

/// The first mode that permits the command, with its status.
fn permitted(probe: &Probe) -> Result<Option<(AccessMode, MaintenanceStatus)>> {
    for mode in [AccessMode::Run, AccessMode::Engineering, AccessMode::Factory] {
        let status = validate(probe, mode)?;
        if status != MaintenanceStatus::Denied {
            return Ok(Some((mode, status)));
        }
    }
    Ok(None)
}

pub(in crate::probe) fn maintenance_mode(probe: &mut Probe) -> Result<Outcome> {
    if probe.sdo().read(0xB000, 2)? != u32::from(AccessMode::Run.raw()) {
        return Ok(Outcome::undecided("another application has requested an access mode"));
    }
    Ok(match permitted(probe)? {
        Some((AccessMode::Run, _)) => {
            Outcome::differs("the command is permitted in run mode").like("run")
        }
        Some((AccessMode::Engineering, _)) => {
            Outcome::holds("denied in run mode, permitted in engineering mode")
        }
        Some((AccessMode::Factory, _)) => {
            Outcome::differs("denied in engineering mode, permitted in factory mode")
                .like("factory")
        }
        None => Outcome::differs("denied in every mode"),
    })
}

pub(in crate::probe) fn maintenance_status(probe: &mut Probe) -> Result<Outcome> {
    let Some((_, status)) = permitted(probe)? else {
        return Ok(Outcome::undecided("the command is denied in every mode"));
    };
    let detail = format!("validating a firmware image ends with status {}", status.raw());
    Ok(match status {
        MaintenanceStatus::Ok => Outcome::undecided("a valid firmware image is stored"),
        MaintenanceStatus::ImageInvalid => Outcome::holds(detail),
        MaintenanceStatus::CrcError => Outcome::differs(detail).like("swapped"),
        _ => Outcome::differs(detail),
    })
}

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
