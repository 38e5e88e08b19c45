//! Data path: from RxPDO images through TX rings and schedule to the controllers, and from the
//! controllers through RX caches to TxPDO images.

use ecan_protocol::config::{
    ApplyStatus, DataPathConfig, DataPathGlobal, DiagnosticTest, RxBypass, TxBypass,
};
use ecan_protocol::image::{
    FrameBudget, FramePacket, OptionFlags, Packet, PdoError, ResultCode, Schedule,
};
use ecan_protocol::mapping::{CHANNELS, Direction, HEADER_BYTES};

use super::channel::{Channel, ChannelModel, path_error};
use super::config::GatewayModelConfig;
use super::controller::{ControllerConfig, Rejection};
use super::dc_clock::PulseTrain;
use super::diagnostics::{CyclePerformance, GatewayCounters};
use super::fault::PendingFaults;
use super::maintenance::flag;
use super::pdo::{RxPdoParser, TxPdoBuilder};
use super::profile_control::ActiveOptions;
use super::transmit_path::{Pending, Reference, ResultQueue, ScheduleQueue, Scheduled};
use super::variant::{GatewayVariant, LateResult, RxBudgetPolicy, ScheduledPulse, TxPdoNumbering};

/// Service budget in microseconds if 0x8020:7 is 0.
const DEFAULT_SERVICE_BUDGET_US: u32 = 1000;
/// Microseconds of the service budget that one frame costs, in either direction.
const FRAME_COST_US: u32 = 2;

#[derive(Clone, Copy, Debug)]
pub(super) struct ServiceTimes {
    pub(super) now: u64,
    /// When the image in SM2 was written.
    pub(super) outputs_at: u64,
    pub(super) pulses: Option<PulseTrain>,
}

#[derive(Clone, Debug)]
pub(super) struct DataPath {
    pub(super) channels: [Channel; CHANNELS],
    pub(super) options: ActiveOptions,
    pub(super) global: DataPathGlobal,
    parser: RxPdoParser,
    builder: TxPdoBuilder,
    results: ResultQueue,
    schedule: ScheduleQueue,
    pub(super) counters: GatewayCounters,
    pub(super) performance: CyclePerformance,
    /// Diagnostic flags of 0xB000:6.
    pub(super) flags: u16,
    variant: GatewayVariant,
}

impl DataPath {
    pub(super) fn new(config: &GatewayModelConfig, seed: u64) -> Self {
        Self {
            channels: std::array::from_fn(|_| Channel::new(ChannelModel::new(config))),
            options: ActiveOptions::new(&config.variant),
            global: DataPathGlobal::default(),
            parser: RxPdoParser::new(&config.variant),
            builder: TxPdoBuilder::new(&config.variant),
            results: ResultQueue::new(&config.variant),
            schedule: ScheduleQueue::new(
                config.variant.schedule_depth.get() as usize,
                config.release_jitter_ns,
                seed,
            ),
            counters: GatewayCounters::default(),
            performance: CyclePerformance::new(config.variant.phase_unit),
            flags: 0,
            variant: config.variant.clone(),
        }
    }

    pub(super) fn reset(&mut self) {
        for channel in &mut self.channels {
            channel.power_off(&mut self.counters);
        }
        self.counters.transmit_losses.stale += self.schedule.flush() as u64;
        self.options = ActiveOptions::new(&self.variant);
        self.global = DataPathGlobal::default();
        self.parser = RxPdoParser::new(&self.variant);
        self.builder = TxPdoBuilder::new(&self.variant);
        self.results.clear();
        self.performance = CyclePerformance::new(self.variant.phase_unit);
        self.flags = 0;
    }

    pub(super) fn variant(&self) -> &GatewayVariant {
        &self.variant
    }

    pub(super) fn set_test(&mut self, test: DiagnosticTest) {
        self.options.test = test;
        self.configure_codecs();
    }

