//! OP cannot be reached or was left (manual 5.4.6, 16.1).

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::CHUNK_BYTES;

use crate::finding::{Finding, Location};
use crate::snapshot::Snapshot;

/// Outputs that arrive closer behind a Sync0 pulse than this may have missed it, in microseconds.
const CLOSE_US: u32 = 20;
/// N from which process data do not fit one datagram.
const LARGE_CHUNKS: u32 = 12;

pub(super) fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    found.extend(state(snapshot));
    found.extend(silence(snapshot));
    found.extend(assignment(snapshot, 0x8010, 0x1C13, Location::TxPdo));
    found.extend(assignment(snapshot, 0x8011, 0x1C12, Location::RxPdo));
    found.extend(large_images(snapshot));
    found.extend(sync_phase(snapshot));
    found
}

fn state(snapshot: &Snapshot) -> Option<Finding> {
    if let Some(code) = snapshot.status_code() {
        return Some(status_code(snapshot, code));
    }
    let has_error = snapshot.has_error_flag || snapshot.al_state & 0x10 != 0;
    let state = snapshot.state();
    match (state, has_error) {
        (None, _) if snapshot.al_state == 0 => None,
        (None, _) => Some(
            Finding::fault(
                "state-unknown",
                Location::Slave,
                format!("the AL state reads as 0x{:02X}, which is none", snapshot.al_state),
            )
            .because(&[
                "the slave is starting, or its link is bad",
                "the slave controller has no working EEPROM",
            ])
            .so("look again, then at the cable and the link lamps", "16.1"),
        ),
        (Some(AlState::Op), false) | (Some(AlState::PreOp), false) => None,
        (Some(AlState::Boot), _) => Some(
            Finding::warning("state-boot", Location::Slave, "the gateway is in BOOT, for firmware")
                .because(&["a firmware update is under way", "a firmware update was broken off"])
                .so("let the update end, or do it again; then power-cycle", "15.7"),
        ),
        (Some(AlState::Init), false) => Some(
            Finding::fault(
                "state-init",
                Location::Slave,
                "the gateway stays in INIT, without mailbox",
            )
            .because(&[
                "the master is still scanning the bus",
                "the mailbox sync managers of the SII are damaged",
                "the master has no configuration for it and leaves it alone",
            ])
            .so("look again in some seconds; then read the kernel log for its name", "16.1"),
        ),
        (Some(AlState::SafeOp), false) => Some(
            Finding::warning(
                "state-safeop",
                Location::Slave,
                "the gateway is in SAFEOP: its inputs are alive, what it is sent is thrown away",
            )
            .because(&[
                "the master is on its way to OP, or was told to stop there",
                "the application no longer sends process data",
                "SM2, the assignment 0x1C12 and the profile 0x8011 do not fit each other",
            ])
            .so("look whether the application runs and its working counter is complete", "16.1"),
        ),
        (Some(state), true) => Some(held(snapshot, state)),
    }
}

/// The master gave up, without a code from the slave.
fn held(snapshot: &Snapshot, state: AlState) -> Finding {
    let what = format!("the master met an error with the gateway and holds it in {state}");
    let finding = Finding::fault("state-error", Location::Slave, what);
    let finding = match state {
        AlState::SafeOp | AlState::Op => finding.because(&[
            "process data stop for longer than the watchdog: the application does not keep its \
             cycle, or frames are lost",
            "the DC shift is too small, so that outputs come behind Sync0",
            "SM2, the assignment 0x1C12 and the profile 0x8011 do not fit each other",
        ]),
        _ => finding.because(&[
            "a startup SDO was refused: a value of the configuration that this firmware does not \
             take",
            "the assignment 0x1C12/0x1C13 has another number of chunks than N of 0x8010/0x8011",
            "SM2/SM3 in the SII are not 0x1100 and 0x1D00 with 3072 bytes and control bytes 0x66 \
             and 0x22",
        ]),
    };
    let code = match snapshot.al_status_code {
        None => "read the AL status code (ethercat reg_read 0x0134) and the kernel log",
        Some(_) => "read the kernel log: it names the SDO or the step that failed",
    };
    finding.so(format!("{code}; check the SII with scripts/ecan_sii_sm_layout.sh check"), "16.1")
}

