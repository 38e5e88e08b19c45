//! Client of the service of a running ECAN-Lite bus (docs/SERVICE.md), on its Unix socket.
//!
//! A [`Client`] makes requests, receives frames and images of its subscriptions, and sends frames.

mod client;
mod inbox;

pub use client::{Client, Tag};
pub use client::{ClientError, SendError};
pub use inbox::{Event, Lost, ReceivedImage};

pub use crate::protocol::*;
