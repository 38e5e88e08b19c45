//! Metrics of a service for Prometheus (docs/SERVICE.md).

mod declared;
mod device_objects;
#[cfg(test)]
mod documentation;
mod metrics_config;
mod metrics_server;
mod render;
mod sample;

pub use metrics_config::{MetricsAddress, MetricsAddressError, MetricsConfig};
pub(crate) use metrics_server::MetricsServer;
pub(crate) use sample::{CycleSample, MetricsSample, ObjectValues, SlaveSample, TimeHistogram};
