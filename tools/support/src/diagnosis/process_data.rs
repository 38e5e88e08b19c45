//! Findings of inactive profiles and invalid images (manual 5.4.6, 13.2, 16.2).

use ecan_protocol::config::ProfileStatus;
use ecan_protocol::image::{BudgetPolicy, OptionFlags, PdoError, PdoProfile};

use super::{Finding, Location};
use crate::diagnosis::snapshot::Snapshot;

/// Size of the header before the frame area, in bytes.
const HEADER_BYTES: u32 = 24;

pub(super) fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    for (index, location) in [(0x8010, Location::TxPdo), (0x8011, Location::RxPdo)] {
        found.extend(status(snapshot, index, location));
        found.extend(frame_area(snapshot, index, location));
        found.extend(last_error(snapshot, index, location));
        found.extend(overflow(snapshot, index, location));
        found.extend(bypass(snapshot, index, location));
    }
    found.extend(diagnostic_test(snapshot));
    found
}

fn status(snapshot: &Snapshot, index: u16, location: Location) -> Option<Finding> {
    let raw = snapshot.get(index, 2)?;
    let status = ProfileStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
    let n = snapshot.number(index, 3);
    let mask = snapshot.text_of(index, 4, |mask| format!("0x{mask:02X}"));
    let what = format!("profile not applied: 0x{index:04X}:02 is {status}");
    let fault = |id| Finding::fault(id, location, what.clone());
    let apply_again = format!("write 0x{index:04X}:01 = 1 in PREOP, then read :02 again");
    match status {
        // Parser and budget errors have counters of their own.
        ProfileStatus::Ok | ProfileStatus::EncapsulationError | ProfileStatus::Overflow => None,
        ProfileStatus::InvalidState => fault("profile-state")
            .cause("the PDO size was changed in OP")
            .next_step("change the profile in PREOP or SAFEOP only", "5.4.2"),
        ProfileStatus::InvalidMultiplier => fault("profile-multiplier")
            .cause(format!("N is {n}; allowed: 1 to 24"))
            .next_step("write an N of 1 to 24, then apply", "5.2"),
        ProfileStatus::InvalidChannelMask => fault("profile-mask")
            .cause(format!("the mask is {mask}; allowed: 0x01 to 0x0F"))
            .next_step("write a mask of 0x01 to 0x0F, then apply", "13.2"),
        ProfileStatus::InvalidProfile => fault("profile-encapsulation")
            .cause("invalid encapsulation profile; allowed: 0, 1, 4 and 5 (0xF000:12)")
            .next_step("write one of them, then apply", "9"),
        ProfileStatus::MappingReloadRequired => fault("profile-mapping-reload")
            .cause(format!("0x1C12/0x1C13 assign another number of chunks than N = {n}"))
            .causes(&[
                "the profile was applied before the assignment was written",
                "the mapping in the master project was changed but not reloaded",
            ])
            .next_step(
                "select the first N chunks in the master, load its mapping, then apply",
                "5.4.6",
            ),
        ProfileStatus::PendingApply => Finding::warning("profile-pending", location, what)
            .cause("the profile was written without apply command")
            .next_step(apply_again, "13.2"),
        ProfileStatus::UnsupportedOption => fault("profile-option")
            .causes(&[
                "an option flag outside 0xF000:15 is set",
                "the firmware is older than the option",
            ])
            .next_step("clear the flags that are not in 0xF000:15, then apply", "9.1"),
        ProfileStatus::Unknown(_) => fault("profile-unknown")
            .cause("the firmware is newer than this program")
            .next_step(apply_again, "13.2"),
    }
}

fn frame_area(snapshot: &Snapshot, index: u16, location: Location) -> Option<Finding> {
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
        None => format!("{bytes} active bytes are smaller than the header of {HEADER_BYTES}"),
    };
    Finding::fault("frame-area", location, what)
        .causes(&["the profile changed during reading", "the firmware uses another header"])
        .next_step("read 0xF000:18 and the profile again", "5.4.2")
}

fn last_error(snapshot: &Snapshot, index: u16, location: Location) -> Option<Finding> {
    let (raw, count) = (snapshot.get(index, 14)?, snapshot.get(index, 15));
    let error = u16::try_from(raw).ok().and_then(PdoError::from_raw);
    let is_of_budget = location == Location::RxPdo && exceeded_budget(snapshot).is_some();
    if raw == 0 && count.unwrap_or(0) == 0 || is_of_budget {
        return None;
    }
    let (id, causes, next): (_, &[&str], _) = match location {
        Location::TxPdo => explain_built(error),
        _ => explain(error),
    };
    let last = match error {
        Some(PdoError::Ok) => "the last image was valid".to_owned(),
        Some(error) => format!("the last error was {raw} ({error})"),
        None => format!("the last error was unknown ({raw})"),
    };
    let what = match count {
        Some(count) => format!("{count} PDO errors, {last}"),
        None => format!("PDO errors, number unknown, {last}"),
    };
    let finding = match error {
        Some(PdoError::Ok | PdoError::DuplicateSequence) => Finding::warning(id, location, what),
        _ => Finding::fault(id, location, what),
    };
    finding.causes(causes).next_step(next, "5.4.6, 16.2")
}

