//! The account of a channel's frames: what the Port reports, what the bus carried, what the application got.

use std::collections::BTreeMap;

use ecan_mcan_port::ChannelStatistics;
use ecan_protocol::can::CanFrame;
use ecan_service::client::FrameEvent;

use crate::frame_number::{FrameNumber, Kinds, Stream};
use crate::seen::Seen;

/// Frames that somebody received, by the channel in their number.
#[derive(Clone, Debug, Default)]
pub struct Received(BTreeMap<u8, [Seen; Stream::COUNT]>);

impl Received {
    /// Adds a frame, which comes once and in the order of its sender.
    pub fn insert(&mut self, frame: &FrameNumber) -> Result<(), String> {
        let FrameNumber { channel, stream, number } = *frame;
        let seen = &self.0.entry(channel).or_default()[stream as usize];
        if stream.is_ordered() && number < seen.next() && !seen.contains(number) {
            let last = seen.next() - 1;
            return Err(format!("{stream:?} frame {number} was received after {last}"));
        }
        self.insert_unordered(frame)
    }

    /// Adds a frame, which comes once.
    pub fn insert_unordered(&mut self, frame: &FrameNumber) -> Result<(), String> {
        let FrameNumber { channel, stream, number } = *frame;
        match self.0.entry(channel).or_default()[stream as usize].insert(number) {
            true => Ok(()),
            false => Err(format!("{stream:?} frame {number} was received twice")),
        }
    }

    pub fn count(&self) -> u64 {
        self.0.values().flatten().map(Seen::count).sum()
    }
}

/// Frames of clients of the service whose results are known.
#[derive(Debug, Default)]
struct ClientFrames {
    /// Accepted by the Port.
    accepted: u64,
    rejected: [Seen; Stream::COUNT],
}

/// Frames of one channel.
#[derive(Debug, Default)]
pub struct Account {
    /// Index in frame numbers.
    pub channel: u8,
    pub kinds: Kinds,
    /// Next number of each stream of the application and of its clients.
    next: [u32; Stream::COUNT],
    /// Sent by the gateway on the bus, by stream.
    on_bus: [Seen; Stream::COUNT],
    clients: ClientFrames,
    /// Frames of CANopen, which have no numbers, sent by the gateway.
    network_on_bus: u64,
    /// Frames on the bus that others sent, by the channel in their number: those of nodes, the answers to those of
    /// the host, and those of the other channels on the bus.
    of_others: BTreeMap<u8, [Seen; Stream::COUNT]>,
    received: Received,
    /// Columns of earlier Ports; those that were pending are unknown.
    ended: ChannelStatistics,
    now: ChannelStatistics,
}

impl Account {
    pub fn new(channel: u8, kinds: Kinds) -> Self {
        Self { channel, kinds, ..Self::default() }
    }

    /// The next frame of a stream, with its number.
    pub fn next_frame(&self, stream: Stream) -> (FrameNumber, CanFrame) {
        let number = self.next[stream as usize];
        let number = FrameNumber { channel: self.channel, stream, number };
        (number, number.frame(self.kinds))
    }

    /// The Port or the service has accepted the next frame.
    pub fn accepted(&mut self, stream: Stream) {
        self.next[stream as usize] += 1;
    }

    pub fn has_numbers(&self) -> bool {
        self.next.iter().all(|next| *next < FrameNumber::MAX)
    }

    /// The result of a frame of a client.
    pub fn result_of_client(
        &mut self,
        frame: &FrameNumber,
        event: FrameEvent,
    ) -> Result<(), String> {
        let FrameNumber { stream, number, .. } = *frame;
        match event {
            FrameEvent::Rejected(reason) => {
                if self.on_bus[stream as usize].contains(number) {
                    return Err(format!(
                        "{stream:?} frame {number} was sent and rejected: {reason}"
                    ));
                }
                self.clients.rejected[stream as usize].insert(number);
            }
            FrameEvent::Received => {
                return Err(format!("{stream:?} frame {number} was received as a result"));
            }
            // The service has ended: the Port may still accept it.
            FrameEvent::Unknown => {}
            _ => self.clients.accepted += 1,
        }
        Ok(())
    }

