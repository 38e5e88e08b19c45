//! Protocol state of one client, without threads and sockets.

use std::time::Duration;

use ecan_protocol::can::CanFrame;

use crate::bridge::config::BridgeProtocol;
use crate::bridge::rates::BusRates;
use crate::bridge::slcan::{self, SlcanReceiveSettings, SlcanSession};
use crate::bridge::socketcand::{self, SocketcandSession};
use crate::bridge::uplink::Uplink;

/// Pause between the answer that enables frames and the first frame. A client of socketcand reads
/// the answer together with what follows, and would not recognise it.
const RAW_MODE_PAUSE: Duration = Duration::from_millis(30);

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
        Session::new(protocol).receive_settings()
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
