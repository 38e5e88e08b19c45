//! Findings if OP is not reached or was left (manual 5.4.6, 16.1).

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{CHUNK_BYTES, Direction, SyncManagerLayout};

use super::{Finding, Location};
use crate::diagnosis::snapshot::Snapshot;

/// Minimum time from a Sync0 pulse to the outputs in microseconds; below, the outputs may have missed
/// the pulse.
const CLOSE_AFTER_US: f64 = 20.0;
/// Minimum time from the outputs to the next Sync0 pulse in microseconds, which the firmware needs to
/// read them.
const CLOSE_BEFORE_US: f64 = 50.0;
/// N from which process data exceed one datagram.
const LARGE_CHUNKS: u32 = 12;

const SHIFT_TOO_SMALL: &str =
    "the DC shift is too small: outputs arrive around or after Sync0, and the firmware misses them";
const OTHER_CHUNKS: &str =
    "the assignment 0x1C12/0x1C13 has another number of chunks than N of 0x8010/0x8011";
const WRONG_SII: &str = "SM2/SM3 in the SII are not 0x1100 and 0x1D00 with 3072 bytes and control bytes \
                         0x66 and 0x22";
const OTHER_DOMAIN: &str = "the FMMUs do not cover the process data: the master needs a domain for each gateway, \
                            and one with patches for large PDOs only where N exceeds a datagram";

pub(super) fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    found.extend(state(snapshot));
    found.extend(silence(snapshot));
    found.extend(assignment(snapshot, 0x8010, 0x1C13, Location::TxPdo));
    found.extend(assignment(snapshot, 0x8011, 0x1C12, Location::RxPdo));
    found.extend(sync_managers(snapshot));
    found.extend(large_images(snapshot));
    found.extend(sync_phase(snapshot));
    found
}

fn state(snapshot: &Snapshot) -> Option<Finding> {
    if let Some(code) = snapshot.status_code() {
        return status_code(snapshot, code);
    }
    let has_error = snapshot.has_error_flag || snapshot.al_state & 0x10 != 0;
    let fault = |id, what: String| Finding::fault(id, Location::Slave, what);
    let warning = |id, what| Finding::warning(id, Location::Slave, what);
    match (snapshot.state(), has_error) {
        (None, _) if snapshot.al_state == 0 => None,
        (None, _) => {
            fault("state-unknown", format!("invalid AL state 0x{:02X}", snapshot.al_state))
                .causes(&[
                    "the slave is starting, or its link is disturbed",
                    "the slave controller has no working EEPROM",
                ])
                .next_step("read again, then check the cable and the link LEDs", "16.1")
        }
        (Some(AlState::Op), false) | (Some(AlState::PreOp), false) => None,
        (Some(AlState::Boot), _) => {
            warning("state-boot", "the gateway is in BOOT, for a firmware update")
                .causes(&["a firmware update is in progress", "a firmware update was interrupted"])
                .next_step("wait for the end of the update or repeat it, then power-cycle", "15.7")
        }
        (Some(AlState::Init), false) => {
            fault("state-init", "the gateway stays in INIT, without mailbox".to_owned())
                .causes(&[
                    "the master is still scanning the bus",
                    "the mailbox sync managers of the SII are damaged",
                    "the master has no configuration for the slave",
                ])
                .next_step(
                    "retry after some seconds, then search the kernel log for the slave",
                    "16.1",
                )
        }
        (Some(AlState::SafeOp), false) => warning(
            "state-safeop",
            "the gateway is in SAFEOP: inputs are valid, outputs are ignored",
        )
        .causes(&[
            "the master is changing to OP, or was configured to stay in SAFEOP",
            "the application no longer sends process data",
            "SM2, the assignment 0x1C12 and the profile 0x8011 do not match",
        ])
        .next_step("check that the application runs with a complete working counter", "16.1"),
        (Some(state), true) => held(snapshot, state),
    }
}

