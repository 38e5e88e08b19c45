use std::ops::RangeInclusive;

use ecan_protocol::object::{AbortCode, object};

use super::{GatewayVariant, MissingAbort, VariantValue};

/// Entries of the object dictionary that the firmware does not have.
///
/// In a scenario file a list of texts: `"0xF000:26"`, `"0xF000:19..30"`, or `"0x9011"` for all subindices.
/// Subindices are decimal. An index means all objects of its family: 0x8021 those of the four channels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MissingEntries(Vec<(u16, RangeInclusive<u8>)>);

impl MissingEntries {
    /// Reads the form of scenario files. `None` if a text is wrong or names an entry that the dictionary lacks.
    #[must_use]
    pub fn parse<'a>(texts: impl IntoIterator<Item = &'a str>) -> Option<Self> {
        texts.into_iter().map(parse).collect::<Option<_>>().map(Self)
    }

    pub(crate) fn lacks(&self, index: u16, subindex: u8) -> bool {
        self.0.iter().any(|(missing, range)| {
            range.contains(&subindex)
                && object(*missing).is_some_and(|object| object.instance(index).is_some())
        })
    }

    /// True if the firmware lacks every entry of the object.
    pub(crate) fn lacks_object(&self, index: u16) -> bool {
        let entries = object(index).map_or(&[][..], |object| object.entries);
        !entries.is_empty() && entries.iter().all(|entry| self.lacks(index, entry.subindex))
    }
}

fn parse(text: &str) -> Option<(u16, RangeInclusive<u8>)> {
    let (index, subindices) = match text.split_once(':') {
        Some((index, subindices)) => (index, Some(subindices)),
        None => (text, None),
    };
    let index = u16::from_str_radix(index.strip_prefix("0x")?, 16).ok()?;
    let object = object(index)?;
    let Some(subindices) = subindices else { return Some((index, 0..=u8::MAX)) };
    let (first, last) = subindices.split_once("..").unwrap_or((subindices, subindices));
    let range = first.parse().ok()?..=last.parse().ok()?;
    let exists = |subindex: &u8| object.entry(*subindex).is_some();
    (exists(range.start()) && exists(range.end()) && !range.is_empty()).then_some((index, range))
}

impl VariantValue for MissingEntries {
    fn read(value: &toml::Value) -> Option<Self> {
        let texts: Option<Vec<_>> = value.as_array()?.iter().map(toml::Value::as_str).collect();
        Self::parse(texts?)
    }

    fn allowed() -> String {
        "a list of existing entries such as \"0xF000:26\", \"0xF000:19..30\" and \"0x9011\""
            .to_owned()
    }
}

impl GatewayVariant {
    /// The abort code of an access to an entry that the firmware does not have.
    pub(crate) fn missing_entry(&self, index: u16, subindex: u8) -> Option<AbortCode> {
        self.missing_entries.lacks(index, subindex).then_some(match self.missing_abort {
            MissingAbort::NoSubindex => AbortCode::NO_SUBINDEX,
            MissingAbort::NoObject => AbortCode::NO_OBJECT,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entry_range_and_object_are_read() {
        let missing = MissingEntries::parse(["0xF000:26", "0x8030:2..4", "0x8021"]).unwrap();
        for (index, subindex, expected) in [
            (0xF000, 25, false),
            (0xF000, 26, true),
            (0x8030, 1, false),
            (0x8030, 2, true),
            (0x8030, 4, true),
            (0x8030, 5, false),
            (0x8021, 0, true),
            (0x8024, 20, true),
            (0x8020, 1, false),
        ] {
            assert_eq!(missing.lacks(index, subindex), expected, "{index:#x}:{subindex}");
        }
        assert!(missing.lacks_object(0x8022));
        assert!(!missing.lacks_object(0x8030));
        assert!(!missing.lacks_object(0x1234));
    }

    #[test]
    fn wrong_entries_are_rejected() {
        for text in ["", "F000:1", "0xF000:", "0xF000:33", "0x1234", "0xF000:5..4", "0xF000:1..40"]
        {
            assert_eq!(MissingEntries::parse([text]), None, "{text}");
        }
    }
}
