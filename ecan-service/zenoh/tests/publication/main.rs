//! A service published to another Zenoh session on this host.
#![allow(missing_docs)]

#[allow(dead_code)]
#[path = "../../../tests/server/common/mod.rs"]
mod common;

mod python;
mod remote_requests;
mod remote_service;
mod security;
mod session;

use std::net::TcpListener;
use std::sync::atomic::Ordering;

use ecan_service::client::{
    BAD_RECORD, BUS_ERROR, FrameEvent, METHOD_NOT_FOUND, NOT_PERMITTED, RejectReason,
};
use ecan_service::server::Control;
use ecan_service_zenoh::{FrameAccount, Publication, PublicationError, PublicationEvent};
use serde_json::{Value, json};
use zenoh::Wait as _;
use zenoh::sample::Sample;

use common::{Fixture, PATIENCE, wait_for};
use session::{
    Remote, config, endpoints, free_address, head, key, next, open_remote, open_session, publish,
    publish_by, record, reports, write_config,
};

#[test]
fn frames_arrive_by_channel_and_all_are_counted() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let samples = published.subscribe("frames/*/*");
    fixture.frames_per_cycle.store(3, Ordering::Release);
    let mut account = FrameAccount::default();
    let mut events = Vec::new();
    let mut take = |sample: Sample, account: &mut FrameAccount| {
        let batch = reports(&sample);
        let (own, channel) = (sample.key_expr().as_str(), key("frames/0/0"));
        assert!(own == channel && batch.iter().all(|report| report.channel == 0), "{own}");
        account.take(head(&sample), batch.len() as u64);
        events.extend(batch.iter().map(|report| report.event));
    };
    while account.received() < 1000 {
        take(next(&samples), &mut account);
    }
    fixture.frames_per_cycle.store(0, Ordering::Release);
    // Until the last frame that the service delivered to the publisher.
    let delivered = || {
        let clients = fixture.client().service_stats().unwrap().clients;
        let client =
            clients.into_iter().find(|client| client.name == "ecan zenoh: frames").unwrap();
        (client.frames_delivered, client.frames_lost)
    };
    let present = || head(&published.get("frames/0/0", Vec::new()).unwrap());
    let mut before = delivered();
    wait_for("the end of the frames and the publication of all", || {
        fixture.run_cycles(50);
        std::mem::replace(&mut before, delivered()) == before && present().frames == before.0
    });
    let present = present();
    account.take(present, 0);
    while account.lost_on_network() > 0 {
        take(next(&samples), &mut account);
    }
    assert_eq!((account.lost_in_service(), present.lost), (0, before.1));
    assert!(events.contains(&FrameEvent::Received) && events.contains(&FrameEvent::Transmitted));
    assert_eq!(published.replies("frames/*/*", Vec::new()).len(), 2, "both channels");
    published.end().unwrap();
}

#[test]
fn states_are_published_and_answer_to_get() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let states = published.subscribe("state");
    let state: Value = serde_json::from_slice(&next(&states).payload().to_bytes()).unwrap();
    assert_eq!(state["gateways"][0]["session"], "ready");
    let state = published.call("state", json!({})).unwrap();
    assert!(state["cycle"]["cycle"].as_u64().unwrap() > 0, "{state}");
    assert_eq!(published.call("hello", json!({})).unwrap()["access"], "read");
    let publisher = Remote::of(&published.remote, "test").info.publisher;
    let all = published.remote.get("bench/**").timeout(PATIENCE).wait().unwrap();
    let mut names: Vec<_> = all
        .into_iter()
        .map(|reply| reply.into_result().unwrap().key_expr().as_str().replace(&key(""), ""))
        .map(|name| name.replace(&publisher, "ID"))
        .collect();
    names.sort();
    let channels = ["frames/0/0", "frames/0/1"];
    let expected =
        [&["axes", "bus.state", "clients"][..], &channels, &["hello", "publisher/ID"]].concat();
    let expected = [&expected[..], &["service.stats", "state"]].concat();
    assert_eq!(names, expected);
    published.end().unwrap();
}

#[test]
fn objects_are_read_and_failures_have_their_data() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let object = |index: u32| json!({ "slave": 0, "index": index, "subindex": 0 });
    let upload = published.call("sdo.upload", object(0x1000)).unwrap();
    assert_eq!(upload["data"].as_str().map(str::len), Some(8), "{upload}");
    let error = published.call("sdo.upload", object(0x5fff)).unwrap_err();
    assert_eq!((error.code, error.data["kind"].as_str()), (BUS_ERROR, Some("sdo")));
    let error = published.call("frames.subscribe", json!({})).unwrap_err();
    assert_eq!(error.code, METHOD_NOT_FOUND);
    published.end().unwrap();
}

