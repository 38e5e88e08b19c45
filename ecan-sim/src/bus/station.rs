//! Stations of a bus: configuration, error counters and error states (ISO 11898-1, fault confinement), recovery
//! from bus-off, and statistics.

use ecan_protocol::can::{CanFrame, FrameKind, Phase};

use super::timing::{FrameTiming, PhysicalLayer, bits_ns};

/// Index of a station on one bus, returned by [`CanBus::attach`](super::CanBus::attach).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StationId(pub(super) usize);

impl StationId {
    /// Number of the station: 0 for the first one attached.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }
}

/// Operating mode of a controller (manual 13.4, node mode).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum StationMode {
    /// Sends, receives, acknowledges, signals errors.
    #[default]
    Normal,
    /// Receives only: never drives the bus, so it neither acknowledges nor signals errors, and its
    /// error counters do not change. Offered frames wait.
    Listen,
    /// Frames are looped back internally and do not reach the bus.
    InternalLoopback,
    /// Frames are sent on the bus and looped back. As in Bosch's M_CAN it needs no acknowledgement
    /// and does not receive frames of other stations.
    ExternalLoopback,
}

/// Configuration of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StationConfig {
    /// Bit rate of the arbitration phase in bit/s.
    pub nominal_bitrate: u32,
    /// Bit rate of the data phase in bit/s, for FD frames with bit rate switching.
    pub data_bitrate: u32,
    /// True if the station supports CAN FD. Without support it destroys FD frames with error flags
    /// and sends its own in classic format, cut to 8 bytes, as M_CAN does.
    pub fd: bool,
    /// True if CAN FD frames have the format before ISO 11898-1:2015, which stations with ISO format
    /// cannot read, and the other way round.
    pub non_iso: bool,
    /// Operating mode.
    pub mode: StationMode,
    /// True if failed transmissions and lost arbitrations are repeated.
    pub auto_retransmit: bool,
}

impl StationConfig {
    /// A classic station in normal mode.
    #[must_use]
    pub const fn classic(bitrate: u32) -> Self {
        Self { fd: false, ..Self::fd(bitrate, bitrate) }
    }

    /// An FD station in normal mode.
    #[must_use]
    pub const fn fd(nominal_bitrate: u32, data_bitrate: u32) -> Self {
        Self {
            nominal_bitrate,
            data_bitrate,
            fd: true,
            non_iso: false,
            mode: StationMode::Normal,
            auto_retransmit: true,
        }
    }

    pub(super) fn bits_ns(&self, bits: u32) -> u64 {
        bits_ns(bits, self.nominal_bitrate)
    }

    pub(super) fn duration_ns(&self, timing: &FrameTiming) -> u64 {
        timing.duration_ns(self.nominal_bitrate, self.data_bitrate)
    }

    /// The frame as this controller sends it.
    pub(super) fn on_wire(&self, frame: CanFrame, passive: bool) -> CanFrame {
        let FrameKind::Fd { brs, esi } = frame.kind() else {
            return frame;
        };
        let changed = if !self.fd {
            let data = frame.data();
            CanFrame::classic(frame.id(), data.get(..8).unwrap_or(data))
        } else if passive && !esi {
            CanFrame::fd(frame.id(), frame.data(), brs, true)
        } else {
            return frame;
        };
        // infallible: a valid FD frame's identifier and shortened data are valid
        changed.unwrap_or(frame)
    }

