//! MCAN controller: transmit FIFO or queue, receive FIFOs and buffers, error state, and the status
//! registers of 0x9000..0x9003 (manual 13.4, 13.5).

mod register_access;

use std::collections::VecDeque;

use ecan_protocol::can::{BitTiming, CanFrame, FrameKind, Phase, TDC_MAX_PRESCALER};
use ecan_protocol::config::{MessageRamLayout, TxMode};

use super::diagnostics::GatewayCounters;
use super::mcan_registers::WrittenRegisters;
use super::message_ram::{
    Destination, FilterTable, RX_ELEMENTS_MAX, ReceiveFifo, Received, wrap_increment,
};
use crate::bus::{
    BusError, DelayCompensation, DetectedError, ErrorState, PhysicalLayer, StationConfig,
    StationMode, arbitration_key,
};
use crate::event_queue::take_first;

const TX_ELEMENTS_MAX: usize = 32;
/// The field TDCV has seven bits.
const SECONDARY_POINT_MAX: u32 = 127;
/// Data byte sent in place of one that does not fit into the element.
const MISSING_DATA: u8 = 0xCC;

mod interrupt {
    /// New message, message lost, full.
    pub(super) const FIFOS: [[u32; 3]; 2] = [[1 << 0, 1 << 3, 1 << 2], [1 << 4, 1 << 7, 1 << 6]];
    pub(super) const HIGH_PRIORITY: u32 = 1 << 8;
    pub(super) const TRANSMITTED: u32 = 1 << 9;
    pub(super) const TX_EMPTY: u32 = 1 << 11;
    pub(super) const BUFFER_NEW: u32 = 1 << 19;
    pub(super) const ERROR_PASSIVE: u32 = 1 << 23;
    pub(super) const ERROR_WARNING: u32 = 1 << 24;
    pub(super) const BUS_OFF: u32 = 1 << 25;
    pub(super) const ERROR_IN_ARBITRATION: u32 = 1 << 27;
    pub(super) const ERROR_IN_DATA: u32 = 1 << 28;
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct ControllerConfig {
    pub(super) station: StationConfig,
    pub(super) ram: MessageRamLayout,
    pub(super) filters: FilterTable,
    /// Nominal and, for CAN FD, data bit timing.
    pub(super) timing: (BitTiming, Option<BitTiming>),
    /// Timestamps are those of the start of frame, not of its end.
    pub(super) captures_start: bool,
    /// Offset (0 is automatic) and filter of the active delay compensation.
    pub(super) tdc: Option<(u8, u8)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rejection {
    /// Not configured, listening only, or an FD frame on a classic channel.
    CannotSend,
    BusOff,
    Full,
}

#[derive(Clone, Debug, Default)]
pub(super) struct CanController {
    pub(super) config: Option<ControllerConfig>,
    pub(super) generation: u32,
    fifos: [ReceiveFifo; 2],
    buffers: Vec<Option<Received>>,
    /// Number of full receive buffers; usually 0, which avoids a search.
    buffers_full: usize,
    transmit: VecDeque<CanFrame>,
    in_flight: Option<CanFrame>,
    tx_get_index: u32,
    tx_put_index: u32,
    pub(super) error_state: ErrorState,
    error_counters: (u16, u16),
    errors: ErrorCodes,
    recovery_requested: bool,
    interrupts: u32,
    high_priority: u32,
    written: WrittenRegisters,
    pub(super) frames_lost: u32,
    /// Delay of its transceiver, in ns.
    transceiver_ns: u32,
    /// A frame with bit rate switch was sent, so that its transmitter delay was measured.
    has_measured_delay: bool,
}

impl CanController {
    pub(super) fn new(transceiver_ns: u32) -> Self {
        Self {
            transceiver_ns,
            fifos: [ReceiveFifo::new(), ReceiveFifo::new()],
            buffers: vec![None; RX_ELEMENTS_MAX],
            transmit: VecDeque::with_capacity(TX_ELEMENTS_MAX),
            ..Self::default()
        }
    }

    /// Restarts the controller with a configuration, or stops it. Its frames are lost and counted;
    /// bus-off ends.
    pub(super) fn restart(
        &mut self,
        config: Option<ControllerConfig>,
        counters: &mut GatewayCounters,
    ) {
        counters.receive_losses.flushed += self.flush_received() as u64;
        counters.transmit_losses.stale += self.transmit_waiting() as u64;
        *self = Self {
            config,
            generation: self.generation.wrapping_add(1),
            frames_lost: self.frames_lost,
            ..Self::new(self.transceiver_ns)
        };
    }

    pub(super) fn flush_received(&mut self) -> usize {
        self.buffers.fill(None);
        let in_fifos: usize = self.fifos.iter_mut().map(ReceiveFifo::clear).sum();
        in_fifos + std::mem::take(&mut self.buffers_full)
    }

    /// How it takes part in its bus; `None` while it is not configured or in INIT.
    pub(super) fn station(&self) -> Option<StationConfig> {
        self.config.as_ref().filter(|_| !self.is_stopped()).map(|config| config.station)
    }

    /// Not configured, or off the bus by its INIT bit.
    pub(super) fn is_stopped(&self) -> bool {
        self.config.is_none() || self.written.is_stopped
    }

    /// Its sample points and delays on the bus.
    pub(super) fn physical_layer(&self) -> Option<PhysicalLayer> {
        let ControllerConfig { timing: (nominal, data), station, tdc, .. } =
            self.config.as_ref()?;
        let data = data.unwrap_or(*nominal);
        let clock_hz = clock_hz(station, *nominal);
        // one mtq is a period of the source clock
        let ns_of =
            |mtq: u8| (u64::from(mtq) * 1_000_000_000).checked_div(clock_hz).unwrap_or(0) as u32;
        let compensation = tdc.filter(|_| data.brp <= TDC_MAX_PRESCALER).map(|(offset, filter)| {
            DelayCompensation { offset_ns: ns_of(offset), filter_ns: ns_of(filter) }
        });
        Some(PhysicalLayer {
            compensation,
            transceiver_ns: self.transceiver_ns,
            ..PhysicalLayer::new(nominal.sample_point(), data.sample_point())
        })
    }

    /// Secondary sample point in mtq: measured delay and offset (PSR.TDCV); 0 before a measurement.
    fn secondary_sample_point(&self) -> u32 {
        let Some(ControllerConfig { timing, station, tdc: Some((offset, _)), .. }) = &self.config
        else {
            return 0;
        };
        let (nominal, Some(data)) = *timing else { return 0 };
        if !self.has_measured_delay {
            return 0;
        }
        let delay_ns = match station.mode {
            StationMode::InternalLoopback => 0,
            _ => u64::from(self.transceiver_ns),
        };
        let delay = (delay_ns * clock_hz(station, nominal) + 500_000_000) / 1_000_000_000;
        let offset = if *offset == 0 { data.automatic_tdc_offset().unwrap_or(0) } else { *offset };
        SECONDARY_POINT_MAX.min(delay as u32 + u32::from(offset))
    }

    pub(super) fn is_bus_off(&self) -> bool {
        self.error_state == ErrorState::BusOff
    }

    pub(super) fn is_listening(&self) -> bool {
        self.station().is_some_and(|station| station.mode == StationMode::Listen)
    }

    fn transmit_elements(&self) -> usize {
        let size = self.config.as_ref().map_or(0, |config| config.ram.tx_fifo_size);
        usize::from(size).min(TX_ELEMENTS_MAX)
    }

    /// Size of FIFO0 or FIFO1.
    fn fifo_size(&self, number: usize) -> u8 {
        let ram = self.config.as_ref().map(|config| config.ram);
        ram.map_or(0, |ram| [ram.rx_fifo0, ram.rx_fifo1][number].size)
    }

    /// Frames in the transmit FIFO or queue, including the one in arbitration.
    pub(super) fn transmit_waiting(&self) -> usize {
        self.transmit.len() + usize::from(self.in_flight.is_some())
    }

    /// Frames in the transmit FIFO or queue, without the one in arbitration.
    pub(super) fn transmit_queued(&self) -> usize {
        self.transmit.len()
    }

    pub(super) fn is_transmit_full(&self) -> bool {
        self.config.is_some() && self.transmit_waiting() >= self.transmit_elements()
    }

    pub(super) fn accepts(&self, frame: &CanFrame) -> Result<(), Rejection> {
        let config = self.config.as_ref().ok_or(Rejection::CannotSend)?;
        if config.station.mode == StationMode::Listen || (frame.is_fd() && !config.station.fd) {
            return Err(Rejection::CannotSend);
        }
        if self.is_bus_off() {
            return Err(Rejection::BusOff);
        }
        Ok(())
    }

    pub(super) fn submit(&mut self, frame: CanFrame) -> Result<(), Rejection> {
        self.accepts(&frame)?;
        if self.is_transmit_full() {
            return Err(Rejection::Full);
        }
        let size = self.config.as_ref().map_or(0, |config| config.ram.tx_data_size.bytes());
        self.transmit.push_back(truncate_data(frame, size.into(), MISSING_DATA));
        self.tx_put_index = wrap_increment(self.tx_put_index, self.transmit_elements());
        Ok(())
    }

    /// Takes the next frame for arbitration; `None` while one is in arbitration.
    pub(super) fn next_transmit(&mut self) -> Option<CanFrame> {
        if self.in_flight.is_some() {
            return None;
        }
        let config = self.config.as_ref()?;
        if self.is_bus_off()
            || config.station.mode == StationMode::Listen
            || self.written.is_stopped
        {
            return None;
        }
        let frame = match config.ram.tx_mode {
            TxMode::Fifo => take_first(&mut self.transmit)?,
            TxMode::Queue => {
                let keys = self.transmit.iter().map(arbitration_key);
                let (index, _) = keys.enumerate().min_by_key(|(index, key)| (*key, *index))?;
                self.transmit.remove(index)?
            }
        };
        self.in_flight = Some(frame);
        Some(frame)
    }

    /// The bus confirms the frame in arbitration; returns `false` without one.
    pub(super) fn transmitted(&mut self) -> bool {
        if let Some(frame) = &self.in_flight {
            self.errors.passed(frame);
            self.has_measured_delay |= has_switch(frame);
        }
        let ended = self.abandoned();
        if ended {
            self.interrupts |= interrupt::TRANSMITTED;
            if self.transmit.is_empty() {
                self.interrupts |= interrupt::TX_EMPTY;
            }
        }
        ended
    }

    /// The bus abandoned the frame in arbitration (automatic retransmission is off); returns `false`
    /// without one.
    pub(super) fn abandoned(&mut self) -> bool {
        let ended = self.in_flight.take().is_some();
        if ended {
            self.tx_get_index = wrap_increment(self.tx_get_index, self.transmit_elements());
        }
        ended
    }

    pub(super) fn flush_transmit(&mut self) -> usize {
        let dropped = self.transmit.len();
        self.transmit.clear();
        dropped
    }

    pub(super) fn receive(
        &mut self,
        frame: &CanFrame,
        start_ns: u64,
        end_ns: u64,
        counters: &mut GatewayCounters,
    ) {
        let Some(config) = self.config.as_ref().filter(|_| !self.written.is_stopped) else {
            return;
        };
        self.errors.passed(frame);
        let at_ns = if config.captures_start { start_ns } else { end_ns };
        counters.frames_from_bus += 1;
        let result = config.filters.evaluate(frame);
        let source = |normal| if result.priority { 3 } else { normal };
        let ram = config.ram;
        let stored = match result.destination {
            Destination::Fifo0 | Destination::Fifo1 => {
                let number = usize::from(result.destination == Destination::Fifo1);
                let (fifo, layout) =
                    (&mut self.fifos[number], [ram.rx_fifo0, ram.rx_fifo1][number]);
                let [new, lost, full] = interrupt::FIFOS[number];
                let element = Received {
                    frame: truncate_data(*frame, layout.data_size.bytes().into(), 0),
                    at_ns,
                    source: source(number as u8),
                };
                let kept = fifo.store(element, layout.size, layout.mode);
                self.interrupts |= new;
                if !kept {
                    self.interrupts |= lost;
                }
                if fifo.len() >= usize::from(layout.size) {
                    self.interrupts |= full;
                }
                kept
            }
            Destination::Buffer(number) => {
                let element = Received {
                    frame: truncate_data(*frame, ram.rx_buffer_data_size.bytes().into(), 0),
                    at_ns,
                    source: source(2),
                };
                match self.buffers.get_mut(usize::from(number)) {
                    // an unread buffer is locked
                    Some(free @ None) if number < ram.rx_buffer_count => {
                        *free = Some(element);
                        self.buffers_full += 1;
                        self.interrupts |= interrupt::BUFFER_NEW;
                        true
                    }
                    _ => false,
                }
            }
            Destination::Nowhere => {
                counters.receive_losses.filtered += 1;
                true
            }
        };
        if result.priority {
            self.interrupts |= interrupt::HIGH_PRIORITY;
            self.high_priority = match result.destination {
                Destination::Fifo0 => 2 << 6,
                Destination::Fifo1 => 3 << 6,
                _ => 0,
            } | u32::from(result.filter.unwrap_or(0)) << 8
                | u32::from(frame.id().is_extended()) << 15;
        }
        if !stored {
            counters.receive_losses.controller_full += 1;
            self.frames_lost = self.frames_lost.saturating_add(1);
        }
    }

    /// Takes the next received frame of one source: 0 FIFO0, 1 FIFO1, 2 receive buffers.
    pub(super) fn take_received(&mut self, source: u8) -> Option<Received> {
        match source {
            0 | 1 => self.fifos[usize::from(source)].take(self.fifo_size(source.into())),
            _ if self.buffers_full == 0 => None,
            _ => {
                let taken = self.buffers.iter_mut().find_map(Option::take);
                self.buffers_full -= usize::from(taken.is_some());
                taken
            }
        }
    }

    pub(super) fn receive_waiting(&self) -> usize {
        self.fifos.iter().map(ReceiveFifo::len).sum::<usize>() + self.buffers_full
    }

    /// Returns whether FIFO0 is at least seven eighths full, or a FIFO has lost a frame since it was last
    /// read.
    pub(super) fn is_receive_pressed(&self) -> bool {
        let size = usize::from(self.fifo_size(0));
        self.config.is_some()
            && (self.fifos.iter().any(ReceiveFifo::has_lost)
                || (size > 0 && self.fifos[0].len() * 8 >= size * 7))
    }

    /// The bus reports error state and counters; returns whether the state changed.
    pub(super) fn set_bus_state(&mut self, state: ErrorState, tec: u16, rec: u16) -> bool {
        self.error_counters = (tec, rec);
        let changed = state != self.error_state;
        self.error_state = state;
        if changed {
            self.interrupts |= match state {
                ErrorState::Active => 0,
                ErrorState::Warning => interrupt::ERROR_WARNING,
                ErrorState::Passive => interrupt::ERROR_PASSIVE,
                ErrorState::BusOff => interrupt::BUS_OFF,
            };
            if state != ErrorState::BusOff {
                self.recovery_requested = false;
            }
        }
        changed
    }

    /// The controller has detected errors since the last call; `counted` raised an error counter.
    pub(super) fn note_errors(&mut self, counted: u64, last: DetectedError) {
        let code = match last.error {
            BusError::Stuff => 1,
            BusError::Form => 2,
            BusError::Ack => 3,
            BusError::Bit1 => 4,
            BusError::Bit0 => 5,
        };
        let (target, flag) = match last.phase {
            Phase::Nominal => (&mut self.errors.arbitration, interrupt::ERROR_IN_ARBITRATION),
            Phase::Data => (&mut self.errors.data, interrupt::ERROR_IN_DATA),
        };
        *target = code;
        self.interrupts |= flag;
        self.errors.logged = self.errors.logged.saturating_add(counted.min(255) as u8);
    }

    pub(super) fn request_recovery(&mut self) {
        self.recovery_requested = self.is_bus_off();
    }

    pub(super) fn take_recovery_request(&mut self) -> bool {
        std::mem::take(&mut self.recovery_requested)
    }
}

fn clock_hz(station: &StationConfig, nominal: BitTiming) -> u64 {
    u64::from(station.nominal_bitrate) * u64::from(nominal.clocks_per_bit())
}

fn has_switch(frame: &CanFrame) -> bool {
    matches!(frame.kind(), FrameKind::Fd { brs: true, .. })
}

/// Last error codes (PSR) and error logging (ECR), as the M_CAN core shows them.
#[derive(Clone, Copy, Debug)]
struct ErrorCodes {
    arbitration: u32,
    data: u32,
    logged: u8,
}

impl ErrorCodes {
    const NO_ERROR: u32 = 0;
    const NO_CHANGE: u32 = 7;

    /// A frame was sent or received without error.
    fn passed(&mut self, frame: &CanFrame) {
        self.arbitration = Self::NO_ERROR;
        if has_switch(frame) {
            self.data = Self::NO_ERROR;
        }
    }
}

impl Default for ErrorCodes {
    fn default() -> Self {
        Self { arbitration: Self::NO_CHANGE, data: Self::NO_CHANGE, logged: 0 }
    }
}

/// Replaces the data bytes that do not fit into an element of `size`.
fn truncate_data(frame: CanFrame, size: usize, filler: u8) -> CanFrame {
    let length = frame.data().len();
    if length <= size {
        return frame;
    }
    let mut data = [filler; 64];
    data[..size].copy_from_slice(&frame.data()[..size]);
    let bytes = &data[..length];
    let cut = match frame.kind() {
        FrameKind::Fd { brs, esi } => CanFrame::fd(frame.id(), bytes, brs, esi),
        _ => CanFrame::classic(frame.id(), bytes),
    };
    cut.unwrap_or(frame)
}
