//! Values of a gateway that `ecan probe` measured, as a file that a configuration includes.

use std::fmt::Write as _;

use serde::Serialize;

use crate::config_file::document::{Document, Includes, Table};
use crate::config_file::fault::FileFaults;

/// Measured values; `None` for one that no experiment measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DeviceProfile {
    /// Serial number.
    pub serial: Option<u64>,
    /// Firmware version: 0xF000:05 and :06.
    pub firmware: Option<(u32, u32)>,
    /// Longest time from an SM2 write to the end of its service, in us.
    pub service_us: Option<u32>,
    /// Longest time of the gateway from an SDO request to its response in OP, in us.
    pub mailbox_us: Option<u32>,
    /// Time from the restart command to the first response, in ms.
    pub restart_ms: Option<u32>,
    /// Scheduled frames that the gateway holds.
    pub schedule_depth: Option<u32>,
    /// Times before and after a Sync0 pulse between which arriving outputs are missed, in us. They arrive the
    /// default time through the host ([`ImageTimes`](ecan_host::ImageTimes)) and their time on the wire
    /// after the send, which is what was measured.
    pub sync0_window_us: Option<(u32, u32)>,
    /// Number of node mode "internal loopback".
    pub internal_loopback: Option<u8>,
    /// Nominal sample point that the firmware chooses from 75 to 87.5 % at 500 kbit/s, in 0.1 %.
    pub sample_point_permille: Option<u32>,
    /// The same by the error counters of two wired channels, in 0.1 %.
    pub wired_sample_point_permille: Option<u32>,
    /// Delay of a CAN transceiver from transmit to receive pin, in ns.
    pub transceiver_ns: Option<u32>,
}

impl DeviceProfile {
    /// The values as a TOML file.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (key, value) in self.values() {
            let _ = writeln!(text, "{key} = {value}");
        }
        text
    }

    /// Reads the bytes of a file, which are UTF-8.
    ///
    /// # Errors
    /// Every fault, with line and column.
    pub fn parse(bytes: &[u8]) -> Result<Self, FileFaults> {
        Document::read(bytes, Includes::None, |document, root| {
            Self::read(Table::root(document, root))
        })
    }

    /// Keys and values of what was measured.
    pub(crate) fn values(&self) -> impl Iterator<Item = (&'static str, String)> {
        let number = |value: Option<u32>| value.map(|value| value.to_string());
        let pair =
            |pair: Option<(u32, u32)>| pair.map(|(first, last)| format!("[{first}, {last}]"));
        let values = [
            // TOML has no integer of 64 bits without sign.
            ("serial", self.serial.map(|serial| format!("\"{serial}\""))),
            ("firmware", pair(self.firmware)),
            ("service_us", number(self.service_us)),
            ("mailbox_us", number(self.mailbox_us)),
            ("restart_ms", number(self.restart_ms)),
            ("schedule_depth", number(self.schedule_depth)),
            ("sync0_window_us", pair(self.sync0_window_us)),
            ("internal_loopback", number(self.internal_loopback.map(u32::from))),
            ("sample_point_permille", number(self.sample_point_permille)),
            ("wired_sample_point_permille", number(self.wired_sample_point_permille)),
            ("transceiver_ns", number(self.transceiver_ns)),
        ];
        values.into_iter().filter_map(|(key, value)| Some((key, value?)))
    }

    fn read(mut table: Table<'_, '_>) -> Self {
        const US: (u32, u32) = (0, 1_000_000);
        const PERMILLE: (u32, u32) = (0, 1_000);
        Self {
            serial: read_serial(&mut table),
            firmware: table.pair("firmware", (0, 0xFFFF)),
            service_us: table.unsigned("service_us", US),
            mailbox_us: table.unsigned("mailbox_us", (0, 60_000_000)),
            restart_ms: table.unsigned("restart_ms", (0, 600_000)),
            schedule_depth: table.unsigned("schedule_depth", (1, 0xFFFF)),
            sync0_window_us: table.pair("sync0_window_us", US),
            internal_loopback: table.unsigned("internal_loopback", (1, 3)),
            sample_point_permille: table.unsigned("sample_point_permille", PERMILLE),
            wired_sample_point_permille: table.unsigned("wired_sample_point_permille", PERMILLE),
            transceiver_ns: table.unsigned("transceiver_ns", (0, 10_000)),
        }
    }
}

fn read_serial(table: &mut Table<'_, '_>) -> Option<u64> {
    let text = table.text("serial")?;
    let serial = text.parse().ok();
    if serial.is_none() {
        let allowed = "allowed: an unsigned number of 64 bits in quotation marks";
        table.fault("serial", format!("`serial` = \"{text}\" is invalid; {allowed}"));
    }
    serial
}
