//! What socketcand remembers of a client, and how it answers.

use std::io::Write as _;

use super::command::{Refusal, SocketcandCommand, is_send, parse};
use crate::session::Uplink;

/// More between `<` and `>` is no command.
const MAX_COMMAND: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Mode {
    NoBus,
    Opened,
    Raw,
}

/// The daemon that one client sees. Whatever bus it opens is the bridge's.
#[derive(Debug)]
pub(crate) struct SocketcandSession {
    /// What has come since the last `<`; none outside of a command.
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

    /// Takes in what the client wrote. What stands outside of `<` and `>` does not matter.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        for &byte in bytes {
            match (byte, &mut self.command) {
                (b'<', command) => *command = Some(Vec::new()),
                (b'>', command) => {
                    if let Some(text) = command.take() {
                        self.command_ends(&text, bus, answer);
                    }
                }
                // One byte too many is enough to tell.
                (_, Some(text)) if text.len() <= MAX_COMMAND => text.push(byte),
                _ => {}
            }
        }
    }

    fn command_ends(&mut self, text: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        let wrong = if is_send(text) { Refusal::Frame } else { Refusal::Syntax };
        let text = if text.len() > MAX_COMMAND { None } else { str::from_utf8(text).ok() };
        let command = text.ok_or(wrong).and_then(parse);
        let Err(refusal) = command.and_then(|command| self.run(command, bus, answer)) else {
            return;
        };
        bus.count_refused();
        // Clients take an error for one of the bus, with a class and a time.
        if refusal != Refusal::Frame {
            // infallible: writing to a vector
            let _ = write!(answer, "< error {refusal} >");
        }
    }

    fn run(
        &mut self,
        command: SocketcandCommand,
        bus: &mut impl Uplink,
        answer: &mut Vec<u8>,
    ) -> Result<(), Refusal> {
        match command {
            SocketcandCommand::Open if self.mode == Mode::NoBus => self.mode = Mode::Opened,
            SocketcandCommand::RawMode if self.mode == Mode::Opened => self.mode = Mode::Raw,
            SocketcandCommand::Echo => {
                answer.extend(b"< echo >");
                return Ok(());
            }
            // Sending is not answered. A full queue holds the client back; one that takes nothing
            // counts that itself.
            SocketcandCommand::Send(frame) if self.mode != Mode::NoBus => {
                bus.send_when_possible(frame);
                return Ok(());
            }
            _ => return Err(Refusal::Mode),
        }
        answer.extend(b"< ok >");
        Ok(())
    }

    /// Whether frames of the bus go to the client.
    pub(crate) fn is_raw(&self) -> bool {
        self.mode == Mode::Raw
    }
}