    /// A client got an event of another sender's frame. `received` and `results`: those that it got before.
    pub fn event_for_client(
        &self,
        frame: &CanFrame,
        event: FrameEvent,
        received: &mut Received,
        results: &mut Received,
    ) -> Result<(), String> {
        if self.is_of_network(frame) {
            return Ok(());
        }
        let number = self.number(frame)?;
        if event == FrameEvent::Received {
            self.check_of_other(&number)?;
            return received.insert(&number);
        }
        let FrameNumber { channel, stream, number: n } = number;
        let is_accepted = channel == self.channel && n < self.next[stream as usize];
        if !is_accepted || matches!(event, FrameEvent::Rejected(_)) {
            return Err(format!(
                "{stream:?} frame {n} was not accepted and has the event {event:?}"
            ));
        }
        results.insert_unordered(&number)
    }

    fn number(&self, frame: &CanFrame) -> Result<FrameNumber, String> {
        let number = FrameNumber::of(frame, self.kinds);
        number.ok_or_else(|| format!("a frame that nobody sent: {frame:?}"))
    }

    fn is_of_network(&self, frame: &CanFrame) -> bool {
        self.kinds.is_shared && !frame.id().is_extended()
    }

    /// The gateway has sent a frame on the bus.
    pub fn sent_on_bus(&mut self, frame: &CanFrame) -> Result<(), String> {
        if self.is_of_network(frame) {
            self.network_on_bus += 1;
            return Ok(());
        }
        let FrameNumber { channel, stream, number } = self.number(frame)?;
        if channel != self.channel {
            return Err(format!("the gateway sent a frame of another channel: {frame:?}"));
        }
        if number >= self.next[stream as usize] {
            return Err(format!("{stream:?} frame {number} was sent and not accepted"));
        }
        if self.clients.rejected[stream as usize].contains(number) {
            return Err(format!("{stream:?} frame {number} was rejected and sent"));
        }
        let seen = &mut self.on_bus[stream as usize];
        if seen.contains(number) {
            return Err(format!("{stream:?} frame {number} was sent twice"));
        }
        if stream.is_ordered() && number < seen.next() {
            return Err(format!("{stream:?} frame {number} was sent after {}", seen.next() - 1));
        }
        seen.insert(number);
        Ok(())
    }

    /// A node or another channel has sent a frame on the bus.
    pub fn sent_by_other(&mut self, frame: &CanFrame) -> Result<(), String> {
        if self.is_of_network(frame) {
            return Ok(());
        }
        let FrameNumber { channel, stream, number } = self.number(frame)?;
        self.of_others.entry(channel).or_default()[stream as usize].insert(number);
        Ok(())
    }

    /// The application got a frame.
    pub fn received(&mut self, frame: &CanFrame) -> Result<(), String> {
        if self.is_of_network(frame) {
            return Ok(());
        }
        let number = self.number(frame)?;
        self.check_of_other(&number)?;
        self.received.insert(&number)
    }

    /// A frame that is received was sent by a node or another channel.
    fn check_of_other(&self, frame: &FrameNumber) -> Result<(), String> {
        let FrameNumber { channel, stream, number } = *frame;
        match self.of_others.get(&channel) {
            Some(seen) if seen[stream as usize].contains(number) => Ok(()),
            _ => Err(format!("{stream:?} frame {number} was received and not sent")),
        }
    }

    /// The counters of the Port after a cycle.
    pub fn update(&mut self, now: ChannelStatistics) -> Result<(), String> {
        let before = std::mem::replace(&mut self.now, now);
        let columns = now.frames_delivered
            + now.frames_lost
            + now.frames_discarded
            + now.frames_unknown
            + now.frames_pending;
        if now.frames_accepted != columns {
            return Err(format!("accepted frames are not in one column each: {now:?}"));
        }
        let (got, known) =
            (self.received.count(), self.ended.frames_received + now.frames_received);
        // Axes take frames, too.
        if got != known && !self.kinds.is_shared {
            return Err(format!("the application got {got} frames, the Port counts {known}"));
        }
        let falls = [
            now.frames_delivered < before.frames_delivered,
            now.frames_lost < before.frames_lost,
            now.frames_discarded < before.frames_discarded,
            now.frames_unknown < before.frames_unknown,
            now.frames_received < before.frames_received,
        ];
        if falls.contains(&true) {
            return Err(format!("a counter falls: {now:?} after {before:?}"));
        }
        let (on_bus, taken) = (self.on_bus(), self.perhaps_taken());
        if on_bus > taken {
            return Err(format!("{on_bus} frames on the bus, of {taken} that it can be: {now:?}"));
        }
        let given = |streams: &[Stream]| -> u64 {
            streams.iter().map(|stream| u64::from(self.next[*stream as usize])).sum()
        };
        let of_application = given(&Stream::OF_APPLICATION);
        let clients = &self.clients;
        let rejected = clients.rejected.iter().map(Seen::count).sum::<u64>();
        let least = of_application + clients.accepted;
        let most = of_application + given(&Stream::OF_CLIENTS) - rejected;
        let known = self.accepted_so_far();
        if known < least || known > most && !self.kinds.is_shared {
            let text =
                if least == most { format!("{least}") } else { format!("{least} to {most}") };
            return Err(format!("{text} frames accepted, of which the Port knows {known}"));
        }
        Ok(())
    }

