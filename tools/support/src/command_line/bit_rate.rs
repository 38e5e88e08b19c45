//! Bit rates of options, in bit/s with an optional factor.

/// Parses a bit rate: `500000`, `500k`, `1M` or `2.5M`.
///
/// # Errors
/// The text is not a bit rate from 1 to 4294967295 bit/s.
pub fn parse_bit_rate(text: &str) -> Result<u32, String> {
    let (digits, factor) = match text.strip_suffix(['k', 'M']) {
        Some(digits) if text.ends_with('k') => (digits, 1_000),
        Some(digits) => (digits, 1_000_000),
        None => (text, 1),
    };
    scaled(digits, factor).filter(|rate| *rate > 0).ok_or_else(|| {
        "expected a bit rate in bit/s, with k or M for thousands or millions: 500000, 500k, 1M"
            .to_owned()
    })
}

/// The decimal number times the factor, if that is an integer.
fn scaled(digits: &str, factor: u32) -> Option<u32> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|it| it.is_ascii_digit());
    let (whole, fraction) = match digits.split_once('.') {
        Some((whole, fraction)) if is_number(fraction) => (whole, fraction),
        Some(_) => return None,
        None => (digits, ""),
    };
    if !is_number(whole) {
        return None;
    }
    let divisor = 10_u64.checked_pow(fraction.len().try_into().ok()?)?;
    let product = format!("{whole}{fraction}").parse::<u64>().ok()?.checked_mul(factor.into())?;
    if product % divisor != 0 {
        return None;
    }
    u32::try_from(product / divisor).ok()
}

#[cfg(test)]
mod tests {
    use super::parse_bit_rate;

    #[test]
    fn bit_rates_have_factors() {
        for (text, rate) in [
            ("500000", 500_000),
            ("500k", 500_000),
            ("83.333k", 83_333),
            ("1M", 1_000_000),
            ("2.5M", 2_500_000),
            ("4294967295", u32::MAX),
        ] {
            assert_eq!(parse_bit_rate(text), Ok(rate), "{text}");
        }
        for wrong in [
            "",
            "0",
            "0k",
            "k",
            "M",
            "5K",
            "5 k",
            "-5k",
            "+5k",
            ".5M",
            "1.M",
            "1.5",
            "0.0001k",
            "4295M",
            "500kk",
            "1e6",
            "99999999999999999999k",
            "1.00000000000000000000M",
        ] {
            let message = parse_bit_rate(wrong).unwrap_err();
            assert!(message.contains("500000, 500k, 1M"), "{wrong}: {message}");
        }
    }
}
