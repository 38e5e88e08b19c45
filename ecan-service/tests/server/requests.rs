//! Requests, access, and clients that break the rules.

use std::io::Write as _;
use std::time::Duration;

use super::common::{
    Fixture, PATIENCE, call, exists, frame, gateway, next, read, say_hello, wait_for, write,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{BusEvent, PendingStep, PortConfig};
use ecan_service::client::*;
use ecan_service::server::{Control, Extension, Permission, Service, ServiceConfig, ServiceError};
use ecan_sim::{ClockKind, Fault, SimOptions};
use serde_json::{Value, json};

fn upload(slave: u16, index: u16, subindex: u8) -> UploadParams {
    UploadParams { slave, index, subindex, max_bytes: None, once: false }
}

#[test]
fn hello_describes_the_bus() {
    let fixture = Fixture::start(|config| config.name = "test bench".into());
    let client = fixture.client();
    let hello = client.hello();
    assert_eq!((hello.server.as_str(), hello.pid), ("test bench", std::process::id()));
    assert!(hello.is_simulated && hello.is_free_running);
    assert_eq!((hello.access, hello.cycle_ns), (Access::Control, Some(1_000_000)));
    let channels = &hello.gateways[0].channels;
    assert_eq!(channels.len(), 2);
    assert_eq!((channels[0].bitrate, channels[0].data_bitrate), (1_000_000, None));
    assert_eq!(hello.channel(0, 1).unwrap().data_bitrate, Some(5_000_000));
    let config = client.config().unwrap();
    let port: PortConfig = serde_json::from_value(config.port).unwrap();
    let adapter: AdapterConfig = serde_json::from_value(config.adapter).unwrap();
    let expected = fixture.execute(|port, _| (*port.adapter().config(), *port.config()));
    assert_eq!((adapter, port), expected);
}

#[test]
fn state_has_cycle_times_and_statistics() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    wait_for("samples", || client.state().unwrap().run_time.samples > 3);
    let state = client.state().unwrap();
    assert!(state.cycle.cycle > 3 && state.cycle.run_time_ns > 0);
    assert!(state.run_time.p50_ns <= state.run_time.max_ns);
    let gateway = &state.gateways[0];
    assert_eq!((gateway.session, gateway.waiting_for.as_deref()), (SessionState::Ready, None));
    assert!(gateway.channel_status[0].is_some() && gateway.channel_status[2].is_none());
    let value = Value::Object(gateway.statistics.clone());
    let statistics: ecan_mcan_port::SlaveStatistics = serde_json::from_value(value).unwrap();
    assert!(statistics.cycles > 0 && statistics.sessions == 1);
    assert_eq!(client.axes().unwrap().axes, []);
}

#[test]
fn changes_of_a_channel_are_notified() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    fixture.simulation.inject(Fault::BusOff { gateway: 0, channel: 1 });
    let change = loop {
        match client.poll(PATIENCE).unwrap() {
            Some(Event::Notification { method, params }) if method == "channel" => break params,
            Some(_) => {}
            None => panic!("no notification"),
        }
    };
    let change: ChannelChanged = serde_json::from_value(change).unwrap();
    assert_eq!((change.gateway, change.channel, change.is_bus_off), (0, 1, true));
    assert!(change.time_ns > 0);
}

#[test]
fn outage_and_bus_off_are_recorded_with_cause_and_duration() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    let of_kind = |kind: RecordedKind| {
        let events = client.events().unwrap().events.into_iter();
        events.filter(|event| event.kind == kind).collect::<Vec<_>>()
    };
    assert_eq!(of_kind(RecordedKind::Cycle)[0].text, "cycle of 1000 us, gateways: 1");
    wait_for("the first event", || of_kind(RecordedKind::Ready).len() == 1);
    assert_eq!(of_kind(RecordedKind::Ready)[0].duration_ns, None);

    fixture.simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 500 });
    let waiting = || client.state().unwrap().gateways[0].clone();
    wait_for("the loss", || waiting().waiting_code != 0);
    wait_for("the return", || of_kind(RecordedKind::Ready).len() == 2);
    assert_eq!(waiting().waiting_code, 0);
    let lost = &of_kind(RecordedKind::Lost)[0];
    assert_eq!(lost.text, BusEvent::Lost(PendingStep::Link).to_string());
    let returned = &of_kind(RecordedKind::Ready)[1];
    let duration_ns = returned.duration_ns.unwrap();
    assert_eq!((lost.gateway, returned.time_ns - lost.time_ns), (Some(0), duration_ns));
    assert!(duration_ns > 300_000_000, "{returned:?}");

    fixture.simulation.inject(Fault::BusOff { gateway: 0, channel: 1 });
    wait_for("the bus-off", || !of_kind(RecordedKind::Channel).is_empty());
    let bus_off = &of_kind(RecordedKind::Channel)[0];
    assert_eq!((bus_off.channel, bus_off.text.as_str()), (Some(1), "channel 1: bus-off"));

    fixture.execute(|_, service| service.record_event("tool change"));
    wait_for("the program's event", || !of_kind(RecordedKind::Program).is_empty());
    let mut stream = fixture.stream();
    write(&mut stream, MessageKind::Rpc, b"{}");
    write(&mut stream, MessageKind::Transmit, &[]);
    wait_for("the client's event", || !of_kind(RecordedKind::Client).is_empty());
    assert!(of_kind(RecordedKind::Client)[0].text.contains("send hello before frames"));
    fixture.execute(|_, service| service.detach());
    wait_for("the end of the cycle", || of_kind(RecordedKind::Cycle).len() == 2);
}

