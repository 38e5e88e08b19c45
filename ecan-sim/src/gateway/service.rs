//! The data-path service: from SM2 through the controllers to SM3, once a cycle.

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{RxBypass, TxBypass};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{FramePacket, OptionFlags, Packet, PdoError, ResultCode, Schedule};
use ecan_protocol::mapping::{CHANNELS, Direction};

use super::Gateway;
use super::channel::path_error;
use super::controller::Refusal;
use super::maintenance::flag;
use super::rx_pdo::Verdict;
use super::schedule::Scheduled;
use super::transmit_path::{Pending, Reference};

/// Service budget in microseconds when 0x8020:7 is 0.
const DEFAULT_SERVICE_BUDGET_US: u32 = 1000;
/// Microseconds of the service budget that one frame costs, in either direction.
const FRAME_COST_US: u32 = 2;

impl Gateway {
    /// When the service for the last SM2 write runs.
    pub(super) fn service_time(&self) -> Option<u64> {
        self.service_due.map(|due| due.max(self.faults.stalled_until))
    }

    /// When the next service runs that no SM2 write asked for.
    pub(super) fn idle_service_time(&self) -> Option<u64> {
        (self.state == AlState::SafeOp).then(|| self.idle_service_at.max(self.faults.stalled_until))
    }

    /// One service.
    pub(super) fn serve(&mut self) {
        self.counters.services += 1;
        if self.outputs.is_full() {
            self.performance.outputs_read(self.outputs.length().unwrap_or(0));
            if self.state == AlState::Op {
                self.take_image();
            }
            self.outputs.empty();
        }
        let budget_us = match self.data_path.max_service_budget_us {
            0 => DEFAULT_SERVICE_BUDGET_US,
            us => u32::from(us),
        };
        let mut allowance = budget_us / FRAME_COST_US;
        let mut served = 0;
        for number in 0..CHANNELS {
            let frames = self.serve_channel(number, allowance);
            allowance = allowance.saturating_sub(frames);
            served += frames;
        }
        self.performance.served(served as usize);
        self.results.settle(&mut self.counters);
        // An image that is being read keeps the buffer: the next one follows it.
        self.is_publish_due = self.are_inputs_being_read;
        if !self.inputs.is_full() {
            self.publish_inputs();
        }
        self.last_service = self.now;
    }

    /// Sends, recovers and drains one channel; returns how many frames that were.
    fn serve_channel(&mut self, number: usize, allowance: u32) -> u32 {
        let skips_send = self.bypasses_rx(RxBypass::MCAN_WRITE);
        let skips_read = self.test.tx_bypass.0 & TxBypass::MCAN_READ.0 != 0
            || self.is_app_bypassed(Direction::TxPdo);
        let carried = self
            .profile(Direction::TxPdo)
            .active()
            .is_some_and(|profile| profile.has_channel(number as u8));
        let op = self.state == AlState::Op;
        let Self { channels, results, counters, maintenance, performance, .. } = self;
        let Some(channel) = channels.get_mut(number) else {
            return 0;
        };
        let policy = channel.policy;
        let mut sent = 0;
        if op && skips_send {
            counters.transmit_losses.bypassed += channel.transmit.drop_unsent() as u64;
        } else if op {
            let full_before = channel.transmit.fifo_full;
            sent = channel.transmit.serve(
                number,
                &mut channel.controller,
                &policy,
                allowance,
                results,
                counters,
            );
            if channel.transmit.fifo_full != full_before {
                maintenance.flags |= flag::TX_FIFO_FULL;
                channel.note_refusal(Refusal::Full);
            }
            channel.transmit.report_queued(number, results);
        }
        channel.serve_recovery();
        for _ in 0..std::mem::take(&mut channel.controller.frames_lost) {
            channel.receive.note_controller_loss();
            channel.last_error = path_error::RX_OVERFLOW;
        }
        let mut drained = 0;
        if !skips_read {
            let dropped_before = channel.receive.dropped_total;
            drained = channel.receive.drain(
                &mut channel.controller,
                &policy,
                allowance.saturating_sub(sent),
                carried,
                &mut counters.receive_losses,
            );
            if channel.receive.dropped_total != dropped_before {
                channel.last_error = path_error::RX_OVERFLOW;
            }
        }
        channel.observe();
        let cycles = performance.served((sent + drained) as usize);
        channel.service_cycles_last = cycles;
        channel.service_cycles_max = channel.service_cycles_max.max(cycles);
        sent + drained
    }

    fn bypasses_rx(&self, bypass: RxBypass) -> bool {
        self.test.rx_bypass.0 & bypass.0 != 0
    }

