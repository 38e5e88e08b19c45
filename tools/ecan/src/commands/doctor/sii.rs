//! Check of the SII of a gateway: SM2 and SM3 must match manual 15.7.

use ecan_protocol::mapping::{
    Direction, MAX_PDO_BYTES, sync_manager_address, sync_manager_control,
};

const EXPECTED: [(&str, Direction); 2] = [("SM2", Direction::RxPdo), ("SM3", Direction::TxPdo)];

const CATEGORY: u16 = 41;

/// Returns the deviations; empty if the layout is correct.
pub(super) fn faults(sii: &[u8]) -> Vec<String> {
    let words: Vec<_> = sii.chunks_exact(2).map(|it| u16::from_le_bytes([it[0], it[1]])).collect();
    let Some(managers) = category(&words) else {
        return vec!["the SII has no category 41 (sync managers)".to_owned()];
    };
    // Four words each: start, size, control and status byte, enable byte and type.
    let managers: Vec<_> = managers.chunks_exact(4).skip(2).collect();
    let missing = managers.len()..EXPECTED.len();
    let mut faults = Vec::new();
    for (found, (name, direction)) in managers.into_iter().zip(EXPECTED) {
        let expected = (sync_manager_address(direction), MAX_PDO_BYTES as u16);
        if (found[0], found[1]) != expected {
            let (start, size) = (found[0], found[1]);
            faults.push(format!("{name} starts at 0x{start:04X} and has {size} bytes"));
        }
        let byte = found[2] as u8;
        if byte != sync_manager_control(direction) {
            faults.push(format!("the control byte of {name} is 0x{byte:02X}"));
        }
    }
    faults
        .extend(missing.filter_map(|it| EXPECTED.get(it)).map(|it| format!("{} is missing", it.0)));
    faults
}

/// Words of the category of the sync managers. Categories start at word 0x40, each with type and
/// length in words.
fn category(words: &[u16]) -> Option<&[u16]> {
    let mut rest = words.get(0x40..)?;
    while let [kind, length, behind @ ..] = rest {
        let length = usize::from(*length);
        if *kind == CATEGORY {
            return behind.get(..length);
        }
        rest = behind.get(length..)?;
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
        assert_eq!(changed(&[(13, 0x1180)]), ["SM2 starts at 0x1180 and has 3072 bytes"]);
        assert_eq!(changed(&[(18, 1024)]), ["SM3 starts at 0x1D00 and has 1024 bytes"]);
        assert_eq!(
            changed(&[(15, 0x64), (19, 0x20)]),
            ["the control byte of SM2 is 0x64", "the control byte of SM3 is 0x20"]
        );
        assert_eq!(changed(&[(4, 8)]), ["SM2 is missing", "SM3 is missing"]);
        assert_eq!(changed(&[(4, 12)]), ["SM3 is missing"]);
        let none = ["the SII has no category 41 (sync managers)"];
        assert_eq!(changed(&[(3, 42)]), none);
        assert_eq!(changed(&[(4, 0x7FFF)]), none);
        assert_eq!(faults(b"abc"), none);
    }
}
