//! What a protocol does for one client, without threads and sockets.

use std::time::Duration;

use ecan_protocol::can::CanFrame;

use crate::rates::BusRates;
use crate::settings::BridgeProtocol;
use crate::slcan::{SlcanReceiveSettings, SlcanSession};
use crate::socketcand::{self, SocketcandSession};

/// Between the answer behind which frames come and the first of them. A client of socketcand reads
/// the answer with whatever has come by then, and takes it for another one.
const SETTLING: Duration = Duration::from_millis(30);

/// The bus, as a session uses it.
pub(crate) trait Uplink {
    /// Its bit rates; `None` before they are known.
    fn bus(&self) -> Option<BusRates>;

    /// Hands a frame over; false when there is no room.
    fn send(&mut self, frame: CanFrame) -> bool;

    /// Hands a frame over and waits until there is room; without effect where the bus takes none.
    fn send_when_possible(&mut self, frame: CanFrame);

    /// A command was refused.
    fn count_refused(&mut self);

    /// A frame was refused because the bus cannot carry it as the client sees the bus.
    fn count_mismatched(&mut self);
}

/// The state of one client.
#[derive(Debug)]
pub(crate) enum Session {
    Slcan(SlcanSession),
    Socketcand(SocketcandSession),
}

impl Session {
    pub(crate) fn new(protocol: BridgeProtocol) -> Self {
        match protocol {
            BridgeProtocol::Slcan => Self::Slcan(SlcanSession::new()),
            BridgeProtocol::Socketcand => Self::Socketcand(SocketcandSession::new()),
        }
    }

    /// What the server says first.
    pub(crate) fn greet(&self, answer: &mut Vec<u8>) {
        match self {
            Self::Slcan(_) => {}
            Self::Socketcand(session) => session.greet(answer),
        }
    }

    /// Takes in what the client wrote, in pieces of any size, and appends the answers.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        match self {
            Self::Slcan(session) => session.feed(bytes, bus, answer),
            Self::Socketcand(session) => session.feed(bytes, bus, answer),
        }
    }

    /// What the client wants to hear by now.
    pub(crate) fn hearing(&self) -> ReceiveSettings {
        match self {
            Self::Slcan(session) => ReceiveSettings::Slcan(session.hearing()),
            Self::Socketcand(session) => ReceiveSettings::Socketcand { is_raw: session.is_raw() },
        }
    }
}

/// What a client wants to hear of the bus, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReceiveSettings {
    Slcan(SlcanReceiveSettings),
    Socketcand { is_raw: bool },
}

impl ReceiveSettings {
    /// That of a new client.
    #[cfg(test)]
    pub(crate) fn nothing(protocol: BridgeProtocol) -> Self {
        Session::new(protocol).hearing()
    }

    /// Appends a frame of the bus, if the client wants to hear it.
    pub(crate) fn encode(
        &self,
        frame: &CanFrame,
        time_ns: u64,
        bus: Option<BusRates>,
        text: &mut Vec<u8>,
    ) {
        match self {
            Self::Slcan(hearing) => hearing.encode(frame, time_ns, bus, text),
            Self::Socketcand { is_raw: true } => socketcand::encode(frame, time_ns, text),
            Self::Socketcand { is_raw: false } => {}
        }
    }

    /// How long frames wait behind the answer that changes the hearing from `before`.
    pub(crate) fn pause_behind(&self, before: &Self) -> Duration {
        match (before, self) {
            (Self::Socketcand { is_raw: false }, Self::Socketcand { is_raw: true }) => SETTLING,
            _ => Duration::ZERO,
        }
    }
}
