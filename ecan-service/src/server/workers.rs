//! Threads for requests that block.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecan_host::Ecrt;
use nix::time::{ClockId, clock_gettime};
use rustix::event::{EventfdFlags, eventfd};
use serde_json::{Value, json};

use super::config::{Extension, Permission};
use super::listener::enter_background;
use crate::protocol::{Access, DEFAULT_MAX_AGE_MS, EXPIRED, RawRequest, RpcError};
use crate::server::bus_calls::{BusCall, BusCalls};
use crate::server::job_queue::{ClientId, JobKey, JobQueue, Lane, QueueLimit, Requester};
use crate::server::session::no_such_method;

/// Time that the end of a service waits for a request. A transfer that the bus does not answer ends
/// with the master's handle later.
const END_WAIT: Duration = Duration::from_secs(2);
/// Bytes of a job besides its data.
const JOB_BYTES: usize = 256;

/// Wakes the service's thread.
#[derive(Debug, Clone)]
pub(crate) struct Waker(Arc<OwnedFd>);

impl Waker {
    pub(crate) fn new() -> rustix::io::Result<Self> {
        let flags = EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK;
        Ok(Self(Arc::new(eventfd(0, flags)?)))
    }

    pub(crate) fn wake(&self) {
        // Full means that a wake is pending.
        let _ = rustix::io::write(&self.0, &1_u64.to_ne_bytes());
    }

    pub(crate) fn clear(&self) {
        let _ = rustix::io::read(&self.0, &mut [0_u8; 8]);
    }
}

impl AsFd for Waker {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Arrival and age limit of a request. The clock counts while the machine sleeps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Age {
    pub(crate) arrival: Duration,
    /// `None`: no limit.
    pub(crate) max: Option<Duration>,
}

/// Time since the start of the system, with the time asleep.
pub(crate) fn time_since_boot() -> Duration {
    // rustix reads the clock past the C library, which ends programs under valgrind.
    clock_gettime(ClockId::CLOCK_BOOTTIME).map(Duration::from).unwrap_or_default()
}

impl Age {
    /// Age limit of a request; of one that may act, the default.
    pub(crate) fn of(request: &RawRequest, access: Access, arrival: Duration) -> Self {
        let default = (access == Access::Control).then_some(DEFAULT_MAX_AGE_MS);
        let max = request.max_age_ms.or(default);
        Self { arrival, max: max.map(|ms| Duration::from_millis(ms.into())) }
    }

    /// Time until the limit; zero after it, `None` without a limit.
    pub(crate) fn left(&self) -> Option<Duration> {
        let age = time_since_boot().saturating_sub(self.arrival);
        self.max.map(|max| max.saturating_sub(age))
    }

    /// Rejects a request that waited longer than its limit.
    pub(crate) fn check(&self, method: &str) -> Result<(), RpcError> {
        if self.left() != Some(Duration::ZERO) {
            return Ok(());
        }
        let age_ms = time_since_boot().saturating_sub(self.arrival).as_millis() as u64;
        let max_ms = self.max.unwrap_or_default().as_millis() as u64;
        let text = format!(
            "{method} was not executed: it waited {age_ms} ms; allowed: {max_ms} ms (max_age_ms); \
             send it again if it is still needed"
        );
        let data = json!({ "age_ms": age_ms, "max_age_ms": max_ms });
        Err(RpcError { data, ..RpcError::new(EXPIRED, text) })
    }
}

/// Task of a worker.
#[derive(Debug)]
pub(crate) enum Work {
    Bus(BusCall),
    /// A method of the extension with this index.
    Extension(usize, RawRequest),
}

impl Work {
    fn key(&self, requester: Requester) -> JobKey {
        let (lane, slave, bytes) = match self {
            Self::Bus(call) => match call.mailbox() {
                Some(slave) => (Lane::Mailbox, Some(slave), call.bytes()),
                None => (Lane::View, None, 0),
            },
            Self::Extension(_, request) => (Lane::Extension, None, request.bytes()),
        };
        JobKey { requester, lane, slave, bytes: JOB_BYTES + bytes }
    }
}

/// A request for a worker.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) permission: Permission,
    pub(crate) id: Value,
    pub(crate) method: String,
    pub(crate) age: Age,
    pub(crate) work: Work,
}

