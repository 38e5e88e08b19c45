//! Effects of a finished transmission on the stations.

use ecan_protocol::can::Phase;

use super::{Broadcast, BusEvent, CanBus, Transmission, TransmissionResult};
use crate::bus::station::{BusError, DetectedError, ErrorState, Mismatch, StationId, StationMode};
use crate::bus::timing::INTERMISSION_BITS;

/// Suspend transmission time of an error-passive sender after the intermission.
const SUSPEND_BITS: u32 = 8;
/// Recessive bits at the end of a frame (ACK delimiter, EOF) and of an error frame (delimiter).
const QUIET_END_BITS: u32 = 8;
/// A receiver that signals an error first detects the flags of the others after its own.
const FIRST_TO_SIGNAL: u16 = 8;

impl CanBus {
    /// Completes the transmission: counters, events; the bus is free after the intermission.
    pub(super) fn complete(&mut self, t: &Transmission, events: &mut Vec<BusEvent>) {
        if self.is_broadcast(t) {
            return self.complete_with_all(t, events);
        }
        self.undisturbed = None;
        self.count(t);

        // The ACK error of an error-passive sender is invisible: listeners receive the frame.
        // A late acknowledgement is dominant during its error flag, which counts.
        let is_passive = self.stations.get(t.transmitter).is_some_and(|s| s.counters.is_passive());
        let silent_no_ack = t.result == TransmissionResult::NoAck && is_passive;
        let silent_late_ack = t.result == TransmissionResult::LateAck && is_passive;
        let good = t.result == TransmissionResult::Delivered;
        let mut states_changed = self.complete_sender(t, good, silent_no_ack, events);
        let received = good || silent_no_ack || silent_late_ack;
        states_changed |= self.complete_receivers(t, received, events);
        if t.contested {
            self.complete_losers(t, |event| events.push(event));
        }
        if self.has_local_activity {
            let quiet = t.end.saturating_sub(t.config.bits_ns(QUIET_END_BITS));
            for recovery in self.stations.iter_mut().filter_map(|s| s.recovery.as_mut()) {
                recovery.interrupted(t.start, quiet);
            }
        }
        if states_changed {
            self.report_states(events);
        }
    }

    /// Returns whether all others receive the frame while no station has errors.
    pub(super) fn is_broadcast(&self, t: &Transmission) -> bool {
        t.result == TransmissionResult::Delivered && self.is_received_by_all(t.start)
    }

    /// Occupies the bus, which is free after the intermission.
    fn count(&mut self, t: &Transmission) {
        let intermission = t.config.bits_ns(INTERMISSION_BITS);
        self.needs_plan = true;
        self.free_at = t.end + intermission;
        self.transmissions += 1;
        self.statistics.busy_ns += t.end - t.start + intermission;
        self.statistics.identifier_collisions += u64::from(t.collision);
    }

    /// Completes a frame that all others receive; all error counters stay 0.
    pub(super) fn complete_broadcast(
        &mut self,
        t: &Transmission,
        abandoned: impl FnMut(BusEvent),
    ) -> Broadcast {
        self.count(t);
        self.statistics.frames += 1;
        self.broadcasts += 1;
        if let Some(sender) = self.stations.get_mut(t.transmitter) {
            sender.offer = None;
            sender.statistics.transmitted += 1;
            sender.broadcasts_missed += 1;
        }
        self.offering.remove(t.transmitter);
        if t.contested {
            self.complete_losers(t, abandoned);
        }
        let sender = StationId(t.transmitter);
        Broadcast { sender, frame: t.frame, start_ns: t.start, at_ns: t.end }
    }

    /// As [`complete_broadcast`](Self::complete_broadcast), with the events of all stations.
    fn complete_with_all(&mut self, t: &Transmission, events: &mut Vec<BusEvent>) {
        let Transmission { frame, start: start_ns, end: at_ns, .. } = *t;
        events.push(BusEvent::Transmitted {
            station: StationId(t.transmitter),
            frame,
            start_ns,
            at_ns,
        });
        for (index, station) in self.stations.iter().enumerate() {
            if index != t.transmitter && station.config.is_some() {
                let station = StationId(index);
                events.push(BusEvent::Received { station, frame, start_ns, at_ns });
            }
        }
        self.complete_broadcast(t, |event| events.push(event));
    }

