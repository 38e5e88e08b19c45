//! Check of the SII of a gateway: SM2 and SM3 must match manual 15.7.

use ecan_protocol::mapping::{Direction, SyncManagerLayout};

const EXPECTED: [(&str, Direction); 2] = [("SM2", Direction::RxPdo), ("SM3", Direction::TxPdo)];

const CATEGORY: u16 = 41;

/// Returns the deviations; empty if the layout is correct.
pub(super) fn faults(sii: &[u8]) -> Vec<String> {
    let Some(managers) = category(sii) else {
        return vec!["the SII has no category 41 (sync managers)".to_owned()];
    };
    let (managers, _) = managers.as_chunks();
    let found = managers.iter().skip(2).copied().map(SyncManagerLayout::from_bytes);
    let mut found = found.map(Some).chain(std::iter::repeat(None));
    let fault = |(name, direction): (&str, Direction)| {
        let required = SyncManagerLayout::required(direction);
        match found.next().flatten() {
            None => Some(format!("{name} is missing")),
            Some(found) if found == required => None,
            Some(found) => Some(format!("{name} has {found} instead of {required}")),
        }
    };
    EXPECTED.into_iter().filter_map(fault).collect()
}

/// Bytes of the category of the sync managers. Categories start at word 0x40, each with type and
/// length in words.
fn category(sii: &[u8]) -> Option<&[u8]> {
    let mut rest = sii.get(2 * 0x40..)?;
    while let [k0, k1, l0, l1, after @ ..] = rest {
        let length = 2 * usize::from(u16::from_le_bytes([*l0, *l1]));
        if u16::from_le_bytes([*k0, *k1]) == CATEGORY {
            return after.get(..length);
        }
        rest = after.get(length..)?;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(categories: &[u16]) -> Vec<u8> {
        let head = std::iter::repeat_n(0, 0x40).chain(categories.iter().copied());
        head.flat_map(u16::to_le_bytes).collect()
    }

    const GOOD: [u16; 22] = [
        30, 1, 7, // Another category before it.
        41, 16, //
        0x1000, 128, 0x26, 0x0101, //
        0x1080, 128, 0x22, 0x0201, //
        0x1100, 3072, 0x66, 0x0301, //
        0x1D00, 3072, 0x22, 0x0401, //
        0xFFFF,
    ];

    #[test]
    fn layout_of_the_manual_has_no_fault() {
        assert_eq!(faults(&image(&GOOD)), [""; 0]);
    }

    #[test]
    fn each_fault_is_named() {
        let changed = |changes: &[(usize, u16)]| {
            let mut words = GOOD;
            changes.iter().for_each(|(at, value)| words[*at] = *value);
            faults(&image(&words))
        };
        let sm2 = "instead of start 0x1100, 3072 bytes, control byte 0x66";
        let sm3 = "instead of start 0x1D00, 3072 bytes, control byte 0x22";
        assert_eq!(
            changed(&[(13, 0x1180)]),
            [format!("SM2 has start 0x1180, 3072 bytes, control byte 0x66 {sm2}")]
        );
        assert_eq!(
            changed(&[(18, 1024)]),
            [format!("SM3 has start 0x1D00, 1024 bytes, control byte 0x22 {sm3}")]
        );
        assert_eq!(
            changed(&[(15, 0x64), (19, 0x20)]),
            [
                format!("SM2 has start 0x1100, 3072 bytes, control byte 0x64 {sm2}"),
                format!("SM3 has start 0x1D00, 3072 bytes, control byte 0x20 {sm3}"),
            ]
        );
        assert_eq!(changed(&[(4, 8)]), ["SM2 is missing", "SM3 is missing"]);
        assert_eq!(changed(&[(4, 12)]), ["SM3 is missing"]);
        let none = ["the SII has no category 41 (sync managers)"];
        assert_eq!(changed(&[(3, 42)]), none);
        assert_eq!(changed(&[(4, 0x7FFF)]), none);
        assert_eq!(faults(b"abc"), none);
    }
}
