//! Requests that wait for a worker: limits, turns, and the end of their clients.
//!
//! A job belongs to a lane, whose workers execute nothing else: a request that needs no mailbox never waits
//! for an SDO transfer. In a lane the users take turns, and the clients of each user; a job of a slave waits
//! while another transfer of this slave is in progress, and no other job does.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Number of a client, from 1.
pub(crate) type ClientId = u64;

/// Kind of work, with workers of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lane {
    /// State of the bus that the master has: no mailbox.
    View,
    /// SDO transfers.
    Mailbox,
    /// Methods of the program.
    Extension,
}

impl Lane {
    pub(crate) const ALL: [Self; 3] = [Self::View, Self::Mailbox, Self::Extension];

    /// Workers of the lane, and those that one client and one user may occupy.
    pub(crate) const fn workers(self) -> (usize, usize, usize) {
        match self {
            Self::View => (1, 1, 1),
            Self::Mailbox => (4, 2, 3),
            Self::Extension => (2, 1, 2),
        }
    }
}

/// Amount of jobs that wait or are executed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Amount {
    pub(crate) jobs: usize,
    pub(crate) bytes: usize,
}

/// Limit of each client, of each user, and of all. A request has up to 1 MiB.
pub(crate) const CLIENT_LIMIT: Amount = Amount { jobs: 16, bytes: 2 << 20 };
pub(crate) const USER_LIMIT: Amount = Amount { jobs: 64, bytes: 4 << 20 };
pub(crate) const TOTAL_LIMIT: Amount = Amount { jobs: 256, bytes: 16 << 20 };

/// Client and user of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Requester {
    pub(crate) client: ClientId,
    /// User ID; `UNKNOWN_USER` if the system does not report it.
    pub(crate) user: u32,
}

/// Place of a job in the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct JobKey {
    pub(crate) requester: Requester,
    pub(crate) lane: Lane,
    /// Slave whose mailbox the job needs.
    pub(crate) slave: Option<u16>,
    pub(crate) bytes: usize,
}

/// Limit for which a job was rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum QueueLimit {
    Client,
    User,
    Total,
}

/// Jobs in the order in which they are executed.
#[derive(Debug)]
pub(crate) struct JobQueue<J> {
    state: Mutex<State<J>>,
    changed: Condvar,
}

#[derive(Debug)]
struct State<J> {
    is_closed: bool,
    clients: BTreeMap<ClientId, ClientJobs<J>>,
    users: BTreeMap<u32, Share>,
    total: Amount,
    busy_slaves: Vec<u16>,
    /// Number of the last job that was given to a worker.
    last_turn: u64,
}

#[derive(Debug)]
struct ClientJobs<J> {
    user: u32,
    share: Share,
    waiting: VecDeque<(JobKey, J)>,
}

/// Jobs of a client or a user.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    amount: Amount,
    running: [usize; Lane::ALL.len()],
    /// Turn of the last job of each lane.
    last_turn: [u64; Lane::ALL.len()],
}

impl Amount {
    fn exceeds(self, limit: Self) -> bool {
        self.jobs > limit.jobs || self.bytes > limit.bytes
    }

    const fn with(self, bytes: usize) -> Self {
        Self { jobs: self.jobs + 1, bytes: self.bytes + bytes }
    }

    const fn without(self, bytes: usize) -> Self {
        Self { jobs: self.jobs.saturating_sub(1), bytes: self.bytes.saturating_sub(bytes) }
    }
}

impl Share {
    /// A new share is last in each round.
    fn starting_at(turn: u64) -> Self {
        Self { last_turn: [turn; Lane::ALL.len()], ..Self::default() }
    }
}

impl<J> Default for JobQueue<J> {
    fn default() -> Self {
        let state = State {
            is_closed: false,
            clients: BTreeMap::new(),
            users: BTreeMap::new(),
            total: Amount::default(),
            busy_slaves: Vec::new(),
            last_turn: 0,
        };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }
}

impl<J> JobQueue<J> {
    /// Adds a job.
    pub(crate) fn push(&self, key: JobKey, job: J) -> Result<(), QueueLimit> {
        let mut state = self.state();
        let result = state.push(key, job);
        drop(state);
        self.changed.notify_all();
        result
    }

