//! Rows of the table.

/// One measure, with both kernels of the CRC where that makes a difference.
#[derive(Clone, Debug)]
pub struct Row {
    /// Measured quantity.
    pub measure: String,
    /// Largest value that is good, with the accelerated kernel and with the portable one.
    pub goals: Option<[f64; 2]>,
    /// With the accelerated kernel, then with the portable one where that was measured.
    pub values: Vec<f64>,
    /// Values are shares, shown as percentages.
    pub is_share: bool,
    /// Compared sides.
    pub what: &'static str,
}

impl Row {
    /// A ratio that no goal is set for.
    #[must_use]
    pub fn new(measure: impl Into<String>, what: &'static str, value: f64) -> Self {
        Self { measure: measure.into(), goals: None, values: vec![value], is_share: false, what }
    }

    /// The same with goals, for the accelerated and for the portable kernel.
    #[must_use]
    pub fn with_goals(mut self, accelerated: f64, portable: f64) -> Self {
        self.goals = Some([accelerated, portable]);
        self
    }

    /// The same shown in percent.
    #[must_use]
    pub fn as_share(mut self) -> Self {
        self.is_share = true;
        self
    }

    /// The row in Markdown: measure, goal, accelerated, portable, what.
    #[must_use]
    pub fn markdown(&self) -> String {
        let show = |value: f64| {
            if self.is_share { format!("{:.2} %", value * 100.0) } else { format!("{value:.3}") }
        };
        let goal = |value: f64| {
            if self.is_share { format!("{} %", value * 100.0) } else { value.to_string() }
        };
        let goals = self.goals.map_or(String::new(), |[accelerated, portable]| {
            if self.values.len() < 2 {
                goal(accelerated)
            } else {
                format!("{} / {}", goal(accelerated), goal(portable))
            }
        });
        let column = |kernel: usize| {
            let Some(&value) = self.values.get(kernel) else { return String::new() };
            let limit = self.goals.and_then(|goals| goals.get(kernel).copied());
            let is_missed = limit.is_some_and(|limit| value > limit);
            format!("{}{}", show(value), if is_missed { " (missed)" } else { "" })
        };
        let (accelerated, portable) = (column(0), column(1));
        format!("| {} | {goals} | {accelerated} | {portable} | {} |", self.measure, self.what)
    }
}

/// Prints rows; each starts with `= `, for the script that makes one table of all benchmarks.
pub fn print_rows<'a>(rows: impl IntoIterator<Item = &'a Row>) {
    println!("= | measure | goal | accelerated | portable | what |");
    for row in rows {
        println!("= {}", row.markdown());
    }
}

#[cfg(test)]
mod tests {
    use super::Row;

    #[test]
    fn missed_goal_is_marked() {
        let mut row = Row::new("CRC", "to C", 0.05).with_goals(0.06, 0.12);
        row.values.push(0.2);
        assert_eq!(row.markdown(), "| CRC | 0.06 / 0.12 | 0.050 | 0.200 (missed) | to C |");
        let share = Row::new("share", "of wire", 0.004).with_goals(0.004, 0.0).as_share();
        assert_eq!(share.markdown(), "| share | 0.4 % | 0.40 % |  | of wire |");
    }
}
