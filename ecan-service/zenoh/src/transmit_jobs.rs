//! Frames of remote clients: those that wait for their turn, and those that have no result yet.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ecan_service::client::{
    BUSY, FrameEvent, FrameReport, RejectReason, RpcError, SendError, Tag, TransmitRecord,
};

use crate::client_turns::{ClientTurns, TurnLimits};

/// Clients with frames that wait.
const MAX_CLIENTS: usize = 32;
/// Frames of one client that wait: at least those of the longest request.
const MAX_CLIENT_FRAMES: usize = 4096;
/// Frames of all clients that wait.
const MAX_FRAMES: usize = 4 * MAX_CLIENT_FRAMES;

/// Takes the reports of all frames of a job, in their order and with the tags of the remote client.
pub(crate) type Reply = Box<dyn FnOnce(Result<Vec<FrameReport>, RpcError>) + Send>;

/// Jobs with frames, until each frame has its result.
///
/// One thread sends the frames of the clients in turn, another one takes the results: neither waits
/// for the other while it writes or reads.
#[derive(Debug)]
pub(crate) struct TransmitJobs {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    next_job: u64,
    jobs: HashMap<u64, Job>,
    waiting: ClientTurns<WaitingFrame>,
    /// Sent frames by the tag of the sending connection.
    open: HashMap<Tag, Place>,
    /// Results that came before the sender knew the tag.
    early: HashMap<Tag, FrameReport>,
    /// Something may be ready to be sent since the last look.
    is_changed: bool,
    /// Reason for which no more results come.
    end: Option<RpcError>,
}

#[derive(Debug, Clone, Copy)]
struct WaitingFrame {
    place: Place,
    record: TransmitRecord,
    deadline_ns: u64,
}

/// A frame of a job.
#[derive(Debug, Clone, Copy)]
struct Place {
    job: u64,
    index: usize,
    /// Tag of the remote client.
    tag: Tag,
}

struct Job {
    client: String,
    reports: Vec<Option<FrameReport>>,
    missing: usize,
    reply: Reply,
}

impl fmt::Debug for Job {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Job").field("client", &self.client).finish_non_exhaustive()
    }
}

