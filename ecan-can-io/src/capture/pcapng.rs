//! Blocks of the file format pcapng: section header, interface description, enhanced packet.

use std::io::{self, Write};

const SECTION_HEADER: u32 = 0x0A0D_0D0A;
const BYTE_ORDER_MAGIC: u32 = 0x1A2B_3C4D;
const INTERFACE_DESCRIPTION: u32 = 1;
const ENHANCED_PACKET: u32 = 6;

const OPTION_END: u16 = 0;
const SECTION_APPLICATION: u16 = 4;
const INTERFACE_NAME: u16 = 2;
const INTERFACE_TIME_RESOLUTION: u16 = 9;
const PACKET_FLAGS: u16 = 2;
/// Decimal digits of the seconds' fraction.
const NANOSECONDS: u8 = 9;
/// Block type and length before the content, and the length after it.
const FRAMING_BYTES: usize = 12;

/// Writer of little-endian blocks; each is built in one reused buffer.
#[derive(Debug)]
pub struct Blocks<W> {
    writer: W,
    block: Vec<u8>,
    interfaces: u32,
}

impl<W: Write> Blocks<W> {
    /// Starts a section with the name of the application.
    pub fn begin(writer: W, application: &str) -> io::Result<Self> {
        let mut blocks = Self { writer, block: Vec::with_capacity(4096), interfaces: 0 };
        blocks.u32(BYTE_ORDER_MAGIC);
        blocks.u16(1);
        blocks.u16(0);
        // Unknown section length.
        blocks.bytes(&u64::MAX.to_le_bytes());
        blocks.option(SECTION_APPLICATION, application.as_bytes());
        blocks.option(OPTION_END, &[]);
        blocks.put(SECTION_HEADER)?;
        Ok(blocks)
    }

    /// Describes an interface with time stamps in nanoseconds; returns its number.
    pub fn describe(&mut self, link_type: u16, name: &str) -> io::Result<u32> {
        self.u16(link_type);
        self.u16(0);
        // No limit of the packet length.
        self.u32(0);
        self.option(INTERFACE_NAME, name.as_bytes());
        self.option(INTERFACE_TIME_RESOLUTION, &[NANOSECONDS]);
        self.option(OPTION_END, &[]);
        self.put(INTERFACE_DESCRIPTION)?;
        let number = self.interfaces;
        self.interfaces += 1;
        Ok(number)
    }

    pub fn packet(
        &mut self,
        interface: u32,
        time_ns: u64,
        flags: u32,
        header: &[u8],
        content: &[u8],
    ) -> io::Result<()> {
        let length = length(header.len() + content.len())?;
        self.u32(interface);
        self.u32((time_ns >> 32) as u32);
        self.u32(time_ns as u32);
        self.u32(length);
        self.u32(length);
        self.bytes(header);
        self.bytes(content);
        self.pad();
        self.option(PACKET_FLAGS, &flags.to_le_bytes());
        self.option(OPTION_END, &[]);
        self.put(ENHANCED_PACKET)
    }

    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }

    pub fn finish(mut self) -> io::Result<W> {
        self.writer.flush()?;
        Ok(self.writer)
    }

    fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.block.extend_from_slice(bytes);
    }

    fn pad(&mut self) {
        self.block.resize(self.block.len().next_multiple_of(4), 0);
    }

    /// Appends an option; a value that is too long is truncated.
    fn option(&mut self, code: u16, value: &[u8]) {
        let length = u16::try_from(value.len()).unwrap_or(u16::MAX);
        self.u16(code);
        self.u16(length);
        self.bytes(value.get(..length.into()).unwrap_or(value));
        self.pad();
    }

    fn put(&mut self, block_type: u32) -> io::Result<()> {
        let length = length(self.block.len() + FRAMING_BYTES)?.to_le_bytes();
        let outcome = self
            .writer
            .write_all(&block_type.to_le_bytes())
            .and_then(|()| self.writer.write_all(&length))
            .and_then(|()| self.writer.write_all(&self.block))
            .and_then(|()| self.writer.write_all(&length));
        self.block.clear();
        outcome
    }
}

fn length(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_| io::Error::from(io::ErrorKind::FileTooLarge))
}
