//! EEPROM of a slave controller with any words in it: the gateway starts, its memory is read through the
//! registers, and the line responds.
#![no_main]

#[path = "../support/line_check.rs"]
mod line_check;
#[path = "../../../ecan-sim/tests/wire_support/mod.rs"]
mod wire_support;

use ecan_sim::echo;
use libfuzzer_sys::fuzz_target;
use line_check::{Bytes, check_counters, exchange};
use wire_support::{Datagram, Line, command};

const MS: u64 = 1_000_000;

thread_local! {
    static INIT: Line = {
        let mut scenario = echo(1);
        scenario.gateways[0].config.boot_ms = 1;
        Line::with(&scenario)
    };
}

fuzz_target!(|data: &[u8]| {
    let mut line = INIT.with(Line::try_clone).expect("echo nodes can be copied");
    let mut input = Bytes(data);
    let (words, first) = (input.byte(), input.word());
    line.wire.world_mut().with_gateway(0, |gateway, now| {
        let first = first % 0x80;
        for word in first..first + u16::from(words) {
            if input.0.is_empty() {
                break;
            }
            gateway.write_eeprom(word, input.word());
        }
        gateway.power(now, false);
        gateway.power(now, true);
    });
    line.pass(2 * MS);
    // requests of a master to the EEPROM interface, and what they change
    for _ in 0..16 {
        if input.0.is_empty() {
            break;
        }
        let (offset, length) =
            (0x0500 + u16::from(input.byte() % 16), usize::from(input.byte() % 12));
        let write = Datagram::new(command::APWR, 0, offset, input.take(length));
        let read = Datagram::new(command::APRD, 0, 0x0500, &[0; 16]);
        let _ = exchange(&mut line, &[write, read]);
        line.pass(MS);
    }
    let state = Datagram::new(command::BRD, 0, 0x0130, &[0; 2]);
    let back = exchange(&mut line, &[state]).expect("one gateway responds");
    assert_eq!(back[0].counter, 1);
    check_counters(&line);
});
