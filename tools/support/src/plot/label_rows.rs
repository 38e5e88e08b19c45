//! Placement of texts above each other so that they do not overlap.

/// Rows of texts in an area of this width.
#[derive(Debug)]
pub struct LabelRows {
    width: i32,
    /// Right end of the last text of each row.
    ends: Vec<i32>,
    most: usize,
}

/// Distance between two texts of a row, in units.
const GAP: i32 = 8;

impl LabelRows {
    pub fn new(width: i32, most: usize) -> Self {
        Self { width, ends: Vec::new(), most }
    }

    /// Returns left end and row of a text of this width at `x`; to the left of `x` if there is no
    /// space to the right. `None` if no row has space. Texts come in the order of `x`.
    pub fn place(&mut self, x: i32, text_width: i32) -> Option<(i32, usize)> {
        let left = x.min(self.width - text_width).max(0);
        let free = self.ends.iter().position(|end| end + GAP <= left);
        let row = match free {
            Some(row) => row,
            None if self.ends.len() < self.most => {
                self.ends.push(0);
                self.ends.len() - 1
            }
            None => return None,
        };
        *self.ends.get_mut(row)? = left + text_width;
        Some((left, row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_that_would_overlap_get_another_row() {
        let mut rows = LabelRows::new(300, 2);
        assert_eq!(rows.place(0, 100), Some((0, 0)));
        assert_eq!(rows.place(50, 100), Some((50, 1)));
        assert_eq!(rows.place(60, 100), None, "both rows are taken");
        assert_eq!(rows.place(120, 100), Some((120, 0)));
        assert_eq!(rows.place(290, 100), Some((200, 1)), "moved to the left");
        assert_eq!(rows.place(290, 100), None);
    }
}
