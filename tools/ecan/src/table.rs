use std::io::{self, Write};

use ecan_tool_support::command_line::screen;

/// Prints a row per item with columns as wide as their widest cell; the last column is not padded.
pub fn print<T, const N: usize>(
    out: &mut dyn Write,
    items: impl IntoIterator<Item = T>,
    mut row: impl FnMut(T) -> [String; N],
) -> io::Result<()> {
    // A line break of a name does not begin a row.
    let cell = |text: String| text.replace('\n', "\\n").replace('\t', "\\t");
    let rows: Vec<_> = items.into_iter().map(|item| row(item).map(cell)).collect();
    let width = |column: usize| rows.iter().map(|row| screen::width(&row[column])).max();
    let widths: [usize; N] = std::array::from_fn(|column| width(column).unwrap_or(0));
    for row in &rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            line.push_str(cell);
            let gap = (width + 2).saturating_sub(screen::width(cell));
            line.extend(std::iter::repeat_n(' ', gap));
        }
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

/// As [`print`], after a row of titles.
pub fn print_with_titles<T, const N: usize>(
    out: &mut dyn Write,
    titles: [&str; N],
    items: impl IntoIterator<Item = T>,
    row: impl FnMut(T) -> [String; N],
) -> io::Result<()> {
    let titles = [titles.map(str::to_owned)];
    print(out, titles.into_iter().chain(items.into_iter().map(row)), |row| row)
}

/// Text of a value in a table, `-` without one.
pub fn or_dash(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    #[test]
    fn columns_are_aligned() {
        let rows = [["a", "long one", ""], ["bcd", "x", "end"]];
        let mut out = Vec::new();
        super::print(&mut out, rows, |row| row.map(str::to_owned)).unwrap();
        assert_eq!(String::from_utf8(out).unwrap(), "a    long one\nbcd  x         end\n");
    }
}
