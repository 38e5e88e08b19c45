//! Metrics of a service for Prometheus (docs/SERVICE.md).

mod declared;
mod device_objects;
#[cfg(test)]
mod documentation_tests;
mod metrics_server;
mod render;
mod sample;

pub use metrics_server::MetricsServer;
pub(crate) use render::source;
pub(crate) use sample::{CycleSample, MetricsSample, ObjectValues, SlaveSample, TimeHistogram};