    pub(super) fn set_policy(&mut self, number: usize, policy: DataPathConfig) {
        self.channels[number].set_policy(policy, &mut self.counters);
    }

    /// Restarts a controller with a new configuration. An invalid configuration leaves it running
    /// as it was.
    pub(super) fn apply_channel(
        &mut self,
        number: usize,
        built: Result<ControllerConfig, ApplyStatus>,
    ) -> ApplyStatus {
        let channel = &mut self.channels[number];
        channel.apply_failed = built.is_err();
        match built {
            Ok(config) => {
                let dropped = self.schedule.flush_channel(number) as u64;
                self.counters.transmit_losses.schedule_failed += dropped;
                channel.restart(Some(config), &mut self.counters);
                ApplyStatus::Ok
            }
            Err(status) => status,
        }
    }

    pub(super) fn restart_channels(&mut self) {
        for channel in &mut self.channels {
            channel.restart(channel.controller.config.clone(), &mut self.counters);
        }
    }

    /// The active profile of a direction has changed. A new RxPDO layout starts a new session.
    pub(super) fn profile_changed(&mut self, direction: Direction) {
        self.configure_codecs();
        if direction == Direction::RxPdo {
            self.parser.reset_session();
        }
    }

    pub(super) fn reset_session(&mut self, direction: Direction) {
        self.options.of_mut(direction).reset_session();
        match direction {
            Direction::TxPdo => {
                if self.variant.txpdo_numbering == TxPdoNumbering::FromOne {
                    self.builder.reset_session();
                }
                self.results.clear();
            }
            Direction::RxPdo => self.parser.reset_session(),
        }
    }

    fn configure_codecs(&mut self) {
        let Self { options, builder, parser, .. } = self;
        let (tx, rx) = (Direction::TxPdo, Direction::RxPdo);
        builder.configure(options.tx.active, options.uses_crc(tx), options.is_payload_only(tx));
        parser.configure(options.rx.active, options.uses_crc(rx));
    }

    /// Process data starts: what was received before is dropped, so the first image is empty.
    pub(super) fn start_inputs(&mut self) {
        for direction in Direction::ALL {
            if self.options.of_mut(direction).lose_rewritten() {
                self.profile_changed(direction);
            }
        }
        self.results.clear();
        for channel in &mut self.channels {
            channel.flush_receive(&mut self.counters);
        }
    }

    /// Outputs stop: frames that wait to be sent are dropped as stale.
    pub(super) fn stop_outputs(&mut self) {
        let mut stale = self.schedule.flush();
        for channel in &mut self.channels {
            stale += channel.transmit.flush();
        }
        self.counters.transmit_losses.stale += stale as u64;
    }

    /// Sync0 changes: frames scheduled for its pulses are dropped.
    pub(super) fn sync0_changed(&mut self) {
        let dropped = self.schedule.flush();
        if dropped > 0 {
            self.counters.transmit_losses.schedule_failed += dropped as u64;
            self.flags |= flag::SCHED_TIMER_MISS;
        }
        self.performance.restart_pulses();
    }

    pub(super) fn take_image(&mut self, image: &[u8], times: &ServiceTimes) {
        if self.options.is_app_bypassed(Direction::RxPdo)
            || self.options.bypasses_rx(RxBypass::STAGE)
            || self.options.bypasses_rx(RxBypass::PARSE)
        {
            return;
        }
        if self.parser.repeats_rejected(image) {
            self.counters.images_repeated += 1;
            return;
        }
        let result = self.parse_image(image, times);
        self.parser.note_rejected(image, result.is_err());
        if let Err(error) = result {
            self.counters.images_faulty += 1;
            self.options.rx.note_error(error);
        }
    }

