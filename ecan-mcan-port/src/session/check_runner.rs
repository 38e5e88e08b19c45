//! Execution of the checks of a verification with SDO requests that run in parallel with the cycle.

use ecan_host::{Adapter, CycleError, Error, RequestState, SdoRequestId};
use ecan_protocol::device::{CCCR, ControllerMode, TEST};
use ecan_protocol::mapping::CHANNELS;

use super::verification::{Check, ControllerStep, PendingStep, SdoTransfer, VerificationFault};

/// Longest wait for a check, in nanoseconds, besides the transfers of all gateways: the master's own
/// timeout of a mailbox response and a reserve.
const WAIT_NS: u64 = 4_000_000_000;
/// Cycles of one transfer: request, fetching the response, and a reserve.
const CYCLES_PER_TRANSFER: u64 = 6;
/// Largest age of the sequence that a gateway reports, in images, besides the time of the transfer.
const SEQUENCE_MARGIN: u16 = 16;
const NS_PER_MS: u64 = 1_000_000;

#[derive(Debug, Clone, Copy)]
struct Step {
    check: Check,
    request: SdoRequestId,
    /// Start of the transfer of the last attempt; `None` if its result is not used.
    begun_ns: Option<u64>,
}

/// The checks of a gateway, each with a request of its own: the master executes requests that are
/// queued together one after the other. Between single ones it polls all slaves, which takes longer
/// than a transfer, and may begin to read the SDO dictionary, which takes seconds.
#[derive(Debug)]
pub(crate) struct CheckRunner {
    slave: usize,
    steps: Vec<Step>,
    /// Checks of this attempt that have passed, and those whose transfer was begun.
    passed: usize,
    begun: usize,
    /// A transfer of an earlier attempt that the master has not ended.
    earlier: Option<SdoTransfer>,
    /// Since when this attempt waits for the same check, and the longest such time.
    waiting_since_ns: u64,
    limit_ns: u64,
    layout_crc: [Option<u32>; 2],
    controller: ControllerReading,
    /// Sequence numbers between those of two gateways.
    sequence_distance: u16,
    /// Sequence of the last image when the check of the sequence was begun.
    sequence_at_start: u16,
    /// True if the gateway reports the sequence of its last image; `None` before the first
    /// verification, when positions are those of the configuration.
    reports_sequence: Option<bool>,
}

