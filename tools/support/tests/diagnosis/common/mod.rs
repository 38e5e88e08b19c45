//! A gateway that is well, and what is found when one thing changes.

use ecan_tool_support::diagnosis::{Finding, Snapshot, findings};

/// A gateway in OP with N = 8 and all channels running well.
pub fn healthy() -> Snapshot {
    let mut snapshot = Snapshot { al_state: 8, al_status_code: Some(0), ..Snapshot::default() };
    for (profile, assignment) in [(0x8010, 0x1C13), (0x8011, 0x1C12)] {
        snapshot.set(assignment, 0, 8);
        snapshot.set(profile, 3, 8);
        snapshot.set(profile, 4, 0x0F);
        for (subindex, value) in
            [(2, 0), (9, 1024), (10, 1000), (12, 0x0000_01E7), (14, 0), (15, 0), (16, 0)]
        {
            snapshot.set(profile, subindex, value);
        }
    }
    snapshot.set(0x8000, 4, 400_000_000);
    for (subindex, value) in [(1, 5000), (2, 5000), (4, 40_000), (5, 48_000)] {
        snapshot.set(0x9011, subindex, value);
    }
    for channel in 0..4 {
        for (subindex, value) in
            [(2, 0), (4, 0), (8, 0), (15, 1), (19, 500_000), (20, 2_000_000), (21, 800), (22, 800)]
        {
            snapshot.set(0x8001 + channel, subindex, value);
        }
        snapshot.set(0x8021 + channel, 1, 1);
        snapshot.set(0x8021 + channel, 3, 0);
        snapshot.set(0x8021 + channel, 14, 1);
        // Idle, no error; run with CAN FD; 32 free transmit elements.
        for (subindex, value) in [(1, 0), (2, 0x070F), (3, 0x0A01), (6, 32), (9, 0x000A)] {
            snapshot.set(0x9000 + channel, subindex, value);
        }
    }
    snapshot.set(0xB000, 6, 0);
    snapshot
}

/// The only finding behind a change of the healthy gateway.
pub fn only(change: impl FnOnce(&mut Snapshot)) -> Finding {
    let mut snapshot = healthy();
    change(&mut snapshot);
    let mut found = findings(&snapshot);
    assert_eq!(found.len(), 1, "{found:#?}");
    let found = found.remove(0);
    assert!(!found.causes.is_empty() && !found.next.is_empty(), "{found:#?}");
    found
}

/// Sets index, subindex and value of several objects.
pub fn set_all(snapshot: &mut Snapshot, values: &[(u16, u8, u32)]) {
    for (index, subindex, value) in values {
        snapshot.set(*index, *subindex, *value);
    }
}

/// As [`only`], with these values changed.
pub fn with_all(values: &[(u16, u8, u32)]) -> Finding {
    only(|snapshot| set_all(snapshot, values))
}

/// As [`only`], with one value changed.
pub fn with(index: u16, subindex: u8, value: u32) -> Finding {
    with_all(&[(index, subindex, value)])
}
