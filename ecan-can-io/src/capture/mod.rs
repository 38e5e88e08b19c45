//! Captures for Wireshark: CAN frames and PDO images of gateways in one pcapng file.
//!
//! CAN frames use the link type `LINKTYPE_CAN_SOCKETCAN` (227). PDO images (manual 6) use the first
//! private link type (`LINKTYPE_USER0`, 147) with a header of 16 bytes, see [`ImageOrigin`];
//! `packaging/wireshark/ecan_pdo.lua` dissects them. Each channel and each gateway is an interface of the
//! capture, named `can0`, `can1` ... and `ecan0` ....
//!
//! [`Capture`] writes synchronously. [`Recorder`] writes on a thread of its own, for applications
//! that must not wait.
//!
//! # In an application
//!
//! Call the recorder from the cycle: record received frames and the TxPDO image after the cycle
//! begins, and likewise the RxPDO image after it ends. Record a sent frame when it is sent, as here,
//! or when the gateway reports its transmit result (manual 10). Start the recorder before the
//! real-time settings of the cycle thread are applied, so that its thread does not inherit them.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # use ecan_sim::{ClockKind, EcrtSetting, SimOptions};
//! # let setting = EcrtSetting::resolve(Some("sim"))?;
//! # let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
//! # let ecrt = ecan_sim::open(&setting, &options)?.ecrt;
//! # let directory = tempfile::tempdir()?;
//! # let path = directory.path().join("drive.pcapng");
//! use ecan_can_io::capture::{Capture, ImageOrigin, Recorder, Traffic};
//! use ecan_host::AdapterConfig;
//! use ecan_protocol::can::{CanFrame, CanId};
//! use ecan_protocol::mapping::{CHUNK_BYTES, Direction};
//! use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, Received};
//!
//! // `ecrt` is the loaded library, `path` the file.
//! let mut gateway = GatewayConfig::default();
//! gateway.channels[0] = Some(ChannelConfig::classic(500_000));
//! let adapter = AdapterConfig::new(1).with_multiplier(2);
//! let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(1, gateway)))?;
//!
//! let file = std::io::BufWriter::new(std::fs::File::create(&path)?);
//! let mut recorder = Recorder::start(Capture::new(file, "my machine 1.0")?, 2 * CHUNK_BYTES)?;
//! # recorder.set_patient(true); // simulated time waits for the file
//! let profile = gateway.profile(Direction::TxPdo, 2);
//! let origin = ImageOrigin { slave: 0, direction: Direction::TxPdo, profile };
//!
//! port.wait_ready()?;
//! let can0 = port.channel(0, 0)?;
//! let frame = CanFrame::classic(CanId::standard(0x123)?, &[1, 2, 3])?;
//! for number in 0..100 {
//!     let mut cycle = port.next_cycle();
//!     // Time stamps are nanoseconds since 1970, whatever the clock of the cycle counts.
//!     let now_ns = std::time::UNIX_EPOCH.elapsed()?.as_nanos() as u64;
//!     recorder.image(now_ns, origin, cycle.adapter().tx_pdo(0));
//!     for item in cycle.received() {
//!         if let Received::Frame(it) = item.to_owned() {
//!             recorder.frame(now_ns, it.channel.into(), Traffic::Received, &it.frame);
//!         }
//!     }
//!     if number == 0 {
//!         cycle.send(can0, &frame)?;
//!         recorder.frame(now_ns, 0, Traffic::Sent, &frame);
//!     }
//!     cycle.end()?;
//! }
//! let recording = recorder.finish()?;
//! assert_eq!(recording.dropped, 0);
//! # assert_eq!(recording.written, 102, "the simulated node echoes the frame");
//! # Ok(()) }
//! ```
//!
//! A recorder drops and counts packets if the file is too slow, see [`Recording`]. `ecan dump`,
//! `send`, `gen`, `replay` and `bridge` use it for `--capture FILE`.

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