    /// Returns whether this controller can read a frame of another one.
    #[inline]
    pub(super) fn can_read(&self, sender: &Self, frame: &CanFrame) -> Result<(), Mismatch> {
        if self.nominal_bitrate != sender.nominal_bitrate {
            return Err(Mismatch::NominalBitrate);
        }
        match frame.kind() {
            FrameKind::Fd { .. } if !self.fd || self.non_iso != sender.non_iso => {
                Err(Mismatch::FdFormat)
            }
            FrameKind::Fd { brs: true, .. } if self.data_bitrate != sender.data_bitrate => {
                Err(Mismatch::DataBitrate)
            }
            _ => Ok(()),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mismatch {
    NominalBitrate,
    DataBitrate,
    FdFormat,
    /// The receiver switches to the data bit rate too late, and misses the switch.
    SwitchLate,
    /// The receiver switches too early.
    SwitchEarly,
}

/// The frame that a station has in arbitration.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArbitrationEntry {
    pub frame: CanFrame,
    pub timing: FrameTiming,
    pub key: u32,
    pub ready_at: u64,
    /// Do not repeat the frame if the present attempt fails.
    pub withdrawn: bool,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct LocalTransmission {
    pub frame: CanFrame,
    pub start: u64,
    pub end: u64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Station {
    pub config: Option<StationConfig>,
    /// `None` samples each bit correctly.
    pub physical_layer: Option<PhysicalLayer>,
    pub offer: Option<ArbitrationEntry>,
    pub local: Option<LocalTransmission>,
    /// Time from which the station takes part, after eleven recessive bits.
    pub active_from: u64,
    /// End of the suspend transmission time after its own frame.
    pub suspended_until: u64,
    /// Earliest next start in internal loopback.
    pub local_free_at: u64,
    pub counters: ErrorCounters,
    pub reported: ErrorState,
    pub last_error: Option<DetectedError>,
    pub recovery: Option<Recovery>,
    pub injected_errors: u32,
    /// Number of the bus's [broadcasts](super::CanBus::take_broadcast) that it did not receive.
    pub broadcasts_missed: u64,
    pub statistics: StationStatistics,
}

impl Station {
    pub(super) fn has_new_state(&self) -> bool {
        self.counters.state() != self.reported
    }

    /// The configuration of a station that receives a frame starting at `start`.
    pub(super) fn listening(&self, start: u64) -> Option<&StationConfig> {
        let config = self.config.as_ref()?;
        let receives = matches!(config.mode, StationMode::Normal | StationMode::Listen)
            && !self.counters.is_bus_off()
            && self.active_from <= start;
        receives.then_some(config)
    }

    /// Earliest start of its frame, regardless of the bus state.
    pub(super) fn ready_at(&self) -> Option<(u64, &ArbitrationEntry, &StationConfig)> {
        let config = self.config.as_ref()?;
        let offer = self.offer.as_ref()?;
        let sends = matches!(config.mode, StationMode::Normal | StationMode::ExternalLoopback)
            && !self.counters.is_bus_off();
        let ready = offer.ready_at.max(self.active_from).max(self.suspended_until);
        sends.then_some((ready, offer, config))
    }
}

const WORD_BITS: usize = u64::BITS as usize;

/// A set of stations by their numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct StationSet {
    words: Vec<u64>,
}

impl StationSet {
    /// Makes room, so that inserting the station does not allocate.
    pub(crate) fn reserve(&mut self, station: usize) {
        let words = station / WORD_BITS + 1;
        self.words.resize(words.max(self.words.len()), 0);
    }

    pub(crate) fn insert(&mut self, station: usize) {
        self.reserve(station);
        if let Some(bits) = self.words.get_mut(station / WORD_BITS) {
            *bits |= 1 << (station % WORD_BITS);
        }
    }

    pub(crate) fn remove(&mut self, station: usize) {
        if let Some(bits) = self.words.get_mut(station / WORD_BITS) {
            *bits &= !(1 << (station % WORD_BITS));
        }
    }

    /// The first station with this number or a higher one.
    pub(crate) fn first_from(&self, station: usize) -> Option<usize> {
        let first = station / WORD_BITS;
        let bits = *self.words.get(first)? & (u64::MAX << (station % WORD_BITS));
        if bits != 0 {
            return Some(first * WORD_BITS + bits.trailing_zeros() as usize);
        }
        let further = self.words.iter().enumerate().skip(first + 1).find(|(_, bits)| **bits != 0);
        further.map(|(word, bits)| word * WORD_BITS + bits.trailing_zeros() as usize)
    }

    /// The stations in ascending order.
    pub(crate) fn iter(&self) -> Iter<'_> {
        Iter { words: self.words.iter(), bits: 0, base: 0, next_base: 0 }
    }
}

/// Iterator over the stations of a [`StationSet`].
pub(crate) struct Iter<'a> {
    words: std::slice::Iter<'a, u64>,
    /// Stations of the present word that are still to come.
    bits: u64,
    base: usize,
    next_base: usize,
}

impl Iterator for Iter<'_> {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        while self.bits == 0 {
            self.bits = *self.words.next()?;
            self.base = self.next_base;
            self.next_base += WORD_BITS;
        }
        let station = self.base + self.bits.trailing_zeros() as usize;
        self.bits &= self.bits - 1;
        Some(station)
    }
}

