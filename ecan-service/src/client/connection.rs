//! The client.

use std::io::{ErrorKind, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ecan_protocol::can::CanFrame;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, recv};
use serde_json::Value;

use super::inbox::{ClientError, Event, Inbox, SendError};
use crate::protocol::{
    Access, ActiveConfig, AssignedParams, AssignedPdo, Axes, BusState, DownloadParams, Empty,
    Hello, HelloParams, ImageSubscription, Link, LinkParams, MAX_AGE_MS, MAX_REQUEST_PAYLOAD,
    METHODS, MessageKind, Method, NmtParams, PROTOCOL_VERSION, RecordedEvents, Request,
    ServiceStats, Slave, SlaveParams, State, Subscription, TransmitRecord, UploadParams, header,
    methods,
};

/// Default time for a response. A transfer without response is repeated for 5 s by the service.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(60);
const READ_BYTES: usize = 64 << 10;

/// Tag of a frame that this client sent, as in
/// [`FrameReport::tag`](crate::protocol::FrameReport::tag).
pub type Tag = u32;

/// Connection to a service.
///
/// Several threads may use it at once through a reference or an `Arc`. One of the threads that wait
/// reads the socket for all: events stay in one queue for [`poll`](Self::poll), responses go to the
/// thread of their request. The queue holds about 16 MB; frames that arrive during requests while it
/// is full are lost and reported by [`Event::Lost`].
///
/// ```no_run
/// use std::{path::Path, time::Duration};
///
/// use ecan_service::client::{Client, Event, Subscription};
///
/// let client = Client::connect(Path::new("/run/ecan/master0.sock"), "example")?;
/// client.subscribe(&Subscription::default())?;
/// while let Some(event) = client.poll(Duration::from_secs(1))? {
///     if let Event::Frame(report) = event {
///         println!("{} {:?}", report.time_ns, report.frame);
///     }
/// }
/// # Ok::<(), ecan_service::client::ClientError>(())
/// ```
#[derive(Debug)]
pub struct Client {
    stream: UnixStream,
    /// Locked while a message is written, so that messages are not mixed.
    output: Mutex<()>,
    input: Mutex<Input>,
    /// The reading thread has added to the input, or reads no longer.
    changed: Condvar,
    hello: Hello,
    request_timeout: Duration,
}

#[derive(Debug)]
struct Input {
    inbox: Inbox,
    next_id: u64,
    next_tag: Tag,
    /// A thread waits for the socket.
    is_reading: bool,
    /// Memory for the reading thread.
    buffer: Vec<u8>,
    /// Reason for which nothing more arrives.
    end: Option<ClientError>,
}

impl Client {
    /// Connects to the service at `path` and introduces the client under `name`.
    ///
    /// # Errors
    /// [`ClientError::Connect`] without a service; an error of the service with the code
    /// [`WRONG_VERSION`](crate::protocol::WRONG_VERSION).
    pub fn connect(path: &Path, name: &str) -> Result<Self, ClientError> {
        let stream = UnixStream::connect(path).map_err(|error| ClientError::Connect {
            path: path.to_owned(),
            source: Arc::new(error),
        })?;
        Self::on(stream, name)
    }

    /// As [`connect`](Self::connect), on a stream that is connected.
    ///
    /// # Errors
    /// As [`connect`](Self::connect).
    pub fn on(stream: UnixStream, name: &str) -> Result<Self, ClientError> {
        stream.set_nonblocking(false)?;
        let mut client = Self {
            stream,
            output: Mutex::new(()),
            input: Mutex::new(Input {
                inbox: Inbox::new(),
                next_id: 1,
                next_tag: 1,
                is_reading: false,
                buffer: vec![0; READ_BYTES],
                end: None,
            }),
            changed: Condvar::new(),
            hello: Hello::default(),
            request_timeout: REQUEST_TIMEOUT,
        };
        let params = HelloParams { version: PROTOCOL_VERSION, client: name.into() };
        client.hello = client.request::<methods::SayHello>(&params)?;
        Ok(client)
    }

    /// Sets the time for a response; 60 s by default.
    pub fn set_request_timeout(&mut self, timeout: Duration) {
        self.request_timeout = timeout;
    }

    /// Response of the service at the connection. [`Event::Gateways`] reports later changes of the
    /// gateways.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// Calls a method by its name, for example one of an extension.
    ///
    /// # Errors
    /// [`ClientError::Rpc`] if the service rejects it.
    pub fn call(&self, method: &str, params: Value) -> Result<Value, ClientError> {
        self.call_within(method, params, self.request_timeout)
    }

