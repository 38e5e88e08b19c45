//! Snapshots for the tests of the views.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::protocol::{Access, AxisState, ClientStats, ServiceStats};

use super::snapshot::{
    AxesView, ChannelView, CycleView, Direction, Errors, Event, GatewayState, GatewayView, Head,
    IdView, Snapshot, Times,
};
use crate::frames::Signals;

fn times(min_us: f64, p50_us: f64, max_us: f64) -> Times {
    Times {
        min_us,
        p50_us,
        p95_us: Some(p50_us + 4.3),
        p99_us: p50_us + 10.1,
        p99_9_us: Some(p50_us + 44.4),
        max_us,
    }
}

fn channel(load: f64) -> ChannelView {
    ChannelView {
        state: Some("run".to_owned()),
        rx_per_second: load * 4500.0,
        received: 120_400,
        load,
        errors: Some(Errors::default()),
        ..ChannelView::default()
    }
}

fn gateway(position: usize) -> GatewayView {
    GatewayView {
        position,
        state: GatewayState::Ready,
        working_counter: 3,
        expected_working_counter: 3,
        times_in_service: 1,
        channels: [channel(0.402), channel(0.1), channel(0.0), channel(0.0)],
        ..GatewayView::default()
    }
}

pub fn healthy(gateways: usize) -> Snapshot {
    Snapshot {
        head: Head { seconds: 61.7, is_simulated: true, ..Head::default() },
        cycle: CycleView {
            cycle_us: 1000.0,
            cycles: 61_700,
            overruns: 1,
            skipped: 2,
            period: Some(times(948.2, 1000.0, 2013.9)),
            run_time: times(11.0, 13.4, 87.5),
            histogram: Some([0, 31, 5_000, 50_000, 6_000, 668, 1]),
            ..CycleView::default()
        },
        gateways: (0..gateways).map(gateway).collect(),
        events: vec![Event { seconds: 0.9, words: "gateway 0: ready".to_owned() }],
        axes: AxesView {
            without_axes: Some(
                "no axes: this command runs the cycle itself and configures no drives".to_owned(),
            ),
            ..AxesView::default()
        },
        ..Snapshot::default()
    }
}

pub fn bus_off() -> Snapshot {
    let mut snapshot = healthy(1);
    snapshot.gateways[0].channels[1] = ChannelView {
        state: Some("bus-off".to_owned()),
        is_bus_off: true,
        has_warning: true,
        tx_pending: 7,
        errors: Some(Errors { transmit: 255, receive: 3, dropped: 12, bus_offs: 2 }),
        ..ChannelView::default()
    };
    snapshot
}

pub fn lost() -> Snapshot {
    let mut snapshot = healthy(2);
    let channels = std::array::from_fn(|_| ChannelView::default());
    snapshot.gateways[1] = GatewayView {
        state: GatewayState::Lost,
        reason: "waiting for OP".to_owned(),
        working_counter: 0,
        incomplete_cycles: 812,
        times_lost: 1,
        channels,
        ..gateway(1)
    };
    snapshot.events.push(Event { seconds: 60.9, words: "gateway 1: lost".to_owned() });
    snapshot
}

/// Observed through a service, with losses.
pub fn through_service() -> Snapshot {
    let mut snapshot = healthy(1);
    let Head { program, frames_lost, .. } = &mut snapshot.head;
    (*program, *frames_lost) = (Some("cell 1.0 (pid 4711)".to_owned()), 1234);
    let sampled = |times: Times| Times { p95_us: None, p99_9_us: None, ..times };
    let cycle = &mut snapshot.cycle;
    (cycle.period, cycle.histogram, cycle.sampled) = (None, None, Some(1230));
    cycle.run_time = sampled(cycle.run_time);
    cycle.late = Some(sampled(times(0.4, 3.1, 61.0)));
    let client = |(name, access, lost): (&str, _, _)| ClientStats {
        id: 1,
        name: name.to_owned(),
        pid: 812,
        uid: 0,
        access,
        connected_ms: 0,
        requests: 5,
        requests_rejected: 0,
        requests_expired: 0,
        frames_delivered: 120_400,
        frames_lost: lost,
        images_delivered: 0,
        images_lost: 0,
        frames_accepted: 77,
        frames_rejected: 1,
        frames_pending: 2,
        queued_bytes: 0,
    };
    let clients = [
        ("ecan", Access::Control, 0),
        ("ecan monitor", Access::Read, 1234),
        ("a client with a long name", Access::Control, 0),
    ];
    snapshot.service = Some(ServiceStats {
        images_lost_in_ring: 3,
        frames_lost_in_ring: 41,
        clients: clients.into_iter().map(client).collect(),
        ..ServiceStats::default()
    });
    snapshot
}

