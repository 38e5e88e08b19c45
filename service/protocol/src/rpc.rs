//! JSON-RPC 2.0 messages.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::bus_error::BusError;

/// Version of JSON-RPC in each message.
pub const JSON_RPC: &str = "2.0";

/// The bytes are not JSON.
pub const PARSE_ERROR: i32 = -32700;
/// The JSON is not a request.
pub const INVALID_REQUEST: i32 = -32600;
/// No such method.
pub const METHOD_NOT_FOUND: i32 = -32601;
/// The parameters are not those of the method.
pub const INVALID_PARAMS: i32 = -32602;
/// The service failed.
pub const INTERNAL_ERROR: i32 = -32603;
/// The client may only read.
pub const NOT_PERMITTED: i32 = -32001;
/// The versions of client and service differ; the service closes the connection.
pub const WRONG_VERSION: i32 = -32002;
/// Another request came before `hello`.
pub const HELLO_FIRST: i32 = -32003;
/// A call of the bus failed; `data` is a [`BusError`].
pub const BUS_ERROR: i32 = -32004;
/// The state for the method does not exist now, for example without a cycle.
pub const NOT_AVAILABLE: i32 = -32005;
/// Too many requests are pending, or too many clients are connected.
pub const BUSY: i32 = -32006;
/// A transmit batch is malformed; the service closes the connection.
pub const BAD_RECORD: i32 = -32007;

/// A request of a client.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Request {
    /// [`JSON_RPC`].
    pub jsonrpc: String,
    /// Number or string that the response repeats.
    pub id: Value,
    /// Name of the method.
    pub method: String,
    /// Parameters by name.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub params: Value,
}

impl Request {
    /// Creates a request.
    pub fn new(id: u64, method: &str, params: Value) -> Self {
        Self { jsonrpc: JSON_RPC.into(), id: id.into(), method: method.into(), params }
    }

    /// Reads the request of a client.
    ///
    /// # Errors
    /// The response to send: with [`PARSE_ERROR`] or [`INVALID_REQUEST`], and the id if there is one.
    pub fn parse(payload: &[u8]) -> Result<Self, Box<Response>> {
        let value: Value = serde_json::from_slice(payload).map_err(|error| {
            let text = format!("request is not JSON: {error}");
            Response::error(Value::Null, RpcError::new(PARSE_ERROR, text))
        })?;
        let id = value.get("id").filter(|id| id.is_u64() || id.is_i64() || id.is_string()).cloned();
        let invalid = |text: String| {
            let id = id.clone().unwrap_or_default();
            Box::new(Response::error(id, RpcError::new(INVALID_REQUEST, text)))
        };
        if id.is_none() {
            return Err(invalid(
                "request has no id that is an integer or a string; batches are not supported"
                    .into(),
            ));
        }
        match serde_json::from_value::<Self>(value) {
            Ok(request) if request.jsonrpc == JSON_RPC => Ok(request),
            Ok(request) => Err(invalid(format!(
                "jsonrpc version \"{}\" is not supported; allowed: \"2.0\"",
                request.jsonrpc
            ))),
            Err(error) => Err(invalid(format!("invalid request: {error}"))),
        }
    }
}

/// A response of the service, or a notification: one without an id.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Response {
    /// [`JSON_RPC`].
    pub jsonrpc: String,
    /// Id of the request; null if the request had none, absent in a notification.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    pub id: Option<Value>,
    /// Result of the method.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    pub result: Option<Value>,
    /// Error of the method.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<RpcError>,
    /// Name of a notification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// Parameters of a notification.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub params: Value,
}

/// Keeps a null apart from an absent member.
fn present<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<Value>, D::Error> {
    Value::deserialize(from).map(Some)
}

impl Response {
    fn empty() -> Self {
        Self {
            jsonrpc: JSON_RPC.into(),
            id: None,
            result: None,
            error: None,
            method: None,
            params: Value::Null,
        }
    }

    /// Creates the response to a request.
    pub fn result(id: Value, result: Value) -> Self {
        Self { id: Some(id), result: Some(result), ..Self::empty() }
    }

    /// Creates an error response.
    pub fn error(id: Value, error: RpcError) -> Self {
        Self { id: Some(id), error: Some(error), ..Self::empty() }
    }

    /// Creates a notification.
    pub fn notification(method: &str, params: Value) -> Self {
        Self { method: Some(method.into()), params, ..Self::empty() }
    }
}

/// Error of a request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("{message}")]
pub struct RpcError {
    /// Code: those of JSON-RPC 2.0, and -32001 to -32007.
    pub code: i32,
    /// Text for users.
    pub message: String,
    /// Details: a [`BusError`] with the code [`BUS_ERROR`].
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub data: Value,
}

impl RpcError {
    /// Creates an error without details.
    pub fn new(code: i32, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), data: Value::Null }
    }

    /// Creates the error of a failed bus call.
    pub fn bus(message: impl Into<String>, error: &BusError) -> Self {
        let data = serde_json::to_value(error).unwrap_or_default();
        Self { code: BUS_ERROR, message: message.into(), data }
    }

    /// The failed bus call, if this is its error.
    pub fn bus_error(&self) -> Option<BusError> {
        (self.code == BUS_ERROR).then(|| BusError::deserialize(&self.data).ok()).flatten()
    }
}
