//! What a gateway showed: the JSON of a bundle, or else values in the order in which they are read.
#![no_main]

use ecan_tool_support::diagnosis::{Depth, ReadError, Snapshot, findings, registers};
use libfuzzer_sys::fuzz_target;

/// A bundle as the program `ecan` writes it, of which the findings are made of one part.
#[derive(serde::Deserialize)]
struct Bundle {
    gateways: Vec<Gateway>,
}

#[derive(serde::Deserialize)]
struct Gateway {
    snapshot: Snapshot,
}

fn read(data: &[u8]) -> Snapshot {
    if let Ok(Bundle { gateways }) = serde_json::from_slice(data) {
        return gateways.into_iter().next().map(|gateway| gateway.snapshot).unwrap_or_default();
    }
    if let Ok(snapshot) = serde_json::from_slice(data) {
        return snapshot;
    }
    let [al_state, flags, code, rest @ ..] = data else { return Snapshot::default() };
    let depth = if flags & 1 == 1 { Depth::Everything } else { Depth::Findings };
    // A length, then that number of bytes; 5 and more reject.
    let mut rest = rest;
    let mut snapshot = Snapshot::read(depth, |_| {
        let Some((length, behind)) = rest.split_first() else { return Ok(0) };
        let length = usize::from(length % 6);
        if length > 4 {
            rest = behind;
            return Err(ReadError::Rejected("no such entry".to_owned()));
        }
        let (own, behind) = behind.split_at(length.min(behind.len()));
        rest = behind;
        Ok(own.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte)))
    });
    snapshot.al_state = *al_state;
    snapshot.has_error_flag = flags & 2 == 2;
    snapshot.al_status_code = (flags & 4 == 4).then_some((*code).into());
    snapshot
}

fuzz_target!(|data: &[u8]| {
    let snapshot = read(data);
    for finding in findings(&snapshot) {
        assert!(!finding.what.is_empty() && !finding.causes.is_empty() && !finding.next.is_empty());
    }
    for (key, value) in &snapshot.values {
        if let Some(words) = registers::text(key.index, *value) {
            assert!(!words.is_empty());
        }
    }
    // What is written is read again. JSON takes longer than all of the above.
    if !data.len().is_multiple_of(8) {
        return;
    }
    let text = serde_json::to_string(&snapshot).expect("plain data");
    assert!(serde_json::from_str::<Snapshot>(&text).is_ok_and(|back| back == snapshot));
});
