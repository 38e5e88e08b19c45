//! Captures for Wireshark: CAN frames and PDO images of gateways in one pcapng file.
//!
//! CAN frames use the link type `LINKTYPE_CAN_SOCKETCAN` (227). PDO images (manual 6) use the first
//! private link type (`LINKTYPE_USER0`, 147) with a header of 16 bytes, see [`ImageOrigin`];
//! `wireshark/ecan_pdo.lua` dissects them. Each channel and each gateway is an interface of the
//! capture, named `can0`, `can1` ... and `ecan0` ....
//!
//! [`Capture`] writes synchronously. [`Recorder`] writes on a thread of its own, for applications
//! that must not wait.
//!
//! # In an application
//!
//! Call the recorder from the cycle: record received frames and the TxPDO image after the cycle
//! begins, and the RxPDO image after it ends. Record a sent frame when it is sent, as here, or when
//! the gateway reports its transmit result (manual 10). Start the recorder before the real-time
//! settings of the cycle thread are applied, so that its thread does not inherit them.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # use ecan_sim::{ClockKind, EcrtSetting, SimOptions};
//! # let setting = EcrtSetting::resolve(Some("sim"))?;
//! # let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
//! # let ecrt = ecan_sim::open(&setting, &options)?.ecrt;
//! # let directory = tempfile::tempdir()?;
//! # let path = directory.path().join("drive.pcapng");
//! use std::time::Duration;
//!
//! use ecan_capture::{Capture, ImageOrigin, Recorder, Traffic};
//! use ecan_host::AdapterConfig;
//! use ecan_protocol::can::{CanFrame, CanId};
//! use ecan_protocol::mapping::{CHUNK_BYTES, Direction};
//! use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, Received};
//!
//! // `ecrt` is the loaded library, `path` the file.
//! let n = 2;
//! let mut gateway = GatewayConfig::default();
//! gateway.channels[0] = Some(ChannelConfig::classic(500_000));
//! let adapter = AdapterConfig::new(1).with_multiplier(n).with_cycle(Duration::from_millis(1));
//! let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(1, gateway)))?;
//!
//! let file = std::io::BufWriter::new(std::fs::File::create(&path)?);
//! let image_bytes = usize::from(n) * CHUNK_BYTES;
//! let mut recorder = Recorder::start(Capture::new(file, "my machine 1.0")?, image_bytes)?;
//! let origin = |port: &Port, direction| ImageOrigin {
//!     slave: 0,
//!     direction,
//!     profile: port.config().gateways[0].profile(direction, n),
//! };
//!
//! port.wait_ready()?;
//! let can0 = port.channel(0, 0)?;
//! # recorder.set_patient(true); // simulated time waits for the file
//! let frame = CanFrame::classic(CanId::standard(0x123)?, &[1, 2, 3])?;
//! let mut has_come_back = false;
//! for number in 0..100 {
//!     let mut cycle = port.next_cycle();
//!     // Time stamps are nanoseconds since 1970, whatever the clock of the cycle counts.
//!     let now_ns = since_1970_ns();
//!     recorder.image(now_ns, origin(&cycle, Direction::TxPdo), cycle.adapter().tx_pdo(0));
//!     for item in cycle.received() {
//!         if let Received::Frame(it) = item.to_owned() {
//!             recorder.frame(now_ns, it.channel.into(), Traffic::Received, &it.frame);
//!             has_come_back |= it.frame == frame;
//!         }
//!     }
//!     if number == 0 {
//!         cycle.send(can0, &frame)?;
//!         recorder.frame(now_ns, 0, Traffic::Sent, &frame);
//!     }
//!     cycle.end()?;
//!     recorder.image(now_ns, origin(&port, Direction::RxPdo), port.adapter().rx_pdo(0));
//! }
//! let recording = recorder.finish()?;
//! assert_eq!(recording.dropped, 0);
//! # assert!(has_come_back, "the simulated node echoes");
//! # assert_eq!(recording.written, 202);
//! # assert!(std::fs::metadata(&path)?.len() > 200 * 256);
//!
//! /// Real-time safe: the clock is read without a system call.
//! fn since_1970_ns() -> u64 {
//!     let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
//!     now.map_or(0, |since| since.as_nanos() as u64)
//! }
//! # Ok(()) }
//! ```
//!
//! A recorder drops and counts packets if the file is too slow, see [`Recording`]. `ecan dump`,
//! `send`, `gen`, `replay` and `bridge` use it for `--capture FILE`.

#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod capture;
mod error_frame;
mod image;
mod pcapng;
mod recorder;
mod socketcan;

pub use capture::{Capture, Traffic};
pub use error_frame::ErrorFrame;
pub use image::{IMAGE_HEADER_BYTES, ImageOrigin};
pub use recorder::{Recorder, Recording};