/// Response of a worker.
#[derive(Debug)]
pub(crate) struct Done {
    pub(crate) client: ClientId,
    pub(crate) id: Value,
    pub(crate) result: Result<Value, RpcError>,
}

/// The workers of a service. Dropping it discards the jobs that wait, and waits for those in progress for a
/// limited time.
#[derive(Debug)]
pub(crate) struct Workers {
    queue: Arc<JobQueue<Job>>,
    extensions: Vec<Arc<dyn Extension>>,
    done: Receiver<Done>,
    threads: Vec<JoinHandle<()>>,
}

impl Workers {
    pub(crate) fn start(
        ecrt: &Ecrt,
        master_index: u32,
        extensions: &[Arc<dyn Extension>],
        waker: &Waker,
    ) -> std::io::Result<Self> {
        let (done_sender, done) = mpsc::channel();
        let queue = Arc::<JobQueue<Job>>::default();
        // Dropped, and so ended, if a thread cannot be started.
        let mut workers = Self {
            queue: queue.clone(),
            extensions: extensions.to_vec(),
            done,
            threads: Vec::new(),
        };
        for lane in Lane::ALL {
            for number in 0..lane.workers().0 {
                let worker = Worker {
                    lane,
                    queue: queue.clone(),
                    done: done_sender.clone(),
                    bus: BusCalls::new(ecrt.clone(), master_index),
                    extensions: extensions.to_vec(),
                    waker: waker.clone(),
                };
                let name = format!("ecan {lane:?} {number}").to_lowercase();
                let thread = thread::Builder::new().name(name).spawn(move || worker.run())?;
                workers.threads.push(thread);
            }
        }
        Ok(workers)
    }

    /// Index of the extension that has a method, and the access that it needs.
    pub(crate) fn extension(&self, method: &str) -> Option<(usize, Access)> {
        let mut extensions = self.extensions.iter().enumerate();
        extensions.find_map(|(index, extension)| Some((index, extension.access(method)?)))
    }

    pub(crate) fn submit(&self, requester: Requester, job: Job) -> Result<(), QueueLimit> {
        self.queue.push(job.work.key(requester), job)
    }

    /// Requests that wait or are executed.
    pub(crate) fn pending(&self) -> u64 {
        self.queue.amount().jobs as u64
    }

    /// A client left: its requests that wait are not executed. Returns their number.
    pub(crate) fn cancel(&self, client: ClientId) -> usize {
        self.queue.cancel(client)
    }

    pub(crate) fn next_done(&self) -> Option<Done> {
        self.done.try_recv().ok()
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.queue.close();
        let end = Instant::now() + END_WAIT;
        for thread in self.threads.drain(..) {
            // A thread has no timeout for its end.
            while !thread.is_finished() && Instant::now() < end {
                thread::sleep(Duration::from_millis(1));
            }
            if thread.is_finished() {
                let _ = thread.join();
            } else {
                tracing::warn!("service: a request did not end within {END_WAIT:?}");
            }
        }
    }
}

struct Worker {
    lane: Lane,
    queue: Arc<JobQueue<Job>>,
    done: Sender<Done>,
    bus: BusCalls,
    extensions: Vec<Arc<dyn Extension>>,
    waker: Waker,
}

impl Worker {
    fn run(self) {
        enter_background();
        while let Some((key, job)) = self.queue.take(self.lane) {
            let result = job.age.check(&job.method).and_then(|()| self.execute(&job));
            self.queue.finish(key);
            let client = key.requester.client;
            if self.done.send(Done { client, id: job.id, result }).is_err() {
                return;
            }
            self.waker.wake();
        }
    }

    fn execute(&self, Job { permission, work, method, .. }: &Job) -> Result<Value, RpcError> {
        match work {
            Work::Bus(call) => self.bus.execute(call),
            Work::Extension(index, request) => {
                let extension = self.extensions.get(*index);
                let result = extension.and_then(|extension| {
                    extension.call(method, &request.params_value(), permission)
                });
                result.unwrap_or_else(|| Err(no_such_method(method)))
            }
        }
    }
}
