//! One CAN channel of the gateway: controller, data path in both directions, bus-off
//! handling, and its status for the PDO header and the diagnostics objects.

use ecan_protocol::config::{BusOffRecovery, DataPathConfig};
use ecan_protocol::image::{ChannelState, ChannelStatus};

use crate::bus::ErrorState;

use super::controller::{Controller, ControllerConfig, Refusal};
use super::gateway_counters::GatewayCounters;
use super::receive_path::ReceivePath;
use super::transmit_path::TransmitPath;

/// Latched channel events, 0x9000:12. The manual names them, not their bits.
pub(super) mod event {
    /// Error warning or error passive.
    pub(in crate::gateway) const WARNING: u16 = 1 << 0;
    /// Bus-off.
    pub(in crate::gateway) const BUS_OFF: u16 = 1 << 1;
    /// Pressure in either direction.
    pub(in crate::gateway) const PRESSURE: u16 = 1 << 2;
    /// The channel state changed.
    pub(in crate::gateway) const STATE_CHANGE: u16 = 1 << 3;
}

/// Degraded state bits, 0x9020:15. The manual says only "non-zero".
mod degraded {
    pub(super) const RECEIVE: u16 = 1 << 0;
    pub(super) const TRANSMIT: u16 = 1 << 1;
    pub(super) const BUS_OFF: u16 = 1 << 2;
}

/// Last data-path error, 0x9020:16. The manual gives no numbers.
pub(super) mod path_error {
    /// The channel cannot send this frame.
    pub(in crate::gateway) const CANNOT_SEND: u32 = 1;
    /// TX ring full.
    pub(in crate::gateway) const RING_FULL: u32 = 2;
    /// Transmit FIFO of the controller full.
    pub(in crate::gateway) const FIFO_FULL: u32 = 3;
    /// Bus-off.
    pub(in crate::gateway) const BUS_OFF: u32 = 4;
    /// RX cache or receive FIFO overflow.
    pub(in crate::gateway) const RX_OVERFLOW: u32 = 5;
    /// Scheduled frame too late, or the schedule queue full.
    pub(in crate::gateway) const SCHEDULE: u32 = 6;
}

/// One CAN channel.
#[derive(Debug)]
pub(super) struct Channel {
    pub(super) controller: Controller,
    pub(super) receive: ReceivePath,
    pub(super) transmit: TransmitPath,
    /// The policy in force.
    pub(super) policy: DataPathConfig,
    /// The policy last applied; not in force while it is disabled.
    requested: DataPathConfig,
    /// The last apply of 0x8001..0x8004 failed.
    pub(super) apply_failed: bool,
    pub(super) bus_off_count: u32,
    pub(super) recovery_attempts: u16,
    /// Services until automatic recovery from bus-off.
    recovery_countdown: Option<u32>,
    held_off: bool,
    pub(super) events: u16,
    pub(super) detail_pending: bool,
    pub(super) detail_sequence: u32,
    pub(super) last_error: u32,
    pub(super) service_cycles_last: u32,
    pub(super) service_cycles_max: u32,
    last_state: ChannelState,
    tx_pressure_percent: u8,
}

impl Channel {
    /// `tx_pressure_percent`: see [`super::GatewayModelConfig`].
    pub(super) fn new(tx_pressure_percent: u8) -> Self {
        Self {
            tx_pressure_percent,
            controller: Controller::new(),
            receive: ReceivePath::new(),
            transmit: TransmitPath::new(),
            policy: DataPathConfig::default(),
            requested: DataPathConfig::default(),
            apply_failed: false,
            bus_off_count: 0,
            recovery_attempts: 0,
            recovery_countdown: None,
            held_off: false,
            events: 0,
            detail_pending: false,
            detail_sequence: 0,
            last_error: 0,
            service_cycles_last: 0,
            service_cycles_max: 0,
            last_state: ChannelState::Disabled,
        }
    }

    /// Loses the supply.
    pub(super) fn power_off(&mut self, counters: &mut GatewayCounters) {
        self.flush_receive(counters);
        self.transmit.flush_into(counters);
        self.controller.restart(None, counters);
        let controller = std::mem::replace(&mut self.controller, Controller::new());
        *self = Self::new(self.tx_pressure_percent);
        self.controller = controller;
    }

