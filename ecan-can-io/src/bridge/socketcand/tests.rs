//! Sessions with the daemon.

use ecan_protocol::can::{CanFrame, CanId, Dlc};
use proptest::prelude::*;

use super::SocketcandSession;
use crate::bridge::config::{BusRates, Conditions, Uplink};
use crate::bridge::session::ReceiveSettings;

#[derive(Default)]
struct Bus {
    sent: Vec<CanFrame>,
    rejected: usize,
    is_closed: bool,
    lost: usize,
}

impl Uplink for Bus {
    fn bus(&self) -> Option<BusRates> {
        None
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        if !self.is_closed {
            self.sent.push(frame);
        }
        !self.is_closed
    }

    fn take_conditions(&mut self) -> Conditions {
        unreachable!("socketcand has no flags")
    }

    fn report_lost(&mut self) {
        self.lost += 1;
    }

    fn count_rejected(&mut self) {
        self.rejected += 1;
    }

    fn count_mismatched(&mut self) {}
}

fn say(session: &mut SocketcandSession, bus: &mut Bus, text: &str) -> String {
    let mut answer = Vec::new();
    session.feed(text.as_bytes(), bus, &mut answer);
    String::from_utf8(answer).unwrap()
}

fn received(session: &SocketcandSession, frame: &CanFrame) -> String {
    let mut text = Vec::new();
    let receive_settings = ReceiveSettings::Socketcand { is_raw: session.is_raw() };
    receive_settings.encode(frame, 23_424_242_999, None, &mut text);
    String::from_utf8(text).unwrap()
}

fn standard(data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(0x23).unwrap(), data).unwrap()
}

fn extended(data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::extended(0x123).unwrap(), data).unwrap()
}

fn raw(bus: &mut Bus) -> SocketcandSession {
    let mut session = SocketcandSession::new(None);
    assert_eq!(say(&mut session, bus, "< open can0 >< rawmode >"), "< ok >< ok >");
    session
}

#[test]
fn only_the_bus_of_the_bridge_opens() {
    let mut session = SocketcandSession::new(Some("can1".to_owned()));
    let mut bus = Bus::default();
    let answers = say(&mut session, &mut bus, "< open can0 >< open can1 >");
    assert_eq!(answers, "< error could not open bus >< ok >");
    assert_eq!(bus.rejected, 1);
}

#[test]
fn frame_that_is_not_sent_is_an_error_of_the_bus() {
    let mut bus = Bus::default();
    let mut session = raw(&mut bus);
    assert_eq!(say(&mut session, &mut bus, "< send 3FFFFFFF 0 >"), "");
    assert_eq!((bus.lost, bus.rejected, bus.sent.len()), (1, 1, 0));
    bus.is_closed = true;
    assert_eq!(say(&mut session, &mut bus, "< send 123 0 >"), "");
    assert_eq!((bus.lost, bus.sent.len()), (2, 0));
}

#[test]
fn session_starts_as_in_python_can() {
    let mut session = SocketcandSession::new(None);
    let mut bus = Bus::default();
    let mut greeting = Vec::new();
    session.greet(&mut greeting);
    assert_eq!(greeting, b"< hi >");
    assert_eq!(received(&session, &standard(&[1])), "");
    assert_eq!(say(&mut session, &mut bus, "< open can0 >"), "< ok >");
    assert_eq!(received(&session, &standard(&[1])), "");
    assert_eq!(say(&mut session, &mut bus, "< rawmode >"), "< ok >");
    assert_eq!(received(&session, &standard(&[1, 0xAB])), "< frame 023 23.424242 01AB >");
    assert_eq!(received(&session, &extended(&[])), "< frame 00000123 23.424242  >");
    // python-can omits leading zeros, and writes a space if there is no data.
    assert_eq!(say(&mut session, &mut bus, "< send 023 2 1 ab >< send 00000123 0  >"), "");
    assert_eq!(bus.sent, [standard(&[1, 0xAB]), extended(&[])]);
    assert_eq!(say(&mut session, &mut bus, "< echo >"), "< echo >");
}

#[test]
fn frames_without_raw_mode_form_are_skipped() {
    let mut bus = Bus::default();
    let session = raw(&mut bus);
    let id = CanId::standard(1).unwrap();
    assert_eq!(received(&session, &CanFrame::fd(id, &[1], false, false).unwrap()), "");
}