#[test]
fn sdo_errors_arrive_unchanged() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    assert_eq!(client.bus_state().unwrap().slaves_responding, 1);
    assert_eq!(client.slaves().unwrap()[0], client.slave(0).unwrap());
    assert!(client.link(0).unwrap().link_up);
    assert!(!client.assigned_pdos(0, 3).unwrap().is_empty());
    let error = client.sdo_upload(&upload(0, 0x5555, 1)).unwrap_err();
    let expected = BusError::Sdo {
        slave: 0,
        direction: SdoDirection::Upload,
        index: 0x5555,
        subindex: 1,
        errno: 5,
        abort_code: Some(0x0602_0000),
        attempts: 1,
    };
    assert_eq!(error.rpc().unwrap().bus_error(), Some(expected));
    let once = UploadParams { once: true, ..upload(0, 0x8001, 19) };
    assert_eq!(client.sdo_upload(&once).unwrap(), 1_000_000_u32.to_le_bytes());
    let no_slave = client.sdo_upload(&upload(9, 0x8001, 19)).unwrap_err();
    let fields = no_slave.rpc().unwrap().bus_error();
    assert_eq!(fields, Some(BusError::SlaveIndex { slave: 9, count: 1 }));
}

#[test]
fn requests_work_in_stepped_time() {
    let fixture = Fixture::with_clock(ClockKind::Stepped, gateway(), |_| ());
    let client = fixture.client();
    for _ in 0..20 {
        assert_eq!(client.sdo_upload(&upload(0, 0x8010, 3)).unwrap(), [3]);
        assert_eq!(client.bus_state().unwrap().slaves_responding, 1);
    }
}

#[test]
fn read_only_client_is_rejected_with_the_reason() {
    let fixture = Fixture::start(|config| config.control = Control::Nobody);
    let client = fixture.client();
    assert_eq!(client.hello().access, Access::Read);
    assert_eq!(client.hello().access_reason.as_deref(), Some("the service is read-only"));
    let error = client.send(0, 0, &frame(1, &[])).unwrap_err();
    assert_eq!(error.to_string(), "cannot send a frame: the service is read-only");
    let params = DownloadParams {
        slave: 0,
        index: 0x8001,
        subindex: 19,
        data: vec![0; 4],
        once: true,
        complete: false,
    };
    let error = client.sdo_download(&params).unwrap_err();
    assert_eq!(error.rpc().unwrap().code, NOT_PERMITTED);
    let expected = "sdo.download is not permitted: the service is read-only";
    assert_eq!(error.to_string(), expected);
    assert!(client.sdo_upload(&upload(0, 0x8001, 19)).is_ok());
    // A client that sends all the same: its frame is rejected.
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let mut payload = Vec::new();
    TransmitRecord { gateway: 0, channel: 0, tag: 3, max_age_ms: 0, frame: frame(1, &[]) }
        .encode(&mut payload);
    write(&mut stream, MessageKind::Transmit, &payload);
    let (kind, payload) = read(&mut stream).unwrap();
    assert_eq!(kind, MessageKind::Frames);
    let Some(Ok(FrameRecord::Frame(report))) = FrameRecords::new(&payload).next() else { panic!() };
    assert_eq!((report.event, report.tag), (FrameEvent::Rejected(RejectReason::ReadOnly), 3));
}

/// The Rust client keeps to its window.
#[test]
fn frames_beyond_the_window_are_rejected_and_counted() {
    let fixture = Fixture::start(|config| config.window = 4);
    let client = fixture.client();
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let mut payload = Vec::new();
    for tag in 1..=7 {
        TransmitRecord { gateway: 0, channel: 0, tag, max_age_ms: 0, frame: frame(1, &[]) }
            .encode(&mut payload);
    }
    write(&mut stream, MessageKind::Transmit, &payload);
    let mut rejected = Vec::new();
    while rejected.len() < 3 {
        let (kind, payload) = read(&mut stream).unwrap();
        assert_eq!(kind, MessageKind::Frames);
        for record in FrameRecords::new(&payload) {
            let Ok(FrameRecord::Frame(report)) = record else { panic!("{record:?}") };
            if report.event == FrameEvent::Rejected(RejectReason::Window) {
                rejected.push(report.tag);
            }
        }
    }
    assert_eq!(rejected, [5, 6, 7]);
    let clients = client.service_stats().unwrap().clients;
    let counted = clients.iter().map(|client| (client.frames_accepted, client.frames_rejected));
    assert_eq!(counted.max(), Some((4, 3)));
}

