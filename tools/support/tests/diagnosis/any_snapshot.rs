//! Whatever a gateway shows or a file says, findings come of it.

use std::collections::BTreeMap;

use crate::diagnosis::common::set_all;
use ecan_tool_support::diagnosis::{Depth, Location, ObjectKey, ReadError, Snapshot, findings};
use proptest::prelude::*;

/// Values that a gateway would show, and those at the ends of what fits an entry.
fn value() -> impl Strategy<Value = Option<u32>> {
    prop_oneof![
        4 => (0_u32..=4).prop_map(Some),
        2 => (0_u32..=30).prop_map(Some),
        2 => Just(Some(u32::MAX)),
        2 => (0_u32..32).prop_map(|bit| Some(1 << bit)),
        2 => any::<u16>().prop_map(|value| Some(value.into())),
        2 => any::<u32>().prop_map(Some),
        1 => Just(None),
    ]
}

prop_compose! {
    fn snapshot()(
        values in prop::collection::vec(value(), 800),
        depth in prop_oneof![Just(Depth::Findings), Just(Depth::Everything)],
        al_state in any::<u8>(),
        has_error_flag in any::<bool>(),
        al_status_code in any::<Option<u16>>(),
        silence in any::<Option<String>>(),
    ) -> Snapshot {
        let mut values = values.into_iter().cycle();
        let read = Snapshot::read(depth, |_| {
            values.next().flatten().ok_or_else(|| ReadError::Rejected("no such entry".to_owned()))
        });
        Snapshot { al_state, has_error_flag, al_status_code, silence, ..read }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn any_snapshot_yields_findings(snapshot in snapshot()) {
        for finding in findings(&snapshot) {
            prop_assert!(!finding.what.is_empty(), "{finding:#?}");
            prop_assert!(!finding.causes.is_empty() && !finding.next.is_empty(), "{finding:#?}");
            prop_assert!(!matches!(finding.location, Location::Channel(4..)), "{finding:#?}");
        }
    }
}

/// What a gateway with these values shows: an unused channel and a gateway without profile have
/// counted nothing.
fn shown(values: &BTreeMap<ObjectKey, u32>, key: ObjectKey) -> u32 {
    let value =
        |index, subindex| values.get(&ObjectKey { index, subindex }).copied().unwrap_or_default();
    let is_unused = |channel| value(0x9000 + channel, 9) & 7 == 0;
    match key.index {
        0x9000..=0x9003 if is_unused(key.index - 0x9000) => 0,
        0x9020..=0x9023 if is_unused(key.index - 0x9020) => 0,
        0x9011 if value(0x8010, 9) == 0 && value(0x8011, 9) == 0 => 0,
        _ => value(key.index, key.subindex),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn few_entries_yield_all_findings(
        values in prop::collection::vec(prop_oneof![3 => Just(Some(0)), 1 => value()], 800),
    ) {
        let mut values = values.into_iter().cycle();
        let mut all = BTreeMap::new();
        Snapshot::read(Depth::Everything, |key| {
            let value = values.next().flatten().unwrap_or_default();
            all.insert(key, value);
            Ok(value)
        });
        let read = |depth| Snapshot::read(depth, |key| Ok(shown(&all, key)));
        let (few, all) = (read(Depth::Findings), read(Depth::Everything));
        prop_assert!(few.values.len() < all.values.len());
        prop_assert_eq!(findings(&few), findings(&all));
    }
}

/// Numbers that no arithmetic may stumble over.
#[test]
fn extreme_numbers_are_reported_without_panic() {
    let mut snapshot = Snapshot { al_state: 8, ..Snapshot::default() };
    snapshot.set(0x8010, 9, 23);
    snapshot.set(0x8010, 10, 0);
    snapshot.set(0x8011, 9, 1024);
    snapshot.set(0x8011, 10, u32::MAX);
    snapshot.set(0x1C12, 0, u32::MAX);
    snapshot.set(0x8000, 13, u32::MAX);
    // CAN1 is alone on its bus: the rotation is told.
    set_all(&mut snapshot, &[(0x9001, 1, 128), (0x9001, 2, 0x077B), (0x9001, 9, 0x001A)]);
    let found = findings(&snapshot);
    let what = |id| -> Vec<_> {
        found
            .iter()
            .filter(|finding| finding.id == id)
            .map(|finding| finding.what.as_str())
            .collect()
    };
    assert_eq!(
        what("frame-area"),
        [
            "23 active bytes are smaller than the header of 24",
            "1024 active bytes leave 4294967295 for frames instead of 1000"
        ]
    );
    assert!(what("assignment-differs")[0].contains("assigns 4294967295 chunks"), "{found:#?}");
    let alone = found.iter().find(|finding| finding.id == "no-acknowledge").unwrap();
    assert!(alone.causes[1].ends_with("this channel uses pin group 0"), "{alone:#?}");
}