    fn parse_image(&mut self, image: &[u8], times: &ServiceTimes) -> Result<(), PdoError> {
        if image.len() != self.options.rx.active_bytes() {
            return Err(PdoError::ActiveArea);
        }
        let Some(image) = self.parser.parse(image)? else {
            self.counters.images_repeated += 1;
            return Ok(());
        };
        let sequence = image.sequence();
        self.options.rx.sequence = sequence;
        let mut budget = self.rx_budget();
        let payload_end = HEADER_BYTES + image.payload().len();
        // Only a budget asks for the end of a packet.
        let mut following = budget.as_ref().map(|_| image.packets().skip(1));
        let mut packets = 0;
        let result = image.packets().try_for_each(|packet| {
            packets += 1;
            let end = match following.as_mut().and_then(Iterator::next) {
                Some(Ok(Packet::Frame(next))) => usize::from(next.offset),
                _ => payload_end,
            };
            match packet {
                Ok(Packet::Frame(packet)) => {
                    let bytes = end.saturating_sub(packet.offset.into());
                    let fits = budget.is_none_or(|budget| bytes <= budget.left(packet.channel));
                    if let Some(budget) = budget.as_mut().filter(|_| fits) {
                        budget.take(packet.channel, bytes);
                    }
                    self.take_frame(sequence, &packet, times, fits)
                }
                Ok(Packet::TxResult(_)) => Err(PdoError::UnknownKind),
                Err(diagnosis) => Err(self.parser.packet_error(&diagnosis)),
            }
        });
        self.performance.image_parsed(packets);
        self.counters.images_parsed += u64::from(result.is_ok());
        result
    }

    /// The budget of an RxPDO image, if the variant applies it.
    fn rx_budget(&self) -> Option<FrameBudget> {
        let is_applied = self.variant.rx_budget == RxBudgetPolicy::Applied;
        self.options.rx.active.filter(|_| is_applied).map(|profile| FrameBudget::new(&profile))
    }

    /// Hands one frame to its channel, or drops it if it does not fit into the budget. An error stops the parsing of the image.
    fn take_frame(
        &mut self,
        sequence: u16,
        packet: &FramePacket<'_>,
        times: &ServiceTimes,
        fits: bool,
    ) -> Result<(), PdoError> {
        let schedule = packet.schedule().transpose()?;
        let pulse = self.variant.scheduled_pulse;
        let due = schedule.map(|schedule| due_time(schedule, times, pulse)).transpose()?;
        self.counters.frames_parsed += 1;
        if self.options.bypasses_rx(RxBypass::TX_RING) {
            self.counters.transmit_losses.bypassed += 1;
            return Ok(());
        }
        let channel = usize::from(packet.channel);
        let frame = packet.frame.to_owned();
        let is_requested = self.options.has(Direction::TxPdo, OptionFlags::TX_RESULT);
        let reference = is_requested.then_some(Reference {
            channel: packet.channel,
            sequence,
            frame_index: packet.index,
        });
        if !fits {
            self.counters.transmit_losses.over_budget += 1;
            self.options.rx.note_overflow(1, Some(PdoError::PacketOverrun));
            self.results.report(reference, ResultCode::TxFifoFull);
            return Ok(());
        }
        match due {
            Some(due_ns) => {
                let entry = Scheduled { due_ns, channel, frame, reference };
                if let Some(code) = self.schedule_frame(entry, times.now) {
                    self.results.report(reference, code);
                }
            }
            None => {
                if let Err(code) = self.enqueue(channel, Pending { frame, reference }) {
                    self.results.report(reference, code);
                }
            }
        }
        Ok(())
    }

    fn enqueue(&mut self, number: usize, pending: Pending) -> Result<(), ResultCode> {
        let channel = &mut self.channels[number];
        let losses = &mut self.counters.transmit_losses;
        channel.check_sendable(&pending.frame, losses)?;
        let before = (losses.ring_full, losses.stale);
        let Channel { transmit, policy, .. } = channel;
        let result = transmit.enqueue(pending, policy, &mut self.results, losses);
        if (losses.ring_full, losses.stale) != before {
            channel.last_error = path_error::RING_FULL;
            self.flags |= flag::TX_RING_DROP;
            self.options.rx.note_overflow(1, None);
        }
        result
    }

