//! State of the cycle of a Port: its gateways, its times, and what other threads share with it.

use ecan_host::{Adapter, CycleError, CycleStart, Phase, StartupRounds};
use ecan_protocol::mapping::CHANNELS;

use crate::address::{AddressError, GatewayHandle};
use crate::gateway::Gateway;
use crate::image_stream::{CycleStamp, ImageRecorder};
use crate::schedule::margin::Sync0Phase;
use crate::snapshot;
use crate::transmit_queue::CycleQueues;

/// State of the cycle, in and between cycles.
#[derive(Debug)]
pub(crate) struct CycleState {
    pub(crate) gateways: Vec<Gateway>,
    /// Number of the section of the snapshots.
    snapshot_reservation: u64,
    is_open: bool,
    /// All gateways were ready at one time.
    has_been_ready: bool,
    /// Number of the last cycle that has begun.
    number: u64,
    /// Deadline of the running cycle; `None` without a wait for the cycle.
    deadline_ns: Option<u64>,
    sync0_phase: Sync0Phase,
    /// Application time of the running cycle since the first one.
    since_first_ns: u64,
    /// Error with which the running cycle began.
    receive_error: Option<CycleError>,
    /// Deadlines missed before the running cycle.
    skipped: u64,
    /// Failed cycles in a row.
    failed_cycles: u32,
    /// For another thread, if one has a stream.
    recorder: Option<ImageRecorder>,
    /// Of another thread, if it has queues. Boxed: a Port is moved by value when it is opened.
    queues: Option<Box<CycleQueues>>,
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

impl CycleState {
    pub(crate) fn new(adapter: &Adapter, gateways: Vec<Gateway>) -> Self {
        Self {
            snapshot_reservation: snapshot::reserve(adapter, gateways.len()),
            gateways,
            is_open: false,
            has_been_ready: false,
            number: 0,
            deadline_ns: None,
            sync0_phase: Sync0Phase::default(),
            since_first_ns: 0,
            receive_error: None,
            skipped: 0,
            failed_cycles: 0,
            recorder: None,
            queues: None,
        }
    }

    /// Ends an open cycle without its images, and removes the gateways, before they are configured again.
    pub(crate) fn remove_gateways(&mut self) {
        self.gateways.clear();
        self.is_open = false;
        self.deadline_ns = None;
        self.sync0_phase = Sync0Phase::default();
    }

    pub(crate) fn set_gateways(&mut self, adapter: &Adapter, gateways: Vec<Gateway>) {
        self.gateways = gateways;
        self.snapshot_reservation = snapshot::reserve(adapter, self.gateways.len());
        if let Some(queues) = &self.queues {
            queues.set_accepted(&self.gateways);
        }
    }

    pub(crate) fn set_recorder(&mut self, recorder: ImageRecorder) {
        self.recorder = Some(recorder);
    }

    pub(crate) fn set_queues(&mut self, queues: CycleQueues) {
        self.queues = Some(Box::new(queues));
    }

    #[inline]
    pub(crate) fn is_open(&self) -> bool {
        self.is_open
    }

    pub(crate) fn number(&self) -> u64 {
        self.number
    }

    pub(crate) fn receive_error(&self) -> Option<CycleError> {
        self.receive_error
    }

    /// Delay with which the running cycle began; `None` without a wait for the cycle.
    pub(crate) fn begun_ns(&self, adapter: &Adapter) -> Option<u64> {
        self.deadline_ns.map(|_| adapter.cycle_start().late_ns)
    }

    /// Application time of the running cycle since the first one.
    pub(crate) fn since_first_ns(&self) -> u64 {
        self.since_first_ns
    }

    pub(crate) fn find(&self, gateway: GatewayHandle) -> Option<&Gateway> {
        self.gateways.get(gateway.slave())
    }

    #[cold]
    pub(crate) fn wrong_address(&self, slave: usize, channel: u8) -> AddressError {
        match self.gateways.len() {
            count if slave >= count => AddressError::Slave { slave, count },
            _ if usize::from(channel) >= CHANNELS => AddressError::Channel { slave, channel },
            _ => AddressError::Disabled { slave, channel },
        }
    }

    /// Returns whether every gateway is ready.
    pub(crate) fn is_ready(&self) -> bool {
        !self.gateways.is_empty() && self.gateways.iter().all(|gateway| gateway.session.is_ready())
    }

    /// Ends the wait for a cycle, and returns the number of missed deadlines.
    pub(crate) fn end_wait(&mut self, adapter: &mut Adapter, start: CycleStart) -> u64 {
        self.skipped = adapter.end_wait(start);
        // The owner of an attached master sets Sync0 by its own deadlines.
        let is_in_phase = !adapter.is_attached();
        self.deadline_ns = is_in_phase.then_some(start.deadline_ns);
        self.skipped
    }

