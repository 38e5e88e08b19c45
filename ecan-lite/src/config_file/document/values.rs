//! The values of a table's keys by their types.

use ecan_canopen::ConfigurationDate;
use toml::Spanned;
use toml::de::{DeInteger, DeValue};

use super::table::{Form, Table, kind};
use crate::config_file::fault::Located;

impl<'t> Table<'t, '_> {
    fn wrong(&self, key: &str, expected: &str, found: &DeValue<'_>) {
        self.fault(key, format!("`{key}` must be {expected}, not {}", kind(found)));
    }

    fn out_of_range(
        &self,
        key: &str,
        found: Option<impl std::fmt::Display>,
        min: impl std::fmt::Display,
        max: impl std::fmt::Display,
    ) {
        let found = match found {
            Some(found) => format!("= {found} is out of range"),
            None => "is too large".to_owned(),
        };
        self.fault(key, format!("`{key}` {found}; allowed: {min} to {max}"));
    }

    /// An integer from `min` to `max`; its absence is a fault.
    pub(crate) fn required(
        &mut self,
        key: &'static str,
        what: &str,
        range: (u32, u32),
    ) -> Option<u32> {
        if !self.has(key) {
            self.fault(key, format!("`{key}` is missing: {what}"));
        }
        self.unsigned(key, range)
    }

    /// All keys of a table of numbers, truth values and strings, with their locations and the texts
    /// of their values.
    pub(crate) fn scalars(&mut self) -> Vec<(String, usize, String)> {
        self.is_open = true;
        if let Some(recorder) = &self.document.recorder {
            recorder.open(self.own_path());
        }
        let mut scalars = Vec::new();
        for (key, value) in self.table {
            let name: &str = key.get_ref();
            let at = value.span().start;
            let text = match value.get_ref() {
                DeValue::String(text) => text.to_string(),
                DeValue::Integer(number) => match integer(number) {
                    Some(number) => number.to_string(),
                    None => {
                        self.document.fault(&self.path(name), at, format!("`{name}` is too large"));
                        continue;
                    }
                },
                DeValue::Float(number) => number.as_str().replace('_', ""),
                DeValue::Boolean(flag) => u8::from(*flag).to_string(),
                other => {
                    let expected = "a number, true, false or a string";
                    let reason = format!("`{name}` must be {expected}, not {}", kind(other));
                    self.document.fault(&self.path(name), at, reason);
                    continue;
                }
            };
            scalars.push((name.to_owned(), at, text));
        }
        scalars
    }

    /// A date, with or without a time of day.
    pub(crate) fn datetime(&mut self, key: &'static str) -> Option<toml::value::Datetime> {
        self.record(key, || Form::Date);
        let value = self.value(key)?.get_ref();
        if let DeValue::Datetime(datetime) = value {
            return Some(*datetime);
        }
        self.wrong(key, "a date and time, 2026-01-31T12:00:00", value);
        None
    }

    /// A date and time from 1984-01-01 on.
    pub(crate) fn configuration_date(&mut self, key: &'static str) -> Option<ConfigurationDate> {
        let date = self.datetime(key)?;
        let days = date
            .date
            .map(|date| days_from_civil(date.year.into(), date.month.into(), date.day.into()));
        let days = days.and_then(|days| u32::try_from(days - EPOCH_DAYS).ok());
        let Some(days) = days else {
            self.fault(key, format!("`{key}` must be a date and time from 1984-01-01 on"));
            return None;
        };
        let milliseconds = date.time.map_or(0, |time| {
            let seconds = u32::from(time.second.unwrap_or(0))
                + 60 * (u32::from(time.minute) + 60 * u32::from(time.hour));
            seconds * 1_000 + time.nanosecond.unwrap_or(0) / 1_000_000
        });
        Some(ConfigurationDate { days, milliseconds })
    }

    /// A list of strings with their locations.
    pub(crate) fn texts(&mut self, key: &'static str) -> Option<Vec<Located<String>>> {
        self.record(key, || Form::Texts);
        let value = self.value(key)?.get_ref();
        let DeValue::Array(array) = value else {
            self.wrong(key, "an array of strings", value);
            return None;
        };
        let mut texts = Vec::new();
        for value in array.iter() {
            match value.get_ref().as_str() {
                Some(text) => texts.push(Located::new(text.to_owned(), value.span().start)),
                None => {
                    self.wrong(key, "an array of strings", value.get_ref());
                    return None;
                }
            }
        }
        Some(texts)
    }

    /// A string.
    pub(crate) fn text(&mut self, key: &'static str) -> Option<&'t str> {
        self.record(key, || Form::Text);
        let value = self.value(key)?.get_ref();
        if value.as_str().is_none() {
            self.wrong(key, "a string", value);
        }
        value.as_str()
    }

    /// A list of two integers from `min` to `max`.
    pub(crate) fn pair(&mut self, key: &'static str, (min, max): (u32, u32)) -> Option<(u32, u32)> {
        self.record(key, || Form::Integers { min, max, count: Some(2) });
        let value = self.value(key)?.get_ref();
        match integers(value, (min, max)).as_deref() {
            Some([first, last]) => Some((*first, *last)),
            _ => {
                self.fault(
                    key,
                    format!("`{key}` must be two integers from {min} to {max}: [a, b]"),
                );
                None
            }
        }
    }

    /// A list of integers from `min` to `max`.
    pub(crate) fn unsigned_list(
        &mut self,
        key: &'static str,
        (min, max): (u32, u32),
    ) -> Option<Vec<u32>> {
        self.record(key, || Form::Integers { min, max, count: None });
        let value = self.value(key)?.get_ref();
        let numbers = integers(value, (min, max));
        if numbers.is_none() {
            self.fault(key, format!("`{key}` must be an array of integers from {min} to {max}"));
        }
        numbers
    }

    /// An integer from `min` to `max`, which fits `T`.
    pub(crate) fn unsigned<T: TryFrom<u32>>(
        &mut self,
        key: &'static str,
        (min, max): (u32, u32),
    ) -> Option<T> {
        self.record(key, || Form::Integer { min: min.into(), max: max.into() });
        let value = self.value(key)?;
        match value.get_ref() {
            DeValue::Integer(number) => {
                let number = integer(number);
                let in_range = number
                    .and_then(|number| u32::try_from(number).ok())
                    .filter(|number| (min..=max).contains(number));
                if in_range.is_none() {
                    self.out_of_range(key, number, min, max);
                }
                in_range.and_then(|number| T::try_from(number).ok())
            }
            other => {
                self.wrong(key, "an integer", other);
                None
            }
        }
    }

    /// A signed integer.
    pub(crate) fn signed(&mut self, key: &'static str) -> Option<i32> {
        self.record(key, || Form::Integer { min: i32::MIN.into(), max: i32::MAX.into() });
        let value = self.value(key)?;
        match value.get_ref() {
            DeValue::Integer(number) => {
                let number = integer(number);
                let in_range = number.and_then(|number| i32::try_from(number).ok());
                if in_range.is_none() {
                    self.out_of_range(key, number, i32::MIN, i32::MAX);
                }
                in_range
            }
            other => {
                self.wrong(key, "an integer", other);
                None
            }
        }
    }

    /// An integer or float. Its range is checked by the configuration.
    pub(crate) fn float(&mut self, key: &'static str) -> Option<f64> {
        self.record(key, || Form::AnyNumber);
        let value = self.value(key)?;
        let number = self.number(key, value.get_ref())?;
        if number.is_none() {
            self.fault(key, format!("`{key}` is too large"));
        }
        number
    }

    /// A number; `Some(None)` if it does not fit its type, `None` if it is none.
    fn number(&self, key: &'static str, value: &DeValue<'_>) -> Option<Option<f64>> {
        match value {
            DeValue::Integer(number) => Some(integer(number).map(|number| number as f64)),
            DeValue::Float(number) => Some(number.as_str().replace('_', "").parse().ok()),
            other => {
                self.wrong(key, "a number", other);
                None
            }
        }
    }

    /// An integer or float times `scale`, rounded.
    fn scaled(&self, key: &'static str, value: &DeValue<'_>, scale: f64, max: f64) -> Option<u32> {
        let number = self.number(key, value)?;
        let in_range = number.filter(|number| (0.0..=max).contains(number));
        if in_range.is_none() {
            self.out_of_range(key, number, 0, max);
        }
        in_range.map(|number| (number * scale).round() as u32)
    }

    /// A time in microseconds, as nanoseconds.
    pub(crate) fn microseconds(&mut self, key: &'static str) -> Option<u32> {
        const MAX_US: f64 = 4_000_000.0;
        self.record(key, || Form::Number { min: 0.0, max: MAX_US });
        let value = self.value(key)?;
        self.scaled(key, value.get_ref(), 1_000.0, MAX_US)
    }

    /// One percentage or a list of two, in 0.1 %.
    pub(crate) fn permille_window(&mut self, key: &'static str) -> Option<[u32; 2]> {
        self.record(key, || Form::Percentages);
        let value = self.value(key)?;
        let one = |value: &DeValue<'_>| self.scaled(key, value, 10.0, 100.0);
        match value.get_ref() {
            DeValue::Array(array) => match array.iter().collect::<Vec<_>>()[..] {
                [min, max] => Some([one(min.get_ref())?, one(max.get_ref())?]),
                _ => {
                    let reason = format!("`{key}` must be one percentage, or [min, max]");
                    self.fault(key, reason);
                    None
                }
            },
            value => one(value).map(|point| [point; 2]),
        }
    }

    /// True or false.
    pub(crate) fn flag(&mut self, key: &'static str) -> Option<bool> {
        self.record(key, || Form::Flag);
        let value = self.value(key)?.get_ref();
        if let DeValue::Boolean(flag) = value {
            return Some(*flag);
        }
        self.wrong(key, "true or false", value);
        None
    }

    /// One of these words.
    pub(crate) fn word<T: Copy>(
        &mut self,
        key: &'static str,
        words: &[(impl AsRef<str>, T)],
    ) -> Option<T> {
        self.record(key, || Form::Word(texts(words)));
        let value = self.value(key)?;
        self.one_word(key, value, words)
    }

    fn one_word<T: Copy>(
        &self,
        key: &'static str,
        value: &Spanned<DeValue<'_>>,
        words: &[(impl AsRef<str>, T)],
    ) -> Option<T> {
        let text = value.get_ref().as_str();
        let found = text.and_then(|text| words.iter().find(|(word, _)| word.as_ref() == text));
        if found.is_none() {
            let allowed: Vec<_> =
                words.iter().map(|(word, _)| format!("\"{}\"", word.as_ref())).collect();
            let what = match text {
                Some(text) => format!("\"{text}\""),
                None => kind(value.get_ref()).to_owned(),
            };
            let reason = format!("`{key}` = {what} is invalid; allowed: {}", allowed.join(", "));
            self.document.fault(&self.path(key), value.span().start, reason);
        }
        found.map(|(_, meaning)| *meaning)
    }

    /// A list of these words.
    pub(crate) fn words<T: Copy>(
        &mut self,
        key: &'static str,
        words: &[(impl AsRef<str>, T)],
    ) -> Option<Vec<T>> {
        self.record(key, || Form::Words(texts(words)));
        let value = self.value(key)?.get_ref();
        let DeValue::Array(array) = value else {
            self.wrong(key, "an array of words", value);
            return None;
        };
        // All words are read, so that each wrong one is reported.
        let meanings: Vec<_> = array.iter().map(|value| self.one_word(key, value, words)).collect();
        meanings.into_iter().collect()
    }
}