    /// Returns the result of the frame.
    fn schedule_frame(&mut self, entry: Scheduled, now: u64) -> Option<ResultCode> {
        let number = entry.channel;
        let losses = &mut self.counters.transmit_losses;
        if let Err(code) = self.channels[number].check_sendable(&entry.frame, losses) {
            return Some(code);
        }
        if entry.due_ns <= now {
            losses.late += 1;
            self.note_schedule_error(number, flag::SCHED_LATE_DROP);
            return match self.variant.late_result {
                LateResult::Absent => None,
                LateResult::Queued => Some(ResultCode::Queued),
                LateResult::BusBusy => Some(ResultCode::BusBusy),
            };
        }
        if !self.schedule.insert(entry) {
            losses.schedule_full += 1;
            self.note_schedule_error(number, flag::SCHED_QUEUE_FULL);
            return Some(ResultCode::TxFifoFull);
        }
        self.counters.frames_scheduled += 1;
        Some(ResultCode::Queued)
    }

    fn note_schedule_error(&mut self, number: usize, flag: u16) {
        self.flags |= flag;
        self.channels[number].last_error = path_error::SCHEDULE;
        self.options.rx.note_overflow(1, None);
    }

    pub(super) fn release_time(&self) -> Option<u64> {
        self.schedule.next_due()
    }

    /// Hands the first due scheduled frame to its controller, past the TX ring.
    pub(super) fn release_scheduled(&mut self, now: u64) {
        let Some(due) = self.schedule.pop_due(now) else {
            return;
        };
        self.performance.scheduled_released(now);
        if self.options.bypasses_rx(RxBypass::MCAN_WRITE) {
            self.counters.transmit_losses.bypassed += 1;
            return;
        }
        let channel = &mut self.channels[due.channel];
        let result = channel.controller.submit(due.frame);
        self.results.report_released(due.reference, result.err());
        let Err(rejection) = result else {
            self.counters.frames_to_controller += 1;
            self.counters.frames_released += 1;
            return;
        };
        self.counters.transmit_losses.schedule_failed += 1;
        if rejection == Rejection::Full {
            channel.transmit.note_fifo_full();
            self.flags |= flag::TX_FIFO_FULL;
        }
        self.note_schedule_error(due.channel, flag::SCHED_TX_FAIL);
        self.channels[due.channel].note_rejection(rejection);
    }

    /// Serves all channels within the service budget. Frames are sent only in OP.
    pub(super) fn serve(&mut self, is_op: bool) {
        let budget_us = match self.global.max_service_budget_us {
            0 => DEFAULT_SERVICE_BUDGET_US,
            us => u32::from(us),
        };
        let mut allowance = budget_us / FRAME_COST_US;
        let mut served = 0;
        for number in 0..CHANNELS {
            let frames = self.serve_channel(number, is_op, allowance);
            allowance = allowance.saturating_sub(frames);
            served += frames;
        }
        self.performance.served(served as usize);
        self.results.settle(&mut self.counters);
    }

    /// Sends, recovers and drains one channel; returns the number of frames.
    fn serve_channel(&mut self, number: usize, is_op: bool, allowance: u32) -> u32 {
        let Self { channels, options, results, flags, performance, counters, .. } = self;
        let carried = options.tx.active.is_some_and(|profile| profile.has_channel(number as u8));
        let channel = &mut channels[number];
        let mut sent = 0;
        if is_op && options.bypasses_rx(RxBypass::MCAN_WRITE) {
            counters.transmit_losses.bypassed += channel.transmit.drop_unsent() as u64;
        } else if is_op {
            let full_before = channel.transmit.counters.fifo_full;
            let Channel { transmit, controller, policy, .. } = channel;
            sent = transmit.serve(controller, policy, allowance, results, counters);
            if transmit.counters.fifo_full != full_before {
                *flags |= flag::TX_FIFO_FULL;
                channel.note_rejection(Rejection::Full);
            }
            channel.transmit.report_queued(results);
        }
        channel.serve_recovery();
        let skips_read =
            options.bypasses_tx(TxBypass::MCAN_READ) || options.is_app_bypassed(Direction::TxPdo);
        let drained = if skips_read {
            channel.take_controller_losses();
            0
        } else {
            let allowance = allowance.saturating_sub(sent);
            channel.drain(allowance, carried, &mut counters.receive_losses)
        };
        channel.observe();
        channel.note_service(performance.served((sent + drained) as usize));
        sent + drained
    }

