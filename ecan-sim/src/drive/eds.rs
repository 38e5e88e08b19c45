//! Electronic data sheets (CiA 306): from the text of a file to objects.

use super::data_type::DataType;
use super::dictionary::{Access, Object, Value};
use super::eds_error::{EdsError, EdsErrorKind};
use super::ini::{Entry, Ini, Section};

const LISTS: [&str; 3] = ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"];
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];

/// Reads the objects of an EDS; `$NODEID` is `node`.
///
/// # Errors
/// The first error, with its line.
pub(super) fn parse(text: &str, node: u8) -> Result<Vec<Object>, EdsError> {
    let ini = Ini::parse(text)?;
    let mut objects = Vec::new();
    let mut listed = Vec::new();
    let mut last_list = 1;
    for list in LISTS {
        let Some(section) = ini.section(list) else { continue };
        last_list = section.line;
        let count_entry = need(section, "SupportedObjects")?;
        let count = number(count_entry, node, 0, 0xFFFF)?;
        for position in 1..=count {
            let key = position.to_string();
            let Some(entry) = section.filled(&key) else {
                let section = section.name.to_owned();
                return Err(at(count_entry.line, EdsErrorKind::MissingKey { section, key }));
            };
            let index = number(entry, node, 0, 0xFFFF)? as u16;
            let name = format!("{index:04X}");
            let Some(section) = ini.section(&name) else {
                return Err(at(entry.line, EdsErrorKind::MissingSection { name }));
            };
            if !listed.contains(&index) {
                listed.push(index);
                read_object(&ini, section, index, node, &mut objects)?;
            }
        }
    }
    for section in ini.sections() {
        check_listed(section, &listed)?;
    }
    for index in MANDATORY {
        if !listed.contains(&index) {
            return Err(at(last_list, EdsErrorKind::Mandatory { index }));
        }
    }
    Ok(objects)
}

fn at(line: usize, kind: EdsErrorKind) -> EdsError {
    EdsError { line, kind }
}

/// Rejects sections of unlisted objects and of subindices without object.
fn check_listed(section: &Section<'_>, listed: &[u16]) -> Result<(), EdsError> {
    let kind = if let Some((owner, _)) = subindex_of(section.name) {
        if listed.contains(&owner) {
            return Ok(());
        }
        EdsErrorKind::Orphan { name: section.name.to_owned() }
    } else {
        match index_of(section.name) {
            Some(index) if !listed.contains(&index) => EdsErrorKind::Unlisted { index },
            _ => return Ok(()),
        }
    };
    Err(at(section.line, kind))
}

/// Index of a section like `[1018]`.
fn index_of(name: &str) -> Option<u16> {
    let is_index = name.len() == 4 && name.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_index.then(|| u16::from_str_radix(name, 16).ok()).flatten()
}

/// Index and subindex of a section like `[1018sub1]`.
fn subindex_of(name: &str) -> Option<(u16, u8)> {
    let index = index_of(name.get(..4)?)?;
    let word = name.get(4..7)?;
    let digits = name.get(7..)?;
    let is_sub = word.eq_ignore_ascii_case("sub")
        && !digits.is_empty()
        && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_sub.then(|| u8::from_str_radix(digits, 16).ok()).flatten().map(|sub| (index, sub))
}

fn read_object(
    ini: &Ini<'_>,
    section: &Section<'_>,
    index: u16,
    node: u8,
    objects: &mut Vec<Object>,
) -> Result<(), EdsError> {
    let object_type = match section.filled("ObjectType") {
        Some(entry) => number(entry, node, 0, 0xFF)? as u8,
        None => 7,
    };
    match object_type {
        2 | 7 => {
            objects.push(read_variable(section, index, 0, object_type, node)?);
            Ok(())
        }
        8 | 9 => match section.filled("CompactSubObj") {
            Some(entry) => read_compact(section, entry, index, node, objects),
            None => read_subindices(ini, section, index, node, objects),
        },
        code => {
            let line = section.entry("ObjectType").map_or(section.line, |entry| entry.line);
            Err(at(line, EdsErrorKind::ObjectType { code }))
        }
    }
}

