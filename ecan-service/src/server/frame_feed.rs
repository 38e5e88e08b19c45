//! Frames and images of the cycle, and the frames of clients that the cycle sends.

use std::collections::VecDeque;

use ecan_mcan_port::{
    ImageEvent, ImageRecord, ImageStream, QueueError, QueuedFrames, TransmitQueues,
};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ImageReader, OptionFlags, Packet, PdoProfile, TxResult};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::protocol::{FrameEvent, FrameReport, ImageMessage, RejectReason};
use crate::server::bus_view::BusView;
use crate::server::job_queue::ClientId;

/// Images that the gateway sends after a published one until its missing results count as lost: 1 s at a
/// cycle of 1 ms. Results arrive one or two images later, later under back pressure. A result in an image
/// that was lost never arrives.
const MAX_IMAGES: u64 = 1000;
/// Published frames of a gateway that wait for results; an image has up to 255. The oldest ones beyond them
/// count as lost.
const MAX_OPEN_FRAMES: usize = 16 << 10;
/// Records that are read in a row, before clients are served again.
const MAX_RECORDS: usize = 1024;

/// Client and tag of a frame.
pub(crate) type Owner = (ClientId, u32);

/// Receiver of what a feed reads.
pub(crate) trait FeedSink {
    /// A frame event; its tag is that of the owner.
    fn frame(&mut self, report: &FrameReport, owner: Option<Owner>);
    fn image(&mut self, image: ImageMessage<'_>);
    /// Images, and the frames in them, that found the ring of the cycle full.
    fn lost(&mut self, images: u32, packets: u32);
}

#[derive(Debug)]
pub(crate) struct FrameFeed {
    stream: ImageStream,
    queues: TransmitQueues,
    accounts: Accounts,
    /// A client needs the images; the stream is paused otherwise.
    is_active: bool,
    is_closed: bool,
}

/// Frames of clients, and published frames without result.
#[derive(Debug)]
struct Accounts {
    gateways: Vec<GatewayAccount>,
    /// Offset of the cycle clock to the time since 1970.
    since_1970_ns: u64,
    /// Time of the last record, since 1970.
    last_time_ns: u64,
}

#[derive(Debug)]
struct GatewayAccount {
    channels: [ChannelQueue; CHANNELS],
    published: VecDeque<PublishedImage>,
    /// Frames without result in the published images.
    open_frames: usize,
    /// Images that were received since the start.
    received: u64,
    has_results: bool,
}

/// Frames in the transmit queue of a channel.
#[derive(Debug, Default)]
struct ChannelQueue {
    frames: VecDeque<(Owner, CanFrame)>,
    /// Frames that were queued since the start.
    pushed: u64,
}

impl ChannelQueue {
    /// Takes the next frame if it was queued before the first `count` frames were.
    fn take_before(&mut self, count: u64) -> Option<(Owner, CanFrame)> {
        let next = self.pushed - self.frames.len() as u64;
        if next < count { self.frames.pop_front() } else { None }
    }
}

#[derive(Debug)]
struct PublishedImage {
    sequence: u16,
    /// Number of the cycle.
    cycle: u64,
    /// Images that were received before it.
    received: u64,
    /// By index in the image; `None` after the result.
    frames: Vec<Option<PublishedFrame>>,
    /// Frames without result.
    open: usize,
}

#[derive(Debug, Clone, Copy)]
struct PublishedFrame {
    channel: u8,
    frame: CanFrame,
    owner: Option<Owner>,
}

impl FrameFeed {
    /// `has_results` of each gateway.
    pub(crate) fn new(
        mut stream: ImageStream,
        queues: TransmitQueues,
        has_results: impl Iterator<Item = bool>,
        since_1970_ns: u64,
    ) -> Self {
        let gateways = has_results.map(|has_results| GatewayAccount {
            channels: Default::default(),
            published: VecDeque::new(),
            open_frames: 0,
            received: 0,
            has_results,
        });
        let gateways = gateways.collect();
        let accounts = Accounts { gateways, since_1970_ns, last_time_ns: 0 };
        stream.set_paused(true);
        Self { stream, queues, accounts, is_active: false, is_closed: false }
    }

