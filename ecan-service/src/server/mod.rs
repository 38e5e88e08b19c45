//! Service of a running ECAN-Lite bus for other programs, on a Unix socket (docs/SERVICE.md).
//!
//! [`ServePort::serve`] starts it in the process that runs the cycle. Clients read the state and the
//! CAN frames of the bus; clients with [`Control`] also send frames and download SDOs. The module
//! [`client`](crate::client) is the client.

mod bus;
mod bus_calls;
mod bus_view;
mod client;
mod config;
mod frame_feed;
mod job_queue;
mod listener;
mod metrics;
mod output_queue;
mod permission;
mod server_loop;
mod service;
mod session;
mod shared;
mod workers;

pub use config::{
    Control, Extension, MetricsAddress, MetricsAddressError, MetricsConfig, Permission,
    ServiceConfig, ServiceError, parse_params, result_value,
};
pub use metrics::MetricsServer;
pub use service::{ServePort, Service};
#[doc(hidden)]
pub use session::OfflineSession;
