//! Selection of the next frame and prediction of its result.

use ecan_protocol::can::Phase;

use super::{CanBus, Sampling, Transmission, TransmissionResult, Undisturbed, mismatch_ns};
use crate::bus::station::{ErrorCounters, ErrorState, Station, StationConfig, StationMode};
use crate::bus::timing::{BitRates, Draw, FrameTiming};
use crate::event_queue::earliest;

/// Bits until a disturbed frame fails: in the control field of a standard frame.
const DISTURBED_AFTER_BITS: u32 = 20;
/// Data bits until a sender that samples too early detects a bit error: ESI, the first bit after the switch.
const ECHO_ERROR_AFTER_BITS: u32 = 1;
/// An error flag, the error flags of others in response, and the error delimiter.
const ERROR_FRAME_BITS: u32 = 6 + 6 + 8;
/// A missing acknowledgement: six bits of flag and eight of delimiter after the ACK slot, where a
/// good frame has eight bits left.
const NO_ACK_EXTRA_BITS: u32 = 6;

impl CanBus {
    /// Plans the next transmission, unless one is in progress, and finds the next end.
    pub(crate) fn replan(&mut self) {
        if self.needs_plan && self.current.as_ref().is_none_or(|t| t.start >= self.now) {
            if self.undisturbed.is_none() {
                self.undisturbed = self.survey();
            }
            self.needs_plan = false;
            self.current = self.plan();
        }
        let mut next = self.current.as_ref().map(|t| t.end);
        if self.has_local_activity {
            self.has_local_activity = false;
            for station in &self.stations {
                self.has_local_activity |= station.local.is_some() || station.recovery.is_some();
                let local = station.local.as_ref().map(|local| local.end);
                next = earliest([next, local, self.recovery_end(station)]);
            }
        }
        self.next_end = next;
    }

    fn survey(&self) -> Option<Undisturbed> {
        let mut from = 0;
        let mut first: Option<&StationConfig> = None;
        let mut has_receivers = false;
        let mut repeats = true;
        for station in &self.stations {
            let Some(config) = &station.config else { continue };
            let is_equal = first.is_none_or(|first| {
                (first.nominal_bitrate, first.data_bitrate, first.fd, first.non_iso)
                    == (config.nominal_bitrate, config.data_bitrate, config.fd, config.non_iso)
            });
            let is_sound = config.mode == StationMode::Normal
                && station.counters == ErrorCounters::default()
                && station.reported == ErrorState::Active
                && station.injected_errors == 0;
            if !is_equal || !is_sound {
                return None;
            }
            has_receivers |= first.is_some();
            repeats &= config.auto_retransmit;
            first = Some(config);
            from = from.max(station.active_from);
        }
        (!self.has_sampling).then_some(Undisturbed { from, has_receivers, repeats })
    }

    /// Returns whether all stations receive a frame that starts then, and acknowledge it.
    pub(super) fn is_received_by_all(&self, start: u64) -> bool {
        self.undisturbed
            .is_some_and(|undisturbed| undisturbed.has_receivers && start >= undisturbed.from)
    }

    fn plan(&self) -> Option<Transmission> {
        let mut start = u64::MAX;
        let mut winner = None;
        let mut collision = false;
        let mut contested = false;
        for index in self.offering.iter() {
            let Some((ready, offer, config)) = self.stations.get(index).and_then(Station::ready_at)
            else {
                continue;
            };
            let ready = ready.max(self.free_at);
            let best = winner.map(|(_, best, _)| best);
            contested = ready == start || contested && ready > start;
            if ready < start || ready == start && best.is_none_or(|best| offer.key < best) {
                start = ready;
                collision = false;
                winner = Some((index, offer.key, (offer, config)));
            } else if ready == start && best == Some(offer.key) {
                collision = true;
            }
        }
        let (transmitter, key, (offer, config)) = winner?;
        let station = self.stations.get(transmitter)?;
        let (mut frame, mut timing) = (offer.frame, offer.timing);
        if station.counters.is_passive() {
            frame = config.on_wire(frame, true);
            timing = FrameTiming::of(&frame);
        }
        let mut planned = Transmission {
            transmitter,
            config: *config,
            frame,
            timing,
            key,
            start,
            end: start,
            result: TransmissionResult::Delivered,
            phase: Phase::Nominal,
            collision,
            contested,
        };
        self.predict(&mut planned);
        Some(planned)
    }

