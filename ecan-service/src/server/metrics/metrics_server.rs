//! Thread that serves the metrics.

use std::net::TcpListener;
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ecan_host::Ecrt;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::{SocketFlags, accept_with};

use super::declared::metrics;
use super::device_objects::DeviceObjects;
use super::http_connection::HttpConnection;
use super::metric::Source;
use super::metrics_config::{MetricsAddress, MetricsConfig};
use super::render;
use crate::server::bus_calls::BusCalls;
use crate::server::config::ServiceError;
use crate::server::listener::{Listener, enter_background};
use crate::server::shared::Shared;
use crate::server::workers::Waker;

/// Time of one client, also if it sends nothing.
const CLIENT_LIMIT: Duration = Duration::from_secs(2);
/// Interval of checking the socket file.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Server of metrics, on a thread of its own. Dropping it ends the thread.
#[derive(Debug)]
pub(crate) struct MetricsServer {
    address: MetricsAddress,
    is_stopped: Arc<AtomicBool>,
    waker: Waker,
    thread: Option<JoinHandle<()>>,
}

impl MetricsServer {
    /// Listens; `mode` and `group` are those of a socket file.
    pub(crate) fn start(
        config: &MetricsConfig,
        (mode, group): (u32, Option<&str>),
        shared: &Arc<Shared>,
        ecrt: &Ecrt,
        master_index: u32,
    ) -> Result<Self, ServiceError> {
        let (socket, address) = match &config.address {
            MetricsAddress::Tcp(address) => {
                if !address.ip().is_loopback() && !config.allows_remote {
                    return Err(ServiceError::RemoteMetrics(*address));
                }
                let error = |source| ServiceError::MetricsAddress { address: *address, source };
                let listener = TcpListener::bind(address).map_err(error)?;
                listener.set_nonblocking(true).map_err(error)?;
                let bound = listener.local_addr().map_err(error)?;
                (Socket::Tcp(listener), MetricsAddress::Tcp(bound))
            }
            MetricsAddress::Unix(path) => {
                let listener = Listener::create_at(path.clone(), mode, group)?;
                (Socket::Unix(listener), config.address.clone())
            }
        };
        let waker = Waker::new().map_err(|error| ServiceError::Thread(error.into()))?;
        let is_stopped = Arc::new(AtomicBool::new(false));
        let objects = config.object_interval.map(|interval| {
            let objects = metrics().filter_map(|metric| match metric.source {
                Source::Object { index, subindex, .. } => Some((index, subindex)),
                _ => None,
            });
            DeviceObjects::start(interval, objects.collect(), shared, ecrt)
        });
        let objects = objects.transpose().map_err(ServiceError::Thread)?;
        let server = Server {
            socket,
            shared: shared.clone(),
            bus: BusCalls::new(ecrt.clone(), master_index),
            objects,
            waker: waker.clone(),
            is_stopped: is_stopped.clone(),
        };
        let builder = thread::Builder::new().name("ecan metrics".into());
        let thread = builder.spawn(move || server.run()).map_err(ServiceError::Thread)?;
        Ok(Self { address, is_stopped, waker, thread: Some(thread) })
    }

    /// The address, with the port that the system has chosen for port 0.
    pub(crate) fn address(&self) -> &MetricsAddress {
        &self.address
    }
}

impl Drop for MetricsServer {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Release);
        self.waker.wake();
        if let Some(thread) = self.thread.take() {
            // A panic in it was reported on standard error.
            let _ = thread.join();
        }
    }
}

enum Socket {
    Tcp(TcpListener),
    Unix(Listener),
}

impl Socket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Tcp(listener) => listener.as_fd(),
            Self::Unix(listener) => listener.as_fd(),
        }
    }
}

struct Server {
    socket: Socket,
    shared: Arc<Shared>,
    bus: BusCalls,
    objects: Option<DeviceObjects>,
    waker: Waker,
    is_stopped: Arc<AtomicBool>,
}

impl Server {
    fn run(mut self) {
        enter_background();
        while !self.is_stopped.load(Ordering::Acquire) {
            if let Socket::Unix(listener) = &mut self.socket {
                // The service logs the same about its own socket.
                let _ = listener.restore();
            }
            let mut fds = [
                PollFd::from_borrowed_fd(self.waker.as_fd(), PollFlags::IN),
                PollFd::from_borrowed_fd(self.socket.as_fd(), PollFlags::IN),
            ];
            let timeout = Timespec::try_from(CHECK_INTERVAL).ok();
            if poll(&mut fds, timeout.as_ref()).is_err() || fds[1].revents().is_empty() {
                continue;
            }
            let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
            match accept_with(self.socket.as_fd(), flags) {
                Ok(client) => self.serve(client),
                // Without a free descriptor the socket stays readable.
                Err(_) => thread::sleep(CHECK_INTERVAL / 20),
            }
        }
    }

    /// One client after the other: a scrape takes a few milliseconds.
    fn serve(&self, client: OwnedFd) {
        HttpConnection::new(client, CLIENT_LIMIT).respond(|| {
            let sample = self.shared.metrics_sample();
            let mut sample = sample.ok_or("the service did not answer in time\n")?;
            sample.objects = self.objects.as_ref().map(DeviceObjects::values).unwrap_or_default();
            sample.bus = self.bus.bus_state().ok();
            render::text(&sample).map_err(|error| format!("{error}\n"))
        });
    }
}