fn status_code(snapshot: &Snapshot, code: AlStatusCode) -> Finding {
    let state = snapshot.state().map_or_else(|| "no state".to_owned(), |state| state.to_string());
    let what = format!("the gateway is in {state} with AL status code {code}");
    let (id, causes, next): (_, &[&str], _) = match code.0 {
        0x001B | 0x002A => (
            "al-watchdog",
            &[
                "the application stopped, or its cycle came late by more than the watchdog time",
                "EtherCAT frames are lost: cable, connector, network interface",
                "the host pauses: no real-time priority, power saving, interrupt coalescing",
                "the watchdog that the application sets is too short for its cycle",
            ],
            "look at the cycle statistics of the application, then run `ecan doctor`",
        ),
        0x0017 | 0x001C | 0x001D | 0x001E | 0x0024 | 0x0025 => (
            "al-sync-manager",
            &[
                "the assignment 0x1C12/0x1C13 has another number of chunks than N of \
                 0x8010/0x8011",
                "SM2/SM3 in the SII are not 0x1100 and 0x1D00 with 3072 bytes and control bytes \
                 0x66 and 0x22",
                "the profile was written but not applied before SAFEOP",
            ],
            "compare N on both sides, then scripts/ecan_sii_sm_layout.sh check",
        ),
        0x001A | 0x002C..=0x002E | 0x0030..=0x0037 => (
            "al-sync",
            &[
                "the DC shift is too small: outputs arrive behind Sync0",
                "Sync0 is not generated: AssignActivate or the Sync0 period is wrong",
                "the host's cycle jitters by more than the shift leaves",
            ],
            "enlarge the shift, compare the Sync0 period with the cycle, look at 0x9011:02",
        ),
        0x0016 | 0x0015 | 0x0043 | 0x0044 => (
            "al-mailbox",
            &[
                "the mailbox sync managers of the SII are damaged",
                "a master with a configuration of its own uses other mailbox addresses",
            ],
            "scripts/ecan_sii_sm_layout.sh check; compare the ESI file with the firmware",
        ),
        0x0006 | 0x0050 | 0x0051 => (
            "al-eeprom",
            &[
                "the SII belongs to another firmware",
                "the SII is damaged, or its emulation does not answer",
            ],
            "rebuild the EEPROM (0xB000:04 bit 6, in factory mode) and power-cycle",
        ),
        _ => (
            "al-error",
            &[
                "the master asks for something that this firmware does not do",
                "a startup SDO was refused before",
            ],
            "read the kernel log for the step that failed",
        ),
    };
    Finding::fault(id, Location::Slave, what).because(causes).so(next, "16.1")
}

fn silence(snapshot: &Snapshot) -> Option<Finding> {
    let why = snapshot.silence.as_ref()?;
    let finding =
        Finding::fault("mailbox-silent", Location::Slave, format!("objects cannot be read: {why}"))
            .because(&[
                "the gateway is not in PREOP or higher, or it is starting",
                "process data leave mailbox traffic no room in the cycle",
                "the link to it is bad",
            ]);
    Some(finding.so("bring it to PREOP; look at its state with `ecan scan`", "16.1"))
}

/// The master's mapping against the profile in force.
fn assignment(
    snapshot: &Snapshot,
    profile: u16,
    assignment: u16,
    place: Location,
) -> Option<Finding> {
    let bytes = snapshot.active_bytes(profile)?;
    let chunks = snapshot.get(assignment, 0)?;
    if u64::from(chunks) * CHUNK_BYTES as u64 == u64::from(bytes) {
        return None;
    }
    let what = format!(
        "0x{assignment:04X} assigns {chunks} chunks, the profile in force (0x{profile:04X}) has \
         {bytes} bytes, N = {}",
        bytes / CHUNK_BYTES as u32
    );
    let finding = Finding::fault("assignment-differs", place, what).because(&[
        "the master project selects another number of chunks than it writes as PDO size \
         multiplier",
        "the profile was applied before the assignment was written",
        "another program changed the assignment afterwards",
    ]);
    Some(finding.so(
        "write the assignment, then the profile, then its apply command, all in PREOP",
        "5.4.6, 16.1",
    ))
}

fn large_images(snapshot: &Snapshot) -> Option<Finding> {
    let bytes = [0x8010, 0x8011].into_iter().filter_map(|it| snapshot.active_bytes(it)).max()?;
    let chunks = bytes / CHUNK_BYTES as u32;
    if chunks < LARGE_CHUNKS || snapshot.state() == Some(AlState::Op) {
        return None;
    }
    let what = format!("N = {chunks}: {bytes} bytes do not fit one EtherCAT datagram");
    let finding = Finding::warning("images-large", Location::Slave, what).because(&[
        "the installed master does not split process data over datagrams, so that N is at most 11",
        "an old application maps several gateways into one domain",
    ]);
    Some(finding.so("choose N of 11 or less, or a master that carries large PDOs", "16.1"))
}

fn sync_phase(snapshot: &Snapshot) -> Option<Finding> {
    let pulses = snapshot.get(0x9011, 2)?;
    let (min, max) = (snapshot.get(0x9011, 4)? as i32, snapshot.get(0x9011, 5)? as i32);
    let clock_hz = snapshot.get(0x8000, 4).filter(|hz| *hz != 0)?;
    if pulses == 0 || (min, max) == (0, 0) {
        return None;
    }
    let us = |cycles: i32| f64::from(cycles) * 1e6 / f64::from(clock_hz);
    if us(min) >= f64::from(CLOSE_US) {
        return None;
    }
    let what = format!(
        "outputs arrive from {:.1} to {:.1} us behind a Sync0 pulse: some come when the pulse is \
         just over",
        us(min),
        us(max)
    );
    let finding = Finding::warning("sync-shift-small", Location::Slave, what).because(&[
        "the DC shift is too small, so that outputs of a late cycle miss their pulse",
        "the host's cycle jitters: no real-time priority, power saving, interrupt coalescing",
    ]);
    Some(finding.so(
        "enlarge the shift by more than the jitter, clear with `ecan diag --clear`, look again",
        "16.1",
    ))
}