impl CheckRunner {
    /// Creates the requests; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        checks: Vec<Check>,
    ) -> Result<Self, Error> {
        let slaves = adapter.slave_count().max(1);
        let transfers = (slaves * checks.len()) as u64;
        let request = |check: Check| {
            let size = check.download().map_or(4, |sdo| sdo.bytes().1);
            let request = adapter.requests().create_sdo(slave, size)?;
            // The runner has its own limit.
            adapter.requests().sdo_timeout(request, 0)?;
            Ok(Step { check, request, begun_ns: None })
        };
        let steps = checks.into_iter().map(request).collect::<Result<Vec<_>, Error>>()?;
        Ok(Self {
            slave,
            steps,
            passed: 0,
            begun: 0,
            earlier: None,
            waiting_since_ns: 0,
            limit_ns: WAIT_NS
                + transfers * CYCLES_PER_TRANSFER * u64::from(adapter.config().cycle_ns()),
            layout_crc: [None; 2],
            controller: ControllerReading::default(),
            // infallible: at most 65536
            sequence_distance: u16::try_from(0x1_0000 / slaves).unwrap_or(u16::MAX),
            sequence_at_start: 0,
            reports_sequence: None,
        })
    }

    /// Sequence number with which the images of a verification begin that starts in this cycle. No
    /// other gateway has images of this number at the same time.
    pub(crate) fn first_sequence(&self, cycle: u64) -> u16 {
        let slave = u16::try_from(self.slave).unwrap_or_default();
        // Wraps on purpose.
        self.sequence_distance.wrapping_mul(slave).wrapping_add(cycle as u16)
    }

    /// Starts another attempt.
    pub(crate) fn restart(&mut self, now_ns: u64) {
        (self.passed, self.begun, self.earlier) = (0, 0, None);
        self.waiting_since_ns = now_ns;
        self.controller.restart();
    }

    /// Returns whether the transfers of this attempt were begun.
    pub(crate) fn has_begun(&self) -> bool {
        self.begun > 0
    }

    /// Keeps a request in the master's queue until the slave is in OP, so that the master
    /// does not begin to read the SDO dictionary before the first check. Its result is not used.
    pub(crate) fn occupy_queue(&mut self, adapter: &mut Adapter) {
        let Some(first) = self.steps.first_mut() else { return };
        if !matches!(adapter.requests().sdo_state(first.request), Ok(RequestState::Busy)) {
            // A request that is rejected is made again.
            let _ = begin(adapter, first);
            first.begun_ns = None;
        }
    }

    /// Step that the attempt waits for.
    pub(crate) fn pending_step(&self) -> PendingStep {
        match (self.earlier, self.steps.get(self.passed)) {
            (Some(transfer), _) => PendingStep::EarlierTransfer(transfer),
            (None, Some(step)) => PendingStep::Transfer(step.check.transfer()),
            (None, None) => PendingStep::NextAttempt,
        }
    }

    /// Continues the attempt; true when the first `count` checks have passed. `published`: sequence
    /// of the last image.
    pub(crate) fn advance(
        &mut self,
        adapter: &mut Adapter,
        count: usize,
        published: u16,
    ) -> Result<bool, VerificationFault> {
        if !self.begin_checks(adapter, count, published)? {
            return Ok(false);
        }
        let now_ns = adapter.clock().now_ns();
        while let Some(Step { check, request, .. }) = self.steps.get(self.passed).copied() {
            if self.passed >= count {
                break;
            }
            let state =
                adapter.requests().sdo_state(request).map_err(VerificationFault::Library)?;
            if state == RequestState::Busy {
                return self.wait(check.transfer(), self.waiting_since_ns, now_ns);
            }
            if let Check::Controller { channel, step } = check {
                let value = (state == RequestState::Success).then(|| value(adapter, request));
                self.controller.take(self.slave, channel, step, value)?;
                self.passed += 1;
                self.waiting_since_ns = now_ns;
                continue;
            }
            if state != RequestState::Success {
                return Err(VerificationFault::Transfer(check.transfer()));
            }
            let value = value(adapter, request);
            check.verify(value, &mut self.layout_crc)?;
            if matches!(check, Check::Sequence) && !self.check_sequence(value, published)? {
                self.begun = self.passed;
                return Ok(false);
            }
            self.passed += 1;
            self.waiting_since_ns = now_ns;
        }
        self.controller.take_fault().map_or(Ok(true), Err)
    }

    /// Begins the transfers of the attempt, once those of earlier ones have ended.
    fn begin_checks(
        &mut self,
        adapter: &mut Adapter,
        count: usize,
        published: u16,
    ) -> Result<bool, VerificationFault> {
        let now_ns = adapter.clock().now_ns();
        if self.begun == 0 {
            self.earlier = None;
            for step in &self.steps {
                let state = adapter.requests().sdo_state(step.request);
                if state.map_err(VerificationFault::Library)? == RequestState::Busy {
                    let transfer = step.check.transfer();
                    self.earlier = step.begun_ns.map(|_| transfer);
                    let begun_ns = step.begun_ns.unwrap_or(self.waiting_since_ns);
                    return self.wait(transfer, begun_ns, now_ns);
                }
            }
        }
        while let Some(step) = self.steps.get_mut(self.begun).filter(|_| self.begun < count) {
            begin(adapter, step).map_err(VerificationFault::Library)?;
            step.begun_ns = Some(now_ns);
            self.sequence_at_start = published;
            self.waiting_since_ns = now_ns;
            self.begun += 1;
        }
        Ok(true)
    }

    fn wait(
        &self,
        transfer: SdoTransfer,
        begun_ns: u64,
        now_ns: u64,
    ) -> Result<bool, VerificationFault> {
        if now_ns.saturating_sub(self.waiting_since_ns) < self.limit_ns {
            return Ok(false);
        }
        let waited_ms = now_ns.saturating_sub(begun_ns) / NS_PER_MS;
        Err(VerificationFault::Unended { transfer, waited_ms })
    }

    /// Returns whether the gateway receives the images that the Port publishes to it, by the
    /// sequence that it reports. `false` for a transfer that took so long that nothing follows; it
    /// is repeated.
    fn check_sequence(&mut self, found: u32, published: u16) -> Result<bool, VerificationFault> {
        let window = published.wrapping_sub(self.sequence_at_start).saturating_add(SEQUENCE_MARGIN);
        if window > self.sequence_distance / 2 {
            return Ok(false);
        }
        let is_own = u64::from(found) <= u64::from(u16::MAX)
            && published.wrapping_sub(found as u16) <= window;
        if self.reports_sequence.is_none() && !is_own {
            tracing::warn!(
                slave = self.slave,
                "slave {}: the gateway does not report the sequence of its last image; that process \
                 data reach the right gateway is not verified",
                self.slave
            );
        }
        match *self.reports_sequence.get_or_insert(is_own) {
            true if !is_own => Err(VerificationFault::ProcessData),
            _ => Ok(true),
        }
    }
}