#[test]
fn nmt_command_reaches_the_bus() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    client.subscribe(&Subscription::default()).unwrap();
    let params = NmtParams { gateway: 0, channel: 0, node: 5, command: NmtCommand::ResetNode };
    client.nmt(&params).unwrap();
    let Event::Frame(report) = super::common::next(&client) else { panic!() };
    assert_eq!((report.frame.id().raw(), report.frame.data()), (0, &[129, 5][..]));
    assert!(client.nmt(&NmtParams { channel: 3, ..params }).is_err());
}

#[test]
fn wrong_version_names_both_and_closes() {
    let fixture = Fixture::start(|_| ());
    let mut stream = fixture.stream();
    let params = json!({"version": 99, "client": "new", "further": true});
    let hello = json!({"jsonrpc": "2.0", "id": 1, "method": "hello", "params": params});
    let error = call(&mut stream, &hello).error.unwrap();
    assert_eq!(error.code, WRONG_VERSION);
    assert!(error.message.contains("99") && error.message.contains("version 1"), "{error}");
    assert_eq!(read(&mut stream), None);
}

#[test]
fn broken_clients_are_answered_and_disturb_nobody() {
    let fixture = Fixture::start(|_| ());
    let good = fixture.client();
    let code = |bytes: &[u8], with_hello: bool| {
        let mut stream = fixture.stream();
        if with_hello {
            say_hello(&mut stream);
        }
        stream.write_all(bytes).unwrap();
        let response: Response = serde_json::from_slice(&read(&mut stream).unwrap().1).unwrap();
        (response.error.unwrap().code, read(&mut stream).is_none())
    };
    assert_eq!(code(&[0xFF; 16], false), (INVALID_REQUEST, true));
    let oversized = header(MessageKind::Rpc, MAX_REQUEST_PAYLOAD + 1);
    assert_eq!(code(&oversized, true), (INVALID_REQUEST, true));
    let mut bad_record = header(MessageKind::Transmit, 3).to_vec();
    bad_record.extend_from_slice(&[1, 2, 3]);
    assert_eq!(code(&bad_record, true), (BAD_RECORD, true));
    assert_eq!(code(&bad_record, false), (HELLO_FIRST, true));
    // Errors of one request keep the connection.
    let mut stream = fixture.stream();
    let request = json!({"jsonrpc": "2.0", "id": "x", "method": "state"});
    assert_eq!(call(&mut stream, &request).error.unwrap().code, HELLO_FIRST);
    say_hello(&mut stream);
    let request = json!({"jsonrpc": "2.0", "id": "x", "method": "no.such"});
    let response = call(&mut stream, &request);
    assert_eq!((response.id, response.error.unwrap().code), (Some(json!("x")), METHOD_NOT_FOUND));
    let request = json!({"jsonrpc": "2.0", "id": 2, "method": "bus.slave", "params": {"at": 1}});
    assert_eq!(call(&mut stream, &request).error.unwrap().code, INVALID_PARAMS);
    // Half a message, and a request whose client is gone.
    stream.write_all(&header(MessageKind::Rpc, 100)[..5]).unwrap();
    drop(stream);
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let params = json!({"slave": 0, "index": 0x8001, "subindex": 19});
    let request = json!({"jsonrpc": "2.0", "id": 2, "method": "sdo.upload", "params": params});
    write(&mut stream, MessageKind::Rpc, request.to_string().as_bytes());
    drop(stream);
    assert_eq!(good.slaves().unwrap().len(), 1);
    wait_for("the end of the others", || good.service_stats().unwrap().clients.len() == 1);
}

