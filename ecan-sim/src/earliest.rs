//! The first of several instants.

const NEVER: u64 = u64::MAX;

/// The earliest of some instants, each of which may never come; the end of time counts as never.
///
/// Asked for after every event, so it is made of comparisons without branches.
#[inline]
pub(crate) fn earliest(times: impl IntoIterator<Item = Option<u64>>) -> Option<u64> {
    let first = times.into_iter().fold(NEVER, |first, time| first.min(time.unwrap_or(NEVER)));
    (first != NEVER).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_never_comes_is_not_first() {
        assert_eq!(earliest([None, Some(7), Some(3), None]), Some(3));
        assert_eq!(earliest([None, Some(u64::MAX)]), None);
        assert_eq!(earliest([]), None);
    }
}
