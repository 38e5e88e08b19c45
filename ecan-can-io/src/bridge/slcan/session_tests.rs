//! Sessions with the adapter.

use ecan_protocol::can::{CanFrame, CanId};
use proptest::prelude::*;

use super::SlcanSession;
use crate::bridge::config::{BusEvent, BusRates, Conditions, Uplink};
use crate::bridge::test_frames::any_frame;

/// A bus that records its frames.
#[derive(Default)]
struct Bus {
    config: Option<BusRates>,
    sent: Vec<CanFrame>,
    room: usize,
    rejected: usize,
    mismatched: usize,
    conditions: Conditions,
}

impl Bus {
    fn new(config: Option<BusRates>) -> Self {
        Self { config, room: usize::MAX, ..Self::default() }
    }
}

impl Uplink for Bus {
    fn bus(&self) -> Option<BusRates> {
        self.config
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        let has_room = self.sent.len() < self.room;
        if has_room {
            self.sent.push(frame);
        }
        has_room
    }

    fn take_conditions(&mut self) -> Conditions {
        std::mem::take(&mut self.conditions)
    }

    fn report_lost(&mut self) {
        unreachable!("a client of slcan is answered")
    }

    fn count_rejected(&mut self) {
        self.rejected += 1;
    }

    fn count_mismatched(&mut self) {
        self.mismatched += 1;
    }
}

fn say(session: &mut SlcanSession, bus: &mut Bus, text: &str) -> String {
    let mut answer = Vec::new();
    session.feed(text.as_bytes(), bus, &mut answer);
    String::from_utf8(answer).unwrap()
}

fn received(session: &SlcanSession, bus: &Bus, frame: &CanFrame) -> String {
    let mut text = Vec::new();
    session.receive_settings().encode(frame, 1_234_000_000, bus.config, &mut text);
    String::from_utf8(text).unwrap()
}

fn frame(data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(0x123).unwrap(), data).unwrap()
}

#[test]
fn session_starts_as_in_python_can() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(Some(BusRates::classic(500_000)));
    // Neither closing a closed channel nor opening an open one is an error.
    assert_eq!(say(&mut session, &mut bus, "C\rS6\r\rO\rO\r"), "\r".repeat(5));
    assert_eq!(say(&mut session, &mut bus, "t1232AABB\r"), "z\r");
    assert_eq!(say(&mut session, &mut bus, "T000001230\r"), "Z\r");
    assert_eq!(bus.sent.len(), 2);
    assert_eq!(received(&session, &bus, &frame(&[1, 2])), "t12320102\r");
    assert_eq!(say(&mut session, &mut bus, "V\rN\r"), "V1010\rNECAN\r");
    assert_eq!(say(&mut session, &mut bus, "C\r"), "\r");
    assert_eq!(received(&session, &bus, &frame(&[1, 2])), "");
    assert_eq!(say(&mut session, &mut bus, "t1230\r"), "\x07");
    assert_eq!((bus.sent.len(), bus.rejected), (2, 1));
}

#[test]
fn listen_only_channel_receives_and_does_not_send() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(None);
    assert_eq!(say(&mut session, &mut bus, "Z1\rL\rL\rO\rt1230\r"), "\r\r\r\x07\x07");
    assert_eq!(received(&session, &bus, &frame(&[])), "t123004D2\r");
    assert!(bus.sent.is_empty());
}

#[test]
fn channel_is_configured_while_closed() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(None);
    assert_eq!(say(&mut session, &mut bus, "F\rO\r"), "\x07\r");
    assert_eq!(say(&mut session, &mut bus, "S6\rY2\rZ1\rs0014\rmFFFFFFFF\r"), "\x07".repeat(5));
    assert_eq!(say(&mut session, &mut bus, "F\r"), "F00\r");
}

#[test]
fn bus_that_accepts_nothing_rejects_and_sets_flag() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(None);
    bus.room = 1;
    assert_eq!(say(&mut session, &mut bus, "O\rt1230\rt1230\r"), "\rz\r\x07");
    assert_eq!(say(&mut session, &mut bus, "F\rF\r"), "F80\rF00\r");
}

#[test]
fn flags_have_what_happened_since_they_were_read() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(None);
    say(&mut session, &mut bus, "O\r");
    for (event, flags) in [
        (BusEvent::ErrorWarning, "F04\r"),
        (BusEvent::LostArbitration, "F40\r"),
        (BusEvent::BusOff, "F80\r"),
        (BusEvent::TransmitFailed, "F80\r"),
        (BusEvent::ReceiveOverflow, "F09\r"),
        (BusEvent::Restarted, "F00\r"),
    ] {
        bus.conditions.note(event);
        assert_eq!(say(&mut session, &mut bus, "F\rF\r"), format!("{flags}F00\r"), "{event:?}");
    }
}

