//! Requests of remote clients that must not act: late, to another machine, or beyond a limit.

use std::cell::Cell;
use std::collections::VecDeque;
use std::iter::repeat_with;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ecan_mcan_port::ChannelConfig;
use ecan_service::client::{
    FrameEvent, INVALID_REQUEST, NOT_AVAILABLE, NOT_PERMITTED, RejectReason, RpcError,
};
use ecan_service_zenoh::{PublicationConfig, PublicationEvent, RejectedRequests, TransmitLimits};
use serde_json::json;
use zenoh::query::Reply;
use zenoh::{Session, Wait as _};

use crate::common::{Fixture, PATIENCE, frame, gateway, wait_for};
use crate::session::{
    LIFETIME, Link, Published, Remote, config, endpoints, free_address, key, open_remote,
    open_session, payload_of, publish, publish_by, publish_with, publishers, record, sent_frames,
};
use ecan_test_support::OnDrop;

const NMT: &str = r#"{ "gateway": 0, "channel": 0, "node": 0, "command": "start" }"#;

fn error_of(reply: Reply) -> RpcError {
    let error = reply.into_result().expect_err("an error");
    serde_json::from_slice(&error.payload().to_bytes()).expect("an RpcError")
}

#[test]
fn request_that_acts_addresses_one_publisher() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let frames = payload_of(&[record(0, 1, &[1])]);
    let remote = Remote::of(&published.remote, "test");
    for (method, payload) in [("send", frames.clone()), ("nmt", NMT.into())] {
        let error = published.get(method, payload.clone()).unwrap_err();
        assert_eq!(error.code, INVALID_REQUEST);
        assert!(error.message.contains("must address one publisher; get PREFIX/publisher/*"));
        let any = format!("publisher/*/test/{method}");
        let replies = published.replies(&any, payload.clone());
        assert!(replies.into_iter().all(|reply| reply.result().is_err()), "{any}");
        let other = format!("publisher/1f/test/{method}");
        let error = published.get(&other, payload.clone()).unwrap_err();
        assert_eq!(error.code, NOT_AVAILABLE);
        for attachment in [None, Some(vec![0; 7]), Some(u64::MAX.to_le_bytes().to_vec())] {
            let mut replies = remote.replies(method, payload.clone(), attachment, PATIENCE);
            assert_eq!(error_of(replies.remove(0)).code, INVALID_REQUEST);
        }
    }
    assert_eq!(sent_frames(&fixture), 0);
    remote.act("send", frames).unwrap();
    remote.act("nmt", NMT.into()).unwrap();
    wait_for("both frames", || sent_frames(&fixture) == 2);
    assert_eq!(published.get("no/such/key", Vec::new()).unwrap_err().code, -32601);
    published.end().unwrap();
}

#[test]
fn two_publishers_with_one_prefix_reject_control() {
    let fixtures = [Fixture::start(|_| ()), Fixture::start(|_| ())];
    let address = free_address("tcp");
    let _router =
        open_session(&format!("mode: 'router', listen: {}", endpoints(&address))).unwrap();
    let start = |fixture: &Fixture| {
        let settings = format!("mode: 'client', connect: {}", endpoints(&address));
        let remote = || open_remote(&address, "").unwrap();
        publish_by(fixture, &fixture.path(), config(true), &settings, remote)
    };
    let first = start(&fixtures[0]);
    let alone = Remote::of(&first.remote, "test");
    alone.act("nmt", NMT.into()).unwrap();
    wait_for("the frame", || sent_frames(&fixtures[0]) == 1);
    let second = start(&fixtures[1]);
    for published in [&first, &second] {
        let is_conflict = |event: &_| matches!(event, PublicationEvent::PrefixInUse { .. });
        let event = published.wait_for_event(is_conflict).to_string();
        assert!(event.contains("remote control is rejected; set --prefix"), "{event}");
    }
    let found = publishers(&first.remote);
    assert_eq!(found.len(), 2, "the client sees both: {found:?}");
    for info in &found {
        let reason = info.access_reason.as_deref().unwrap_or_default();
        assert!(reason.contains("another publisher uses the prefix"), "{reason}");
    }
    // Addressed to the first one, which was the only one.
    for (method, payload) in [("nmt", NMT.into()), ("send", payload_of(&[record(0, 1, &[1])]))] {
        let error = alone.act(method, payload).unwrap_err();
        assert_eq!(error.code, NOT_AVAILABLE);
        assert!(error.message.contains("another publisher uses the prefix"), "{error}");
    }
    let replies = first.replies("state", Vec::new());
    assert!(!replies.is_empty() && replies.into_iter().all(|reply| reply.result().is_err()));
    second.end().unwrap();
    first.wait_for_event(|event| *event == PublicationEvent::PrefixFree);
    Remote::of(&first.remote, "test").act("nmt", NMT.into()).unwrap();
    wait_for("the frame", || sent_frames(&fixtures[0]) == 2);
    assert_eq!(sent_frames(&fixtures[1]), 0);
    first.end().unwrap();
}

