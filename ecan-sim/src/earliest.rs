const NEVER: u64 = u64::MAX;

/// The earliest of several times; `u64::MAX` counts as `None`. Runs after every event: branch-free.
#[inline]
pub(crate) fn earliest(times: impl IntoIterator<Item = Option<u64>>) -> Option<u64> {
    let first = times.into_iter().fold(NEVER, |first, time| first.min(time.unwrap_or(NEVER)));
    (first != NEVER).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_time_is_never_first() {
        assert_eq!(earliest([None, Some(7), Some(3), None]), Some(3));
        assert_eq!(earliest([None, Some(u64::MAX)]), None);
        assert_eq!(earliest([]), None);
    }
}