    pub(crate) fn is_active(&self) -> bool {
        self.is_active
    }

    /// Starts to read what the cycle writes from now on.
    pub(crate) fn activate(&mut self) {
        if !self.is_active {
            self.stream.clear();
            self.stream.set_paused(false);
            self.is_active = true;
        }
    }

    /// Reads what the cycle wrote, then ends every frame without result.
    pub(crate) fn close(&mut self, sink: &mut impl FeedSink) {
        // Before the last record is read.
        let is_cycle_over = self.stream.is_closed();
        while self.is_active
            && let Some(record) = self.stream.next()
        {
            self.accounts.take(&record, sink);
        }
        self.is_closed = true;
        self.accounts.close(is_cycle_over, sink);
    }

    /// Queues a frame of a client; the cycle withdraws it at `expires_ns` on its clock.
    pub(crate) fn transmit(
        &mut self,
        owner: Owner,
        gateway: u16,
        channel: u8,
        frame: &CanFrame,
        expires_ns: u64,
    ) -> Result<(), RejectReason> {
        if self.is_closed {
            return Err(RejectReason::Closed);
        }
        self.activate();
        let slave = usize::from(gateway);
        let account = self.accounts.gateways.get_mut(slave);
        let queue = account.and_then(|account| account.channels.get_mut(usize::from(channel)));
        let Some(queue) = queue else { return Err(RejectReason::NoSuchChannel) };
        self.queues.push_until(slave, channel, frame, expires_ns).map_err(|error| match error {
            QueueError::Full { .. } => RejectReason::QueueFull,
            QueueError::NotFd { .. } => RejectReason::NotFd,
            QueueError::ReceiveOnly { .. } => RejectReason::ReceiveOnly,
            QueueError::Closed => RejectReason::Closed,
            _ => RejectReason::NoSuchChannel,
        })?;
        queue.pushed += 1;
        queue.frames.push_back((owner, *frame));
        Ok(())
    }

    /// Reads what the cycle wrote. `is_needed`: a client needs the images. `view` has the state of the
    /// gateways. Returns whether more is left.
    pub(crate) fn drain(
        &mut self,
        is_needed: bool,
        view: &mut BusView,
        sink: &mut impl FeedSink,
    ) -> bool {
        if !is_needed && !self.accounts.has_frames() {
            if std::mem::replace(&mut self.is_active, false) {
                self.stream.set_paused(true);
                self.accounts.forget();
            }
            return false;
        }
        self.activate();
        // Before the last record is read.
        let is_closed = self.stream.is_closed();
        let lost_sessions = self.accounts.lost_sessions(view);
        for _ in 0..MAX_RECORDS {
            let Some(record) = self.stream.next() else {
                self.accounts.end_sessions(&lost_sessions, sink);
                if is_closed && !self.is_closed {
                    self.close(sink);
                }
                return false;
            };
            self.accounts.take(&record, sink);
        }
        true
    }
}

impl Accounts {
    fn has_frames(&self) -> bool {
        let has_owner = |image: &PublishedImage| {
            image.frames.iter().flatten().any(|frame| frame.owner.is_some())
        };
        self.gateways.iter().any(|gateway| {
            gateway.channels.iter().any(|queue| !queue.frames.is_empty())
                || gateway.published.iter().any(has_owner)
        })
    }

    fn forget(&mut self) {
        for gateway in &mut self.gateways {
            gateway.published.clear();
            gateway.open_frames = 0;
        }
    }

    /// Gateways with open frames that are not ready in the last cycle, and the number of this cycle: the
    /// records up to it are written.
    fn lost_sessions(&self, view: &mut BusView) -> Vec<(usize, u64)> {
        let open = self.gateways.iter().enumerate().filter(|(_, gateway)| gateway.open_frames > 0);
        open.filter_map(|(slave, _)| Some((slave, view.cycle_of_lost_session(slave)?))).collect()
    }

