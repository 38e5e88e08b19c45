//! Captures for Wireshark: CAN frames and process images of the gateway in one pcapng file.
//!
//! CAN frames are written in the link type that Wireshark knows (`LINKTYPE_CAN_SOCKETCAN`, 227).
//! Process images (manual 6) have the first link type for private use (`LINKTYPE_USER0`, 147) with
//! 16 bytes in front, see [`ImageOrigin`]; `wireshark/ecan_pdo.lua` shows their fields. Each channel
//! and each gateway is an interface of the capture, named `can0`, `can1` ... and `ecan0` ....
//!
//! [`Capture`] writes where it is called. [`Recorder`] has a thread that writes, for applications
//! that must not wait.

#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod capture;
mod error_frame;
mod image;
mod pcapng;
mod recorder;
mod socketcan;

pub use capture::{Capture, Traffic};
pub use error_frame::ErrorFrame;
pub use image::{IMAGE_HEADER_BYTES, ImageOrigin};
pub use recorder::{Recorder, Recording};