    /// As [`call`](Self::call), with the time for the response. It is the age limit of a request that may
    /// act, too: the service does not execute it when its sender no longer waits.
    ///
    /// # Errors
    /// As [`call`](Self::call).
    pub fn call_within(
        &self,
        method: &str,
        params: Value,
        timeout: Duration,
    ) -> Result<Value, ClientError> {
        // A late answer to a request that only reads does no harm.
        let may_act = !METHODS.contains(&(method, Access::Read));
        self.call_aged(method, params, may_act.then_some(timeout), timeout)
    }

    /// As [`call`](Self::call), with the age limit of the request: the service begins it within this
    /// time, or rejects it with [`EXPIRED`](crate::protocol::EXPIRED). The response may follow
    /// later.
    ///
    /// # Errors
    /// As [`call`](Self::call).
    pub fn call_before(
        &self,
        method: &str,
        params: Value,
        max_age: Duration,
    ) -> Result<Value, ClientError> {
        self.call_aged(method, params, Some(max_age), self.request_timeout)
    }

    fn call_aged(
        &self,
        method: &str,
        params: Value,
        max_age: Option<Duration>,
        timeout: Duration,
    ) -> Result<Value, ClientError> {
        let id = {
            let mut input = self.input();
            let id = input.next_id;
            input.next_id += 1;
            input.inbox.expect_response(id);
            id
        };
        let max_age_ms = max_age.map(|age| age_ms(age, MAX_AGE_MS));
        let request = Request { max_age_ms, ..Request::new(id, method, params) };
        let result = self.exchange(id, &request, timeout);
        self.input().inbox.forget_response(id);
        result
    }

    fn exchange(
        &self,
        id: u64,
        request: &Request,
        timeout: Duration,
    ) -> Result<Value, ClientError> {
        let (method, payload) = (&request.method, serde_json::to_vec(request)?);
        if payload.len() > MAX_REQUEST_PAYLOAD {
            return Err(ClientError::Protocol(format!(
                "request {method} has {} bytes; allowed: at most {MAX_REQUEST_PAYLOAD}",
                payload.len()
            )));
        }
        self.write(MessageKind::Rpc, &payload)?;
        match self.wait(timeout, |input| input.inbox.take_response(id))? {
            Some(result) => result.map_err(|error| ClientError::Rpc(Box::new(error))),
            None => Err(ClientError::Timeout {
                method: method.clone(),
                timeout_ms: u64::try_from(timeout.as_millis()).unwrap_or(u64::MAX),
            }),
        }
    }

    /// Calls a method with its types.
    ///
    /// # Errors
    /// As [`call`](Self::call).
    pub fn request<M: Method>(&self, params: &M::Params) -> Result<M::Result, ClientError> {
        let result = self.call(M::NAME, serde_json::to_value(params)?)?;
        Ok(serde_json::from_value(result)?)
    }

    /// Subscribes to frames, instead of an earlier subscription. Results of this client's own frames
    /// need none.
    ///
    /// # Errors
    /// As [`call`](Self::call), like all methods below.
    pub fn subscribe(&self, subscription: &Subscription) -> Result<(), ClientError> {
        self.request::<methods::SubscribeFrames>(subscription).map(drop)
    }

    /// Ends the subscription to frames.
    pub fn unsubscribe(&self) -> Result<(), ClientError> {
        self.request::<methods::UnsubscribeFrames>(&Empty {}).map(drop)
    }

    /// Subscribes to PDO images.
    pub fn subscribe_images(&self, images: &ImageSubscription) -> Result<(), ClientError> {
        self.request::<methods::SubscribeImages>(images).map(drop)
    }

    /// Ends the subscription to images.
    pub fn unsubscribe_images(&self) -> Result<(), ClientError> {
        self.request::<methods::UnsubscribeImages>(&Empty {}).map(drop)
    }

    /// State of master and links.
    pub fn bus_state(&self) -> Result<BusState, ClientError> {
        self.request::<methods::ReadBusState>(&Empty {})
    }

    /// State of one link.
    pub fn link(&self, device: u32) -> Result<Link, ClientError> {
        self.request::<methods::ReadLink>(&LinkParams { device })
    }

