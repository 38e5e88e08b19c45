use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use ecan_protocol::mapping::CHANNELS;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Index of a gateway.
    pub gateway: usize,
    pub channel: usize,
    pub is_paused: bool,
    pub has_help: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    None,
    Clear,
    Quit,
}

impl Choice {
    pub fn press(&mut self, key: KeyEvent, gateways: usize) -> Action {
        if key.kind == KeyEventKind::Release {
            return Action::None;
        }
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Char('c') if is_control => return Action::Quit,
            // With the help open, Esc only closes it.
            KeyCode::Esc if self.has_help => self.has_help = false,
            KeyCode::Char('q') | KeyCode::Esc => return Action::Quit,
            KeyCode::Char('c') => return Action::Clear,
            KeyCode::Char('p') => self.is_paused = !self.is_paused,
            KeyCode::Char('?') => self.has_help = !self.has_help,
            KeyCode::Up => self.gateway = self.gateway.saturating_sub(1),
            KeyCode::Down => self.gateway = (self.gateway + 1).min(gateways.saturating_sub(1)),
            KeyCode::Left => self.channel = self.channel.saturating_sub(1),
            KeyCode::Right => self.channel = (self.channel + 1).min(CHANNELS - 1),
            _ => {}
        }
        Action::None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(choice: &mut Choice, code: KeyCode) -> Action {
        choice.press(KeyEvent::new(code, KeyModifiers::NONE), 2)
    }

    #[test]
    fn keys_quit_pause_clear_and_select() {
        let mut choice = Choice::default();
        let control_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
        assert_eq!(choice.press(control_c, 2), Action::Quit);
        assert_eq!(press(&mut choice, KeyCode::Char('q')), Action::Quit);
        assert_eq!(press(&mut choice, KeyCode::Esc), Action::Quit);
        assert_eq!(press(&mut choice, KeyCode::Char('c')), Action::Clear);
        assert_eq!(choice, Choice::default());
        for code in [KeyCode::Down, KeyCode::Down, KeyCode::Down, KeyCode::Right] {
            assert_eq!(press(&mut choice, code), Action::None);
        }
        assert_eq!((choice.gateway, choice.channel), (1, 1));
        for code in [KeyCode::Left, KeyCode::Left, KeyCode::Up, KeyCode::Char('p')] {
            assert_eq!(press(&mut choice, code), Action::None);
        }
        assert_eq!(choice, Choice { is_paused: true, ..Choice::default() });
        press(&mut choice, KeyCode::Char('?'));
        assert!(choice.has_help);
        assert_eq!(press(&mut choice, KeyCode::Esc), Action::None);
        assert!(!choice.has_help);
    }
}
