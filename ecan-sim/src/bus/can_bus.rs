//! A CAN bus with its stations: transmissions one after the other and how stations sample them, events, and injected
//! faults.

use ecan_protocol::can::{CanFrame, Phase};

use super::station::{
    ArbitrationEntry, BusStatistics, DetectedError, ErrorCounters, ErrorState, LocalTransmission,
    Mismatch, Recovery, Station, StationConfig, StationId, StationMode, StationSet,
    StationStatistics,
};
use super::timing::{
    BitRates, Draw, FrameTiming, INTERMISSION_BITS, PhysicalLayer, Sample, SwitchError, bits_ns,
};
use super::wire_frame::arbitration_key;

mod completion;
mod planning;

/// Recessive bits for which a station waits before it takes part.
const INTEGRATION_BITS: u32 = 11;

/// One CAN bus and its stations.
///
/// The caller alternates two steps: [`advance`](Self::advance) to the next instant at which
/// something ends, then [`offer`](Self::offer) the frames that the stations send from there on. A
/// frame may still be offered for the instant at which a transmission starts: arbitration is
/// decided when time moves past it. Time never goes back; an earlier `now` counts as the latest
/// one.
///
/// Once the vectors have grown, only [`new`](Self::new) and [`attach`](Self::attach) allocate.
#[derive(Clone, Debug, Default)]
pub struct CanBus {
    name: String,
    seed: u64,
    now: u64,
    free_at: u64,
    stations: Vec<Station>,
    current: Option<Transmission>,
    /// Stations that may have a frame in arbitration.
    offering: StationSet,
    /// Number of ended transmissions.
    transmissions: u64,
    /// Number of frames that all stations but the sender received.
    broadcasts: u64,
    statistics: BusStatistics,
    report_due: bool,
    /// Time at which the next transmission or recovery ends, as last planned.
    next_end: Option<u64>,
    /// True if two stations have sample points.
    has_sampling: bool,
    /// True if a station may be in internal loopback or recovering from bus-off.
    has_local_activity: bool,
    /// True if the next transmission must be selected again.
    needs_plan: bool,
    /// Set while every station can read every frame without an error.
    undisturbed: Option<Undisturbed>,
}

/// Stations that all have the same bit rates and format, in normal mode, with error counters of 0
/// and without sample points: every frame is received by all others.
#[derive(Clone, Copy, Debug)]
struct Undisturbed {
    /// Time from which all of them take part.
    from: u64,
    /// True if there are at least two.
    has_receivers: bool,
    /// True if all of them repeat a frame that lost arbitration.
    repeats: bool,
}

impl CanBus {
    /// An idle bus without stations at time 0.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }

    /// The bus with another seed of its random errors.
    #[must_use]
    pub fn with_seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Name of the bus.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Adds a station that is not yet on the bus.
    pub fn attach(&mut self) -> StationId {
        let station = self.stations.len();
        self.stations.push(Station::default());
        self.offering.reserve(station);
        StationId(station)
    }

    /// Restarts a station with a configuration, or takes it off the bus (`None`).
    ///
    /// The controller is reset: its frame is lost (one in transmission ends in an error frame), the
    /// error counters become 0 without an event, injected errors are cleared. It takes part in
    /// frames that start at least eleven recessive bits later.
    pub fn configure(&mut self, now: u64, station: StationId, config: Option<StationConfig>) {
        self.now = self.now.max(now);
        let now = self.now;
        let statistics = self.station_statistics(station);
        let Some(slot) = self.stations.get_mut(station.0) else {
            return;
        };
        let physical_layer = slot.physical_layer;
        *slot = Station {
            config,
            physical_layer,
            active_from: config.map_or(now, |c| now + c.bits_ns(INTEGRATION_BITS)),
            statistics,
            broadcasts_missed: self.broadcasts,
            ..Station::default()
        };
        self.offering.remove(station.0);
        self.undisturbed = None;
        self.handle_station_removal(station.0);
        self.changed();
    }

    /// Sets sample points and delays of a station, for frames planned from now on. `None`, the
    /// default, samples each bit correctly. They have an effect if two stations have them.
    pub fn set_physical_layer(&mut self, station: StationId, layer: Option<PhysicalLayer>) {
        if let Some(slot) = self.stations.get_mut(station.0) {
            slot.physical_layer = layer;
        }
        let sampling =
            self.stations.iter().filter(|station| station.physical_layer.is_some()).count();
        self.has_sampling = sampling > 1;
        self.undisturbed = None;
        self.needs_plan = true;
    }