    /// All slaves of the bus.
    pub fn slaves(&self) -> Result<Vec<Slave>, ClientError> {
        self.request::<methods::ReadSlaves>(&Empty {})
    }

    /// The slave at a position.
    pub fn slave(&self, slave: u16) -> Result<Slave, ClientError> {
        self.request::<methods::ReadSlave>(&SlaveParams { slave })
    }

    /// Uploads an object.
    pub fn sdo_upload(&self, params: &UploadParams) -> Result<Vec<u8>, ClientError> {
        self.request::<methods::UploadSdo>(params).map(|upload| upload.data)
    }

    /// Downloads an object. Needs control.
    pub fn sdo_download(&self, params: &DownloadParams) -> Result<(), ClientError> {
        self.request::<methods::DownloadSdo>(params).map(drop)
    }

    /// PDOs that a sync manager has assigned.
    pub fn assigned_pdos(&self, slave: u16, sync: u8) -> Result<Vec<AssignedPdo>, ClientError> {
        self.request::<methods::ReadAssigned>(&AssignedParams { slave, sync })
    }

    /// State of the last cycle.
    pub fn state(&self) -> Result<State, ClientError> {
        self.request::<methods::ReadState>(&Empty {})
    }

    /// Axes of the last cycle.
    pub fn axes(&self) -> Result<Axes, ClientError> {
        self.request::<methods::ReadAxes>(&Empty {})
    }

    /// Configuration of Adapter and Port.
    pub fn config(&self) -> Result<ActiveConfig, ClientError> {
        self.request::<methods::ReadConfig>(&Empty {})
    }

    /// Counters of the service and its clients.
    pub fn service_stats(&self) -> Result<ServiceStats, ClientError> {
        self.request::<methods::ReadServiceStats>(&Empty {})
    }

    /// The last events of the bus and the service.
    pub fn events(&self) -> Result<RecordedEvents, ClientError> {
        self.request::<methods::ReadEvents>(&Empty {})
    }

    /// Sends an NMT command. Needs control.
    pub fn nmt(&self, params: &NmtParams) -> Result<(), ClientError> {
        self.request::<methods::SendNmt>(params).map(drop)
    }

    /// Sends a frame. Exactly one later [`Event::Frame`] with the tag reports the result. The age limit
    /// is [`Hello::max_age_ms`].
    ///
    /// # Errors
    /// [`SendError::WindowFull`] while too many frames of the channel have no result.
    pub fn send(&self, gateway: u16, channel: u8, frame: &CanFrame) -> Result<Tag, SendError> {
        self.send_record(gateway, channel, frame, 0)
    }

    /// As [`send`](Self::send), with an age limit of 1 ms to 65.535 s: if the frame waits longer between
    /// its arrival at the service and the cycle, it is rejected with
    /// [`RejectReason::Expired`](crate::protocol::RejectReason::Expired).
    ///
    /// # Errors
    /// As [`send`](Self::send).
    pub fn send_within(
        &self,
        gateway: u16,
        channel: u8,
        frame: &CanFrame,
        max_age: Duration,
    ) -> Result<Tag, SendError> {
        self.send_record(gateway, channel, frame, age_ms(max_age, u16::MAX.into()) as u16)
    }

    fn send_record(
        &self,
        gateway: u16,
        channel: u8,
        frame: &CanFrame,
        max_age_ms: u16,
    ) -> Result<Tag, SendError> {
        if self.hello.access != Access::Control {
            let reason = self.hello.access_reason.clone();
            let reason = reason.unwrap_or_else(|| "the service is read-only".into());
            return Err(SendError::ReadOnly { reason });
        }
        let window = self.hello.window;
        let tag = {
            let mut input = self.input();
            if *input.inbox.in_flight(gateway, channel) >= window && input.inbox.has_room() {
                drop(input);
                // Results that have arrived.
                self.wait(Duration::ZERO, |_| None::<()>)?;
                input = self.input();
            }
            let in_flight = input.inbox.in_flight(gateway, channel);
            if *in_flight >= window {
                return Err(SendError::WindowFull { gateway, channel, window });
            }
            *in_flight += 1;
            let tag = input.next_tag;
            input.next_tag = tag.checked_add(1).unwrap_or(1);
            tag
        };
        let mut payload = Vec::with_capacity(80);
        TransmitRecord { gateway, channel, tag, max_age_ms, frame: *frame }.encode(&mut payload);
        self.write(MessageKind::Transmit, &payload)?;
        Ok(tag)
    }

