//! Requests of remote clients.

use ecan_protocol::can::CanId;
use ecan_service::client::{
    Access, BAD_RECORD, INVALID_PARAMS, INVALID_REQUEST, METHOD_NOT_FOUND, METHODS, Method as _,
    NOT_PERMITTED, NmtParams, PARSE_ERROR, RpcError, Subscription, TransmitRecord, TransmitRecords,
    methods,
};
use serde_json::Value;

use crate::transmit_limits::TransmitLimits;

/// Name of the request that sends frames, as a method.
pub(crate) const SEND: &str = "send";
/// Methods of the publisher itself, which read: its clients, and the next lease of a subscription.
pub(crate) const CLIENTS: &str = "clients";
pub(crate) const RENEW: &str = "frames.renew";
pub(crate) const SUBSCRIBE: &str = methods::SubscribeFrames::NAME;
#[cfg(feature = "engine")]
pub(crate) const UNSUBSCRIBE: &str = methods::UnsubscribeFrames::NAME;
/// Bytes of a request. The service ends the connection of a client whose request has more than 64 KiB,
/// of which some are those of JSON-RPC.
pub(crate) const MAX_REQUEST_BYTES: usize = 63 << 10;
/// Nested lists and objects in parameters. What the service cannot read ends the connection that all
/// remote clients share.
const MAX_NESTING: usize = 32;
/// Bytes of the name of a method, as in the service.
const MAX_METHOD_BYTES: usize = 128;
/// Bytes of the name of a remote client, or of a subscription.
const MAX_NAME_BYTES: usize = 64;

/// Methods that are published at each interval.
pub(crate) const PUBLISHED: [&str; 5] = [
    methods::ReadState::NAME,
    methods::ReadAxes::NAME,
    methods::ReadBusState::NAME,
    methods::ReadServiceStats::NAME,
    CLIENTS,
];

/// Returns whether a method may change something: every one that is not a method of version 1 that
/// reads, because the effect of an extension is not known.
pub(crate) fn is_acting(method: &str) -> bool {
    ![CLIENTS, RENEW].contains(&method) && !METHODS.contains(&(method, Access::Read))
}

/// Checks that remote clients may call a method.
pub(crate) fn check(method: &str, has_control: bool) -> Result<(), RpcError> {
    if ["frames.", "images."].iter().any(|family| method.starts_with(family)) {
        let text = format!(
            "{method} is not available through Zenoh; subscribe to PREFIX/frames/<gateway>/<channel>, \
             or send {SUBSCRIBE} to PREFIX/publisher/<publisher>/<client>"
        );
        return Err(RpcError::new(METHOD_NOT_FOUND, text));
    }
    if method.len() > MAX_METHOD_BYTES {
        let text = format!(
            "name of the method has {} bytes; allowed: at most {MAX_METHOD_BYTES}",
            method.len()
        );
        return Err(RpcError::new(METHOD_NOT_FOUND, text));
    }
    if has_control || !is_acting(method) {
        return Ok(());
    }
    let text = format!(
        "{method} is not permitted: remote clients only read; start ecan zenoh with --control"
    );
    Err(RpcError::new(NOT_PERMITTED, text))
}

/// Checks the size of a request.
pub(crate) fn check_size(bytes: usize) -> Result<(), RpcError> {
    if bytes <= MAX_REQUEST_BYTES {
        return Ok(());
    }
    let text = format!("request has {bytes} bytes; allowed: at most {MAX_REQUEST_BYTES}");
    Err(RpcError::new(INVALID_REQUEST, text))
}

/// Checks a name; `owner` is "client" or "subscription".
pub(crate) fn check_name(owner: &str, name: &str) -> Result<(), RpcError> {
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.@".contains(&byte);
    if !name.is_empty() && name.len() <= MAX_NAME_BYTES && name.bytes().all(is_allowed) {
        return Ok(());
    }
    let text = format!(
        "name of the {owner} has {} bytes; allowed: 1 to {MAX_NAME_BYTES} letters, digits and - _ . @",
        name.len()
    );
    Err(RpcError::new(INVALID_REQUEST, text))
}

/// Error of a request that acts and does not address one publisher.
pub(crate) fn not_addressed(method: &str) -> RpcError {
    let text = format!(
        "{method} acts and must address one publisher; get PREFIX/publisher/*, then send it to \
         PREFIX/publisher/<publisher>/<client>/{method}"
    );
    RpcError::new(INVALID_REQUEST, text)
}

/// Checks the CAN frame that a method with these parameters sends.
pub(crate) fn check_frames_of(
    method: &str,
    params: &Value,
    limits: &TransmitLimits,
) -> Result<(), RpcError> {
    // The service rejects wrong parameters.
    if method == methods::SendNmt::NAME
        && let Ok(NmtParams { gateway, channel, .. }) = serde_json::from_value(params.clone())
        && let Ok(id) = CanId::standard(0)
    {
        return limits.check(gateway, channel, id);
    }
    Ok(())
}