/// As if its process was killed in the middle of a batch, and with frames on the bus.
#[test]
fn batch_cut_by_the_end_of_its_client_sends_nothing() {
    let fixture = Fixture::start(|_| ());
    let good = fixture.client();
    good.subscribe(&Subscription::default()).unwrap();
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let record = |id| TransmitRecord {
        gateway: 0,
        channel: 0,
        tag: 1,
        max_age_ms: 0,
        frame: frame(id, &[7; 8]),
    };
    let (mut whole, mut cut) = (Vec::new(), Vec::new());
    record(0x111).encode(&mut whole);
    (0..2).for_each(|_| record(0x222).encode(&mut cut));
    write(&mut stream, MessageKind::Transmit, &whole);
    stream.write_all(&header(MessageKind::Transmit, cut.len())).unwrap();
    stream.write_all(&cut[..cut.len() - 1]).unwrap();
    drop(stream);
    wait_for("its end", || good.service_stats().unwrap().clients.len() == 1);
    good.send(0, 0, &frame(0x333, &[])).unwrap();
    let mut ids = Vec::new();
    while ids.len() < 4 {
        let Event::Frame(report) = next(&good) else { panic!("no frame") };
        ids.push(report.frame.id().raw());
    }
    ids.sort_unstable();
    assert_eq!(ids, [0x111, 0x111, 0x333, 0x333], "each frame and its echo");
}

#[test]
fn too_many_clients_are_rejected() {
    let fixture = Fixture::start(|config| config.max_clients = 2);
    wait_for("a free place", || Client::connect(&fixture.path(), "first").is_ok());
    let first = fixture.client();
    let _second = fixture.client();
    let error = Client::connect(&fixture.path(), "third").unwrap_err();
    assert_eq!(error.rpc().map(|error| error.code), Some(BUSY), "{error}");
    assert!(first.service_stats().unwrap().clients_rejected >= 1);
}

#[test]
fn socket_is_exclusive_restored_and_removed() {
    let mut fixture = Fixture::start(|_| ());
    let path = fixture.path();
    let config = ServiceConfig::new(&path);
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &SimOptions::default()).unwrap();
    let error = Service::of_bus(&backend.ecrt, 0, config).unwrap_err();
    assert!(matches!(error, ServiceError::InUse { .. }), "{error}");
    let client = fixture.client();
    std::fs::remove_file(&path).unwrap();
    wait_for("a new socket", || exists(&path));
    wait_for("a new client", || Client::connect(&path, "late").is_ok());
    assert!(client.state().is_ok(), "connected before");
    fixture.stop();
    assert!(!exists(&path));
    let ended = (0..1000).find_map(|_| client.poll(PATIENCE).err());
    assert!(matches!(ended, Some(ClientError::Closed)), "{ended:?}");
}

#[test]
fn control_changes_for_connected_clients() {
    let fixture = Fixture::start(|config| config.control = Control::Nobody);
    let client = fixture.client();
    let params = NmtParams { gateway: 0, channel: 0, node: 5, command: NmtCommand::Start };
    assert_eq!(client.nmt(&params).unwrap_err().rpc().unwrap().code, NOT_PERMITTED);
    fixture.execute(|_, service| {
        assert!(service.set_control(Control::Group("no-such-group".into())).is_err());
        service.set_control(Control::Owner).unwrap();
        service.set_max_clients(1);
    });
    wait_for("control", || client.nmt(&params).is_ok());
    let rejected = Client::connect(&fixture.path(), "second").unwrap_err();
    assert_eq!(rejected.rpc().map(|error| error.code), Some(BUSY));
}

#[derive(Debug)]
struct Counter;

impl Extension for Counter {
    fn access(&self, method: &str) -> Option<Access> {
        match method {
            "test.read" => Some(Access::Read),
            "test.change" => Some(Access::Control),
            _ => None,
        }
    }

    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>> {
        match method {
            "test.read" => Some(Ok(params.clone())),
            "test.change" => Some(access.need_control(method).map(|()| json!("changed"))),
            _ => None,
        }
    }
}

#[test]
fn idle_bus_serves_sdo_and_extensions() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("idle.sock");
    let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
    let config = ServiceConfig::new(&path).with_extension(Counter);
    let service = Service::of_bus(&backend.ecrt, 0, config).unwrap();
    let client = Client::connect(&path, "test").unwrap();
    assert!(client.hello().gateways.is_empty());
    wait_for("the slave", || client.slaves().is_ok_and(|slaves| slaves.len() == 1));
    wait_for("its mailbox", || client.sdo_upload(&upload(0, 0x8001, 19)).is_ok());
    assert_eq!(client.state().unwrap_err().rpc().unwrap().code, NOT_AVAILABLE);
    assert_eq!(client.call("test.read", json!({"a": 1})).unwrap(), json!({"a": 1}));
    let error = client.call("test.change", Value::Null).unwrap_err();
    assert_eq!(error.rpc().unwrap().code, NOT_PERMITTED);
    service.notify("sim.fault", json!({"time_ns": 5}));
    let expected =
        Event::Notification { method: "sim.fault".into(), params: json!({"time_ns": 5}) };
    assert_eq!(client.poll(PATIENCE).unwrap(), Some(expected));
    drop(service);
    assert!(!exists(&path));
    assert!(client.poll(Duration::from_secs(1)).is_err());
}
