//! One CAN channel with its data path in both directions and its recovery from bus-off.

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{BusOffRecovery, DataPathConfig};
use ecan_protocol::image::{ChannelState, ChannelStatus, ResultCode};

use super::config::GatewayModelConfig;
use super::controller::{CanController, ControllerConfig, Rejection};
use super::diagnostics::{GatewayCounters, ReceiveLosses, TransmitLosses};
use super::mcan_registers::STATUS_REGISTERS;
use super::receive_path::{ReceiveCounters, ReceivePath};
use super::transmit_path::{TransmitCounters, TransmitPath};
use super::variant::{BusOffWait, CriticalSet, RxDrain, TxPending};
use crate::bus::ErrorState;

/// Latched channel events, 0x9000:12. The manual names them but not their bits.
mod event {
    /// Error warning or error passive.
    pub(super) const WARNING: u16 = 1 << 0;
    pub(super) const BUS_OFF: u16 = 1 << 1;
    pub(super) const PRESSURE: u16 = 1 << 2;
    pub(super) const STATE_CHANGE: u16 = 1 << 3;
}

/// Degraded state bits, 0x9020:15. The manual specifies only "non-zero".
mod degraded {
    pub(super) const RECEIVE: u16 = 1 << 0;
    pub(super) const TRANSMIT: u16 = 1 << 1;
    pub(super) const BUS_OFF: u16 = 1 << 2;
}

/// Last data-path error, 0x9020:16. The manual gives no numbers.
pub(super) mod path_error {
    pub(in crate::gateway) const CANNOT_SEND: u32 = 1;
    pub(in crate::gateway) const RING_FULL: u32 = 2;
    pub(in crate::gateway) const FIFO_FULL: u32 = 3;
    pub(in crate::gateway) const BUS_OFF: u32 = 4;
    /// RX cache or receive FIFO overflow.
    pub(in crate::gateway) const RX_OVERFLOW: u32 = 5;
    /// Scheduled frame too late, or the schedule queue full.
    pub(in crate::gateway) const SCHEDULE: u32 = 6;
}

#[derive(Clone, Debug, Default)]
pub(super) struct Channel {
    pub(super) controller: CanController,
    pub(super) receive: ReceivePath,
    pub(super) transmit: TransmitPath,
    pub(super) policy: DataPathConfig,
    /// The policy applied last; not active while it is disabled.
    pub(super) requested: DataPathConfig,
    /// The last apply of 0x8001..0x8004 failed.
    pub(super) apply_failed: bool,
    bus_off_count: u32,
    recovery_attempts: u16,
    /// Services until automatic recovery from bus-off.
    recovery_countdown: Option<u32>,
    waits_for_master: bool,
    events: u16,
    detail_pending: bool,
    detail_sequence: u32,
    pub(super) last_error: u32,
    service_cycles_last: u32,
    service_cycles_max: u32,
    last_state: ChannelState,
    model: ChannelModel,
}

/// Behaviour of a channel that the manual leaves open.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChannelModel {
    tx_pressure_percent: u8,
    transceiver_ns: u32,
    rx_drain: RxDrain,
    tx_pending: TxPending,
    bus_off_wait: BusOffWait,
    critical_frames: CriticalSet,
}

impl ChannelModel {
    pub(super) fn new(config: &GatewayModelConfig) -> Self {
        let GatewayModelConfig { tx_pressure_percent, transceiver_ns, variant, .. } = config;
        Self {
            tx_pressure_percent: *tx_pressure_percent,
            transceiver_ns: *transceiver_ns,
            rx_drain: variant.rx_drain,
            tx_pending: variant.tx_pending,
            bus_off_wait: variant.bus_off_wait,
            critical_frames: variant.critical_frames,
        }
    }
}

impl Channel {
    pub(super) fn new(model: ChannelModel) -> Self {
        Self {
            model,
            controller: CanController::new(model.transceiver_ns),
            receive: ReceivePath::new(model.rx_drain, model.critical_frames),
            transmit: TransmitPath::new(),
            ..Self::default()
        }
    }

    pub(super) fn power_off(&mut self, counters: &mut GatewayCounters) {
        self.restart(None, counters);
        let controller = std::mem::take(&mut self.controller);
        *self = Self { controller, ..Self::new(self.model) };
    }

