//! Requests of remote clients.

use ecan_service_client::{
    Access, BAD_RECORD, METHOD_NOT_FOUND, METHODS, Method as _, NOT_PERMITTED, PARSE_ERROR,
    RpcError, TransmitRecord, TransmitRecords, methods,
};
use serde_json::Value;

/// Name of the request that sends frames, as a method.
pub(crate) const SEND: &str = "send";

/// Methods that are published at each interval.
pub(crate) const PUBLISHED: [&str; 4] = [
    methods::ReadState::NAME,
    methods::ReadAxes::NAME,
    methods::ReadBusState::NAME,
    methods::ReadServiceStats::NAME,
];

/// Checks that remote clients may call a method. Without control only the methods of version 1 that
/// read: whether an extension changes something is not known.
pub(crate) fn check(method: &str, has_control: bool) -> Result<(), RpcError> {
    if ["frames.", "images."].iter().any(|it| method.starts_with(it)) {
        let text = format!(
            "{method} is not available through Zenoh; subscribe to PREFIX/frames/<gateway>/<channel>"
        );
        return Err(RpcError::new(METHOD_NOT_FOUND, text));
    }
    if has_control || METHODS.contains(&(method, Access::Read)) {
        return Ok(());
    }
    let text = format!(
        "{method} is not permitted: remote clients only read; start ecan zenoh with --control"
    );
    Err(RpcError::new(NOT_PERMITTED, text))
}

/// Parameters of a method in a payload; none in an empty one.
pub(crate) fn parameters(method: &str, payload: &[u8]) -> Result<Value, RpcError> {
    if payload.is_empty() {
        return Ok(Value::Null);
    }
    serde_json::from_slice(payload).map_err(|error| {
        RpcError::new(PARSE_ERROR, format!("parameters of {method} are not JSON: {error}"))
    })
}

/// Frames to send in a payload.
pub(crate) fn frames_to_send(payload: &[u8]) -> Result<Vec<TransmitRecord>, RpcError> {
    TransmitRecords::new(payload).collect::<Result<_, _>>().map_err(|error| {
        let text = format!("transmit batch rejected, none of it is sent: {error}");
        RpcError::new(BAD_RECORD, text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remote_clients_read_unless_control_is_permitted() {
        let code = |method, has_control| check(method, has_control).map_err(|error| error.code);
        for method in ["sdo.upload", "state", "config"].iter().chain(&PUBLISHED) {
            assert_eq!((code(method, false), code(method, true)), (Ok(()), Ok(())));
        }
        for method in ["sdo.download", "nmt", "sim.fault", SEND] {
            assert_eq!((code(method, false), code(method, true)), (Err(NOT_PERMITTED), Ok(())));
        }
        assert_eq!(code("frames.subscribe", true), Err(METHOD_NOT_FOUND));
        assert_eq!(code("images.unsubscribe", true), Err(METHOD_NOT_FOUND));
    }

    #[test]
    fn payloads_are_read_or_rejected() {
        assert_eq!(parameters("state", b"").unwrap(), Value::Null);
        assert_eq!(parameters("state", b"{\"a\":1}").unwrap()["a"], 1);
        assert_eq!(parameters("state", b"{").unwrap_err().code, PARSE_ERROR);
        assert_eq!(frames_to_send(&[0; 15]).unwrap_err().code, BAD_RECORD);
        assert_eq!(frames_to_send(&[]).unwrap(), []);
    }
}
