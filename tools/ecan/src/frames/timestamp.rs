use clap::ValueEnum;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Style {
    /// Seconds since 1970, or since the start of a stepped simulation
    #[value(name = "a")]
    Absolute,
    /// Time since the previous frame
    #[value(name = "d")]
    Delta,
    /// Time since the first frame
    #[value(name = "z")]
    Zero,
    /// Date and time of day
    #[value(name = "A")]
    Date,
}

#[derive(Debug)]
pub struct Timestamps {
    style: Style,
    has_nanoseconds: bool,
    /// Time of the first or the previous frame.
    reference_ns: Option<u64>,
}

impl Timestamps {
    pub fn new(style: Style, has_nanoseconds: bool) -> Self {
        Self { style, has_nanoseconds, reference_ns: None }
    }

    /// Formats the time of the next frame, in parentheses.
    pub fn text(&mut self, time_ns: u64) -> String {
        match self.style {
            Style::Absolute => self.bracket(&format!("{:010}", seconds(time_ns)), time_ns),
            Style::Date => self.bracket(&date(time_ns), time_ns),
            Style::Delta | Style::Zero => {
                let reference_ns = *self.reference_ns.get_or_insert(time_ns);
                if self.style == Style::Delta {
                    self.reference_ns = Some(time_ns);
                }
                let since_ns = time_ns.saturating_sub(reference_ns);
                self.bracket(&format!("{:03}", seconds(since_ns)), since_ns)
            }
        }
    }

    fn bracket(&self, whole: &str, time_ns: u64) -> String {
        let fraction = time_ns % 1_000_000_000;
        if self.has_nanoseconds {
            format!("({whole}.{fraction:09})")
        } else {
            format!("({whole}.{:06})", fraction / 1000)
        }
    }
}

fn seconds(time_ns: u64) -> u64 {
    time_ns / 1_000_000_000
}

fn date(time_ns: u64) -> String {
    let since_1970 = i64::try_from(seconds(time_ns)).ok();
    let time = since_1970.and_then(|seconds| jiff::Timestamp::from_second(seconds).ok());
    time.unwrap_or_default()
        .to_zoned(jiff::tz::TimeZone::system())
        .strftime("%Y-%m-%d %H:%M:%S")
        .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stamps_match_candump() {
        let first = 1_398_128_223_803_317_555;
        let frames = [first, first + 20_000_500, first + 1_020_000_000];
        let texts = |style, has_nanoseconds| {
            let mut timestamps = Timestamps::new(style, has_nanoseconds);
            frames.map(|time| timestamps.text(time))
        };
        assert_eq!(
            texts(Style::Absolute, false),
            ["(1398128223.803317)", "(1398128223.823318)", "(1398128224.823317)"]
        );
        assert_eq!(texts(Style::Delta, false), ["(000.000000)", "(000.020000)", "(000.999999)"]);
        assert_eq!(
            texts(Style::Zero, true),
            ["(000.000000000)", "(000.020000500)", "(001.020000000)"]
        );
        assert_eq!(Timestamps::new(Style::Absolute, false).text(1_500), "(0000000000.000001)");
    }
}
