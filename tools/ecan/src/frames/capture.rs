//! Capture of frames and images for Wireshark.

use std::collections::HashMap;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use clap::Args;
use ecan_can_io::capture::{Capture, ErrorFrame, ImageOrigin, Recorder, Traffic};
use ecan_host::AdapterConfig;
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ChannelStatus, Timestamp};
use ecan_protocol::mapping::{CHANNELS, CHUNK_BYTES, Direction, HEADER_BYTES};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file::{Existing, create, is_standard_stream};

use crate::context::{Failure, Result, note};
use crate::frames::channels::Channels;
use crate::frames::link::{Arrival, BusFrame, Event, FrameLink, Ticket};

const PENDING_FRAMES: usize = 4096;

#[derive(Clone, Debug, Args)]
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

    pub fn has_images(&self) -> bool {
        self.images
    }

    pub fn check_apart_from(&self, log: Option<&Path>) -> Result {
        match log.is_some() && log == self.path() {
            true => Err(Failure::Usage("--record and --capture name the same file".to_owned())),
            false => Ok(()),
        }
    }
}

type ImageHeader = [u8; HEADER_BYTES];

/// Recorded state of a gateway.
#[derive(Debug)]
struct GatewayCapture {
    /// Channels whose state is recorded.
    channels: Channels,
    status: [Option<ChannelStatus>; CHANNELS],
    /// Headers of the last images, RxPDO and TxPDO.
    headers: (ImageHeader, ImageHeader),
}

#[derive(Debug)]
pub struct FrameCapture {
    recorder: Recorder,
    path: PathBuf,
    has_images: bool,
    gateways: Vec<GatewayCapture>,
    /// Offset from the cycle clock to the time since 1970.
    since_1970_ns: u64,
    /// Frames without transmit result.
    pending: HashMap<Ticket, BusFrame>,
}

/// Number of a channel over all gateways.
fn port_number(gateway: usize, channel: u8) -> usize {
    gateway * CHANNELS + usize::from(channel)
}

impl GatewayCapture {
    fn new(channels: &Channels) -> Self {
        Self { channels: *channels, status: [None; CHANNELS], headers: Default::default() }
    }
}

impl FrameCapture {
    pub fn start(
        options: &CaptureOptions,
        adapter: &AdapterConfig,
        channels: &[Channels],
        interrupt: &Interrupt,
    ) -> Result<Option<Self>> {
        let Some(path) = options.capture.clone() else { return Ok(None) };
        let chunks =
            adapter.slaves.iter().map(|slave| slave.rx_multiplier.max(slave.tx_multiplier)).max();
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
                    gateways: channels.iter().map(GatewayCapture::new).collect(),
                    since_1970_ns: 0,
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

    /// Records the results of a cycle start: the TxPDO images, status changes as error frames,
    /// received frames, and sent frames with a transmit result.
    pub fn after_begin(&mut self, link: &dyn FrameLink, now_ns: u64, arrivals: &[Arrival]) {
        let time_ns = now_ns.wrapping_add(self.since_1970_ns);
        for (gateway, capture) in self.gateways.iter_mut().enumerate() {
            for channel in capture.channels.iter() {
                let now = link.channel_status(gateway, channel);
                let Some(last) = capture.status.get_mut(usize::from(channel)) else { continue };
                let error = last.and_then(|before| ErrorFrame::of_change(before, now));
                *last = Some(now);
                if let Some(error) = error {
                    self.recorder.error(time_ns, port_number(gateway, channel), error);
                }
            }
            if !link.condition(gateway).is_ready() {
                // Results of frames before the loss never arrive.
                self.pending.retain(|_, sent| sent.gateway != gateway);
            }
        }
        self.images(link, Direction::TxPdo);
        for arrival in arrivals {
            match &arrival.event {
                Event::Frame(frame) => {
                    let traffic = if frame.is_sent { Traffic::Sent } else { Traffic::Received };
                    self.frame(arrival.time_ns, traffic, frame);
                }
                Event::Result { ticket, outcome } => {
                    let sent = ticket.and_then(|ticket| self.pending.remove(&ticket));
                    if let Some(sent) = sent.filter(|_| outcome.is_success()) {
                        self.frame(arrival.time_ns, Traffic::Sent, &sent);
                    }
                }
            }
        }
    }

    /// Marks a gap before what is recorded next.
    pub fn lost_images(&mut self, images: u64) {
        self.recorder.lost_images(images);
    }

    fn frame(&mut self, time_ns: u64, traffic: Traffic, frame: &BusFrame) {
        let port_number = port_number(frame.gateway, frame.channel);
        self.recorder.frame(self.absolute_ns(time_ns), port_number, traffic, &frame.frame);
    }

    pub fn add_pending(&mut self, ticket: Ticket, gateway: usize, channel: u8, frame: &CanFrame) {
        let sent =
            BusFrame { gateway, channel, frame: *frame, timestamp: Timestamp::None, is_sent: true };
        self.pending.insert(ticket, sent);
    }

    pub fn after_end(&mut self, link: &dyn FrameLink) {
        self.images(link, Direction::RxPdo);
    }

    fn absolute_ns(&self, time_ns: u64) -> u64 {
        time_ns.wrapping_add(self.since_1970_ns)
    }

    fn images(&mut self, link: &dyn FrameLink, direction: Direction) {
        if !self.has_images {
            return;
        }
        let Self { gateways, recorder, since_1970_ns, .. } = self;
        link.images(direction, &mut |gateway, time_ns, image| {
            let Some(header) = image.first_chunk() else { return };
            let Some(capture) = gateways.get_mut(gateway) else { return };
            let last = match direction {
                Direction::RxPdo => &mut capture.headers.0,
                Direction::TxPdo => &mut capture.headers.1,
            };
            let slave = link.adapter_config().slaves.get(gateway);
            let config = link.port_config().gateways.get(gateway);
            let (Some(slave), Some(config), true) = (slave, config, header != last) else { return };
            *last = *header;
            let multiplier = match direction {
                Direction::RxPdo => slave.rx_multiplier,
                Direction::TxPdo => slave.tx_multiplier,
            };
            let profile = config.profile(direction, multiplier);
            let origin = ImageOrigin { slave: slave.position, direction, profile };
            recorder.image(time_ns.wrapping_add(*since_1970_ns), origin, image);
        });
    }

    pub fn is_over(&self) -> bool {
        self.recorder.is_over()
    }

    /// Removes the file of a run that did not start.
    pub fn discard(self) {
        let _ = self.recorder.finish();
        if self.path.symlink_metadata().is_ok_and(|found| found.is_file()) {
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
