//! Frames of a running bus: received, transmitted, results, losses.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::common::{Fixture, Limit, PATIENCE, frame, next, wait_for};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::OptionFlags;
use ecan_service::client::{
    Client, Event, EventKind, FrameEvent, FrameReport, IdFilter, ImageSubscription, RejectReason,
    SendError, SessionState, Subscription,
};
use ecan_service::server::{Control, ServePort as _, Service, ServiceConfig};
use ecan_sim::{ClockKind, Fault, SimOptions, Simulation};

fn next_frame(client: &Client) -> FrameReport {
    match next(client) {
        Event::Frame(report) => report,
        other => panic!("{other:?}"),
    }
}

#[test]
fn sent_frame_is_echoed_with_its_tag_and_seen_by_others() {
    let fixture = Fixture::start(|_| ());
    let (sender, other) = (fixture.client(), fixture.client());
    other.subscribe(&Subscription::default()).unwrap();
    let sent = frame(0x123, &[1, 2, 3]);
    let tag = sender.send(0, 0, &sent).unwrap();
    let own = next_frame(&sender);
    assert_eq!((own.event, own.tag, own.frame), (FrameEvent::Transmitted, tag, sent));
    assert_eq!(sender.in_flight(0, 0), 0);
    // The other client sees the transmission without the tag, and the answer of the echo node.
    let events = [next_frame(&other), next_frame(&other)];
    let kinds = events.map(|report| (report.event, report.tag));
    assert!(kinds.contains(&(FrameEvent::Transmitted, 0)), "{events:?}");
    assert!(kinds.contains(&(FrameEvent::Received, 0)), "{events:?}");
    assert!(events.iter().all(|report| report.time_ns > 0 && report.channel == 0));
    // The sender has no subscription.
    assert_eq!(sender.poll(Duration::ZERO).unwrap(), None);
}

#[test]
fn fd_frame_and_wrong_frames_have_their_events() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    let fd = CanFrame::fd(CanId::extended(0x1234_5678).unwrap(), &[9; 64], true, false).unwrap();
    client.send(0, 1, &fd).unwrap();
    let report = next_frame(&client);
    assert_eq!((report.event, report.frame, report.channel), (FrameEvent::Transmitted, fd, 1));
    for (gateway, channel, frame, reason) in [
        (0, 0, fd, RejectReason::NotFd),
        (0, 2, frame(1, &[]), RejectReason::NoSuchChannel),
        (7, 0, frame(1, &[]), RejectReason::NoSuchChannel),
    ] {
        let tag = client.send(gateway, channel, &frame).unwrap();
        let report = next_frame(&client);
        assert_eq!((report.event, report.tag), (FrameEvent::Rejected(reason), tag));
        assert_eq!(client.in_flight(gateway, channel), 0);
    }
}

#[test]
fn gateway_without_results_reports_published_frames() {
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000));
    assert!(!gateway.tx_options.contains(OptionFlags::TX_RESULT));
    let fixture = Fixture::with_gateway(gateway, |_| ());
    let client = fixture.client();
    assert!(!client.hello().gateways[0].has_results);
    client.send(0, 0, &frame(5, &[])).unwrap();
    assert_eq!(next_frame(&client).event, FrameEvent::Published);
}

#[test]
fn window_limits_frames_without_result() {
    let fixture = Fixture::start(|config| config.window = 4);
    let client = fixture.client();
    assert_eq!(client.hello().window, 4);
    let mut sent = 0;
    let mut was_full = false;
    let mut finished = 0;
    let limit = Limit::start();
    while finished < 200 {
        limit.check("the results");
        while sent < 200 {
            match client.send(0, 0, &frame(1, &[])) {
                Ok(_) => sent += 1,
                Err(SendError::WindowFull { window: 4, .. }) => {
                    was_full = true;
                    break;
                }
                Err(error) => panic!("{error}"),
            }
        }
        assert!(client.in_flight(0, 0) <= 4);
        while let Some(event) = client.poll(Duration::from_millis(1)).unwrap() {
            let Event::Frame(report) = event else { panic!("{event:?}") };
            assert_eq!(report.event, FrameEvent::Transmitted);
            finished += 1;
        }
    }
    assert!(was_full);
}

