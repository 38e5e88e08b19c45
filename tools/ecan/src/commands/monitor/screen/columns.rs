//! Columns of a table that fit into the width of the screen.

use ratatui::layout::Constraint;
use ratatui::style::Modifier;
use ratatui::widgets::{Cell, Row};

/// Columns that are shown, in their order.
pub struct Columns<const N: usize> {
    shown: Vec<usize>,
    widths: [u16; N],
    titles: [&'static str; N],
}

impl<const N: usize> Columns<N> {
    /// Columns by title and width; the first ones in `priority` that fit are shown. A width of 0 takes
    /// the rest.
    pub fn new(columns: [(&'static str, u16); N], priority: [usize; N], room: u16) -> Self {
        let (titles, widths) = (columns.map(|it| it.0), columns.map(|it| it.1));
        let mut used = 0;
        let fits = |column: &usize| {
            used += widths.get(*column).copied().unwrap_or_default() + 1;
            used <= room + 1
        };
        let mut shown: Vec<_> = priority.into_iter().take_while(fits).collect();
        shown.sort_unstable();
        Self { shown, widths, titles }
    }

    /// Returns whether a column is shown.
    pub fn contains(&self, column: usize) -> bool {
        self.shown.contains(&column)
    }

    /// Width of the column that takes the rest.
    pub fn rest(&self, width: u16) -> usize {
        let others = self.shown(&self.widths).filter(|width| **width > 0);
        width.saturating_sub(others.map(|width| width + 1).sum()).into()
    }

    pub fn widths(&self) -> Vec<Constraint> {
        let constraint = |width: u16| match width {
            0 => Constraint::Min(0),
            width => Constraint::Length(width),
        };
        self.shown(&self.widths).map(|width| constraint(*width)).collect()
    }

    pub fn titles(&self) -> Row<'static> {
        let titles: Vec<_> = self.shown(&self.titles).map(|title| Cell::from(*title)).collect();
        Row::new(titles).style(Modifier::BOLD)
    }

    pub fn row<'a, C: Clone + Into<Cell<'a>>>(&self, cells: [C; N]) -> Row<'a> {
        Row::new(self.shown(&cells).map(|cell| cell.clone().into()).collect::<Vec<_>>())
    }

    fn shown<'a, T>(&'a self, items: &'a [T; N]) -> impl Iterator<Item = &'a T> {
        self.shown.iter().filter_map(|at| items.get(*at))
    }
}