impl TransmitJobs {
    /// Creates the jobs of a connection with this window. A client has at most half of it in use, so
    /// that another one finds room.
    pub(crate) fn new(window: u32) -> Self {
        let running = usize::try_from(window / 2).unwrap_or(usize::MAX).max(1);
        let limits = TurnLimits {
            clients: MAX_CLIENTS,
            items: MAX_CLIENT_FRAMES,
            bytes: MAX_FRAMES * size_of::<TransmitRecord>(),
            running,
        };
        let state = State {
            next_job: 0,
            jobs: HashMap::new(),
            waiting: ClientTurns::new(limits),
            open: HashMap::new(),
            early: HashMap::new(),
            is_changed: false,
            end: None,
        };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Adds the frames of a client, which arrived now and have a deadline. The age limit of a frame
    /// makes its deadline earlier. The reply follows with the last result.
    pub(crate) fn add(
        &self,
        client: &str,
        records: &[TransmitRecord],
        (now_ns, deadline_ns): (u64, u64),
        reply: Reply,
    ) {
        if records.is_empty() {
            return reply(Ok(Vec::new()));
        }
        if let Err((error, reply)) = self.state().add(client, records, (now_ns, deadline_ns), reply)
        {
            return reply(Err(error));
        }
        self.changed.notify_all();
    }

    /// Waits until frames may be ready to be sent, for at most `timeout`.
    pub(crate) fn wait(&self, timeout: Duration) {
        let state =
            self.changed.wait_timeout_while(self.state(), timeout, |state| !state.is_changed);
        state.unwrap_or_else(PoisonError::into_inner).0.is_changed = false;
    }

    /// Sends the frames whose channel is open, one of each client in turn, and rejects those whose
    /// deadline has passed. `is_open` takes the gateway and the channel; `send` the frame and the
    /// time to its deadline. Returns the number of late frames.
    pub(crate) fn send_waiting(
        &self,
        now_ns: impl Fn() -> u64,
        is_open: impl Fn(u16, u8) -> bool,
        mut send: impl FnMut(&TransmitRecord, Duration) -> Result<Tag, SendError>,
    ) -> u64 {
        let mut late = 0;
        loop {
            let now = now_ns();
            let next = self.state().waiting.take(|frame| {
                frame.deadline_ns <= now || is_open(frame.record.gateway, frame.record.channel)
            });
            let Some((_, WaitingFrame { place, record, deadline_ns })) = next else { return late };
            let done = if deadline_ns <= now {
                late += 1;
                self.state().reject(place, &record, RejectReason::Expired)
            } else {
                let sent = send(&record, Duration::from_nanos(deadline_ns - now));
                self.state().take_sent(place, &record, sent)
            };
            finish(done);
        }
    }

    /// Takes the result of a frame.
    pub(crate) fn take_result(&self, report: FrameReport) {
        let job = {
            let mut state = self.state();
            state.is_changed = true;
            state.take_result(report)
        };
        self.changed.notify_all();
        finish(job);
    }

    /// Fails all jobs, also future ones: no more results come.
    pub(crate) fn end(&self, error: &RpcError) {
        let jobs = {
            let mut state = self.state();
            state.end = Some(error.clone());
            state.waiting.drain();
            std::mem::take(&mut state.jobs)
        };
        jobs.into_values().for_each(|job| (job.reply)(Err(error.clone())));
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Replies without the lock.
fn finish(job: Option<Job>) {
    if let Some(job) = job {
        (job.reply)(Ok(job.reports.into_iter().flatten().collect()));
    }
}

impl State {
    fn add(
        &mut self,
        client: &str,
        records: &[TransmitRecord],
        (now_ns, deadline_ns): (u64, u64),
        reply: Reply,
    ) -> Result<(), (RpcError, Reply)> {
        if let Some(end) = self.end.clone() {
            return Err((end, reply));
        }
        let job = self.next_job;
        let frames = records.iter().enumerate().map(|(index, record)| WaitingFrame {
            place: Place { job, index, tag: record.tag },
            record: *record,
            deadline_ns: match u64::from(record.max_age_ms) {
                0 => deadline_ns,
                age_ms => deadline_ns.min(now_ns.saturating_add(age_ms * 1_000_000)),
            },
        });
        if let Err(full) = self.waiting.push(client, frames, size_of::<TransmitRecord>()) {
            let text = format!("{full}; nothing was sent; retry after a reply");
            return Err((RpcError::new(BUSY, text), reply));
        }
        self.next_job += 1;
        let (client, missing) = (client.to_owned(), records.len());
        self.jobs.insert(job, Job { client, reports: vec![None; missing], missing, reply });
        self.is_changed = true;
        Ok(())
    }

    /// Returns the job if it has all its results, as all methods below.
    fn take_result(&mut self, report: FrameReport) -> Option<Job> {
        match self.open.remove(&report.tag) {
            Some(place) => self.report(place, report),
            None => {
                self.early.insert(report.tag, report);
                None
            }
        }
    }

    fn take_sent(
        &mut self,
        place: Place,
        record: &TransmitRecord,
        sent: Result<Tag, SendError>,
    ) -> Option<Job> {
        let reason = match sent {
            Ok(tag) => {
                self.open.insert(tag, place);
                let early = self.early.remove(&tag)?;
                return self.take_result(early);
            }
            Err(SendError::WindowFull { .. }) => RejectReason::Window,
            Err(SendError::ReadOnly { .. }) => RejectReason::ReadOnly,
            Err(_) => RejectReason::Closed,
        };
        self.reject(place, record, reason)
    }

    fn reject(
        &mut self,
        place: Place,
        record: &TransmitRecord,
        reason: RejectReason,
    ) -> Option<Job> {
        let TransmitRecord { gateway, channel, tag, frame, .. } = *record;
        let event = FrameEvent::Rejected(reason);
        self.report(place, FrameReport { time_ns: 0, gateway, channel, tag, event, frame })
    }

    fn report(&mut self, Place { job: id, index, tag }: Place, report: FrameReport) -> Option<Job> {
        let job = self.jobs.get_mut(&id)?;
        *job.reports.get_mut(index)? = Some(FrameReport { tag, ..report });
        job.missing -= 1;
        self.waiting.finish(&job.client);
        if job.missing == 0 { self.jobs.remove(&id) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::sync::mpsc::{Receiver, TryRecvError, channel};

    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_service::client::{ClientError, NOT_AVAILABLE};

    use super::*;

    type Outcome = Result<Vec<(Tag, FrameEvent)>, i32>;

    const NEVER: u64 = u64::MAX;

    fn reply() -> (Reply, Receiver<Outcome>) {
        let (sender, receiver) = channel();
        let reply: Reply = Box::new(move |result| {
            let events = |reports: Vec<FrameReport>| {
                reports.iter().map(|report| (report.tag, report.event)).collect()
            };
            sender.send(result.map(events).map_err(|error| error.code)).unwrap();
        });
        (reply, receiver)
    }

    fn records(tags: &[Tag]) -> Vec<TransmitRecord> {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        let record =
            |tag: &Tag| TransmitRecord { gateway: 0, channel: 2, tag: *tag, max_age_ms: 0, frame };
        tags.iter().map(record).collect()
    }

    fn add(jobs: &TransmitJobs, client: &str, tags: &[Tag], deadline_ns: u64) -> Receiver<Outcome> {
        let (reply, replies) = reply();
        jobs.add(client, &records(tags), (0, deadline_ns), reply);
        replies
    }

    fn result(tag: Tag) -> FrameReport {
        let TransmitRecord { gateway, channel, frame, .. } = records(&[tag])[0];
        let event = FrameEvent::Transmitted;
        FrameReport { time_ns: 5, gateway, channel, tag, event, frame }
    }

    /// Sends what is ready and returns the tags that remote clients gave.
    fn send_waiting(jobs: &TransmitJobs, now_ns: u64, first_tag: Tag) -> Vec<Tag> {
        let sent = RefCell::new(Vec::new());
        jobs.send_waiting(
            || now_ns,
            |_, _| true,
            |record, _| {
                sent.borrow_mut().push(record.tag);
                Ok(first_tag + sent.borrow().len() as Tag - 1)
            },
        );
        sent.into_inner()
    }

    #[test]
    fn reply_has_all_results_in_the_order_of_the_frames() {
        let jobs = TransmitJobs::new(64);
        let replies = add(&jobs, "a", &[7, 7, 9], NEVER);
        // Returns at once, because frames were added.
        jobs.wait(Duration::from_secs(30));
        let mut tags = [100, 101, 102].into_iter();
        jobs.send_waiting(
            || 0,
            |_, _| true,
            |_, _| {
                let tag = tags.next().unwrap();
                if tag == 100 {
                    jobs.take_result(result(100));
                }
                Ok(tag)
            },
        );
        jobs.take_result(result(102));
        assert_eq!(replies.try_recv(), Err(TryRecvError::Empty));
        jobs.take_result(result(101));
        let sent = FrameEvent::Transmitted;
        assert_eq!(replies.recv(), Ok(Ok(vec![(7, sent), (7, sent), (9, sent)])));
        let state = jobs.state();
        assert!(state.jobs.is_empty() && state.open.is_empty() && state.early.is_empty());
    }

    #[test]
    fn frames_that_are_not_sent_are_rejected_with_the_reason() {
        let jobs = TransmitJobs::new(64);
        let replies = add(&jobs, "a", &[1, 2, 3], NEVER);
        let mut errors = [
            SendError::WindowFull { gateway: 0, channel: 2, window: 1 },
            SendError::ReadOnly { reason: String::new() },
            SendError::Client(ClientError::Closed),
        ]
        .into_iter();
        jobs.send_waiting(|| 0, |_, _| true, |_, _| Err(errors.next().unwrap()));
        let rejected = FrameEvent::Rejected;
        let expected = vec![
            (1, rejected(RejectReason::Window)),
            (2, rejected(RejectReason::ReadOnly)),
            (3, rejected(RejectReason::Closed)),
        ];
        assert_eq!(replies.recv(), Ok(Ok(expected)));
    }

    #[test]
    fn flooding_client_delays_no_other_one() {
        let jobs = TransmitJobs::new(8);
        let flood: Vec<_> = (1..=100).collect();
        let _flood = add(&jobs, "flooder", &flood, NEVER);
        assert_eq!(send_waiting(&jobs, 0, 1000), [1, 2, 3, 4], "half of the window");
        let probe = add(&jobs, "probe", &[200], NEVER);
        assert_eq!(send_waiting(&jobs, 0, 2000), [200]);
        jobs.take_result(result(2000));
        assert_eq!(probe.recv(), Ok(Ok(vec![(200, FrameEvent::Transmitted)])));
        let (reply, replies) = reply();
        jobs.add("flooder", &records(&[1; MAX_CLIENT_FRAMES]), (0, NEVER), reply);
        assert_eq!(replies.recv(), Ok(Err(BUSY)), "all of the request, or none");
        jobs.take_result(result(1000));
        assert_eq!(send_waiting(&jobs, 0, 3000), [5]);
    }

    #[test]
    fn frames_wait_for_their_channel_until_the_deadline() {
        let jobs = TransmitJobs::new(64);
        let replies = add(&jobs, "a", &[1, 2], 50);
        let send = |now_ns, is_open| {
            let tags = RefCell::new(10..);
            let lives = RefCell::new(Vec::new());
            let late = jobs.send_waiting(
                || now_ns,
                |_, _| is_open && lives.borrow().is_empty(),
                |_, life| {
                    lives.borrow_mut().push(life.as_nanos());
                    Ok(tags.borrow_mut().next().unwrap())
                },
            );
            (late, lives.into_inner())
        };
        assert_eq!(send(10, false), (0, vec![]));
        assert_eq!(send(20, true), (0, vec![30]));
        assert_eq!(send(50, true), (1, vec![]), "late, though the channel is open");
        jobs.take_result(result(10));
        let expected =
            vec![(1, FrameEvent::Transmitted), (2, FrameEvent::Rejected(RejectReason::Expired))];
        assert_eq!(replies.recv(), Ok(Ok(expected)));
    }

    #[test]
    fn age_limit_of_a_frame_makes_its_deadline_earlier() {
        let jobs = TransmitJobs::new(64);
        let (reply, replies) = reply();
        let mut records = records(&[1, 2]);
        records[0].max_age_ms = 3;
        jobs.add("a", &records, (1_000_000, 9_000_000), reply);
        assert_eq!(send_waiting(&jobs, 4_000_000, 10), [2]);
        jobs.take_result(result(10));
        let expected =
            vec![(1, FrameEvent::Rejected(RejectReason::Expired)), (2, FrameEvent::Transmitted)];
        assert_eq!(replies.recv(), Ok(Ok(expected)));
    }

    #[test]
    fn end_fails_open_and_later_jobs() {
        let jobs = TransmitJobs::new(64);
        let first = add(&jobs, "a", &[1], NEVER);
        assert_eq!(send_waiting(&jobs, 0, 1), [1]);
        let waiting = add(&jobs, "a", &[1], NEVER);
        jobs.end(&RpcError::new(NOT_AVAILABLE, "ended"));
        let second = add(&jobs, "a", &[1], NEVER);
        for replies in [first, waiting, second] {
            assert_eq!(replies.recv(), Ok(Err(NOT_AVAILABLE)));
        }
        assert!(send_waiting(&jobs, 0, 1).is_empty());
        assert_eq!(add(&jobs, "a", &[], NEVER).recv(), Ok(Ok(vec![])));
    }
}
