/// Takes from several sources in turn, so that none is starved.
#[derive(Debug, Default)]
pub struct RoundRobin {
    next: usize,
}

impl RoundRobin {
    /// Returns the next item of the first of `count` sources that has one, starting after the last
    /// source.
    pub fn next<T>(&mut self, count: usize, mut take: impl FnMut(usize) -> Option<T>) -> Option<T> {
        let (from, until) = (self.next.min(count), count);
        (from..until).chain(0..from).find_map(|source| {
            let taken = take(source)?;
            self.next = source + 1;
            Some(taken)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::RoundRobin;

    #[test]
    fn endless_source_starves_no_other() {
        let mut turns = RoundRobin::default();
        let mut rest = [usize::MAX, 2, 0, 3];
        let mut order = Vec::new();
        for _ in 0..9 {
            order.extend(turns.next(4, |source| {
                rest[source] = rest[source].checked_sub(1)?;
                Some(source)
            }));
        }
        assert_eq!(order, [0, 1, 3, 0, 1, 3, 0, 3, 0]);
        assert_eq!(turns.next(4, |_| None::<()>), None);
        assert_eq!(turns.next(0, Some), None);
    }
}
