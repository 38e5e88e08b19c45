//! What the program prints: text for people, or JSON for programs.

use std::io::{IsTerminal, Write};

use serde::Serialize;

use crate::failure::Failure;
use crate::global::Color;

/// Where and how to print.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    json: bool,
    color: bool,
    is_beside: bool,
}

/// A colour that says something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// As it should be.
    Good,
    /// To be looked at.
    Warning,
    /// Wrong.
    Bad,
    /// Beside the point.
    Faint,
}

impl Output {
    pub fn new(json: bool, color: Color) -> Self {
        let is_wanted = match color {
            Color::Always => true,
            Color::Never => false,
            Color::Auto => {
                std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none()
            }
        };
        Self { json, color: is_wanted && !json, is_beside: false }
    }

    /// The same on standard error, where standard output is taken.
    pub fn beside(self, is_taken: bool) -> Self {
        Self { is_beside: is_taken, color: self.color && !is_taken, ..self }
    }

    /// Whether colours are wanted.
    pub fn has_color(&self) -> bool {
        self.color
    }

    /// Where data go.
    pub fn stream(&self) -> Box<dyn Write> {
        match self.is_beside {
            false => Box::new(std::io::stdout().lock()),
            true => Box::new(std::io::stderr().lock()),
        }
    }

    /// A text in a colour, where there are colours.
    pub fn toned(&self, tone: Tone, text: impl std::fmt::Display) -> String {
        let code = match tone {
            Tone::Good => 32,
            Tone::Warning => 33,
            Tone::Bad => 31,
            Tone::Faint => 2,
        };
        if self.color { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_string() }
    }

    /// Prints data: as JSON where it is wanted, else by `text`. That the reader has gone is no
    /// failure: the exit status still tells what was found.
    pub fn data<T: Serialize>(
        &self,
        data: &T,
        text: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), Failure> {
        let mut stream = self.stream();
        let printed = if self.json {
            let printed = serde_json::to_writer_pretty(&mut stream, data);
            printed.map_err(std::io::Error::from).and_then(|()| writeln!(stream))
        } else {
            text(&mut stream)
        };
        unless_reader_gone(printed.and_then(|()| stream.flush()))
    }

    /// As [`data`](Self::data), of one or of several: JSON is a list only where that was asked for.
    pub fn one_or_list<T: Serialize>(
        &self,
        is_list: bool,
        data: &[T],
        text: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), Failure> {
        match data {
            [only] if !is_list => self.data(only, text),
            list => self.data(&list, text),
        }
    }

    /// Prints bytes as they are.
    pub fn bytes(&self, bytes: &[u8]) -> Result<(), Failure> {
        let mut stream = self.stream();
        unless_reader_gone(stream.write_all(bytes).and_then(|()| stream.flush()))
    }

    /// A line beside the data, on standard error.
    pub fn note(&self, text: impl std::fmt::Display) {
        let _ = writeln!(std::io::stderr(), "{text}");
    }

    /// How far a long work is, on standard error; not where a program reads what is printed.
    pub fn progress(&self, text: impl std::fmt::Display) {
        if !self.json {
            self.note(text);
        }
    }

    /// Why the program fails, on standard error.
    pub fn failure(&self, failure: &Failure) {
        self.note(format_args!("ecan: {failure}"));
    }
}

fn unless_reader_gone(printed: std::io::Result<()>) -> Result<(), Failure> {
    match printed.map_err(Failure::from) {
        Err(Failure::ReaderGone) => Ok(()),
        other => other,
    }
}
