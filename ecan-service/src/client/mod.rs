//! Client of the service of a running ECAN-Lite bus (docs/SERVICE.md), on its Unix socket.
//!
//! A [`Client`] makes requests, receives frames and images of its subscriptions, and sends frames.

mod connection;
mod inbox;

pub use connection::{Client, Tag};
pub use inbox::{ClientError, Event, Lost, ReceivedImage, SendError};

pub use crate::protocol::*;
