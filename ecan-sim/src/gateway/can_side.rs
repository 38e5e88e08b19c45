//! The four CAN connectors, as the world sees them.

use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::CHANNELS;

use crate::bus::{ErrorState, StationConfig};

use super::Gateway;
use super::channel::Channel;
use super::emergency::Emergency;

impl Gateway {
    /// The logical channel behind a connector, by the active pin rotation (0x8000:13).
    fn channel_at(&mut self, connector: usize) -> Option<&mut Channel> {
        let logical = self.logical(connector)?;
        self.channels.get_mut(logical)
    }

    fn logical(&self, connector: usize) -> Option<usize> {
        let rotation = usize::from(self.pin_rotation) % CHANNELS;
        (connector < CHANNELS).then(|| (connector + CHANNELS - rotation) % CHANNELS)
    }

    /// How the controller at a connector (0 to 3) takes part in its bus; `None` while it is
    /// not configured, in INIT by its own register, or the gateway has no supply.
    #[must_use]
    pub fn station_config(&self, channel: usize) -> Option<StationConfig> {
        let logical = self.logical(channel)?;
        self.channels.get(logical)?.controller.station()
    }

    /// Changes whenever [`station_config`](Self::station_config) may have changed or the
    /// controller was restarted.
    #[must_use]
    pub fn station_generation(&self, channel: usize) -> u32 {
        let restarts = self
            .logical(channel)
            .and_then(|logical| self.channels.get(logical))
            .map_or(0, |channel| channel.controller.generation());
        // a rotation puts another controller behind the connector, whose number of restarts
        // may happen to be the same
        restarts.wrapping_add(self.rotations << 16)
    }

    /// Takes the frame that the controller at a connector puts into arbitration next; `None`
    /// when there is none, or while the last one is neither confirmed nor given up.
    pub fn next_transmit(&mut self, channel: usize) -> Option<CanFrame> {
        self.channel_at(channel)?.controller.next_transmit()
    }

    /// The bus confirms the frame that was taken last.
    pub fn transmitted(&mut self, now: u64, channel: usize, _frame: &CanFrame) {
        self.advance(now);
        let confirmed =
            self.channel_at(channel).is_some_and(|channel| channel.controller.transmitted());
        self.counters.frames_on_bus += u64::from(confirmed);
    }

    /// The bus gave the frame up that was taken last (automatic retransmission is off).
    pub fn abandoned(&mut self, now: u64, channel: usize, _frame: &CanFrame) {
        self.advance(now);
        let given_up =
            self.channel_at(channel).is_some_and(|channel| channel.controller.abandoned());
        self.counters.transmit_losses.not_retransmitted += u64::from(given_up);
    }

    /// A frame arrives from the bus, complete at `now`.
    pub fn received(&mut self, now: u64, channel: usize, frame: &CanFrame, start_ns: u64) {
        self.advance(now);
        let Some(logical) = self.logical(channel) else {
            return;
        };
        if let Some(channel) = self.channels.get_mut(logical) {
            channel.controller.receive(frame, start_ns, now, &mut self.counters);
        }
    }

    /// The bus reports error state and error counters of the controller at a connector.
    pub fn bus_state(&mut self, now: u64, channel: usize, state: ErrorState, tec: u16, rec: u16) {
        self.advance(now);
        let Some(logical) = self.logical(channel) else {
            return;
        };
        let Some(channel) = self.channels.get_mut(logical) else {
            return;
        };
        let was_bus_off = channel.controller.is_bus_off();
        channel.bus_state(state, tec, rec, &mut self.counters);
        match (was_bus_off, channel.controller.is_bus_off()) {
            (false, true) => self.raise_emergency(Emergency::bus_off(logical)),
            (true, false) => self.raise_emergency(Emergency::bus_off_recovered(logical)),
            _ => {}
        }
    }

    /// Whether the controller at a connector wants to leave bus-off now; asking takes the wish.
    pub fn wants_recovery(&mut self, channel: usize) -> bool {
        self.channel_at(channel).is_some_and(|channel| channel.controller.take_recovery_wish())
    }
}
