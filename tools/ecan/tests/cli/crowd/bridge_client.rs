//! A client of a bridge, which sends numbered frames and checks every frame that it receives.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::sequence::{APPLICATION, CLIENT, Sequence};
use crate::support::Running;
use crate::support::timed_reader::LIMIT;

/// Frames whose echo the client awaits.
const WINDOW: u64 = 4;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    Slcan,
    Socketcand,
}

impl Protocol {
    pub fn option(self) -> &'static str {
        match self {
            Self::Slcan => "--slcan",
            Self::Socketcand => "--socketcand",
        }
    }

    fn last_byte(self) -> u8 {
        match self {
            Self::Slcan => b'\r',
            Self::Socketcand => b'>',
        }
    }

    fn frame(self, number: u64) -> String {
        match self {
            Self::Slcan => format!("t{CLIENT:03X}8{number:016X}\r"),
            Self::Socketcand => {
                let bytes = number.to_be_bytes().map(|byte| format!("{byte:02X}")).join(" ");
                format!("< send {CLIENT:X} 8 {bytes} >")
            }
        }
    }

    /// CAN ID and number of a message with a frame.
    fn parse(self, message: &str) -> Option<(u16, u64)> {
        let (id, data) = match self {
            Self::Slcan => (message.get(1..4)?, message.strip_prefix('t')?.get(4..20)?),
            Self::Socketcand => {
                let mut words = message.strip_prefix("< frame ")?.split(' ');
                (words.next()?, words.nth(1)?)
            }
        };
        Some((u16::from_str_radix(id, 16).ok()?, u64::from_str_radix(data, 16).ok()?))
    }
}

/// Shared with the thread of the client.
#[derive(Debug, Default)]
pub struct Progress {
    /// Frames of the application that the client has seen twice.
    pub application: AtomicU64,
    /// Own frames.
    pub sent: AtomicU64,
    /// The client shall send no more; it has every echo.
    pub is_stopped: AtomicBool,
    pub is_quiet: AtomicBool,
}

#[derive(Debug)]
pub struct BridgeClient {
    protocol: Protocol,
    stream: TcpStream,
    reader: BufReader<TcpStream>,
}

impl BridgeClient {
    /// Connects to the only address of a bridge.
    pub fn connect(protocol: Protocol, bridge: &mut Running) -> Self {
        let line = bridge.line();
        let words: Vec<_> = line.split(' ').collect();
        let (address, bus) = (words[3], words[5]);
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        let reader = BufReader::new(stream.try_clone().unwrap());
        let mut client = Self { protocol, stream, reader };
        match protocol {
            Protocol::Slcan => client.command("O\r", "\r"),
            Protocol::Socketcand => {
                client.command("", "< hi >");
                client.command(&format!("< open {bus} >"), "< ok >");
                client.command("< rawmode >", "< ok >");
            }
        }
        client
    }

    fn command(&mut self, command: &str, answer: &str) {
        self.say(command);
        assert_eq!(self.message().as_deref(), Some(answer));
    }

    fn say(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).unwrap();
    }

    /// The next message; `None` at the end of the connection.
    fn message(&mut self) -> Option<String> {
        let mut bytes = Vec::new();
        self.reader.read_until(self.protocol.last_byte(), &mut bytes).unwrap();
        (!bytes.is_empty()).then(|| String::from_utf8(bytes).unwrap())
    }

    /// Sends and receives until the bridge ends. The application has sent `before` frames.
    pub fn run(mut self, progress: &Progress, before: u64) {
        let (mut application, mut own, mut sent) = (Sequence::before(before), 0, 0);
        loop {
            let is_stopped = progress.is_stopped.load(Ordering::Acquire);
            while !is_stopped && sent - own < WINDOW {
                self.say(&self.protocol.frame(sent));
                sent += 1;
                progress.sent.store(sent, Ordering::Release);
            }
            progress.is_quiet.store(is_stopped && sent == own, Ordering::Release);
            let Some(message) = self.message() else { return };
            match self.protocol.parse(&message) {
                Some((APPLICATION, number)) => {
                    assert!(application.take(number), "{number} after {application:?}");
                    progress.application.store(application.twice, Ordering::Release);
                }
                Some((CLIENT, number)) => {
                    assert_eq!(number, own, "echo of an own frame");
                    own += 1;
                }
                Some(_) => {}
                // The confirmation of a sent frame.
                None => assert_eq!((self.protocol, message.as_str()), (Protocol::Slcan, "z\r")),
            }
        }
    }
}
