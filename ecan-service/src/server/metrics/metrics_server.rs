//! The server of the metrics, and its connections.

use std::net::TcpListener;
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, Shutdown, SocketFlags, accept_with, recv, send, shutdown};

use crate::server::config::{MetricsAddress, MetricsConfig, ServiceError};
use crate::server::listener::{Listener, enter_background};
use crate::server::workers::Waker;

/// Time of one client, also if it sends nothing.
const CLIENT_LIMIT: Duration = Duration::from_secs(2);
/// Interval of checking the socket file.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Server of metrics for Prometheus, on a thread of its own. Dropping it ends the thread.
#[derive(Debug)]
pub struct MetricsServer {
    address: MetricsAddress,
    is_stopped: Arc<AtomicBool>,
    waker: Waker,
    thread: Option<JoinHandle<()>>,
}

impl MetricsServer {
    /// Listens at the address of `config`, and answers each scrape with what `text` returns: the text form of
    /// Prometheus (0.0.4), or the reason without one. Mode and group are those of a socket file.
    ///
    /// # Errors
    /// The address is in use, reached by other hosts and not permitted, or no socket can be made there.
    pub fn start(
        config: &MetricsConfig,
        (mode, group): (u32, Option<&str>),
        text: impl Fn() -> Result<String, String> + Send + 'static,
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
        let server = Server { socket, text, waker: waker.clone(), is_stopped: is_stopped.clone() };
        let builder = thread::Builder::new().name("ecan metrics".into());
        let thread = builder.spawn(move || server.run()).map_err(ServiceError::Thread)?;
        Ok(Self { address, is_stopped, waker, thread: Some(thread) })
    }

    /// The address, with the port that the system has chosen for port 0.
    pub fn address(&self) -> &MetricsAddress {
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

struct Server<F> {
    socket: Socket,
    text: F,
    waker: Waker,
    is_stopped: Arc<AtomicBool>,
}

impl<F: Fn() -> Result<String, String>> Server<F> {
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
                // One client after the other: a scrape takes a few milliseconds.
                Ok(client) => HttpConnection::new(client, CLIENT_LIMIT).respond(&self.text),
                // Without a free descriptor the socket stays readable.
                Err(_) => thread::sleep(CHECK_INTERVAL / 20),
            }
        }
    }
}

/// Bytes of a request, which has no body.
const MAX_REQUEST: usize = 8 << 10;
const MAX_HEADERS: usize = 64;
/// Content type of the text form.
const TEXT_FORM: &str = "text/plain; version=0.0.4; charset=utf-8";
const PATH: &str = "/metrics";

/// Connection that is closed when it is dropped.
#[derive(Debug)]
pub(crate) struct HttpConnection {
    socket: OwnedFd,
    end: Instant,
}

/// A request, or the response to one that is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Request {
    Incomplete,
    Metrics { has_body: bool },
    Rejected(&'static str, &'static str),
}

impl HttpConnection {
    /// Takes a nonblocking socket. The client has `limit` to send its request and to read the response.
    pub(crate) fn new(socket: OwnedFd, limit: Duration) -> Self {
        Self { socket, end: Instant::now() + limit }
    }

    /// Responds to one request with the text of the metrics, which is only made for a valid request;
    /// `Err` is the reason without one.
    pub(crate) fn respond(self, text: impl FnOnce() -> Result<String, String>) {
        let Some(request) = self.request() else { return };
        let (status, content_type, body, has_body) = match request {
            Request::Metrics { has_body } => match text() {
                Ok(text) => ("200 OK", TEXT_FORM, text, has_body),
                Err(reason) => ("503 Service Unavailable", "text/plain", reason, has_body),
            },
            Request::Rejected(status, reason) => {
                (status, "text/plain", format!("{reason}\n"), true)
            }
            Request::Incomplete => return,
        };
        let length = body.len();
        let mut response = format!(
            "HTTP/1.1 {status}\r\nContent-Type: {content_type}\r\nContent-Length: {length}\r\n\
             Connection: close\r\n\r\n"
        );
        if has_body {
            response.push_str(&body);
        }
        self.write(response.as_bytes());
        if matches!(request, Request::Rejected(..)) {
            self.drain();
        }
    }

