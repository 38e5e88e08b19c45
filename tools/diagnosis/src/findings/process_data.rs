//! Profiles that are not in force, images that cannot be parsed (manual 5.4.6, 13.2, 16.2).

use ecan_protocol::config::ProfileStatus;
use ecan_protocol::image::{OptionFlags, PdoError};

use crate::finding::{Finding, Location};
use crate::snapshot::Snapshot;

/// Header in front of the frame area, in bytes.
const HEADER_BYTES: u32 = 24;

pub(super) fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    for (index, place) in [(0x8010, Location::TxPdo), (0x8011, Location::RxPdo)] {
        found.extend(status(snapshot, index, place));
        found.extend(frame_area(snapshot, index, place));
        found.extend(last_error(snapshot, index, place));
        found.extend(overflow(snapshot, index, place));
        found.extend(bypass(snapshot, index, place));
    }
    found.extend(diagnostic_test(snapshot));
    found
}

fn status(snapshot: &Snapshot, index: u16, place: Location) -> Option<Finding> {
    let raw = snapshot.get(index, 2)?;
    let status = ProfileStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
    let n = snapshot.number(index, 3);
    let mask = snapshot.told(index, 4, |mask| format!("0x{mask:02X}"));
    let what = format!("the profile was not applied: 0x{index:04X}:02 is {status}");
    let fault = |id| Finding::fault(id, place, what.clone());
    let apply_again = format!("write 0x{index:04X}:01 = 1 in PREOP, then read :02 again");
    Some(match status {
        // What parsing and budgets say is told by their counters.
        ProfileStatus::Ok | ProfileStatus::EncapsulationError | ProfileStatus::Overflow => {
            return None;
        }
        ProfileStatus::InvalidState => fault("profile-state")
            .because(&["the size of the process data was to change in OP"])
            .so("change the profile in PREOP or SAFEOP only", "5.4.2"),
        ProfileStatus::InvalidMultiplier => fault("profile-multiplier")
            .or_because(format!("N is {n}; the gateway takes 1 to 24"))
            .so("write an N of 1 to 24, then apply", "5.2"),
        ProfileStatus::InvalidChannelMask => fault("profile-mask")
            .or_because(format!("the mask is {mask}; bits 0 to 3 are channels, one at least"))
            .so("write a mask of 0x01 to 0x0F, then apply", "13.2"),
        ProfileStatus::InvalidProfile => fault("profile-encapsulation")
            .because(&["the encapsulation profile is none of 0, 1, 4 and 5 (0xF000:12)"])
            .so("write one of them, then apply", "9"),
        ProfileStatus::MappingReloadRequired => fault("profile-mapping-reload")
            .or_because(format!("0x1C12/0x1C13 assign another number of chunks than N = {n}"))
            .because(&[
                "the profile was applied before the assignment was written",
                "the mapping in the master project was changed but not loaded again",
            ])
            .so("select the first N chunks in the master, load its mapping, then apply", "5.4.6"),
        ProfileStatus::PendingApply => Finding::warning("profile-pending", place, what)
            .because(&["a profile was written but its apply command was not"])
            .so(apply_again, "13.2"),
        ProfileStatus::UnsupportedOption => fault("profile-option")
            .because(&[
                "an option flag outside 0xF000:15 is set",
                "the firmware is older than the option",
            ])
            .so("clear the flags that 0xF000:15 does not name, then apply", "9.1"),
        ProfileStatus::Unknown(_) => fault("profile-unknown")
            .because(&["a firmware that is newer than this program"])
            .so(apply_again, "13.2"),
    })
}

fn frame_area(snapshot: &Snapshot, index: u16, place: Location) -> Option<Finding> {
    let bytes = snapshot.active_bytes(index)?;
    let area = snapshot.get(index, 10)?;
    let expected = bytes.checked_sub(HEADER_BYTES);
    if expected == Some(area) {
        return None;
    }
    let what = match expected {
        Some(expected) => {
            format!("{bytes} active bytes leave {area} for frames instead of {expected}")
        }
        None => format!("{bytes} active bytes do not hold the header of {HEADER_BYTES}"),
    };
    let finding = Finding::fault("frame-area", place, what)
        .because(&["the profile changed while it was read", "a firmware with another header"]);
    Some(finding.so("read 0xF000:18 and the profile again", "5.4.2"))
}

