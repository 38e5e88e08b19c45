//! Sending frames at their times, until they have left.

use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{ReceiveSource, Received, ReceivedFrame};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::Timestamp;

use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::frames::format::TimedFrame;
use crate::frames::printer::Printer;
use crate::frames::service::{Cycle, Service};
use crate::frames::summary::Summary;
use crate::frames::transmit_tracker::TransmitTracker;
use crate::output::Output;

/// How long frames may take to leave once the user wants to stop, in cycles' time: a computer that
/// pauses takes nothing away from them.
const FAREWELL_NS: u64 = 100_000_000;

/// A frame, and when it is due.
#[derive(Clone, Copy, Debug)]
pub struct Due {
    /// After the start, in nanoseconds.
    pub after_ns: u64,
    pub channel: u8,
    pub frame: CanFrame,
}

/// What is written meanwhile.
#[derive(Debug)]
pub enum Record {
    Nothing,
    /// The frames that go out.
    Sent(Printer),
    /// The frames that come.
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
            let (timestamp, source) = (Timestamp::None, ReceiveSource::default());
            let received = ReceivedFrame { slave: 0, channel, frame, timestamp, source };
            // The screen of what is sent shows no times.
            printer.put(TimedFrame { time_ns: 0, received }, service.is_real_time());
        }
    }

    fn received(&mut self, cycle: &Cycle, service: &Service) {
        let Self::Received(printer) = self else { return };
        for arrival in &cycle.arrivals {
            if let Received::Frame(received) = arrival.received {
                let time_ns = service.absolute_ns(arrival.time_ns);
                printer.put(TimedFrame { time_ns, received }, service.is_real_time());
            }
        }
    }

    /// Writes the last of it.
    pub fn finish(self, output: &Output) -> Result<(), Failure> {
        match self {
            Self::Nothing => Ok(()),
            Self::Sent(printer) | Self::Received(printer) => printer.finish(output),
        }
    }
}

/// Sends frames through one gateway.
#[derive(Debug)]
pub struct Sender<'a> {
    /// The channels that are watched.
    pub channels: Channels,
    /// For so long no frame may leave, in nanoseconds.
    pub timeout_ns: u64,
    pub interrupt: &'a Interrupt,
    pub record: Record,
}

impl Sender<'_> {
    /// Sends all, `total` if there is an end, tells how it went, and judges it.
    pub fn run(
        mut self,
        mut service: Service,
        frames: impl Iterator<Item = Result<Due, Failure>>,
        total: Option<u64>,
        output: &Output,
    ) -> Result<(), Failure> {
        let (departures, outcome) = self.send(&mut service, frames);
        let recorded = self.record.finish(output);
        let captured = service.finish();
        let wanted = total.filter(|_| !self.interrupt.is_set()).unwrap_or(departures.count());
        let summary = Summary::of(&departures, service.port(), wanted);
        let told = match recorded {
            Err(Failure::Output(_) | Failure::ReaderGone) => Ok(()),
            _ => summary.print(output),
        };
        outcome.and(recorded).and(captured).and(told)?;
        summary.judge(|words| departures.failure(&service, words, None))
    }

    /// Sends all and waits until they have left; also where that fails, it is known how far it came.
    pub fn send(
        &mut self,
        service: &mut Service,
        frames: impl Iterator<Item = Result<Due, Failure>>,
    ) -> (TransmitTracker, Result<(), Failure>) {
        let mut departures = TransmitTracker::new(self.channels, service);
        let outcome = self
            .hand_over(service, frames, &mut departures)
            .and_then(|()| self.settle(service, &mut departures));
        departures.close(service, self.interrupt, outcome.is_ok());
        (departures, outcome)
    }

    /// Puts all into images, each when it is due.
    fn hand_over(
        &mut self,
        service: &mut Service,
        mut frames: impl Iterator<Item = Result<Due, Failure>>,
        departures: &mut TransmitTracker,
    ) -> Result<(), Failure> {
        let start_ns = service.now_ns();
        let mut next = frames.next().transpose()?;
        while next.is_some() && !self.interrupt.is_set() && !self.record.is_over() {
            let cycle = service.begin();
            departures.look(&cycle, service.port());
            self.record.received(&cycle, service);
            let mut has_room = true;
            while let Some(due) = next.filter(|due| due.after_ns <= cycle.now_ns - start_ns)
                && has_room
            {
                match service.send(due.channel, &due.frame)? {
                    Some(ticket) => {
                        departures.taken(ticket, cycle.now_ns);
                        self.record.sent(due, service);
                        next = frames.next().transpose()?;
                    }
                    // It waits for the next cycle, and with it all behind it: their order holds.
                    None => has_room = false,
                }
            }
            // A long gap is no standstill.
            let is_stuck = !has_room && departures.standstill_ns(cycle.now_ns) >= self.timeout_ns;
            service.end(cycle)?;
            if is_stuck {
                break;
            }
        }
        Ok(())
    }

    /// Runs the cycle until everything has left, or nothing has for too long. Who has had enough
    /// waits only as long as frames that are on their way need.
    fn settle(
        &mut self,
        service: &mut Service,
        departures: &mut TransmitTracker,
    ) -> Result<(), Failure> {
        let cycle_ns = u64::from(service.port().adapter().config().cycle_ns());
        let mut farewell_ns = 0;
        while !departures.are_settled(service.port()) {
            let cycle = service.begin();
            departures.look(&cycle, service.port());
            self.record.received(&cycle, service);
            let now_ns = cycle.now_ns;
            service.end(cycle)?;
            if self.interrupt.is_set() {
                farewell_ns += cycle_ns;
                if farewell_ns > FAREWELL_NS {
                    break;
                }
            }
            if departures.standstill_ns(now_ns) >= self.timeout_ns {
                break;
            }
        }
        Ok(())
    }
}
