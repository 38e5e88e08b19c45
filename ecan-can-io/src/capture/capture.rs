//! A capture with CAN frames, error frames and PDO images, each on its interface.

use std::io::{self, Write};

use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;

use crate::capture::error_frame::ErrorFrame;
use crate::capture::image::{self, ImageOrigin};
use crate::capture::pcapng::Blocks;
use crate::capture::socketcan;

/// Direction of a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Traffic {
    /// Received from the bus.
    Received,
    /// Sent to the bus.
    Sent,
}

impl Traffic {
    /// Bits of the packet flags.
    const fn flags(self) -> u32 {
        match self {
            Self::Received => 1,
            Self::Sent => 2,
        }
    }
}

/// Interface of the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interface {
    Can(usize),
    Images(u16),
}

/// Writer of a capture.
///
/// Writes the description of an interface before its first packet and allocates only then. Times are
/// nanoseconds since 1970. Each function returns the I/O errors of the writer. Do not use it in the
/// cycle, because it waits for the file; see [`Recorder`](crate::capture::Recorder).
#[derive(Debug)]
pub struct Capture<W> {
    blocks: Blocks<W>,
    interfaces: Vec<(Interface, u32)>,
}

impl<W: Write> Capture<W> {
    /// Starts a capture. The writer should be buffered; `application` is stored in the file.
    pub fn new(writer: W, application: &str) -> io::Result<Self> {
        let blocks = Blocks::begin(writer, application)?;
        Ok(Self { blocks, interfaces: Vec::with_capacity(16) })
    }

    /// Writes a CAN frame; `port` counts the channels of all gateways from `can0`.
    pub fn frame(
        &mut self,
        time_ns: u64,
        port: usize,
        traffic: Traffic,
        frame: &CanFrame,
    ) -> io::Result<()> {
        let interface = self.interface(Interface::Can(port))?;
        let header = socketcan::frame_header(frame);
        self.blocks.packet(interface, time_ns, traffic.flags(), &header, frame.data())
    }

    /// Writes an error frame of a channel.
    pub fn error(&mut self, time_ns: u64, port: usize, error: &ErrorFrame) -> io::Result<()> {
        let interface = self.interface(Interface::Can(port))?;
        let header = socketcan::error_header(error);
        let flags = Traffic::Received.flags();
        self.blocks.packet(interface, time_ns, flags, &header, error.data())
    }

    /// Writes a PDO image, 128 * N bytes.
    pub fn image(&mut self, time_ns: u64, origin: &ImageOrigin, image: &[u8]) -> io::Result<()> {
        let interface = self.interface(Interface::Images(origin.slave))?;
        let traffic = match origin.direction {
            Direction::RxPdo => Traffic::Sent,
            Direction::TxPdo => Traffic::Received,
        };
        self.blocks.packet(interface, time_ns, traffic.flags(), &origin.header(), image)
    }

    /// Flushes the writer.
    pub fn flush(&mut self) -> io::Result<()> {
        self.blocks.flush()
    }

    /// Ends the capture and returns the writer.
    pub fn finish(self) -> io::Result<W> {
        self.blocks.finish()
    }

    fn interface(&mut self, wanted: Interface) -> io::Result<u32> {
        if let Some((_, number)) = self.interfaces.iter().find(|(it, _)| *it == wanted) {
            return Ok(*number);
        }
        let number = match wanted {
            Interface::Can(port) => {
                self.blocks.describe(socketcan::LINK_TYPE, &format!("can{port}"))
            }
            Interface::Images(slave) => {
                self.blocks.describe(image::LINK_TYPE, &format!("ecan{slave}"))
            }
        }?;
        self.interfaces.push((wanted, number));
        Ok(number)
    }
}
