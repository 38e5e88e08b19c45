//! Services and their clients.

mod attacks;
pub(crate) mod common;
mod frames;
mod metrics;
mod python_client;
mod requests;