/// CAN IDs of two channels, more than a screen.
pub fn ids() -> Snapshot {
    let mut snapshot = healthy(1);
    let id = |raw: u32| CanId::new(raw, raw > 0x7FF).unwrap();
    let row = |at: u64, frame: CanFrame| IdView {
        gateway: 0,
        channel: 0,
        direction: Direction::Received,
        frame,
        count: 1000 - at,
        period_ns: Some(10_000_000 + at * 250_000),
        mean_period_ns: Some(10_250_000 + (at % 7) * 1_000_000),
        age_ns: (at % 5) * 1_300_000_000,
        changed: 0b10,
    };
    for at in 0..30 {
        let data = [at as u8, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77];
        let frame = CanFrame::classic(id(0x180 + at), &data).unwrap();
        snapshot.ids.ids.push(row(at.into(), frame));
    }
    let long = std::array::from_fn::<_, 64, _>(|at| at as u8);
    let others = [
        (Direction::Received, CanFrame::classic(id(0x7FF), &[]).unwrap(), 0),
        (Direction::Received, CanFrame::classic(id(0x1234_5678), &[1, 2, 3]).unwrap(), 0b111),
        (Direction::Sent, CanFrame::classic(id(0x1234_5678), &[1, 2, 3]).unwrap(), 0),
        (Direction::Failed, CanFrame::classic(id(0x1234_5679), &[0xFF]).unwrap(), 0),
        (Direction::Received, CanFrame::fd(id(0x1ABC_DEF0), &long, true, false).unwrap(), 0x70E),
    ];
    for (at, (direction, frame, changed)) in (30..).zip(others) {
        let period_ns = (at != 30).then_some(1_234_567_890);
        snapshot.ids.ids.push(IdView {
            channel: 1,
            direction,
            changed,
            period_ns,
            mean_period_ns: period_ns,
            ..row(at, frame)
        });
    }
    snapshot.ids.not_listed = 17;
    snapshot
}

/// Signals of the second frame of [`ids`].
pub fn with_signals(snapshot: Snapshot) -> Snapshot {
    let file = "BO_ 385 Drive: 8 X\n \
                SG_ Speed : 0|16@1+ (0.1,0) [0|0] \"km/h\" X\n \
                SG_ Torque : 16|8@1- (0.5,0) [0|0] \"Nm\" X\n \
                SG_ State : 24|8@1+ (1,0) [0|0] \"\" X\n \
                SG_ Temperature : 32|8@1+ (1,-40) [0|0] \"degC\" X\n \
                SG_ Voltage : 40|16@1+ (0.01,0) [0|0] \"V\" X\n\
                VAL_ 385 State 51 \"Running\" ;\n";
    let signals = Signals::of_text(file);
    Snapshot { signals: signals.into(), ..snapshot }
}

/// An axis that follows targets, and one in fault.
pub fn axes() -> Snapshot {
    let running = AxisState {
        channel: 1,
        node_id: 3,
        phase: "following targets".to_owned(),
        elapsed_ns: 12_340_000_000,
        mode: "CSP".to_owned(),
        statusword: Some(0x1237),
        drive_state: Some("operation enabled".to_owned()),
        nmt_state: Some("operational".to_owned()),
        heartbeat: "active".to_owned(),
        actual: Some(-2_147_483_648),
        actual_age: 1,
        actual_degrees: Some(-90.5),
        target: Some(-2_147_483_600),
        following_error: Some(48),
        is_configured: true,
        is_running: true,
        ..AxisState::default()
    };
    let faulty = AxisState {
        node_id: 4,
        phase: "stopped: hold, the drive's heartbeat timed out".to_owned(),
        error: Some("the drive is in fault".to_owned()),
        statusword: Some(0x0218),
        drive_state: Some("fault".to_owned()),
        error_code: 0x8611,
        heartbeat: "timed out".to_owned(),
        actual_age: u16::MAX,
        hold_reason: Some("the drive's heartbeat timed out".to_owned()),
        stop_cause: Some("hold, the drive's heartbeat timed out".to_owned()),
        is_running: false,
        is_stopped: true,
        ..running.clone()
    };
    let fresh = AxisState {
        node_id: 5,
        phase: "not configured".to_owned(),
        statusword: None,
        drive_state: None,
        nmt_state: None,
        heartbeat: "none received yet".to_owned(),
        actual: None,
        target: None,
        following_error: None,
        is_running: false,
        ..running.clone()
    };
    let mut snapshot = through_service();
    snapshot.axes = AxesView { without_axes: None, axes: vec![running, faulty, fresh] };
    snapshot
}