    /// Returns whether the sender's error state changed.
    fn complete_sender(
        &mut self,
        t: &Transmission,
        good: bool,
        silent_no_ack: bool,
        events: &mut Vec<BusEvent>,
    ) -> bool {
        let transmitter = StationId(t.transmitter);
        if good {
            self.statistics.frames += 1;
        } else {
            self.statistics.error_frames += 1;
            events.push(BusEvent::ErrorFrame { transmitter, at_ns: t.end });
        }
        let free_at = self.free_at;
        let Some(station) = self.stations.get_mut(t.transmitter) else {
            return false;
        };
        if t.result == TransmissionResult::SenderRemoved {
            // The station was reset or is bus-off already.
            return false;
        }
        if good {
            station.counters.sent();
            station.statistics.transmitted += 1;
            station.offer = None;
            let (frame, start_ns, at_ns) = (t.frame, t.start, t.end);
            events.push(BusEvent::Transmitted { station: transmitter, frame, start_ns, at_ns });
            if t.config.mode == StationMode::ExternalLoopback {
                station.statistics.received += 1;
                events.push(BusEvent::Received { station: transmitter, frame, start_ns, at_ns });
            }
        } else {
            let error = match t.result {
                TransmissionResult::NoAck | TransmissionResult::LateAck => BusError::Ack,
                TransmissionResult::EchoMissed => BusError::Bit0,
                _ => BusError::Bit1,
            };
            station.last_error = Some(DetectedError { error, phase: t.phase });
            station.statistics.transmit_errors += 1;
            if t.result == TransmissionResult::Disturbed {
                station.injected_errors = station.injected_errors.saturating_sub(1);
            }
            if !silent_no_ack {
                station.counters.send_failed();
                station.statistics.counted_errors += 1;
            }
            let once = !t.config.auto_retransmit;
            if let Some(offer) = station.offer.filter(|o| once || o.withdrawn) {
                station.offer = None;
                if !offer.withdrawn {
                    let (station, frame) = (transmitter, offer.frame);
                    events.push(BusEvent::Abandoned { station, frame, at_ns: t.end });
                }
            }
        }
        if station.counters.is_passive() {
            station.suspended_until = free_at + t.config.bits_ns(SUSPEND_BITS);
        }
        station.has_new_state()
    }

    /// Returns whether a receiver's error state changed.
    fn complete_receivers(
        &mut self,
        t: &Transmission,
        good: bool,
        events: &mut Vec<BusEvent>,
    ) -> bool {
        let sampling = self.sampling_of(t);
        let mut states_changed = false;
        for (index, station) in self.stations.iter_mut().enumerate() {
            if index == t.transmitter {
                continue;
            }
            let Some(config) = station.listening(t.start) else {
                continue;
            };
            let counts = config.mode == StationMode::Normal;
            let readable = t.read_by(sampling.as_ref(), index, station, config);
            if good && readable.is_ok() {
                if counts {
                    station.counters.received();
                    states_changed |= station.has_new_state();
                }
                station.statistics.received += 1;
                let (station, frame) = (StationId(index), t.frame);
                events.push(BusEvent::Received { station, frame, start_ns: t.start, at_ns: t.end });
                continue;
            }
            station.statistics.receive_errors += 1;
            station.last_error = Some(match readable {
                Err(Mismatch::FdFormat) => DetectedError::nominal(BusError::Form),
                // it takes the data phase for bits at the nominal bit rate
                Err(Mismatch::NominalBitrate | Mismatch::SwitchLate) => {
                    DetectedError::nominal(BusError::Stuff)
                }
                Err(Mismatch::DataBitrate | Mismatch::SwitchEarly) => {
                    DetectedError { error: BusError::Stuff, phase: Phase::Data }
                }
                Ok(()) => DetectedError { error: BusError::Stuff, phase: t.phase },
            });
            if counts {
                let first = t.result == TransmissionResult::Destroyed
                    && readable.is_err()
                    && !station.counters.is_passive();
                station.statistics.counted_errors += 1;
                station.counters.receive_failed(if first { 1 + FIRST_TO_SIGNAL } else { 1 });
                states_changed |= station.has_new_state();
            }
        }
        states_changed
    }

    /// Handles stations that lost arbitration at the same start.
    fn complete_losers(&mut self, t: &Transmission, mut abandoned: impl FnMut(BusEvent)) {
        for index in self.offering.iter().filter(|index| *index != t.transmitter) {
            let Some(station) = self.stations.get_mut(index) else { continue };
            let Some((ready, offer, config)) = station.ready_at() else {
                continue;
            };
            if ready > t.start || offer.key == t.key {
                continue;
            }
            let (frame, repeats) = (offer.frame, config.auto_retransmit);
            station.statistics.arbitrations_lost += 1;
            if !repeats {
                station.offer = None;
                abandoned(BusEvent::Abandoned { station: StationId(index), frame, at_ns: t.end });
            }
        }
    }

    /// Reports every changed error state.
    pub(super) fn report_states(&mut self, events: &mut Vec<BusEvent>) {
        self.report_due = false;
        for (index, station) in self.stations.iter_mut().enumerate() {
            let state = station.counters.state();
            if state == station.reported {
                continue;
            }
            station.reported = state;
            if state == ErrorState::BusOff {
                station.statistics.bus_offs += 1;
            }
            let station = StationId(index);
            events.push(BusEvent::StateChanged { station, state, at_ns: self.now });
        }
    }
}
