//! One cycle of the Port as a value: receive, send, end.

use std::ops::Deref;

use ecan_host::{CycleError, CycleStart, CycleWait, Phase, StartupRounds};

use crate::address::GatewayHandle;
use crate::gateway::Gateway;
use crate::port::Port;
use crate::receive::items::ReceivedItems;
use crate::receive::received::Received;
use crate::sharing::image_stream::CycleStamp;
use crate::snapshot;

/// Failed cycles in a row after which [`Cycle::end`] returns the error.
pub const MAX_FAILED_CYCLES: u32 = 100;

/// A cycle that has begun: the images of all gateways are received and checked, and frames can be
/// sent until it ends. Dropping it ends it.
///
/// The getters of the [`Port`] are available on it. Nothing in it allocates, locks, panics, or calls
/// anything but the master.
///
/// ```no_run
/// # use ecan_mcan_port::{OkOrTemporary, Port};
/// # use ecan_protocol::can::CanFrame;
/// # fn control(port: &mut Port, frame: &CanFrame) -> Result<(), Box<dyn std::error::Error>> {
/// let can0 = port.channel(0, 0)?;
/// loop {
///     let mut cycle = port.next_cycle();
///     for received in cycle.received() {
///         println!("{received}");
///     }
///     cycle.send(can0, frame).ok_or_temporary()?;
///     cycle.end()?;
/// }
/// # }
/// ```
#[derive(Debug)]
pub struct Cycle<'p> {
    pub(crate) port: &'p mut Port,
    /// Dropping must not end the cycle.
    is_kept: bool,
}

/// Summary of a cycle that has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleSummary {
    /// Deadlines that were missed before this cycle.
    pub skipped: u64,
    /// Error of the library when the cycle began.
    pub receive_error: Option<CycleError>,
    /// Error of the library when the cycle ended.
    pub send_error: Option<CycleError>,
    /// Cycles with an error in a row, this one included.
    pub failed_cycles: u32,
}

impl CycleSummary {
    /// First error of the library in this cycle. Unless the bus is not active, it may be gone in the
    /// next cycle.
    pub fn error(&self) -> Option<CycleError> {
        self.receive_error.or(self.send_error)
    }
}

