//! Tests of the protocol.
#![allow(missing_docs)]

mod common;

mod bit_timing;
mod configuration;
mod crc;
mod device_answers;
mod dictionary;
mod dictionary_manual;
mod filters;
mod golden;
mod image_checks;
mod maintenance;
mod mcan_channel;
mod round_trip;
mod sample_points;
mod writer;