    /// Builds a TxPDO image of `length` bytes, the length of SM3. Returns the bytes to publish.
    pub(super) fn build_inputs(
        &mut self,
        length: usize,
        time_base_ns: u64,
        faults: &mut PendingFaults,
    ) -> Option<&[u8]> {
        if self.options.bypasses_tx(TxBypass::COPY) || self.options.tx.active.is_none() {
            return None;
        }
        if length != self.options.tx.active_bytes() {
            self.options.tx.note_error(PdoError::ActiveArea);
            return None;
        }
        let empty = self.options.is_app_bypassed(Direction::TxPdo)
            || self.options.bypasses_tx(TxBypass::BUILD);
        let scheduled = std::array::from_fn(|number| self.schedule.waiting(number));
        let (sequence, undelivered) = self.builder.build(
            &mut self.channels,
            &mut self.results,
            scheduled,
            time_base_ns,
            empty,
            &mut self.counters,
        )?;
        let control = &mut self.options.tx;
        control.sequence = sequence;
        control.note_overflow(undelivered.dropped, None);
        control.note_overflow(undelivered.unpacked, Some(PdoError::PacketOverrun));
        control.note_overflow(undelivered.oversized, Some(PdoError::FrameOverrun));
        if faults.torn_images.take() {
            self.builder.tear();
        }
        if faults.crc_errors.take() {
            self.builder.corrupt_crc();
        }
        self.counters.images_published += 1;
        let published = self.builder.published();
        self.performance.inputs_published(published.len());
        Some(published)
    }

    pub(super) fn clear_diagnostics(&mut self, now: u64, pulses: Option<PulseTrain>) {
        self.flags = 0;
        for channel in &mut self.channels {
            channel.clear_diagnostics();
        }
        self.clear_performance(now, pulses);
    }

    /// Clear command of 0x9011, which also clears the channels' service times.
    pub(super) fn clear_performance(&mut self, now: u64, pulses: Option<PulseTrain>) {
        for channel in &mut self.channels {
            channel.clear_service_times();
        }
        self.performance.clear(now, pulses);
    }

    /// A value of 0x9000..0x9003.
    pub(super) fn channel_information(&mut self, number: usize, subindex: u8) -> Option<u32> {
        self.channels[number].information(subindex, self.schedule.waiting(number))
    }
}

/// Send time of a schedule record: its offset after a Sync0 pulse, by default the first one that follows
/// the image. Without Sync0, or with an offset beyond the cycle, the record is invalid.
fn due_time(
    schedule: Schedule,
    times: &ServiceTimes,
    pulse: ScheduledPulse,
) -> Result<u64, PdoError> {
    let pulses = times.pulses.ok_or(PdoError::BadSchedule)?;
    let offset = u64::from(schedule.offset_ns);
    if offset >= pulses.cycle_ns() {
        return Err(PdoError::BadSchedule);
    }
    let next = pulses.next_after(times.outputs_at);
    let from = match pulse {
        ScheduledPulse::Next => next,
        ScheduledPulse::Previous => next.saturating_sub(pulses.cycle_ns()),
        ScheduledPulse::Second => next.saturating_add(pulses.cycle_ns()),
    };
    Ok(from.saturating_add(offset))
}
