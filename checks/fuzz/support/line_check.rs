//! Sends frames to a line of gateways and checks the responses.
#![allow(dead_code)]

use ecan_protocol::device::AlState;
use ecan_sim::Gateway;

use crate::wire_support::{Datagram, Line, encode};

const MS: u64 = 1_000_000;

/// Bytes of the input, consumed from the front.
pub struct Bytes<'a>(pub &'a [u8]);

impl<'a> Bytes<'a> {
    pub fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }

    pub fn word(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    pub fn take(&mut self, length: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at(length.min(self.0.len()));
        self.0 = rest;
        taken
    }

    /// A datagram with any command, address and data.
    pub fn datagram(&mut self) -> Datagram {
        let (command, slave, offset) = (self.byte() % 17, self.byte(), self.word());
        let slave = match slave {
            0..=0x7F => 0x1001 + u16::from(slave & 1),
            _ => u16::from(slave).wrapping_sub(0x80).wrapping_neg(),
        };
        let length = usize::from(self.byte()) * if command & 1 == 0 { 1 } else { 3 };
        Datagram::new(command, slave, offset, self.take(length))
    }
}

fn states(line: &Line) -> Vec<AlState> {
    let world = line.wire.world();
    (0..world.gateway_count())
        .filter_map(|index| world.gateway(index))
        .map(Gateway::al_state)
        .collect()
}

fn rank(state: AlState) -> u8 {
    match state {
        AlState::Init => 0,
        AlState::PreOp | AlState::Boot => 1,
        AlState::SafeOp => 2,
        AlState::Op => 3,
    }
}

/// Sends the datagrams of one frame 10 us later; checks the response, if there is one.
pub fn exchange(line: &mut Line, sent: &[Datagram]) -> Option<Vec<Datagram>> {
    let before = states(line);
    let back = line.exchange(sent);
    let slaves = before.len() as u16;
    if let Some(back) = &back {
        assert_eq!(back.len(), sent.len());
        for (sent, back) in sent.iter().zip(back) {
            check_datagram(sent, back, slaves);
        }
    }
    if let [only] = sent {
        for (before, after) in before.into_iter().zip(states(line)) {
            check_transition(before, after, only);
        }
    }
    back
}

/// Passes any bytes after the EtherType of EtherCAT.
pub fn pass_raw(line: &mut Line, bytes: &[u8]) {
    let mut frame = encode(&[]);
    frame.truncate(14);
    frame.extend(bytes);
    let length = frame.len();
    line.pass(MS / 10);
    line.wire.pass(line.now, &mut frame);
    assert_eq!(frame.len(), length);
}

fn check_datagram(sent: &Datagram, back: &Datagram, slaves: u16) {
    let changed = sent.counter != back.counter;
    // read, write and exchange add 1, 1 and 3 for each slave that takes part
    let limit = match sent.command {
        1 | 2 => 1,
        3 => 3,
        4 | 5 | 7 | 8 | 10 | 11 | 13 | 14 => slaves,
        6 | 9 | 12 => 3 * slaves,
        _ => 0,
    };
    assert!(back.counter <= limit, "working counter {}: {sent:?}", back.counter);
    assert_eq!((back.command, back.data.len()), (sent.command, sent.data.len()));
    if !changed || matches!(sent.command, 2 | 5 | 8 | 11) {
        assert_eq!(back.data, sent.data, "{sent:?}");
    }
    let hops = match sent.command {
        1..=3 | 7..=9 | 13 => back.slave.wrapping_sub(sent.slave),
        _ => {
            assert_eq!(back.slave, sent.slave);
            0
        }
    };
    assert!(hops <= slaves && back.offset == sent.offset);
}

/// A request leads at most one state up; BOOT lies between INIT and INIT.
fn check_transition(before: AlState, after: AlState, sent: &Datagram) {
    let is_legal = match (before, after) {
        (AlState::Boot, to) => matches!(to, AlState::Boot | AlState::Init),
        (from, AlState::Boot) => from == AlState::Init,
        (from, to) => rank(to) <= rank(from) + 1,
    };
    assert!(is_legal, "{before} to {after} by {sent:?}");
}

/// Checks that the counters of each gateway are plausible.
pub fn check_counters(line: &Line) {
    let world = line.wire.world();
    for gateway in 0..world.gateway_count() {
        let it = world.counters(gateway).expect("a gateway of the line");
        let parsed = it.images_parsed + it.images_repeated + it.images_faulty;
        assert!(parsed <= it.images_written, "{it:?}");
        assert!(it.images_read <= it.images_published, "{it:?}");
        assert!(it.frames_on_bus <= it.frames_to_controller, "{it:?}");
        assert!(it.frames_released <= it.frames_scheduled, "{it:?}");
        assert!(it.frames_to_master <= it.frames_from_bus, "{it:?}");
    }
}