    /// Configuration of a station.
    #[must_use]
    pub fn config(&self, station: StationId) -> Option<StationConfig> {
        self.stations.get(station.0)?.config
    }

    /// Returns whether the station with this number is on the bus.
    pub(crate) fn is_attached(&self, station: usize) -> bool {
        self.stations.get(station).is_some_and(|station| station.config.is_some())
    }

    /// Puts a station's next frame into arbitration.
    ///
    /// Returns false, and ignores the frame, if the station already has a frame, or is not on the
    /// bus. Frames of a listening or a bus-off station wait.
    pub fn offer(&mut self, now: u64, station: StationId, frame: CanFrame) -> bool {
        let taken = self.offer_unplanned(now, station, &frame);
        if taken {
            self.replan();
        }
        taken
    }

    /// As [`offer`](Self::offer), if others may offer too: [`replan`](Self::replan) must follow.
    pub(crate) fn offer_unplanned(
        &mut self,
        now: u64,
        station: StationId,
        frame: &CanFrame,
    ) -> bool {
        self.now = self.now.max(now);
        let now = self.now;
        let Some(slot) = self.stations.get_mut(station.0) else {
            return false;
        };
        let Some(config) = slot.config else {
            return false;
        };
        if slot.offer.is_some() || slot.local.is_some() {
            return false;
        }
        let frame = config.on_wire(*frame, false);
        let timing = FrameTiming::of(&frame);
        if config.mode == StationMode::InternalLoopback {
            let start = now.max(slot.active_from).max(slot.local_free_at);
            slot.local =
                Some(LocalTransmission { frame, start, end: start + config.duration_ns(&timing) });
            self.has_local_activity = true;
            return true;
        }
        slot.offer = Some(ArbitrationEntry {
            frame,
            timing,
            key: arbitration_key(&frame),
            ready_at: now,
            withdrawn: false,
        });
        self.offering.insert(station.0);
        self.needs_plan = true;
        true
    }

    /// Returns whether a station has a frame in transmission or waiting for the bus.
    #[must_use]
    pub fn is_offering(&self, station: StationId) -> bool {
        self.stations.get(station.0).is_some_and(|s| s.offer.is_some() || s.local.is_some())
    }

    /// Withdraws a waiting frame. A frame in transmission continues, but is not repeated if it
    /// fails.
    pub fn withdraw(&mut self, station: StationId) {
        let now = self.now;
        let in_progress =
            self.current.as_ref().is_some_and(|t| t.transmitter == station.0 && t.start < now);
        let Some(slot) = self.stations.get_mut(station.0) else {
            return;
        };
        if slot.local.is_some_and(|local| local.start >= now) {
            slot.local = None;
        }
        if in_progress {
            if let Some(offer) = &mut slot.offer {
                offer.withdrawn = true;
            }
        } else {
            slot.offer = None;
        }
        self.changed();
    }

    /// Next instant at which something ends or changes, as known now.
    #[must_use]
    pub fn next_event(&self) -> Option<u64> {
        if self.report_due {
            return Some(self.now);
        }
        self.next_end
    }

    /// Advances time to the first instant up to `to` at which something happens and appends the
    /// events; otherwise to `to`.
    ///
    /// Returns the instant reached. Offer the frames that result from the events and call it again
    /// until it returns `to` without events.
    pub fn advance(&mut self, to: u64, events: &mut Vec<BusEvent>) -> u64 {
        self.advance_unplanned(to, events);
        self.replan();
        self.now
    }

    /// As [`advance`](Self::advance), if frames are offered next: [`replan`](Self::replan) must
    /// follow.
    pub(crate) fn advance_unplanned(&mut self, to: u64, events: &mut Vec<BusEvent>) {
        let Some(at) = self.next_event().filter(|&at| at <= to) else {
            self.now = self.now.max(to);
            return;
        };
        self.now = self.now.max(at);
        if self.report_due {
            self.report_states(events);
        }
        if let Some(t) = self.current.take_if(|t| t.end == at) {
            self.complete(&t, events);
        }
        if self.has_local_activity {
            for index in 0..self.stations.len() {
                self.complete_local(index, at, events);
                self.complete_recovery(index, at);
            }
            self.report_states(events);
        }
    }

