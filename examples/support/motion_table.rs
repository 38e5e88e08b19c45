//! Table of the axes at the end of a motion demo.

use std::fmt::Write;

use ecan_cia402::Cia402;

/// One line per axis: state, target, actual position, following error, gaps, emergencies.
pub fn table(cia402: &Cia402) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "\n{:<38}{:<20}{:>11}{:>11}{:>8}{:>8}{:>8}{:>7}{:>6}",
        "axis", "state", "target", "actual", "error", "max", "TPDOs", "lost", "EMCY"
    );
    for axis in cia402.axes() {
        let statistics = axis.statistics();
        let error = axis.following_error();
        // The statistics measure the error before the target of the cycle, the column after it.
        let max_error = statistics.max_following_error.max(error.map_or(0, i64::unsigned_abs));
        let number = |value: Option<i64>| value.map_or_else(|| "-".into(), |v| v.to_string());
        let state = axis.drive_state().map_or_else(|| "unknown".into(), |state| state.to_string());
        let _ = writeln!(
            text,
            "{:<38}{:<20}{:>11}{:>11}{:>8}{:>8}{:>8}{:>7}{:>6}",
            format!("{}: {}", axis.index(), axis.config().address),
            state,
            number(axis.target().map(i64::from)),
            number(axis.actual().map(i64::from)),
            number(error),
            max_error,
            statistics.tpdos,
            statistics.lost_tpdos,
            statistics.emergencies
        );
        if let Some(reason) = statistics.last_hold {
            let _ = writeln!(text, "   held {} time(s), last: {reason}", statistics.holds);
        }
        if let Some(error) = axis.error() {
            let _ = writeln!(text, "   {error}");
        }
    }
    text
}
