//! Frames of remote clients that have no result yet.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ecan_service_client::{
    FrameEvent, FrameReport, RejectReason, RpcError, SendError, Tag, TransmitRecord,
};

/// Takes the reports of all frames of a job, in their order and with the tags of the remote client.
pub(crate) type Reply = Box<dyn FnOnce(Result<Vec<FrameReport>, RpcError>) + Send>;

/// Jobs whose frames were sent, until each frame has its result.
///
/// One thread sends, another one takes the results: neither waits for the other while it writes or
/// reads.
#[derive(Debug, Default)]
pub(crate) struct TransmitJobs {
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    next_job: u64,
    jobs: HashMap<u64, Job>,
    /// Job and index of a frame, by the tag of the client.
    open: HashMap<Tag, (u64, usize)>,
    /// Results that came before the sender knew the tag.
    early: HashMap<Tag, FrameReport>,
    /// Reason for which no more results come.
    end: Option<RpcError>,
}

struct Job {
    records: Vec<TransmitRecord>,
    reports: Vec<Option<FrameReport>>,
    missing: usize,
    reply: Reply,
}

impl fmt::Debug for Job {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Job").field("records", &self.records).finish_non_exhaustive()
    }
}

impl TransmitJobs {
    /// Sends the frames of a job with `send`. The reply follows with the last result.
    pub(crate) fn send(
        &self,
        mut send: impl FnMut(&TransmitRecord) -> Result<Tag, SendError>,
        records: Vec<TransmitRecord>,
        reply: Reply,
    ) {
        if records.is_empty() {
            return reply(Ok(Vec::new()));
        }
        let id = {
            let mut state = self.state();
            if let Some(end) = state.end.clone() {
                drop(state);
                return reply(Err(end));
            }
            state.next_job += 1;
            let (id, missing) = (state.next_job, records.len());
            let reports = vec![None; missing];
            state.jobs.insert(id, Job { records: records.clone(), reports, missing, reply });
            id
        };
        for (index, record) in records.iter().enumerate() {
            let sent = send(record);
            finish(self.state().take_sent((id, index), record, sent));
        }
    }

    /// Takes the result of a frame.
    pub(crate) fn take_result(&self, report: FrameReport) {
        finish(self.state().take_result(report));
    }

    /// Fails all jobs, also future ones: no more results come.
    pub(crate) fn end(&self, error: &RpcError) {
        let mut state = self.state();
        state.end = Some(error.clone());
        let jobs = std::mem::take(&mut state.jobs);
        drop(state);
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

/// Each method returns the job that has all its results.
impl State {
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
        place: (u64, usize),
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
        let TransmitRecord { gateway, channel, tag, frame, .. } = *record;
        let event = FrameEvent::Rejected(reason);
        self.report(place, FrameReport { time_ns: 0, gateway, channel, tag, event, frame })
    }

    fn report(&mut self, (id, index): (u64, usize), report: FrameReport) -> Option<Job> {
        let job = self.jobs.get_mut(&id)?;
        let tag = job.records.get(index)?.tag;
        *job.reports.get_mut(index)? = Some(FrameReport { tag, ..report });
        job.missing -= 1;
        if job.missing == 0 { self.jobs.remove(&id) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, TryRecvError, channel};

    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_service_client::{ClientError, NOT_AVAILABLE};

    use super::*;

    type Outcome = Result<Vec<(Tag, FrameEvent)>, i32>;

    fn reply() -> (Reply, Receiver<Outcome>) {
        let (sender, receiver) = channel();
        let reply: Reply = Box::new(move |result| {
            let events = |it: Vec<FrameReport>| it.iter().map(|it| (it.tag, it.event)).collect();
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

    fn result(tag: Tag) -> FrameReport {
        let TransmitRecord { gateway, channel, frame, .. } = records(&[tag])[0];
        let event = FrameEvent::Transmitted;
        FrameReport { time_ns: 5, gateway, channel, tag, event, frame }
    }

    #[test]
    fn reply_has_all_results_in_the_order_of_the_frames() {
        let jobs = TransmitJobs::default();
        let (reply, replies) = reply();
        let mut tags = [100, 101, 102].into_iter();
        jobs.send(
            |_| {
                let tag = tags.next().unwrap();
                if tag == 100 {
                    jobs.take_result(result(100));
                }
                Ok(tag)
            },
            records(&[7, 7, 9]),
            reply,
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
        let jobs = TransmitJobs::default();
        let (reply, replies) = reply();
        let mut errors = [
            SendError::WindowFull { gateway: 0, channel: 2, window: 1 },
            SendError::ReadOnly { reason: String::new() },
            SendError::Client(ClientError::Closed),
        ]
        .into_iter();
        jobs.send(|_| Err(errors.next().unwrap()), records(&[1, 2, 3]), reply);
        let rejected = FrameEvent::Rejected;
        let expected = vec![
            (1, rejected(RejectReason::Window)),
            (2, rejected(RejectReason::ReadOnly)),
            (3, rejected(RejectReason::Closed)),
        ];
        assert_eq!(replies.recv(), Ok(Ok(expected)));
    }

    #[test]
    fn end_fails_open_and_later_jobs() {
        let jobs = TransmitJobs::default();
        let (first, first_replies) = reply();
        jobs.send(|_| Ok(1), records(&[1]), first);
        jobs.end(&RpcError::new(NOT_AVAILABLE, "ended"));
        let (second, second_replies) = reply();
        jobs.send(|_| panic!("not sent"), records(&[1]), second);
        for replies in [first_replies, second_replies] {
            assert_eq!(replies.recv(), Ok(Err(NOT_AVAILABLE)));
        }
        let (empty, replies) = reply();
        jobs.send(|_| panic!("nothing to send"), records(&[]), empty);
        assert_eq!(replies.recv(), Ok(Ok(vec![])));
    }
}
