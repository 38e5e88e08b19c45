//! Metrics of a service for Prometheus (docs/SERVICE.md).

mod cycle_sample;
mod declared;
mod device_objects;
#[cfg(test)]
mod documentation;
mod http_connection;
mod metric;
mod metrics_config;
mod metrics_sample;
mod metrics_server;
mod render;
mod time_histogram;

pub(crate) use cycle_sample::{CycleSample, SlaveSample};
pub use metrics_config::{MetricsAddress, MetricsAddressError, MetricsConfig};
pub(crate) use metrics_sample::{MetricsSample, ObjectValues};
pub(crate) use metrics_server::MetricsServer;
pub(crate) use time_histogram::TimeHistogram;
