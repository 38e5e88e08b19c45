//! Conversations with the daemon.

use ecan_protocol::{CanFrame, CanId, Dlc};
use proptest::prelude::*;

use super::SocketcandSession;
use crate::rates::BusRates;
use crate::session::{Hearing, Uplink};

#[derive(Default)]
struct Bus {
    sent: Vec<CanFrame>,
    is_full: bool,
}

impl Uplink for Bus {
    fn bus(&self) -> Option<BusRates> {
        None
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        self.sent.push(frame);
        !self.is_full
    }

    fn count_refused(&mut self) {}

    fn count_mismatched(&mut self) {}
}

fn say(session: &mut SocketcandSession, bus: &mut Bus, text: &str) -> String {
    let mut answer = Vec::new();
    session.feed(text.as_bytes(), bus, &mut answer);
    String::from_utf8(answer).unwrap()
}

fn heard(session: &SocketcandSession, frame: &CanFrame) -> String {
    let mut text = Vec::new();
    let hearing = Hearing::Socketcand { is_raw: session.is_raw() };
    hearing.encode(frame, 23_424_242_999, None, &mut text);
    String::from_utf8(text).unwrap()
}

fn standard(data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(0x23).unwrap(), data).unwrap()
}

fn extended(data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::extended(0x123).unwrap(), data).unwrap()
}

fn raw(bus: &mut Bus) -> SocketcandSession {
    let mut session = SocketcandSession::new();
    assert_eq!(say(&mut session, bus, "< open can0 >< rawmode >"), "< ok >< ok >");
    session
}

#[test]
fn a_session_as_python_can_begins_it() {
    let mut session = SocketcandSession::new();
    let mut bus = Bus::default();
    let mut greeting = Vec::new();
    session.greet(&mut greeting);
    assert_eq!(greeting, b"< hi >");
    assert_eq!(heard(&session, &standard(&[1])), "");
    assert_eq!(say(&mut session, &mut bus, "< open can0 >"), "< ok >");
    assert_eq!(heard(&session, &standard(&[1])), "");
    assert_eq!(say(&mut session, &mut bus, "< rawmode >"), "< ok >");
    assert_eq!(heard(&session, &standard(&[1, 0xAB])), "< frame 023 23.424242 01AB >");
    assert_eq!(heard(&session, &extended(&[])), "< frame 00000123 23.424242  >");
    // python-can leaves leading zeros out, and a space where there is no data.
    assert_eq!(say(&mut session, &mut bus, "< send 023 2 1 ab >< send 00000123 0  >"), "");
    assert_eq!(bus.sent, [standard(&[1, 0xAB]), extended(&[])]);
    assert_eq!(say(&mut session, &mut bus, "< echo >"), "< echo >");
}

#[test]
fn frames_without_a_form_in_raw_mode_are_left_out() {
    let mut bus = Bus::default();
    let session = raw(&mut bus);
    let id = CanId::standard(1).unwrap();
    assert_eq!(heard(&session, &CanFrame::fd(id, &[1], false, false).unwrap()), "");
    assert_eq!(heard(&session, &CanFrame::remote(id, Dlc::new(1).unwrap()).unwrap()), "");
}

#[test]
fn what_is_wrong_is_refused_with_a_reason() {
    let mut bus = Bus::default();
    let mut session = SocketcandSession::new();
    let mut refused = |text: &str| say(&mut session, &mut bus, text);
    assert_eq!(refused("< send 123 0 >"), "< error not possible in this mode >");
    assert_eq!(refused("< rawmode >"), "< error not possible in this mode >");
    assert_eq!(refused("< open >"), "< error bus name is missing >");
    assert_eq!(refused("< isotpmode >"), "< error unknown command >");
    assert_eq!(refused("<>"), "< error syntax error >");
    for wrong in ["800 0", "12 0", "123 9 1 2 3 4 5 6 7 8 9", "123 2 1", "123 1 1 2", "123 1 100"] {
        assert_eq!(refused(&format!("< send {wrong} >")), "< error syntax error >", "{wrong}");
    }
    assert_eq!(refused(&format!("< {} >", "x".repeat(100_000))), "< error syntax error >");
    bus.is_full = true;
    let mut session = raw(&mut bus);
    assert_eq!(say(&mut session, &mut bus, "<send 123 0>"), "< error transmit queue is full >");
}

proptest! {
    #[test]
    fn what_is_written_can_be_sent(id in 0..=0x7FFu16, data in prop::collection::vec(any::<u8>(), 0..=8)) {
        let frame = CanFrame::classic(CanId::standard(id).unwrap(), &data).unwrap();
        let mut bus = Bus::default();
        let mut session = raw(&mut bus);
        let bytes: Vec<_> = data.iter().map(|byte| format!("{byte:x}")).collect();
        let text = format!("< send {id:03X} {:X} {} >", data.len(), bytes.join(" "));
        prop_assert_eq!(say(&mut session, &mut bus, &text), "");
        prop_assert_eq!(bus.sent, [frame]);
    }

    #[test]
    fn any_text_is_answered(text in "[<> a-z0-9]{0,400}") {
        let mut bus = Bus::default();
        let mut session = raw(&mut bus);
        let answer = say(&mut session, &mut bus, &text);
        prop_assert_eq!(answer.matches('<').count(), answer.matches('>').count());
    }

    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut session = SocketcandSession::new();
        session.feed(&bytes, &mut Bus::default(), &mut Vec::new());
    }
}
