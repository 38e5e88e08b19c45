//! Telling what changes on channels and in the gateway's session.

use ecan_mcan_port::{Port, Session};
use ecan_protocol::{CHANNELS, ChannelState, ChannelStatus};

use crate::frames::channels::Channels;

/// What of a channel's status is worth a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Condition {
    state: ChannelState,
    has_warning: bool,
    is_bus_off: bool,
}

impl Condition {
    fn of(status: ChannelStatus) -> Self {
        let (state, has_warning) = (status.state(), status.warn());
        Self { state, has_warning, is_bus_off: status.bus_off() }
    }

    fn is_good(self) -> bool {
        let takes_part = matches!(self.state, ChannelState::Run | ChannelState::Listen);
        takes_part && !self.has_warning && !self.is_bus_off
    }

    fn words(self) -> String {
        match self {
            Self { is_bus_off: true, .. } => "bus-off".to_owned(),
            Self { state, has_warning: true, .. } => {
                format!("{state}, warning: error passive or many errors")
            }
            Self { state, .. } => state.to_string(),
        }
    }
}

/// Remembers what was seen last.
#[derive(Debug)]
pub struct StatusWatch {
    channels: Channels,
    seen: [Option<Condition>; CHANNELS],
    session: Session,
}

impl StatusWatch {
    /// Starts with a gateway in service and channels that run as they should.
    pub fn new(channels: Channels) -> Self {
        Self { channels, seen: [None; CHANNELS], session: Session::Ready }
    }

    /// Hands a line for everything that has changed to `say`.
    pub fn look(&mut self, port: &Port, mut say: impl FnMut(String)) {
        let session = port.session(0);
        if session != self.session {
            self.session = session;
            say(format!("the gateway is {session}"));
        }
        if session != Session::Ready {
            return;
        }
        for channel in self.channels.iter() {
            let now = Condition::of(port.channel_status(0, channel));
            let Some(seen) = self.seen.get_mut(usize::from(channel)) else { continue };
            let before = *seen;
            // Before the first image there is no status to speak of.
            let is_unknown = before.is_none() && now.state == ChannelState::Disabled;
            if before == Some(now) || is_unknown {
                continue;
            }
            *seen = Some(now);
            if before.is_some() || !now.is_good() {
                say(format!("can{channel} {}", now.words()));
            }
        }
    }
}
