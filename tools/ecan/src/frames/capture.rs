//! A capture for Wireshark, written beside the cycle.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use clap::Args;
use ecan_capture::{Capture, ErrorFrame, ImageOrigin, Recorder, Traffic};
use ecan_protocol::{CHANNELS, ChannelStatus, Direction, HEADER_BYTES};

use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::frames::format::Heard;
use crate::frames::service::Service;
use crate::output::Output;

/// Where to and what.
#[derive(Debug, Args)]
pub struct CaptureOptions {
    /// Write a capture for Wireshark (pcapng); nothing is shown then, but with --screen
    #[arg(long, value_name = "FILE")]
    capture: Option<PathBuf>,
    /// Write the process images too, those that differ from the one before in their header
    #[arg(long, requires = "capture")]
    images: bool,
}

impl CaptureOptions {
    /// The file, where there is to be a capture.
    pub fn path(&self) -> Option<&Path> {
        self.capture.as_deref()
    }
}

/// The fixed header of an image.
type ImageHeader = [u8; HEADER_BYTES];

/// A capture of one gateway.
#[derive(Debug)]
pub struct FrameCapture {
    recorder: Recorder,
    path: PathBuf,
    has_images: bool,
    status: [Option<ChannelStatus>; CHANNELS],
    /// Of the last images, RxPDO and TxPDO.
    headers: (ImageHeader, ImageHeader),
}

impl FrameCapture {
    /// Creates the file, if it is wanted, and starts the thread that writes it.
    pub fn start(options: &CaptureOptions, pdo_bytes: usize) -> Result<Option<Self>, Failure> {
        let Some(path) = options.capture.clone() else { return Ok(None) };
        let image_bytes = if options.images { pdo_bytes } else { 0 };
        let application = concat!("ecan ", env!("CARGO_PKG_VERSION"));
        let recorder = File::create(&path)
            .and_then(|file| Capture::new(BufWriter::new(file), application))
            .and_then(|capture| Recorder::start(capture, image_bytes));
        match recorder {
            Ok(recorder) => Ok(Some(Self {
                recorder,
                path,
                has_images: options.images,
                status: [None; CHANNELS],
                headers: Default::default(),
            })),
            Err(error) => Err(write_failure(path, &error)),
        }
    }

    /// What the beginning of a cycle has brought, but for the frames: the image of the gateway, and
    /// the changes of the channels' status as error frames.
    pub fn after_begin(&mut self, service: &Service, channels: Channels) {
        self.recorder.set_patient(!service.is_real_time());
        let time_ns = service.absolute_ns(service.now_ns());
        for channel in channels.iter() {
            let now = service.port().channel_status(0, channel);
            let Some(last) = self.status.get_mut(usize::from(channel)) else { continue };
            let error = last.and_then(|before| ErrorFrame::of_change(before, now));
            *last = Some(now);
            if let Some(error) = error {
                self.recorder.error(time_ns, channel.into(), error);
            }
        }
        self.image(service, Direction::TxPdo);
    }

    /// A frame that came.
    pub fn received(&mut self, heard: &Heard) {
        let (port, frame) = (heard.received.channel.into(), &heard.received.frame);
        self.recorder.frame(heard.time_ns, port, Traffic::Received, frame);
    }

    /// What the end of a cycle has sent: the image for the gateway.
    pub fn after_end(&mut self, service: &Service) {
        self.image(service, Direction::RxPdo);
    }

    fn image(&mut self, service: &Service, direction: Direction) {
        let adapter = service.port().adapter();
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
            (adapter.config().slaves.first(), service.port().config().gateways.first())
        else {
            return;
        };
        let multiplier = match direction {
            Direction::RxPdo => slave.rx_multiplier,
            Direction::TxPdo => slave.tx_multiplier,
        };
        let profile = gateway.profile(direction, multiplier);
        let origin = ImageOrigin { slave: slave.position, direction, profile };
        self.recorder.image(service.absolute_ns(service.now_ns()), origin, image);
    }

    /// Whether it can write no more.
    pub fn is_over(&self) -> bool {
        self.recorder.is_over()
    }

    /// Waits until everything is written; says what was dropped.
    pub fn finish(self, output: &Output) -> Result<(), Failure> {
        let recording = self.recorder.finish().map_err(|error| write_failure(self.path, &error))?;
        if recording.dropped > 0 {
            let words = "packets are not in the capture: the file is too slow";
            output.note(format_args!("# {} {words}", recording.dropped));
        }
        Ok(())
    }
}

fn write_failure(path: PathBuf, error: &std::io::Error) -> Failure {
    Failure::File { what: "write", path, reason: error.to_string() }
}
