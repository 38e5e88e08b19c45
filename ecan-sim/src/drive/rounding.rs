/// The nearest integer, as `value.round() as i64`, which needs a call into a library on processors
/// without SSE 4.1.
pub(super) fn nearest(value: f64) -> i64 {
    let whole = value as i64;
    let rest = value - whole as f64;
    whole.saturating_add(i64::from(rest >= 0.5)).saturating_sub(i64::from(rest <= -0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_integer_is_that_of_round() {
        let edges = [0.0, 0.499_999_999_999_999_94, 0.5, 1.5, 2.5, 1e9 + 0.5, 4.5e15 + 0.5, 9.3e18];
        let special = [f64::NAN, f64::INFINITY, f64::MAX, f64::MIN_POSITIVE, 2f64.powi(63)];
        for value in edges.into_iter().chain(special) {
            for value in [value, -value, value.next_up(), value.next_down()] {
                assert_eq!(nearest(value), value.round() as i64, "{value:?}");
            }
        }
    }
}
