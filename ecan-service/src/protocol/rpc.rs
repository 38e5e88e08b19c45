//! JSON-RPC 2.0 messages.

use std::fmt;

use ecan_protocol::text::PrintableLines;
use serde::de::{DeserializeOwned, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

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
/// A limit of requests is reached, or one of clients; `data` of a request has the `limit`.
pub const BUSY: i32 = -32006;
/// A transmit batch is malformed; the service closes the connection.
pub const BAD_RECORD: i32 = -32007;
/// The request waited longer than its [`Request::max_age_ms`] and was not executed.
pub const EXPIRED: i32 = -32008;

/// Age limit in milliseconds of a request that may act, and of a frame to send, without an own one.
pub const DEFAULT_MAX_AGE_MS: u32 = 10_000;
/// Largest age limit of a request, in milliseconds.
pub const MAX_AGE_MS: u32 = 3_600_000;

/// A request of a client, to write it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Request {
    /// [`JSON_RPC`].
    pub jsonrpc: String,
    /// Number or string that the response repeats.
    pub id: Value,
    /// Name of the method.
    pub method: String,
    /// Parameters by name.
    #[serde(skip_serializing_if = "Value::is_null")]
    pub params: Value,
    /// Age limit, counted from the arrival at the service, 1 to [`MAX_AGE_MS`]: a request that waits
    /// longer is rejected with [`EXPIRED`]. `None` is [`DEFAULT_MAX_AGE_MS`] for a method that may act and
    /// no limit for one that only reads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_age_ms: Option<u32>,
}

impl Request {
    /// Creates a request without an age limit of its own.
    pub fn new(id: u64, method: &str, params: Value) -> Self {
        let (jsonrpc, method) = (JSON_RPC.into(), method.into());
        Self { jsonrpc, id: id.into(), method, params, max_age_ms: None }
    }

    /// Reads the request of a client, with its parameters.
    ///
    /// # Errors
    /// As [`RawRequest::parse`].
    pub fn parse(payload: &[u8]) -> Result<Self, Box<Response>> {
        let raw = RawRequest::parse(payload)?;
        let params = raw.params_value();
        let RawRequest { id, method, max_age_ms, .. } = raw;
        Ok(Self { jsonrpc: JSON_RPC.into(), id, method, params, max_age_ms })
    }
}

/// A request of a client whose parameters are not parsed yet: it takes no more memory than its bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct RawRequest {
    /// Number or string that the response repeats.
    pub id: Value,
    /// Name of the method.
    pub method: String,
    /// As [`Request::max_age_ms`].
    pub max_age_ms: Option<u32>,
    payload: Vec<u8>,
}

impl RawRequest {
    /// Reads the request of a client. A string in it, apart from the parameters, has at most 128 bytes.
    ///
    /// # Errors
    /// The response to send: with [`PARSE_ERROR`] or [`INVALID_REQUEST`], and the id if there is one.
    pub fn parse(payload: &[u8]) -> Result<Self, Box<Response>> {
        let fail = |id: Value, code, text: String| {
            Box::new(Response::error(id, RpcError::new(code, text)))
        };
        let head: Head = serde_json::from_slice(payload).map_err(|error| {
            let code = if error.is_data() { INVALID_REQUEST } else { PARSE_ERROR };
            fail(Value::Null, code, format!("request is not a JSON-RPC request: {error}"))
        })?;
        let is_object = payload.trim_ascii_start().first() == Some(&b'{');
        let id = match head.id {
            Scalar(id @ (Value::Number(_) | Value::String(_))) if is_object => id,
            _ => {
                let text = "request has no id that is an integer or a string of at most 128 bytes; batches \
                            are not supported";
                return Err(fail(Value::Null, INVALID_REQUEST, text.into()));
            }
        };
        let invalid = |text: String| Err(fail(id.clone(), INVALID_REQUEST, text));
        if head.jsonrpc.0 != JSON_RPC {
            return invalid("jsonrpc version is not supported; allowed: \"2.0\"".into());
        }
        let Scalar(Value::String(method)) = head.method else {
            return invalid("request has no method that is a string of at most 128 bytes".into());
        };
        let max_age_ms = match head.max_age_ms {
            None => None,
            Some(Scalar(age)) => {
                let in_range = |age: &u32| (1..=MAX_AGE_MS).contains(age);
                match age.as_u64().and_then(|age| age.try_into().ok()).filter(in_range) {
                    Some(age) => Some(age),
                    None => {
                        return invalid(format!(
                            "max_age_ms {age} is out of range; allowed: 1 to {MAX_AGE_MS}"
                        ));
                    }
                }
            }
        };
        Ok(Self { id, method, max_age_ms, payload: payload.into() })
    }

    /// Bytes of the request.
    pub fn bytes(&self) -> usize {
        self.payload.len()
    }

