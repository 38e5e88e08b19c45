//! The cycle: receive, evaluate the working counters, send.

use super::{Adapter, Slave};
use crate::error::CycleError;
use crate::master::WcState;
use crate::phase::Phase;

/// Delivery of one direction in the last exchange, by the working counter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Delivery {
    /// No exchange yet.
    #[default]
    None,
    /// The image was delivered.
    Confirmed,
    /// It was not delivered.
    Missed,
    /// Unknown: with LWR and LRD a sum of 1 may be either direction; unknown also after an error
    /// of the library.
    Unknown,
}

/// Result of the last exchange with one slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DomainReport {
    /// Working counter of the slave's domain.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
    /// The master's evaluation, which decides.
    pub wc_state: WcState,
    /// Delivery of the RxPDO image.
    pub outputs: Delivery,
    /// Delivery of the TxPDO image.
    pub inputs: Delivery,
}

impl Default for DomainReport {
    fn default() -> Self {
        Self {
            working_counter: 0,
            expected_working_counter: 0,
            wc_state: WcState::Zero,
            outputs: Delivery::None,
            inputs: Delivery::None,
        }
    }
}

impl DomainReport {
    /// Returns whether both directions were exchanged. Motion waits for this in every cycle (manual
    /// 15.5.2, step 8).
    pub fn is_complete(&self) -> bool {
        self.wc_state == WcState::Complete
    }
}

fn delivery_of(slave: &Slave, working_counter: u32, wc_state: WcState) -> (Delivery, Delivery) {
    let seen = |counted: bool| if counted { Delivery::Confirmed } else { Delivery::Missed };
    match wc_state {
        WcState::Complete => (Delivery::Confirmed, Delivery::Confirmed),
        WcState::Zero => (Delivery::Missed, Delivery::Missed),
        // Another slave has the same process data: the images are a mixture.
        WcState::Incomplete if working_counter > slave.report.expected_working_counter => {
            (Delivery::Unknown, Delivery::Unknown)
        }
        // In a single LRW a read counts 1 and a write 2, each on its own.
        WcState::Incomplete if slave.layout.is_single_datagram() => {
            (seen(working_counter & 2 != 0), seen(working_counter & 1 != 0))
        }
        WcState::Incomplete => (Delivery::Unknown, Delivery::Unknown),
    }
}

/// Keeps the first error while the rest of the cycle continues.
fn keep(first: &mut Result<(), CycleError>, next: Result<(), CycleError>) {
    if first.is_ok() {
        *first = next;
    }
}

impl Adapter {
    /// Receives the process data and evaluates every slave's working counter.
    ///
    /// Real-time safe: no allocation, no lock, no call beyond the master's own. First in the
    /// cycle, since with distributed clocks its time is that of the cycle; on an attached Adapter
    /// after the owner's `ecrt_master_receive`.
    ///
    /// # Errors
    /// The first [`CycleError`]. Every other slave was served all the same; for those that were
    /// not, [`DomainReport`] reports [`Delivery::Unknown`].
    pub fn receive(&mut self) -> Result<(), CycleError> {
        self.is_leaving_op = false;
        self.exchange_inputs()
    }

    pub(super) fn exchange_inputs(&mut self) -> Result<(), CycleError> {
        if self.phase != Phase::Active {
            return Err(CycleError::NotActive { is: self.phase });
        }
        self.begin_observed_cycle();
        self.start_cycle();
        self.master.count_cycle();
        let mut result = Ok(());
        if !self.is_attached() {
            let received = self.master.receive();
            keep(&mut result, received.map_err(CycleError::library("ecrt_master_receive")));
        }
        let has_received = result.is_ok();
        for (index, slave) in self.slaves.iter_mut().enumerate() {
            slave.report.working_counter = 0;
            slave.report.wc_state = WcState::Zero;
            (slave.report.outputs, slave.report.inputs) = (Delivery::Unknown, Delivery::Unknown);
            if !has_received {
                continue;
            }
            let state = self
                .master
                .domain_process(slave.domain)
                .map_err(CycleError::of_slave("ecrt_domain_process", index))
                .and_then(|()| {
                    let state = self.master.domain_state(slave.domain);
                    state.map_err(CycleError::of_slave("ecrt_domain_state", index))
                });
            match state {
                Ok(_) if slave.is_unsent => {}
                Ok(state) => {
                    let (outputs, inputs) =
                        delivery_of(slave, state.working_counter, state.wc_state);
                    let report = &mut slave.report;
                    report.working_counter = state.working_counter;
                    report.wc_state = state.wc_state;
                    (report.outputs, report.inputs) = (outputs, inputs);
                    let is_silent = state.wc_state == WcState::Zero && !self.is_leaving_op;
                    slave.outage.update(index, is_silent);
                }
                Err(error) => keep(&mut result, Err(error)),
            }
        }
        self.clock_correction_ns = 0;
        if let Some(clocks) = &mut self.clocks {
            let answering = self.slaves.iter().filter(|s| s.report.working_counter > 0).count();
            match clocks.receive(&mut self.master, answering) {
                Ok(correction) => self.correct_deadline(correction),
                Err(error) => keep(&mut result, Err(error)),
            }
        }
        result
    }

    /// Queues every slave's process data, serves the distributed clocks and sends.
    ///
    /// Real-time safe, as [`receive`](Self::receive). Last in the cycle; on an attached Adapter
    /// before the owner's `ecrt_master_send`, who also serves the clocks.
    ///
    /// # Errors
    /// The first [`CycleError`]. What could be sent was sent all the same: a bus on which nothing
    /// is sent never recovers.
    pub fn send(&mut self) -> Result<(), CycleError> {
        if self.phase != Phase::Active {
            return Err(CycleError::NotActive { is: self.phase });
        }
        let mut result = Ok(());
        for (index, slave) in self.slaves.iter_mut().enumerate() {
            let queued = self.master.domain_queue(slave.domain);
            slave.is_unsent = queued.is_err();
            keep(&mut result, queued.map_err(CycleError::of_slave("ecrt_domain_queue", index)));
        }
        if self.is_attached() {
            self.end_cycle();
            self.publish_cycle();
            return result;
        }
        if let Some(clocks) = &mut self.clocks {
            let now = self.ecrt.clock().now_ns();
            keep(&mut result, clocks.send(&mut self.master, now));
        }
        let sent = self.master.send();
        for slave in &mut self.slaves {
            slave.is_unsent |= sent.is_err();
        }
        keep(&mut result, sent.map_err(CycleError::library("ecrt_master_send")));
        self.end_cycle();
        self.publish_cycle();
        result
    }

    /// Outcome of the last [`receive`](Self::receive) for a slave; real-time safe. A slave index
    /// out of range reads as nothing exchanged.
    pub fn domain_report(&self, slave: usize) -> DomainReport {
        self.slaves.get(slave).map_or_else(DomainReport::default, |s| s.report)
    }

    /// Returns whether more than one slave took part in the last exchange: another one has the same process
    /// data. Real-time safe.
    pub fn shares_process_data(&self, slave: usize) -> bool {
        let report = self.domain_report(slave);
        report.wc_state == WcState::Incomplete
            && report.working_counter > report.expected_working_counter
    }

    /// Returns whether every slave exchanged both directions in the last cycle; real-time safe.
    pub fn domain_is_complete(&self) -> bool {
        !self.slaves.is_empty() && self.slaves.iter().all(|s| s.report.is_complete())
    }
}
