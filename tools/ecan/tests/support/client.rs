//! A client of a bridge over TCP.
#![allow(dead_code)]

use std::io::Write as _;
use std::net::TcpStream;

use super::deadline::Deadlined;

pub struct Client {
    stream: TcpStream,
    heard: Deadlined,
}

impl Client {
    pub fn connect(address: &str) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        let heard = Deadlined::new(stream.try_clone().unwrap());
        Self { stream, heard }
    }

    pub fn say(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).unwrap();
    }

    pub fn expect(&mut self, text: &str) {
        let bytes = self.heard.bytes(text.len());
        assert_eq!(String::from_utf8_lossy(&bytes), text);
    }

    /// What comes up to this character, and with it.
    pub fn hear_through(&mut self, last: char) -> String {
        let bytes = self.heard.through(u8::try_from(last).unwrap());
        String::from_utf8(bytes).unwrap()
    }
}