    /// Publishes the images and the snapshot, and sends.
    pub(crate) fn publish(&mut self, adapter: &mut Adapter) -> Result<(), CycleError> {
        let stamp = self.stamp(adapter);
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let image = adapter.rx_pdo_mut(slave);
            let is_new = gateway.transmitter.end(image, &mut gateway.statistics);
            if let (true, Some(recorder)) = (is_new, &mut self.recorder) {
                let queued =
                    self.queues.as_ref().map(|queues| queues.sent(slave)).unwrap_or_default();
                recorder.record_published(
                    stamp,
                    slave,
                    gateway.transmitter.profile(),
                    image,
                    queued,
                );
            }
        }
        snapshot::publish(adapter, &self.gateways, self.snapshot_reservation);
        adapter.send()
    }

    /// Adds the frames of other threads to the images, after those of the application.
    fn send_queued(&mut self, adapter: &mut Adapter) {
        let stamp = self.stamp(adapter);
        let Some(queues) = &mut self.queues else { return };
        if !queues.begin() {
            return;
        }
        // The deadline of a cycle after a pause of the host is one before the pause.
        let turn = (self.number as u8, adapter.clock().now_ns());
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let image = adapter.rx_pdo_mut(slave);
            queues.send(slave, gateway, image, turn, |frames| {
                if let Some(recorder) = &mut self.recorder {
                    recorder.record_rejected(stamp, slave, frames);
                }
            });
        }
    }

    fn stamp(&self, adapter: &Adapter) -> CycleStamp {
        (self.number, adapter.cycle_time_ns())
    }

    pub(crate) fn needed_rounds(&self) -> StartupRounds {
        let mut starting = self.gateways.iter().map(|gateway| &gateway.session);
        match () {
            () if self.is_ready() => StartupRounds::Off,
            () if self.gateways.iter().any(Gateway::has_left_op_unnoticed) => StartupRounds::On,
            () if starting.all(|session| session.is_ready() || session.has_queued_requests()) => {
                StartupRounds::On
            }
            () => StartupRounds::UntilSafeOp,
        }
    }

    pub(crate) fn begin(&mut self, adapter: &mut Adapter) {
        if self.is_open {
            return;
        }
        self.receive_error = adapter.receive().err();
        if adapter.phase() == Phase::Active {
            let time_ns = adapter.cycle_time_ns();
            self.since_first_ns = self.sync0_phase.begin(time_ns, adapter.config());
        }
        self.number += 1;
        let since_first_ns = self.deadline_ns.map(|_| self.since_first_ns);
        let stamp = self.stamp(adapter);
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let number = self.number;
            let is_new = gateway.begin(adapter, slave, number, since_first_ns);
            if let (true, Some(recorder)) = (is_new, &mut self.recorder) {
                let image = adapter.tx_pdo(slave);
                recorder.record_received(stamp, slave, gateway.receiver.profile(), image);
            }
        }
        if !self.has_been_ready && self.is_ready() {
            self.has_been_ready = true;
            adapter.clock().gateways_ready();
        }
        self.retry_startups(adapter);
        self.is_open = true;
    }

    /// Requests the startup of gateways again that stay below OP; see
    /// [`PendingStep::StartupRetry`](crate::PendingStep::StartupRetry).
    fn retry_startups(&mut self, adapter: &mut Adapter) {
        let is_due = self.gateways.iter().any(|gateway| gateway.session.needs_startup());
        if !is_due || adapter.is_attached() {
            return;
        }
        let in_use = self.gateways.iter().any(|gateway| gateway.session.is_ready());
        if in_use && adapter.retry_startup_blocks() || adapter.retry_startup().is_err() {
            return;
        }
        let now_ns = adapter.clock().now_ns();
        for gateway in &mut self.gateways {
            let was_due = gateway.session.record_startup_request(now_ns);
            gateway.statistics.startup_requests += u64::from(was_due);
        }
    }

    pub(crate) fn end(&mut self, adapter: &mut Adapter) -> CycleSummary {
        self.is_open = false;
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            gateway.close_image(adapter, slave);
        }
        if let Some(deadline_ns) = self.deadline_ns.take() {
            let since_first_ns = self.since_first_ns;
            for (slave, gateway) in self.gateways.iter_mut().enumerate() {
                gateway.withdraw_late(adapter, slave, deadline_ns, since_first_ns);
            }
        }
        self.send_queued(adapter);
        let send_error = self.publish(adapter).err();
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
