//! Sending CAN frames in a cycle: at once or at a phase of the next Sync0 period.

use ecan_host::Adapter;
use ecan_protocol::can::FrameRef;

use super::options::{Backpressure, SendError, SendOptions, SendTicket, TransmitFrame};
use crate::address::{AddressError, ChannelHandle};
use crate::config::MarginCheck;
use crate::cycle::Cycle;
use crate::cycle_state::CycleState;
use crate::gateway::Gateway;
use crate::port::Port;
use crate::schedule::margin::NotSchedulable;
use crate::transmit::transmitter::PushFault;

/// Result of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batch {
    /// Frames sent, from the front of the batch.
    pub sent: usize,
    /// Error of the next frame; `None` if all were sent.
    pub stopped: Option<SendError>,
}

impl Cycle<'_> {
    /// Sends a frame at once: a [`CanFrame`](ecan_protocol::can::CanFrame) by reference or a [`FrameRef`].
    ///
    /// Writes the packet directly into the PDO image. Real-time safe.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    #[inline]
    pub fn send<'f>(
        &mut self,
        to: ChannelHandle,
        frame: impl Into<FrameRef<'f>>,
    ) -> Result<SendTicket, SendError> {
        let (head, data) = frame.into().into_parts();
        send_now(self.port, to, head, data)
    }

    /// As [`send`](Self::send), to a channel that was not checked before, and inlined: for the C
    /// interface, whose callers have no handle.
    ///
    /// # Errors
    /// As [`send`](Self::send), converted by `reject`.
    #[doc(hidden)]
    #[inline(always)]
    pub fn send_to<E>(
        &mut self,
        (slave, channel): (usize, u8),
        frame: FrameRef<'_>,
        reject: impl FnOnce(SendError) -> E,
    ) -> Result<SendTicket, E> {
        let to = ChannelHandle::new(slave, channel);
        self.port.state.put(&mut self.port.adapter, to, frame, SendOptions::default(), true, reject)
    }

    /// As [`send`](Self::send), with a hint or a schedule.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    #[inline]
    pub fn send_with<'f>(
        &mut self,
        to: ChannelHandle,
        frame: impl Into<FrameRef<'f>>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        send_with(self.port, to, frame.into(), options)
    }

    /// Sends frames in order and stops at the first error, for all channels, so that the rest can be
    /// sent in order in a later cycle. Real-time safe.
    pub fn send_batch(&mut self, frames: &[TransmitFrame]) -> Batch {
        for (sent, frame) in frames.iter().enumerate() {
            if let Err(error) = self.send_with(frame.to, &frame.frame, frame.options) {
                return Batch { sent, stopped: Some(error) };
            }
        }
        Batch { sent: frames.len(), stopped: None }
    }
}

/// Sends the frame of these parts ([`FrameRef::into_parts`]).
fn send_now(
    port: &mut Port,
    to: ChannelHandle,
    head: u64,
    data: &[u8],
) -> Result<SendTicket, SendError> {
    let frame = FrameRef::from_parts(head, data);
    let Port { adapter, state, .. } = port;
    state.put(adapter, to, frame, SendOptions::default(), true, |error| error)
}

fn send_with(
    port: &mut Port,
    to: ChannelHandle,
    frame: FrameRef<'_>,
    options: SendOptions,
) -> Result<SendTicket, SendError> {
    let Port { adapter, state, .. } = port;
    let has_margin = match options.schedule {
        Some(schedule) => {
            state.check_channel(to, frame.is_fd())?;
            state.check_phase(adapter, to, schedule.offset_ns)?
        }
        None => true,
    };
    state.put(adapter, to, frame, options, has_margin, |error| error)
}

impl CycleState {
    /// Writes a frame into the image; the phase of a schedule was checked before. Inlined into both
    /// callers: the one that sends at once, by far the more frequent, has no options to check.
    #[inline(always)]
    fn put<E>(
        &mut self,
        adapter: &mut Adapter,
        to: ChannelHandle,
        frame: FrameRef<'_>,
        options: SendOptions,
        has_margin: bool,
        reject: impl FnOnce(SendError) -> E,
    ) -> Result<SendTicket, E> {
        let (slave, channel) = (to.slave(), to.channel());
        let gateway = match self.gateways.get_mut(slave) {
            Some(gateway) if gateway.accepts(channel, frame) => gateway,
            _ => return Err(reject(self.reject_channel(to, frame.is_fd()))),
        };
        if gateway.is_paced && !gateway.transmitter.window(channel).accepts_frames() {
            return Err(reject(reject_paced(gateway, to)));
        }
        let image = adapter.rx_pdo_mut(slave);
        let id_aux = options.hint as u8;
        match gateway.transmitter.push(image, channel, id_aux, frame, options.schedule) {
            Ok((sequence, index)) => {
                gateway.statistics.channel(channel).frames_accepted += 1;
                if options.schedule.is_some() {
                    gateway.transmitter.accounts_mut().count_scheduled(channel, has_margin);
                }
                Ok(SendTicket { slave, sequence, index })
            }
            Err(error) => Err(reject(reject_push(gateway, to, error))),
        }
    }

