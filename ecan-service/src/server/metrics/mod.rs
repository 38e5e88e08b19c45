//! Metrics of a service for Prometheus (docs/SERVICE.md).

mod declared;
#[cfg(test)]
mod documentation;
mod endpoint;
mod render;

pub use endpoint::{MetricsAddress, MetricsAddressError, MetricsConfig};

pub(crate) use endpoint::MetricsServer;
pub(crate) use render::MetricsSample;
pub(crate) use render::ObjectValues;
pub(crate) use render::TimeHistogram;
pub(crate) use render::{CycleSample, SlaveSample};
