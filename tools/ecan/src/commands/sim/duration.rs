use serde_json::Value;

/// Units and their length in milliseconds; a unit that is the end of another one follows it.
const UNITS: [(&str, f64); 3] = [("ms", 1.0), ("s", 1e3), ("min", 6e4)];
/// About 49 days, as in scenario files.
const MAX_MS: f64 = u32::MAX as f64;

/// Parses a time with its unit, as a number of milliseconds.
pub fn parse(text: &str) -> Result<Value, String> {
    let (number, ms) = UNITS
        .iter()
        .find_map(|(unit, ms)| Some((text.strip_suffix(unit)?, ms)))
        .ok_or("expected a time with its unit, for example 300ms, 1.5s or 1min")?;
    let number: f64 = number.parse().map_err(|_| format!("\"{number}\" is not a number"))?;
    // Rounded to 1 ns: 1.1 s are 1100 ms.
    let ms = (number * ms * 1e6).round() / 1e6;
    match ms.fract() == 0.0 && (0.0..=MAX_MS).contains(&ms) {
        true => Ok(Value::from(ms as u64)),
        false => Err(format!("expected 0 to {MAX_MS} whole milliseconds")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_unit() {
        for (text, ms) in [("300ms", 300), ("1.1s", 1100), ("2min", 120_000), ("0s", 0)] {
            assert_eq!(parse(text), Ok(Value::from(ms)), "{text}");
        }
        for wrong in ["300", "ms", "0.5ms", "-1s", "2h", "nans", "80000min", ""] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
