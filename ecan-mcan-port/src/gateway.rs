//! One gateway in the Port: its session, images and counters, and its part of the cycle.

use ecan_host::{Adapter, Delivery, DomainReport, Plan};
use ecan_protocol::can::FrameRef;
use ecan_protocol::device::{AlState, Capabilities};
use ecan_protocol::image::{ChannelStatus, ImageReader, ImageWriter, OptionFlags};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::al_watch::{AlWatch, Proof};
use crate::config::{GatewayConfig, ScheduleConfig};
use crate::receiver::Receiver;
use crate::schedule::account::ScheduleFault;
use crate::schedule::margin::{NotSchedulable, ScheduleMargin, ScheduleTimes};
use crate::schedule::watch::{ScheduleWatch, WatchResult};
use crate::session::machine::{Event, Session, SessionMachine};
use crate::statistics::SlaveStatistics;
use crate::transmit::transmitter::Transmitter;
use crate::transmit::window::DEFAULT_DEPTH;

/// Bits of a channel's status that are counted: state and bus-off (manual 7).
const STATE_BITS: u16 = 7 | ChannelStatus::from_raw(0).with_bus_off(true).raw();

#[derive(Debug)]
pub(crate) struct Gateway {
    pub(crate) session: SessionMachine,
    al_watch: AlWatch,
    pub(crate) transmitter: Transmitter,
    pub(crate) receiver: Receiver,
    pub(crate) statistics: SlaveStatistics,
    pub(crate) capabilities: Capabilities,
    pub(crate) channel_mask: u8,
    /// [`STATE_BITS`] of the channels in the last image of this session, if none of them is counted.
    running_states: Option<[u16; CHANNELS]>,
    /// Channels that frames can be sent to.
    rx_mask: u8,
    fd_mask: u8,
    can_schedule: bool,
    pub(crate) is_paced: bool,
    hold_limit: u16,
    input_limit: u16,
    pub(crate) schedule: ScheduleConfig,
    pub(crate) schedule_times: ScheduleTimes,
    /// Sync0 pulse that the scheduled frames of this cycle count from, in application time since the
    /// first cycle; `None` if unknown.
    pulse_ns: Option<u64>,
    pub(crate) watch: ScheduleWatch,
    /// Fault of the last reading of the flags.
    pub(crate) schedule_fault: Option<ScheduleFault>,
    /// Cycle in which it became ready the last time; 0 if it never was.
    pub(crate) ready_since: u64,
}