    /// Reads the rest of a rejected request: closing with unread bytes would discard the response.
    fn drain(&self) {
        let _ = shutdown(&self.socket, Shutdown::Write);
        let mut rest = [0; 4096];
        loop {
            match recv(&self.socket, &mut rest, RecvFlags::empty()) {
                Err(Errno::AGAIN | Errno::INTR) if self.wait(PollFlags::IN).is_some() => {}
                Ok((_, count)) if count > 0 && Instant::now() < self.end => {}
                _ => return,
            }
        }
    }

    /// Reads a request; `None` if the client does not send one in time.
    fn request(&self) -> Option<Request> {
        let mut bytes = vec![0; MAX_REQUEST];
        let mut length = 0;
        loop {
            let rest = bytes.get_mut(length..).filter(|rest| !rest.is_empty());
            let Some(rest) = rest else {
                let status = "431 Request Header Fields Too Large";
                return Some(Request::Rejected(status, "the request is longer than 8 KiB"));
            };
            match recv(&self.socket, rest, RecvFlags::empty()) {
                Ok((_, 0)) => return None,
                Ok((_, count)) => length += count,
                Err(Errno::AGAIN | Errno::INTR) => self.wait(PollFlags::IN)?,
                Err(_) => return None,
            }
            match parse(bytes.get(..length).unwrap_or_default()) {
                Request::Incomplete => {}
                request => return Some(request),
            }
        }
    }

    fn write(&self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            match send(&self.socket, bytes, SendFlags::NOSIGNAL) {
                Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => {
                    if self.wait(PollFlags::OUT).is_none() {
                        return;
                    }
                }
                Err(_) => return,
            }
        }
    }

    /// Waits until the socket is ready; `None` at the end of the client's time.
    fn wait(&self, flags: PollFlags) -> Option<()> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return None;
        }
        let timeout = Timespec::try_from(left).ok();
        match poll(&mut [PollFd::new(&self.socket, flags)], timeout.as_ref()) {
            Ok(0) => None,
            Ok(_) | Err(Errno::INTR) => Some(()),
            Err(_) => None,
        }
    }
}

fn parse(bytes: &[u8]) -> Request {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    match request.parse(bytes) {
        Ok(httparse::Status::Partial) => return Request::Incomplete,
        Ok(httparse::Status::Complete(_)) => {}
        Err(_) => return Request::Rejected("400 Bad Request", "the request is not HTTP/1"),
    }
    let path = request.path.and_then(|path| path.split('?').next());
    match (request.method, path) {
        (Some(method @ ("GET" | "HEAD")), Some(PATH)) => {
            Request::Metrics { has_body: method == "GET" }
        }
        (Some("GET" | "HEAD"), _) => {
            Request::Rejected("404 Not Found", "the metrics are at /metrics")
        }
        _ => Request::Rejected("405 Method Not Allowed", "allowed: GET and HEAD"),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn prefix_of_a_request_is_incomplete(end in 0_usize..42, tail in any::<Vec<u8>>()) {
            let request = b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
            prop_assert_eq!(parse(&request[..end]), Request::Incomplete);
            // Any bytes are parsed or rejected.
            parse(&tail);
            parse(&[&request[..end], &tail].concat());
        }
    }

    #[test]
    fn requests_are_parsed_or_rejected() {
        let get = Request::Metrics { has_body: true };
        assert_eq!(parse(b"GET /metrics HTTP/1.1\r\nHost: a\r\n\r\n"), get);
        assert_eq!(parse(b"GET /metrics?x=1 HTTP/1.0\r\n\r\n"), get);
        assert_eq!(parse(b"HEAD /metrics HTTP/1.1\r\n\r\n"), Request::Metrics { has_body: false });
        assert_eq!(parse(b"GET /metrics HTTP/1.1\r\nHost"), Request::Incomplete);
        let status = |bytes: &[u8]| match parse(bytes) {
            Request::Rejected(status, _) => status,
            other => panic!("{other:?}"),
        };
        assert_eq!(status(b"GET / HTTP/1.1\r\n\r\n"), "404 Not Found");
        assert_eq!(status(b"POST /metrics HTTP/1.1\r\n\r\n"), "405 Method Not Allowed");
        assert_eq!(status(b"\x16\x03\x01\x02\x00"), "400 Bad Request");
    }
}