#[test]
fn subscription_selects_frames() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    let filter = IdFilter { id: 0x102, mask: 0x7FF };
    let kinds = vec![EventKind::Transmitted];
    client.subscribe(&Subscription { kinds, filters: vec![filter], ..Default::default() }).unwrap();
    fixture.frames_per_cycle.store(4, Ordering::Release);
    for _ in 0..20 {
        let report = next_frame(&client);
        assert_eq!((report.event, report.tag), (FrameEvent::Transmitted, 0));
        assert_eq!(report.frame.id().raw(), 0x102);
    }
    client.unsubscribe().unwrap();
    while client.poll(Duration::ZERO).unwrap().is_some() {}
    assert_eq!(client.poll(Duration::from_millis(20)).unwrap(), None);
}

/// Every frame that the Port counts reaches both clients or is a counted loss.
#[test]
fn slow_client_counts_exactly_what_it_loses() {
    let fixture = Fixture::start(|config| config.queue_bytes = 16 << 10);
    let before = fixture.statistics().channels[0].frames_received;
    let (slow, fast) = (fixture.client(), fixture.client());
    let received = || Subscription { kinds: vec![EventKind::Received], ..Default::default() };
    slow.subscribe(&received()).unwrap();
    fast.subscribe(&received()).unwrap();
    fixture.frames_per_cycle.store(6, Ordering::Release);
    let mut fast_counts = (0, 0);
    // The fast client reads all the time, the slow one nothing.
    wait_for("a loss of the slow client", || {
        read_all(&fast, &mut fast_counts);
        let stats = fast.service_stats().unwrap();
        stats.clients.iter().any(|client| client.frames_lost > 500)
    });
    fixture.frames_per_cycle.store(0, Ordering::Release);
    let count = || fixture.statistics().channels[0].frames_received;
    let mut last = 0;
    wait_for("the end of the frames", || {
        fixture.run_cycles(50);
        std::mem::replace(&mut last, count()) == last
    });
    let published = last - before;
    let mut slow_counts = (0, 0);
    for (client, counts) in [(&fast, &mut fast_counts), (&slow, &mut slow_counts)] {
        wait_for("all frames of a client", || {
            read_all(client, counts);
            counts.0 + counts.1 >= published
        });
        assert_eq!(counts.0 + counts.1, published);
    }
    let stats = fast.service_stats().unwrap();
    assert_eq!(stats.frames_lost_in_ring, 0);
    let in_service = |at: usize| {
        let client = &stats.clients[at];
        (client.frames_delivered, client.frames_lost)
    };
    assert_eq!((in_service(0), in_service(1)), (slow_counts, fast_counts));
}

/// Adds frames and losses.
fn read_all(client: &Client, counts: &mut (u64, u64)) {
    while let Some(event) = client.poll(Duration::ZERO).unwrap() {
        match event {
            Event::Frame(_) => counts.0 += 1,
            Event::Lost(lost) => counts.1 += lost.frames + lost.frames_in_client,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn images_have_both_directions() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    client.subscribe_images(&ImageSubscription::default()).unwrap();
    fixture.frames_per_cycle.store(1, Ordering::Release);
    let mut directions = Vec::new();
    wait_for("images of both directions", || {
        if let Event::Image(image) = next(&client) {
            assert_eq!(image.image.len(), image.profile.pdo_bytes());
            directions.push(image.direction);
        }
        directions.contains(&directions[0])
            && directions.iter().any(|direction| *direction != directions[0])
    });

    client.unsubscribe_images().unwrap();
    // What arrived before the response.
    while client.poll(Duration::ZERO).unwrap().is_some() {}
    client.subscribe(&Subscription::default()).unwrap();
    for _ in 0..50 {
        next_frame(&client);
    }
}

#[test]
fn reconfiguration_reports_gateways_and_frames_continue() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    fixture.execute(|port, service| {
        let adapter = *port.adapter().config();
        let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(500_000));
        port.reconfigure((adapter, ecan_mcan_port::PortConfig::uniform(1, gateway))).unwrap();
        service.attach(port);
        port.wait_ready().unwrap();
    });
    let Event::Gateways(changed) = next(&client) else { panic!("no notification") };
    assert_eq!(changed.gateways[0].channels[0].bitrate, 500_000);
    assert_eq!(changed.gateways[0].channels.len(), 1);
    client.send(0, 0, &frame(7, &[])).unwrap();
    assert_eq!(next_frame(&client).event, FrameEvent::Published);
}

