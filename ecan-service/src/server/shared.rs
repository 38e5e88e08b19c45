//! State that a service and its thread share.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use serde_json::Value;

use super::bus::Attachment;
use crate::protocol::Response;
use crate::server::metrics::MetricsSample;
use crate::server::permission::AccessRule;
use crate::server::workers::Waker;

/// Time that the thread of the service has for a sample.
const SAMPLE_LIMIT: Duration = Duration::from_secs(2);

/// Change of a running service.
#[derive(Debug)]
pub(crate) enum Update {
    /// A Port runs the cycle, or none.
    Cycle(Option<Box<Attachment>>),
    /// Another rule for all clients.
    Access(AccessRule),
    /// Another limit of clients.
    MaxClients(usize),
    /// A notification for every client.
    Notify(String, Value),
    /// An event of the program.
    Record(String),
    /// A request for a sample of everything that metrics show.
    Metrics(SyncSender<MetricsSample>),
}

#[derive(Debug)]
pub(crate) struct Shared {
    is_stopped: AtomicBool,
    updates: Mutex<Vec<Update>>,
    waker: Waker,
}

impl Shared {
    pub(crate) fn new(waker: Waker) -> Self {
        Self { is_stopped: AtomicBool::new(false), updates: Mutex::default(), waker }
    }

    pub(crate) fn waker(&self) -> &Waker {
        &self.waker
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Acquire)
    }

    pub(crate) fn stop(&self) {
        self.is_stopped.store(true, Ordering::Release);
        self.waker.wake();
    }

    pub(crate) fn send(&self, update: Update) {
        self.updates.lock().unwrap_or_else(PoisonError::into_inner).push(update);
        self.waker.wake();
    }

    /// Everything that metrics show, from the thread of the service; `None` if it does not answer.
    pub(crate) fn metrics_sample(&self) -> Option<MetricsSample> {
        let (sender, receiver) = sync_channel(1);
        self.send(Update::Metrics(sender));
        receiver.recv_timeout(SAMPLE_LIMIT).ok()
    }

    pub(crate) fn take_updates(&self) -> Vec<Update> {
        std::mem::take(&mut self.updates.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

pub(crate) fn notification(method: &str, params: &impl serde::Serialize) -> Response {
    Response::notification(method, serde_json::to_value(params).unwrap_or_default())
}
