//! Columns of text.

use std::io::Write;

/// Prints rows with columns as wide as their widest cell; the last column is not padded.
pub fn print<const N: usize>(out: &mut dyn Write, rows: &[[String; N]]) -> std::io::Result<()> {
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max()
    };
    let widths: [usize; N] = std::array::from_fn(|column| width(column).unwrap_or(0));
    for row in rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            line.push_str(cell);
            let gap = (width + 2).saturating_sub(cell.chars().count());
            line.extend(std::iter::repeat_n(' ', gap));
        }
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn columns_are_aligned() {
        let rows = [["a", "long one", ""], ["bcd", "x", "end"]];
        let rows = rows.map(|row| row.map(str::to_owned));
        let mut out = Vec::new();
        super::print(&mut out, &rows).unwrap();
        assert_eq!(String::from_utf8(out).unwrap(), "a    long one\nbcd  x         end\n");
    }
}