    /// Number of own frames of a channel without result.
    pub fn in_flight(&self, gateway: u16, channel: u8) -> u32 {
        *self.input().inbox.in_flight(gateway, channel)
    }

    /// Waits for the next event for at most `timeout`; `None` without one. With [`AsFd`] in another
    /// poll loop: the descriptor is readable for new bytes only, so call this with a timeout of zero
    /// until it returns `None` before waiting for the descriptor.
    ///
    /// # Errors
    /// The connection ended. Events that arrived before are returned first.
    pub fn poll(&self, timeout: Duration) -> Result<Option<Event>, ClientError> {
        self.wait(timeout, |input| input.inbox.take_event())
    }

    fn input(&self) -> MutexGuard<'_, Input> {
        self.input.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, kind: MessageKind, payload: &[u8]) -> Result<(), ClientError> {
        let mut message = header(kind, payload.len()).to_vec();
        message.extend_from_slice(payload);
        let _output = self.output.lock().unwrap_or_else(PoisonError::into_inner);
        // The service explains in its last message why it closes the connection.
        match (&self.stream).write_all(&message) {
            Err(error)
                if [ErrorKind::BrokenPipe, ErrorKind::ConnectionReset].contains(&error.kind()) =>
            {
                self.wait(Duration::ZERO, |_| None::<()>)?;
                Err(ClientError::Closed)
            }
            result => Ok(result?),
        }
    }

    /// Reads the socket, or waits for the thread that does, until `take` returns a value.
    fn wait<R>(
        &self,
        timeout: Duration,
        mut take: impl FnMut(&mut Input) -> Option<R>,
    ) -> Result<Option<R>, ClientError> {
        // Without an end if it is beyond the clock's range.
        let end = Instant::now().checked_add(timeout);
        let mut input = self.input();
        loop {
            if let Some(value) = take(&mut input) {
                return Ok(Some(value));
            }
            if let Some(error) = &input.end {
                return Err(error.clone());
            }
            let left =
                end.map_or(Duration::MAX, |end| end.saturating_duration_since(Instant::now()));
            if !input.is_reading {
                input = self.read(input, left);
            } else if !left.is_zero() {
                let waited = self.changed.wait_timeout(input, left.min(REQUEST_TIMEOUT));
                input = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
            if left.is_zero() {
                let end = input.end.clone();
                return take(&mut input)
                    .map_or(end.map_or(Ok(None), Err), |message| Ok(Some(message)));
            }
        }
    }

    /// Waits for bytes, without the lock, and takes them.
    fn read<'a>(
        &'a self,
        mut input: MutexGuard<'a, Input>,
        left: Duration,
    ) -> MutexGuard<'a, Input> {
        input.is_reading = true;
        let mut buffer = std::mem::take(&mut input.buffer);
        drop(input);
        let read = read_some(&self.stream, left, &mut buffer);
        let mut input = self.input();
        input.is_reading = false;
        let result = match read {
            Ok(None) => Ok(()),
            Ok(Some(0)) => Err(ClientError::Closed),
            Ok(Some(count)) => input.inbox.receive(buffer.get(..count).unwrap_or_default()),
            Err(error) => Err(error.into()),
        };
        input.buffer = buffer;
        input.end = result.err();
        self.changed.notify_all();
        input
    }
}

/// An age limit in milliseconds, 1 to `max`.
fn age_ms(age: Duration, max: u32) -> u32 {
    u32::try_from(age.as_millis()).unwrap_or(max).clamp(1, max)
}

/// Reads what arrives within `left`; `None` without anything, 0 at the end.
fn read_some(
    stream: &UnixStream,
    left: Duration,
    buffer: &mut [u8],
) -> Result<Option<usize>, Errno> {
    let mut fds = [PollFd::new(stream, PollFlags::IN)];
    let timeout = Timespec::try_from(left).ok();
    match poll(&mut fds, timeout.as_ref()) {
        Ok(0) | Err(Errno::INTR) => return Ok(None),
        Ok(_) => {}
        Err(error) => return Err(error),
    }
    match recv(stream, buffer, RecvFlags::DONTWAIT) {
        Ok((count, _)) => Ok(Some(count)),
        Err(Errno::INTR | Errno::AGAIN) => Ok(None),
        Err(Errno::CONNRESET) => Ok(Some(0)),
        Err(error) => Err(error),
    }
}

impl AsFd for Client {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }
}
