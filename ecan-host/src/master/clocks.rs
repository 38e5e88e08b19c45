//! Distributed clocks.

use ecrt_sys::{Errno, status};

use super::{Master, SlaveConfigId};

impl Master {
    /// Chooses the slave whose clock all others follow; `None` for the first that has one.
    /// Before activation.
    pub fn select_reference_clock(&mut self, config: Option<SlaveConfigId>) -> Result<(), Errno> {
        let config = match config {
            Some(id) => self.slave_config_raw(id)?,
            None => std::ptr::null_mut(),
        };
        // SAFETY: master and configuration are valid and belong together; null is allowed.
        Errno::check(unsafe {
            (self.ecrt.functions().master_select_reference_clock)(self.raw.as_ptr(), config)
        })
    }

    library_calls! {
        /// Sets the application time, ns since 2000-01-01; every cycle, before the clocks are
        /// synchronised. Real-time safe.
        master fn application_time(time_ns: u64) = status master_application_time;

        /// Queues the reference clock's correction to the application time. Real-time safe.
        ///
        /// # Errors
        /// `ENXIO` without a reference clock.
        master fn sync_reference_clock() = status master_sync_reference_clock;

        /// Queues the other clocks' correction to the reference clock. Real-time safe.
        master fn sync_slave_clocks() = status master_sync_slave_clocks;

        /// Queues the measurement of how far the clocks differ. Real-time safe.
        master fn sync_monitor_queue() = status master_sync_monitor_queue;
    }

    /// Queues the reference clock's correction to `time_ns`. Real-time safe.
    ///
    /// # Errors
    /// `ENOSYS` before 1.5.3.
    pub fn sync_reference_clock_to(&mut self, time_ns: u64) -> Result<(), Errno> {
        let function = self.ecrt.functions().master_sync_reference_clock_to;
        let function = function.ok_or(Errno::ENOSYS)?;
        // SAFETY: the master is valid as long as `self`.
        Errno::check(unsafe { status!(function, self.raw.as_ptr(), time_ns) })
    }

    /// Lower half of the reference clock's time at the last exchange, ns. Real-time safe, but only after
    /// an exchange that arrived: otherwise the library writes to stderr.
    ///
    /// # Errors
    /// `ENXIO` without a reference clock, `EIO` when the exchange was lost.
    pub fn reference_clock_time(&self) -> Result<u32, Errno> {
        let mut time_ns = 0;
        // SAFETY: the master is valid as long as `self`, the target is writable.
        let status = unsafe {
            (self.ecrt.functions().master_reference_clock_time)(self.raw.as_ptr(), &mut time_ns)
        };
        Errno::check(status)?;
        Ok(time_ns)
    }

    /// The largest difference of a clock to the reference clock, ns, as measured last. Real-time safe,
    /// but only after an exchange that arrived: otherwise the library writes to stderr.
    ///
    /// # Errors
    /// `EIO` when the measurement did not arrive.
    pub fn sync_monitor_process(&mut self) -> Result<u32, Errno> {
        // SAFETY: the master is valid as long as `self`.
        let difference =
            unsafe { (self.ecrt.functions().master_sync_monitor_process)(self.raw.as_ptr()) };
        match difference {
            u32::MAX => Err(Errno::EIO),
            difference => Ok(difference),
        }
    }
}