const WARNING_LIMIT: u16 = 96;
const PASSIVE_LIMIT: u16 = 128;
/// Transmit error count from which a station is bus-off.
const BUS_OFF_LIMIT: u16 = 256;
/// Counting beyond the passive limit has no effect.
const REC_MAX: u16 = 255;
/// Receive error counter of an error-passive receiver after a good frame; the standard allows 119
/// to 127.
const REC_AFTER_PASSIVE: u16 = 127;

/// Error state of a station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ErrorState {
    /// Error active, both counters below 96.
    #[default]
    Active,
    /// Error active, a counter of 96 or more.
    Warning,
    /// Error passive: a counter of 128 or more. Its error flags do not disturb others.
    Passive,
    /// Bus-off: the transmit error counter reached 256.
    BusOff,
}

/// Error that a station detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BusError {
    /// Stuff error: six equal bits. Also caused by another station's error flag.
    Stuff,
    /// ACK error: no station acknowledged the frame.
    Ack,
    /// Bit error: a recessive bit was sent, a dominant one was read back. Also caused by another
    /// station's error flag.
    Bit1,
    /// Bit error: a dominant bit was sent, a recessive one was read back.
    Bit0,
    /// Form error. Also caused by an FD frame at a classic station.
    Form,
}

/// An error with the phase of the frame in which it was detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DetectedError {
    /// The error.
    pub error: BusError,
    /// The data phase is that of an FD frame with bit rate switch.
    pub phase: Phase,
}

