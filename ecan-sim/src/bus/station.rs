//! One CAN controller on the bus.

use ecan_protocol::can::{CanFrame, FrameKind};

use super::error_confinement::{DetectedError, ErrorCounters, ErrorState};
use super::frame_timing::{FrameTiming, bits_ns};
use super::physical_layer::PhysicalLayer;
use super::recovery::Recovery;
use super::statistics::StationStatistics;

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
            FrameKind::Fd { .. } if !self.fd => Err(Mismatch::FdFormat),
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