fn begin(adapter: &mut Adapter, step: &Step) -> Result<(), CycleError> {
    let SdoTransfer { index, subindex, .. } = step.check.transfer();
    match step.check.download() {
        Some(sdo) => {
            let (bytes, length) = sdo.bytes();
            let data = bytes.get(..length).unwrap_or_default();
            adapter.requests().sdo_write(step.request, index, subindex, data)
        }
        None => adapter.requests().sdo_read(step.request, index, subindex),
    }
}

/// Value of an upload that has succeeded.
fn value(adapter: &mut Adapter, request: SdoRequestId) -> u32 {
    let mut value = [0; 4];
    for (to, from) in value.iter_mut().zip(adapter.requests().sdo_data(request)) {
        *to = *from;
    }
    u32::from_le_bytes(value)
}

/// Status of the register service: busy (manual 13.6).
const BUSY: u32 = 3;
/// Failed attempts in a row from which the mode of a channel counts as not readable.
const MAX_ATTEMPTS: u8 = 3;

/// Registers of the channel whose steps are in progress, and the attempts of all channels.
#[derive(Debug, Default)]
pub(crate) struct ControllerReading {
    cccr: u32,
    test: u32,
    /// The service rejected an access to the channel.
    is_rejected: bool,
    /// First fault of the channel that may pass.
    channel_fault: Option<VerificationFault>,
    /// First fault of the attempt that may pass. The channels after it are read nevertheless, so
    /// that their attempts count, too.
    fault: Option<VerificationFault>,
    /// Attempts in a row that did not read the mode, by channel.
    failed_attempts: [u8; CHANNELS],
    /// Channels whose unverified mode is logged.
    logged: u8,
}

impl ControllerReading {
    /// Begins another attempt.
    pub(crate) fn restart(&mut self) {
        self.fault = None;
    }

    /// Fault of the attempt that may pass, after the steps of all channels.
    pub(crate) fn take_fault(&mut self) -> Option<VerificationFault> {
        self.fault.take()
    }

    /// Takes the value of a step; `None` if the transfer failed. Decides after the last step of a
    /// channel: an access that the service rejects, and one that fails in several attempts in a row, is
    /// a warning, because firmware may lack the service or deny the access.
    pub(crate) fn take(
        &mut self,
        slave: usize,
        channel: u8,
        step: ControllerStep,
        value: Option<u32>,
    ) -> Result<(), VerificationFault> {
        if step == ControllerStep::Offset(CCCR) {
            (self.is_rejected, self.channel_fault) = (false, None);
        }
        let in_use = VerificationFault::RegisterServiceInUse { channel };
        let fault = match (step, value) {
            (_, None) => {
                Some(VerificationFault::Transfer(Check::Controller { channel, step }.transfer()))
            }
            (ControllerStep::Status, Some(BUSY)) => Some(in_use),
            (ControllerStep::Status, Some(status)) => {
                self.is_rejected |= status != 0;
                None
            }
            (ControllerStep::Value(CCCR), Some(value)) => {
                self.cccr = value;
                None
            }
            (ControllerStep::Value(_), Some(value)) => {
                self.test = value;
                None
            }
            // The result belongs to the access of another program.
            (ControllerStep::OffsetReadback(offset), Some(value)) => {
                (value != u32::from(offset)).then_some(in_use)
            }
            (ControllerStep::Offset(_) | ControllerStep::Command, Some(_)) => None,
        };
        self.channel_fault = self.channel_fault.or(fault);
        match step {
            ControllerStep::OffsetReadback(TEST) => self.decide(slave, channel),
            _ => Ok(()),
        }
    }

