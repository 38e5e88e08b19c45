//! Access modes, commands and statuses of 0xB000 against the object dictionary.
#![allow(missing_docs)]

use ecan_protocol::device::{AccessMode, MaintenanceCommand, MaintenanceStatus};
use ecan_protocol::object::lookup;

#[test]
fn modes_and_commands_match_the_dictionary() {
    let (_, mode) = lookup(0xB000, 2).unwrap();
    for raw in 0..=u8::MAX {
        let known = AccessMode::from_raw(raw).map(|mode| mode.to_string());
        assert_eq!(known.as_deref(), mode.meaning(raw.into()));
    }
    assert!(AccessMode::Run < AccessMode::Engineering, "more rights are greater");
    assert!(AccessMode::Engineering < AccessMode::Factory);
    let (_, command) = lookup(0xB000, 4).unwrap();
    assert_eq!(command.bits.len(), 7);
    for (bit, name) in command.bits {
        let command = MaintenanceCommand::from_raw(1 << bit).unwrap();
        // "save configuration" and Save
        let first = name.split(' ').next().unwrap();
        let is_same = format!("{command:?}").to_lowercase().starts_with(first);
        assert!(is_same || first == "restore", "{command:?} {name}");
    }
}

#[test]
fn status_display_has_its_number() {
    for raw in 0..=u8::MAX {
        let status = MaintenanceStatus::from_raw(raw);
        assert_eq!(status.raw(), raw);
        assert!(status.to_string().starts_with(&format!("{raw} (")), "{status}");
    }
    let (_, status) = lookup(0xB000, 5).unwrap();
    let denied = MaintenanceStatus::Denied;
    assert_eq!((denied.raw(), status.meaning(2)), (2, Some("denied")));
    assert!(denied.to_string().starts_with("2 (denied"));
    assert_eq!(MaintenanceStatus::from_raw(9).to_string(), "9 (not in the manual)");
}
