//! Detection of a held key by the repetition of the terminal.

use std::time::Duration;

/// Longest delay of the first repetition: terminals wait 250 to 700 ms.
const FIRST: Duration = Duration::from_millis(1_000);

/// State of the keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold<K> {
    /// No key, or released.
    None,
    /// Pressed; the terminal does not repeat it yet.
    Pressed(K),
    /// Held.
    Held(K),
}

/// Keys as a terminal reports them: pressed, and repeated while held. Times are those since any start.
#[derive(Clone, Copy, Debug)]
pub struct KeyHold<K> {
    /// Time without a repetition after which a key is released.
    timeout: Duration,
    last: Option<(K, Duration)>,
    is_repeating: bool,
}

impl<K: Copy + PartialEq> KeyHold<K> {
    pub fn new(timeout: Duration) -> Self {
        Self { timeout, last: None, is_repeating: false }
    }

    /// A key was pressed or repeated. Presses at intervals above the timeout do not count as held.
    pub fn press(&mut self, key: K, at: Duration) {
        self.is_repeating = matches!(self.last, Some((last, since))
            if last == key && at.saturating_sub(since) <= self.timeout);
        self.last = Some((key, at));
    }

    /// Another key was pressed.
    pub fn release(&mut self) {
        (self.last, self.is_repeating) = (None, false);
    }

    pub fn state(&self, now: Duration) -> Hold<K> {
        let Some((key, at)) = self.last else { return Hold::None };
        let since = now.saturating_sub(at);
        if self.is_repeating {
            return if since <= self.timeout { Hold::Held(key) } else { Hold::None };
        }
        if since <= FIRST { Hold::Pressed(key) } else { Hold::None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMEOUT: Duration = Duration::from_millis(200);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn repeated_key_is_held_until_the_timeout() {
        let mut keys = KeyHold::new(TIMEOUT);
        assert_eq!(keys.state(ms(0)), Hold::None);
        keys.press('a', ms(100));
        assert_eq!(keys.state(ms(600)), Hold::Pressed('a'), "before the first repetition");
        keys.press('a', ms(600));
        assert_eq!(keys.state(ms(610)), Hold::Pressed('a'), "two presses may be single ones");
        keys.press('a', ms(640));
        assert_eq!(keys.state(ms(840)), Hold::Held('a'));
        assert_eq!(keys.state(ms(841)), Hold::None, "released");
        keys.press('a', ms(900));
        assert_eq!(keys.state(ms(901)), Hold::Pressed('a'), "it begins again");
    }

    #[test]
    fn other_key_ends_the_hold() {
        let mut keys = KeyHold::new(TIMEOUT);
        (0..5).for_each(|nth| keys.press('a', ms(nth * 30)));
        assert_eq!(keys.state(ms(121)), Hold::Held('a'));
        keys.press('b', ms(130));
        assert_eq!(keys.state(ms(131)), Hold::Pressed('b'));
        keys.release();
        assert_eq!(keys.state(ms(132)), Hold::None);
    }

    #[test]
    fn single_presses_are_no_held_key() {
        let mut keys = KeyHold::new(TIMEOUT);
        for nth in 0..10 {
            keys.press('a', ms(nth * 250));
            assert_eq!(keys.state(ms(nth * 250 + 1)), Hold::Pressed('a'));
        }
        assert_eq!(keys.state(ms(9 * 250 + 1_001)), Hold::None);
    }
}