    /// The Port has ended, or its statistics start again.
    pub fn end_statistics(&mut self) {
        let now = std::mem::take(&mut self.now);
        let ended = &mut self.ended;
        ended.frames_accepted += now.frames_accepted;
        ended.frames_delivered += now.frames_delivered;
        ended.frames_lost += now.frames_lost;
        ended.frames_discarded += now.frames_discarded;
        ended.frames_unknown += now.frames_unknown + now.frames_pending;
        ended.frames_received += now.frames_received;
        ended.frames_not_taken += now.frames_not_taken;
    }

    /// Frames that the gateway has sent.
    pub fn on_bus(&self) -> u64 {
        self.network_on_bus + self.on_bus.iter().map(Seen::count).sum::<u64>()
    }

    pub fn accepted_so_far(&self) -> u64 {
        self.ended.frames_accepted + self.now.frames_accepted
    }

    pub fn delivered(&self) -> u64 {
        self.ended.frames_delivered + self.now.frames_delivered
    }

    pub fn pending(&self) -> u64 {
        self.now.frames_pending
    }

    /// Frames that the gateway has or may have taken.
    pub fn perhaps_taken(&self) -> u64 {
        let unknown = self.ended.frames_unknown + self.now.frames_unknown;
        self.delivered() + unknown + self.pending()
    }

    /// Frames that came in images.
    pub fn arrived(&self) -> u64 {
        let sum = |statistics: &ChannelStatistics| {
            statistics.frames_received + statistics.frames_not_taken
        };
        sum(&self.ended) + sum(&self.now)
    }

    pub fn taken_by_application(&self) -> u64 {
        self.received.count()
    }
}

#[cfg(test)]
mod tests {
    use ecan_service::client::RejectReason;

    use super::*;

    const FD: Kinds = Kinds { is_fd: true, is_shared: false };

    fn account() -> Account {
        let mut account = Account::new(5, FD);
        (0..10).for_each(|_| account.accepted(Stream::Immediate));
        account
    }

    fn frame(number: u32) -> CanFrame {
        FrameNumber { channel: 5, stream: Stream::Immediate, number }.frame(FD)
    }

    fn statistics(accepted: u64, delivered: u64) -> ChannelStatistics {
        ChannelStatistics {
            frames_accepted: accepted,
            frames_delivered: delivered,
            frames_discarded: accepted - delivered,
            ..ChannelStatistics::default()
        }
    }

    #[test]
    fn frames_in_order_are_no_finding() {
        let mut account = account();
        for number in [0, 1, 2, 5, 9] {
            account.sent_on_bus(&frame(number)).unwrap();
            account.sent_by_other(&frame(number)).unwrap();
        }
        [1, 2, 9].iter().for_each(|number| account.received(&frame(*number)).unwrap());
        account.update(ChannelStatistics { frames_received: 3, ..statistics(10, 5) }).unwrap();
    }

    #[test]
    fn each_violation_is_a_finding() {
        let text = |result: Result<(), String>| result.unwrap_err();
        let mut account = account();
        account.sent_on_bus(&frame(3)).unwrap();
        assert!(text(account.sent_on_bus(&frame(3))).contains("sent twice"));
        assert!(text(account.sent_on_bus(&frame(2))).contains("sent after 3"));
        assert!(text(account.sent_on_bus(&frame(10))).contains("not accepted"));
        assert!(text(account.received(&frame(3))).contains("received and not sent"));
        account.sent_by_other(&frame(3)).unwrap();
        account.sent_by_other(&frame(2)).unwrap();
        account.received(&frame(3)).unwrap();
        assert!(text(account.received(&frame(3))).contains("received twice"));
        assert!(text(account.received(&frame(2))).contains("received after 3"));
        assert!(
            text(account.update(statistics(10, 0))).contains("got 1 frames, the Port counts 0")
        );
        let received = ChannelStatistics { frames_received: 1, ..statistics(10, 0) };
        assert!(text(account.update(received)).contains("frames on the bus"));
    }