    /// The parameters as JSON; null for absent ones.
    pub fn params_value(&self) -> Value {
        let body = serde_json::from_slice::<Body<Value>>(&self.payload);
        body.ok().and_then(|body| body.params).unwrap_or_default()
    }

    /// Parses the parameters. Absent ones are those of a method without any.
    ///
    /// # Errors
    /// An error with the code [`INVALID_PARAMS`], the method and the cause.
    pub fn params<P: DeserializeOwned>(&self) -> Result<P, RpcError> {
        let body = serde_json::from_slice::<Body<P>>(&self.payload);
        let params = body.and_then(|body| match body.params {
            Some(params) => Ok(params),
            None => P::deserialize(Value::Object(serde_json::Map::new())),
        });
        params.map_err(|error| {
            let text = format!("invalid parameters of {}: {error}", self.method);
            RpcError::new(INVALID_PARAMS, text)
        })
    }
}

/// Members of a request besides its parameters.
#[derive(Deserialize)]
#[serde(default)]
struct Head {
    jsonrpc: Scalar,
    id: Scalar,
    method: Scalar,
    max_age_ms: Option<Scalar>,
}

impl Default for Head {
    fn default() -> Self {
        let none = || Scalar(Value::Null);
        Self { jsonrpc: none(), id: none(), method: none(), max_age_ms: None }
    }
}

/// Parameters of a request.
#[derive(Deserialize)]
struct Body<P> {
    #[serde(default = "Option::default")]
    params: Option<P>,
}

/// An integer or a short string; null for every other value, which takes no memory.
struct Scalar(Value);

/// Longest string of a [`Scalar`], in bytes.
const MAX_SCALAR_BYTES: usize = 128;

impl<'de> Deserialize<'de> for Scalar {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(ScalarVisitor)
    }
}

struct ScalarVisitor;

impl<'de> Visitor<'de> for ScalarVisitor {
    type Value = Scalar;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an integer or a string")
    }

    fn visit_u64<E>(self, number: u64) -> Result<Scalar, E> {
        Ok(Scalar(number.into()))
    }

    fn visit_i64<E>(self, number: i64) -> Result<Scalar, E> {
        Ok(Scalar(number.into()))
    }

    fn visit_str<E>(self, text: &str) -> Result<Scalar, E> {
        Ok(Scalar(if text.len() <= MAX_SCALAR_BYTES { text.into() } else { Value::Null }))
    }

    fn visit_bool<E>(self, _: bool) -> Result<Scalar, E> {
        Ok(Scalar(Value::Null))
    }

    fn visit_f64<E>(self, _: f64) -> Result<Scalar, E> {
        Ok(Scalar(Value::Null))
    }

    fn visit_unit<E>(self) -> Result<Scalar, E> {
        Ok(Scalar(Value::Null))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Scalar, A::Error> {
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Scalar(Value::Null))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Scalar, A::Error> {
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(Scalar(Value::Null))
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
#[error("{}", PrintableLines(with_indented_lines(message)))]
pub struct RpcError {
    /// Code: those of JSON-RPC 2.0, and -32001 to -32008.
    pub code: i32,
    /// Text for users.
    pub message: String,
    /// Details: a [`BusError`] with the code [`BUS_ERROR`].
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub data: Value,
}

/// Indents the lines after the first, so that a message of the other program has no line that looks
/// like one of this program.
fn with_indented_lines(message: &str) -> String {
    let mut lines = message.lines();
    let mut text = lines.next().unwrap_or_default().to_owned();
    for line in lines {
        text.push_str("\n  ");
        text.push_str(line.strip_prefix("  ").unwrap_or(line));
    }
    text
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

/// Direction of an SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SdoDirection {
    /// From the slave.
    Upload,
    /// To the slave.
    Download,
}

/// Fields of a failed bus call: `data` of an error with the code
/// [`BUS_ERROR`](super::BUS_ERROR). A slave is its position on the bus, except in `SlaveIndex`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum BusError {
    /// An SDO transfer failed.
    Sdo {
        /// Position of the slave.
        slave: u32,
        /// Direction.
        direction: SdoDirection,
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Error number of the system.
        errno: i32,
        /// Abort code of the slave, if it answered.
        abort_code: Option<u32>,
        /// Number of attempts.
        attempts: u32,
    },
    /// No slave at the address.
    NoSuchSlave {
        /// Index of the slave.
        slave: u32,
        /// Configured alias.
        alias: u16,
        /// Configured position.
        position: u16,
        /// Number of slaves that the master found.
        responding: u32,
        /// The master is still scanning the bus.
        is_scanning: bool,
    },
    /// An index out of range.
    SlaveIndex {
        /// The index.
        slave: u32,
        /// Number of slaves.
        count: u32,
    },
    /// A call of the master library failed.
    Library {
        /// Name of the library function.
        call: String,
        /// Position of the slave, if the call concerns one.
        slave: Option<u32>,
        /// Error number of the system.
        errno: i32,
    },
    /// Another error; the message describes it.
    Other,
}