#[test]
fn remote_frames_have_own_commands() {
    let mut bus = Bus::default();
    let mut session = raw(&mut bus);
    let remote = |id, dlc| CanFrame::remote(id, Dlc::new(dlc).unwrap()).unwrap();
    let (standard, extended) = (CanId::standard(0x123).unwrap(), CanId::extended(0x123).unwrap());
    assert_eq!(received(&session, &remote(standard, 4)), "< rtr 123 23.424242 4 >");
    assert_eq!(received(&session, &remote(extended, 0)), "< rtr 00000123 23.424242 0 >");
    assert_eq!(say(&mut session, &mut bus, "< sendrtr 123 4 >< sendrtr 00000123 0 >"), "");
    assert_eq!(bus.sent, [remote(standard, 4), remote(extended, 0)]);
}

/// Identifiers without leading zeros, and signed numbers with all their digits.
#[test]
fn frames_match_savvycan_format() {
    let mut bus = Bus::default();
    let mut session = raw(&mut bus);
    let text = "< send 12 2 7f ffffffffffffffab >< send 7ff 0 >< send ffffffff80000123 1 1 >\
                < send 9fffffff 0 >";
    assert_eq!(say(&mut session, &mut bus, text), "");
    let (low, high) = (CanId::standard(0x12).unwrap(), CanId::standard(0x7FF).unwrap());
    let highest = CanId::extended(0x1FFF_FFFF).unwrap();
    let expected = [
        CanFrame::classic(low, &[0x7F, 0xAB]).unwrap(),
        CanFrame::classic(high, &[]).unwrap(),
        extended(&[1]),
        CanFrame::classic(highest, &[]).unwrap(),
    ];
    assert_eq!((bus.sent.as_slice(), bus.rejected), (expected.as_slice(), 0));
}

#[test]
fn invalid_commands_are_rejected_with_reason() {
    let mut bus = Bus::default();
    let mut session = SocketcandSession::new(None);
    let mut rejected = |text: &str| say(&mut session, &mut bus, text);
    assert_eq!(rejected("< send 123 0 >"), "< error not possible in this mode >");
    assert_eq!(rejected("< rawmode >"), "< error not possible in this mode >");
    assert_eq!(rejected("< open >"), "< error bus name is missing >");
    assert_eq!(rejected("< isotpmode >"), "< error unknown command >");
    assert_eq!(rejected("<>"), "< error syntax error >");
    assert_eq!(rejected(&format!("< {} >", "x".repeat(100_000))), "< error syntax error >");
    assert_eq!(bus.rejected, 6);
}

/// An error in raw mode is a bus error for python-can, which requires a class in it.
#[test]
fn invalid_frame_is_counted_without_answer() {
    let mut bus = Bus::default();
    let mut session = raw(&mut bus);
    let long = format!("123 1 {}", "0".repeat(100_000));
    let wrong = [
        "",
        "800 0",
        "1234567 0",
        "20000000 0",
        "123",
        "123 9 1 2 3 4 5 6 7 8 9",
        "123 2 1",
        "123 1 1 2",
        "123 1 1g",
        "123 -1",
        "123 + 0",
        &long,
    ];
    for frame in wrong {
        assert_eq!(say(&mut session, &mut bus, &format!("< send {frame} >")), "", "{frame}");
    }
    for frame in ["123 9", "123", "123 1 1"] {
        assert_eq!(say(&mut session, &mut bus, &format!("< sendrtr {frame} >")), "", "{frame}");
    }
    assert_eq!((bus.sent.len(), bus.rejected), (0, wrong.len() + 3));
}

proptest! {
    #[test]
    fn written_frames_can_be_sent(id in 0..=0x7FFu16, data in prop::collection::vec(any::<u8>(), 0..=8)) {
        let frame = CanFrame::classic(CanId::standard(id).unwrap(), &data).unwrap();
        let mut bus = Bus::default();
        let mut session = raw(&mut bus);
        let bytes: Vec<_> = data.iter().map(|byte| format!("{byte:x}")).collect();
        let text = format!("< send {id:03X} {:X} {} >", data.len(), bytes.join(" "));
        prop_assert_eq!(say(&mut session, &mut bus, &text), "");
        prop_assert_eq!(bus.sent, [frame]);
    }

    #[test]
    fn every_command_except_frame_has_one_answer(
        commands in prop::collection::vec("(send |sendrtr |echo|open |rawmode)?[a-z0-9 ]{0,20}", 0..30),
    ) {
        let mut bus = Bus::default();
        let mut session = raw(&mut bus);
        for command in commands {
            let answer = say(&mut session, &mut bus, &format!("x < {command} >> y"));
            let is_frame = command.trim_start().starts_with("send ")
                || command.trim_start().starts_with("sendrtr ");
            let answers = usize::from(!is_frame);
            prop_assert_eq!(answer.matches("< ").count(), answers, "{}: {}", command, answer);
            prop_assert_eq!(answer.matches(" >").count(), answers);
        }
    }

    #[test]
    fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut session = SocketcandSession::new(None);
        session.feed(&bytes, &mut Bus::default(), &mut Vec::new());
    }
}
