//! Findings of a channel name the objects of that channel, not those of another.

use std::collections::BTreeSet;

use ecan_tool_support::diagnosis::{Finding, Location, Snapshot, findings};

/// The first object of each family that has one object per channel.
const FAMILIES: [u16; 5] = [0x8001, 0x8021, 0x9000, 0x9020, 0xA000];

/// The objects of these families that a finding names.
fn named(finding: &Finding) -> Vec<u16> {
    let texts = finding.causes.iter().chain([&finding.what, &finding.next]);
    let objects = texts.flat_map(|text| text.split("0x").skip(1)).filter_map(|text| {
        let digits: String = text.chars().take_while(char::is_ascii_hexdigit).collect();
        (digits.len() == 4).then(|| u16::from_str_radix(&digits, 16).unwrap())
    });
    let is_of_a_channel =
        |object: &u16| FAMILIES.iter().any(|first| (*first..first + 4).contains(object));
    objects.filter(is_of_a_channel).collect()
}

/// What a channel shows that has nearly everything wrong with it, in ways that exclude each other:
/// family, subindex and value.
const AILMENTS: [&[(u16, u8, u32)]; 11] = [
    // Bus-off with each policy, and everything that a channel in whatever state may show.
    &[
        (0x9000, 9, 0x003B),
        (0x8021, 14, 0),
        (0x8001, 2, 4),
        (0x8001, 62, 64),
        (0x8001, 4, 1),
        (0x8001, 8, 2),
        (0x9000, 3, 1 << 3 | 1 << 15 | 1 << 17),
        (0x9000, 13, 7),
        (0x9000, 14, 9),
        (0x8021, 1, 0),
        (0x8021, 3, 1),
        (0x9020, 5, 30),
        (0x9020, 11, 3),
        (0x9020, 15, 4),
    ],
    &[(0x9000, 9, 0x003B), (0x8021, 14, 3), (0x8001, 2, 3), (0x8001, 65, 9), (0x8001, 4, 3)],
    &[(0x9000, 9, 0x003B), (0x8021, 14, 1), (0x8001, 2, 1), (0x8001, 4, 4)],
    &[(0x9000, 1, 0x8011), (0x9000, 2, 0x0769), (0x9000, 15, 2), (0x8001, 2, 3)],
    &[(0x9000, 1, 128), (0x9000, 2, 0x077B), (0x8001, 2, 4)],
    &[(0x9000, 1, 97), (0x9000, 2, 0x070C)],
    &[(0x9000, 2, 0x060F)],
    &[
        (0x9000, 2, 0x050F),
        (0x8001, 16, 1),
        (0x8001, 20, 5_000_000),
        (0x8001, 33, 9),
        (0x8001, 34, 0),
    ],
    &[
        (0x9000, 2, 0x050F),
        (0x8001, 16, 0),
        (0x8001, 20, 2_000_000),
        (0x8001, 33, 0),
        (0x8001, 34, 0),
    ],
    &[(0x9000, 9, 0x0004)],
    &[(0x9000, 9, 0)],
];

/// What each channel shows that is well: running, without an error.
fn well() -> Snapshot {
    let mut snapshot = Snapshot { al_state: 8, ..Snapshot::default() };
    for profile in [0x8010, 0x8011] {
        for (subindex, value) in [(9, 1024), (10, 1000), (12, 0x0000_01E7)] {
            snapshot.set(profile, subindex, value);
        }
    }
    for channel in 0..4 {
        snapshot.set(0x9000 + channel, 2, 0x070F);
        snapshot.set(0x9000 + channel, 9, 0x000A);
        snapshot.set(0x8021 + channel, 1, 1);
    }
    snapshot
}

fn of_channel(channel: u8, change: impl FnOnce(&mut Snapshot)) -> Vec<Finding> {
    let mut snapshot = well();
    change(&mut snapshot);
    let mut found = findings(&snapshot);
    found.retain(|finding| finding.location == Location::Channel(channel));
    found
}

#[test]
fn findings_name_the_objects_of_their_own_channel() {
    assert_eq!(findings(&well()), []);
    let mut ids = BTreeSet::new();
    let mut naming = BTreeSet::new();
    for channel in 0..4 {
        let own = |family: u16| family + u16::from(channel);
        let ailing = AILMENTS.iter().flat_map(|ailment| {
            of_channel(channel, |snapshot| {
                for (family, subindex, value) in *ailment {
                    snapshot.set(own(*family), *subindex, *value);
                }
            })
        });
        // Left out of one mask.
        let left_out = [0x8010, 0x8011].into_iter().flat_map(|profile| {
            let mask = 0x0F & !(1 << channel);
            of_channel(channel, |snapshot| snapshot.set(profile, 12, 7 | mask << 5))
        });
        for finding in ailing.chain(left_out) {
            ids.insert(finding.id);
            for object in named(&finding) {
                naming.insert(finding.id);
                let is_own = FAMILIES.iter().any(|family| own(*family) == object);
                assert!(is_own, "CAN{channel} names 0x{object:04X}: {finding:#?}");
            }
        }
    }
    // All that the library has for a channel.
    let all = [
        "apply-failed",
        "bus-error",
        "bus-off",
        "bus-off-past",
        "cannot-receive",
        "cannot-send",
        "channel-error",
        "channel-off",
        "data-path-apply",
        "data-path-degraded",
        "data-path-off",
        "data-phase-error",
        "error-passive",
        "error-warning",
        "event-loss",
        "flash-failed",
        "message-ram",
        "no-acknowledge",
        "node-mode",
        "receive-loss",
        "rx-cache-drop",
        "transmit-pressure",
        "tx-fifo-full",
    ];
    assert_eq!(ids.into_iter().collect::<Vec<_>>(), all);
    for id in [
        "bus-off",
        "channel-off",
        "data-phase-error",
        "node-mode",
        "receive-loss",
        "event-loss",
        "rx-cache-drop",
    ] {
        assert!(naming.contains(id), "{id} names its object: {naming:?}");
    }
}
