//! A channel of a gateway: its bit rates, the traffic of the application, and what else is on its bus.

use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::draw::{chance, pick, weighted};
use crate::drives::Mode;
use crate::frame_number::Kinds;

/// Bits of a frame of medium length, for the load of a bus.
pub const FRAME_BITS: u64 = 130;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// 0 to 3.
    pub number: u8,
    pub bitrate: u32,
    /// CAN FD.
    pub data_bitrate: Option<u32>,
    /// In the masks of both directions, or of one.
    pub receives: bool,
    pub sends: bool,
    /// Frames of the host in 1000 cycles.
    pub frames: u32,
    /// Range of extended CAN IDs that a filter rejects.
    pub rejects: Option<[u32; 2]>,
    /// Name of its bus if that is the one of another channel.
    pub bus: Option<String>,
    pub partner: Partner,
}

/// What is on the bus besides the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Partner {
    /// Nobody acknowledges.
    Nobody,
    Silent,
    Echo,
    /// Sends bursts of numbered frames.
    Talker {
        period_us: u32,
        burst: u32,
    },
    /// CiA 402 drives; the axes send, too.
    Drives {
        count: u8,
        mode: Mode,
    },
}

impl Channel {
    pub fn kinds(&self) -> Kinds {
        Kinds { is_fd: self.data_bitrate.is_some(), is_shared: self.drives() > 0 }
    }

    /// Frames in 1000 cycles that its nodes send, without the TPDOs of drives.
    pub fn of_nodes(&self, cycle_us: u32) -> u32 {
        match self.partner {
            Partner::Talker { period_us, burst } => {
                let frames = u64::from(cycle_us) * 1_000 * u64::from(burst);
                (frames / u64::from(period_us)) as u32
            }
            Partner::Echo => self.frames,
            // SDO responses and heartbeats.
            Partner::Drives { .. } => 1_000,
            Partner::Nobody | Partner::Silent => 0,
        }
    }

    /// Number of drives.
    pub fn drives(&self) -> u8 {
        match self.partner {
            Partner::Drives { count, .. } => count,
            _ => 0,
        }
    }

    pub fn draw(r: &mut Rng, number: u8, cycle_us: u32) -> Self {
        let (bitrate, data_bitrate) = pick(
            r,
            &[
                (1_000_000, None),
                (1_000_000, None),
                (500_000, None),
                (125_000, None),
                (500_000, Some(2_000_000)),
                (1_000_000, Some(5_000_000)),
            ],
        );
        // Frames that the bus carries in 1000 cycles.
        let capacity = u64::from(bitrate) * u64::from(cycle_us) / FRAME_BITS / 1_000;
        let frames = |percent: u64| (capacity * percent / 100) as u32;
        let partner = match r.u8(..20) {
            0 => Partner::Nobody,
            1..5 => Partner::Silent,
            5..12 => Partner::Echo,
            _ => {
                let burst = pick(r, &[1, 1, 1, 3, 8]);
                let percent = pick(r, &[2, 10, 30, 60]);
                let period_us = u64::from(cycle_us) * 1_000 * u64::from(burst)
                    / u64::from(frames(percent).max(1));
                Partner::Talker { period_us: period_us.min(1_000_000) as u32, burst }
            }
        };
        let (receives, sends) =
            weighted(r, &[(8, (true, true)), (1, (true, false)), (1, (false, true))]);
        let percent = pick(r, &[1, 10, 10, 30, 50, 150]);
        Self {
            number,
            bitrate,
            data_bitrate,
            receives,
            sends,
            frames: frames(percent).min(20_000),
            rejects: chance(r, 15).then(|| {
                let first = r.u32(..0x1000_0000);
                [first, first + r.u32(..0x1000_0000)]
            }),
            bus: None,
            partner,
        }
    }

    /// Connects the channel to the bus of another one.
    pub fn connect(&mut self, bus: String, other: &Self) {
        let frames = u64::from(self.frames) * u64::from(other.bitrate);
        self.frames = (frames / u64::from(self.bitrate)) as u32;
        self.partner = match self.partner {
            Partner::Talker { period_us, burst } => {
                let period_us = u64::from(period_us) * u64::from(self.bitrate);
                let period_us = (period_us / u64::from(other.bitrate)).clamp(1, 1_000_000) as u32;
                Partner::Talker { period_us, burst }
            }
            _ => Partner::Nobody,
        };
        (self.bitrate, self.data_bitrate) = (other.bitrate, other.data_bitrate);
        self.bus = Some(bus);
    }
}
