//! Axes that are stopped when the program ends: by a call, or when their owner is dropped.

use std::io::Write;
use std::time::Duration;

use ecan_mcan_port::Port;

use super::cia402::Cia402;
use super::error::{AxisTimeout, Cia402Error};

/// Default of [`Cia402::stop_time`].
pub(super) const STOP_TIME: Duration = Duration::from_secs(10);

impl Cia402 {
    /// Longest time for which the end of a program waits until the axes have stopped
    /// ([`stop_before_end`](Self::stop_before_end), [`AxisOwner`], the deinit functions of C); 10 s.
    pub fn stop_time(&self) -> Duration {
        self.stop_time
    }

    /// Sets the time for which the end of a program waits. Zero leaves the axes as they are, for a program
    /// whose successor adopts them ([`Takeover::Adopt`](crate::Takeover::Adopt)).
    pub fn set_stop_time(&mut self, stop_time: Duration) {
        self.stop_time = stop_time;
    }

    /// Returns whether the drive of an axis may be moving or may begin to: it reported something, and not
    /// that it has stopped.
    pub fn may_move(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| axis.may_move(self.now_ns))
    }

    /// Stops the axes that may move, as [`stop_all_timeout`](Self::stop_all_timeout), at most for the
    /// [`stop_time`](Self::stop_time). Returns at once if no axis may move. Blocks. For the end of a program; in order
    /// it ends by [`shutdown_timeout`](Self::shutdown_timeout).
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that may still move. On a master of another owner
    /// this call cannot run the cycle, and names them at once.
    pub fn stop_before_end(&mut self, port: &mut Port) -> Result<(), Cia402Error> {
        if self.stop_time.is_zero() || !self.axes.iter().any(|axis| axis.may_move(self.now_ns)) {
            return Ok(());
        }
        if port.adapter().is_attached() {
            let axes = self.progress_of(|axis| axis.may_move(self.now_ns));
            let (what, waited) = (AxisTimeout::STOPPED, Duration::ZERO);
            return Err(AxisTimeout { what, waited, axes, cycle_error: None }.into());
        }
        self.stop_all_timeout(port, self.stop_time, |_| {})
    }
}

/// A Port and the axes on it, which are stopped when this value is dropped: also by an error that leaves the
/// function with `?`. A [`Cia402`] alone has no Port, so that its end sends nothing.
///
/// The drop waits until the axes have stopped, at most for the [`stop_time`](Cia402::stop_time), and
/// then names those that may still move on standard error and in the log. It does not wait during a panic, which
/// may have left the application in any state: then the watch of the host by the drives stops them
/// ([`Cia402::host_loss`]). Nor does it after `std::process::exit` or a signal that ends the process.
///
/// ```no_run
/// # use ecan_cia402::{AxisOwner, Cia402};
/// # fn machine(port: ecan_mcan_port::Port, cia402: Cia402) -> Result<(), Box<dyn std::error::Error>> {
/// let mut owner = AxisOwner::new(port, cia402);
/// let (port, axes) = owner.parts();
/// let mut cycle = port.next_cycle();
/// axes.process_rx(&mut cycle);
/// axes.send_targets_all(&mut cycle);
/// cycle.end()?; // an error stops the axes
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct AxisOwner {
    port: Port,
    cia402: Cia402,
}

impl AxisOwner {
    /// Owns a Port and the axes that were created on it.
    pub fn new(port: Port, cia402: Cia402) -> Self {
        Self { port, cia402 }
    }

    /// The Port and the axes, for a cycle or a call that waits.
    pub fn parts(&mut self) -> (&mut Port, &mut Cia402) {
        (&mut self.port, &mut self.cia402)
    }

    /// The Port.
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// The axes.
    pub fn cia402(&self) -> &Cia402 {
        &self.cia402
    }
}

impl Drop for AxisOwner {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        if let Err(error) = self.cia402.stop_before_end(&mut self.port) {
            tracing::error!("{error}");
            // A closed standard error has no effect.
            let _ = writeln!(std::io::stderr(), "{error}; remove the power of a motor that moves");
        }
    }
}
