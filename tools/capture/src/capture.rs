//! A capture: CAN frames, error frames and process images, each on its interface.

use std::io::{self, Write};

use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;

use crate::error_frame::ErrorFrame;
use crate::image::{self, ImageOrigin};
use crate::pcapng::Blocks;
use crate::socketcan;

/// Which way a CAN frame went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Traffic {
    /// From the bus.
    Received,
    /// To the bus.
    Sent,
}

impl Traffic {
    /// The bits of a packet's flags.
    const fn flags(self) -> u32 {
        match self {
            Self::Received => 1,
            Self::Sent => 2,
        }
    }
}

/// What an interface of the capture stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interface {
    Can(usize),
    Images(u16),
}

/// Writes a capture.
///
/// An interface is described when its first packet comes; otherwise nothing is allocated. Times are
/// nanoseconds since 1970. Not for the cycle: writing waits for the file, see
/// [`Recorder`](crate::Recorder).
#[derive(Debug)]
pub struct Capture<W> {
    blocks: Blocks<W>,
    interfaces: Vec<(Interface, u32)>,
}

impl<W: Write> Capture<W> {
    /// Begins a capture. The writer should have a buffer; the application's name stands in the file.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn new(writer: W, application: &str) -> io::Result<Self> {
        let blocks = Blocks::begin(writer, application)?;
        Ok(Self { blocks, interfaces: Vec::with_capacity(16) })
    }

    /// A CAN frame; `port` counts the channels of all gateways, `can0` being the first.
    ///
    /// # Errors
    /// Those of the writer.
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

    /// An error frame of a channel.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn error(&mut self, time_ns: u64, port: usize, error: &ErrorFrame) -> io::Result<()> {
        let interface = self.interface(Interface::Can(port))?;
        let header = socketcan::error_header(error);
        let flags = Traffic::Received.flags();
        self.blocks.packet(interface, time_ns, flags, &header, error.data())
    }

    /// A process image as it is, 128 * N bytes.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn image(&mut self, time_ns: u64, origin: &ImageOrigin, image: &[u8]) -> io::Result<()> {
        let interface = self.interface(Interface::Images(origin.slave))?;
        let traffic = match origin.direction {
            Direction::RxPdo => Traffic::Sent,
            Direction::TxPdo => Traffic::Received,
        };
        self.blocks.packet(interface, time_ns, traffic.flags(), &origin.header(), image)
    }

    /// Writes out what the writer's buffer holds.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn flush(&mut self) -> io::Result<()> {
        self.blocks.flush()
    }

    /// Ends the capture and gives the writer back.
    ///
    /// # Errors
    /// Those of the writer.
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
