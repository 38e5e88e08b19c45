//! Methods of a program.

use std::fmt;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::protocol::{Access, INTERNAL_ERROR, INVALID_PARAMS, RpcError};

/// Methods that a program adds to its service, for example `reload`.
pub trait Extension: fmt::Debug + Send + Sync {
    /// Access that a method needs: `Control` if it changes something; `None` if the extension does not
    /// have it. Called on the thread of the service, which rejects clients without this access: it does not
    /// block.
    fn access(&self, method: &str) -> Option<Access>;

    /// Calls a method; `None` if the extension does not have it. Called on a worker thread of the
    /// service, at most two calls at a time and one of each client: it may block. `access` is that of the
    /// client.
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
    /// An error with the code [`NOT_PERMITTED`](crate::protocol::NOT_PERMITTED), the method and
    /// the reason.
    pub fn need_control(&self, method: &str) -> Result<(), RpcError> {
        if self.access == Access::Control {
            return Ok(());
        }
        let reason = self.reason.as_deref().unwrap_or("the service is read-only");
        let text = format!("{method} is not permitted: {reason}");
        Err(RpcError::new(crate::protocol::NOT_PERMITTED, text))
    }
}

/// Parses the parameters of a method. Absent ones are those of a method without any.
///
/// # Errors
/// An error with the code [`INVALID_PARAMS`], the method and the cause.
pub fn parse_params<P: DeserializeOwned>(method: &str, params: &Value) -> Result<P, RpcError> {
    let params = match params {
        Value::Null => Value::Object(serde_json::Map::new()),
        params => params.clone(),
    };
    serde_json::from_value(params).map_err(|error| {
        RpcError::new(INVALID_PARAMS, format!("invalid parameters of {method}: {error}"))
    })
}

/// Converts the result of a method to JSON.
///
/// # Errors
/// An error with the code [`INTERNAL_ERROR`]: the result has no form in JSON.
pub fn result_value(result: &impl Serialize) -> Result<Value, RpcError> {
    serde_json::to_value(result).map_err(|error| RpcError::new(INTERNAL_ERROR, error.to_string()))
}