/// Name, causes and next step of an RxPDO error.
type Explanation = (&'static str, &'static [&'static str], &'static str);

/// The budget policy of the RxPDO by which frames were dropped: packets exceeded the share of their channel, not
/// the frame area, which would count as an error of the image (manual 12, assumption H7).
fn exceeded_budget(snapshot: &Snapshot) -> Option<&'static str> {
    snapshot.active_bytes(0x8011)?;
    let value = |subindex| snapshot.get(0x8011, subindex);
    let error = value(14).and_then(|raw| PdoError::from_raw(u16::try_from(raw).ok()?));
    if error != Some(PdoError::PacketOverrun) || value(15) != Some(0) || value(16)? == 0 {
        return None;
    }
    match PdoProfile::from_word(value(12)?)?.budget {
        BudgetPolicy::Deterministic => Some(
            "the budget policy 0x8011:06 is 2 (Deterministic): an image has more frames for a channel than its \
             equal share",
        ),
        BudgetPolicy::Balanced => Some(
            "the budget policy 0x8011:06 is 0 (Balanced): an image has more frames for a channel than its minimum \
             and what the others leave",
        ),
        BudgetPolicy::SharedOnly => None,
    }
}

/// Name, causes and next step of an error of the images that the gateway builds itself (0x8010:14).
fn explain_built(error: Option<PdoError>) -> Explanation {
    match error {
        Some(PdoError::Ok) => (
            "pdo-errors-past",
            &["images could not be built before; later ones are valid"],
            "clear with `ecan diag --clear` and check whether the counter increases",
        ),
        Some(PdoError::FrameOverrun) => (
            "pdo-frame-overrun",
            &[
                "a received CAN FD frame is longer than the profile 0x8010:05 supports",
                "the frame area of the TxPDO is smaller than one packet: N is too small",
            ],
            "use a profile that supports the frames of the bus, and a larger N",
        ),
        Some(PdoError::PacketOverrun) => (
            "pdo-packet-overrun",
            &[
                "a received frame does not fit into the frame area of the TxPDO, or the share of its channel: N \
                 is too small",
                "the budget policy 0x8010:06 reserves space for idle channels",
            ],
            "plan the traffic with `ecan plan`; use a larger N, or Shared only (0x8010:06 = 1)",
        ),
        Some(PdoError::UnsupportedProfile | PdoError::UnsupportedOption) => explain(error),
        Some(PdoError::ActiveArea) => (
            "pdo-active-area",
            &[
                "SM3 has another length than the active TxPDO profile",
                "0x1C13 assigns another number of chunks than N in 0x8010:03",
            ],
            "compare 0x8010:09 with the length of SM3 and with 0x1C13:00",
        ),
        Some(_) => (
            "pdo-build-error",
            &["the firmware built a faulty TxPDO image", "the firmware uses other error numbers"],
            "reset the session (0x8010:08 = 3); if it recurs, send a bundle to support",
        ),
        None => explain(error),
    }
}