    /// Restarts the controller with a configuration; what waited for the old one is lost.
    pub(super) fn apply(&mut self, config: ControllerConfig, counters: &mut GatewayCounters) {
        self.flush_receive(counters);
        self.transmit.flush_into(counters);
        self.controller.restart(Some(config), counters);
        self.apply_failed = false;
        self.forget_bus_off();
    }

    /// Restarts the controller with the configuration that it has.
    pub(super) fn restart_in_place(&mut self, counters: &mut GatewayCounters) {
        let config = self.controller.config().cloned();
        self.flush_receive(counters);
        self.transmit.flush_into(counters);
        self.controller.restart(config, counters);
        self.forget_bus_off();
    }

    /// Drops everything received that is not packed yet.
    pub(super) fn flush_receive(&mut self, counters: &mut GatewayCounters) {
        let flushed = self.receive.flush() + self.controller.flush_received();
        counters.receive_losses.flushed += flushed as u64;
    }

    /// Puts a policy in force; a disabled one leaves the factory's in force.
    pub(super) fn set_policy(&mut self, requested: DataPathConfig, counters: &mut GatewayCounters) {
        self.requested = requested;
        self.policy = if requested.enable { requested } else { DataPathConfig::default() };
        self.receive.shrink(&self.policy, &mut counters.receive_losses);
        if self.controller.is_bus_off() {
            self.plan_recovery();
        }
    }

    /// The policy last applied, for 0x8021:20.
    pub(super) fn requested_policy(&self) -> &DataPathConfig {
        &self.requested
    }

    /// Drops everything that waits to be sent, but for the frame in arbitration, which the
    /// controller does not let go.
    pub(super) fn flush_transmit(&mut self, counters: &mut GatewayCounters) {
        let in_controller = self.controller.flush_transmit();
        self.transmit.note_stale(in_controller);
        let dropped = self.transmit.flush() + in_controller;
        counters.transmit_losses.stale += dropped as u64;
    }

    /// Forgets a bus-off with all that it caused, as a restart of the controller does.
    pub(super) fn forget_bus_off(&mut self) {
        self.recovery_countdown = None;
        self.held_off = false;
    }

    /// The bus reports the station's error state.
    pub(super) fn bus_state(
        &mut self,
        state: ErrorState,
        tec: u16,
        rec: u16,
        counters: &mut GatewayCounters,
    ) {
        if !self.controller.set_bus_state(state, tec, rec) {
            return;
        }
        match state {
            ErrorState::BusOff => self.enter_bus_off(counters),
            ErrorState::Warning | ErrorState::Passive => self.latch(event::WARNING),
            ErrorState::Active => self.forget_bus_off(),
        }
    }

    fn enter_bus_off(&mut self, counters: &mut GatewayCounters) {
        self.bus_off_count = self.bus_off_count.saturating_add(1);
        self.last_error = path_error::BUS_OFF;
        self.latch(event::BUS_OFF);
        if self.policy.bus_off_recovery != BusOffRecovery::Aggressive {
            self.flush_transmit(counters);
        }
        self.plan_recovery();
    }

    /// Prepares the way out of bus-off that the policy names.
    fn plan_recovery(&mut self) {
        let wait = u32::from(self.policy.backoff_base_cycles);
        let policy = self.policy.bus_off_recovery;
        self.recovery_countdown = (policy == BusOffRecovery::Auto).then_some(wait);
        self.held_off = policy == BusOffRecovery::Degraded;
        if policy == BusOffRecovery::Aggressive {
            self.attempt_recovery();
        }
    }

    fn attempt_recovery(&mut self) {
        self.recovery_attempts = self.recovery_attempts.saturating_add(1);
        self.controller.want_recovery();
    }

    /// One service: counts down to the automatic recovery.
    pub(super) fn serve_recovery(&mut self) {
        match self.recovery_countdown {
            Some(0) => {
                self.recovery_countdown = None;
                self.attempt_recovery();
            }
            Some(left) => self.recovery_countdown = Some(left - 1),
            None => {}
        }
    }