/// A Port in stepped time whose cycle runs on the thread of the test, with a client of its service.
struct Stepped {
    port: Port,
    service: Service,
    client: Client,
    simulation: Simulation,
    directory: tempfile::TempDir,
}

impl Stepped {
    fn start() -> Self {
        Self::with(GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000)), |_| ())
    }

    fn with(gateway: GatewayConfig, change: impl FnOnce(&mut ServiceConfig)) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        // A slave leaves OP when its watchdog expires: not in a pause of a test.
        let adapter = AdapterConfig::new(1)
            .with_cycle(Duration::from_millis(1))
            .with_watchdog(Duration::from_secs(6));
        let config = (adapter, PortConfig::uniform(1, gateway));
        let mut port = Port::open(&backend.ecrt, config).unwrap();
        let path = directory.path().join("master0.sock");
        let mut config = ServiceConfig::new(&path).with_control(Control::Owner);
        change(&mut config);
        let service = port.serve(config).unwrap();
        port.wait_ready().unwrap();
        let client = Client::connect(&path, "test").unwrap();
        Self { port, service, client, simulation: backend.simulation.unwrap(), directory }
    }

    fn connect(&self) -> Client {
        Client::connect(self.service.path(), "test").unwrap()
    }

    fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            self.port.next_cycle().finish();
        }
    }
}

/// Sends a frame; returns once it is in the queue of the cycle.
fn queue_frame(client: &Client) {
    client.send(0, 0, &frame(5, &[])).unwrap();
    client.state().unwrap();
}

/// Lets time pass without a cycle, as while the process is stopped, and the service see it.
fn pause(port: &Port, client: &Client, pause: Duration) {
    let clock = port.adapter().clock();
    clock.sleep_until_ns(clock.now_ns() + pause.as_nanos() as u64);
    client.state().unwrap();
}

#[test]
fn pause_of_the_host_loses_no_result() {
    let mut bus = Stepped::with(super::common::gateway(), |_| ());
    for number in 0..50 {
        bus.client.send(0, 0, &frame(0x100 + number, &[])).unwrap();
        bus.client.state().unwrap();
        bus.cycles(1);
        pause(&bus.port, &bus.client, Duration::from_secs(5));
        assert_eq!(bus.client.poll(Duration::ZERO).unwrap(), None, "the result is not known");
        bus.cycles(10);
        let report = next_frame(&bus.client);
        assert_eq!(report.event, FrameEvent::Transmitted);
        assert_eq!(report.frame.id().raw(), u32::from(0x100 + number));
    }
    let stats = bus.client.service_stats().unwrap().clients[0].clone();
    assert_eq!((stats.frames_accepted, stats.frames_pending), (50, 0));
}

#[test]
fn frames_of_a_lost_session_end_as_transmitted_or_unknown() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    let accepted = || client.service_stats().unwrap().clients[0].frames_accepted;
    for _ in 0..3 {
        let (mut sent, mut ended) = (0, 0);
        fixture.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 200 });
        let limit = Limit::start();
        while sent < 100 {
            limit.check("room for the frames");
            if client.send(0, 0, &frame(1, &[])).is_ok() {
                sent += 1;
            }
            while let Some(event) = client.poll(Duration::ZERO).unwrap() {
                let Event::Frame(report) = event else { panic!("{event:?}") };
                let not_ready = FrameEvent::Rejected(RejectReason::NotReady);
                let expected = [FrameEvent::Transmitted, FrameEvent::Unknown, not_ready];
                assert!(expected.contains(&report.event), "{report:?}");
                ended += 1;
            }
        }
        // Without a further image of the gateway.
        while ended < sent {
            let Event::Frame(_) = next(&client) else { panic!("no frame") };
            ended += 1;
        }
        assert_eq!(client.in_flight(0, 0), 0);
        wait_for("the gateway", || {
            client.state().unwrap().gateways[0].session == SessionState::Ready
        });
    }
    assert_eq!(accepted(), 300);
}

