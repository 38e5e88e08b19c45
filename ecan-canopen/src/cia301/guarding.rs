//! Node guarding (CiA 301, 7.2.8.3.2.1): a remote frame asks, the node responds with its NMT state.

use super::nmt::NmtState;

/// Response of a node to a guarding request, a remote frame with the CAN ID of its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct GuardResponse {
    /// Alternates from response to response; false in the first one after a reset of communication.
    pub toggle: bool,
    /// NMT state of the node.
    pub state: NmtState,
}

const TOGGLE: u8 = 0x80;

impl GuardResponse {
    /// Bytes of data that a guarding request asks for.
    pub const LENGTH: u8 = 1;

    /// The data of the frame.
    pub const fn to_bytes(self) -> [u8; 1] {
        [self.state.raw() | if self.toggle { TOGGLE } else { 0 }]
    }

    /// Reads the data of a frame; `None` for another length or an undefined state.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[byte] = data else { return None };
        let state = NmtState::from_raw(byte & !TOGGLE)?;
        Some(Self { toggle: byte & TOGGLE != 0, state })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn response_has_state_and_toggle_bit() {
        for (byte, toggle, state) in [
            (0x05, false, NmtState::Operational),
            (0x85, true, NmtState::Operational),
            (0x04, false, NmtState::Stopped),
            (0xFF, true, NmtState::PreOperational),
        ] {
            let response = GuardResponse { toggle, state };
            assert_eq!(response.to_bytes(), [byte]);
            assert_eq!(GuardResponse::parse(&[byte]), Some(response));
        }
        for wrong in [&[][..], &[0x06], &[0x86], &[5, 5]] {
            assert_eq!(GuardResponse::parse(wrong), None);
        }
    }
}