/// The master reports an error without a code of the slave.
fn held(snapshot: &Snapshot, state: AlState) -> Option<Finding> {
    let what = format!("the master reports an error and keeps the gateway in {state}");
    let finding = Finding::fault("state-error", Location::Slave, what);
    let finding = match state {
        AlState::SafeOp | AlState::Op => finding.causes(&[
            "process data stop for longer than the watchdog time: the application misses its \
             cycle, or frames are lost",
            SHIFT_TOO_SMALL,
            "SM2, the assignment 0x1C12 and the profile 0x8011 do not match",
        ]),
        _ => finding.causes(&[
            "a startup SDO was aborted: a value of the configuration that this firmware does not \
             take",
            OTHER_CHUNKS,
            WRONG_SII,
        ]),
    };
    let code = match snapshot.al_status_code {
        None => "read the AL status code (ethercat reg_read 0x0134) and the kernel log",
        Some(_) => "read the kernel log for the failed SDO or step",
    };
    let next = format!("{code}; check the SII: `ecan doctor` or ecan_sii_sm_layout.sh check");
    finding.next_step(next, "16.1")
}

fn status_code(snapshot: &Snapshot, code: AlStatusCode) -> Option<Finding> {
    let state =
        snapshot.state().map_or_else(|| "an unknown state".to_owned(), |state| state.to_string());
    let what = format!("the gateway is in {state} with AL status code {code}");
    let (id, causes, next): (_, &[&str], _) = match code.0 {
        0x001B | 0x002A => (
            "al-watchdog",
            &[
                "the application stopped, or a cycle was late by more than the watchdog time",
                "EtherCAT frames are lost: cable, connector, network interface",
                SHIFT_TOO_SMALL,
                "the host pauses: no real-time priority, power saving, interrupt coalescing",
                "the watchdog time is too short for the cycle of the application",
            ],
            "check the cycle statistics of the application and its DC shift, then run `ecan doctor`",
        ),
        0x0017 | 0x001C | 0x001D | 0x001E | 0x0024 | 0x0025 => (
            "al-sync-manager",
            &[
                OTHER_CHUNKS,
                WRONG_SII,
                "the profile was written but not applied before SAFEOP",
                OTHER_DOMAIN,
            ],
            "compare N on both sides, then check the SII: `ecan doctor` or \
             ecan_sii_sm_layout.sh check",
        ),
        0x001A | 0x002C..=0x002E | 0x0030..=0x0037 => (
            "al-sync",
            &[
                SHIFT_TOO_SMALL,
                "Sync0 is not generated: AssignActivate or the Sync0 period is wrong",
                "the jitter of the host's cycle exceeds the shift",
            ],
            "compare the shift with the usable ones of `ecan config check` or `--plan`, the Sync0 \
             period with the cycle; check 0x9011:02, :04, :05",
        ),
        0x0016 | 0x0015 | 0x0043 | 0x0044 => (
            "al-mailbox",
            &[
                "the mailbox sync managers of the SII are damaged",
                "the configuration of the master uses other mailbox addresses",
            ],
            "run ecan_sii_sm_layout.sh check; compare the ESI file with the firmware",
        ),
        0x0006 | 0x0050 | 0x0051 => (
            "al-eeprom",
            &[
                "the SII is from another firmware",
                "the SII is damaged, or its emulation does not respond",
            ],
            "rebuild the EEPROM (0xB000:04 bit 6, in factory mode) and power-cycle",
        ),
        _ => (
            "al-error",
            &[
                "the master requests a function that this firmware does not support",
                "a startup SDO was aborted before",
            ],
            "read the kernel log for the failed step",
        ),
    };
    let mut causes = causes.to_vec();
    if let Some(first) = evident_cause(snapshot, id)
        && let Some(index) = causes.iter().position(|cause| *cause == first)
    {
        causes[..=index].rotate_right(1);
    }
    Finding::fault(id, Location::Slave, what).causes(&causes).next_step(next, "16.1")
}