/// A publication whose clients connect through a link.
fn publish_through_link(fixture: &Fixture) -> (Published, Link) {
    let address = free_address("tcp");
    let link = Link::to_address(&address);
    let remote = || open_remote(&link.address, "").unwrap();
    let settings = format!("listen: {}", endpoints(&address));
    let published = publish_by(fixture, &fixture.path(), config(true), &settings, remote);
    (published, link)
}

#[test]
fn requests_that_arrive_late_are_rejected_and_reported() {
    let fixture = Fixture::start(|_| ());
    let (published, link) = publish_through_link(&fixture);
    let remote = Remote::of(&published.remote, "test");
    let requests = [
        ("nmt", NMT.as_bytes().to_vec()),
        ("send", payload_of(&[record(0, 1, &[1]), record(0, 2, &[2])])),
        ("sdo.download", br#"{ "slave": 0, "index": 32769, "subindex": 19, "data": "00" }"#.into()),
        ("no.extension", b"{}".into()),
    ];
    let requests_count = requests.len() as u64;
    link.set_held(true);
    std::thread::scope(|scope| {
        for (method, payload) in requests {
            let remote = &remote;
            // Until Zenoh reports that the client waits no longer.
            scope.spawn(move || {
                let lifetime = Duration::from_millis(200);
                let attachment = Some(remote.deadline(lifetime));
                let replies = remote.replies(method, payload, attachment, lifetime);
                assert!(replies.iter().all(|reply| reply.result().is_err()), "{replies:?}");
            });
        }
    });
    link.set_held(false);
    published.wait_for_event(|event| {
        *event == PublicationEvent::Rejected(RejectedRequests { late: requests_count, full: 0 })
    });
    // Later requests of the same client.
    remote.act("send", payload_of(&[record(1, 1, &[3])])).unwrap();
    let channels = fixture.statistics().channels;
    assert_eq!((channels[0].frames_accepted, channels[1].frames_accepted), (0, 1));
    published.end().unwrap();
}

#[test]
fn frames_that_wait_for_the_bus_expire() {
    // A frame takes 12 ms, so that those of the application fill the queue, also if cycles are late.
    let bus = gateway().with_channel(0, ChannelConfig::classic(10_000));
    let fixture = Fixture::with_gateway(bus, |_| ());
    let published = publish(&fixture, true);
    let remote = Remote::of(&published.remote, "test");
    fixture.frames_per_cycle.store(200, Ordering::Release);
    wait_for("back pressure", || {
        fixture.execute(|port, _| {
            let mut cycle = port.next_cycle();
            let channel = cycle.channel(0, 0).unwrap();
            let is_full = (0..300).any(|_| cycle.send(channel, &frame(0x7ff, &[])).is_err());
            cycle.finish();
            is_full
        })
    });
    let records: Vec<_> = (1..=100).map(|tag| record(0, tag, &[1])).collect();
    let attachment = Some(remote.deadline(Duration::from_millis(300)));
    let mut replies = remote.replies("send", payload_of(&records), attachment, PATIENCE);
    let reports = crate::session::reports(&replies.remove(0).into_result().unwrap());
    let is_expired = |event| event == FrameEvent::Rejected(RejectReason::Expired);
    assert!(reports.iter().all(|report| is_expired(report.event)), "{reports:?}");
    assert_eq!(reports.len(), records.len());
    let late = records.len() as u64;
    published.wait_for_event(|event| {
        *event == PublicationEvent::Rejected(RejectedRequests { late, full: 0 })
    });
    published.end().unwrap();
}

#[test]
fn flooding_client_rejects_no_request_of_another() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let object = json!({ "slave": 0, "index": 0x1000, "subindex": 0 }).to_string();
    let flooder = Remote::of(&published.remote, "flooder");
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let _end = OnDrop(|| is_over.store(true, Ordering::Release));
        // More requests of each kind than may wait, all the time. Zenoh discards some on a busy machine; the short
        // timeout keeps the flood going then.
        scope.spawn(|| {
            let timeout = Duration::from_millis(200);
            let frames: Vec<_> = (1..=200).map(|tag| record(0, tag, &[9; 8])).collect();
            let mut pending = VecDeque::new();
            while !is_over.load(Ordering::Acquire) {
                let deadline = Some(flooder.deadline(LIFETIME));
                let upload = flooder.start("sdo.upload", object.clone().into(), None, timeout);
                let send = flooder.start("send", payload_of(&frames), deadline, timeout);
                pending.extend([upload, send]);
                if pending.len() > 80 {
                    pending.drain(..2).for_each(|replies| replies.into_iter().for_each(drop));
                }
            }
        });
        let rejected = Cell::new(0);
        published.wait_for_event(|event| {
            if let PublicationEvent::Rejected(RejectedRequests { full, .. }) = event {
                rejected.set(rejected.get() + full);
            }
            rejected.get() >= 20
        });
        let probe = Remote::of(&published.remote, "probe");
        for number in 0..20 {
            let send = || {
                let reply = probe.act("send", payload_of(&[record(1, 1, &[number])])).unwrap();
                crate::session::reports(&reply)[0].event
            };
            // A machine that stops the cycle for 100 ms takes the gateway out of OP for some time.
            let not_ready = FrameEvent::Rejected(RejectReason::NotReady);
            let event = repeat_with(send).find(|event| *event != not_ready);
            assert_eq!(event, Some(FrameEvent::Transmitted));
            probe.act("sdo.upload", object.clone().into()).unwrap();
            Remote::of(&published.remote, "probe");
        }
    });
    published.end().unwrap();
}