    /// Why the channel would refuse a frame, in the words of the result codes.
    pub(super) fn note_refusal(&mut self, refusal: Refusal) {
        self.last_error = match refusal {
            Refusal::CannotSend => path_error::CANNOT_SEND,
            Refusal::BusOff => path_error::BUS_OFF,
            Refusal::Full => path_error::FIFO_FULL,
        };
    }

    /// 0x9020:15.
    pub(super) fn degraded_state(&self) -> u16 {
        let bit = |on: bool, mask: u16| if on { mask } else { 0 };
        bit(self.receive.is_degraded(), degraded::RECEIVE)
            | bit(self.transmit.is_degraded(), degraded::TRANSMIT)
            | bit(self.held_off, degraded::BUS_OFF)
    }

    fn state(&self) -> ChannelState {
        if self.controller.config().is_none() {
            return if self.apply_failed { ChannelState::Error } else { ChannelState::Disabled };
        }
        if self.controller.is_stopped() {
            ChannelState::Disabled
        } else if self.controller.is_bus_off() {
            ChannelState::BusOff
        } else if self.controller.is_listening() {
            ChannelState::Listen
        } else {
            ChannelState::Run
        }
    }

    fn rx_pressure(&self) -> bool {
        self.receive.is_under_pressure(&self.policy) || self.controller.is_receive_pressed()
    }

    fn tx_pressure(&self) -> bool {
        self.transmit.is_filled_to(self.tx_pressure_percent)
            || (self.tx_pressure_percent < 100 && self.controller.is_transmit_full())
    }

    pub(super) fn rx_pending(&self) -> usize {
        self.receive.waiting() + self.controller.receive_waiting()
    }

    /// Frames that wait to be sent, `scheduled` of them in the schedule queue.
    pub(super) fn tx_pending(&self, scheduled: usize) -> usize {
        self.transmit.waiting() + self.controller.transmit_waiting() + scheduled
    }

    /// Latches what is new since the last service, for the detail snapshot.
    pub(super) fn observe(&mut self) {
        let state = self.state();
        if state != self.last_state {
            self.last_state = state;
            self.latch(event::STATE_CHANGE);
        }
        if self.rx_pressure() || self.tx_pressure() {
            self.latch(event::PRESSURE);
        }
    }

    fn latch(&mut self, event: u16) {
        if self.events & event == 0 {
            self.events |= event;
            self.detail_sequence = self.detail_sequence.wrapping_add(1);
            self.detail_pending = true;
        }
    }

    /// The master has read the latched events.
    pub(super) fn acknowledge_details(&mut self) {
        self.events = 0;
        self.detail_pending = false;
    }

    /// The channel's status word (manual 7).
    pub(super) fn status(&self, scheduled: usize) -> ChannelStatus {
        let saturate = |count: usize| u8::try_from(count.min(7)).unwrap_or(7);
        let rx = self.rx_pending();
        let tx = self.tx_pending(scheduled);
        let degraded = self.degraded_state() != 0;
        ChannelStatus::default()
            .with_state(self.state())
            .with_fd_enabled(self.controller.station().is_some_and(|station| station.fd))
            .with_warn(self.controller.error_state() != ErrorState::Active || degraded)
            .with_bus_off(self.controller.is_bus_off())
            .with_rx_pressure(self.rx_pressure())
            .with_tx_pressure(self.tx_pressure())
            .with_detail_pending(self.detail_pending)
            .with_counter_sat(rx > 7 || tx > 7)
            .with_rx_pending(saturate(rx))
            .with_tx_pending(saturate(tx))
    }

    /// Error, bus-off or congestion: what ANY_CHANNEL_ERROR sums up (manual 6).
    pub(super) fn is_troubled(&self) -> bool {
        matches!(self.state(), ChannelState::Error | ChannelState::BusOff)
            || self.controller.error_state() != ErrorState::Active
            || self.rx_pressure()
            || self.tx_pressure()
    }

    pub(super) fn clear_diagnostics(&mut self) {
        self.receive.clear_counters();
        self.transmit.clear_counters();
        self.controller.frames_lost = 0;
        self.bus_off_count = 0;
        self.recovery_attempts = 0;
        self.last_error = 0;
        self.clear_service_times();
        self.acknowledge_details();
    }

    pub(super) fn clear_service_times(&mut self) {
        self.service_cycles_last = 0;
        self.service_cycles_max = 0;
    }
}