#[test]
fn extended_identifier_has_29_bits_and_may_have_the_flag_of_socketcan() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(None);
    let text = "O\rTFFFFFFFF0\rT200000000\rT9FFFFFFF0\rT1FFFFFFF0\r";
    assert_eq!(say(&mut session, &mut bus, text), "\r\x07\x07Z\rZ\r");
    assert_eq!((bus.sent.len(), bus.rejected), (2, 2));
}

#[test]
fn other_bit_rate_is_rejected_and_does_not_open_the_channel() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(Some(BusRates::classic(500_000)));
    assert_eq!(say(&mut session, &mut bus, "S8\rO\rt1230\r"), "\x07\x07\x07");
    assert_eq!(received(&session, &bus, &frame(&[])), "");
    assert_eq!((bus.sent.len(), bus.mismatched), (0, 2));
    bus.config = Some(BusRates::classic(1_000_000));
    assert_eq!(say(&mut session, &mut bus, "O\rt1230\r"), "\rz\r");
    assert_eq!(received(&session, &bus, &frame(&[])), "t1230\r");
}

#[test]
fn ambiguous_or_rounded_bit_rate_matches() {
    for (name, rate) in [("S7", 800_000), ("S7", 750_000), ("S9", 83_333), ("s0016", 800_000)] {
        let mut session = SlcanSession::new();
        let mut bus = Bus::new(Some(BusRates::classic(rate)));
        assert_eq!(say(&mut session, &mut bus, &format!("{name}\rO\rt1230\r")), "\r\rz\r");
        assert_eq!(received(&session, &bus, &frame(&[])), "t1230\r");
    }
}

#[test]
fn fd_frames_need_fd_bus_and_data_bit_rate() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(Some(BusRates::classic(500_000)));
    assert_eq!(say(&mut session, &mut bus, "S6\rY5\rO\rd1230\rb1230\r"), "\r\r\r\x07\x07");
    bus.config = Some(BusRates::fd(500_000, 2_000_000));
    assert_eq!(say(&mut session, &mut bus, "d1230\rb1230\r"), "z\r\x07");
    bus.config = Some(BusRates::fd(500_000, 5_000_000));
    assert_eq!(say(&mut session, &mut bus, "b1230\rB000001230\r"), "z\rZ\r");
    assert_eq!((bus.sent.len(), bus.mismatched), (3, 3));
}

#[test]
fn overlong_line_is_rejected_once() {
    let mut session = SlcanSession::new();
    let mut bus = Bus::new(None);
    let endless = "t".repeat(100_000);
    assert_eq!(say(&mut session, &mut bus, &endless), "");
    assert_eq!(say(&mut session, &mut bus, "\rO\r\nt1230\r\n"), "\x07\rz\r");
}

proptest! {
    /// The partition of the input by TCP is irrelevant, and only requested frames are sent, in
    /// order.
    /// asked for, in its order.
    #[test]
    fn input_may_be_split_anywhere(
        frames in prop::collection::vec(any_frame(false), 1..20),
        cuts in prop::collection::vec(1..40usize, 1..60),
    ) {
        let mut text = b"O\r".to_vec();
        let mut writer = SlcanSession::new();
        let mut nowhere = Bus::new(None);
        writer.feed(b"O\r", &mut nowhere, &mut Vec::new());
        for frame in &frames {
            writer.receive_settings().encode(frame, 0, None, &mut text);
        }
        let mut session = SlcanSession::new();
        let mut bus = Bus::new(None);
        let mut answer = Vec::new();
        let mut cuts = cuts.iter().cycle();
        let mut rest = &text[..];
        while !rest.is_empty() {
            let (chunk, after) = rest.split_at(rest.len().min(*cuts.next().unwrap()));
            session.feed(chunk, &mut bus, &mut answer);
            rest = after;
        }
        prop_assert_eq!(bus.sent, frames);
        prop_assert_eq!(bus.rejected, 0);
    }

    /// Each line has exactly one answer.
    #[test]
    fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut session = SlcanSession::new();
        let mut bus = Bus::new(None);
        let mut answer = Vec::new();
        session.feed(&bytes, &mut bus, &mut answer);
        let lines = bytes.iter().filter(|byte| **byte == b'\r').count();
        let ends = answer.iter().filter(|byte| matches!(byte, b'\r' | 0x07)).count();
        prop_assert_eq!(ends, lines);
    }
}
