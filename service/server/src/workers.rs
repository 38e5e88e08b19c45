//! Threads for requests that block.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecan_host::Ecrt;
use ecan_service_protocol::{Request, RpcError};
use rustix::event::{EventfdFlags, eventfd};
use serde_json::Value;

use crate::bus_calls::BusCalls;
use crate::extension::{Extension, Permission};
use crate::scheduling::enter_background;
use crate::session::{ClientId, no_such_method};

const WORKERS: usize = 4;
/// Time that the end of a service waits for a request. A transfer that the bus does not answer ends
/// with the master's handle later.
const END_WAIT: Duration = Duration::from_secs(2);

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

/// A request for a worker.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) client: ClientId,
    pub(crate) permission: Permission,
    pub(crate) request: Request,
}

/// Response of a worker.
#[derive(Debug)]
pub(crate) struct Done {
    pub(crate) client: ClientId,
    pub(crate) id: Value,
    pub(crate) result: Result<Value, RpcError>,
}

/// The workers of a service. Dropping it waits for them, for a limited time.
#[derive(Debug)]
pub(crate) struct Workers {
    jobs: Option<Sender<Job>>,
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
        let (jobs, job_receiver) = mpsc::channel();
        let (done_sender, done) = mpsc::channel();
        let jobs_in = Arc::new(Mutex::new(job_receiver));
        let start = |number: usize| {
            let worker = Worker {
                jobs: jobs_in.clone(),
                done: done_sender.clone(),
                bus: BusCalls::new(ecrt.clone(), master_index),
                extensions: extensions.to_vec(),
                waker: waker.clone(),
            };
            let name = format!("ecan worker {number}");
            thread::Builder::new().name(name).spawn(move || worker.run())
        };
        let threads = (0..WORKERS).map(start).collect::<Result<_, _>>()?;
        Ok(Self { jobs: Some(jobs), done, threads })
    }

    pub(crate) fn submit(&self, job: Job) {
        // Workers end after the sender only.
        if let Some(jobs) = &self.jobs {
            let _ = jobs.send(job);
        }
    }

    pub(crate) fn next_done(&self) -> Option<Done> {
        self.done.try_recv().ok()
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.jobs = None;
        let end = Instant::now() + END_WAIT;
        for thread in self.threads.drain(..) {
            // A channel without senders has no timeout for the end of a thread.
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
    jobs: Arc<Mutex<Receiver<Job>>>,
    done: Sender<Done>,
    bus: BusCalls,
    extensions: Vec<Arc<dyn Extension>>,
    waker: Waker,
}

impl Worker {
    fn run(self) {
        enter_background();
        loop {
            let next = self.jobs.lock().unwrap_or_else(PoisonError::into_inner).recv();
            let Ok(Job { client, permission, request }) = next else { return };
            let result = self.execute(&request, &permission);
            if self.done.send(Done { client, id: request.id, result }).is_err() {
                return;
            }
            self.waker.wake();
        }
    }

    fn execute(&self, request: &Request, permission: &Permission) -> Result<Value, RpcError> {
        let method = &request.method;
        let of_program =
            || self.extensions.iter().find_map(|it| it.call(method, &request.params, permission));
        of_program()
            .or_else(|| self.bus.call(request))
            .unwrap_or_else(|| Err(no_such_method(method)))
    }
}
