//! SYNC (CiA 301, 7.2.5).

use super::cob_id::CobId;

/// Identifier of SYNC unless 0x1005 says otherwise.
pub const SYNC_COB_ID: CobId = CobId::SYNC;

/// Data of a SYNC: nothing, or the counter (1 to 240).
pub fn sync_data(counter: &Option<[u8; 1]>) -> &[u8] {
    counter.as_ref().map_or(&[], |counter| &counter[..])
}

/// The counter of a SYNC, `Some(None)` for one without; `None` for what is no SYNC.
pub fn parse_sync(data: &[u8]) -> Option<Option<u8>> {
    match data {
        [] => Some(None),
        [counter @ 1..=240] => Some(Some(*counter)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_and_without_counter() {
        assert_eq!(sync_data(&None), []);
        assert_eq!(sync_data(&Some([7])), [7]);
        assert_eq!(parse_sync(&[]), Some(None));
        assert_eq!(parse_sync(&[240]), Some(Some(240)));
        assert_eq!(parse_sync(&[0]), None);
        assert_eq!(parse_sync(&[1, 2]), None);
    }
}
