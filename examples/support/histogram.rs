//! Histograms of times, drawn as SVG.

use std::fmt::Write;

use crate::svg::{self, Anchor};

/// Number of bars; odd, so that symmetric distributions have a middle bar.
const BARS: usize = 61;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 40.0;

/// A range of times, in microseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Left end.
    pub low_us: f64,
    /// Right end.
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

/// One histogram.
#[derive(Debug, Clone, Copy)]
pub struct Panel<'a> {
    /// Title.
    pub title: &'a str,
    /// Subtitle, grey.
    pub subtitle: &'a str,
    /// Label of the horizontal axis.
    pub axis: &'a str,
    /// Times, ns.
    pub times_ns: &'a [u64],
    /// Range of the horizontal axis.
    pub range: Range,
    /// Mark on the horizontal axis: the nominal period, us.
    pub mark_us: f64,
    /// Minimum of the vertical axis, for panels that are compared.
    pub at_least: u64,
    /// Colour of the bars.
    pub colour: &'a str,
}

impl Panel<'_> {
    /// Draws the panel at a position of the picture. The vertical axis is logarithmic, so that single
    /// times are visible next to thousands.
    pub fn draw(&self, out: &mut String, (left, top): (f64, f64), (width, height): (f64, f64)) {
        let Range { low_us, high_us } = self.range;
        let (x0, x1) = (left + LEFT, left + width - RIGHT);
        let (y0, y1) = (top + height - BOTTOM, top + TOP);
        let x = |us: f64| x0 + (x1 - x0) * (us - low_us) / (high_us - low_us);
        let counts = self.counts();
        let most = counts.iter().copied().max().unwrap_or(0).max(self.at_least).max(1);
        // At most one decade above the largest bar; a single time has a visible bar.
        let decades = (most as f64 * 1.25).log10().max(1.0);
        let y = |count: f64| y0 - (y0 - y1) * ((count.log10() + 0.3) / (decades + 0.3)).max(0.0);
        svg::text(out, (x0, top + 20.0), Anchor::Start, "font-weight=\"bold\"", self.title);
        svg::text(out, (x1, top + 20.0), Anchor::End, "fill=\"#555\"", self.subtitle);
        for power in 0..=decades.floor() as i32 {
            let count = 10_f64.powi(power);
            let line = y(count);
            let _ = writeln!(
                out,
                "<line x1=\"{x0:.1}\" x2=\"{x1:.1}\" y1=\"{line:.1}\" y2=\"{line:.1}\" \
                 stroke=\"#e4e4e4\"/>"
            );
            let label = format!("{count}");
            svg::text(out, (x0 - 6.0, line + 4.0), Anchor::End, "fill=\"#555\"", &label);
        }
        let step = (high_us - low_us) / BARS as f64;
        for (nth, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let from = x(low_us + step * nth as f64);
            let to = x(low_us + step * (nth + 1) as f64);
            let height = y0 - y(*count as f64);
            let _ = writeln!(
                out,
                "<rect x=\"{from:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\" \
                 fill=\"{}\"/>",
                y0 - height,
                (to - from - 0.6).max(0.6),
                self.colour
            );
        }
        let _ = writeln!(
            out,
            "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{y1:.1}\" y2=\"{y0:.1}\" stroke=\"#333\" \
             stroke-dasharray=\"3 3\"/>\n\
             <path d=\"M{x0:.1} {y1:.1}V{y0:.1}H{x1:.1}\" fill=\"none\" stroke=\"#888\"/>",
            x(self.mark_us)
        );
        for tick in svg::ticks(low_us, high_us, 6) {
            let at = x(tick);
            let _ = writeln!(
                out,
                "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{y0:.1}\" y2=\"{:.1}\" stroke=\"#888\"/>",
                y0 + 4.0
            );
            // Enough digits to tell the ticks apart.
            let digits = if high_us - low_us < 3.0 { 1 } else { 0 };
            let label = format!("{tick:.digits$}");
            svg::text(out, (at, y0 + 17.0), Anchor::Middle, "fill=\"#555\"", &label);
        }
        svg::text(out, ((x0 + x1) / 2.0, y0 + 33.0), Anchor::Middle, "", self.axis);
    }

    /// The number of times in the largest bar.
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
