//! From frames to signals.

use core::fmt;

use ecan_protocol::can::CanFrame;

use crate::dbc::message::Message;
use crate::dbc::number::Number;
use crate::dbc::signal::Signal;

/// Signals of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded<'a> {
    /// Message of the CAN ID.
    pub message: &'a Message,
    /// Signals of the frame in the order of the file, without those that the multiplexers exclude.
    pub signals: Vec<DecodedSignal<'a>>,
    /// Number of signals that the frame is too short for.
    pub missing: usize,
}

/// Signal of a frame. `Display` writes `name = value unit (text)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedSignal<'a> {
    /// The signal.
    pub signal: &'a Signal,
    /// Physical value.
    pub value: Number,
    /// Text of the value, if it has one.
    pub text: Option<&'a str>,
}

impl DecodedSignal<'_> {
    /// Value with unit and text.
    #[must_use]
    pub fn value_text(&self) -> String {
        let mut shown = self.value.to_string();
        if !self.signal.unit.is_empty() {
            shown = format!("{shown} {}", self.signal.unit);
        }
        match self.text {
            Some(text) => format!("{shown} ({text})"),
            None => shown,
        }
    }
}

impl fmt::Display for DecodedSignal<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}", self.signal.name, self.value_text())
    }
}

impl Message {
    /// Decodes a frame of this message. A remote frame has no signals.
    #[must_use]
    pub fn decode(&self, frame: &CanFrame) -> Decoded<'_> {
        let mut decoded = Decoded { message: self, signals: Vec::new(), missing: 0 };
        if frame.as_ref().is_remote() {
            return decoded;
        }
        let raw = |signal: &Signal| signal.layout.extract(frame.data());
        for (index, signal) in self.signals.iter().enumerate() {
            if !self.is_selected(index, &raw) {
                continue;
            }
            match raw(signal) {
                Some(raw) => decoded.signals.push(DecodedSignal {
                    signal,
                    value: signal.number(raw),
                    text: signal.text(raw),
                }),
                None => decoded.missing += 1,
            }
        }
        decoded
    }
}
