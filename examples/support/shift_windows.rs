//! Usable Sync0 shifts of sweeps, in the form of the table of manual 15.6.1.

use std::fmt;

use ecan_tool_support::plot::ShiftRow;

use crate::phase_table::PhaseTable;

/// Usable shifts of one configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShiftWindows {
    /// Sync0 period in nanoseconds.
    pub period_ns: u32,
    /// Bytes of process data per direction and gateway.
    pub pdo_bytes: usize,
    /// The tested shifts in nanoseconds, ascending, with whether each is usable.
    pub shifts: Vec<(u32, bool)>,
    /// The recommended one of them.
    pub recommended_ns: Option<u32>,
    /// First and last shift that the plan finds usable, in nanoseconds.
    pub planned_ns: Option<(u32, u32)>,
}

impl ShiftWindows {
    /// The shifts of a sweep at the offset of its recommended point.
    pub fn new(table: &PhaseTable, pdo_bytes: usize, planned_ns: Option<(u32, u32)>) -> Self {
        let best = table.recommended();
        let mut shifts: Vec<(u32, bool)> = table
            .points
            .iter()
            .filter(|point| best.is_none_or(|best| point.offset_ns == best.offset_ns))
            .map(|point| (point.shift_ns, table.is_good(point)))
            .collect();
        shifts.sort_unstable();
        shifts.dedup_by_key(|(shift_ns, _)| *shift_ns);
        let recommended_ns = best.map(|best| best.shift_ns);
        Self { period_ns: table.period_ns, pdo_bytes, shifts, recommended_ns, planned_ns }
    }

    /// First and last shift of each run of usable ones, in nanoseconds. Shifts are cyclic: in a run over
    /// the end of the period the first is the larger one.
    pub fn windows(&self) -> Vec<(u32, u32)> {
        let mut windows: Vec<(u32, u32)> = Vec::new();
        let mut is_open = false;
        for &(shift, is_usable) in &self.shifts {
            match windows.last_mut() {
                Some(last) if is_open && is_usable => last.1 = shift,
                _ if is_usable => windows.push((shift, shift)),
                _ => {}
            }
            is_open = is_usable;
        }
        let ends = (self.shifts.first(), self.shifts.last());
        if let (Some((_, true)), Some((_, true))) = ends
            && windows.len() > 1
        {
            let (_, end) = windows.remove(0);
            if let Some(last) = windows.last_mut() {
                last.1 = end;
            }
        }
        windows
    }

    /// The windows in microseconds: `300 to 900 us; 0 us`.
    pub fn text(&self) -> String {
        let us = |ns: u32| ns / 1_000;
        let windows: Vec<String> = self
            .windows()
            .into_iter()
            .map(|(first, last)| match first == last {
                true => format!("{} us", us(first)),
                false => format!("{} to {} us", us(first), us(last)),
            })
            .collect();
        if windows.is_empty() { "none".to_owned() } else { windows.join("; ") }
    }
}

/// `DC Sync0   1 ms    384B   300 to 100 us            700 us`, below [`HEADING`].
impl fmt::Display for ShiftWindows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let recommended =
            self.recommended_ns.map_or_else(|| "-".to_owned(), |ns| format!("{} us", ns / 1_000));
        write!(
            f,
            "{:<10} {:<8} {:<6} {:<32} {recommended}",
            "DC Sync0",
            cycle(self.period_ns),
            format!("{}B", self.pdo_bytes),
            self.text()
        )
    }
}

/// Heading of the rows.
pub const HEADING: &str =
    "Mode       Cycle    PDO    Usable shifts                    Recommended shift";

fn cycle(period_ns: u32) -> String {
    format!("{} ms", f64::from(period_ns) / 1e6)
}

impl ShiftWindows {
    /// Row of a picture.
    pub fn row(&self) -> ShiftRow {
        ShiftRow {
            title: format!("{}, {}B", cycle(self.period_ns), self.pdo_bytes),
            period_ns: self.period_ns,
            shifts: self.shifts.clone(),
            recommended_ns: self.recommended_ns,
            planned_ns: self.planned_ns,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows(usable: &[u32]) -> ShiftWindows {
        ShiftWindows {
            period_ns: 1_000_000,
            pdo_bytes: 384,
            shifts: (0..10).map(|nth| (nth * 100_000, usable.contains(&nth))).collect(),
            recommended_ns: Some(700_000),
            planned_ns: Some((330_000, 30_000)),
        }
    }

    #[test]
    fn usable_shifts_in_a_row_are_one_window() {
        assert_eq!(windows(&[3, 4, 5]).windows(), [(300_000, 500_000)]);
        assert_eq!(windows(&[2, 5, 6]).text(), "200 us; 500 to 600 us");
        assert_eq!(windows(&[]).text(), "none");
    }

    #[test]
    fn window_over_the_end_of_the_period_is_one() {
        assert_eq!(windows(&[0, 1, 3, 8, 9]).windows(), [(300_000, 300_000), (800_000, 100_000)]);
        let all: Vec<u32> = (0..10).collect();
        assert_eq!(windows(&all).windows(), [(0, 900_000)]);
    }

    #[test]
    fn row_has_the_columns_of_the_manual() {
        let row = windows(&[3, 4, 5, 6, 7, 8, 9, 0]).to_string();
        let columns: Vec<&str> = row.split("  ").map(str::trim).filter(|c| !c.is_empty()).collect();
        assert_eq!(columns, ["DC Sync0", "1 ms", "384B", "300 to 0 us", "700 us"]);
    }
}