impl DetectedError {
    pub(super) const fn nominal(error: BusError) -> Self {
        Self { error, phase: Phase::Nominal }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ErrorCounters {
    pub tec: u16,
    pub rec: u16,
    bus_off: bool,
}

impl ErrorCounters {
    pub(super) const fn state(&self) -> ErrorState {
        if self.bus_off {
            ErrorState::BusOff
        } else if self.is_passive() {
            ErrorState::Passive
        } else if self.tec >= WARNING_LIMIT || self.rec >= WARNING_LIMIT {
            ErrorState::Warning
        } else {
            ErrorState::Active
        }
    }

    pub(super) const fn is_bus_off(&self) -> bool {
        self.bus_off
    }

    pub(super) const fn is_passive(&self) -> bool {
        self.tec >= PASSIVE_LIMIT || self.rec >= PASSIVE_LIMIT
    }

    pub(super) const fn sent(&mut self) {
        self.tec = self.tec.saturating_sub(1);
    }

    pub(super) const fn received(&mut self) {
        self.rec =
            if self.rec >= PASSIVE_LIMIT { REC_AFTER_PASSIVE } else { self.rec.saturating_sub(1) };
    }

    /// The transmitter's error flag adds eight; bus-off from 256.
    pub(super) const fn send_failed(&mut self) {
        self.tec += 8;
        if self.tec >= BUS_OFF_LIMIT {
            self.leave_bus();
        }
    }

    pub(super) fn receive_failed(&mut self, points: u16) {
        self.rec = REC_MAX.min(self.rec + points);
    }

    pub(super) const fn leave_bus(&mut self) {
        self.tec = BUS_OFF_LIMIT;
        self.bus_off = true;
    }
}

/// Occurrences of eleven recessive bits that end the bus-off state.
const SEQUENCES: u64 = 128;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Recovery {
    missing: u64,
    /// Time since which the bus has been recessive for this recovery.
    recessive_since: u64,
    sequence_ns: u64,
}

impl Recovery {
    /// `sequence_ns` is the duration of 11 bits.
    pub(super) fn start(now: u64, sequence_ns: u64) -> Self {
        Self { missing: SEQUENCES, recessive_since: now, sequence_ns: sequence_ns.max(1) }
    }

    /// Time at which it ends if no frame is sent before.
    pub(super) fn end(&self) -> u64 {
        self.recessive_since + self.missing * self.sequence_ns
    }

    /// Handles a transmission that occupied the bus from `start`; it was recessive again from
    /// `quiet` on.
    pub(super) fn interrupted(&mut self, start: u64, quiet: u64) {
        let seen = start.saturating_sub(self.recessive_since) / self.sequence_ns;
        self.missing = self.missing.saturating_sub(seen);
        self.recessive_since = self.recessive_since.max(quiet);
    }
}

/// Counters of a bus up to an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusStatistics {
    /// The instant, simulated ns.
    pub at_ns: u64,
    /// Frames acknowledged or looped back over the bus.
    pub frames: u64,
    /// Transmissions that ended in an error frame.
    pub error_frames: u64,
    /// Starts at which two stations had the same arbitration field. On a real bus different data
    /// then cause bit errors; here the station with the lower number is first.
    pub identifier_collisions: u64,
    /// Time occupied by frames and error frames, each with its intermission.
    pub busy_ns: u64,
}

impl BusStatistics {
    /// Share of the time since an earlier snapshot in which the bus was busy, 0 to 1.
    ///
    /// A bus without pauses has load 1, since the intermission counts as busy.
    #[must_use]
    pub fn load_since(&self, earlier: &Self) -> f64 {
        let span = self.at_ns.saturating_sub(earlier.at_ns);
        if span == 0 {
            return 0.0;
        }
        self.busy_ns.saturating_sub(earlier.busy_ns) as f64 / span as f64
    }
}

/// Counters of one station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationStatistics {
    /// Frames sent successfully.
    pub transmitted: u64,
    /// Frames received, including looped-back ones.
    pub received: u64,
    /// Own transmissions that failed.
    pub transmit_errors: u64,
    /// Frames of others that failed.
    pub receive_errors: u64,
    /// Errors that raised an error counter.
    pub counted_errors: u64,
    /// Starts at which another station won arbitration.
    pub arbitrations_lost: u64,
    /// Number of bus-off events.
    pub bus_offs: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stations_come_in_ascending_order() {
        let mut set = StationSet::default();
        assert_eq!(set.iter().next(), None);
        [130, 3, 64, 0, 63, 3].into_iter().for_each(|station| set.insert(station));
        assert_eq!(set.iter().collect::<Vec<_>>(), [0, 3, 63, 64, 130]);
        let first_from = [0, 1, 4, 64, 65, 130, 131, 500].map(|from| set.first_from(from));
        let expected = [0, 3, 63, 64, 130, 130].map(Some);
        assert_eq!(first_from, [&expected[..], &[None, None]].concat()[..]);
        [64, 3, 500].into_iter().for_each(|station| set.remove(station));
        assert_eq!(set.iter().collect::<Vec<_>>(), [0, 63, 130]);
    }

    #[test]
    fn sixteen_failures_are_passive_thirty_two_bus_off() {
        let mut counters = ErrorCounters::default();
        let mut seen = Vec::new();
        for n in 1..=32 {
            let before = counters.state();
            counters.send_failed();
            if counters.state() != before {
                seen.push((n, counters.state()));
            }
        }
        assert_eq!(
            seen,
            [(12, ErrorState::Warning), (16, ErrorState::Passive), (32, ErrorState::BusOff)]
        );
    }

    #[test]
    fn good_frame_ends_passive_state_of_receiver() {
        let mut counters = ErrorCounters::default();
        counters.receive_failed(300);
        assert_eq!(counters.state(), ErrorState::Passive);
        counters.received();
        assert_eq!(counters.rec, 127);
        assert_eq!(counters.state(), ErrorState::Warning);
        counters.received();
        assert_eq!(counters.rec, 126);
    }
}
