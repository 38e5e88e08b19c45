//! The ECAN-Lite manual as types: PDO stream codec, object dictionary, bit timing.
//!
//! `no_std`, without allocation and without I/O. Host and simulated gateway both use it, so that every
//! byte is defined once.
//!
//! # Process data
//!
//! An [`ImageWriter`](image::ImageWriter) packs frames into a PDO image of one
//! [`Direction`](mapping::Direction) with a [`PdoProfile`](image::PdoProfile); an
//! [`ImageReader`](image::ImageReader) checks an image as manual 6.1 requires and returns borrowed
//! views of its packets.
//!
//! ```
//! use ecan_protocol::can::{CanId, FrameRef};
//! use ecan_protocol::image::{
//!     CommitFields, ImageReader, ImageWriter, Packet, PdoProfile, Timestamp,
//! };
//! use ecan_protocol::mapping::Direction;
//!
//! let profile = PdoProfile::default();
//! let mut image = [0; 1024];
//! let mut writer = ImageWriter::new(Direction::RxPdo, profile);
//! let frame = FrameRef::classic(CanId::standard(0x123)?, &[0x11, 0x22])?;
//! writer.push(&mut image, 0, 0, frame, Timestamp::None)?;
//! let sequence = writer.commit(&mut image, CommitFields::default());
//!
//! let reader = ImageReader::new(Direction::RxPdo, profile);
//! let received = reader.read(&image)?;
//! assert_eq!(received.sequence(), sequence);
//! for packet in received.packets() {
//!     if let Packet::Frame(packet) = packet? {
//!         assert_eq!(packet.frame, frame);
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[cfg(target_endian = "big")]
compile_error!(
    "the ECAN-Lite SDK supports little-endian processors only: EtherCAT and the gateway's images are \
     little-endian, and no test runs on a big-endian processor; build for x86_64 or aarch64"
);

mod copy;
mod text_enum;

pub mod can;
pub mod config;
pub mod device;
pub mod image;
pub mod mapping;
pub mod object;
pub mod sequence;
pub mod text;