    /// No results of sessions that are lost arrive any more.
    fn end_sessions(&mut self, lost: &[(usize, u64)], sink: &mut impl FeedSink) {
        let time_ns = self.last_time_ns;
        for (slave, cycle) in lost {
            let Some(gateway) = self.gateways.get_mut(*slave) else { continue };
            let mut report = Reporter { time_ns, slave: *slave, sink };
            while gateway.published.front().is_some_and(|image| image.cycle <= *cycle) {
                gateway.lose_first(&mut report);
            }
        }
    }

    fn take(&mut self, record: &ImageRecord<'_>, sink: &mut impl FeedSink) {
        if record.lost_before > 0 {
            sink.lost(record.lost_before, record.lost_packets);
        }
        let time_ns = record.time_ns.wrapping_add(self.since_1970_ns);
        self.last_time_ns = time_ns;
        let image = |slave: usize, direction, profile, image| ImageMessage {
            time_ns,
            cycle: record.cycle,
            lost: 0,
            gateway: slave as u16,
            direction,
            profile,
            image,
        };
        match record.event {
            ImageEvent::Received { slave, profile, image: bytes } => {
                sink.image(image(slave, Direction::TxPdo, profile, bytes));
                self.received(time_ns, slave, profile, bytes, sink);
            }
            ImageEvent::Published { slave, profile, image: bytes, queued } => {
                sink.image(image(slave, Direction::RxPdo, profile, bytes));
                let read = ImageReader::new(Direction::RxPdo, profile).with_crc(false).read(bytes);
                if let Ok(image) = read {
                    let frames = image.packets().map_while(Result::ok).filter_map(frame_of);
                    let frames = frames.collect();
                    let time = (record.cycle, time_ns);
                    self.published(time, slave, image.sequence(), frames, queued, sink);
                }
            }
            ImageEvent::Rejected { slave, channel, frames, taken, is_expired } => {
                let Some(gateway) = self.gateways.get_mut(slave) else { return };
                let Some(queue) = gateway.channels.get_mut(usize::from(channel)) else { return };
                let mut report = Reporter { time_ns, slave, sink };
                let sent = taken.saturating_sub(frames.into());
                while let Some((owner, frame)) = queue.take_before(sent) {
                    report.frame(channel, frame, Some(owner), FrameEvent::Unknown);
                }
                let reason =
                    if is_expired { RejectReason::Expired } else { RejectReason::NotReady };
                while let Some((owner, frame)) = queue.take_before(taken) {
                    let event = FrameEvent::Rejected(reason);
                    report.frame(channel, frame, Some(owner), event);
                }
            }
        }
    }

    fn received(
        &mut self,
        time_ns: u64,
        slave: usize,
        profile: PdoProfile,
        bytes: &[u8],
        sink: &mut impl FeedSink,
    ) {
        // The Port has checked the image: a copy without CRC is one that the options allow.
        let reader = ImageReader::new(Direction::TxPdo, profile).with_crc(false);
        let (Some(gateway), Ok(image)) = (self.gateways.get_mut(slave), reader.read(bytes)) else {
            return;
        };
        gateway.has_results = profile.options.contains(OptionFlags::TX_RESULT);
        let mut report = Reporter { time_ns, slave, sink };
        for packet in image.packets().map_while(Result::ok) {
            match packet {
                Packet::Frame(packet) => {
                    let frame = packet.frame.to_owned();
                    report.frame(packet.channel, frame, None, FrameEvent::Received);
                }
                Packet::TxResult(result) => gateway.result(&result, &mut report),
            }
        }
        gateway.received += 1;
        let received = gateway.received;
        let is_old = |image: &PublishedImage| received - image.received > MAX_IMAGES;
        while gateway.published.front().is_some_and(is_old) {
            gateway.lose_first(&mut report);
        }
    }