    /// As [`advance_unplanned`](Self::advance_unplanned), if nothing happens up to `to` but the end of a frame
    /// that all others receive: returns that frame instead of its events, and `None` without effect
    /// otherwise.
    pub(crate) fn take_broadcast(&mut self, to: u64) -> Option<Broadcast> {
        let at = self.next_end.filter(|&at| at <= to)?;
        if self.report_due || self.has_local_activity {
            return None;
        }
        let t = *self.current.as_ref().filter(|t| t.end == at)?;
        if !self.is_broadcast(&t) || t.contested && !self.undisturbed?.repeats {
            return None;
        }
        self.now = self.now.max(at);
        self.current = None;
        Some(self.complete_broadcast(&t, |_| {}))
    }

    fn complete_local(&mut self, index: usize, at: u64, events: &mut Vec<BusEvent>) {
        let Some(slot) = self.stations.get_mut(index) else {
            return;
        };
        let Some(local) = slot.local.filter(|local| local.end == at) else {
            return;
        };
        let station = StationId(index);
        slot.local = None;
        slot.local_free_at = at + slot.config.map_or(0, |c| c.bits_ns(INTERMISSION_BITS));
        slot.statistics.transmitted += 1;
        slot.statistics.received += 1;
        let LocalTransmission { frame, start: start_ns, end: at_ns } = local;
        events.push(BusEvent::Transmitted { station, frame, start_ns, at_ns });
        events.push(BusEvent::Received { station, frame, start_ns, at_ns });
    }

    /// End of a recovery, if it is before the next transmission.
    pub(super) fn recovery_end(&self, station: &Station) -> Option<u64> {
        let end = station.recovery.as_ref()?.end();
        match &self.current {
            Some(t) if end > t.start => None,
            _ => Some(end),
        }
    }

    fn complete_recovery(&mut self, index: usize, at: u64) {
        let ended = self
            .stations
            .get(index)
            .and_then(|station| self.recovery_end(station))
            .is_some_and(|end| end <= at);
        if ended && let Some(slot) = self.stations.get_mut(index) {
            slot.recovery = None;
            slot.counters = ErrorCounters::default();
            slot.active_from = slot.active_from.max(at);
            slot.suspended_until = 0;
            self.needs_plan = true;
        }
    }

    /// Transmit and receive error counter.
    ///
    /// The transmit counter stays at 256 in bus-off; the receive counter stops at 255.
    #[must_use]
    pub fn error_counters(&self, station: StationId) -> (u16, u16) {
        self.stations.get(station.0).map_or((0, 0), |s| (s.counters.tec, s.counters.rec))
    }

    /// The error state; [`ErrorState::Active`] for a station that is not on the bus.
    #[must_use]
    pub fn error_state(&self, station: StationId) -> ErrorState {
        self.stations.get(station.0).map_or(ErrorState::Active, |s| s.counters.state())
    }

    /// Number of errors that the station detected, and of those that raised an error counter.
    pub(crate) fn error_counts(&self, station: StationId) -> (u64, u64) {
        self.stations.get(station.0).map_or((0, 0), |s| {
            let StationStatistics { transmit_errors, receive_errors, counted_errors, .. } =
                s.statistics;
            (transmit_errors + receive_errors, counted_errors)
        })
    }

    /// Last error that the station detected since it was configured.
    #[must_use]
    pub fn last_error(&self, station: StationId) -> Option<DetectedError> {
        self.stations.get(station.0)?.last_error
    }

    /// Starts the recovery of a bus-off station: it is error active again after 128 occurrences of
    /// 11 recessive bits. No effect in another state or during recovery.
    pub fn recover(&mut self, now: u64, station: StationId) {
        self.now = self.now.max(now);
        let now = self.now;
        let Some(slot) = self.stations.get_mut(station.0) else {
            return;
        };
        if let (true, None, Some(config)) =
            (slot.counters.is_bus_off(), slot.recovery, &slot.config)
        {
            slot.recovery = Some(Recovery::start(now, config.bits_ns(11)));
            self.has_local_activity = true;
            self.changed();
        }
    }