    /// Sets result and end from the present state of the stations.
    fn predict(&self, t: &mut Transmission) {
        if self.is_received_by_all(t.start) {
            t.end = t.start + t.config.duration_ns(&t.timing);
            return;
        }
        let mut acknowledged = t.config.mode == StationMode::ExternalLoopback;
        let sampling = self.sampling_of(t);
        let mut is_late = false;
        let mut destroyed: Option<(u64, Phase)> = None;
        for (index, station) in self.stations.iter().enumerate() {
            if index == t.transmitter {
                continue;
            }
            let Some(config) = station.listening(t.start) else {
                continue;
            };
            if config.mode != StationMode::Normal {
                continue;
            }
            let sampling = sampling.as_ref();
            match t.read_by(sampling, index, station, config) {
                Ok(())
                    if sampling
                        .is_some_and(|sampling| sampling.acknowledges_late(index, station)) =>
                {
                    is_late = true;
                }
                Ok(()) => acknowledged = true,
                Err(mismatch) if !station.counters.is_passive() => {
                    let (after, phase) = (mismatch_ns(mismatch, t), t.phase_of(mismatch));
                    if destroyed.is_none_or(|(earliest, _)| after < earliest) {
                        destroyed = Some((after, phase));
                    }
                }
                Err(_) => {}
            }
        }
        let disturbed = self.stations.get(t.transmitter).is_some_and(|s| s.injected_errors > 0);
        let whole = t.config.duration_ns(&t.timing);
        let error_frame = t.config.bits_ns(ERROR_FRAME_BITS);
        let (result, phase, length) = if disturbed {
            let bits = DISTURBED_AFTER_BITS + ERROR_FRAME_BITS;
            (TransmissionResult::Disturbed, Phase::Nominal, t.config.bits_ns(bits))
        } else if sampling.is_some_and(|sampling| sampling.misses_echo(t)) {
            let after = t.after_switch_ns(ECHO_ERROR_AFTER_BITS);
            (TransmissionResult::EchoMissed, Phase::Data, after + error_frame)
        } else if let Some((after, phase)) = destroyed {
            (TransmissionResult::Destroyed, phase, after + error_frame)
        } else if acknowledged {
            (TransmissionResult::Delivered, Phase::Nominal, whole)
        } else {
            let result =
                if is_late { TransmissionResult::LateAck } else { TransmissionResult::NoAck };
            (result, Phase::Nominal, whole + t.config.bits_ns(NO_ACK_EXTRA_BITS))
        };
        t.result = result;
        t.phase = phase;
        t.end = t.start + length;
    }

    /// Handles a station that leaves the bus at `now`, during a transmission.
    pub(super) fn handle_station_removal(&mut self, index: usize) {
        let now = self.now;
        let Some(mut t) = self.current.filter(|t| t.start < now) else {
            return;
        };
        if index == t.transmitter {
            t.result = TransmissionResult::SenderRemoved;
            t.end = t.end.min(now + t.config.bits_ns(ERROR_FRAME_BITS));
        } else if t.result == TransmissionResult::Delivered {
            // Its acknowledgement may be missing now, unless the ACK slot has passed.
            let before_delimiter = t.end.saturating_sub(t.config.bits_ns(8));
            if now < before_delimiter {
                self.predict(&mut t);
                if !matches!(t.result, TransmissionResult::Delivered | TransmissionResult::NoAck) {
                    return;
                }
            }
        }
        self.current = Some(t);
    }
}

impl CanBus {
    /// `None` if no two stations have sample points.
    #[inline]
    pub(super) fn sampling_of(&self, t: &Transmission) -> Option<Sampling> {
        if self.has_sampling { self.sampling_of_sender(t) } else { None }
    }

    #[cold]
    fn sampling_of_sender(&self, t: &Transmission) -> Option<Sampling> {
        Some(Sampling {
            sender: self.stations.get(t.transmitter)?.physical_layer?,
            rates: BitRates { nominal: t.config.nominal_bitrate, data: t.config.data_bitrate },
            has_switch: t.timing.data_bits != 0,
            draw: Draw(self.seed ^ self.transmissions),
        })
    }
}