fn read_subindices(
    ini: &Ini<'_>,
    section: &Section<'_>,
    index: u16,
    node: u8,
    objects: &mut Vec<Object>,
) -> Result<(), EdsError> {
    let count_entry = need(section, "SubNumber")?;
    let announced = number(count_entry, node, 0, 255)? as usize;
    let mut found = 0;
    for section in ini.sections() {
        let Some((owner, subindex)) = subindex_of(section.name) else { continue };
        if owner != index {
            continue;
        }
        let object_type = match section.filled("ObjectType") {
            Some(entry) => number(entry, node, 0, 0xFF)? as u8,
            None => 7,
        };
        objects.push(read_variable(section, index, subindex, object_type, node)?);
        found += 1;
    }
    if found == announced {
        Ok(())
    } else {
        Err(at(count_entry.line, EdsErrorKind::SubindexCount { index, announced, found }))
    }
}

/// Reads an array without subindex sections: all elements are alike.
fn read_compact(
    section: &Section<'_>,
    count_entry: Entry<'_>,
    index: u16,
    node: u8,
    objects: &mut Vec<Object>,
) -> Result<(), EdsError> {
    let count = number(count_entry, node, 1, 0xFE)? as u8;
    objects.push(Object {
        index,
        subindex: 0,
        data_type: DataType::Unsigned(1),
        access: Access::Const,
        mappable: false,
        limits: (None, None),
        default: Value::Number(u64::from(count)),
        saved: None,
        value: Value::Number(u64::from(count)),
    });
    for subindex in 1..=count {
        objects.push(read_variable(section, index, subindex, 7, node)?);
    }
    Ok(())
}

fn read_variable(
    section: &Section<'_>,
    index: u16,
    subindex: u8,
    object_type: u8,
    node: u8,
) -> Result<Object, EdsError> {
    let data_type = match section.filled("DataType") {
        Some(entry) => {
            let code = number(entry, node, 0, 0xFFFF)? as u16;
            DataType::from_index(code)
                .ok_or_else(|| at(entry.line, EdsErrorKind::DataType { code }))?
        }
        None if object_type == 2 => DataType::Domain,
        None => return Err(missing(section, "DataType")),
    };
    let access = match section.filled("AccessType") {
        Some(entry) => read_access(entry)?,
        None if object_type == 2 => Access::ReadWrite,
        None => return Err(missing(section, "AccessType")),
    };
    let mappable = match section.filled("PDOMapping") {
        Some(entry) => number(entry, node, 0, 1)? == 1,
        None => false,
    };
    let limits = read_limits(section, data_type, node)?;
    let default = read_default(section, data_type, limits, node)?;
    let value = default.clone();
    Ok(Object { index, subindex, data_type, access, mappable, limits, default, saved: None, value })
}

fn read_access(entry: Entry<'_>) -> Result<Access, EdsError> {
    Ok(match entry.value.to_ascii_lowercase().as_str() {
        "const" => Access::Const,
        "ro" => Access::ReadOnly,
        "wo" => Access::WriteOnly,
        "rw" => Access::ReadWrite,
        "rwr" => Access::ReadWriteInput,
        "rww" => Access::ReadWriteOutput,
        _ => return Err(at(entry.line, EdsErrorKind::Access { text: entry.value.to_owned() })),
    })
}

type Limits = (Option<i64>, Option<i64>);

fn read_limits(section: &Section<'_>, data_type: DataType, node: u8) -> Result<Limits, EdsError> {
    if !matches!(data_type, DataType::Signed(_) | DataType::Unsigned(_)) {
        return Ok((None, None));
    }
    let limit = |key| section.filled(key).map(|entry| typed(entry, data_type, node)).transpose();
    let limits = (limit("LowLimit")?, limit("HighLimit")?);
    if let (Some(low), Some(high)) = limits
        && low > high
    {
        let line = section.entry("LowLimit").map_or(section.line, |entry| entry.line);
        return Err(at(line, EdsErrorKind::Limits { low, high }));
    }
    Ok(limits)
}

