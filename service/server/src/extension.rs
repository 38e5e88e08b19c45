//! Methods of a program.

use std::fmt;

use ecan_service_protocol::{Access, RpcError};
use serde_json::Value;

/// Methods that a program adds to its service, for example `reload`.
pub trait Extension: fmt::Debug + Send + Sync {
    /// Calls a method; `None` if the extension does not have it. Called on a worker thread of the
    /// service, at most four calls at a time: it may block. An extension checks `access` itself, with
    /// [`Permission::need_control`] for a method that changes something.
    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>>;
}

/// Access of a client, with the reason without control.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Permission {
    /// The access.
    pub access: Access,
    /// Reason without control.
    pub reason: Option<String>,
}

impl Permission {
    /// Rejects a client without control.
    ///
    /// # Errors
    /// An error with the code [`NOT_PERMITTED`](ecan_service_protocol::NOT_PERMITTED), the method and
    /// the reason.
    pub fn need_control(&self, method: &str) -> Result<(), RpcError> {
        if self.access == Access::Control {
            return Ok(());
        }
        let reason = self.reason.as_deref().unwrap_or("the service is read-only");
        let text = format!("{method} is not permitted: {reason}");
        Err(RpcError::new(ecan_service_protocol::NOT_PERMITTED, text))
    }
}