    /// Parses the image in SM2 and hands its frames on.
    fn take_image(&mut self) {
        if self.is_app_bypassed(Direction::RxPdo)
            || self.bypasses_rx(RxBypass::STAGE)
            || self.bypasses_rx(RxBypass::PARSE)
        {
            return;
        }
        let length = self.outputs.length().unwrap_or(0);
        let active = self.profile(Direction::RxPdo).active_bytes();
        // Taken out for the time of the walk, so that the walk can borrow the rest.
        let outputs = std::mem::replace(&mut self.outputs, super::SingleBuffer::vacant());
        let mut parser = std::mem::replace(&mut self.parser, super::RxPdoParser::vacant());
        let error = if length != active {
            Some(PdoError::ActiveArea)
        } else {
            let image = outputs.memory().get(..length).unwrap_or_default();
            match parser.judge(image) {
                Verdict::Repeated => {
                    self.counters.images_repeated += 1;
                    None
                }
                Verdict::Faulty(error) => Some(error),
                Verdict::New(image) => {
                    let sequence = image.sequence();
                    self.profile_mut(Direction::RxPdo).sequence = sequence;
                    let mut packets = 0;
                    let mut error = None;
                    for packet in image.packets() {
                        packets += 1;
                        let fault = match packet {
                            Ok(Packet::Frame(packet)) => self.take_frame(sequence, &packet).err(),
                            Ok(Packet::TxResult(_)) => Some(PdoError::UnknownKind),
                            Err(diagnosis) => Some(parser.packet_error(&diagnosis)),
                        };
                        if fault.is_some() {
                            error = fault;
                            break;
                        }
                    }
                    self.performance.image_parsed(packets);
                    if error.is_none() {
                        self.counters.images_parsed += 1;
                    }
                    error
                }
            }
        };
        self.outputs = outputs;
        self.parser = parser;
        if let Some(error) = error {
            self.counters.images_faulty += 1;
            self.profile_mut(Direction::RxPdo).note_error(error);
        }
    }

    /// Hands one frame to its channel. An error ends the walk through the image.
    fn take_frame(&mut self, sequence: u16, packet: &FramePacket<'_>) -> Result<(), PdoError> {
        let schedule = packet.schedule().transpose()?;
        let due = match schedule {
            None => None,
            Some(schedule) => Some(self.due_time(schedule)?),
        };
        self.counters.frames_parsed += 1;
        if self.bypasses_rx(RxBypass::TX_RING) {
            self.counters.transmit_losses.bypassed += 1;
            return Ok(());
        }
        let number = usize::from(packet.channel);
        let reference = self
            .has_option(Direction::TxPdo, OptionFlags::TX_RESULT)
            .then_some(Reference { sequence, frame_index: packet.index });
        let frame = packet.frame.to_owned();
        let outcome = match due {
            Some(due_ns) => self.take_scheduled(number, frame, due_ns).map(|()| {
                if let Some(reference) = reference {
                    self.results.report(number, reference, ResultCode::Queued);
                }
            }),
            None => self.take_immediate(number, frame, reference),
        };
        if let (Err(code), Some(reference)) = (outcome, reference) {
            self.results.report(number, reference, code);
        }
        Ok(())
    }

    /// Whether the channel could send the frame; counts the loss when not.
    fn check_sendable(&mut self, number: usize, frame: &CanFrame) -> Result<(), ResultCode> {
        let Self { channels, counters, .. } = self;
        let Some(channel) = channels.get_mut(number) else {
            return Err(ResultCode::InvalidChannel);
        };
        let Err(refusal) = channel.controller.accepts(frame) else {
            return Ok(());
        };
        channel.note_refusal(refusal);
        match refusal {
            Refusal::BusOff => {
                counters.transmit_losses.bus_off += 1;
                Err(ResultCode::BusOff)
            }
            Refusal::CannotSend | Refusal::Full => {
                counters.transmit_losses.invalid_channel += 1;
                Err(ResultCode::InvalidChannel)
            }
        }
    }

    fn take_immediate(
        &mut self,
        number: usize,
        frame: CanFrame,
        reference: Option<Reference>,
    ) -> Result<(), ResultCode> {
        self.check_sendable(number, &frame)?;
        let Self { channels, results, counters, .. } = self;
        let Some(channel) = channels.get_mut(number) else {
            return Err(ResultCode::InvalidChannel);
        };
        let policy = channel.policy;
        let before = counters.transmit_losses;
        let outcome = channel.transmit.enqueue(
            number,
            Pending { frame, reference },
            &policy,
            results,
            &mut counters.transmit_losses,
        );
        if counters.transmit_losses != before {
            channel.last_error = path_error::RING_FULL;
            self.maintenance.flags |= flag::TX_RING_DROP;
            self.profile_mut(Direction::RxPdo).note_overflow(1, None);
        }
        outcome
    }

    // Scheduled transmission

    /// When a schedule record wants its frame to be sent: at an offset behind the first Sync0
    /// pulse after the image arrived. Without Sync0 there is no such capability; an offset
    /// beyond the cycle is no phase.
    fn due_time(&self, schedule: Schedule) -> Result<u64, PdoError> {
        let pulses = self.pulses.ok_or(PdoError::BadSchedule)?;
        let offset = u64::from(schedule.offset_ns);
        if offset >= pulses.cycle_ns() {
            return Err(PdoError::BadSchedule);
        }
        Ok(pulses.next_after(self.outputs_at).saturating_add(offset))
    }

