//! What the C face costs over the Rust call: frames sent and received within a cycle, through
//! `igh_mcan_port_send_can` and `igh_mcan_port_receive` against `Port::send_can` and
//! `Port::receive`.
//!
//! Both run on a simulated gateway of their own with an echo node, cycle by cycle in turn; only the
//! calls are timed, not the simulation. Prints the medians and their ratio.
#![allow(missing_docs)]

#[path = "../tests/c_port/mod.rs"]
mod c_port;

use std::time::Instant;

use c_port::CPort;
use ecan_host::AdapterConfig;
use ecan_igh_host::mcan_port::cycle::{
    igh_mcan_port_cycle_begin, igh_mcan_port_cycle_end, igh_mcan_port_receive,
    igh_mcan_port_wait_next_cycle,
};
use ecan_igh_host::mcan_port::send::igh_mcan_port_send_can;
use ecan_mcan_host::pdo::frames::igh_mcan_rx_frame_t;
use ecan_mcan_port::{ChannelSettings, GatewayConfig, Port, PortConfig, Received};
use ecan_protocol::CanId;
use ecan_sim::{ClockKind, EcrtSetting, SimOptions};

/// Frames sent in a cycle; the echo node's answers come back later.
const FRAMES: usize = 8;
const CYCLES: usize = 20_000;
const WARM_UP: usize = 100;
/// Frames that a receive takes at most.
const CAPACITY: usize = 64;

struct Through {
    nanoseconds: Vec<f64>,
    received: usize,
}

impl Through {
    fn new() -> Self {
        Self { nanoseconds: Vec::with_capacity(CYCLES), received: 0 }
    }

    fn add(&mut self, cycle: usize, start: Instant, received: usize) {
        let time = start.elapsed().as_nanos() as f64;
        if cycle >= WARM_UP {
            self.nanoseconds.push(time);
            self.received += received;
        }
    }

    fn median(&mut self) -> f64 {
        self.nanoseconds.sort_by(f64::total_cmp);
        self.nanoseconds[self.nanoseconds.len() / 2]
    }
}

fn rust_port() -> Port {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let setting = EcrtSetting::parse("sim:echo").unwrap();
    let backend = ecan_sim::open(&setting, &options).unwrap();
    let gateway = GatewayConfig {
        paced: false,
        ..GatewayConfig::on_channel(0, ChannelSettings::classic(1_000_000))
    };
    let config = PortConfig::uniform(1, gateway);
    let mut port = Port::open(&backend.ecrt, AdapterConfig::new(1), config).unwrap();
    port.wait_ready(30_000).unwrap();
    port
}

fn main() {
    let mut rust = rust_port();
    let mut c = CPort::ready(1);
    let (mut through_rust, mut through_c) = (Through::new(), Through::new());
    let data = [1, 2, 3, 4, 5, 6, 7, 8];
    let mut items = Vec::new();
    let placeholder = Received::TransmitReport(ecan_mcan_port::TransmitReport {
        ticket: None,
        slave: 0,
        channel: 0,
        code: ecan_protocol::ResultCode::Ok,
    });
    items.resize(CAPACITY, placeholder);
    let mut frames = vec![igh_mcan_rx_frame_t::EMPTY; CAPACITY];
    let port = c.port();

    for cycle in 0..CYCLES + WARM_UP {
        rust.wait_next_cycle();
        rust.cycle_begin().unwrap();
        let start = Instant::now();
        let received = rust.receive(&mut items);
        for n in 0..FRAMES as u32 {
            let id = CanId::new(0x100 + n, false).unwrap();
            rust.send_can(0, 0, id, &data).unwrap();
        }
        through_rust.add(cycle, start, received);
        rust.cycle_end().unwrap();

        // SAFETY: every pointer is valid.
        unsafe {
            igh_mcan_port_wait_next_cycle(port);
            assert_eq!(igh_mcan_port_cycle_begin(port), 0);
            let start = Instant::now();
            let mut received = 0;
            igh_mcan_port_receive(port, frames.as_mut_ptr(), CAPACITY, &mut received);
            for n in 0..FRAMES as u32 {
                let sent = igh_mcan_port_send_can(port, 0, 0, 0x100 + n, 0, data.as_ptr(), 8);
                assert_eq!(sent, 0);
            }
            through_c.add(cycle, start, received);
            assert_eq!(igh_mcan_port_cycle_end(port), 0);
        }
    }
    let (in_rust, in_c) = (through_rust.median(), through_c.median());
    println!(
        "{FRAMES} frames sent and those due received, per cycle: {in_rust:.0} ns in Rust ({} frames \
         received), {in_c:.0} ns through C ({} received)",
        through_rust.received, through_c.received
    );
    println!("C over Rust: {:.3}", in_c / in_rust);
}