impl Port {
    /// Waits for the next cycle and begins it: receives the images of all gateways, checks them,
    /// and continues the verification of gateways that are not ready.
    ///
    /// Frames of the previous cycle that were not received are lost. Its transmit results are
    /// counted in any case ([`ChannelStatistics`](crate::ChannelStatistics)).
    pub fn next_cycle(&mut self) -> Cycle<'_> {
        self.wait_next_cycle();
        self.begin_cycle()
    }

    /// As [`next_cycle`](Self::next_cycle), without waiting: for an application that keeps the
    /// period itself, and for an attached Adapter, after the owner's receive.
    ///
    /// Returns a cycle that was [kept open](Cycle::keep_open) unchanged.
    pub fn begin_cycle(&mut self) -> Cycle<'_> {
        self.begin();
        Cycle { port: self, is_kept: false }
    }

    /// The cycle that was [kept open](Cycle::keep_open), if any. It stays open when the value is
    /// dropped, until [`Cycle::end`].
    #[inline]
    pub fn open_cycle(&mut self) -> Option<Cycle<'_>> {
        if self.is_cycle_open { Some(Cycle { port: self, is_kept: true }) } else { None }
    }

    /// Returns true from the begin of a cycle that was [kept open](Cycle::keep_open) to its end.
    #[inline]
    pub fn has_open_cycle(&self) -> bool {
        self.is_cycle_open
    }

    /// Sends the images of the last cycle once more, without a cycle: keeps the bus alive.
    /// Real-time safe.
    ///
    /// # Errors
    /// A [`CycleError`] of the library.
    pub fn repeat_images(&mut self) -> Result<(), CycleError> {
        self.publish()
    }

    /// Sleeps until the next cycle is due and returns the number of missed deadlines: see
    /// [`Adapter::wait_next_cycle`](ecan_host::Adapter::wait_next_cycle).
    pub fn wait_next_cycle(&mut self) -> u64 {
        let start = self.begin_wait().sleep();
        self.end_wait(start)
    }

    /// First part of [`wait_next_cycle`](Self::wait_next_cycle): see
    /// [`Adapter::begin_wait`](ecan_host::Adapter::begin_wait).
    pub fn begin_wait(&mut self) -> CycleWait {
        self.adapter.set_startup_rounds(self.needed_rounds());
        self.adapter.begin_wait()
    }

    /// Last part of [`wait_next_cycle`](Self::wait_next_cycle): see
    /// [`Adapter::end_wait`](ecan_host::Adapter::end_wait).
    pub fn end_wait(&mut self, start: CycleStart) -> u64 {
        self.skipped = self.adapter.end_wait(start);
        // The owner of an attached master sets Sync0 by its own deadlines.
        let is_in_phase = !self.adapter.is_attached();
        self.deadline_ns = is_in_phase.then_some(self.adapter.cycle_start().deadline_ns);
        self.skipped
    }

    /// Publishes the images and the snapshot, and sends.
    fn publish(&mut self) -> Result<(), CycleError> {
        let stamp = self.stamp();
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let image = self.adapter.rx_pdo_mut(slave);
            let is_new = gateway.transmitter.end(image, &mut gateway.statistics);
            if let (true, Some(recorder)) = (is_new, &mut self.recorder) {
                let queued = self.queues.as_ref().map(|it| it.sent(slave)).unwrap_or_default();
                recorder.published(stamp, slave, gateway.transmitter.profile(), image, queued);
            }
        }
        snapshot::publish(&self.adapter, &self.gateways, self.snapshot_reservation);
        self.adapter.send()
    }

    /// Adds the frames of other threads to the images, after those of the application.
    fn send_queued(&mut self) {
        let stamp = self.stamp();
        let Some(queues) = &mut self.queues else { return };
        if !queues.begin() {
            return;
        }
        // The deadline of a cycle after a pause of the host is one before the pause.
        let turn = (self.cycle_number as u8, self.adapter.clock().now_ns());
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let image = self.adapter.rx_pdo_mut(slave);
            queues.send(slave, gateway, image, turn, |frames| {
                if let Some(recorder) = &mut self.recorder {
                    recorder.rejected(stamp, slave, frames);
                }
            });
        }
    }

    fn stamp(&self) -> CycleStamp {
        (self.cycle_number, self.adapter.cycle_time_ns())
    }

    fn needed_rounds(&self) -> StartupRounds {
        let mut starting = self.gateways.iter().map(|gateway| &gateway.session);
        match () {
            () if self.is_ready() => StartupRounds::Off,
            () if self.gateways.iter().any(Gateway::has_left_op_unnoticed) => StartupRounds::On,
            () if starting.all(|it| it.is_ready() || it.has_queued_requests()) => StartupRounds::On,
            () => StartupRounds::UntilSafeOp,
        }
    }

    fn begin(&mut self) {
        if self.is_cycle_open {
            return;
        }
        self.receive_error = self.adapter.receive().err();
        if self.adapter.phase() == Phase::Active {
            let time_ns = self.adapter.cycle_time_ns();
            self.since_first_ns = self.sync0_phase.begin(time_ns, self.adapter.config());
        }
        self.cycle_number += 1;
        let since_first_ns = self.deadline_ns.map(|_| self.since_first_ns);
        let stamp = self.stamp();
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let number = self.cycle_number;
            let is_new = gateway.begin(&mut self.adapter, slave, number, since_first_ns);
            if let (true, Some(recorder)) = (is_new, &mut self.recorder) {
                let image = self.adapter.tx_pdo(slave);
                recorder.received(stamp, slave, gateway.receiver.profile(), image);
            }
        }
        if !self.has_been_ready && self.is_ready() {
            self.has_been_ready = true;
            self.adapter.clock().gateways_ready();
        }
        self.retry_startups();
        self.is_cycle_open = true;
    }

    /// Requests the startup of gateways again that stay below OP; see
    /// [`PendingStep::StartupRetry`](crate::PendingStep::StartupRetry).
    fn retry_startups(&mut self) {
        let is_due = self.gateways.iter().any(|gateway| gateway.session.needs_startup());
        if !is_due || self.adapter.is_attached() {
            return;
        }
        let in_use = self.gateways.iter().any(|gateway| gateway.session.is_ready());
        if in_use && self.adapter.retry_startup_blocks() || self.adapter.retry_startup().is_err() {
            return;
        }
        let now_ns = self.adapter.clock().now_ns();
        for gateway in &mut self.gateways {
            let was_due = gateway.session.startup_requested(now_ns);
            gateway.statistics.startup_requests += u64::from(was_due);
        }
    }

    fn end(&mut self) -> CycleSummary {
        self.is_cycle_open = false;
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            gateway.close_image(&self.adapter, slave);
        }
        if let Some(deadline_ns) = self.deadline_ns.take() {
            let since_first_ns = self.since_first_ns;
            for (slave, gateway) in self.gateways.iter_mut().enumerate() {
                gateway.withdraw_late(&mut self.adapter, slave, deadline_ns, since_first_ns);
            }
        }
        self.send_queued();
        let send_error = self.publish().err();
        let skipped = std::mem::take(&mut self.skipped);
        if self.receive_error.is_some() || send_error.is_some() {
            return self.failed_summary(skipped, send_error);
        }
        self.failed_cycles = 0;
        // Written here and not copied: a copy waits for the stores of the errors.
        CycleSummary { skipped, receive_error: None, send_error: None, failed_cycles: 0 }
    }

    #[cold]
    #[inline(never)]
    fn failed_summary(&mut self, skipped: u64, send_error: Option<CycleError>) -> CycleSummary {
        let receive_error = self.receive_error.take();
        self.failed_cycles = self.failed_cycles.saturating_add(1);
        CycleSummary { skipped, receive_error, send_error, failed_cycles: self.failed_cycles }
    }
}

