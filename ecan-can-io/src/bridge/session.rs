//! Protocol state of one client, without threads and sockets.

use std::time::Duration;

use ecan_protocol::can::CanFrame;

use super::config::{BridgeProtocol, BusRates, Conditions, ErrorFrame, Uplink};
use super::slcan::{SlcanReceiveSettings, SlcanSession};
use super::socketcand::SocketcandSession;
use super::{slcan, socketcand};

/// Pause between the answer that enables frames and the first frame. A client of socketcand reads
/// the answer together with what follows, and would not recognise it.
const RAW_MODE_PAUSE: Duration = Duration::from_millis(30);

#[derive(Debug)]
pub(crate) enum Session {
    Slcan(SlcanSession),
    Socketcand(SocketcandSession),
}

impl Session {
    /// `bus` is the name that clients of socketcand open; `None` for every one.
    pub(crate) fn new(protocol: BridgeProtocol, bus: Option<String>) -> Self {
        match protocol {
            BridgeProtocol::Slcan => Self::Slcan(SlcanSession::new()),
            BridgeProtocol::Socketcand => Self::Socketcand(SocketcandSession::new(bus)),
        }
    }

    pub(crate) fn greet(&self, answer: &mut Vec<u8>) {
        match self {
            Self::Slcan(_) => {}
            Self::Socketcand(session) => session.greet(answer),
        }
    }

    /// Processes input in pieces of any size and appends the answers.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        match self {
            Self::Slcan(session) => session.feed(bytes, bus, answer),
            Self::Socketcand(session) => session.feed(bytes, bus, answer),
        }
    }

    /// Returns whether the client has opened the bus, so that it sends or receives frames.
    pub(crate) fn is_open(&self) -> bool {
        match self {
            Self::Slcan(session) => session.is_open(),
            Self::Socketcand(session) => session.is_open(),
        }
    }

    pub(crate) fn receive_settings(&self) -> ReceiveSettings {
        match self {
            Self::Slcan(session) => ReceiveSettings::Slcan(session.receive_settings()),
            Self::Socketcand(session) => ReceiveSettings::Socketcand { is_raw: session.is_raw() },
        }
    }
}

/// Which frames a client receives, and their format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReceiveSettings {
    Slcan(SlcanReceiveSettings),
    Socketcand { is_raw: bool },
}

impl ReceiveSettings {
    #[cfg(test)]
    pub(crate) fn nothing(protocol: BridgeProtocol) -> Self {
        Session::new(protocol, None).receive_settings()
    }

    /// Appends a frame of the bus if the client receives it.
    pub(crate) fn encode(
        &self,
        frame: &CanFrame,
        time_ns: u64,
        bus: Option<BusRates>,
        text: &mut Vec<u8>,
    ) {
        match self {
            Self::Slcan(receive_settings) => receive_settings.encode(frame, time_ns, bus, text),
            Self::Socketcand { is_raw: true } => socketcand::encode(frame, time_ns, text),
            Self::Socketcand { is_raw: false } => {}
        }
    }

    /// Appends the loss of frames that were accepted earlier.
    pub(crate) fn encode_losses(&self, count: u64, time_ns: u64, text: &mut Vec<u8>) {
        match self {
            Self::Slcan(_) => slcan::encode_losses(count, text),
            Self::Socketcand { .. } => socketcand::encode_losses(count, time_ns, text),
        }
    }

    /// Appends an event of the bus. slcan has flags in its place.
    pub(crate) fn encode_error(&self, error: ErrorFrame, time_ns: u64, text: &mut Vec<u8>) {
        if let Self::Socketcand { is_raw: true } = self {
            socketcand::encode_error(error.class, time_ns, text);
        }
    }

    /// Pause before frames after the answer that changed the settings from `before`.
    pub(crate) fn pause_after(&self, before: &Self) -> Duration {
        match (before, self) {
            (Self::Socketcand { is_raw: false }, Self::Socketcand { is_raw: true }) => {
                RAW_MODE_PAUSE
            }
            _ => Duration::ZERO,
        }
    }
}

/// Result of a session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OfflineSession {
    /// Bytes sent to the client, including the greeting.
    pub answers: Vec<u8>,
    /// Frames that the client sent.
    pub sent: Vec<CanFrame>,
    /// The sent frames in the encoding in which the client would receive them at the end.
    pub received: Vec<u8>,
}

impl OfflineSession {
    /// Feeds a client's input in pieces, on a bus that accepts everything.
    pub fn hold<'a>(
        protocol: BridgeProtocol,
        rates: Option<BusRates>,
        pieces: impl IntoIterator<Item = &'a [u8]>,
    ) -> Self {
        let mut session = Session::new(protocol, None);
        let mut session_result = Self::default();
        let mut bus = Bus { rates, sent: Vec::new() };
        session.greet(&mut session_result.answers);
        for chunk in pieces {
            session.feed(chunk, &mut bus, &mut session_result.answers);
        }
        for frame in &bus.sent {
            session.receive_settings().encode(frame, 0, rates, &mut session_result.received);
        }
        session_result.sent = bus.sent;
        session_result
    }
}

struct Bus {
    rates: Option<BusRates>,
    sent: Vec<CanFrame>,
}

impl Uplink for Bus {
    fn bus(&self) -> Option<BusRates> {
        self.rates
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        self.sent.push(frame);
        true
    }

    fn take_conditions(&mut self) -> Conditions {
        Conditions::default()
    }

    fn report_lost(&mut self) {}

    fn count_rejected(&mut self) {}

    fn count_mismatched(&mut self) {}
}