#[test]
fn frames_are_sent_with_their_results_in_the_reply() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let samples = published.subscribe("frames/0/0");
    let records = [record(0, 7, &[1]), record(3, 8, &[2]), record(0, 9, &[3])];
    let results = published.send(&records).unwrap();
    let results: Vec<_> =
        results.iter().map(|report| (report.tag, report.event, report.frame)).collect();
    let no_channel = FrameEvent::Rejected(RejectReason::NoSuchChannel);
    let events = [FrameEvent::Transmitted, no_channel, FrameEvent::Transmitted];
    let expected: Vec<_> = records
        .iter()
        .zip(events)
        .map(|(record, event)| (record.tag, event, record.frame))
        .collect();
    assert_eq!(results, expected);
    let mut seen = Vec::new();
    while seen.len() < 4 {
        seen.extend(reports(&next(&samples)));
    }
    assert!(seen.iter().all(|report| report.tag == 0), "tags are those of their sender: {seen:?}");

    let error = Remote::of(&published.remote, "test").act("send", vec![0; 15]).unwrap_err();
    assert_eq!(error.code, BAD_RECORD);
    assert_eq!(published.send(&[]).unwrap(), []);
    let nmt = json!({ "gateway": 0, "channel": 0, "node": 1, "command": "start" });
    published.act("nmt", nmt).unwrap();
    let heartbeat = json!({ "slave": 0, "index": 0x1000, "subindex": 0, "data": "00" });
    assert_eq!(published.act("sdo.download", heartbeat).unwrap_err().code, BUS_ERROR);
    published.end().unwrap();
}

#[test]
fn control_needs_the_option_and_the_service() {
    let nmt = json!({ "gateway": 0, "channel": 0, "node": 0, "command": "start" });
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    for error in [
        published.send(&[record(0, 1, &[])]).unwrap_err(),
        published.act("nmt", nmt.clone()).unwrap_err(),
        published.act("sim.fault", json!({})).unwrap_err(),
    ] {
        assert_eq!(error.code, NOT_PERMITTED);
        assert!(error.message.contains("start ecan zenoh with --control"), "{error}");
    }
    published.end().unwrap();
    let fixture = Fixture::start(|config| config.control = Control::Nobody);
    let published = publish(&fixture, true);
    for error in
        [published.send(&[record(0, 1, &[])]).unwrap_err(), published.act("nmt", nmt).unwrap_err()]
    {
        assert_eq!(error.code, NOT_PERMITTED);
        assert!(error.message.contains("read-only"), "{error}");
    }
    published.end().unwrap();
}

#[test]
fn end_of_the_service_ends_the_run_and_the_token() {
    let mut fixture = Fixture::start(|_| ());
    let mut published = publish(&fixture, false);
    fixture.stop();
    let error = published.thread.take().unwrap().join().unwrap().unwrap_err();
    assert!(matches!(error, PublicationError::Service(_)), "{error}");
    wait_for("the end of the token", || !published.is_alive());
}

#[test]
fn router_between_the_hosts_forwards() {
    let fixture = Fixture::start(|_| ());
    let address = free_address("tcp");
    let router = format!("mode: 'router', listen: {}", endpoints(&address));
    let _router = open_session(&router).unwrap();
    let settings = format!("mode: 'client', connect: {}", endpoints(&address));
    let remote = || open_remote(&address, "").unwrap();
    let published = publish_by(&fixture, &fixture.path(), config(true), &settings, remote);
    let links = published.events.recv_timeout(PATIENCE).unwrap();
    assert_eq!(links, PublicationEvent::Links { routers: 1, peers: 0 });
    let samples = published.subscribe("frames/0/0");
    let sent = published.send(&[record(0, 1, &[5])]).unwrap();
    assert_eq!(sent[0].event, FrameEvent::Transmitted);
    wait_for("a frame", || {
        published.send(&[record(0, 1, &[6])]).unwrap();
        samples.try_recv().unwrap().is_some_and(|sample| !reports(&sample).is_empty())
    });
    published.end().unwrap();
}

#[test]
fn unreachable_router_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let text = format!("{{ mode: 'client', connect: {{ endpoints: ['tcp/{free}'] }} }}");
    let error = Publication::open(&write_config(directory.path(), &text), config(false));
    let error = error.unwrap_err().to_string();
    assert!(error.contains("cannot open the Zenoh session"), "{error}");
    assert!(error.contains(&free.to_string()), "{error}");
}