/// Name, causes and next step of the encapsulation errors of manual 13.2.
fn explain(error: Option<PdoError>) -> Explanation {
    const CODEC: &str = "compare the image that the master writes with 5.4.4 byte by byte";
    match error {
        Some(PdoError::Ok) => (
            "pdo-errors-past",
            &["images were rejected before; later images are valid"],
            "clear with `ecan diag --clear` and check whether the counter increases",
        ),
        Some(PdoError::FrameOverrun) => (
            "pdo-frame-overrun",
            &["a CAN FD frame longer than the profile supports"],
            "use a profile that supports it, or send shorter frames",
        ),
        Some(PdoError::PacketOverrun) => (
            "pdo-packet-overrun",
            &[
                "more packets were written than fit into the frame area",
                "a channel exceeded its share by the budget policy 0x8011:06 (manual 12)",
                "N is too small",
            ],
            "plan the images with `ecan plan`; use its N, or budget policy 1 (SharedOnly)",
        ),
        Some(PdoError::UnknownKind) => (
            "pdo-unknown-kind",
            &[
                "a packet starts at the wrong byte: data are parsed as a control word",
                "only one side pads packets to 4 bytes (ALIGN4)",
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
            &["frames for a channel that is not in the mask 0x8011:04", "a channel number above 3"],
            "add the channel to the mask 0x8011:04 and apply, or send to another channel",
        ),
        Some(PdoError::InvalidTsf) => (
            "pdo-invalid-timestamp",
            &["a timestamp format that the profile or direction does not support"],
            "use profile 1 or 5 for delta16; schedule only if 0xF000:16 bit 8 is set",
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
                "the master does not increment seq_begin with each image",
                "two programs write the process data",
                "an image was repeated after a lost frame, which is harmless",
            ],
            "check whether CAN frames are missing; if so, increment the sequence",
        ),
        Some(PdoError::UnsupportedOption) => (
            "pdo-unsupported-option",
            &["option flags outside 0xF000:15"],
            "clear them, then apply",
        ),
        Some(PdoError::ActiveArea) => (
            "pdo-active-area",
            &[
                "layout_id in the header belongs to another profile",
                "N of the profile and the mapping of the master differ",
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
                "no complete header is written: the process data are all zero, ver_ihl is not 0x16, or seq_begin and \
                 seq_end differ",
                "the image is modified while the master sends it",
            ],
            "write a complete header in every cycle, seq_end last",
        ),
        Some(PdoError::BadCrc) => (
            "pdo-bad-crc",
            &[
                "the CRC does not cover exactly the bytes [24, 24 + payload_len)",
                "the image is modified while the master sends it",
                "NO_CRC16 or 0x8030:04 is set on one side only",
            ],
            "check the CRC with the example of 5.4.4, then the time of the writes",
        ),
        Some(PdoError::BadSchedule) => (
            "pdo-bad-schedule",
            &[
                "Sync0 is not active",
                "the offset is beyond the Sync0 period",
                "the record is not of format 1",
            ],
            "check 0x9011:02 for Sync0; keep the offset within the period",
        ),
        None => (
            "pdo-error-unknown",
            &["the firmware is newer than this program"],
            "compare with the manual of the firmware",
        ),
    }
}

fn overflow(snapshot: &Snapshot, index: u16, location: Location) -> Option<Finding> {
    let count = snapshot.get(index, 16).filter(|count| *count != 0)?;
    let what = format!("frames did not fit into the process data or were delayed, {count} times");
    let finding = Finding::warning("pdo-overflow", location, what);
    if index == 0x8010 {
        finding
            .causes(&[
                "more frames per cycle on the buses than fit into the TxPDO: N is too small",
                "the EtherCAT cycle is too long for the traffic",
                "the budget policy reserves space for idle channels",
            ])
            .next_step("plan the traffic with `ecan plan`; increase N or shorten the cycle", "12")
    } else {
        finding
            .cause_if(exceeded_budget(snapshot).map(str::to_owned))
            .causes(&[
                "the host sends more frames than the bit rates allow",
                "no acknowledgement on a bus: its queue stays full",
                "a channel's transmit budget (0x8021:12 to 0x8024:12) is smaller than the frames of a \
                 cycle",
            ])
            .next_step(
                "compare the frames of a cycle with 0x8011:06, N and the bit rate, then check the channels",
                "12, 16.2",
            )
    }
}

fn bypass(snapshot: &Snapshot, index: u16, location: Location) -> Option<Finding> {
    snapshot.active_bytes(index)?;
    let options = snapshot.get(index, 12)? >> 21 & 0xFF;
    if options & u32::from(OptionFlags::APP_BYPASS.bits()) == 0 {
        return None;
    }
    let what = "APP_BYPASS is active: CAN is disconnected in this direction";
    Finding::fault("app-bypass", location, what)
        .cause("not reset after a measurement")
        .next_step(format!("clear bit 3 of 0x{index:04X}:07 and apply"), "9.1")
}

fn diagnostic_test(snapshot: &Snapshot) -> Option<Finding> {
    let value =
        |subindex| Some((subindex, snapshot.get(0x8030, subindex).filter(|value| *value != 0)?));
    let active: Vec<_> = (2..=6)
        .filter_map(value)
        .map(|(subindex, value)| format!(":{subindex:02} = 0x{value:X}"))
        .collect();
    if active.is_empty() {
        return None;
    }
    let what = format!("diagnostic tests are active: 0x8030 {}", active.join(", "));
    Finding::fault("diagnostic-test", Location::Device, what)
        .cause("not reset after a measurement")
        .next_step("write 0 to 0x8030:02 to :06, then to the key :01; or `ecan reboot`", "13.2.3")
}
