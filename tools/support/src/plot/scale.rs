//! Ranges and labels of axes.

use std::ops::Range;

/// Returns the range of these values with a margin of 6 %, at least `least` wide.
pub fn range(values: impl Iterator<Item = f64>, least: f64) -> Range<f64> {
    let mut ends: Option<(f64, f64)> = None;
    for value in values.filter(|value| value.is_finite()) {
        let (low, high) = ends.unwrap_or((value, value));
        ends = Some((low.min(value), high.max(value)));
    }
    let (low, high) = ends.unwrap_or((0.0, 0.0));
    let missing = (least - (high - low)).max(0.0) / 2.0;
    let margin = missing + (high - low) * 0.06;
    low - margin..high + margin
}

/// Formats a value of an axis of this width: as many decimals as its ticks need.
pub fn label(value: f64, width: f64) -> String {
    let step = width.abs() / 10.0;
    let decimals = if step > 0.0 { (-step.log10().floor()).clamp(0.0, 9.0) as usize } else { 0 };
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_zero { "0".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_get_a_range_of_the_least_width() {
        assert_eq!(range([5.0, 5.0].into_iter(), 4.0), 3.0..7.0);
        assert_eq!(range(std::iter::empty(), 2.0), -1.0..1.0);
        assert_eq!(range([f64::NAN, 1.0, 2.0].into_iter(), 0.0), 0.94..2.06);
    }

    #[test]
    fn labels_have_the_decimals_of_their_ticks() {
        assert_eq!(label(120_000.0, 200_000.0), "120000");
        assert_eq!(label(0.25, 1.0), "0.2");
        assert_eq!(label(0.0005, 0.002), "0.0005");
        assert_eq!(label(-0.0, 3.0), "0");
    }
}