impl Gateway {
    /// Reads the capabilities and creates the SDO requests; the Adapter is not active yet.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        config: &GatewayConfig,
    ) -> Result<Self, ecan_host::Error> {
        let capabilities = Capabilities::read(|subindex| adapter.capability(slave, subindex))?;
        let settings = &adapter.config().slaves[slave];
        let rx = config.profile(Direction::RxPdo, settings.rx_multiplier);
        let tx = config.profile(Direction::TxPdo, settings.tx_multiplier);
        let mut writer = ImageWriter::new(Direction::RxPdo, rx);
        let mut reader = ImageReader::new(Direction::TxPdo, tx);
        if config.allow_diagnostic_tests {
            // 0x8030:04 overrides the CRC option of both directions (manual 13.2.3).
            let policy = adapter.diagnostics().sdo_upload_u32(slave, 0x8030, 4);
            match ecan_host::Error::or_assumed(policy, 0x8030, 4)? {
                1 => (writer, reader) = (writer.with_crc(true), reader.with_crc(true)),
                2 => (writer, reader) = (writer.with_crc(false), reader.with_crc(false)),
                _ => {}
            }
        }
        let depth = match capabilities.tx_cache_max {
            0 => DEFAULT_DEPTH,
            depth => depth,
        };
        let fd_mask = (0..CHANNELS).fold(0, |mask, channel| {
            let is_fd = config.channels[channel].as_ref().is_some_and(|c| c.can.fd);
            mask | u8::from(is_fd) << channel
        });
        let has_results = config.tx_options.contains(OptionFlags::TX_RESULT);
        let schedule = config.schedule;
        let dc = adapter.config().dc;
        let plan = Plan::of(adapter.config());
        let schedule_times = ScheduleTimes::new(&schedule, adapter.config(), &plan.slaves[slave]);
        Ok(Self {
            session: SessionMachine::new(adapter, slave, config)?,
            al_watch: AlWatch::new(adapter, slave)?,
            watch: ScheduleWatch::new(adapter, slave, rx.channel_mask, &schedule, dc)?,
            transmitter: Transmitter::new(writer, &rx, depth, has_results, schedule.discard_missed),
            receiver: Receiver::new(reader),
            statistics: SlaveStatistics::default(),
            can_schedule: capabilities.has_scheduled_tx(),
            capabilities,
            channel_mask: config.channel_mask(),
            running_states: None,
            rx_mask: rx.channel_mask,
            schedule,
            schedule_times,
            pulse_ns: None,
            schedule_fault: None,
            ready_since: 0,
            fd_mask,
            is_paced: config.paced,
            hold_limit: config.hold_limit,
            input_limit: config.input_limit,
        })
    }

    pub(crate) fn set_limits(&mut self, config: &GatewayConfig) {
        self.is_paced = config.paced;
        (self.hold_limit, self.input_limit) = (config.hold_limit, config.input_limit);
    }

    #[inline]
    pub(crate) fn has_channel(&self, channel: u8) -> bool {
        usize::from(channel) < CHANNELS && self.channel_mask >> channel & 1 == 1
    }

    pub(crate) fn is_fd(&self, channel: u8) -> bool {
        usize::from(channel) < CHANNELS && self.fd_mask >> channel & 1 == 1
    }

    /// Returns whether the RxPDO carries frames to the channel.
    pub(crate) fn can_send(&self, channel: u8) -> bool {
        usize::from(channel) < CHANNELS && self.rx_mask >> channel & 1 == 1
    }

    /// Returns whether the gateway is ready and the frame suits a channel of the RxPDO.
    #[inline(always)]
    pub(crate) fn accepts(&self, channel: u8, frame: FrameRef<'_>) -> bool {
        let mask = if frame.is_fd() { self.rx_mask & self.fd_mask } else { self.rx_mask };
        usize::from(channel) < CHANNELS && mask >> channel & 1 == 1 && self.session.is_ready()
    }

    /// Margin of a Sync0 phase.
    pub(crate) fn schedule_margin(&self, offset_ns: u32) -> Result<ScheduleMargin, NotSchedulable> {
        let margin = self.schedule_times.margin(offset_ns);
        match margin {
            Err(NotSchedulable::NoSync0) => margin,
            _ if !self.can_schedule => Err(NotSchedulable::NotSupported),
            _ => margin,
        }
    }

    /// Start of the cycle `number`. `since_first_ns` is the application time since the first cycle, if known.
    /// Returns whether a new image has arrived.
    pub(crate) fn begin(
        &mut self,
        adapter: &mut Adapter,
        slave: usize,
        number: u64,
        since_first_ns: Option<u64>,
    ) -> bool {
        let report = adapter.domain_report(slave);
        if self.statistics.sessions > 0 {
            self.statistics.cycles += 1;
            self.statistics.incomplete_cycles += u64::from(!report.is_complete());
        }
        let pulse_ns = since_first_ns.and_then(|ns| self.schedule_times.pulse_of(ns));
        let last_ns = std::mem::replace(&mut self.pulse_ns, pulse_ns);
        let is_same_pulse = pulse_ns.is_some() && last_ns == pulse_ns;
        let image = adapter.rx_pdo_mut(slave);
        self.transmitter.begin(image, &report, is_same_pulse, &mut self.statistics);
        self.step_al_watch(adapter, &report);
        self.step_session(adapter, slave, number);
        if !self.session.is_ready() {
            let Self { receiver, statistics, .. } = self;
            let may_publish = || may_publish(adapter, slave);
            receiver.pass_over(adapter.tx_pdo(slave), report.inputs, may_publish, statistics);
            return false;
        }
        self.step_watch(adapter, slave);
        let Self { receiver, statistics, .. } = self;
        let is_new = receiver.begin(adapter.tx_pdo(slave), report.inputs, statistics);
        if is_new {
            let status = receiver.status();
            let states = status.map(|status| status.raw() & STATE_BITS);
            // Nearly always every channel runs as before.
            if self.running_states != Some(states) {
                self.count_status(slave, states);
            }
            self.transmitter.status(self.receiver.status());
        }
        is_new
    }

    /// Counts the status of the channels in a new image, before the transmitter takes it.
    #[cold]
    fn count_status(&mut self, slave: usize, states: [u16; CHANNELS]) {
        let Self { transmitter, receiver, statistics, channel_mask, .. } = self;
        let mut is_counted = false;
        for (channel, status) in receiver.status().iter().enumerate() {
            if *channel_mask >> channel & 1 == 1 {
                is_counted |= statistics.channel(channel as u8).count_status(*status);
            }
            if status.bus_off() != transmitter.window(channel as u8).is_bus_off() {
                log_bus_off(slave, channel, status.bus_off());
            }
        }
        self.running_states = (!is_counted).then_some(states);
    }

    /// Returns whether the master has not noticed that the gateway left OP.
    pub(crate) fn has_left_op_unnoticed(&self) -> bool {
        self.al_watch.is_unnoticed()
    }

    pub(crate) fn statistics(&self) -> SlaveStatistics {
        let mut statistics = self.statistics;
        for (channel, pending) in statistics.channels.iter_mut().zip(self.transmitter.pending()) {
            channel.frames_pending = pending;
        }
        statistics
    }

    fn step_al_watch(&mut self, adapter: &mut Adapter, report: &DomainReport) {
        let answers = report.outputs == Delivery::Confirmed;
        let mark = self.transmitter.mark();
        match self.al_watch.step(adapter, answers, mark) {
            Some(Proof::Proven(mark)) => self.transmitter.prove(mark, &mut self.statistics),
            Some(Proof::Unproven(mark)) => {
                self.transmitter.expire_proof(mark, &mut self.statistics);
            }
            None => {}
        }
    }

    fn step_session(&mut self, adapter: &mut Adapter, slave: usize, number: u64) {
        let Self { session, transmitter, receiver, statistics, watch, ready_since, .. } = self;
        let no_input = self.input_limit > 0 && receiver.misses() > self.input_limit;
        let is_lost = transmitter.misses() > self.hold_limit || no_input;
        let was_ready = session.is_ready();
        session.set_below_op(self.al_watch.is_below_op());
        match session.step(adapter, is_lost, transmitter.published_sequence()) {
            Event::None => return,
            Event::Started => {
                transmitter.restart(session.first_sequence(number), statistics);
            }
            Event::Ready => {
                receiver.reset();
                transmitter.reset(statistics);
                watch.reset();
                statistics.sessions += 1;
                *ready_since = number;
                tracing::info!(slave, "slave {slave}: ready");
            }
            Event::Failed => {
                statistics.verification_failures += 1;
                if let Session::Failed(fault) = session.state() {
                    tracing::warn!(slave, "slave {slave}: verification failed ({fault})");
                }
            }
            Event::Lost => {
                receiver.reset();
                transmitter.reset(statistics);
                if was_ready {
                    statistics.sessions_lost += 1;
                    tracing::warn!(slave, "slave {slave}: lost");
                } else {
                    tracing::info!(slave, "slave {slave}: lost during its verification");
                }
            }
        }
        // The transmitter has forgotten the status.
        self.running_states = None;
    }

    fn step_watch(&mut self, adapter: &mut Adapter, slave: usize) {
        let Self { watch, transmitter, schedule_fault, .. } = self;
        let has_results = transmitter.has_results();
        let is_used = transmitter.accounts().is_used();
        let accounts = transmitter.accounts_mut();
        let fault = match watch.step(adapter, is_used) {
            WatchResult::Nothing => return,
            WatchResult::Due => return accounts.ripen(),
            WatchResult::Cleared => {
                accounts.forget_flags();
                None
            }
            WatchResult::Looked(now, before) => {
                accounts.record_reading(&now, before.as_ref(), has_results)
            }
            WatchResult::Unreadable(object) => {
                accounts.forget_flags();
                Some(ScheduleFault::unreadable(object))
            }
        };
        if let Some(fault) = fault
            && *schedule_fault != Some(fault)
        {
            log_schedule_fault(slave, fault);
        }
        *schedule_fault = fault;
    }

    /// Withdraws scheduled frames whose image would arrive after their pulse: they would leave a
    /// period late.
    pub(crate) fn withdraw_late(
        &mut self,
        adapter: &mut Adapter,
        slave: usize,
        point_ns: u64,
        since_first_ns: u64,
    ) {
        if !self.transmitter.has_scheduled() {
            return;
        }
        let sent_ns = adapter.clock().now_ns().saturating_sub(point_ns);
        if self.schedule_times.misses_pulse(since_first_ns, sent_ns) {
            self.transmitter.withdraw_late(adapter.rx_pdo_mut(slave), &mut self.statistics);
        }
    }
}

/// Returns whether a gateway may publish images, by the state that the master reports.
fn may_publish(adapter: &Adapter, slave: usize) -> bool {
    let state = adapter.slave_state(slave);
    state.is_ok_and(|state| state.online && state.al_state >= AlState::SafeOp.raw())
}

#[cold]
fn log_schedule_fault(slave: usize, fault: ScheduleFault) {
    tracing::warn!(slave, "slave {slave}: scheduled frames: {fault}");
}

#[cold]
fn log_bus_off(slave: usize, channel: usize, is_bus_off: bool) {
    if is_bus_off {
        tracing::warn!(slave, channel, "slave {slave} channel {channel}: bus-off");
    } else {
        tracing::info!(slave, channel, "slave {slave} channel {channel}: bus-off ended");
    }
}