    /// Restarts the controller with a configuration; waiting frames are lost.
    pub(super) fn restart(
        &mut self,
        config: Option<ControllerConfig>,
        counters: &mut GatewayCounters,
    ) {
        self.flush_receive(counters);
        counters.transmit_losses.stale += self.transmit.flush() as u64;
        self.controller.restart(config, counters);
        self.end_recovery();
    }

    /// Drops all received frames that are not packed yet.
    pub(super) fn flush_receive(&mut self, counters: &mut GatewayCounters) {
        let flushed = self.receive.flush() + self.controller.flush_received();
        counters.receive_losses.flushed += flushed as u64;
    }

    pub(super) fn set_policy(&mut self, requested: DataPathConfig, counters: &mut GatewayCounters) {
        self.requested = requested;
        self.policy = if requested.enable { requested } else { DataPathConfig::default() };
        self.receive.shrink(&self.policy, &mut counters.receive_losses);
        if self.controller.is_bus_off() {
            self.plan_recovery();
        }
    }

    /// Drops all frames that wait to be sent, except the one in arbitration.
    fn flush_transmit(&mut self, counters: &mut GatewayCounters) {
        let in_controller = self.controller.flush_transmit();
        self.transmit.note_stale(in_controller);
        let dropped = self.transmit.flush() + in_controller;
        counters.transmit_losses.stale += dropped as u64;
    }

    fn end_recovery(&mut self) {
        self.recovery_countdown = None;
        self.waits_for_master = false;
    }

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
            ErrorState::Active => self.end_recovery(),
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

    fn plan_recovery(&mut self) {
        let wait = match self.model.bus_off_wait {
            BusOffWait::BackoffBase => u32::from(self.policy.backoff_base_cycles),
            BusOffWait::Nothing => 0,
        };
        let policy = self.policy.bus_off_recovery;
        self.recovery_countdown = (policy == BusOffRecovery::Auto).then_some(wait);
        self.waits_for_master = policy == BusOffRecovery::Degraded;
        if policy == BusOffRecovery::Aggressive {
            self.attempt_recovery();
        }
    }

    fn attempt_recovery(&mut self) {
        self.recovery_attempts = self.recovery_attempts.saturating_add(1);
        self.controller.request_recovery();
    }

    /// One service of the countdown to automatic recovery.
    pub(super) fn serve_recovery(&mut self) {
        let left = self.recovery_countdown;
        self.recovery_countdown = left.and_then(|left| left.checked_sub(1));
        if left == Some(0) {
            self.attempt_recovery();
        }
    }

    /// Counts a frame that the channel cannot send; the error is its result code.
    pub(super) fn check_sendable(
        &mut self,
        frame: &CanFrame,
        losses: &mut TransmitLosses,
    ) -> Result<(), ResultCode> {
        self.controller.accepts(frame).map_err(|rejection| {
            self.note_rejection(rejection);
            if rejection == Rejection::BusOff {
                losses.bus_off += 1;
                ResultCode::BusOff
            } else {
                losses.invalid_channel += 1;
                ResultCode::InvalidChannel
            }
        })
    }

    pub(super) fn note_rejection(&mut self, rejection: Rejection) {
        self.last_error = match rejection {
            Rejection::CannotSend => path_error::CANNOT_SEND,
            Rejection::BusOff => path_error::BUS_OFF,
            Rejection::Full => path_error::FIFO_FULL,
        };
    }

    fn degraded_state(&self) -> u16 {
        let bit = |on: bool, mask: u16| if on { mask } else { 0 };
        bit(self.receive.is_degraded, degraded::RECEIVE)
            | bit(self.transmit.is_degraded, degraded::TRANSMIT)
            | bit(self.waits_for_master, degraded::BUS_OFF)
    }

