//! Tests of the CAN bus.

mod errors;
mod fixture;
mod frame_timing;
mod naive;
mod physical_layer;
mod transmission;