/// While the gateway is off no image of it arrives that could end them.
#[test]
fn frames_of_a_gateway_that_stays_away_end_without_result() {
    let mut bus = Stepped::with(super::common::gateway(), |_| ());
    queue_frame(&bus.client);
    bus.cycles(1);
    bus.simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 60_000 });
    bus.cycles(50);
    assert_ne!(bus.client.state().unwrap().gateways[0].session, SessionState::Ready);
    assert_eq!(next_frame(&bus.client).event, FrameEvent::Unknown);
    assert_eq!(bus.client.in_flight(0, 0), 0);
}

#[test]
fn frames_of_many_clients_that_find_the_queue_full_are_rejected_as_such() {
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000));
    let mut bus = Stepped::with(gateway, |config| config.window = 1);
    let clients: Vec<Client> = (0..40).map(|_| bus.connect()).collect();
    clients.iter().for_each(queue_frame);
    bus.cycles(20);
    let events: Vec<FrameEvent> = clients.iter().map(|client| next_frame(client).event).collect();
    let (published, rest) =
        events.split_at(events.iter().take_while(|event| **event == FrameEvent::Published).count());
    assert!(published.len() >= 4, "{events:?}");
    assert!(!rest.is_empty(), "40 frames fit");
    let full = FrameEvent::Rejected(RejectReason::QueueFull);
    assert!(rest.iter().all(|event| *event == full), "{events:?}");
}

#[test]
fn frame_older_than_its_limit_is_rejected() {
    let mut bus = Stepped::start();
    let (short, long) = (Duration::from_millis(5), Duration::from_secs(60));
    bus.client.send_within(0, 0, &frame(1, &[]), short).unwrap();
    bus.client.send_within(0, 0, &frame(2, &[]), long).unwrap();
    bus.client.send(0, 0, &frame(3, &[])).unwrap();
    bus.client.state().unwrap();
    pause(&bus.port, &bus.client, Duration::from_secs(11));
    bus.cycles(2);
    let mut events = [(); 3].map(|()| next_frame(&bus.client));
    events.sort_by_key(|report| report.frame.id().raw());
    let expired = FrameEvent::Rejected(RejectReason::Expired);
    // The last one has the default limit of 10 s.
    assert_eq!(events.map(|report| report.event), [expired, FrameEvent::Published, expired]);
}

#[test]
fn end_of_service_after_a_cycle_reports_what_it_sent() {
    let Stepped { mut port, mut service, mut client, directory: _directory, .. } = Stepped::start();
    for _ in 0..50 {
        queue_frame(&client);
        port.next_cycle().finish();
        let path = service.path().to_owned();
        drop(service);
        assert_eq!(next_frame(&client).event, FrameEvent::Published);
        service = port.serve(ServiceConfig::new(&path).with_control(Control::Owner)).unwrap();
        client = Client::connect(&path, "test").unwrap();
    }
}

#[test]
fn end_of_service_leaves_queued_frames_without_result() {
    let Stepped { mut port, service, client, directory: _directory, .. } = Stepped::start();
    queue_frame(&client);
    let accepted =
        |port: &Port| port.statistics(port.gateway(0).unwrap()).channels[0].frames_accepted;
    drop(service);
    // The frame is still in the queue, from which the next cycle takes it.
    let event = next_frame(&client).event;
    assert_eq!(event, FrameEvent::Unknown);
    assert_eq!(accepted(&port), 0);
    port.next_cycle().finish();
    assert_eq!(accepted(&port), 1);
}

#[test]
fn end_of_port_rejects_queued_frames() {
    let Stepped { port, service: _service, client, directory: _directory, .. } = Stepped::start();
    queue_frame(&client);
    drop(port);
    assert_eq!(next_frame(&client).event, FrameEvent::Rejected(RejectReason::Closed));
}

#[test]
fn detached_service_ends_frames_and_keeps_the_connection() {
    let fixture = Fixture::start(|_| ());
    let client = fixture.client();
    fixture.execute(|_, service| service.detach());
    let Event::Gateways(changed) = client.poll(PATIENCE).unwrap().unwrap() else { panic!() };
    assert!(changed.gateways.is_empty() && changed.cycle_ns.is_none());
    let tag = client.send(0, 0, &frame(7, &[])).unwrap();
    let report = next_frame(&client);
    let expected = (FrameEvent::Rejected(RejectReason::NoSuchChannel), tag);
    assert_eq!((report.event, report.tag), expected);
    assert!(client.state().unwrap_err().to_string().contains("no cycle"));
    assert_eq!(client.slaves().unwrap().len(), 1);
}