    fn state(&self) -> ChannelState {
        if self.controller.config.is_none() {
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
        let percent = self.model.tx_pressure_percent;
        self.transmit.is_filled_to(percent) || (percent < 100 && self.controller.is_transmit_full())
    }

    fn rx_pending(&self) -> usize {
        self.receive.waiting() + self.controller.receive_waiting()
    }

    fn tx_pending(&self, scheduled: usize) -> usize {
        let in_controller = match self.model.tx_pending {
            TxPending::WithRunning => self.controller.transmit_waiting(),
            TxPending::WithoutRunning => self.controller.transmit_queued(),
        };
        self.transmit.waiting() + in_controller + scheduled
    }

    /// Latches events since the last service.
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

    fn acknowledge_details(&mut self) {
        self.events = 0;
        self.detail_pending = false;
    }

    /// Channel status word (manual 7), with `scheduled` frames in the schedule queue.
    pub(super) fn status(&self, scheduled: usize) -> ChannelStatus {
        let saturate = |count: usize| count.min(7) as u8;
        let rx = self.rx_pending();
        let tx = self.tx_pending(scheduled);
        let degraded = self.degraded_state() != 0;
        ChannelStatus::default()
            .with_state(self.state())
            .with_fd_enabled(self.controller.station().is_some_and(|station| station.fd))
            .with_warn(self.controller.error_state != ErrorState::Active || degraded)
            .with_bus_off(self.controller.is_bus_off())
            .with_rx_pressure(self.rx_pressure())
            .with_tx_pressure(self.tx_pressure())
            .with_detail_pending(self.detail_pending)
            .with_counter_sat(rx > 7 || tx > 7)
            .with_rx_pending(saturate(rx))
            .with_tx_pending(saturate(tx))
    }

    /// Error, bus-off or congestion, reported by ANY_CHANNEL_ERROR (manual 6).
    pub(super) fn has_error(&self) -> bool {
        matches!(self.state(), ChannelState::Error | ChannelState::BusOff)
            || self.controller.error_state != ErrorState::Active
            || self.rx_pressure()
            || self.tx_pressure()
    }

    /// One service: drains the controller into the cache, within `allowance`. Frames of a channel
    /// that the TxPDO does not carry are dropped. Returns the number of drained frames.
    pub(super) fn drain(
        &mut self,
        allowance: u32,
        carried: bool,
        losses: &mut ReceiveLosses,
    ) -> u32 {
        self.take_controller_losses();
        let dropped_before = self.receive.counters.dropped_total;
        let Self { receive, controller, policy, .. } = self;
        let drained = receive.drain(controller, policy, allowance, carried, losses);
        if self.receive.counters.dropped_total != dropped_before {
            self.last_error = path_error::RX_OVERFLOW;
        }
        drained
    }

    pub(super) fn take_controller_losses(&mut self) {
        for _ in 0..std::mem::take(&mut self.controller.frames_lost) {
            self.receive.note_controller_loss();
            self.last_error = path_error::RX_OVERFLOW;
        }
    }

    pub(super) fn note_service(&mut self, cycles: u32) {
        self.service_cycles_last = cycles;
        self.service_cycles_max = self.service_cycles_max.max(cycles);
    }

    /// A value of 0x9000..0x9003. Reading the latched events acknowledges them.
    pub(super) fn information(&mut self, subindex: u8, scheduled: usize) -> Option<u32> {
        Some(match subindex {
            1..=8 => self.controller.read_register(STATUS_REGISTERS[usize::from(subindex) - 1]),
            9 => u32::from(self.status(scheduled).raw()),
            10 => self.rx_pending() as u32,
            11 => self.tx_pending(scheduled) as u32,
            12 => {
                let events = u32::from(self.events);
                self.acknowledge_details();
                events
            }
            13 => self.receive.counters.dropped_total,
            14 => self.transmit.counters.backpressure,
            15 => self.bus_off_count,
            16 => self.detail_sequence,
            _ => return None,
        })
    }

    /// A value of 0x9020..0x9023.
    pub(super) fn diagnostics(&self, subindex: u8) -> Option<u32> {
        let (receive, transmit) = (&self.receive.counters, &self.transmit.counters);
        Some(match subindex {
            1 => self.receive.waiting() as u32,
            2 => u32::from(receive.high_watermark),
            3 => u32::from(receive.drained_last),
            4 => u32::from(receive.drained_max),
            5 => receive.dropped_total,
            6 => receive.dropped_old,
            7 => receive.dropped_new,
            8 => receive.dropped_critical,
            9 => u32::from(receive.consumed_last),
            10 => u32::from(receive.consumed_max),
            11 => transmit.fifo_full,
            12 => transmit.stale_dropped,
            13 => self.bus_off_count,
            14 => u32::from(self.recovery_attempts),
            15 => u32::from(self.degraded_state()),
            16 => self.last_error,
            17 => self.service_cycles_max,
            18 => self.service_cycles_last,
            _ => return None,
        })
    }

    pub(super) fn clear_diagnostics(&mut self) {
        self.receive.counters = ReceiveCounters::default();
        self.transmit.counters = TransmitCounters::default();
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
