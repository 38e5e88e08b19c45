//! The four CAN connectors as the world sees them.

use ecan_protocol::can::CanFrame;

use super::Gateway;
use super::application::Application;
use super::channel::Channel;
use super::diagnostics::{Emergency, GatewayCounters};
use crate::bus::{DetectedError, ErrorState, PhysicalLayer, StationConfig};

impl Gateway {
    /// The channel at a connector, by the active pin rotation (0x8000:13).
    fn channel_at(&self, connector: usize) -> Option<&Channel> {
        let Application { pins, data_path, .. } = &self.application;
        Some(&data_path.channels[pins.channel_at(connector)?])
    }

    /// The same with its number, for changes.
    fn channel_at_mut(
        &mut self,
        connector: usize,
    ) -> Option<(usize, &mut Channel, &mut GatewayCounters)> {
        let Application { pins, data_path, .. } = &mut self.application;
        let number = pins.channel_at(connector)?;
        Some((number, &mut data_path.channels[number], &mut data_path.counters))
    }

    /// How the controller at a connector (0 to 3) takes part in its bus; `None` while it is
    /// not configured, in INIT by its own register, or without supply.
    #[must_use]
    pub fn station_config(&self, connector: usize) -> Option<StationConfig> {
        self.channel_at(connector)?.controller.station()
    }

    /// Sample points and delays of the controller at a connector; `None` while it is not configured.
    #[must_use]
    pub fn physical_layer(&self, connector: usize) -> Option<PhysicalLayer> {
        self.channel_at(connector)?.controller.physical_layer()
    }

    /// Changes when [`station_config`](Self::station_config) may have changed or the controller
    /// was restarted.
    #[must_use]
    pub fn station_generation(&self, connector: usize) -> u32 {
        let restarts =
            self.channel_at(connector).map_or(0, |channel| channel.controller.generation);
        // a rotation connects another controller, which may have the same number of restarts
        restarts.wrapping_add(self.application.pins.changes() << 16)
    }

    /// Takes the next frame that the controller at a connector puts into arbitration; `None`
    /// without one, or while the last one is neither confirmed nor abandoned.
    pub fn next_transmit(&mut self, connector: usize) -> Option<CanFrame> {
        self.channel_at_mut(connector)?.1.controller.next_transmit()
    }

    /// The bus confirms the frame that was taken last.
    pub fn transmitted(&mut self, now: u64, connector: usize, _frame: &CanFrame) {
        self.advance(now);
        self.confirm(now, connector);
    }

    /// As [`transmitted`](Self::transmitted), while nothing is due.
    pub(crate) fn confirm(&mut self, now: u64, connector: usize) {
        self.now = self.now.max(now);
        if let Some((_, channel, counters)) = self.channel_at_mut(connector) {
            counters.frames_on_bus += u64::from(channel.controller.transmitted());
        }
    }

    /// The bus abandoned the frame that was taken last (automatic retransmission is off).
    pub fn abandoned(&mut self, now: u64, connector: usize, _frame: &CanFrame) {
        self.advance(now);
        if let Some((_, channel, counters)) = self.channel_at_mut(connector) {
            let abandoned = channel.controller.abandoned();
            counters.transmit_losses.not_retransmitted += u64::from(abandoned);
        }
    }

    /// A frame arrives from the bus, complete at `now`.
    pub fn received(&mut self, now: u64, connector: usize, frame: &CanFrame, start_ns: u64) {
        self.advance(now);
        self.receive(now, connector, frame, start_ns);
    }

    /// As [`received`](Self::received), while nothing is due.
    pub(crate) fn receive(&mut self, now: u64, connector: usize, frame: &CanFrame, start_ns: u64) {
        self.now = self.now.max(now);
        if let Some((_, channel, counters)) = self.channel_at_mut(connector) {
            channel.controller.receive(frame, start_ns, now, counters);
        }
    }

    /// The bus reports error state and error counters of the controller at a connector.
    pub fn bus_state(&mut self, now: u64, connector: usize, state: ErrorState, tec: u16, rec: u16) {
        self.advance(now);
        let Some((number, channel, counters)) = self.channel_at_mut(connector) else { return };
        let was_bus_off = channel.controller.is_bus_off();
        channel.bus_state(state, tec, rec, counters);
        match (was_bus_off, channel.controller.is_bus_off()) {
            (false, true) => self.raise_emergency(Emergency::bus_off(number)),
            (true, false) => self.raise_emergency(Emergency::bus_off_recovered(number)),
            _ => {}
        }
    }

    /// The controller at a connector detected errors on the bus: the last one, and the number of those
    /// that raised an error counter.
    pub fn bus_errors(&mut self, now: u64, connector: usize, counted: u64, last: DetectedError) {
        self.advance(now);
        if let Some((_, channel, _)) = self.channel_at_mut(connector) {
            channel.controller.note_errors(counted, last);
        }
    }

    /// Takes a request of the controller at a connector to recover from bus-off.
    pub fn take_recovery_request(&mut self, connector: usize) -> bool {
        let channel = self.channel_at_mut(connector);
        channel.is_some_and(|(_, channel, _)| channel.controller.take_recovery_request())
    }
}