#[test]
fn long_requests_are_rejected() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let remote = Remote::of(&published.remote, "test");
    let spaces = |bytes: usize| vec![b' '; bytes];
    for (method, bytes) in [("state", 64 << 10), ("send", 64 << 10), ("no.method", 900 << 10)] {
        let error = remote.act(method, spaces(bytes)).unwrap_err();
        assert_eq!(error.code, INVALID_REQUEST);
        assert!(error.message.contains("allowed: at most"), "{error}");
    }
    // Of these the service would end the connection.
    let nested = format!("{}1{}", "[".repeat(126), "]".repeat(126));
    assert_eq!(remote.act("state", nested.into_bytes()).unwrap_err().code, INVALID_REQUEST);
    let numbers = format!("[{}1]", "1e9,".repeat(15_000));
    assert_eq!(remote.act("no.method", numbers.into_bytes()).unwrap_err().code, INVALID_REQUEST);
    assert_eq!(remote.act(&"x".repeat(1000), Vec::new()).unwrap_err().code, -32601);
    // Zenoh discards a longer message.
    let wait = Duration::from_millis(500);
    let replies = remote.replies("state", spaces(24 << 20), None, wait);
    assert!(replies.iter().all(|reply| reply.result().is_err()), "{}", replies.len());
    let wait = Duration::from_secs(30);
    assert_eq!(remote.replies("state", Vec::new(), None, wait).len(), 1);
    published.end().unwrap();
}

#[test]
fn token_falls_while_the_service_is_silent() {
    let fixture = Fixture::start(|_| ());
    let near = fixture.directory.path().join("link.sock");
    let link = Link::to_socket(&near, fixture.path());
    let published = publish_with(&fixture, &near, config(true));
    let remote = Remote::of(&published.remote, "test");
    link.set_held(true);
    published.wait_for_event(|event| *event == PublicationEvent::ServiceSilent);
    wait_for("the end of the token", || !published.is_alive());
    for (method, payload) in [("nmt", NMT.into()), ("state", Vec::new())] {
        let error = remote.act(method, payload).unwrap_err();
        assert_eq!(error.code, NOT_AVAILABLE);
        assert!(error.message.contains("the service has not responded"), "{error}");
    }
    link.set_held(false);
    published.wait_for_event(|event| *event == PublicationEvent::ServiceResponds);
    wait_for("the token", || published.is_alive());
    remote.act("nmt", NMT.into()).unwrap();
    wait_for("the frame", || sent_frames(&fixture) == 1);
    published.end().unwrap();
}

#[test]
fn frames_beyond_the_limits_of_remote_clients_are_rejected() {
    let fixture = Fixture::start(|_| ());
    let rules = ["0.0:100-1FF", "0.1"].map(|rule| rule.parse().unwrap());
    let limits = TransmitLimits { rules: rules.to_vec() };
    let config = PublicationConfig { limits, ..config(true) };
    let published = publish_with(&fixture, &fixture.path(), config);
    let mut forbidden = record(0, 2, &[]);
    forbidden.frame = frame(0x200, &[]);
    let error = published.send(&[record(0, 1, &[]), forbidden]).unwrap_err();
    assert_eq!(error.code, NOT_PERMITTED);
    assert!(error.message.contains("CAN ID 200 on gateway 0 channel 0"), "{error}");
    assert!(error.message.contains("allowed: 0.0:100-1FF, 0.1"), "{error}");
    let error = published.act("nmt", serde_json::from_str(NMT).unwrap()).unwrap_err();
    assert_eq!(error.code, NOT_PERMITTED);
    assert_eq!(sent_frames(&fixture), 0);
    let sent = published.send(&[record(0, 1, &[]), record(1, 2, &[])]).unwrap();
    assert!(sent.iter().all(|report| report.event == FrameEvent::Transmitted), "{sent:?}");
    published.end().unwrap();
}

/// The keys and the session are those of a client that is not of this project.
fn declare_token(session: &Session) -> zenoh::liveliness::LivelinessToken {
    session.liveliness().declare_token(key("alive/other")).wait().unwrap()
}

#[test]
fn token_of_another_publisher_rejects_control() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let token = declare_token(&published.remote);
    let expected = PublicationEvent::PrefixInUse { token: key("alive/other") };
    let warning = published.wait_for_event(|event| *event == expected);
    assert!(warning.to_string().contains("set --prefix"));
    let remote = Remote::of(&published.remote, "test");
    assert_eq!(remote.act("nmt", NMT.into()).unwrap_err().code, NOT_AVAILABLE);
    token.undeclare().wait().unwrap();
    published.wait_for_event(|event| *event == PublicationEvent::PrefixFree);
    published.end().unwrap();
}
