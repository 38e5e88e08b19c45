//! One cycle of the Port as a value: receive, send, end.

use std::ops::Deref;

use ecan_host::{CycleError, CycleStart, CycleWait};

use crate::address::GatewayHandle;
use crate::cycle_state::CycleSummary;
use crate::port::Port;
use crate::received::{Received, ReceivedItems};

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
        self.state.begin(&mut self.adapter);
        Cycle { port: self, is_kept: false }
    }

    /// The cycle that was [kept open](Cycle::keep_open), if any. It stays open when the value is
    /// dropped, until [`Cycle::end`].
    #[inline]
    pub fn open_cycle(&mut self) -> Option<Cycle<'_>> {
        if self.state.is_open() { Some(Cycle { port: self, is_kept: true }) } else { None }
    }

    /// Returns true from the begin of a cycle that was [kept open](Cycle::keep_open) to its end.
    #[inline]
    pub fn has_open_cycle(&self) -> bool {
        self.state.is_open()
    }

    /// Sends the images of the last cycle once more, without a cycle: keeps the bus alive.
    /// Real-time safe.
    ///
    /// # Errors
    /// A [`CycleError`] of the library.
    pub fn repeat_images(&mut self) -> Result<(), CycleError> {
        self.state.publish(&mut self.adapter)
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
        self.adapter.set_startup_rounds(self.state.needed_rounds());
        self.adapter.begin_wait()
    }

    /// Last part of [`wait_next_cycle`](Self::wait_next_cycle): see
    /// [`Adapter::end_wait`](ecan_host::Adapter::end_wait).
    pub fn end_wait(&mut self, start: CycleStart) -> u64 {
        self.state.end_wait(&mut self.adapter, start)
    }
}

impl<'p> Cycle<'p> {
    /// Error of the library when the cycle began. The cycle is open all the same, and its end keeps
    /// the bus alive.
    pub fn receive_error(&self) -> Option<CycleError> {
        self.port.state.receive_error()
    }

    /// The frames and transmit results that arrived, in the order of slaves and images. Items that
    /// are not taken stay for another call in the same cycle.
    #[inline]
    pub fn received(&mut self) -> ReceivedItems<'_> {
        ReceivedItems::new(&self.port.adapter, &mut self.port.state.gateways)
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
        self.port.state.end(&mut self.port.adapter)
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
            self.port.state.end(&mut self.port.adapter);
        }
    }
}
