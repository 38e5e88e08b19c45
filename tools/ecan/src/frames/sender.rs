use ecan_protocol::can::CanFrame;
use ecan_protocol::image::Timestamp;

use crate::context::{Failure, Output, Result};
use crate::frames::channels::Channels;
use crate::frames::format::TimedFrame;
use crate::frames::link::{BusFrame, Event};
use crate::frames::printer::Printer;
use crate::frames::service::{Cycle, Service};
use crate::frames::summary::Summary;
use crate::frames::transmit_tracker::TransmitTracker;

/// Time for pending frames after the user stops, in cycle time, so that pauses of the computer do
/// not count.
const GRACE_NS: u64 = 100_000_000;

#[derive(Clone, Copy, Debug)]
pub struct Due {
    /// Due time after the start, in nanoseconds.
    pub after_ns: u64,
    pub channel: u8,
    pub frame: CanFrame,
}

#[derive(Debug)]
pub enum Record {
    Nothing,
    Sent(Printer),
    Received(Printer),
}

impl Record {
    fn printer(&mut self) -> Option<&mut Printer> {
        match self {
            Self::Nothing => None,
            Self::Sent(printer) | Self::Received(printer) => Some(printer),
        }
    }

    fn is_over(&mut self) -> bool {
        self.printer().is_some_and(|printer| printer.is_over())
    }

    fn sent(&mut self, due: Due, service: &Service) {
        if let Self::Sent(printer) = self {
            let Due { channel, frame, .. } = due;
            let frame =
                BusFrame { gateway: 0, channel, frame, timestamp: Timestamp::None, is_sent: true };
            // Sent frames are printed without time stamps.
            printer.put(TimedFrame { time_ns: 0, frame }, service.is_real_time());
        }
    }

    fn received(&mut self, cycle: &Cycle, service: &Service) {
        let Self::Received(printer) = self else { return };
        for arrival in &cycle.arrivals {
            if let Event::Frame(frame) = arrival.event
                && !frame.is_sent
            {
                let time_ns = service.absolute_ns(arrival.time_ns);
                printer.put(TimedFrame { time_ns, frame }, service.is_real_time());
            }
        }
    }

    pub fn finish(self) -> Result {
        match self {
            Self::Nothing => Ok(()),
            Self::Sent(printer) | Self::Received(printer) => printer.finish(),
        }
    }
}

#[derive(Debug)]
pub struct Sender {
    /// Observed channels.
    pub channels: Channels,
    /// Time limit without progress, in nanoseconds of observed time.
    pub timeout_ns: u64,
    pub record: Record,
}

impl Sender {
    /// Sends all frames (`total`, if finite), prints the summary and checks it.
    pub fn run(
        mut self,
        mut service: Service,
        frames: impl Iterator<Item = Result<Due>>,
        total: Option<u64>,
        output: &Output,
    ) -> Result {
        let (tracker, outcome) = self.send(&mut service, frames);
        let recorded = self.record.finish();
        let captured = service.finish();
        let expected = total.filter(|_| !service.is_interrupted()).unwrap_or(tracker.count());
        let summary = Summary::of(&tracker, &service, expected);
        let printed = match recorded {
            Err(Failure::Output(_) | Failure::ReaderGone) => Ok(()),
            _ => summary.print(output),
        };
        outcome.and(recorded).and(captured).and(printed)?;
        summary.check(|message| tracker.failure(&service, message, None))
    }

    /// Sends all frames and waits for their transmission; returns the tracker also on errors.
    pub fn send(
        &mut self,
        service: &mut Service,
        frames: impl Iterator<Item = Result<Due>>,
    ) -> (TransmitTracker, Result) {
        let mut tracker = TransmitTracker::new(self.channels, service);
        let outcome = self
            .hand_over(service, frames, &mut tracker)
            .and_then(|()| self.settle(service, &mut tracker));
        tracker.close(service, outcome.is_ok());
        (tracker, outcome)
    }

    fn hand_over(
        &mut self,
        service: &mut Service,
        mut frames: impl Iterator<Item = Result<Due>>,
        tracker: &mut TransmitTracker,
    ) -> Result {
        let start_ns = service.now_ns();
        let mut next = frames.next().transpose()?;
        while next.is_some() && !service.is_interrupted() && !self.record.is_over() {
            let cycle = service.begin();
            tracker.look(&cycle, service);
            self.record.received(&cycle, service);
            let mut has_space = true;
            while let Some(due) = next.filter(|due| due.after_ns <= cycle.now_ns - start_ns)
                && has_space
            {
                match service.send(0, due.channel, &due.frame)? {
                    Some(ticket) => {
                        tracker.taken(ticket, service);
                        self.record.sent(due, service);
                        next = frames.next().transpose()?;
                    }
                    // The frame and all after it wait for the next cycle, in order.
                    None => has_space = false,
                }
            }
            // A gap between due times is not a stall.
            let is_stuck = !has_space && tracker.stall_ns(service) >= self.timeout_ns;
            service.end(cycle)?;
            if is_stuck {
                break;
            }
        }
        Ok(())
    }

    /// Runs the cycle until all frames are sent or there is no progress; after a stop by the user,
    /// only for the pending frames.
    fn settle(&mut self, service: &mut Service, tracker: &mut TransmitTracker) -> Result {
        let cycle_ns = service.cycle_ns();
        let mut grace_ns = 0;
        while !tracker.are_settled(service) || !tracker.controllers_are_empty(service) {
            let cycle = service.begin();
            tracker.look(&cycle, service);
            self.record.received(&cycle, service);
            service.end(cycle)?;
            if service.is_interrupted() {
                grace_ns += cycle_ns;
                if grace_ns > GRACE_NS {
                    break;
                }
            }
            if tracker.stall_ns(service) >= self.timeout_ns {
                break;
            }
        }
        Ok(())
    }
}
