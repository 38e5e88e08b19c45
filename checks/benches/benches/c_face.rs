//! Cost of the C interface over the Rust call: frames sent and received within a cycle, through
//! `igh_mcan_port_send_can` and `igh_mcan_port_receive` against `Port::send_can` and
//! `Port::receive`.
//!
//! Both run on a simulated gateway of their own with an echo node, cycle by cycle in turn; only the
//! calls are timed, not the simulation. Prints the medians and their ratios.
#![allow(missing_docs)]

#[path = "../../../capi/igh-host/tests/c_port/mod.rs"]
mod c_port;

use std::time::Instant;

use c_port::CPort;
use ecan_bench::measure::{Row, median, print_rows};
use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_host::AdapterConfig;
use ecan_igh_host::mcan_port::cycle::{
    igh_mcan_port_cycle_begin, igh_mcan_port_cycle_end, igh_mcan_port_receive,
    igh_mcan_port_send_can, igh_mcan_port_wait_next_cycle,
};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, Received, TransmitReport};
use ecan_protocol::can::{CanId, FrameRef};
use ecan_protocol::image::ResultCode;
use ecan_sim::{ClockKind, EcrtSetting, SimOptions};

/// Frames sent in a cycle: what an image of N = 8 holds comfortably. The gateway sends some of them
/// on, and their echoes come back later.
const FRAMES: u32 = 60;
const CYCLES: usize = 10_000;
const WARM_UP: usize = 100;
/// Frames that a receive takes at most.
const CAPACITY: usize = 255;

/// Nanoseconds per frame, of each cycle.
#[derive(Default)]
struct Times {
    send: Vec<f64>,
    receive: Vec<f64>,
}

impl Times {
    fn add(&mut self, cycle: usize, marks: [Instant; 3], received: usize) {
        if cycle < WARM_UP {
            return;
        }
        let per_frame = |from: Instant, to: Instant, frames| (to - from).as_nanos() as f64 / frames;
        if received > 0 {
            self.receive.push(per_frame(marks[0], marks[1], received as f64));
        }
        self.send.push(per_frame(marks[1], marks[2], FRAMES.into()));
    }

    fn medians(self) -> (f64, f64) {
        (median(self.send), median(self.receive))
    }
}

fn rust_port() -> Port {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let setting = EcrtSetting::parse("sim:echo");
    let backend = ecan_sim::open(&setting, &options).unwrap();
    let gateway = GatewayConfig {
        paced: false,
        ..GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000))
    };
    let config = PortConfig::uniform(1, gateway);
    let mut port =
        Port::open(&backend.ecrt, (AdapterConfig::new(1).with_multiplier(8), config)).unwrap();
    port.wait_ready().unwrap();
    port
}

fn main() {
    let mut rust = rust_port();
    let can0 = rust.channel(0, 0).unwrap();
    let mut c = CPort::ready(1);
    let (mut through_rust, mut through_c) = (Times::default(), Times::default());
    let data = [1, 2, 3, 4, 5, 6, 7, 8];
    let placeholder = Received::TransmitReport(TransmitReport {
        ticket: None,
        slave: 0,
        channel: 0,
        code: ResultCode::Ok,
        schedule_tag: None,
    });
    let mut items = vec![placeholder; CAPACITY];
    let mut frames = vec![igh_mcan_rx_frame_t::EMPTY; CAPACITY];
    let port = c.port();

    for cycle in 0..ecan_bench::measure::rounds(CYCLES) + WARM_UP {
        let mut open = rust.next_cycle();
        let start = Instant::now();
        let received = open.receive(&mut items);
        let middle = Instant::now();
        for n in 0..FRAMES {
            let id = CanId::new(0x100 + n, false).unwrap();
            open.send(can0, FrameRef::classic(id, &data).unwrap()).unwrap();
        }
        through_rust.add(cycle, [start, middle, Instant::now()], received);
        open.end().unwrap();

        // SAFETY: every pointer is valid.
        unsafe {
            igh_mcan_port_wait_next_cycle(port);
            assert_eq!(igh_mcan_port_cycle_begin(port), 0);
            let mut received = 0;
            let start = Instant::now();
            igh_mcan_port_receive(port, frames.as_mut_ptr(), CAPACITY, &mut received);
            let middle = Instant::now();
            for n in 0..FRAMES {
                let sent = igh_mcan_port_send_can(port, 0, 0, 0x100 + n, 0, data.as_ptr(), 8);
                assert_eq!(sent, 0);
            }
            through_c.add(cycle, [start, middle, Instant::now()], received);
            assert_eq!(igh_mcan_port_cycle_end(port), 0);
        }
    }

    let (rust, c) = (through_rust.medians(), through_c.medians());
    println!("per frame, in ns       Rust      C   C over Rust");
    let row =
        |name, rust: f64, c: f64| println!("{name:<20} {rust:>6.1} {c:>6.1} {:>8.3}", c / rust);
    row("send_can", rust.0, c.0);
    row("receive", rust.1, c.1);
    row("send_can + receive", rust.0 + rust.1, c.0 + c.1);
    let ratio = (c.0 + c.1) / (rust.0 + rust.1);
    print_rows(&[Row::new("C face, send_can and receive", "C functions / Port, per frame", ratio)]);
}
