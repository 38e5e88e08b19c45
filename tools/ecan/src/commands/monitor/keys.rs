//! Keys of the full-screen mode, and what they select.

use clap::ValueEnum;
use crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ecan_protocol::mapping::CHANNELS;

use super::snapshot::{IdView, Snapshot};
use crate::frames::Channels;

/// Rows of a page.
const PAGE: usize = 10;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum View {
    /// Gateways, channels, cycle and events
    #[default]
    Overview,
    /// Frames by gateway, channel, CAN ID and direction
    Ids,
    /// Axes of the application, through its service
    Axes,
}

/// Order of the CAN IDs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Sort {
    /// Gateway, channel, CAN ID, direction
    #[default]
    Id,
    /// Most frames first
    Count,
    /// Shortest mean period first
    Period,
    /// Latest frame first
    Age,
}

impl Sort {
    pub fn text(self) -> &'static str {
        match self {
            Self::Id => "CAN ID",
            Self::Count => "count",
            Self::Period => "period",
            Self::Age => "age",
        }
    }

    fn next(self) -> Self {
        match self {
            Self::Id => Self::Count,
            Self::Count => Self::Period,
            Self::Period => Self::Age,
            Self::Age => Self::Id,
        }
    }
}

/// Selection of the user.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    pub view: View,
    /// Index of a gateway.
    pub gateway: usize,
    pub channel: usize,
    /// Index among the shown CAN IDs.
    pub id: usize,
    pub sort: Sort,
    /// Channels of the shown CAN IDs.
    pub filter: Channels,
    /// Index of an axis.
    pub axis: usize,
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
    /// Shown CAN IDs in their order.
    pub fn ids<'a>(&self, snapshot: &'a Snapshot) -> Vec<&'a IdView> {
        let ids = snapshot.ids.ids.iter().filter(|id| self.filter.contains(id.channel));
        let mut ids: Vec<_> = ids.collect();
        match self.sort {
            Sort::Id => {}
            Sort::Count => ids.sort_by_key(|id| std::cmp::Reverse(id.count)),
            Sort::Period => ids.sort_by_key(|id| id.mean_period_ns.unwrap_or(u64::MAX)),
            Sort::Age => ids.sort_by_key(|id| id.age_ns),
        }
        ids
    }

    pub fn press(&mut self, key: KeyEvent, snapshot: &Snapshot) -> Action {
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
            KeyCode::Char('1') => self.view = View::Overview,
            KeyCode::Char('2') => self.view = View::Ids,
            KeyCode::Char('3') => self.view = View::Axes,
            KeyCode::Char('s') => self.sort = self.sort.next(),
            KeyCode::Up => self.move_row(snapshot, |row| row.saturating_sub(1)),
            KeyCode::Down => self.move_row(snapshot, |row| row + 1),
            KeyCode::PageUp => self.move_row(snapshot, |row| row.saturating_sub(PAGE)),
            KeyCode::PageDown => self.move_row(snapshot, |row| row + PAGE),
            KeyCode::Home => self.move_row(snapshot, |_| 0),
            KeyCode::End => self.move_row(snapshot, |_| usize::MAX),
            KeyCode::Left => self.move_channel(false),
            KeyCode::Right => self.move_channel(true),
            _ => {}
        }
        Action::None
    }

    fn move_row(&mut self, snapshot: &Snapshot, to: impl Fn(usize) -> usize) {
        let (row, count) = match self.view {
            View::Overview => (self.gateway, snapshot.gateways.len()),
            View::Ids => (self.id, self.ids(snapshot).len()),
            View::Axes => (self.axis, snapshot.axes.axes.len()),
        };
        let row = to(row).min(count.saturating_sub(1));
        match self.view {
            View::Overview => self.gateway = row,
            View::Ids => self.id = row,
            View::Axes => self.axis = row,
        }
    }

    /// Selects a channel, or the filter: all channels, then each one.
    fn move_channel(&mut self, is_right: bool) {
        let filters = (0..CHANNELS as u8).map(Channels::only);
        let filters: Vec<_> = std::iter::once(Channels::ALL).chain(filters).collect();
        let (at, count) = match self.view {
            View::Overview => (self.channel, CHANNELS),
            View::Ids => {
                let at = filters.iter().position(|filter| *filter == self.filter);
                (at.unwrap_or(0), filters.len())
            }
            View::Axes => return,
        };
        let at = if is_right { (at + 1).min(count - 1) } else { at.saturating_sub(1) };
        match (self.view, filters.get(at)) {
            (View::Ids, Some(filter)) => (self.filter, self.id) = (*filter, 0),
            _ => self.channel = at,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::snapshot::GatewayView;
    use super::super::test_snapshots::{axes, ids};
    use super::*;

    fn key(code: KeyCode) -> KeyEvent {
        KeyEvent::new(code, KeyModifiers::NONE)
    }

    fn press(choice: &mut Choice, codes: &[KeyCode], snapshot: &Snapshot) {
        for code in codes {
            assert_eq!(choice.press(key(*code), snapshot), Action::None, "{code:?}");
        }
    }

    fn two_gateways() -> Snapshot {
        Snapshot { gateways: vec![GatewayView::default(); 2], ..Snapshot::default() }
    }

    #[test]
    fn keys_quit_pause_clear_and_select() {
        let (mut choice, bus) = (Choice::default(), two_gateways());
        let control_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
        assert_eq!(choice.press(control_c, &bus), Action::Quit);
        assert_eq!(choice.press(key(KeyCode::Char('q')), &bus), Action::Quit);
        assert_eq!(choice.press(key(KeyCode::Esc), &bus), Action::Quit);
        assert_eq!(choice.press(key(KeyCode::Char('c')), &bus), Action::Clear);
        assert_eq!(choice, Choice::default());
        press(&mut choice, &[KeyCode::Down, KeyCode::Down, KeyCode::Right], &bus);
        assert_eq!((choice.gateway, choice.channel), (1, 1));
        press(&mut choice, &[KeyCode::Left, KeyCode::Left, KeyCode::Up], &bus);
        press(&mut choice, &[KeyCode::Char('p')], &bus);
        assert_eq!(choice, Choice { is_paused: true, ..Choice::default() });
        press(&mut choice, &[KeyCode::Char('?')], &bus);
        assert!(choice.has_help);
        press(&mut choice, &[KeyCode::Esc], &bus);
        assert!(!choice.has_help);
    }

    #[test]
    fn keys_sort_filter_and_scroll_the_view() {
        let bus = ids();
        let mut choice = Choice { filter: Channels::ALL, ..Choice::default() };
        press(&mut choice, &[KeyCode::Char('2'), KeyCode::End], &bus);
        assert_eq!((choice.view, choice.id), (View::Ids, bus.ids.ids.len() - 1));
        press(&mut choice, &[KeyCode::PageUp], &bus);
        assert_eq!(choice.id, bus.ids.ids.len() - 1 - PAGE);
        press(&mut choice, &[KeyCode::Right, KeyCode::Right], &bus);
        assert_eq!((choice.filter, choice.id), (Channels::only(1), 0));
        assert!(choice.ids(&bus).iter().all(|id| id.channel == 1));
        press(&mut choice, &[KeyCode::Left, KeyCode::Left, KeyCode::Left], &bus);
        assert_eq!((choice.filter, choice.gateway, choice.channel), (Channels::ALL, 0, 0));
        let mut shown = |sort| {
            press(&mut choice, &[KeyCode::Char('s')], &bus);
            assert_eq!(choice.sort, sort);
            choice.ids(&bus).into_iter().copied().collect::<Vec<_>>()
        };
        assert!(shown(Sort::Count).is_sorted_by(|a, b| a.count >= b.count));
        let by_period = shown(Sort::Period);
        assert!(by_period.iter().filter_map(|row| row.mean_period_ns).is_sorted());
        assert_eq!(by_period.last().unwrap().mean_period_ns, None);
        assert!(shown(Sort::Age).is_sorted_by_key(|row| row.age_ns));
        assert_eq!(shown(Sort::Id), bus.ids.ids);
        let bus = axes();
        press(&mut choice, &[KeyCode::Char('3'), KeyCode::End, KeyCode::Right], &bus);
        assert_eq!(choice.axis, bus.axes.axes.len() - 1);
    }
}