/// Cause that other values of the snapshot show, or that remains since they exclude the others.
fn evident_cause(snapshot: &Snapshot, id: &str) -> Option<&'static str> {
    match id {
        "al-watchdog" => {
            let is_close = sync_phase(snapshot).is_some_and(|found| found.id == "sync-shift-small");
            is_close.then_some(SHIFT_TOO_SMALL)
        }
        "al-sync-manager" => {
            let has = |id| sync_managers(snapshot).iter().any(|finding| finding.id == id);
            let has_profiles =
                [0x8010, 0x8011].iter().all(|object| snapshot.active_bytes(*object).is_some());
            match () {
                () if has("sync-manager-layout") => Some(WRONG_SII),
                () if !has_profiles || has("sync-manager-length") => None,
                () if differs(snapshot) => None,
                () => snapshot.sync_managers.map(|_| OTHER_DOMAIN),
            }
        }
        _ => None,
    }
}

/// Returns whether an assignment has another size than the active profile.
fn differs(snapshot: &Snapshot) -> bool {
    assignment(snapshot, 0x8010, 0x1C13, Location::TxPdo).is_some()
        || assignment(snapshot, 0x8011, 0x1C12, Location::RxPdo).is_some()
}

fn silence(snapshot: &Snapshot) -> Option<Finding> {
    let why = snapshot.silence.as_ref()?;
    Finding::fault("mailbox-silent", Location::Slave, format!("objects cannot be read: {why}"))
        .causes(&[
            "the gateway is not in PREOP or higher, or it is starting",
            "process data leave no bandwidth for the mailbox in the cycle; of N = 12 and more a master that \
             does not split them sends nothing at all",
            "the link is disturbed",
        ])
        .next_step("bring it to PREOP; check its state with `ecan scan`", "16.1")
}

/// Compares the mapping of the master with the active profile.
fn assignment(
    snapshot: &Snapshot,
    profile: u16,
    assignment: u16,
    location: Location,
) -> Option<Finding> {
    let bytes = snapshot.active_bytes(profile)?;
    let chunks = snapshot.get(assignment, 0)?;
    if u64::from(chunks) * CHUNK_BYTES as u64 == u64::from(bytes) {
        return None;
    }
    let what = format!(
        "0x{assignment:04X} assigns {chunks} chunks, the active profile (0x{profile:04X}) has \
         {bytes} bytes, N = {}",
        bytes / CHUNK_BYTES as u32
    );
    let next = "write the assignment, then the profile, then its apply command, all in PREOP";
    Finding::fault("assignment-differs", location, what)
        .causes(&[
            "the master project selects another number of chunks than it writes as PDO size \
             multiplier",
            "the profile was applied before the assignment was written",
            "another program changed the assignment later",
        ])
        .next_step(next, "5.4.6, 16.1")
}

/// SM2 and SM3 as the master configured them, against manual 5.3 and the active profiles.
fn sync_managers(snapshot: &Snapshot) -> Vec<Finding> {
    let Some(registers) = snapshot.sync_managers else { return Vec::new() };
    let found = registers.map(SyncManagerLayout::from_bytes);
    let known = [("SM2", Direction::RxPdo, 0x1C12), ("SM3", Direction::TxPdo, 0x1C13)];
    let configured = found.into_iter().zip(known).filter(|(manager, _)| manager.length != 0);
    configured
        .filter_map(|(manager, (name, direction, assignment))| {
            let location = match direction {
                Direction::TxPdo => Location::TxPdo,
                Direction::RxPdo => Location::RxPdo,
            };
            if !manager.has_required_start_and_control(direction) {
                return wrong_sync_manager(name, manager, direction, location);
            }
            let bytes = snapshot.active_bytes(direction.profile_object())?;
            if bytes == u32::from(manager.length) {
                return None;
            }
            let what = format!(
                "{name} has {} bytes, the active profile (0x{:04X}) {bytes}",
                manager.length,
                direction.profile_object(),
            );
            let next = format!(
                "compare the number of chunks in 0x{assignment:04X} with N in 0x{:04X}:03, then apply the \
                 profile again in PREOP",
                direction.profile_object()
            );
            Finding::fault("sync-manager-length", location, what)
                .causes(&[
                    "the master project selects another number of chunks than it writes as PDO size \
                     multiplier",
                    "the profile was applied before the assignment was written",
                ])
                .next_step(next, "5.4.6, 16.1")
        })
        .collect()
}

