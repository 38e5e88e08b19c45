//! Keys in the bytes of a terminal.

/// Key that a command uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    Left,
    Right,
    Up,
    Down,
    Enter,
    Escape,
    /// Ctrl-C or Ctrl-D as a byte.
    Control,
    Character(u8),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
enum State {
    #[default]
    Ground,
    /// After ESC.
    Escape,
    /// After ESC [ or ESC O, with parameters that are ignored.
    Sequence,
}

/// Reads keys from bytes, also if a sequence arrives in parts.
#[derive(Debug, Default)]
pub struct KeyParser(State);

impl KeyParser {
    /// Reads a byte; `None` within a sequence, and for sequences of other keys.
    pub fn byte(&mut self, byte: u8) -> Option<Key> {
        match (self.0, byte) {
            (State::Escape, b'[' | b'O') => {
                self.0 = State::Sequence;
                None
            }
            (State::Sequence, b'0'..=b'9' | b';' | b':' | b'?') => None,
            (State::Sequence, byte) => {
                self.0 = State::Ground;
                match byte {
                    b'A' => Some(Key::Up),
                    b'B' => Some(Key::Down),
                    b'C' => Some(Key::Right),
                    b'D' => Some(Key::Left),
                    _ => None,
                }
            }
            (_, 0x1B) => {
                self.0 = State::Escape;
                None
            }
            (_, byte) => {
                self.0 = State::Ground;
                Some(match byte {
                    b'\r' | b'\n' => Key::Enter,
                    0x03 | 0x04 => Key::Control,
                    byte => Key::Character(byte),
                })
            }
        }
    }

    /// Returns whether an escape byte waits for the rest of a sequence.
    pub fn is_pending(&self) -> bool {
        self.0 != State::Ground
    }

    /// The rest of a sequence did not come: the key Esc, or nothing.
    pub fn timed_out(&mut self) -> Option<Key> {
        let state = std::mem::take(&mut self.0);
        (state == State::Escape).then_some(Key::Escape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(bytes: &[u8]) -> Vec<Key> {
        let mut parser = KeyParser::default();
        let mut keys: Vec<_> = bytes.iter().filter_map(|byte| parser.byte(*byte)).collect();
        keys.extend(parser.timed_out());
        keys
    }

    #[test]
    fn arrows_of_both_cursor_modes_are_keys() {
        let arrows = [Key::Up, Key::Down, Key::Right, Key::Left];
        assert_eq!(keys(b"\x1b[A\x1b[B\x1b[C\x1b[D"), arrows);
        assert_eq!(keys(b"\x1bOA\x1bOB\x1bOC\x1bOD"), arrows);
        assert_eq!(keys(b"\x1b[1;5C"), [Key::Right], "with Ctrl");
    }

    #[test]
    fn other_sequences_are_ignored_and_escape_alone_is_a_key() {
        assert_eq!(keys(b"\x1b[5~q\n\x03"), [Key::Character(b'q'), Key::Enter, Key::Control]);
        assert_eq!(keys(b"\x1b"), [Key::Escape]);
        assert_eq!(keys(b"\x1b\x1b[A"), [Key::Up]);
        assert_eq!(keys(b"\x1b["), []);
    }
}
