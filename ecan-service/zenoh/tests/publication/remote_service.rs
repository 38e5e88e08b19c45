//! A published service as a service of another host.

use std::sync::atomic::Ordering;
use std::time::Duration;

use ecan_service::client::{
    Access, Client, ClientError, Event, EventKind, FrameEvent, FrameReport, IdFilter, NmtCommand,
    NmtParams, RejectReason, Subscription, UploadParams,
};
use ecan_service_zenoh::{Keys, PublicationEvent, RemoteService};
use serde_json::json;

use crate::common::{Fixture, PATIENCE, frame, wait_for};
use crate::session::{
    Link, PREFIX, Published, config, endpoints, free_address, open_remote, publish_by, write_config,
};

/// A publisher, and a program of another host whose link can be held.
struct Hosts {
    fixture: Fixture,
    published: Published,
    link: Link,
    service: RemoteService,
}

impl Hosts {
    fn start(has_control: bool) -> Self {
        let fixture = Fixture::start(|_| ());
        let address = free_address("tcp");
        // A held link keeps few bytes.
        let buffer = "transport: { link: { tcp: { so_sndbuf: 16384 } } }";
        let settings = format!("listen: {}, {buffer}", endpoints(&address));
        let remote = || open_remote(&address, "").unwrap();
        let published =
            publish_by(&fixture, &fixture.path(), config(has_control), &settings, remote);
        let link = Link::to_narrow_address(&address);
        let text = format!("{{ mode: 'client', connect: {} }}", endpoints(&link.address));
        let directory = tempfile::tempdir().unwrap();
        let file = write_config(directory.path(), &text);
        let service = RemoteService::open(Some(&file), Keys::new(PREFIX).unwrap(), "hmi").unwrap();
        Self { fixture, published, link, service }
    }

    fn client(&self) -> Client {
        self.service.connect("remote").unwrap()
    }
}

fn next_frame(client: &Client) -> FrameReport {
    match client.poll(PATIENCE).unwrap() {
        Some(Event::Frame(report)) => report,
        other => panic!("{other:?}"),
    }
}

#[test]
fn requests_are_those_of_the_service() {
    let hosts = Hosts::start(true);
    let (remote, local) = (hosts.client(), hosts.fixture.client());
    assert_eq!(remote.hello().gateways, local.hello().gateways);
    assert_eq!(remote.hello().access, Access::Control);
    let object = |index| UploadParams { slave: 0, index, subindex: 0, max_bytes: None, once: true };
    let read = [&remote, &local].map(|client| client.sdo_upload(&object(0x1000)).unwrap());
    assert_eq!(read[0], read[1]);
    let errors = [&remote, &local].map(|client| client.sdo_upload(&object(0x5fff)).unwrap_err());
    let errors = errors.map(|error| error.rpc().unwrap().bus_error());
    assert!(errors[0].is_some() && errors[0] == errors[1], "{errors:?}");
    assert_eq!(remote.slaves().unwrap(), local.slaves().unwrap());
    let (gateway, channel, node) = (0, 0, 1);
    remote.nmt(&NmtParams { gateway, channel, node, command: NmtCommand::Start }).unwrap();
    wait_for("the frame", || crate::session::sent_frames(&hosts.fixture) == 1);
    let error = remote.subscribe_images(&Default::default()).unwrap_err().to_string();
    assert!(error.contains("images.subscribe is not available through Zenoh"), "{error}");
}

#[test]
fn own_frames_have_one_result_and_others_are_selected() {
    let hosts = Hosts::start(true);
    let (remote, local) = (hosts.client(), hosts.fixture.client());
    let subscription = Subscription {
        kinds: vec![EventKind::Transmitted],
        filters: vec![IdFilter { id: 0x120, mask: 0x7f0 }],
        ..Subscription::default()
    };
    remote.subscribe(&subscription).unwrap();
    let own: Vec<_> = (0..20u8)
        .map(|number| (remote.send(0, 0, &frame(0x123, &[number])).unwrap(), number))
        .collect();
    for (tag, number) in own {
        let report = next_frame(&remote);
        assert_eq!((report.tag, report.event), (tag, FrameEvent::Transmitted));
        assert_eq!(report.frame, frame(0x123, &[number]));
        assert!(report.time_ns > 0);
    }
    local.send(0, 0, &frame(0x223, &[1])).unwrap();
    local.send(0, 0, &frame(0x124, &[2])).unwrap();
    let report = next_frame(&remote);
    assert_eq!((report.tag, report.frame), (0, frame(0x124, &[2])));
    let no_channel = remote.send(0, 3, &frame(0x123, &[])).unwrap();
    let report = next_frame(&remote);
    let event = FrameEvent::Rejected(RejectReason::NoSuchChannel);
    assert_eq!((report.tag, report.event), (no_channel, event));
    remote.unsubscribe().unwrap();
    local.send(0, 0, &frame(0x125, &[])).unwrap();
    let last = remote.send(0, 0, &frame(0x126, &[])).unwrap();
    assert_eq!(next_frame(&remote).tag, last, "no frame of the ended subscription");
}

