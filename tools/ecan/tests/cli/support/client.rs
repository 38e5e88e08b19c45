//! TCP client of a bridge.

use std::io::Write as _;
use std::net::TcpStream;

use super::timed_reader::TimedReader;

pub struct Client {
    stream: TcpStream,
    heard: TimedReader,
}

impl Client {
    pub fn connect(address: &str) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        let heard = TimedReader::new(stream.try_clone().unwrap());
        Self { stream, heard }
    }

    pub fn say(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).unwrap();
    }

    pub fn expect(&mut self, text: &str) {
        let bytes = self.heard.bytes(text.len());
        assert_eq!(String::from_utf8_lossy(&bytes), text);
    }

    /// Reads up to and including the first of these bytes.
    pub fn hear_through(&mut self, last: &[u8]) -> String {
        String::from_utf8(self.heard.through_one_of(last)).unwrap()
    }
}