    fn decide(&mut self, slave: usize, channel: u8) -> Result<(), VerificationFault> {
        let attempts = &mut self.failed_attempts[usize::from(channel) % CHANNELS];
        if let Some(fault) = self.channel_fault {
            *attempts = attempts.saturating_add(1);
            if *attempts < MAX_ATTEMPTS {
                self.fault = self.fault.or(Some(fault));
                return Ok(());
            }
        }
        if self.channel_fault.is_some() || self.is_rejected {
            if self.logged >> channel & 1 == 0 {
                self.logged |= 1 << channel;
                warn_unverified(slave, channel);
            }
            return Ok(());
        }
        *attempts = 0;
        self.logged &= !(1 << channel);
        match ControllerMode::of(self.cccr, self.test) {
            ControllerMode::Listen => Ok(()),
            mode => Err(VerificationFault::NodeMode { channel, mode }),
        }
    }
}

/// Logs that the mode of a channel that must only listen is not verified.
pub(crate) fn warn_unverified(slave: usize, channel: u8) {
    tracing::warn!(
        slave,
        channel,
        "slave {slave} channel {channel}: the registers of the controller cannot be read; that node \
         mode 1 is listen-only is not verified (assumption H9)"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHANNEL: u8 = 2;
    /// Values of the steps of a channel that listens.
    const LISTENING: [Option<u32>; 10] = values(0x20, 0x80);
    const IN_USE: VerificationFault = VerificationFault::RegisterServiceInUse { channel: CHANNEL };

    const fn values(cccr: u32, test: u32) -> [Option<u32>; 10] {
        let (cccr, test) = (Some(cccr), Some(test));
        let (zero, cccr_offset, test_offset) = (Some(0), Some(CCCR as u32), Some(TEST as u32));
        [zero, zero, zero, cccr, cccr_offset, zero, zero, zero, test, test_offset]
    }

    /// Result of one attempt.
    fn attempt(
        reading: &mut ControllerReading,
        values: [Option<u32>; 10],
    ) -> Result<(), VerificationFault> {
        reading.restart();
        let steps = [CCCR, TEST].into_iter().flat_map(ControllerStep::of_register);
        steps.zip(values).try_for_each(|(step, value)| reading.take(0, CHANNEL, step, value))?;
        reading.take_fault().map_or(Ok(()), Err)
    }

    fn with(nth: usize, value: Option<u32>) -> [Option<u32>; 10] {
        let mut values = LISTENING;
        values[nth] = value;
        values
    }

    fn failed(step: ControllerStep) -> Result<(), VerificationFault> {
        let check = Check::Controller { channel: CHANNEL, step };
        Err(VerificationFault::Transfer(check.transfer()))
    }

    #[test]
    fn mode_is_read_from_both_registers() {
        let mut reading = ControllerReading::default();
        assert_eq!(attempt(&mut reading, LISTENING), Ok(()));
        for (cccr, test, mode) in [
            (0x00, 0x80, ControllerMode::Normal),
            (0xA0, 0x90, ControllerMode::InternalLoopback),
            (0x80, 0x90, ControllerMode::ExternalLoopback),
        ] {
            let fault = VerificationFault::NodeMode { channel: CHANNEL, mode };
            assert_eq!(attempt(&mut reading, values(cccr, test)), Err(fault));
        }
    }

    #[test]
    fn rejected_access_is_no_fault() {
        for status in [1, 4] {
            for nth in [2, 7] {
                let mut reading = ControllerReading::default();
                assert_eq!(attempt(&mut reading, with(nth, Some(status))), Ok(()));
                assert_eq!(reading.logged, 1 << CHANNEL);
            }
        }
    }

    #[test]
    fn failed_transfers_are_repeated_twice() {
        let mut reading = ControllerReading::default();
        let offset = failed(ControllerStep::Offset(CCCR));
        assert_eq!(attempt(&mut reading, [None; 10]), offset);
        assert_eq!(attempt(&mut reading, [None; 10]), offset);
        for _ in 0..300 {
            assert_eq!(attempt(&mut reading, [None; 10]), Ok(()));
        }
        assert_eq!(reading.logged, 1 << CHANNEL);
        assert_eq!(attempt(&mut reading, LISTENING), Ok(()));
        assert_eq!(reading.logged, 0);
        assert_eq!(attempt(&mut reading, [None; 10]), offset);
    }

    #[test]
    fn any_failed_transfer_prevents_a_decision() {
        for nth in 0..10 {
            let mut normal = values(0, 0);
            normal[nth] = None;
            let result = attempt(&mut ControllerReading::default(), normal);
            assert!(matches!(result, Err(VerificationFault::Transfer(_))), "{nth}: {result:?}");
        }
    }

    #[test]
    fn busy_or_shared_service_is_read_again() {
        for (nth, value) in [(2, BUSY), (7, BUSY), (4, TEST.into()), (9, 0x1C)] {
            let mut reading = ControllerReading::default();
            assert_eq!(attempt(&mut reading, with(nth, Some(value))), Err(IN_USE));
            assert_eq!(attempt(&mut reading, LISTENING), Ok(()));
        }
    }

    /// A runner whose transfer began after image 65,500; images of another gateway are 16,384 numbers away.
    fn runner() -> CheckRunner {
        CheckRunner {
            slave: 0,
            steps: Vec::new(),
            passed: 0,
            begun: 0,
            earlier: None,
            waiting_since_ns: 0,
            limit_ns: 0,
            layout_crc: [None; 2],
            controller: ControllerReading::default(),
            sequence_distance: 0x4000,
            sequence_at_start: 65_500,
            reports_sequence: None,
        }
    }

    const OTHER: VerificationFault = VerificationFault::ProcessData;

    #[test]
    fn gateway_that_reports_images_of_another_one_is_rejected() {
        let mut runner = runner();
        for (found, published) in [(65_500, 65_510), (65_510, 65_510), (65_530, 10), (10, 10)] {
            assert_eq!(runner.check_sequence(found, published), Ok(true), "{found}");
        }
        let oldest = u32::from(65_500 - SEQUENCE_MARGIN);
        assert_eq!(runner.check_sequence(oldest, 65_510), Ok(true));
        for found in [oldest - 1, 65_511, 0x4000, u32::from(u16::MAX) + 65_500] {
            assert_eq!(runner.check_sequence(found, 65_510), Err(OTHER), "{found}");
        }
    }

    #[test]
    fn gateway_that_reports_no_sequence_is_accepted() {
        let mut runner = runner();
        assert_eq!(runner.check_sequence(0, 65_510), Ok(true));
        assert_eq!(runner.check_sequence(0, 65_510), Ok(true), "also later");
    }

    /// Numbers of such a distance are those of another gateway, too.
    #[test]
    fn slow_transfer_decides_nothing() {
        let mut runner = runner();
        let longest = 0x2000 - SEQUENCE_MARGIN;
        let published = 65_500_u16.wrapping_add(longest + 1);
        assert_eq!(runner.check_sequence(0x4000, published), Ok(false));
        assert_eq!(runner.check_sequence(0x4000, published.wrapping_add(500)), Ok(false));
        let published = 65_500_u16.wrapping_add(longest);
        assert_eq!(runner.check_sequence(published.into(), published), Ok(true));
        assert_eq!(runner.check_sequence(0x4000, published), Err(OTHER));
    }
}