    /// Returns whether a bus-off station is recovering.
    #[must_use]
    pub fn is_recovering(&self, station: StationId) -> bool {
        self.stations.get(station.0).is_some_and(|s| s.recovery.is_some())
    }

    /// Injects a fault at the instant that the bus has reached.
    pub fn inject(&mut self, fault: BusFault) {
        match fault {
            BusFault::ErrorFrames { station, count } => {
                if let Some(slot) = self.stations.get_mut(station.0) {
                    slot.injected_errors = slot.injected_errors.saturating_add(count);
                }
            }
            BusFault::BusOff(station) => {
                let Some(slot) = self.stations.get_mut(station.0) else {
                    return;
                };
                if slot.config.is_none() || slot.counters.is_bus_off() {
                    return;
                }
                slot.counters.leave_bus();
                self.undisturbed = None;
                self.report_due = true;
                self.handle_station_removal(station.0);
            }
        }
        self.changed();
    }

    /// Plans again after a change of stations.
    fn changed(&mut self) {
        self.undisturbed = None;
        self.needs_plan = true;
        self.replan();
    }

    /// Returns whether no error counter changed in the last transmission, and all are 0.
    pub(crate) const fn is_undisturbed(&self) -> bool {
        self.undisturbed.is_some()
    }

    /// Counters of the bus up to the instant that it has reached.
    #[must_use]
    pub fn statistics(&self) -> BusStatistics {
        let mut statistics = self.statistics;
        statistics.at_ns = self.now;
        match self.current.as_ref().filter(|t| t.start < self.now) {
            Some(t) => statistics.busy_ns += self.now - t.start,
            None => statistics.busy_ns -= self.free_at.saturating_sub(self.now),
        }
        statistics
    }

    /// Counters of one station.
    #[must_use]
    pub fn station_statistics(&self, station: StationId) -> StationStatistics {
        let Some(slot) = self.stations.get(station.0) else { return StationStatistics::default() };
        let mut statistics = slot.statistics;
        if slot.config.is_some() {
            statistics.received += self.broadcasts - slot.broadcasts_missed;
        }
        statistics
    }
}

/// One event on the bus. Times in simulated nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusEvent {
    /// A station's frame was sent and acknowledged (or looped back).
    Transmitted {
        /// The sender.
        station: StationId,
        /// The frame as sent on the wire: ESI is set if the sender was error passive, and an FD
        /// frame of a classic station was sent in classic format.
        frame: CanFrame,
        /// Start of frame.
        start_ns: u64,
        /// End of frame.
        at_ns: u64,
    },
    /// A station received a frame.
    Received {
        /// The receiver.
        station: StationId,
        /// The frame.
        frame: CanFrame,
        /// Start of frame.
        start_ns: u64,
        /// End of frame.
        at_ns: u64,
    },
    /// A transmission ended in an error frame or was not acknowledged.
    ErrorFrame {
        /// The sender.
        transmitter: StationId,
        /// End of the error delimiter.
        at_ns: u64,
    },
    /// A station without automatic retransmission discarded a frame after an error or lost
    /// arbitration.
    Abandoned {
        /// The station.
        station: StationId,
        /// The frame.
        frame: CanFrame,
        /// Time.
        at_ns: u64,
    },
    /// The error state of a station changed.
    StateChanged {
        /// The station.
        station: StationId,
        /// The new state.
        state: ErrorState,
        /// Time.
        at_ns: u64,
    },
}

/// A fault to inject.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusFault {
    /// A bit error disturbs the next `count` transmissions of a station.
    ErrorFrames {
        /// The station.
        station: StationId,
        /// Number of transmissions.
        count: u32,
    },
    /// A station becomes bus-off at once; a frame in transmission ends in an error frame.
    BusOff(StationId),
}

/// A frame that every other station on the bus received, without effect on an error counter. Times in
/// simulated nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Broadcast {
    pub(crate) sender: StationId,
    pub(crate) frame: CanFrame,
    /// Start of frame.
    pub(crate) start_ns: u64,
    /// End of frame.
    pub(crate) at_ns: u64,
}

