//! Running the cycle while something slower is waited for.

use ecan_host::{Adapter, Diagnostics};

use crate::cycle;
use crate::error::PortError;
use crate::port::Port;

impl Port {
    /// Activates the bus if that has not been done, and runs the cycle until every gateway is in
    /// OP, verified and in service.
    ///
    /// Blocks, for seconds. Received frames are thrown away meanwhile.
    ///
    /// # Errors
    /// [`PortError::Adapter`] with a report of the slaves that do not reach OP,
    /// [`PortError::NotInService`] for one that does but fails verification, or what went wrong in
    /// the cycle.
    pub fn wait_ready(&mut self, timeout_ms: u32) -> Result<(), PortError> {
        let clock = self.adapter.ecrt().clock().clone();
        let start = clock.now_ns();
        let Self { adapter, gateways, .. } = self;
        adapter.wait_op_with(timeout_ms, |adapter| {
            cycle::begin(adapter, gateways)?;
            cycle::end(adapter, gateways)
        })?;
        let deadline = start + u64::from(timeout_ms) * 1_000_000;
        let mut next = clock.now_ns();
        while !self.is_ready() {
            if next > deadline {
                let waited_ms = (clock.now_ns() - start) / 1_000_000;
                let open = self.gateways.iter().position(|g| !g.session.is_ready());
                let slave = open.unwrap_or_default();
                let session = self.session(slave);
                return Err(PortError::NotInService { slave, session, waited_ms });
            }
            next += u64::from(self.adapter.config().cycle_ns);
            clock.sleep_until_ns(next);
            self.cycle_begin()?;
            self.cycle_end()?;
        }
        // The next exchange is due one cycle after the last one, not at once.
        clock.sleep_until_ns(next + u64::from(self.adapter.config().cycle_ns));
        Ok(())
    }

    /// Runs `work` with a diagnostics handle of its own while the cycle goes on: blocking SDO
    /// transfers on a running bus. Received frames are thrown away meanwhile, and nothing is sent.
    ///
    /// # Errors
    /// The handle cannot be opened.
    pub fn diagnose<R: Send>(
        &mut self,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, PortError> {
        let Self { adapter, gateways, .. } = self;
        let cycle = |adapter: &mut Adapter| {
            cycle::begin(adapter, gateways)?;
            cycle::end(adapter, gateways)
        };
        Ok(adapter.diagnose(cycle, work)?)
    }
}
