//! State of a socketcand session.

use std::io::Write as _;

use super::command::{CommandError, SocketcandCommand, is_send, parse};
use crate::bridge::uplink::Uplink;

const MAX_COMMAND: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Mode {
    NoBus,
    Opened,
    Raw,
}

/// The daemon of one client. Any bus name opens the bus of the bridge.
#[derive(Debug)]
pub(crate) struct SocketcandSession {
    /// Text since the last `<`; `None` outside a command.
    command: Option<Vec<u8>>,
    mode: Mode,
}

impl SocketcandSession {
    pub(crate) fn new() -> Self {
        Self { command: None, mode: Mode::NoBus }
    }

    pub(crate) fn greet(&self, answer: &mut Vec<u8>) {
        answer.extend(b"< hi >");
    }

    /// Processes input. Text outside `<` and `>` is ignored.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        for &byte in bytes {
            match (byte, &mut self.command) {
                (b'<', command) => *command = Some(Vec::new()),
                (b'>', command) => {
                    if let Some(text) = command.take() {
                        self.command_ends(&text, bus, answer);
                    }
                }
                // One byte beyond the limit marks it as too long.
                (_, Some(text)) if text.len() <= MAX_COMMAND => text.push(byte),
                _ => {}
            }
        }
    }

    fn command_ends(&mut self, text: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        let wrong = if is_send(text) { CommandError::Frame } else { CommandError::Syntax };
        let text = if text.len() > MAX_COMMAND { None } else { str::from_utf8(text).ok() };
        let command = text.ok_or(wrong).and_then(parse);
        let Err(error) = command.and_then(|command| self.run(command, bus, answer)) else {
            return;
        };
        bus.count_rejected();
        // Clients expect a bus error, with class and time, as error of a frame.
        if error != CommandError::Frame {
            // infallible: writing to a vector
            let _ = write!(answer, "< error {error} >");
        }
    }

    fn run(
        &mut self,
        command: SocketcandCommand,
        bus: &mut impl Uplink,
        answer: &mut Vec<u8>,
    ) -> Result<(), CommandError> {
        match command {
            SocketcandCommand::Open if self.mode == Mode::NoBus => self.mode = Mode::Opened,
            SocketcandCommand::RawMode if self.mode == Mode::Opened => self.mode = Mode::Raw,
            SocketcandCommand::Echo => {
                answer.extend(b"< echo >");
                return Ok(());
            }
            // Sending has no answer. A full queue blocks the client; a bus that accepts no frames
            // counts them itself.
            SocketcandCommand::Send(frame) if self.mode != Mode::NoBus => {
                bus.send_when_possible(frame);
                return Ok(());
            }
            _ => return Err(CommandError::Mode),
        }
        answer.extend(b"< ok >");
        Ok(())
    }

    /// Returns whether the client has opened a bus.
    pub(crate) fn is_open(&self) -> bool {
        self.mode != Mode::NoBus
    }

    /// Returns whether the client receives frames of the bus.
    pub(crate) fn is_raw(&self) -> bool {
        self.mode == Mode::Raw
    }
}
