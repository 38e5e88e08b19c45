//! Objects and entries of the dictionary.

use std::fmt::Write as _;

use ecan_protocol::mapping::{Direction, map_subindex, pdo_map_index};
use ecan_protocol::object::{Access, object};

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::sdo::Upload;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H1", "H42"],
        key: "missing_entries",
        stage: Stage::Reading,
        assumption: "the gateway has every entry of this version of the manual",
        run: missing_entries,
    },
    Experiment {
        rows: &["H42"],
        key: "missing_abort",
        stage: Stage::Reading,
        assumption: "an access to a missing entry aborts with 0x06090011",
        run: missing_abort,
    },
    Experiment {
        rows: &["H3", "S5"],
        key: "mapped_subindex",
        stage: Stage::Reading,
        assumption: "the PDOs map subindex 1 of the 16-byte objects",
        run: mapped_subindex,
    },
];

/// Objects that versions of the firmware may lack, of the first channel only.
const EXAMINED: [u16; 6] = [0xF000, 0x8030, 0x8021, 0x8001, 0x9011, 0x9020];
/// Of 0x8001 only the entry that was added.
const CHANNEL_CONFIG_ADDED: u8 = 74;

struct Missing {
    index: u16,
    subindices: Vec<u8>,
    is_whole: bool,
    abort: u32,
}

fn find_missing(probe: &Probe) -> Result<Vec<Missing>> {
    let mut found = Vec::new();
    for index in EXAMINED {
        let entries = object(index).map_or(&[][..], |object| object.entries);
        let examined: Vec<_> = entries
            .iter()
            .filter(|entry| entry.access != Access::Wo && entry.subindex != 0)
            .map(|entry| entry.subindex)
            .filter(|subindex| index != 0x8001 || *subindex == CHANNEL_CONFIG_ADDED)
            .collect();
        let (mut subindices, mut abort) = (Vec::new(), 0);
        for subindex in &examined {
            if let Upload::Aborted(code) = probe.sdo().try_read(index, *subindex)? {
                subindices.push(*subindex);
                abort = code;
            }
        }
        if !subindices.is_empty() {
            let is_whole = subindices.len() == examined.len() && index != 0x8001;
            found.push(Missing { index, subindices, is_whole, abort });
        }
    }
    Ok(found)
}

/// `0xF000:4..8`, as in a scenario file.
fn ranges(missing: &Missing) -> Vec<String> {
    let index = missing.index;
    if missing.is_whole {
        return vec![format!("0x{index:04X}")];
    }
    let mut texts = Vec::new();
    for run in missing.subindices.chunk_by(|a, b| b - a == 1) {
        let mut text = format!("0x{index:04X}:");
        match run {
            [only] => _ = write!(text, "{only}"),
            [first, .., last] => _ = write!(text, "{first}..{last}"),
            [] => continue,
        }
        texts.push(text);
    }
    texts
}

fn missing_entries(probe: &mut Probe) -> Result<Outcome> {
    let missing = find_missing(probe)?;
    if missing.is_empty() {
        return Ok(Outcome::holds("every entry was read"));
    }
    let texts: Vec<_> = missing.iter().flat_map(ranges).collect();
    let quoted: Vec<_> = texts.iter().map(|text| format!("\"{text}\"")).collect();
    Ok(Outcome::differs(format!("missing: {}", texts.join(", ")))
        .like(format!("[{}]", quoted.join(", "))))
}

fn missing_abort(probe: &mut Probe) -> Result<Outcome> {
    let Some(missing) = find_missing(probe)?.pop() else {
        return Ok(Outcome::undecided("no entry is missing"));
    };
    let detail =
        format!("an access to 0x{:04X} aborts with 0x{:08X}", missing.index, missing.abort);
    Ok(match missing.abort {
        0x0609_0011 => Outcome::holds(detail),
        0x0602_0000 => Outcome::differs(detail).like("no_object"),
        _ => Outcome::differs(detail),
    })
}

fn mapped_subindex(probe: &mut Probe) -> Result<Outcome> {
    let mut subindices = [0; 2];
    for (direction, subindex) in Direction::ALL.into_iter().zip(&mut subindices) {
        let entry = probe.sdo().read(pdo_map_index(direction, 0), map_subindex(0))?;
        let [high, low, found, bits] = entry.to_be_bytes();
        if bits != 128 {
            let index = u16::from_be_bytes([high, low]);
            return Ok(Outcome::differs(format!("0x{index:04X} is mapped with {bits} bits")));
        }
        *subindex = found;
    }
    let [tx, rx] = subindices;
    let detail = format!("0x1600:01 maps subindex {rx}, 0x1A00:01 subindex {tx}");
    Ok(match (tx, rx) {
        (1, 1) => Outcome::holds(detail),
        (0, 0) => Outcome::differs(detail).like("zero"),
        _ => Outcome::differs(detail),
    })
}
