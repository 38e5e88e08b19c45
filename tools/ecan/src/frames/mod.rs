//! A gateway in service for the commands that carry CAN frames.

pub mod channels;
pub mod options;
pub mod service;
pub mod status_watch;