fn read_default(
    section: &Section<'_>,
    data_type: DataType,
    limits: Limits,
    node: u8,
) -> Result<Value, EdsError> {
    let entry = section.filled("DefaultValue");
    Ok(match data_type {
        DataType::Text | DataType::Unicode => {
            let text = entry.map_or("", |entry| entry.value);
            Value::Bytes(if data_type == DataType::Text {
                text.bytes().collect()
            } else {
                text.encode_utf16().flat_map(u16::to_le_bytes).collect()
            })
        }
        DataType::Octets => Value::Bytes(match entry {
            Some(entry) => read_bytes(entry)?,
            None => Vec::new(),
        }),
        // The default of a domain is at most a file name.
        DataType::Domain => Value::Bytes(Vec::new()),
        DataType::Real(bytes) => Value::Number(match entry {
            Some(entry) => read_real(entry, bytes)?,
            None => 0,
        }),
        DataType::Boolean | DataType::Signed(_) | DataType::Unsigned(_) => {
            let Some(entry) = entry else { return Ok(Value::Number(0)) };
            let number = typed(entry, data_type, node)?;
            let low = limits.0.unwrap_or(i64::MIN);
            let high = limits.1.unwrap_or(i64::MAX);
            if !(low..=high).contains(&number) {
                let text = entry.value.to_owned();
                return Err(at(entry.line, EdsErrorKind::Range { text, low, high }));
            }
            Value::Number(data_type.cut(number as u64))
        }
    })
}

fn read_bytes(entry: Entry<'_>) -> Result<Vec<u8>, EdsError> {
    let wrong = || at(entry.line, EdsErrorKind::NotBytes { text: entry.value.to_owned() });
    let digits: Option<Vec<u8>> = entry
        .value
        .chars()
        .filter(|character| !character.is_whitespace())
        .map(|character| character.to_digit(16).map(|digit| digit as u8))
        .collect();
    let digits = digits.filter(|digits| digits.len() % 2 == 0).ok_or_else(wrong)?;
    Ok(digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit)).collect())
}

/// Reads a real, written as a number or as its bits.
fn read_real(entry: Entry<'_>, bytes: u8) -> Result<u64, EdsError> {
    let text = entry.value;
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let bits = match hex {
        Some(hex) => u64::from_str_radix(hex, 16).ok(),
        None if bytes == 4 => text.parse().ok().map(|real: f32| u64::from(real.to_bits())),
        None => text.parse().ok().map(f64::to_bits),
    };
    bits.ok_or_else(|| at(entry.line, EdsErrorKind::NotANumber { text: text.to_owned() }))
}

fn missing(section: &Section<'_>, key: &'static str) -> EdsError {
    let (name, key) = (section.name.to_owned(), key.to_owned());
    at(section.line, EdsErrorKind::MissingKey { section: name, key })
}

fn need<'a>(section: &Section<'a>, key: &'static str) -> Result<Entry<'a>, EdsError> {
    section.filled(key).ok_or_else(|| missing(section, key))
}

/// Reads a number of an object's type. Hexadecimal digits may give the bits of a negative number.
fn typed(entry: Entry<'_>, data_type: DataType, node: u8) -> Result<i64, EdsError> {
    let value = evaluate(entry, node)?;
    let Some((low, high)) = data_type.range() else { return Ok(value as i64) };
    let hex = entry.value.contains("0x") || entry.value.contains("0X");
    let bits = i128::from(high) - i128::from(low);
    if hex && (0..=bits).contains(&value) {
        return Ok(data_type.number(value as u64));
    }
    within(entry, value, low, high)
}

fn number(entry: Entry<'_>, node: u8, low: i64, high: i64) -> Result<i64, EdsError> {
    within(entry, evaluate(entry, node)?, low, high)
}

fn within(entry: Entry<'_>, value: i128, low: i64, high: i64) -> Result<i64, EdsError> {
    match i64::try_from(value) {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(at(entry.line, EdsErrorKind::Range { text: entry.value.to_owned(), low, high })),
    }
}

/// Decimal, hexadecimal with `0x`, octal with a leading 0, or a sum with `$NODEID`.
fn evaluate(entry: Entry<'_>, node: u8) -> Result<i128, EdsError> {
    let wrong = || at(entry.line, EdsErrorKind::NotANumber { text: entry.value.to_owned() });
    let mut sum = 0i128;
    // A sign at the beginning is not a sum.
    for term in entry.value.split('+') {
        let term = term.trim();
        sum += if term.eq_ignore_ascii_case("$NODEID") {
            i128::from(node)
        } else {
            literal(term).ok_or_else(wrong)?
        };
    }
    Ok(sum)
}

fn literal(text: &str) -> Option<i128> {
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text),
    };
    let (radix, digits) = match digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        Some(digits) => (16, digits),
        None if digits.len() > 1 && digits.starts_with('0') => (8, digits),
        None => (10, digits),
    };
    // from_str_radix would accept a second sign.
    if digits.starts_with(['+', '-']) {
        return None;
    }
    let value = i128::from(u64::from_str_radix(digits, radix).ok()?);
    Some(if negative { -value } else { value })
}
