//! Electronic data sheets (CiA 306): from the text of a file to objects.

use super::data_type::DataType;
use super::dictionary::{Access, Object, Value};
use super::eds_error::EdsError;
use super::ini::{Entry, Ini, Section};

const LISTS: [&str; 3] = ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"];
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];
const DOMAIN: i64 = 2;
const VARIABLE: i64 = 7;

/// Reads the objects of an EDS; `$NODEID` is `node`.
pub(super) fn parse(text: &str, node: u8) -> Result<Vec<Object>, EdsError> {
    let ini = Ini::parse(text)?;
    let mut objects = Vec::new();
    let mut listed = Vec::new();
    let mut last_list = 1;
    for list in LISTS {
        let Some(section) = ini.section(list) else { continue };
        last_list = section.line;
        let count = section.need("SupportedObjects")?;
        for position in 1..=number(count, node, 0, 0xFFFF)? {
            let entry = section
                .filled(&position.to_string())
                .ok_or_else(|| count.error(format!("[{}] has no `{position}`", section.name)))?;
            let index = number(entry, node, 0, 0xFFFF)? as u16;
            let section = ini
                .section(&format!("{index:04X}"))
                .ok_or_else(|| entry.error(format!("section [{index:04X}] is missing")))?;
            if !listed.contains(&index) {
                listed.push(index);
                read_object(&ini, section, index, node, &mut objects)?;
            }
        }
    }
    for section in &ini.sections {
        check_listed(section, &listed)?;
    }
    match MANDATORY.into_iter().find(|index| !listed.contains(index)) {
        Some(index) => {
            Err(EdsError::new(last_list, format!("mandatory object {index:04X} is missing")))
        }
        None => Ok(objects),
    }
}

/// Rejects sections of unlisted objects and of subindices without object.
fn check_listed(section: &Section<'_>, listed: &[u16]) -> Result<(), EdsError> {
    let reason = match (subindex_of(section.name), index_of(section.name)) {
        (Some((owner, _)), _) if !listed.contains(&owner) => {
            format!("[{}] belongs to no object", section.name)
        }
        (None, Some(index)) if !listed.contains(&index) => {
            format!("object {index:04X} is in no object list")
        }
        _ => return Ok(()),
    };
    Err(EdsError::new(section.line, reason))
}

/// Index of a section like `[1018]`.
fn index_of(name: &str) -> Option<u16> {
    let is_index = name.len() == 4 && name.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_index.then(|| u16::from_str_radix(name, 16).ok()).flatten()
}

/// Index and subindex of a section like `[1018sub1]`.
fn subindex_of(name: &str) -> Option<(u16, u8)> {
    let index = index_of(name.get(..4)?)?;
    let digits = name.get(7..)?;
    let is_sub = name.get(4..7)?.eq_ignore_ascii_case("sub")
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
    let count = section.filled("CompactSubObj");
    match (object_type(section, node)?, count) {
        (kind @ (DOMAIN | VARIABLE), _) => {
            objects.push(read_variable(section, (index, 0), kind, node)?);
        }
        // An array without subindex sections: all elements are alike.
        (8 | 9, Some(count)) => {
            let count = number(count, node, 1, 0xFE)? as u8;
            let value = Value::Number(count.into());
            objects.push(Object::new((index, 0), DataType::Unsigned(1), Access::Const, value));
            for subindex in 1..=count {
                objects.push(read_variable(section, (index, subindex), VARIABLE, node)?);
            }
        }
        (8 | 9, None) => {
            let count = section.need("SubNumber")?;
            let announced = number(count, node, 0, 255)?;
            let before = objects.len();
            for section in &ini.sections {
                match subindex_of(section.name) {
                    Some(key) if key.0 == index => {
                        let kind = object_type(section, node)?;
                        objects.push(read_variable(section, key, kind, node)?);
                    }
                    _ => {}
                }
            }
            let found = objects.len() - before;
            if found as i64 != announced {
                return Err(count.error(format!(
                    "object {index:04X} has {found} subindices; `SubNumber` is {announced}"
                )));
            }
        }
        (code, _) => {
            return Err(section.need("ObjectType")?.error(format!(
                "invalid object type {code}; allowed: 2 (DOMAIN), 7 (VAR), 8 (ARRAY), 9 (RECORD)"
            )));
        }
    }
    Ok(())
}

fn object_type(section: &Section<'_>, node: u8) -> Result<i64, EdsError> {
    section.filled("ObjectType").map_or(Ok(VARIABLE), |entry| number(entry, node, 0, 0xFF))
}

fn read_variable(
    section: &Section<'_>,
    key: (u16, u8),
    object_type: i64,
    node: u8,
) -> Result<Object, EdsError> {
    let is_domain = object_type == DOMAIN;
    let data_type = match section.filled("DataType") {
        None if is_domain => DataType::Domain,
        _ => {
            let entry = section.need("DataType")?;
            let code = number(entry, node, 0, 0xFFFF)? as u16;
            DataType::from_index(code)
                .ok_or_else(|| entry.error(format!("unknown data type {code:#06X}")))?
        }
    };
    let access = match section.filled("AccessType") {
        None if is_domain => Access::ReadWrite,
        _ => read_access(section.need("AccessType")?)?,
    };
    let mapping = section.filled("PDOMapping").map(|entry| number(entry, node, 0, 1));
    let mappable = mapping.transpose()? == Some(1);
    let limits = read_limits(section, data_type, node)?;
    let default = read_default(section, data_type, limits, node)?;
    Ok(Object { mappable, limits, ..Object::new(key, data_type, access, default) })
}

