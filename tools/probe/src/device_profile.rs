//! Values of a gateway that experiments measured.

use serde::Serialize;

/// Measured values; `None` for one that no experiment measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DeviceProfile {
    /// Serial number.
    pub serial: Option<u64>,
    /// Firmware version: 0xF000:05 and :06.
    pub firmware: Option<(u32, u32)>,
    /// Longest time from an SM2 write to the end of its service, in us.
    pub service_us: Option<u32>,
    /// Time from an SDO request to its response in OP, in us.
    pub mailbox_us: Option<u32>,
    /// Time from the restart command to the first response, in ms.
    pub restart_ms: Option<u32>,
    /// Scheduled frames that the gateway holds.
    pub schedule_depth: Option<u32>,
    /// First and last time of a send relative to a Sync0 pulse, in us, at which the firmware missed the image.
    pub sync0_missed_us: Option<(i64, i64)>,
    /// Number of node mode "internal loopback".
    pub internal_loopback: Option<u8>,
    /// Nominal sample point that the firmware chooses from 75 to 87.5 % at 500 kbit/s, in 0.1 %.
    pub sample_point_permille: Option<u32>,
    /// The same by the error counters of two wired channels, in 0.1 %.
    pub wired_sample_point_permille: Option<u32>,
}
