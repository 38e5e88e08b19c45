//! The cycle: receive, judge the working counters, send.

use ecrt_sys::{Errno, WcState};
use thiserror::Error;

use crate::adapter::{Adapter, Phase, Slave};

/// Errors inside the cycle: small, `Copy`, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CycleError {
    /// A call of the master library failed.
    #[error("{call} failed in the cycle: {errno}")]
    Library {
        /// Name of the library function.
        call: &'static str,
        /// What the system said.
        errno: Errno,
    },
    /// The Adapter is not active, so there is no cycle.
    #[error("the bus is {is}, not active: call activate first")]
    NotActive {
        /// Phase that it is in.
        is: Phase,
    },
}

/// What the working counter tells about the RxPDO of the last exchange.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Delivery {
    /// Nothing was exchanged yet.
    #[default]
    None,
    /// The slave took the image.
    Confirmed,
    /// The slave did not take it.
    Missed,
    /// It cannot be told: with LWR and LRD a sum of 1 may be either direction.
    Unknown,
}

/// Outcome of the last exchange with one slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DomainReport {
    /// Working counter of the slave's domain.
    pub working_counter: u32,
    /// The master's judgement of it; it knows the expected value.
    pub wc_state: WcState,
    /// What became of the output image.
    pub delivery: Delivery,
}

impl Default for DomainReport {
    fn default() -> Self {
        Self { working_counter: 0, wc_state: WcState::Zero, delivery: Delivery::None }
    }
}

impl DomainReport {
    /// Whether both directions were exchanged. Motion waits for this in every cycle (manual
    /// 15.5.2, step 8).
    pub fn is_complete(&self) -> bool {
        self.wc_state == WcState::Complete
    }
}

fn judge(slave: &Slave, working_counter: u32, wc_state: WcState) -> Delivery {
    match wc_state {
        WcState::Complete => Delivery::Confirmed,
        WcState::Zero => Delivery::Missed,
        // In a single LRW a read counts 1 and a write 2, each on its own.
        WcState::Incomplete if slave.capacity.is_single_datagram() => {
            if working_counter & 2 != 0 {
                Delivery::Confirmed
            } else {
                Delivery::Missed
            }
        }
        WcState::Incomplete => Delivery::Unknown,
    }
}

fn fail(call: &'static str) -> impl Fn(Errno) -> CycleError {
    move |errno| CycleError::Library { call, errno }
}

impl Adapter {
    /// Fetches what came back and judges every slave's working counter.
    ///
    /// Real-time safe: no allocation, no lock, no call beyond the master's own. First in the
    /// cycle; on an attached Adapter after the owner's `ecrt_master_receive`.
    ///
    /// # Errors
    /// A [`CycleError`]; the cycle may go on with the next call.
    pub fn receive(&mut self) -> Result<(), CycleError> {
        if self.phase != Phase::Active {
            return Err(CycleError::NotActive { is: self.phase });
        }
        if !self.is_attached() {
            self.master.receive().map_err(fail("ecrt_master_receive"))?;
        }
        for slave in &mut self.slaves {
            self.master.domain_process(slave.domain).map_err(fail("ecrt_domain_process"))?;
            let state =
                self.master.domain_state(slave.domain).map_err(fail("ecrt_domain_state"))?;
            slave.report = DomainReport {
                working_counter: state.working_counter,
                wc_state: state.wc_state,
                delivery: judge(slave, state.working_counter, state.wc_state),
            };
        }
        Ok(())
    }

    /// Queues every slave's process data, serves the distributed clocks and sends.
    ///
    /// Real-time safe, as [`receive`](Self::receive). Last in the cycle; on an attached Adapter
    /// before the owner's `ecrt_master_send`, who also serves the clocks.
    ///
    /// # Errors
    /// A [`CycleError`]; the cycle may go on with the next call.
    pub fn send(&mut self) -> Result<(), CycleError> {
        if self.phase != Phase::Active {
            return Err(CycleError::NotActive { is: self.phase });
        }
        for slave in &self.slaves {
            self.master.domain_queue(slave.domain).map_err(fail("ecrt_domain_queue"))?;
        }
        if self.is_attached() {
            return Ok(());
        }
        if self.config.dc.is_some() {
            let now = self.ecrt.clock().now_ns();
            self.master.application_time(now).map_err(fail("ecrt_master_application_time"))?;
            self.master.sync_reference_clock().map_err(fail("ecrt_master_sync_reference_clock"))?;
            self.master.sync_slave_clocks().map_err(fail("ecrt_master_sync_slave_clocks"))?;
        }
        self.master.send().map_err(fail("ecrt_master_send"))
    }

    /// Outcome of the last [`receive`](Self::receive) for a slave; real-time safe. A slave index
    /// out of range reads as nothing exchanged.
    pub fn domain_report(&self, slave: usize) -> DomainReport {
        self.slaves.get(slave).map_or_else(DomainReport::default, |s| s.report)
    }

    /// Whether every slave exchanged both directions in the last cycle; real-time safe.
    pub fn domain_is_complete(&self) -> bool {
        !self.slaves.is_empty() && self.slaves.iter().all(|s| s.report.is_complete())
    }
}