fn read_access(entry: Entry<'_>) -> Result<Access, EdsError> {
    Ok(match entry.value.to_ascii_lowercase().as_str() {
        "const" => Access::Const,
        "ro" => Access::ReadOnly,
        "wo" => Access::WriteOnly,
        "rw" => Access::ReadWrite,
        "rwr" => Access::ReadWriteInput,
        "rww" => Access::ReadWriteOutput,
        _ => {
            return Err(entry.error(format!(
                "invalid access type `{}`; allowed: const, ro, wo, rw, rwr, rww",
                entry.value
            )));
        }
    })
}

type Limits = (Option<i64>, Option<i64>);

fn read_limits(section: &Section<'_>, data_type: DataType, node: u8) -> Result<Limits, EdsError> {
    if !matches!(data_type, DataType::Signed(_) | DataType::Unsigned(_)) {
        return Ok((None, None));
    }
    let limit = |key| section.filled(key).map(|entry| typed(entry, data_type, node)).transpose();
    let limits = (limit("LowLimit")?, limit("HighLimit")?);
    match limits {
        (Some(low), Some(high)) if low > high => Err(section
            .need("LowLimit")?
            .error(format!("the lower limit {low} is above the upper limit {high}"))),
        _ => Ok(limits),
    }
}

fn read_default(
    section: &Section<'_>,
    data_type: DataType,
    (low, high): Limits,
    node: u8,
) -> Result<Value, EdsError> {
    let entry = section.filled("DefaultValue");
    let text = entry.map_or("", |entry| entry.value);
    Ok(match (data_type, entry) {
        (DataType::Text, _) => Value::Bytes(text.bytes().collect()),
        (DataType::Unicode, _) => {
            Value::Bytes(text.encode_utf16().flat_map(u16::to_le_bytes).collect())
        }
        (DataType::Octets, Some(entry)) => Value::Bytes(read_bytes(entry)?),
        // The default of a domain is at most a file name.
        (DataType::Octets | DataType::Domain, _) => Value::Bytes(Vec::new()),
        (_, None) => Value::Number(0),
        (DataType::Real(bytes), Some(entry)) => Value::Number(read_real(entry, bytes)?),
        (DataType::Boolean | DataType::Signed(_) | DataType::Unsigned(_), Some(entry)) => {
            let number = i128::from(typed(entry, data_type, node)?);
            let (low, high) = (low.unwrap_or(i64::MIN), high.unwrap_or(i64::MAX));
            Value::Number(data_type.cut(within(entry, number, low, high)? as u64))
        }
    })
}

fn read_bytes(entry: Entry<'_>) -> Result<Vec<u8>, EdsError> {
    let digits = entry.value.chars().filter(|character| !character.is_whitespace());
    let digits: Option<Vec<_>> = digits.map(|character| character.to_digit(16)).collect();
    let digits = digits.filter(|digits| digits.len() % 2 == 0).ok_or_else(|| {
        entry.error(format!("`{}` is not a sequence of bytes in hexadecimal digits", entry.value))
    })?;
    Ok(digits
        .chunks(2)
        .map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | *digit as u8))
        .collect())
}

/// Reads a real, written as a number or as its bits.
fn read_real(entry: Entry<'_>, bytes: u8) -> Result<u64, EdsError> {
    let text = entry.value;
    let bits = match hexadecimal(text) {
        Some(digits) => u64::from_str_radix(digits, 16).ok(),
        None if bytes == 4 => text.parse().ok().map(|real: f32| u64::from(real.to_bits())),
        None => text.parse().ok().map(f64::to_bits),
    };
    bits.ok_or_else(|| not_a_number(entry))
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
        _ => Err(entry.error(format!("{} is out of range; allowed: {low} to {high}", entry.value))),
    }
}

/// Decimal, hexadecimal with `0x`, octal with a leading 0, or a sum with `$NODEID`.
fn evaluate(entry: Entry<'_>, node: u8) -> Result<i128, EdsError> {
    // A sign at the beginning is not a sum.
    let terms = entry.value.split('+').map(|term| match term.trim() {
        term if term.eq_ignore_ascii_case("$NODEID") => Some(i128::from(node)),
        term => literal(term),
    });
    terms.sum::<Option<_>>().ok_or_else(|| not_a_number(entry))
}

fn not_a_number(entry: Entry<'_>) -> EdsError {
    entry.error(format!("`{}` is not a number", entry.value))
}

fn literal(text: &str) -> Option<i128> {
    let positive = text.strip_prefix('-');
    let digits = positive.unwrap_or(text);
    let (radix, digits) = match hexadecimal(digits) {
        Some(digits) => (16, digits),
        None if digits.len() > 1 && digits.starts_with('0') => (8, digits),
        None => (10, digits),
    };
    // from_str_radix would accept a second sign.
    if digits.starts_with(['+', '-']) {
        return None;
    }
    let value = i128::from(u64::from_str_radix(digits, radix).ok()?);
    Some(if positive.is_some() { -value } else { value })
}

/// The digits after `0x`.
fn hexadecimal(text: &str) -> Option<&str> {
    text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"))
}
