//! Frames to two gateways in PREOP: datagrams with any command, address and data, and any bytes with
//! the EtherType of EtherCAT. Each input begins with a copy of one line.
#![no_main]

#[path = "../support/line_check.rs"]
mod line_check;
#[path = "../../../ecan-sim/tests/wire_support/mod.rs"]
mod wire_support;

use libfuzzer_sys::fuzz_target;
use line_check::{Bytes, check_counters, exchange, pass_raw};
use wire_support::Line;

thread_local! {
    static PREOP: Line = Line::preop(2);
}

fuzz_target!(|data: &[u8]| {
    let mut line = PREOP.with(Line::try_clone).expect("echo nodes can be copied");
    let mut rest = Bytes(data);
    // A frame takes longer than the choice of the next input.
    for _ in 0..64 {
        if rest.0.is_empty() {
            break;
        }
        match rest.byte() {
            0..0xD0 => {
                line.pass(100_000);
                let _ = exchange(&mut line, &[rest.datagram()]);
            }
            0xD0..0xE0 => {
                let _ = exchange(&mut line, &[rest.datagram(), rest.datagram(), rest.datagram()]);
            }
            0xE0..0xF0 => line.pass(u64::from(rest.byte()) * 1_000_000),
            _ => {
                let length = usize::from(rest.byte());
                pass_raw(&mut line, rest.take(length));
            }
        }
    }
    check_counters(&line);
});
