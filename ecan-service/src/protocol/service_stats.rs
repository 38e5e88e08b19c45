//! Method `service.stats`.

use serde::{Deserialize, Serialize};

use crate::protocol::hello::Access;

/// Result of `service.stats`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ServiceStats {
    /// Clients that were accepted since the start.
    pub clients_accepted: u64,
    /// Clients that were rejected: too many in all or of one user, or no file descriptor.
    pub clients_rejected: u64,
    /// Clients that were disconnected because no `hello` came in time.
    #[serde(default)]
    pub clients_silent: u64,
    /// Requests that wait for a worker or are executed by one.
    #[serde(default)]
    pub requests_pending: u64,
    /// Requests that were rejected because a limit was reached.
    #[serde(default)]
    pub requests_rejected: u64,
    /// Requests that were not executed because their client left.
    #[serde(default)]
    pub requests_cancelled: u64,
    /// Requests that waited longer than their age limit and were not executed.
    #[serde(default)]
    pub requests_expired: u64,
    /// Frame events of the bus that the service read.
    pub frames: u64,
    /// Frames of images that found the ring of the cycle full: lost for every subscribed client.
    pub frames_lost_in_ring: u64,
    /// Images that found the ring of the cycle full.
    pub images_lost_in_ring: u64,
    /// The connected clients.
    pub clients: Vec<ClientStats>,
}

/// Counters of a client. For each subscribed client, every selected frame is either in
/// `frames_delivered` or in `frames_lost`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClientStats {
    /// Number of the client, from 1.
    pub id: u64,
    /// Name in `hello`.
    pub name: String,
    /// Process of the client.
    pub pid: u32,
    /// User of the client.
    pub uid: u32,
    /// Access.
    pub access: Access,
    /// Time since the connection, in milliseconds.
    pub connected_ms: u64,
    /// Requests.
    pub requests: u64,
    /// Requests that were rejected because a limit was reached.
    #[serde(default)]
    pub requests_rejected: u64,
    /// Requests that waited longer than their age limit and were not executed.
    #[serde(default)]
    pub requests_expired: u64,
    /// Frames put into the output queue of the client.
    pub frames_delivered: u64,
    /// Frames that the client lost.
    pub frames_lost: u64,
    /// Images put into the output queue.
    pub images_delivered: u64,
    /// Images that the client lost.
    pub images_lost: u64,
    /// Frames of the client that the service accepted.
    pub frames_accepted: u64,
    /// Frames of the client that the service rejected.
    pub frames_rejected: u64,
    /// Frames of the client without result.
    pub frames_pending: u64,
    /// Bytes in the output queue.
    pub queued_bytes: u64,
}