    fn published(
        &mut self,
        (cycle, time_ns): (u64, u64),
        slave: usize,
        sequence: u16,
        mut frames: Vec<Option<PublishedFrame>>,
        queued: QueuedFrames,
        sink: &mut impl FeedSink,
    ) {
        let Some(gateway) = self.gateways.get_mut(slave) else { return };
        let mut report = Reporter { time_ns, slave, sink };
        for ((channel, queue), (sent, taken)) in
            (0_u8..).zip(&mut gateway.channels).zip(queued.sent.into_iter().zip(queued.taken))
        {
            // Of records that were lost.
            while let Some((owner, frame)) = queue.take_before(taken.saturating_sub(sent.into())) {
                report.frame(channel, frame, Some(owner), FrameEvent::Unknown);
            }
            let of_channel = frames.iter_mut().flatten().filter(|frame| frame.channel == channel);
            let mut last: Vec<_> = of_channel.rev().take(sent.into()).collect();
            while let (Some((owner, _)), Some(frame)) = (queue.take_before(taken), last.pop()) {
                frame.owner = Some(owner);
            }
        }
        if !gateway.has_results {
            for PublishedFrame { channel, frame, owner } in frames.into_iter().flatten() {
                report.frame(channel, frame, owner, FrameEvent::Published);
            }
        } else if !frames.is_empty() {
            let (open, received) = (frames.len(), gateway.received);
            let image = PublishedImage { sequence, cycle, received, frames, open };
            gateway.published.push_back(image);
            gateway.open_frames += open;
            while gateway.open_frames > MAX_OPEN_FRAMES {
                gateway.lose_first(&mut report);
            }
        }
    }

    /// `is_cycle_over`: the frames in the queues are not sent any more.
    fn close(&mut self, is_cycle_over: bool, sink: &mut impl FeedSink) {
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let mut report = Reporter { time_ns: 0, slave, sink };
            while !gateway.published.is_empty() {
                gateway.lose_first(&mut report);
            }
            for (channel, queue) in (0_u8..).zip(&mut gateway.channels) {
                for (owner, frame) in queue.frames.drain(..) {
                    let event = match is_cycle_over {
                        true => FrameEvent::Rejected(RejectReason::Closed),
                        false => FrameEvent::Unknown,
                    };
                    report.frame(channel, frame, Some(owner), event);
                }
            }
        }
    }
}

/// A frame of an image; the place of a packet that is none.
fn frame_of(packet: Packet<'_>) -> Option<Option<PublishedFrame>> {
    match packet {
        Packet::Frame(packet) => Some(Some(PublishedFrame {
            channel: packet.channel,
            frame: packet.frame.to_owned(),
            owner: None,
        })),
        Packet::TxResult(_) => None,
    }
}

impl GatewayAccount {
    /// Reports the frame of a transmit result. Its image may be older than the subscription.
    fn result(&mut self, result: &TxResult, report: &mut Reporter<'_, impl FeedSink>) {
        let image = self.published.iter_mut().rev().find(|image| image.sequence == result.sequence);
        let Some(image) = image else { return };
        let slot = image.frames.get_mut(usize::from(result.frame_index));
        let frame = slot.and_then(|slot| slot.take_if(|frame| frame.channel == result.channel));
        let Some(PublishedFrame { channel, frame, owner }) = frame else { return };
        image.open -= 1;
        self.open_frames = self.open_frames.saturating_sub(1);
        let event = if result.code.is_success() {
            FrameEvent::Transmitted
        } else {
            FrameEvent::Failed(result.code)
        };
        report.frame(channel, frame, owner, event);
        while self.published.front().is_some_and(|image| image.open == 0) {
            self.published.pop_front();
        }
    }

    /// The results of the oldest image are not known and will not be.
    fn lose_first(&mut self, report: &mut Reporter<'_, impl FeedSink>) {
        let Some(image) = self.published.pop_front() else { return };
        self.open_frames = self.open_frames.saturating_sub(image.open);
        for PublishedFrame { channel, frame, owner } in image.frames.into_iter().flatten() {
            report.frame(channel, frame, owner, FrameEvent::Unknown);
        }
    }
}

/// Reports the frames of one gateway.
struct Reporter<'a, S> {
    time_ns: u64,
    slave: usize,
    sink: &'a mut S,
}

impl<S: FeedSink> Reporter<'_, S> {
    fn frame(&mut self, channel: u8, frame: CanFrame, owner: Option<Owner>, event: FrameEvent) {
        let tag = owner.map_or(0, |(_, tag)| tag);
        let report = FrameReport {
            time_ns: self.time_ns,
            gateway: self.slave as u16,
            channel,
            tag,
            event,
            frame,
        };
        self.sink.frame(&report, owner);
    }
}