    #[test]
    fn frames_of_another_channel_are_received_in_order() {
        let text = |result: Result<(), String>| result.unwrap_err();
        let mut account = account();
        let other =
            |number| FrameNumber { channel: 6, stream: Stream::Immediate, number }.frame(FD);
        assert!(text(account.sent_on_bus(&other(1))).contains("another channel"));
        assert!(text(account.received(&other(1))).contains("received and not sent"));
        (1..4).for_each(|number| account.sent_by_other(&other(number)).unwrap());
        assert!(text(account.received(&frame(1))).contains("received and not sent"));
        account.received(&other(2)).unwrap();
        assert!(text(account.received(&other(1))).contains("received after 2"));
        assert!(text(account.received(&other(2))).contains("received twice"));
        assert_eq!(account.taken_by_application(), 1);
    }

    #[test]
    fn results_of_clients_are_checked() {
        let text = |result: Result<(), String>| result.unwrap_err();
        let stream = Stream::SecondClient;
        let number = |number| FrameNumber { channel: 5, stream, number };
        let mut account = account();
        (0..3).for_each(|_| account.accepted(stream));
        account.result_of_client(&number(0), FrameEvent::Published).unwrap();
        account.sent_on_bus(&number(0).frame(FD)).unwrap();
        let rejected = FrameEvent::Rejected(RejectReason::NotReady);
        account.result_of_client(&number(1), rejected).unwrap();
        assert!(text(account.sent_on_bus(&number(1).frame(FD))).contains("rejected and sent"));
        assert!(text(account.result_of_client(&number(0), rejected)).contains("sent and rejected"));
        // Ten of the application, one or two of the client.
        account.update(statistics(11, 11)).unwrap();
        account.update(statistics(12, 12)).unwrap();
        assert!(text(account.update(statistics(13, 13))).contains("11 to 12 frames accepted"));
    }

    #[test]
    fn events_for_clients_are_checked() {
        let text = |result: Result<(), String>| result.unwrap_err();
        let mut account = account();
        account.sent_by_other(&frame(3)).unwrap();
        let (mut received, mut results) = Default::default();
        let mut event = |number, event| {
            account.event_for_client(&frame(number), event, &mut received, &mut results)
        };
        event(3, FrameEvent::Received).unwrap();
        assert!(text(event(3, FrameEvent::Received)).contains("received twice"));
        assert!(text(event(4, FrameEvent::Received)).contains("received and not sent"));
        event(9, FrameEvent::Transmitted).unwrap();
        assert!(text(event(9, FrameEvent::Published)).contains("received twice"));
        assert!(text(event(10, FrameEvent::Published)).contains("not accepted"));
    }

    #[test]
    fn frames_of_the_network_are_counted() {
        let mut account = Account::new(5, Kinds { is_fd: false, is_shared: true });
        let sync = CanFrame::classic(ecan_protocol::can::CanId::standard(0x80).unwrap(), &[]);
        let sync = sync.unwrap();
        account.sent_on_bus(&sync).unwrap();
        account.received(&sync).unwrap();
        assert_eq!(account.on_bus(), 1);
        account.update(statistics(1, 1)).unwrap();
        account.sent_on_bus(&sync).unwrap();
        assert!(account.update(statistics(1, 1)).unwrap_err().contains("frames on the bus"));
    }

    #[test]
    fn columns_add_up() {
        let text = |statistics| account().update(statistics).unwrap_err();
        assert!(text(statistics(9, 9)).contains("Port knows 9"));
        let lost = ChannelStatistics { frames_discarded: 2, ..statistics(10, 9) };
        assert!(text(lost).contains("one column each"));
        let mut account = account();
        account.update(statistics(10, 6)).unwrap();
        assert!(account.update(statistics(10, 5)).unwrap_err().contains("a counter falls"));
    }
}