/// Parameters of a method in a payload; none in an empty one.
pub(crate) fn parameters(method: &str, payload: &[u8]) -> Result<Value, RpcError> {
    if payload.is_empty() {
        return Ok(Value::Null);
    }
    let params: Value = serde_json::from_slice(payload).map_err(|error| {
        RpcError::new(PARSE_ERROR, format!("parameters of {method} are not JSON: {error}"))
    })?;
    // The text that the service receives may be longer, for example that of 1e9.
    check_size(method.len() + params.to_string().len())?;
    if !is_nested_within(&params, MAX_NESTING) {
        let text = format!(
            "parameters of {method} are nested too deeply; allowed: {MAX_NESTING} lists or objects"
        );
        return Err(RpcError::new(INVALID_REQUEST, text));
    }
    Ok(params)
}

fn is_nested_within(value: &Value, levels: usize) -> bool {
    let below = |value: &Value| levels > 0 && is_nested_within(value, levels - 1);
    match value {
        Value::Array(values) => levels > 0 && values.iter().all(below),
        Value::Object(members) => levels > 0 && members.values().all(below),
        _ => true,
    }
}

/// Name and selection in the parameters of a subscription.
pub(crate) fn subscription_of(
    method: &str,
    mut params: Value,
) -> Result<(String, Subscription), RpcError> {
    let name = params.as_object_mut().and_then(|members| members.remove("subscription"));
    let name = name.as_ref().and_then(Value::as_str).unwrap_or_default().to_owned();
    check_name("subscription", &name)?;
    let selection = serde_json::from_value(params).map_err(|error| {
        RpcError::new(INVALID_PARAMS, format!("invalid parameters of {method}: {error}"))
    })?;
    Ok((name, selection))
}

/// Frames to send in a payload. If one of them is not permitted, none is sent.
pub(crate) fn frames_to_send(
    payload: &[u8],
    limits: &TransmitLimits,
) -> Result<Vec<TransmitRecord>, RpcError> {
    let records =
        TransmitRecords::new(payload).collect::<Result<Vec<_>, _>>().map_err(|error| {
            let text = format!("transmit batch rejected, none of it is sent: {error}");
            RpcError::new(BAD_RECORD, text)
        })?;
    for record in &records {
        limits.check(record.gateway, record.channel, record.frame.id())?;
    }
    Ok(records)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subscription_has_a_name_and_the_selection_of_the_service() {
        let params = serde_json::json!({ "subscription": "s-1", "channels": [2] });
        let (name, selection) = subscription_of(SUBSCRIBE, params).unwrap();
        assert_eq!((&name[..], selection.channels), ("s-1", vec![2]));
        for params in [Value::Null, serde_json::json!({ "subscription": 1 })] {
            assert_eq!(subscription_of(SUBSCRIBE, params).unwrap_err().code, INVALID_REQUEST);
        }
    }

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
        let limits = TransmitLimits::default();
        assert_eq!(frames_to_send(&[0; 15], &limits).unwrap_err().code, BAD_RECORD);
        assert_eq!(frames_to_send(&[], &limits).unwrap(), []);
    }

    #[test]
    fn requests_have_a_size_and_a_client() {
        assert_eq!(check_size(MAX_REQUEST_BYTES), Ok(()));
        let error = check_size(MAX_REQUEST_BYTES + 1).unwrap_err();
        assert!(error.message.contains("allowed: at most"), "{error}");
        let numbers = format!("[{}1]", "1e9,".repeat(10_000));
        assert!(numbers.len() < MAX_REQUEST_BYTES);
        assert_eq!(parameters("state", numbers.as_bytes()).unwrap_err().code, INVALID_REQUEST);
        let nested = |levels| format!("{}1{}", "[".repeat(levels), "]".repeat(levels));
        assert!(parameters("state", nested(MAX_NESTING).as_bytes()).is_ok());
        let error = parameters("state", nested(MAX_NESTING + 1).as_bytes()).unwrap_err();
        assert_eq!(error.code, INVALID_REQUEST);
        let long = "x".repeat(MAX_METHOD_BYTES + 1);
        assert_eq!(check(&long, true).unwrap_err().code, METHOD_NOT_FOUND);
        assert_eq!(check_name("client", "hmi-2_a.b@cell"), Ok(()));
        assert!(
            not_addressed("nmt").message.ends_with("PREFIX/publisher/<publisher>/<client>/nmt")
        );
        for name in ["", "a b", "\u{1b}[31m", "é", &"x".repeat(65)] {
            assert_eq!(check_name("client", name).unwrap_err().code, INVALID_REQUEST);
        }
    }

    #[test]
    fn nmt_is_a_frame_with_the_can_id_0() {
        let limits = TransmitLimits { rules: vec!["0.1:000".parse().unwrap()] };
        let code = |channel| {
            let params = serde_json::json!(
                { "gateway": 0, "channel": channel, "node": 1, "command": "stop" });
            check_frames_of("nmt", &params, &limits).map_err(|error| error.code)
        };
        assert_eq!((code(1), code(0)), (Ok(()), Err(NOT_PERMITTED)));
        assert_eq!(check_frames_of("state", &Value::Null, &limits), Ok(()));
    }
}