/// Bits until a receiver at another nominal bit rate detects a stuff error.
const RATE_ERROR_AFTER_BITS: u32 = 7;
/// Data bits until a receiver with another data bit rate detects a stuff error after the switch.
const DATA_RATE_ERROR_AFTER_BITS: u32 = 6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TransmissionResult {
    /// Acknowledged, or sent in external loopback.
    Delivered,
    /// No one acknowledged.
    NoAck,
    /// The acknowledgements came after the sample point of the sender.
    LateAck,
    /// The sender sampled its own data bits before they were back.
    EchoMissed,
    /// An injected bit error.
    Disturbed,
    /// An error-active station that cannot read the frame destroyed it.
    Destroyed,
    /// The sender left the bus.
    SenderRemoved,
}

/// A transmission: planned until `start` has passed, then in progress.
#[derive(Clone, Copy, Debug)]
struct Transmission {
    pub transmitter: usize,
    pub config: StationConfig,
    pub frame: CanFrame,
    pub timing: FrameTiming,
    pub key: u32,
    pub start: u64,
    pub end: u64,
    pub result: TransmissionResult,
    /// Phase in which the sender detects the error of an unsuccessful result.
    pub phase: Phase,
    pub collision: bool,
    /// True if other stations were ready at the same start.
    pub contested: bool,
}

/// Sampling of a transmission whose sender has sample points.
struct Sampling {
    sender: PhysicalLayer,
    rates: BitRates,
    /// The frame has a data phase.
    has_switch: bool,
    draw: Draw,
}

impl Sampling {
    #[cold]
    fn read_by(&self, index: usize, station: &Station) -> Result<(), Mismatch> {
        if let Some(receiver) = &station.physical_layer
            && self.has_switch
        {
            let (error, probability) = self.sender.switch_error(receiver, self.rates);
            if self.draw.hits(probability, index, Sample::Switch) {
                return Err(match error {
                    SwitchError::Late => Mismatch::SwitchLate,
                    SwitchError::Early => Mismatch::SwitchEarly,
                });
            }
        }
        Ok(())
    }

    #[cold]
    fn acknowledges_late(&self, index: usize, station: &Station) -> bool {
        let Some(receiver) = &station.physical_layer else { return false };
        let probability = self.sender.late_acknowledge(receiver, self.rates, self.has_switch);
        self.draw.hits(probability, index, Sample::Acknowledge)
    }

    #[cold]
    fn misses_echo(&self, t: &Transmission) -> bool {
        let probability = if self.has_switch { self.sender.echo_error(self.rates) } else { 0 };
        self.draw.hits(probability, t.transmitter, Sample::Echo)
    }
}

impl Transmission {
    /// Returns whether a station can read the frame.
    #[inline]
    fn read_by(
        &self,
        sampling: Option<&Sampling>,
        index: usize,
        station: &Station,
        config: &StationConfig,
    ) -> Result<(), Mismatch> {
        config.can_read(&self.config, &self.frame)?;
        match sampling {
            Some(sampling) => sampling.read_by(index, station),
            None => Ok(()),
        }
    }

    fn after_switch_ns(&self, data_bits: u32) -> u64 {
        self.config.bits_ns(u32::from(self.timing.header_bits))
            + bits_ns(data_bits, self.config.data_bitrate)
    }

    /// Phase of the sender when a receiver signals an error.
    fn phase_of(&self, mismatch: Mismatch) -> Phase {
        match mismatch {
            Mismatch::NominalBitrate | Mismatch::FdFormat => Phase::Nominal,
            Mismatch::DataBitrate | Mismatch::SwitchLate | Mismatch::SwitchEarly => Phase::Data,
        }
    }
}

fn mismatch_ns(mismatch: Mismatch, t: &Transmission) -> u64 {
    let header = u32::from(t.timing.header_bits);
    match mismatch {
        Mismatch::NominalBitrate => t.config.bits_ns(RATE_ERROR_AFTER_BITS),
        Mismatch::FdFormat => t.config.bits_ns(header),
        Mismatch::DataBitrate | Mismatch::SwitchEarly => {
            t.after_switch_ns(DATA_RATE_ERROR_AFTER_BITS)
        }
        // it continues at the nominal bit rate
        Mismatch::SwitchLate => t.config.bits_ns(header + DATA_RATE_ERROR_AFTER_BITS),
    }
}