fn texts<T>(words: &[(impl AsRef<str>, T)]) -> Vec<String> {
    words.iter().map(|(word, _)| word.as_ref().to_owned()).collect()
}

/// Replaces a default by a value of the file.
pub(crate) fn store<T>(target: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *target = value;
    }
}

/// `None` if it does not fit into 64 bits.
fn integer(number: &DeInteger<'_>) -> Option<i64> {
    let digits = number.as_str().replace('_', "");
    i64::from_str_radix(digits.trim_start_matches('+'), number.radix()).ok()
}

/// The integers of an array; `None` for another value, or with an integer out of range.
fn integers(value: &DeValue<'_>, (min, max): (u32, u32)) -> Option<Vec<u32>> {
    let numbers = value.as_array()?.iter().map(|item| integer(item.get_ref().as_integer()?));
    numbers
        .map(|number| u32::try_from(number?).ok().filter(|number| (min..=max).contains(number)))
        .collect()
}

/// Days from 1984-01-01, the epoch of 0x1020, to 1970-01-01 are negative.
const EPOCH_DAYS: i64 = 5_113;

/// Days from 1970-01-01 of a date of the Gregorian calendar.
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    // Years begin with March, so that the leap day is the last one.
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + day_of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_count_from_1984() {
        let days = |year, month, day| days_from_civil(year, month, day) - EPOCH_DAYS;
        assert_eq!(days_from_civil(1970, 1, 1), 0);
        assert_eq!(days(1984, 1, 1), 0);
        assert_eq!(days(1984, 3, 1), 60);
        assert_eq!(days(1985, 1, 1), 366);
        // 40 years with ten leap days, and 2024 is one.
        assert_eq!(days(2024, 1, 1), 40 * 365 + 10);
        assert_eq!(days(2026, 11, 24), 40 * 365 + 10 + 366 + 365 + 327);
    }
}
