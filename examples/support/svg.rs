//! Pieces of SVG pictures.

use std::error::Error;
use std::fmt::Write;
use std::path::Path;

/// Returns a picture of this size in pixels, on white.
pub fn picture(width: f64, height: f64, draw: impl FnOnce(&mut String)) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    draw(&mut svg);
    svg + "</svg>\n"
}

pub fn write(path: &Path, text: &str) -> Result<(), Box<dyn Error>> {
    std::fs::write(path, text).map_err(|e| format!("cannot write {}: {e}", path.display()).into())
}

/// Adds a text; `anchor` is start, middle or end, `style` contains further attributes.
pub fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, style: &str, content: &str) {
    // Writing to a String cannot fail.
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" {style}>{}</text>",
        escaped(content)
    );
}

pub fn line(svg: &mut String, [(x1, y1), (x2, y2)]: [(f64, f64); 2], style: &str) {
    let _ = writeln!(
        svg,
        "<line x1=\"{x1:.1}\" x2=\"{x2:.1}\" y1=\"{y1:.1}\" y2=\"{y2:.1}\" {style}/>"
    );
}

pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A diagram: the corners of its frame in pixels, and the values at its edges.
#[derive(Debug, Clone, Copy)]
pub struct Diagram {
    /// Left and right edge.
    pub columns: (f64, f64),
    /// Lower and upper edge.
    pub rows: (f64, f64),
    /// Horizontal values at the left and right edge.
    pub x: (f64, f64),
    /// Vertical values at the lower and upper edge.
    pub y: (f64, f64),
}

impl Diagram {
    /// Position of a value in pixels; beyond the lower or upper edge the edge.
    pub fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let scale = |value: f64, (low, high): (f64, f64), (from, to): (f64, f64)| {
            from + (to - from) * (value - low) / (high - low)
        };
        (scale(x, self.x, self.columns), scale(y.clamp(self.y.0, self.y.1), self.y, self.rows))
    }

    /// Adds frame and title, and a note in this colour on the right.
    pub fn frame(&self, svg: &mut String, title: &str, (note, colour): (&str, &str)) {
        let ((left, right), (bottom, top)) = (self.columns, self.rows);
        text(svg, (left, top - 10.0), "start", "font-weight=\"bold\"", title);
        text(svg, (right, top - 10.0), "end", &format!("fill=\"{colour}\""), note);
        let (width, height) = (right - left, bottom - top);
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" \
             stroke=\"#999\"/>"
        );
    }

    /// Adds labels of about `count` round values below the diagram.
    pub fn label_columns(&self, svg: &mut String, count: u32, label: impl Fn(f64) -> String) {
        for value in ticks(self.x.0, self.x.1, count) {
            let (x, bottom) = (self.at((value, self.y.0)).0, self.rows.0);
            line(svg, [(x, bottom), (x, bottom + 4.0)], "stroke=\"#888\"");
            text(svg, (x, bottom + 17.0), "middle", "fill=\"#555\"", &label(value));
        }
    }

    pub fn label_row(&self, svg: &mut String, value: f64, label: &str) {
        let (left, right) = self.columns;
        let y = self.at((self.x.0, value)).1;
        line(svg, [(left, y), (right, y)], "stroke=\"#e4e4e4\"");
        text(svg, (left - 6.0, y + 4.0), "end", "fill=\"#555\"", label);
    }

    pub fn curve(&self, svg: &mut String, values: impl Iterator<Item = (f64, f64)>, colour: &str) {
        let points: Vec<_> =
            values.map(|value| self.at(value)).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.3\"/>",
            points.join(" ")
        );
    }
}

/// Returns about `count` round values between two ends: multiples of 1, 2 or 5 times a power of ten.
pub fn ticks(low: f64, high: f64, count: u32) -> Vec<f64> {
    let span = (high - low).max(1e-9);
    let rough = span / f64::from(count.max(1));
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * power)
        .find(|step| *step >= rough)
        .unwrap_or(rough);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|nth| nth as f64 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within_the_range() {
        assert_eq!(ticks(0.0, 10.0, 5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(987.0, 1013.0, 5), [990.0, 1000.0, 1010.0]);
        assert_eq!(ticks(380.0, 1610.0, 6), [500.0, 1000.0, 1500.0]);
    }

    #[test]
    fn markup_in_a_text_is_escaped() {
        assert_eq!(escaped("a<b> & \"c\""), "a&lt;b&gt; &amp; &quot;c&quot;");
    }
}
