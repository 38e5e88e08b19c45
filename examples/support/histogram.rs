//! Histograms of times, drawn as SVG.

use std::fmt::Write;

use crate::svg::{self, Diagram};

/// Number of bars; odd, so that symmetric distributions have a middle bar.
const BARS: usize = 61;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    pub low_us: f64,
    pub high_us: f64,
}

impl Range {
    /// Range of these times and a mark with a margin; `None` without a time.
    pub fn around<'a>(times_ns: impl Iterator<Item = &'a u64>, mark_us: f64) -> Option<Self> {
        let (mut low, mut high, mut any) = (mark_us, mark_us, false);
        for ns in times_ns {
            let us = *ns as f64 / 1e3;
            (low, high, any) = (low.min(us), high.max(us), true);
        }
        // Keeps a bar of equal times narrow.
        let air = ((high - low) * 0.04).max(0.5);
        any.then_some(Self { low_us: low - air, high_us: high + air })
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Panel<'a> {
    pub title: &'a str,
    pub subtitle: &'a str,
    pub axis: &'a str,
    pub times_ns: &'a [u64],
    pub range: Range,
    /// Mark on the horizontal axis: the nominal period, us.
    pub mark_us: f64,
    pub at_least: u64,
    pub colour: &'a str,
}

impl Panel<'_> {
    /// Draws the panel at a position of the picture. The vertical axis is logarithmic, so that single
    /// times are visible next to thousands.
    pub fn draw(&self, svg: &mut String, (left, top): (f64, f64), (width, height): (f64, f64)) {
        let Range { low_us, high_us } = self.range;
        let counts = self.counts();
        let most = counts.iter().copied().max().unwrap_or(0).max(self.at_least).max(1);
        // At most one decade above the largest bar.
        let decades = (most as f64 * 1.25).log10().max(1.0);
        let diagram = Diagram {
            columns: (left + 56.0, left + width - 14.0),
            rows: (top + height - 40.0, top + 34.0),
            x: (low_us, high_us),
            // A single time has a visible bar.
            y: (-0.3, decades),
        };
        diagram.frame(svg, self.title, (self.subtitle, "#555"));
        for power in 0..=decades as u32 {
            diagram.label_row(svg, power.into(), &10_u64.pow(power).to_string());
        }
        let step = (high_us - low_us) / BARS as f64;
        for (nth, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let from_us = low_us + step * nth as f64;
            let (from, y) = diagram.at((from_us, (*count as f64).log10()));
            let (to, bottom) = diagram.at((from_us + step, -0.3));
            let (width, height) = ((to - from - 0.6).max(0.6), bottom - y);
            let _ = writeln!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" \
                 height=\"{height:.1}\" fill=\"{}\"/>",
                self.colour
            );
        }
        let [bottom, top] = [-0.3, decades].map(|value| diagram.at((self.mark_us, value)));
        svg::line(svg, [bottom, top], "stroke=\"#333\" stroke-dasharray=\"3 3\"");
        // Enough digits to distinguish the ticks.
        let digits = if high_us - low_us < 3.0 { 1 } else { 0 };
        diagram.label_columns(svg, 6, |tick| format!("{tick:.digits$}"));
        let middle = (diagram.columns.0 + diagram.columns.1) / 2.0;
        svg::text(svg, (middle, diagram.rows.0 + 33.0), "middle", "", self.axis);
    }

    pub fn largest_bar(&self) -> u64 {
        self.counts().into_iter().max().unwrap_or(0)
    }

    fn counts(&self) -> [u64; BARS] {
        let Range { low_us, high_us } = self.range;
        let mut counts = [0; BARS];
        for ns in self.times_ns {
            let share = (*ns as f64 / 1e3 - low_us) / (high_us - low_us);
            if (0.0..=1.0).contains(&share) {
                counts[((share * BARS as f64) as usize).min(BARS - 1)] += 1;
            }
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_in_the_range_is_in_a_bar() {
        let times: Vec<u64> = (0..1_000).map(|nth| 900_000 + nth * 200).collect();
        let range = Range::around(times.iter(), 1_000.0).unwrap();
        assert!(range.low_us < 900.0 && range.high_us > 1_099.8);
        let panel = Panel {
            title: "t",
            subtitle: "",
            at_least: 0,
            axis: "us",
            times_ns: &times,
            range,
            mark_us: 1_000.0,
            colour: "#123456",
        };
        assert_eq!(panel.counts().iter().sum::<u64>(), 1_000);
        let mut svg = String::new();
        panel.draw(&mut svg, (0.0, 0.0), (400.0, 200.0));
        assert!(svg.contains(">1000</text>") && !svg.contains("NaN"), "{svg}");
        assert_eq!(Range::around([].iter(), 1.0), None);
    }
}