fn wrong_sync_manager(
    name: &str,
    found: SyncManagerLayout,
    direction: Direction,
    location: Location,
) -> Option<Finding> {
    let required = SyncManagerLayout::required(direction);
    let what = format!(
        "{name} has start 0x{:04X} and control byte 0x{:02X} instead of 0x{:04X} and 0x{:02X}",
        found.start, found.control, required.start, required.control
    );
    Finding::fault("sync-manager-layout", location, what)
        .causes(&[
            "the SII has a wrong layout: masters take SM2 and SM3 from there",
            "the project of the master has other sync managers, from an ESI file of another firmware",
        ])
        .next_step(
            "run `ecan doctor` or ecan_sii_sm_layout.sh check, then fix; power-cycle the gateway",
            "15.7, 16.1",
        )
}

fn large_images(snapshot: &Snapshot) -> Option<Finding> {
    let bytes =
        [0x8010, 0x8011].into_iter().filter_map(|object| snapshot.active_bytes(object)).max()?;
    let chunks = bytes / CHUNK_BYTES as u32;
    if chunks < LARGE_CHUNKS || snapshot.state() == Some(AlState::Op) {
        return None;
    }
    let what = format!("N = {chunks}: {bytes} bytes exceed one EtherCAT datagram");
    Finding::warning("images-large", Location::Slave, what)
        .causes(&[
            "the installed master does not split process data over datagrams: N is at most 11",
            "an old application maps several gateways into one domain",
        ])
        .next_step("use N of 11 or less, or a master that supports large PDOs", "16.1")
}

/// Outputs that arrive around a pulse, by 0x9011:04, :05 and the Sync0 period, which is not known in
/// every case.
fn sync_phase(snapshot: &Snapshot) -> Option<Finding> {
    let pulses = snapshot.get(0x9011, 2)?;
    let (min, max) = (snapshot.get(0x9011, 4)? as i32, snapshot.get(0x9011, 5)? as i32);
    let clock_hz = snapshot.get(0x8000, 4).filter(|hz| *hz != 0)?;
    if pulses == 0 || (min, max) == (0, 0) {
        return None;
    }
    let us = |cycles: i32| f64::from(cycles) * 1e6 / f64::from(clock_hz);
    let (min, max) = (us(min), us(max));
    let period = snapshot.sync0_period_ns.filter(|ns| *ns != 0).map(|ns| f64::from(ns) / 1e3);
    if let Some(period) = period.filter(|period| max > *period) {
        let what = format!(
            "0x9011:05, read in CPU cycles, is {max:.1} us, more than the Sync0 period of {period:.1} us: the \
             times of outputs around Sync0 are not examined"
        );
        return Finding::warning("sync-phase-unit", Location::Slave, what)
            .causes(&[
                "the value is older than the Sync0 period",
                "the firmware reports another unit than CPU cycles (assumption H25)",
            ])
            .next_step("run `ecan diag --clear`, check again", "13.2.4");
    }
    let before = period.map(|period| period - max).filter(|before| *before < CLOSE_BEFORE_US);
    let what = match before {
        _ if min < CLOSE_AFTER_US => format!(
            "outputs arrive {min:.1} to {max:.1} us after a Sync0 pulse: some come when the pulse is \
             just over, and the firmware misses them"
        ),
        Some(before) => format!(
            "outputs arrive {before:.1} us before a Sync0 pulse at the latest: the firmware misses \
             those that it has not read when the pulse comes"
        ),
        None => return None,
    };
    let next = "compare the shift with the usable ones of `ecan config check` or `--plan`, increase it \
                by more than the jitter, run `ecan diag --clear`, check again; \
                `mcan_gateway_tx_probe --sweep` finds the usable shifts of the machine";
    Finding::warning("sync-shift-small", Location::Slave, what)
        .causes(&[
            "the DC shift is too small: outputs are not there before Sync0 and are missed, with \
             incomplete working counters or loss of OP",
            "the host's cycle has jitter: no real-time priority, power saving, interrupt coalescing",
        ])
        .next_step(next, "16.1, 15.6.1")
}
