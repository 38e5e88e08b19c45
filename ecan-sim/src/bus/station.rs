//! One controller on the bus.

use ecan_protocol::can::{CanFrame, FrameKind};

use super::error_confinement::{BusError, ErrorCounters, ErrorState};
use super::frame_timing::{FrameTiming, bits_ns};
use super::recovery::Recovery;
use super::statistics::StationStatistics;

/// Names a station of one bus; handed out by [`CanBus::attach`](super::CanBus::attach).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StationId(pub(super) usize);

impl StationId {
    /// The station's number: 0 for the first one attached, and so on.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }
}

/// How a controller takes part in the bus (manual 13.4, node mode).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum StationMode {
    /// Sends, receives, acknowledges, signals errors.
    #[default]
    Normal,
    /// Receives only: never drives the bus, so it neither acknowledges nor signals errors, and
    /// its error counters stand still. Frames offered wait.
    Listen,
    /// Frames come back to the station itself and the bus sees nothing.
    InternalLoopback,
    /// Frames go to the bus and come back to the station itself. As in Bosch's M_CAN it needs
    /// no acknowledgement and does not hear other stations.
    ExternalLoopback,
}

/// Configuration of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StationConfig {
    /// Bit rate of the arbitration phase in bit/s.
    pub nominal_bitrate: u32,
    /// Bit rate of the data phase in bit/s; matters for FD frames with bit rate switching.
    pub data_bitrate: u32,
    /// Whether the station knows CAN FD. One that does not destroys FD frames with error flags
    /// and sends what it is given in the classic format, cut to 8 bytes, as M_CAN does.
    pub fd: bool,
    /// How it takes part.
    pub mode: StationMode,
    /// Whether failed transmissions and lost arbitrations are repeated.
    pub auto_retransmit: bool,
}

impl StationConfig {
    /// A classic station in normal mode.
    #[must_use]
    pub const fn classic(bitrate: u32) -> Self {
        Self {
            nominal_bitrate: bitrate,
            data_bitrate: bitrate,
            fd: false,
            mode: StationMode::Normal,
            auto_retransmit: true,
        }
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

    /// Whether this controller reads a frame sent with another one's bit rates.
    pub(super) fn understands(&self, sender: &Self, frame: &CanFrame) -> Result<(), Mismatch> {
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

/// Why a station cannot read a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mismatch {
    NominalBitrate,
    DataBitrate,
    FdFormat,
}

impl Mismatch {
    pub(super) const fn error(self) -> BusError {
        match self {
            Self::FdFormat => BusError::Form,
            Self::NominalBitrate | Self::DataBitrate => BusError::Stuff,
        }
    }
}

/// The frame a station has in arbitration.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArbitrationEntry {
    pub frame: CanFrame,
    pub timing: FrameTiming,
    pub key: u32,
    pub ready_at: u64,
    /// Not to be repeated if the attempt under way fails.
    pub withdrawn: bool,
}

/// A frame that an internally looped station sends to itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalTransmission {
    pub frame: CanFrame,
    pub start: u64,
    pub end: u64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Station {
    pub config: Option<StationConfig>,
    pub offer: Option<ArbitrationEntry>,
    pub local: Option<LocalTransmission>,
    /// Since when (or from when on) it has seen the eleven recessive bits that let it join.
    pub active_from: u64,
    /// End of the pause an error-passive sender makes behind its own frame.
    pub suspended_until: u64,
    /// Earliest next start in internal loopback.
    pub local_free_at: u64,
    pub counters: ErrorCounters,
    pub reported: ErrorState,
    pub last_error: Option<BusError>,
    pub recovery: Option<Recovery>,
    pub injected_errors: u32,
    pub statistics: StationStatistics,
}

impl Station {
    /// Whether its error state is still to be reported.
    pub(super) fn state_is_new(&self) -> bool {
        self.counters.state() != self.reported
    }

    /// The configuration of a station that hears a frame starting at `start`.
    pub(super) fn listening(&self, start: u64) -> Option<&StationConfig> {
        let config = self.config.as_ref()?;
        let hears = matches!(config.mode, StationMode::Normal | StationMode::Listen)
            && !self.counters.is_bus_off()
            && self.active_from <= start;
        hears.then_some(config)
    }

    /// The earliest start of its offer, not counting the state of the bus.
    pub(super) fn ready_at(&self) -> Option<(u64, &ArbitrationEntry, &StationConfig)> {
        let config = self.config.as_ref()?;
        let offer = self.offer.as_ref()?;
        let sends = matches!(config.mode, StationMode::Normal | StationMode::ExternalLoopback)
            && !self.counters.is_bus_off();
        let ready = offer.ready_at.max(self.active_from).max(self.suspended_until);
        sends.then_some((ready, offer, config))
    }
}