#[test]
fn frames_that_the_network_loses_are_reported() {
    let hosts = Hosts::start(false);
    let remote = hosts.client();
    assert_eq!(remote.hello().access, Access::Read);
    remote.subscribe(&Subscription::default()).unwrap();
    hosts.fixture.frames_per_cycle.store(200, Ordering::Release);
    next_frame(&remote);
    hosts.link.set_held(true);
    let clients = crate::session::json_of(&hosts.published.get("clients", Vec::new()).unwrap());
    assert_eq!((&clients[0]["client"], &clients[0]["subscriptions"]), (&json!("hmi"), &json!(1)));
    // More than the link and Zenoh keep.
    let local = hosts.fixture.client();
    let delivered = || {
        let mut clients = local.service_stats().unwrap().clients.into_iter();
        clients.find(|client| client.name == "ecan zenoh: frames").unwrap().frames_delivered
    };
    let before = delivered();
    wait_for("many frames", || delivered() > before + 30_000);
    hosts.fixture.frames_per_cycle.store(0, Ordering::Release);
    hosts.link.set_held(false);
    let (mut received, mut lost) = (0, 0);
    while lost == 0 {
        match remote.poll(PATIENCE).unwrap() {
            Some(Event::Frame(_)) => received += 1,
            Some(Event::Lost(event)) => lost += event.frames + event.frames_in_client,
            other => panic!("{other:?} after {received} frames"),
        }
    }
}

#[test]
fn end_of_the_publisher_ends_the_connection_and_another_one_is_found() {
    let mut hosts = Hosts::start(true);
    let client = hosts.client();
    let event =
        hosts.published.wait_for_event(|event| matches!(event, PublicationEvent::Client(_)));
    assert_eq!(event, PublicationEvent::Client("hmi".into()));
    hosts.fixture.stop();
    let error = loop {
        match client.poll(PATIENCE) {
            Ok(Some(_)) => {}
            Ok(None) => panic!("the connection does not end"),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, ClientError::Closed), "{error}");
    let error = hosts.service.connect("remote").unwrap_err().to_string();
    assert!(error.contains("no publisher answers; start ecan zenoh"), "{error}");
}

#[test]
fn subscription_is_limited_to_its_publisher_and_named() {
    let hosts = Hosts::start(false);
    let remote = crate::session::Remote::of(&hosts.published.remote, "test");
    let act =
        |params: serde_json::Value| remote.act("frames.subscribe", params.to_string().into_bytes());
    let error = act(json!({ "subscription": "a/b" })).unwrap_err();
    assert!(error.message.contains("name of the subscription has 3 bytes; allowed"), "{error}");
    let error = act(json!({ "subscription": "a", "chanels": [1] })).unwrap_err();
    assert!(error.message.contains("unknown field `chanels`"), "{error}");
    let error = remote.act("frames.renew", br#"{"subscription":"b"}"#.to_vec()).unwrap_err();
    assert!(error.message.contains("subscription b does not exist any more"), "{error}");
    let info = crate::session::json_of(&act(json!({ "subscription": "a" })).unwrap());
    assert_eq!(info["lease_ms"], 10_000);
    let samples = hosts.published.subscribe("subscriptions/a/*/*");
    hosts.fixture.frames_per_cycle.store(1, Ordering::Release);
    let sample = samples.recv_timeout(Duration::from_secs(60)).unwrap().unwrap();
    assert_eq!(sample.key_expr().as_str(), format!("{PREFIX}/subscriptions/a/0/0"));
}
