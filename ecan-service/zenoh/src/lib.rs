//! Publishes the service of a running ECAN-Lite bus to other hosts through Zenoh (docs/SERVICE.md,
//! "Other hosts").
//!
//! Key expressions ([`Keys`]), the head of a publication ([`BatchHead`]), the account of a subscriber
//! ([`FrameAccount`]) and the deadline of a request ([`PublisherClock`]) need no engine. With the feature `engine`, `Publication` is a client
//! of the service that publishes it, and `RemoteService` one on another host that uses it as a service.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![forbid(unsafe_code)]

#[cfg(feature = "engine")]
mod client_counts;
#[cfg(any(feature = "engine", test))]
mod client_turns;
mod frame_account;
#[cfg(any(feature = "engine", test))]
mod frame_batches;
mod keys;
#[cfg(any(feature = "engine", test))]
mod remote_request;
#[cfg(any(feature = "engine", test))]
mod transmit_jobs;
#[cfg(any(feature = "engine", test))]
mod transmit_limits;

#[cfg(feature = "engine")]
mod connection_output;
#[cfg(feature = "engine")]
mod presence;
#[cfg(feature = "engine")]
mod publication;
#[cfg(feature = "engine")]
mod publisher;
#[cfg(feature = "engine")]
mod query_gate;
#[cfg(feature = "engine")]
mod remote_clients;
#[cfg(feature = "engine")]
mod remote_connection;
#[cfg(feature = "engine")]
mod remote_service;

#[cfg(feature = "engine")]
pub use client_counts::RejectedRequests;
pub use frame_account::{BATCH_HEAD_BYTES, BatchHead, FrameAccount, HeadError, SubscriptionInfo};
pub use keys::{Keys, MAX_LIFETIME, PrefixError, PublisherClock, PublisherInfo, RequestKey};
#[cfg(feature = "engine")]
pub use publication::PublicationError;
#[cfg(feature = "engine")]
pub use publication::{Publication, PublicationConfig, PublicationEvent};
#[cfg(feature = "engine")]
pub use remote_service::RemoteService;
#[cfg(feature = "engine")]
pub use transmit_limits::{TransmitLimits, TransmitRule, TransmitRuleError};