    fn take_scheduled(
        &mut self,
        number: usize,
        frame: CanFrame,
        due_ns: u64,
    ) -> Result<(), ResultCode> {
        self.check_sendable(number, &frame)?;
        if due_ns <= self.now {
            self.counters.transmit_losses.late += 1;
            self.note_schedule_trouble(number, flag::SCHED_LATE_DROP);
            return Err(ResultCode::BusBusy);
        }
        let entry = Scheduled { due_ns, channel: number, frame };
        if !self.schedule.insert(entry) {
            self.counters.transmit_losses.schedule_full += 1;
            self.note_schedule_trouble(number, flag::SCHED_QUEUE_FULL);
            return Err(ResultCode::TxFifoFull);
        }
        self.counters.frames_scheduled += 1;
        Ok(())
    }

    fn note_schedule_trouble(&mut self, number: usize, flag: u16) {
        self.maintenance.flags |= flag;
        if let Some(channel) = self.channels.get_mut(number) {
            channel.last_error = path_error::SCHEDULE;
        }
        self.profile_mut(Direction::RxPdo).note_overflow(1, None);
    }

    /// When the next scheduled frame is to go out.
    pub(super) fn release_time(&self) -> Option<u64> {
        self.schedule.next_due()
    }

    /// Hands the first due scheduled frame to its controller, past the TX ring.
    pub(super) fn release_scheduled(&mut self) {
        let Some(due) = self.schedule.pop_due(self.now) else {
            return;
        };
        self.performance.scheduled_released(self.now);
        if self.bypasses_rx(RxBypass::MCAN_WRITE) {
            self.counters.transmit_losses.bypassed += 1;
            return;
        }
        let Self { channels, counters, .. } = self;
        let Some(channel) = channels.get_mut(due.channel) else {
            return;
        };
        match channel.controller.submit(due.frame) {
            Ok(()) => {
                counters.frames_to_controller += 1;
                counters.frames_released += 1;
            }
            Err(refusal) => {
                counters.transmit_losses.schedule_failed += 1;
                if refusal == Refusal::Full {
                    channel.transmit.note_fifo_full();
                    self.maintenance.flags |= flag::TX_FIFO_FULL;
                }
                self.note_schedule_trouble(due.channel, flag::SCHED_TX_FAIL);
                if let Some(channel) = self.channels.get_mut(due.channel) {
                    channel.note_refusal(refusal);
                }
            }
        }
    }

    // Inputs

    /// Builds a TxPDO and hands it to SM3, which must be empty.
    pub(super) fn publish_inputs(&mut self) {
        if self.test.tx_bypass.0 & TxBypass::COPY.0 != 0 {
            return;
        }
        let length = self.inputs.length().unwrap_or(0);
        if length != self.profile(Direction::TxPdo).active_bytes() {
            self.profile_mut(Direction::TxPdo).note_error(PdoError::ActiveArea);
            return;
        }
        let empty = self.is_app_bypassed(Direction::TxPdo)
            || self.test.tx_bypass.0 & TxBypass::BUILD.0 != 0;
        let status = self.channel_status();
        let Some((sequence, shortfall)) = self.builder.build(
            &mut self.channels,
            &mut self.results,
            status,
            self.last_service,
            empty,
            &mut self.counters,
        ) else {
            return;
        };
        let control = self.profile_mut(Direction::TxPdo);
        control.sequence = sequence;
        control.note_overflow(shortfall.dropped, None);
        control.note_overflow(shortfall.unpacked, Some(PdoError::PacketOverrun));
        control.note_overflow(shortfall.oversized, Some(PdoError::FrameOverrun));
        if self.faults.torn_images > 0 {
            self.faults.torn_images -= 1;
            self.builder.tear();
        }
        if self.faults.crc_errors > 0 {
            self.faults.crc_errors -= 1;
            self.builder.corrupt_crc();
        }
        let published = self.builder.published();
        self.inputs.store(published);
        self.performance.inputs_published(published.len());
        self.inputs.release();
        self.counters.images_published += 1;
    }

    /// Status words of all channels.
    pub(super) fn channel_status(&self) -> [ecan_protocol::image::ChannelStatus; CHANNELS] {
        let mut status = [ecan_protocol::image::ChannelStatus::default(); CHANNELS];
        for (number, (word, channel)) in status.iter_mut().zip(&self.channels).enumerate() {
            *word = channel.status(self.schedule.waiting(number));
        }
        status
    }

    /// Clears runtime diagnostics: those of the channels, of 0x9011 and the session errors.
    pub(super) fn clear_diagnostics(&mut self) {
        for channel in &mut self.channels {
            channel.clear_diagnostics();
        }
        self.clear_performance();
    }

    /// The clear command of 0x9011, which also concerns the channels' service times.
    pub(super) fn clear_performance(&mut self) {
        for channel in &mut self.channels {
            channel.clear_service_times();
        }
        self.performance.clear(self.now, self.pulses);
    }
}