fn last_error(snapshot: &Snapshot, index: u16, place: Location) -> Option<Finding> {
    let (raw, count) = (snapshot.get(index, 14)?, snapshot.get(index, 15));
    let error = u16::try_from(raw).ok().and_then(PdoError::from_raw);
    if raw == 0 && count.unwrap_or(0) == 0 {
        return None;
    }
    let (id, causes, next): (_, &[&str], _) = explain(error);
    let last = match error {
        Some(PdoError::Ok) => "the last image was good".to_owned(),
        Some(error) => format!("the last error was {raw} ({error})"),
        None => format!("the last error was {raw}, which the manual does not list"),
    };
    let what = match count {
        Some(count) => format!("{count} PDO errors, {last}"),
        None => format!("PDO errors, their number is unknown, {last}"),
    };
    let finding = match error {
        Some(PdoError::Ok | PdoError::DuplicateSequence) => Finding::warning(id, place, what),
        _ => Finding::fault(id, place, what),
    };
    Some(finding.because(causes).so(next, "5.4.6, 16.2"))
}

/// Name, causes and next step of the encapsulation errors of manual 13.2.
fn explain(error: Option<PdoError>) -> (&'static str, &'static [&'static str], &'static str) {
    const CODEC: &str = "compare the image that the master writes with 5.4.4 byte by byte";
    match error {
        Some(PdoError::Ok) => (
            "pdo-errors-past",
            &["images were refused before; since then good ones have arrived"],
            "clear with `ecan diag --clear` and look whether the counter rises",
        ),
        Some(PdoError::FrameOverrun) => (
            "pdo-frame-overrun",
            &["a CAN FD frame longer than the profile carries"],
            "choose a profile that carries it, or send shorter frames",
        ),
        Some(PdoError::PacketOverrun) => (
            "pdo-packet-overrun",
            &["more packets were written than the frame area holds", "N is too small"],
            "plan the images with `ecan plan` and choose a larger N",
        ),
        Some(PdoError::UnknownKind) => (
            "pdo-unknown-kind",
            &[
                "a packet starts at the wrong byte, so that data are taken for a control word",
                "one side pads packets to 4 bytes (ALIGN4) and the other does not",
            ],
            "compare option flag bit 1 on both sides, then the packet lengths",
        ),
        Some(PdoError::InvalidDlc) => (
            "pdo-invalid-dlc",
            &["a classic frame with a DLC above 8", "a packet starts at the wrong byte"],
            CODEC,
        ),
        Some(PdoError::InvalidChannel) => (
            "pdo-invalid-channel",
            &[
                "frames for a channel that the mask of 0x8011:04 leaves out",
                "a channel number above 3",
            ],
            "put the channel into the mask of 0x8011:04 and apply, or send to another channel",
        ),
        Some(PdoError::InvalidTsf) => (
            "pdo-invalid-timestamp",
            &["a timestamp format that profile or direction does not have"],
            "choose profile 1 or 5 for delta16; schedule only where 0xF000:16 bit 8 is set",
        ),
        Some(PdoError::Truncated) => (
            "pdo-truncated",
            &["payload_len ends inside a packet", "ALIGN4 is set on one side only"],
            CODEC,
        ),
        Some(PdoError::UnsupportedProfile) => (
            "pdo-unsupported-profile",
            &["the encapsulation profile is not in 0xF000:12"],
            "write a profile of 0, 1, 4 or 5 and apply",
        ),
        Some(PdoError::DuplicateSequence) => (
            "pdo-duplicate",
            &[
                "an image was published again after a lost frame, which does no harm",
                "the master does not count seq_begin up with each image",
                "two programs write the process data",
            ],
            "look whether frames are missing on the CAN bus; if so, count the sequence up",
        ),
        Some(PdoError::UnsupportedOption) => (
            "pdo-unsupported-option",
            &["option flags outside 0xF000:15"],
            "clear them, then apply",
        ),
        Some(PdoError::ActiveArea) => (
            "pdo-active-area",
            &[
                "N of the profile and the mapping of the master differ",
                "layout_id in the header is that of another profile",
            ],
            "compare 0x8011:09 with the length of SM2, and layout_id with 0x8011:12",
        ),
        Some(PdoError::ReservedBit) => (
            "pdo-reserved-bit",
            &[
                "a bit that must be 0 is set in a control word or in the header",
                "a packet starts at the wrong byte",
            ],
            CODEC,
        ),
        Some(PdoError::BadHeader) => (
            "pdo-bad-header",
            &[
                "the process data are all zero: nothing writes the header",
                "ver_ihl is not 0x16, or seq_begin and seq_end differ",
                "the image is written while the master sends it",
            ],
            "let the application write a whole header in every cycle, seq_end last",
        ),
        Some(PdoError::BadCrc) => (
            "pdo-bad-crc",
            &[
                "the CRC was computed over other bytes than [24, 24 + payload_len)",
                "the image is written while the master sends it",
                "NO_CRC16 or 0x8030:04 is set on one side only",
            ],
            "check the CRC with the example of 5.4.4, then who writes the image when",
        ),
        Some(PdoError::BadSchedule) => (
            "pdo-bad-schedule",
            &[
                "Sync0 is not active, so that nothing can be scheduled to it",
                "the offset is beyond the Sync0 period",
                "the record is not of format 1",
            ],
            "look at 0x9011:02 for Sync0; keep the offset inside the period",
        ),
        None => (
            "pdo-error-unknown",
            &["a firmware that is newer than this program"],
            "compare with the manual of the firmware",
        ),
    }
}

fn overflow(snapshot: &Snapshot, index: u16, place: Location) -> Option<Finding> {
    let count = snapshot.get(index, 16).filter(|count| *count != 0)?;
    let what = format!("{count} times frames did not fit the process data or were held up");
    let finding = Finding::warning("pdo-overflow", place, what);
    Some(if index == 0x8010 {
        finding
            .because(&[
                "the buses carry more than the TxPDO holds in a cycle: N is too small",
                "the EtherCAT cycle is too long for the traffic",
                "the budget policy keeps room for channels that do not need it",
            ])
            .so("plan the traffic with `ecan plan`; enlarge N or shorten the cycle", "12")
    } else {
        finding
            .because(&[
                "the host sends more than the buses carry",
                "nobody acknowledges on a bus, so that its queue stays full",
                "a channel's transmit budget (0x8021:12 to 0x8024:12) is smaller than the frames of a \
                 cycle",
            ])
            .so("compare the frames sent with the bit rate, then look at the channels", "12")
    })
}

fn bypass(snapshot: &Snapshot, index: u16, place: Location) -> Option<Finding> {
    snapshot.active_bytes(index)?;
    let options = snapshot.get(index, 12)? >> 21 & 0xFF;
    let is_bypassed = options & u32::from(OptionFlags::APP_BYPASS.bits()) != 0;
    is_bypassed.then(|| {
        Finding::fault(
            "app-bypass",
            place,
            "APP_BYPASS is active: CAN is cut off in this direction",
        )
        .because(&["it was switched on for a measurement and left so"])
        .so(format!("clear bit 3 of 0x{index:04X}:07 and apply"), "9.1")
    })
}

fn diagnostic_test(snapshot: &Snapshot) -> Option<Finding> {
    let mut active = Vec::new();
    for subindex in 2..=6 {
        let value = snapshot.get(0x8030, subindex).unwrap_or(0);
        if value != 0 {
            active.push(format!(":{subindex:02} = 0x{value:X}"));
        }
    }
    if active.is_empty() {
        return None;
    }
    let what = format!("diagnostic tests are active: 0x8030 {}", active.join(", "));
    let finding = Finding::fault("diagnostic-test", Location::Device, what)
        .because(&["they were switched on for a measurement and left so"]);
    Some(finding.so("write 0 to 0x8030:02 to :06, then to the key :01; or `ecan reboot`", "13.2.3"))
}
