//! Where service frames go: the Port, behind the little that sending needs of it.

use ecan_mcan_port::{Port, SendError, SendOptions, SendTicket, Session};
use ecan_protocol::can::FrameRef;

pub(super) trait FrameSink {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError>;

    /// Frames that the gateway has not sent yet on a channel, as far as its status tells.
    fn pending(&self, slave: usize, channel: u8) -> u8;

    /// Bytes left in the image of this cycle.
    fn room(&self, slave: usize) -> usize;

    /// Whether the gateway is in service.
    fn is_ready(&self, slave: usize) -> bool;

    /// Whether the last image is repeated, so that frames wait for the next one.
    fn is_holding(&self, slave: usize) -> bool;
}

impl FrameSink for Port {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        self.send_with(slave, channel, frame, options)
    }

    fn pending(&self, slave: usize, channel: u8) -> u8 {
        self.channel_status(slave, channel).tx_pending()
    }

    fn room(&self, slave: usize) -> usize {
        self.image_room(slave)
    }

    fn is_ready(&self, slave: usize) -> bool {
        self.session(slave) == Session::Ready
    }

    fn is_holding(&self, slave: usize) -> bool {
        self.cycle_report(slave).is_holding
    }
}

/// Whether waiting may cure it.
pub(super) fn is_passing(error: SendError) -> bool {
    matches!(
        error,
        SendError::Backpressure { .. } | SendError::NotReady { .. } | SendError::NoCycle
    )
}
