//! Values of the tables that the example programs print.

/// Value of a row in the column whose head ends at the same place, as in right-aligned tables.
pub fn value<'a>(output: &'a str, column: &str, row: &str) -> Option<&'a str> {
    let mut lines = output.lines();
    let end = lines.by_ref().find_map(|line| head_end(line, column))?;
    let line =
        lines.take_while(|line| !line.trim().is_empty()).find(|line| line.starts_with(row))?;
    line.get(..end.min(line.len()))?.split_whitespace().last()
}

/// As [`value`], as a number.
pub fn number(output: &str, column: &str, row: &str) -> Option<u64> {
    value(output, column, row)?.parse().ok()
}

/// End of a column's head in a line of heads, which begins with the name of the rows.
fn head_end(line: &str, column: &str) -> Option<usize> {
    let begins_table = ["channel", "gateway", "axis"].iter().any(|name| line.starts_with(name));
    let start = begins_table.then(|| line.find(&format!(" {column}")))??;
    let end = start + 1 + column.len();
    let is_whole = line.as_bytes().get(end).is_none_or(|next| *next == b' ');
    is_whole.then_some(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_by_row_and_column() {
        let output = "\
1 gateway(s) ready

channel             sent delivered  received discarded    rejected  bus load
slave 0 can0         100        99        98         0           7     2.2 %
slave 0 can1           5         5         5         0           0     2.2 %

gateway           cycles   wc miss    images  repeated   rx images   rx lost    errors
slave 0              103         2       472         0         104         0         0
";
        assert_eq!(number(output, "delivered", "slave 0 can0"), Some(99));
        assert_eq!(number(output, "rejected", "slave 0 can0"), Some(7));
        assert_eq!(number(output, "received", "slave 0 can1"), Some(5));
        assert_eq!(number(output, "wc miss", "slave 0"), Some(2));
        assert_eq!(number(output, "errors", "slave 0"), Some(0));
        assert_eq!(number(output, "sent", "slave 1 can0"), None);
        assert_eq!(number(output, "unknown", "slave 0"), None);
    }
}