    /// Waits for the next job of a lane; `None` once the queue is closed. [`finish`](Self::finish) follows.
    pub(crate) fn take(&self, lane: Lane) -> Option<(JobKey, J)> {
        let mut state = self.state();
        loop {
            if state.is_closed {
                return None;
            }
            if let Some(next) = state.take(lane) {
                return Some(next);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A worker has executed a job.
    pub(crate) fn finish(&self, key: JobKey) {
        self.state().finish(key);
        self.changed.notify_all();
    }

    /// Jobs that wait or are executed.
    pub(crate) fn amount(&self) -> Amount {
        self.state().total
    }

    /// Removes the waiting jobs of a client that left and returns their number.
    pub(crate) fn cancel(&self, client: ClientId) -> usize {
        self.state().cancel(client)
    }

    /// Discards the waiting jobs and ends the workers.
    pub(crate) fn close(&self) {
        let mut state = self.state();
        state.is_closed = true;
        state.clients.clear();
        drop(state);
        self.changed.notify_all();
    }

    fn state(&self) -> MutexGuard<'_, State<J>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<J> State<J> {
    fn push(&mut self, key: JobKey, job: J) -> Result<(), QueueLimit> {
        let JobKey { requester: Requester { client, user }, bytes, .. } = key;
        let amount =
            |share: Option<&Share>| share.map_or_else(Amount::default, |share| share.amount);
        let of_client = amount(self.clients.get(&client).map(|jobs| &jobs.share)).with(bytes);
        let of_user = amount(self.users.get(&user)).with(bytes);
        let total = self.total.with(bytes);
        let limits = [
            (of_client.exceeds(CLIENT_LIMIT), QueueLimit::Client),
            (of_user.exceeds(USER_LIMIT), QueueLimit::User),
            (total.exceeds(TOTAL_LIMIT), QueueLimit::Total),
        ];
        if let Some((_, limit)) = limits.into_iter().find(|(is_exceeded, _)| *is_exceeded) {
            return Err(limit);
        }
        let share = Share::starting_at(self.last_turn);
        let jobs = self.clients.entry(client).or_insert_with(|| ClientJobs {
            user,
            share,
            waiting: VecDeque::new(),
        });
        jobs.share.amount = of_client;
        jobs.waiting.push_back((key, job));
        self.users.entry(user).or_insert(share).amount = of_user;
        self.total = total;
        Ok(())
    }

    /// The job of the client whose user, and which itself, was served longest ago.
    fn take(&mut self, lane: Lane) -> Option<(JobKey, J)> {
        let at = lane as usize;
        let (_, of_client, of_user) = lane.workers();
        let Self { clients, users, busy_slaves, .. } = self;
        let next = clients.iter().filter_map(|(client, jobs)| {
            let user = users.get(&jobs.user)?;
            if jobs.share.running[at] >= of_client || user.running[at] >= of_user {
                return None;
            }
            let is_free =
                |slave: Option<u16>| slave.is_none_or(|slave| !busy_slaves.contains(&slave));
            let index =
                jobs.waiting.iter().position(|(key, _)| key.lane == lane && is_free(key.slave))?;
            Some((user.last_turn[at], jobs.share.last_turn[at], *client, index))
        });
        let (.., client, index) = next.min()?;
        let jobs = self.clients.get_mut(&client)?;
        let (key, job) = jobs.waiting.remove(index)?;
        self.last_turn += 1;
        for share in [Some(&mut jobs.share), self.users.get_mut(&jobs.user)].into_iter().flatten() {
            share.running[at] += 1;
            share.last_turn[at] = self.last_turn;
        }
        self.busy_slaves.extend(key.slave);
        Some((key, job))
    }

    fn finish(&mut self, key: JobKey) {
        let JobKey { requester: Requester { client, user }, lane, slave, .. } = key;
        let shares =
            [self.clients.get_mut(&client).map(|jobs| &mut jobs.share), self.users.get_mut(&user)];
        for share in shares.into_iter().flatten() {
            let running = &mut share.running[lane as usize];
            *running = running.saturating_sub(1);
        }
        self.busy_slaves.retain(|busy| Some(*busy) != slave);
        self.remove(key);
    }

    fn cancel(&mut self, client: ClientId) -> usize {
        let Some(jobs) = self.clients.get_mut(&client) else { return 0 };
        let waiting = std::mem::take(&mut jobs.waiting);
        waiting.iter().for_each(|(key, _)| self.remove(*key));
        waiting.len()
    }

    /// Takes a job out of the amounts.
    fn remove(&mut self, JobKey { requester: Requester { client, user }, bytes, .. }: JobKey) {
        self.total = self.total.without(bytes);
        if let Some(jobs) = self.clients.get_mut(&client) {
            jobs.share.amount = jobs.share.amount.without(bytes);
            if jobs.share.amount.jobs == 0 {
                self.clients.remove(&client);
            }
        }
        if let Some(share) = self.users.get_mut(&user) {
            share.amount = share.amount.without(bytes);
            if share.amount.jobs == 0 {
                self.users.remove(&user);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: usize = 100;

    fn key(client: ClientId, user: u32, lane: Lane, slave: Option<u16>) -> JobKey {
        JobKey { requester: Requester { client, user }, lane, slave, bytes: SMALL }
    }

    fn upload(client: ClientId, user: u32, slave: u16) -> JobKey {
        key(client, user, Lane::Mailbox, Some(slave))
    }

    fn next(queue: &JobQueue<u32>, lane: Lane) -> Option<(JobKey, u32)> {
        queue.state().take(lane)
    }

    /// Takes and finishes every job; returns them in their order.
    fn drain(queue: &JobQueue<u32>, lane: Lane) -> Vec<u32> {
        let take = || {
            let (key, job) = next(queue, lane)?;
            queue.finish(key);
            Some(job)
        };
        std::iter::from_fn(take).collect()
    }

    #[test]
    fn users_and_their_clients_take_turns() {
        let queue = JobQueue::default();
        for job in 0..3 {
            queue.push(upload(1, 10, 0), job).unwrap();
            queue.push(upload(2, 10, 0), 10 + job).unwrap();
            queue.push(upload(3, 20, 0), 20 + job).unwrap();
        }
        assert_eq!(drain(&queue, Lane::Mailbox), [0, 20, 10, 21, 1, 22, 11, 2, 12]);
        let state = queue.state();
        assert!(state.clients.is_empty() && state.users.is_empty() && state.busy_slaves.is_empty());
        assert_eq!(state.total, Amount::default());
    }

    #[test]
    fn client_that_comes_later_follows_those_that_wait() {
        let queue = JobQueue::default();
        queue.push(upload(1, 10, 0), 0).unwrap();
        queue.push(upload(1, 10, 0), 1).unwrap();
        queue.push(upload(2, 10, 0), 10).unwrap();
        let (first, job) = next(&queue, Lane::Mailbox).unwrap();
        assert_eq!(job, 0);
        // Come and go does not gain a turn.
        for client in 3..8 {
            queue.push(upload(client, 10, 0), client as u32 * 10).unwrap();
            assert_eq!(queue.cancel(client), 1);
        }
        queue.push(upload(9, 10, 0), 90).unwrap();
        queue.finish(first);
        assert_eq!(drain(&queue, Lane::Mailbox), [10, 1, 90]);
    }

    #[test]
    fn silent_mailbox_keeps_one_worker_and_no_view() {
        let queue = JobQueue::default();
        for job in 0..16 {
            queue.push(upload(1, 10, 0), job).unwrap();
        }
        queue.push(upload(2, 10, 1), 20).unwrap();
        queue.push(key(2, 10, Lane::View, None), 21).unwrap();
        let (silent, _) = next(&queue, Lane::Mailbox).unwrap();
        assert_eq!(next(&queue, Lane::Mailbox).unwrap().1, 20, "another slave");
        assert_eq!(next(&queue, Lane::Mailbox), None, "the slave is busy");
        assert_eq!(next(&queue, Lane::View).unwrap().1, 21);
        queue.finish(silent);
        assert_eq!(next(&queue, Lane::Mailbox).unwrap().1, 1, "the order of a client is kept");
    }

    #[test]
    fn client_and_user_leave_workers_to_others() {
        let queue = JobQueue::default();
        for slave in 0..4 {
            queue.push(upload(1, 10, slave), 0).unwrap();
            queue.push(upload(2, 10, 10 + slave), 1).unwrap();
        }
        let taken: Vec<_> = std::iter::from_fn(|| next(&queue, Lane::Mailbox)).collect();
        assert_eq!(taken.iter().map(|(_, job)| *job).collect::<Vec<_>>(), [0, 1, 0]);
        queue.push(upload(3, 20, 30), 2).unwrap();
        assert_eq!(next(&queue, Lane::Mailbox).unwrap().1, 2);
    }

    #[test]
    fn jobs_and_bytes_of_client_user_and_all_are_limited() {
        let queue = JobQueue::<()>::default();
        let push = |client, user, bytes| {
            queue.push(JobKey { bytes, ..key(client, user, Lane::Extension, None) }, ())
        };
        for _ in 0..CLIENT_LIMIT.jobs {
            push(1, 1, SMALL).unwrap();
        }
        assert_eq!(push(1, 1, SMALL), Err(QueueLimit::Client));
        push(2, 1, 1 << 20).unwrap();
        assert_eq!(push(2, 1, (1 << 20) + 1), Err(QueueLimit::Client));
        push(3, 1, 2 << 20).unwrap();
        assert_eq!(push(4, 1, 1 << 20), Err(QueueLimit::User));
        let mut accepted = 0;
        while push(100 + accepted, 100 + accepted as u32, 2 << 20).is_ok() {
            accepted += 1;
        }
        assert_eq!(accepted, 6, "16 MiB in all");
        assert_eq!(push(1000, 1000, 2 << 20), Err(QueueLimit::Total));
        assert_eq!(queue.cancel(1), CLIENT_LIMIT.jobs);
        push(1, 1, SMALL).unwrap();
    }

    #[test]
    fn running_job_of_a_client_that_left_counts_until_its_end() {
        let queue = JobQueue::default();
        queue.push(upload(1, 10, 0), 0).unwrap();
        queue.push(upload(1, 10, 0), 1).unwrap();
        let (running, _) = next(&queue, Lane::Mailbox).unwrap();
        assert_eq!(queue.cancel(1), 1);
        assert_eq!(queue.state().total.jobs, 1);
        queue.finish(running);
        assert!(queue.state().clients.is_empty());
        assert_eq!(queue.state().total, Amount::default());
    }

    #[test]
    fn closed_queue_ends_its_workers() {
        let queue = JobQueue::default();
        queue.push(upload(1, 10, 0), 0).unwrap();
        queue.close();
        assert_eq!(queue.take(Lane::Mailbox), None);
    }
}