    fn check_channel(&self, to: ChannelHandle, is_fd: bool) -> Result<(), SendError> {
        let (slave, channel) = (to.slave(), to.channel());
        let gateway = match self.gateways.get(slave) {
            Some(gateway) if gateway.has_channel(channel) => gateway,
            _ => return Err(self.wrong_address(slave, channel).into()),
        };
        if !gateway.can_send(channel) {
            return Err(SendError::ReceiveOnly { slave, channel });
        }
        if is_fd && !gateway.is_fd(channel) {
            return Err(SendError::NotFd { slave, channel });
        }
        if !gateway.session.is_ready() {
            return Err(SendError::NotReady { slave });
        }
        Ok(())
    }

    /// Error of [`check_channel`](Self::check_channel) for a frame that was not accepted.
    #[cold]
    #[inline(never)]
    fn reject_channel(&self, to: ChannelHandle, is_fd: bool) -> SendError {
        match self.check_channel(to, is_fd) {
            Err(error) => error,
            Ok(()) => self.wrong_address(to.slave(), to.channel()).into(),
        }
    }

    /// Checks that this cycle can meet a phase; returns whether its margin suffices.
    fn check_phase(
        &mut self,
        adapter: &Adapter,
        to: ChannelHandle,
        offset_ns: u32,
    ) -> Result<bool, SendError> {
        let (slave, channel) = (to.slave(), to.channel());
        let reject = |reason| SendError::NotSchedulable { slave, offset_ns, reason };
        let (begun_ns, since_first_ns) = (self.begun_ns(adapter), self.since_first_ns());
        let Some(gateway) = self.gateways.get_mut(slave) else {
            return Err(self.wrong_address(slave, channel).into());
        };
        let margin = gateway.schedule_margin(offset_ns);
        let accounts = gateway.transmitter.accounts_mut();
        accounts.count_request(channel);
        let margin = margin.map_err(reject)?;
        let has_margin = margin.is_sufficient();
        if !has_margin && gateway.schedule.margin_check == MarginCheck::Reject {
            let lacking_ns = margin.lacking_ns();
            return Err(reject(NotSchedulable::NoMargin { lacking_ns }));
        }
        // Frames sent while an image is unconfirmed leave in a later cycle.
        let is_late =
            begun_ns.is_some_and(|ns| gateway.schedule_times.misses_pulse(since_first_ns, ns));
        if is_late || gateway.transmitter.is_unconfirmed() {
            gateway.transmitter.accounts_mut().count_late_rejection(channel);
            return Err(SendError::Backpressure { slave, channel, what: Backpressure::Phase });
        }
        Ok(has_margin)
    }
}

/// Counts a frame that a paced channel rejects, and returns the reason.
#[cold]
#[inline(never)]
fn reject_paced(gateway: &mut Gateway, to: ChannelHandle) -> SendError {
    let (slave, channel) = (to.slave(), to.channel());
    let statistics = gateway.statistics.channel(channel);
    let what = if gateway.transmitter.window(channel).is_bus_off() {
        statistics.rejected_bus_off += 1;
        Backpressure::BusOff
    } else {
        statistics.rejected_queue_full += 1;
        Backpressure::Queue
    };
    SendError::Backpressure { slave, channel, what }
}

#[cold]
#[inline(never)]
fn reject_push(gateway: &mut Gateway, to: ChannelHandle, fault: PushFault) -> SendError {
    let (slave, channel) = (to.slave(), to.channel());
    if fault.is_temporary() {
        gateway.statistics.channel(channel).rejected_image_full += 1;
    }
    match fault {
        PushFault::Share { bytes, most } if bytes > most => {
            SendError::BeyondShare { slave, channel, bytes, share: most }
        }
        PushFault::Share { .. } => {
            SendError::Backpressure { slave, channel, what: Backpressure::Share }
        }
        PushFault::Image(_) if fault.is_temporary() => {
            SendError::Backpressure { slave, channel, what: Backpressure::Image }
        }
        PushFault::Image(_) => AddressError::Disabled { slave, channel }.into(),
    }
}
