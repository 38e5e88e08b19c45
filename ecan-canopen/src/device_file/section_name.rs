//! Names of sections (CiA 306-1, 6.6 and 8.3).

use super::ini::numbered;

/// Owner of an object: the device, or one of its modules by number.
pub(super) type Owner = Option<u16>;

/// Part of an object that a section describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Object,
    Sub(u8),
    Names,
    Values,
    Denotations,
    References,
    Links,
}

/// Meaning of a section's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SectionName {
    Object(Owner, u16, Part),
    /// An index with fewer than four digits, which may be another name as well.
    ShortObject(u16, Part),
    ModuleInfo(u16),
    ModuleComments(u16),
    /// A list of the objects of a module.
    ModuleList(u16),
    ModuleExtension(u16, u16),
    Tool(u16),
    Other,
}

impl SectionName {
    pub(super) fn of(name: &str) -> Self {
        let name = name.to_ascii_lowercase();
        if let Some((index, part)) = object_part(&name) {
            return Self::Object(None, index, part);
        }
        if let Some(number) = numbered(&name, "tool") {
            return Self::Tool(number);
        }
        module_part(&name).or_else(|| short_object(&name)).unwrap_or(Self::Other)
    }
}

fn module_part(name: &str) -> Option<SectionName> {
    let rest = name.strip_prefix('m')?;
    let (digits, rest) = rest.split_at(rest.find(|digit: char| !digit.is_ascii_digit())?);
    let module = digits.parse().ok()?;
    Some(match rest {
        "moduleinfo" => SectionName::ModuleInfo(module),
        "comments" => SectionName::ModuleComments(module),
        "fixedobjects" | "subextends" => SectionName::ModuleList(module),
        _ => {
            if let Some(index) = rest.strip_prefix("subext") {
                let (index, Part::Object) = object_part(index)? else { return None };
                return Some(SectionName::ModuleExtension(module, index));
            }
            let (index, part) = object_part(rest.strip_prefix("fixed")?)?;
            SectionName::Object(Some(module), index, part)
        }
    })
}

/// Part of an object with four digits, for example `1018sub1`.
fn object_part(name: &str) -> Option<(u16, Part)> {
    let (digits, rest) = name.split_at_checked(4)?;
    let index = hexadecimal(digits)?;
    let part = match rest {
        "" => Part::Object,
        "name" => Part::Names,
        "value" => Part::Values,
        "denotation" => Part::Denotations,
        "paramrefd" | "parameterrefd" => Part::References,
        "objectlinks" => Part::Links,
        _ => Part::Sub(u8::try_from(hexadecimal(rest.strip_prefix("sub")?)?).ok()?),
    };
    Some((index, part))
}

/// An object with one to three digits, for example `A0sub1`.
fn short_object(name: &str) -> Option<SectionName> {
    let (digits, part) = match name.split_once("sub") {
        Some((digits, sub)) => (digits, Part::Sub(u8::try_from(hexadecimal(sub)?).ok()?)),
        None => (name, Part::Object),
    };
    let index = hexadecimal(digits).filter(|_| digits.len() < 4)?;
    Some(SectionName::ShortObject(index, part))
}

fn hexadecimal(digits: &str) -> Option<u16> {
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_number.then(|| u16::from_str_radix(digits, 16).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_their_meaning() {
        let object = |index, part| SectionName::Object(None, index, part);
        let cases = [
            ("1018", object(0x1018, Part::Object)),
            ("1a00SUB1", object(0x1A00, Part::Sub(1))),
            ("1018subFE", object(0x1018, Part::Sub(0xFE))),
            ("1018sub01", object(0x1018, Part::Sub(1))),
            ("1018sub100", SectionName::Other),
            ("1018sub", SectionName::Other),
            ("2000Denotation", object(0x2000, Part::Denotations)),
            ("2000Value", object(0x2000, Part::Values)),
            ("2000ObjectLinks", object(0x2000, Part::Links)),
            ("A0sub1", SectionName::ShortObject(0xA0, Part::Sub(1))),
            ("A0", SectionName::ShortObject(0xA0, Part::Object)),
            ("M2ModuleInfo", SectionName::ModuleInfo(2)),
            ("M2Fixed6000sub1", SectionName::Object(Some(2), 0x6000, Part::Sub(1))),
            ("M2SubExt6000", SectionName::ModuleExtension(2, 0x6000)),
            ("M2SubExtends", SectionName::ModuleList(2)),
            ("MandatoryObjects", SectionName::Other),
            ("Tool3", SectionName::Tool(3)),
            ("Tools", SectionName::Other),
            ("Commentsé", SectionName::Other),
        ];
        for (name, meaning) in cases {
            assert_eq!(SectionName::of(name), meaning, "{name}");
        }
    }
}
