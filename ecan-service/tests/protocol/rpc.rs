//! JSON-RPC messages: texts of docs/SERVICE.md, and arbitrary bytes.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::protocol::*;
use proptest::prelude::*;
use serde_json::{Value, json};

#[test]
fn request_is_read_and_rejected_with_its_id() {
    let request = Request::parse(br#"{"jsonrpc":"2.0","id":7,"method":"state"}"#).unwrap();
    assert_eq!((request.method.as_str(), request.params), ("state", Value::Null));
    let code = |text: &str| {
        let response = Request::parse(text.as_bytes()).unwrap_err();
        (response.error.unwrap().code, response.id.unwrap())
    };
    assert_eq!(code("{"), (PARSE_ERROR, Value::Null));
    assert_eq!(code("[]"), (INVALID_REQUEST, Value::Null));
    assert_eq!(code(r#"{"jsonrpc":"2.0","method":"state"}"#), (INVALID_REQUEST, Value::Null));
    assert_eq!(code(r#"{"jsonrpc":"2.0","id":"a"}"#), (INVALID_REQUEST, json!("a")));
    assert_eq!(code(r#"{"jsonrpc":"1.0","id":5,"method":"x"}"#), (INVALID_REQUEST, json!(5)));
    let aged = |age: u32| format!(r#"{{"jsonrpc":"2.0","id":5,"method":"x","max_age_ms":{age}}}"#);
    for age in [0, MAX_AGE_MS + 1] {
        assert_eq!(code(&aged(age)), (INVALID_REQUEST, json!(5)));
    }
    assert_eq!(Request::parse(aged(7).as_bytes()).unwrap().max_age_ms, Some(7));
}

#[test]
fn responses_have_the_documented_text() {
    let text = |response: &Response| serde_json::to_string(response).unwrap();
    let result = Response::result(json!(1), json!({}));
    assert_eq!(text(&result), r#"{"jsonrpc":"2.0","id":1,"result":{}}"#);
    let error = Response::error(Value::Null, RpcError::new(PARSE_ERROR, "no"));
    let expected = r#"{"jsonrpc":"2.0","id":null,"error":{"code":-32700,"message":"no"}}"#;
    assert_eq!(text(&error), expected);
    let notification = Response::notification("closed", Value::Null);
    assert_eq!(text(&notification), r#"{"jsonrpc":"2.0","method":"closed"}"#);
    for response in [result, error, notification, Response::result(json!("x"), Value::Null)] {
        assert_eq!(serde_json::from_str::<Response>(&text(&response)).unwrap(), response);
    }
}

#[test]
fn message_of_other_program_is_printed_without_controls() {
    let error = RpcError::new(BUS_ERROR, "cannot read \u{1b}[2Jx\r\nerror: \u{202e}y");
    assert_eq!(error.to_string(), "cannot read \\x1b[2Jx\n  error: \\u{202e}y");
}

#[test]
fn bus_error_survives_the_response() {
    let bus = BusError::Sdo {
        slave: 1,
        direction: SdoDirection::Download,
        index: 0x8010,
        subindex: 1,
        errno: 5,
        abort_code: Some(0x0609_0030),
        attempts: 2,
    };
    let error = RpcError::bus("SDO download failed", &bus);
    let text = serde_json::to_string(&error).unwrap();
    assert!(text.contains(r#""kind":"sdo""#) && text.contains(r#""abort_code":101253168"#));
    let error: RpcError = serde_json::from_str(&text).unwrap();
    assert_eq!(error.bus_error(), Some(bus));
    assert_eq!(RpcError::new(BUSY, "").bus_error(), None);
}

#[test]
fn sdo_data_are_hexadecimal() {
    let params = json!({"slave": 0, "index": 0x8010, "subindex": 1, "data": "0aFF"});
    let params: DownloadParams = serde_json::from_value(params).unwrap();
    assert_eq!(
        (params.data.as_slice(), params.once, params.complete),
        (&[10, 255][..], false, false)
    );
    let wrong = json!({"slave": 0, "index": 1, "subidx": 1, "data": "0"});
    assert!(serde_json::from_value::<DownloadParams>(wrong).is_err());
}

#[test]
fn subscription_selects_by_all_of_its_lists() {
    let frame = |id, extended| CanFrame::classic(CanId::new(id, extended).unwrap(), &[]).unwrap();
    let (plain, received) = (frame(0x123, false), FrameEvent::Received);
    let all = Subscription::default();
    assert!(all.selects(9, 3, received, &plain));
    assert!(!all.selects(0, 0, FrameEvent::Rejected(RejectReason::Window), &plain));
    let some: Subscription = serde_json::from_value(json!({
        "gateways": [1], "channels": [2], "kinds": ["received", "failed"],
        "filters": [{"id": 0x120, "mask": 0x8000_07F0_u32}],
    }))
    .unwrap();
    assert!(some.selects(1, 2, received, &plain));
    assert!(!some.selects(0, 2, received, &plain));
    assert!(!some.selects(1, 1, received, &plain));
    assert!(!some.selects(1, 2, FrameEvent::Transmitted, &plain));
    assert!(!some.selects(1, 2, received, &frame(0x133, false)));
    assert!(!some.selects(1, 2, received, &frame(0x123, true)));
}

#[test]
fn events_and_states_of_other_versions_are_read() {
    let recorded = RecordedEvents {
        dropped: 7,
        events: vec![RecordedEvent {
            time_ns: 5,
            kind: RecordedKind::Ready,
            gateway: Some(1),
            channel: None,
            duration_ns: Some(300_000_000),
            text: "ready after 0.300 s".into(),
        }],
    };
    let mut text = json!(recorded);
    assert_eq!(
        text["events"][0],
        json!({"time_ns": 5, "kind": "ready", "gateway": 1, "channel": null,
            "duration_ns": 300_000_000, "text": "ready after 0.300 s"})
    );
    assert_eq!(serde_json::from_value::<RecordedEvents>(text.clone()).unwrap(), recorded);
    text["events"][0]["kind"] = json!("a later kind");
    text["events"][0]["more"] = json!(1);
    let later: RecordedEvents = serde_json::from_value(text).unwrap();
    assert_eq!(later.events[0].kind, RecordedKind::Other);

    let former = json!({"session": "waiting", "waiting_for": "OP", "working_counter": 0,
        "expected_working_counter": 3, "channel_status": [null, null, null, null], "statistics": {}});
    let former: GatewayState = serde_json::from_value(former).unwrap();
    assert_eq!((former.waiting_for.as_deref(), former.waiting_code), (Some("OP"), 0));
}

#[test]
fn every_method_name_is_unique() {
    let mut names: Vec<_> = METHODS.iter().map(|(name, _)| name).collect();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), METHODS.len());
    assert!(METHODS.contains(&("sdo.download", Access::Control)));
    assert!(METHODS.contains(&("sdo.upload", Access::Read)));
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_no_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Request::parse(&bytes);
        let _ = serde_json::from_slice::<Response>(&bytes);
    }

    #[test]
    fn any_json_is_read_or_rejected(
        id in prop_oneof![Just(json!(null)), Just(json!(1)), Just(json!([1])), Just(json!("a"))],
        method in prop_oneof![Just(json!("hello")), Just(json!(1)), Just(json!(null))],
        version in prop_oneof![Just(json!("2.0")), Just(json!(2.0))],
    ) {
        let text = json!({"jsonrpc": version, "id": id, "method": method, "params": 1}).to_string();
        let is_good = version == "2.0" && method == "hello" && (id == 1 || id == "a");
        prop_assert_eq!(Request::parse(text.as_bytes()).is_ok(), is_good);
    }
}
