//! A running gateway, for the frame commands.

pub mod arrival;
pub mod bit_rates;
pub mod capture;
pub mod channels;
pub mod format;
pub mod options;
pub mod prepared;
pub mod printer;
pub mod recording;
pub mod sender;
pub mod service;
pub mod settings;
pub mod single_gateway;
pub mod status_watch;
pub mod summary;
pub mod timestamp;
pub mod transmit_tracker;