impl<'p> Cycle<'p> {
    /// Error of the library when the cycle began. The cycle is open all the same, and its end keeps
    /// the bus alive.
    pub fn receive_error(&self) -> Option<CycleError> {
        self.port.receive_error
    }

    /// The frames and transmit results that arrived, in the order of slaves and images. Items that
    /// are not taken stay for another call in the same cycle.
    #[inline]
    pub fn received(&mut self) -> ReceivedItems<'_> {
        ReceivedItems::new(&self.port.adapter, &mut self.port.gateways)
    }

    /// Copies items that arrived into `received`, as [`received`](Self::received), and returns their
    /// number.
    pub fn receive(&mut self, received: &mut [Received]) -> usize {
        let mut count = 0;
        for (to, item) in received.iter_mut().zip(self.received()) {
            *to = item.to_owned();
            count += 1;
        }
        count
    }

    /// As [`Port::discard_pending`].
    pub fn discard_pending(&mut self, gateway: GatewayHandle) -> usize {
        self.port.discard_pending(gateway)
    }

    /// Ends the cycle: publishes the RxPDO images, or unconfirmed ones once more, and sends.
    ///
    /// # Errors
    /// A [`CycleError`] only if nothing recovers by itself: the bus is not active, or more than
    /// [`MAX_FAILED_CYCLES`] cycles in a row failed. Other errors are part of the summary.
    pub fn end(self) -> Result<CycleSummary, CycleError> {
        let summary = self.finish();
        match summary.error() {
            None => Ok(CycleSummary { skipped: summary.skipped, ..CycleSummary::default() }),
            Some(error @ CycleError::NotActive { .. }) => Err(error),
            Some(error) if summary.failed_cycles > MAX_FAILED_CYCLES => Err(error),
            Some(_) => Ok(summary),
        }
    }

    /// Ends the cycle, as [`end`](Self::end), and leaves every error to the caller.
    pub fn finish(mut self) -> CycleSummary {
        self.is_kept = true;
        self.port.end()
    }

    /// Keeps the cycle open beyond this value: [`Port::open_cycle`] continues it.
    pub fn keep_open(mut self) {
        self.is_kept = true;
    }
}

impl Deref for Cycle<'_> {
    type Target = Port;

    #[inline]
    fn deref(&self) -> &Port {
        self.port
    }
}

impl Drop for Cycle<'_> {
    #[inline]
    fn drop(&mut self) {
        if !self.is_kept {
            self.port.end();
        }
    }
}
