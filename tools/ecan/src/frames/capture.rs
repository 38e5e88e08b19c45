//! Capture of frames and images for Wireshark.

use std::collections::HashMap;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use clap::Args;
use ecan_capture::{Capture, ErrorFrame, ImageOrigin, Recorder, Traffic};
use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::new_file::{Existing, create, is_standard_stream};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{Port, Received, SendTicket, Session};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::{CHANNELS, CHUNK_BYTES, Direction, HEADER_BYTES};

use crate::context::{Failure, Result, note};
use crate::frames::arrival::Arrival;
use crate::frames::channels::Channels;
use crate::frames::single_gateway::{channel_status, session};

const PENDING_FRAMES: usize = 4096;

#[derive(Debug, Args)]
pub struct CaptureOptions {
    /// Write received and sent frames for Wireshark (pcapng); - is stdout
    #[arg(long, value_name = "FILE")]
    capture: Option<PathBuf>,
    /// Write PDO images too, whenever their header changes
    #[arg(long, requires = "capture")]
    images: bool,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

impl CaptureOptions {
    pub fn existing(&self) -> Existing {
        Existing::forced(self.force)
    }

    pub fn is_on_output(&self) -> bool {
        self.path().is_some_and(is_standard_stream)
    }

    pub fn path(&self) -> Option<&Path> {
        self.capture.as_deref()
    }

    pub fn check_apart_from(&self, log: Option<&Path>) -> Result {
        match log.is_some() && log == self.path() {
            true => Err(Failure::Usage("--record and --capture name the same file".to_owned())),
            false => Ok(()),
        }
    }
}

type ImageHeader = [u8; HEADER_BYTES];

#[derive(Debug)]
pub struct FrameCapture {
    recorder: Recorder,
    path: PathBuf,
    has_images: bool,
    /// Channels whose state is recorded.
    channels: Channels,
    /// Offset from the cycle clock to the time since 1970.
    since_1970_ns: u64,
    status: [Option<ChannelStatus>; CHANNELS],
    /// Headers of the last images, RxPDO and TxPDO.
    headers: (ImageHeader, ImageHeader),
    /// Frames without transmit result, with their channels.
    pending: HashMap<SendTicket, (u8, CanFrame)>,
}

impl FrameCapture {
    pub fn start(
        options: &CaptureOptions,
        adapter: &AdapterConfig,
        channels: Channels,
        interrupt: &Interrupt,
    ) -> Result<Option<Self>> {
        let Some(path) = options.capture.clone() else { return Ok(None) };
        let chunks = adapter.slaves.iter().map(|it| it.rx_multiplier.max(it.tx_multiplier)).max();
        let image_bytes = match options.images {
            true => usize::from(chunks.unwrap_or(0)) * CHUNK_BYTES,
            false => 0,
        };
        let application = concat!("ecan ", env!("CARGO_PKG_VERSION"));
        let recorder = create(&path, options.existing())
            .and_then(|file| Capture::new(BufWriter::new(file), application))
            .and_then(|capture| Recorder::start(capture, image_bytes));
        match recorder {
            Ok(mut recorder) => {
                recorder.set_hurry(interrupt.flag());
                Ok(Some(Self {
                    recorder,
                    path,
                    has_images: options.images,
                    channels,
                    since_1970_ns: 0,
                    status: [None; CHANNELS],
                    headers: Default::default(),
                    pending: HashMap::with_capacity(PENDING_FRAMES),
                }))
            }
            Err(error) => Err(write_failure(path, error)),
        }
    }

    /// Sets the time base, and waits for the file in simulated time.
    pub fn with_time(mut self, is_real_time: bool, since_1970_ns: u64) -> Self {
        self.recorder.set_patient(!is_real_time);
        Self { since_1970_ns, ..self }
    }

    /// Records the results of a cycle start: the TxPDO image, status changes as error frames,
    /// received frames, and sent frames with a transmit result.
    pub fn after_begin(&mut self, port: &Port, now_ns: u64, arrivals: &[Arrival]) {
        for channel in self.channels.iter() {
            let now = channel_status(port, channel);
            let Some(last) = self.status.get_mut(usize::from(channel)) else { continue };
            let error = last.and_then(|before| ErrorFrame::of_change(before, now));
            *last = Some(now);
            if let Some(error) = error {
                self.recorder.error(self.absolute_ns(now_ns), channel.into(), error);
            }
        }
        self.image(port, now_ns, Direction::TxPdo);
        if session(port) != Session::Ready {
            // Results of frames before the loss never arrive.
            self.pending.clear();
        }
        for arrival in arrivals {
            let time_ns = self.absolute_ns(arrival.time_ns);
            match &arrival.received {
                Received::Frame(received) => {
                    let (port_number, frame) = (received.channel.into(), &received.frame);
                    self.recorder.frame(time_ns, port_number, Traffic::Received, frame);
                }
                Received::TransmitReport(report) => {
                    let sent = report.ticket.and_then(|ticket| self.pending.remove(&ticket));
                    if let Some((channel, frame)) = sent.filter(|_| report.code.is_success()) {
                        self.recorder.frame(time_ns, channel.into(), Traffic::Sent, &frame);
                    }
                }
            }
        }
    }

    pub fn add_pending(&mut self, ticket: SendTicket, channel: u8, frame: &CanFrame) {
        self.pending.insert(ticket, (channel, *frame));
    }

    pub fn after_end(&mut self, port: &Port, now_ns: u64) {
        self.image(port, now_ns, Direction::RxPdo);
    }

    fn absolute_ns(&self, time_ns: u64) -> u64 {
        time_ns.wrapping_add(self.since_1970_ns)
    }

    fn image(&mut self, port: &Port, now_ns: u64, direction: Direction) {
        let adapter = port.adapter();
        let (image, last) = match direction {
            Direction::RxPdo => (adapter.rx_pdo(0), &mut self.headers.0),
            Direction::TxPdo => (adapter.tx_pdo(0), &mut self.headers.1),
        };
        let Some(header) = image.first_chunk() else { return };
        if !self.has_images || header == last {
            return;
        }
        *last = *header;
        let (Some(slave), Some(gateway)) =
            (adapter.config().slaves.first(), port.config().gateways.first())
        else {
            return;
        };
        let multiplier = match direction {
            Direction::RxPdo => slave.rx_multiplier,
            Direction::TxPdo => slave.tx_multiplier,
        };
        let profile = gateway.profile(direction, multiplier);
        let origin = ImageOrigin { slave: slave.position, direction, profile };
        self.recorder.image(self.absolute_ns(now_ns), origin, image);
    }

    pub fn is_over(&self) -> bool {
        self.recorder.is_over()
    }

    /// Removes the file of a run that did not start.
    pub fn discard(self) {
        let _ = self.recorder.finish();
        if self.path.metadata().is_ok_and(|found| found.is_file()) {
            let _ = std::fs::remove_file(self.path);
        }
    }

    pub fn finish(self) -> Result {
        let recording = self.recorder.finish().map_err(|error| write_failure(self.path, error))?;
        if recording.dropped > 0 {
            let message = "packets dropped from the capture: the file is too slow";
            note(format_args!("# {} {message}", recording.dropped));
        }
        Ok(())
    }
}

fn write_failure(path: PathBuf, error: std::io::Error) -> Failure {
    if is_standard_stream(&path) {
        return error.into();
    }
    Failure::file("write", &path, error)
}
